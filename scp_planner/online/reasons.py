"""Reason of a replan's answer, for an operator, and the table of its candidates, for who wants to know more."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum

import numpy as np

from scp_planner.certificate.verdict import Certificate
from scp_planner.scenario.units import NaturalUnits
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class ReasonParameters:
    still: float = 0.05  # Share of the vehicle's top speed, below which an obstacle counts as one that stands


REASONS = ReasonParameters()


class ReasonCode(StrEnum):
    """Kind of reason of a plan."""

    DRIVING = "driving"
    """It leads to the goal."""
    WAITING = "waiting"
    """The vehicle stands, or stops, until an obstacle that moves has passed."""
    GIVING_WAY = "giving_way"
    """The vehicle drives slower for an obstacle, or out of its way."""
    BLOCKED = "blocked"
    """No way to the goal is free, or the goal cannot be met as it is asked for."""
    OUT_OF_TIME = "out_of_time"
    """The deadline left no time to look for a way to the goal; what is driven meanwhile is safe."""
    NOTHING_SAFE = "nothing_safe"
    """Nothing is certified; what is driven is expected to do least harm."""
    ARRIVED = "arrived"
    """The vehicle is at its goal."""


@dataclass(frozen=True)
class Reason:
    code: ReasonCode
    sentence: str
    obstacle: str | None = None
    lasts: float | None = None  # s


class CandidateKind(StrEnum):
    """Kind of a candidate."""

    LAST = "last plan"
    IMPROVED = "last plan, improved"
    ROUTE = "other route"
    SLOWER = "last plan, slower"
    STOP = "stop"
    EVASION = "evasive manoeuvre"


@dataclass(frozen=True)
class Candidate:
    """Something that a replan looked at.

    Attributes
    ----------
    kind : CandidateKind
    inside : Trip
        In units of the scene.
    safe : bool
        Whether the safety gate passed it.
    gate : Certificate or str
        Verdict of the safety gate, in units of the scene.
    units : NaturalUnits
        Those units.
    worth : float or None
        Of evasive manoeuvres: way to the goal that they gain, less what their nearness to obstacles counts, m.
    severity : float or None
        Share: 1 for a certain contact at top speed, where nothing is safe.
    chosen : bool
        Whether it is what is driven.
    """

    kind: CandidateKind
    inside: Trip
    safe: bool
    gate: Certificate | str
    units: NaturalUnits
    worth: float | None = None
    severity: float | None = None
    chosen: bool = False

    @property
    def trip(self) -> Trip:
        """The candidate as a trip."""
        return self.inside.outside(self.units)

    @property
    def verdict(self) -> str:
        """Violations that the safety gate found; empty without any."""
        return worded(self.gate, self.units)

    def __str__(self) -> str:
        numbers = {"worth": self.worth, "severity": self.severity}
        told = [f"{name} {value:.3g}" for name, value in numbers.items() if value is not None]
        verdict = ["safe" if self.safe else self.verdict or "not safe"]
        return f"{'>' if self.chosen else ' '} {self.kind}: {'; '.join(told + verdict)}"


def worded(gate: Certificate | str, units: NaturalUnits) -> str:
    """Tell a verdict of the safety gate in words."""
    return gate if isinstance(gate, str) else "; ".join(map(str, gate.outside(units).violations))


def passes_after(zones: ZoneBatch, name: str | None, top_speed: float) -> float | None:
    """In how many seconds an obstacle has passed a vehicle in the origin, if it keeps its velocity; None if it stands.

    It has when its bounding disc has left the vehicle's, behind the point of closest approach.
    """
    some = np.array([number for number, each in enumerate(zones.ids) if each == name], dtype=np.intp)
    if not some.size:
        return None
    now, zone = np.zeros(1), zones.subset(some)
    place, velocity, reach = zone.centers.grid(now)[0], zone.velocities.grid(now)[0], zone.reach(now)[0]
    speed = np.hypot(*velocity.T)
    if speed.min() < REASONS.still * top_speed:
        return None
    nearest = -np.sum(place * velocity, axis=1) / speed
    across = np.maximum(np.sum(place * place, axis=1) - nearest**2, 0.0)
    after = float(((nearest + np.sqrt(np.maximum(reach**2 - across, 0.0))) / speed).max())
    return after if after > 0.0 else None


class Goes(Enum):
    ON = "drives on"
    SLOWER = "drives slower"
    ASIDE = "moves aside"
    STOPS = "stops"


@dataclass(frozen=True)
class Facts:
    safe: bool
    standing: bool
    goes: Goes
    obstacle: str | None = None
    passes: float | None = None  # s, from now
    arrives: float | None = None  # s, from now
    in_time: bool = True
    broken: str = ""  # Limits, and by how much


def reason_of(facts: Facts) -> Reason:
    """Make the reason of an answer."""
    whom, passes = facts.obstacle, facts.passes
    does = "stands" if facts.standing and facts.goes is Goes.STOPS else facts.goes.value
    about = "" if passes is None else f", for about {passes:.2g} s"
    if not facts.safe:
        clear = "keep clear" if whom is None else f"keep clear of {whom}"
        text = f"Nothing is sure to {clear}; the vehicle {does}, which is likely to do least harm."
        text += f" It breaks limits: {facts.broken}." if facts.broken else ""
        return Reason(ReasonCode.NOTHING_SAFE, text, whom, passes)
    if facts.goes is Goes.ON:
        return Reason(ReasonCode.DRIVING, "The vehicle drives to its goal.", None, facts.arrives)
    if not facts.in_time:
        text = f"There was no time to look for a way to the goal; the vehicle {does}."
        return Reason(ReasonCode.OUT_OF_TIME, text)
    if facts.goes is not Goes.STOPS:
        text = f"The vehicle {does} for {whom}{about}." if whom else f"The vehicle {does}, where more is free."
        return Reason(ReasonCode.GIVING_WAY, text, whom, passes)
    if whom is not None and passes is not None:
        return Reason(ReasonCode.WAITING, f"The vehicle {does} until {whom} has passed{about}.", whom, passes)
    text = "No way to the goal is free" if whom is None else f"{whom} blocks the way to the goal"
    return Reason(ReasonCode.BLOCKED, f"{text}; the vehicle {does}.", whom)


ARRIVED = Reason(ReasonCode.ARRIVED, "The vehicle is at its goal.")
OTHERWISE = Reason(ReasonCode.BLOCKED, "The vehicle is at its goal, with another speed or heading than it asks for.")
NEAR = Reason(ReasonCode.DRIVING, "The vehicle stops at its goal.")
