"""Contents of a certificate: measures, violations, and the tolerances that it grants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Flag, auto
from math import inf, isfinite
from typing import Any

from scp_planner.certificate.tolerances import LARGEST_OFF_STEP, LENGTH_TOLERANCE, STEP_TOLERANCE
from scp_planner.scenario.units import NaturalUnits
from scp_planner.scenario.values import Endless, Finite, Name


@dataclass(frozen=True)
class Clearance:
    """Least signed distance between the vehicle's disc and the zones.

    Attributes
    ----------
    minimum : float
        m; a certified lower bound if the plan is certified; inf without obstacles, -inf if nothing is known.
    obstacle : str or None
        Id of the obstacle.
    time : float or None
        Absolute time, s.
    """

    minimum: Endless = -inf
    obstacle: Name | None = None
    time: Finite | None = None

    def __str__(self) -> str:
        if self.obstacle is None:
            return "no obstacles" if self.minimum > 0.0 else "clearance not known"
        return f"{self.minimum:.4g} m clear of {self.obstacle}"

    def to_dict(self) -> dict[str, Any]:
        """Return the clearance for a file: null without obstacles, no minimum at all if it is not known."""
        minimum = {"minimum": self.minimum if isfinite(self.minimum) else None}
        return {**(minimum if self.minimum > -inf else {}), "obstacle": self.obstacle, "time": self.time}

    def outside(self, units: NaturalUnits) -> Clearance:
        """Return a clearance in the units of its scene in SI units."""
        time = None if self.time is None else units.absolute(self.time)
        return Clearance(self.minimum * units.length, self.obstacle, time)


@dataclass(frozen=True)
class LimitUse:
    """The worst value of a limited quantity over a trip.

    Attributes
    ----------
    worst : float
        In the quantity's SI unit.
    limit : float or None
        In the same unit; None: unbounded.
    time : float
        Absolute time of the worst value, s.
    """

    worst: Finite
    limit: Finite | None
    time: Finite

    def outside(self, units: NaturalUnits, unit: str) -> LimitUse:
        """Return the use of a limit in the units of its scene in SI units, ``unit`` the quantity's own."""
        factor = units.factor(unit)
        # A limit is a number that somebody wrote: without what two roundings made of its last digit.
        limit = None if self.limit is None else float(f"{self.limit * factor:.14g}")
        return LimitUse(self.worst * factor, limit, units.absolute(self.time))


LATEST = "latest arrival"
EARLIEST = "earliest arrival"
OFF_STEP = "arrival off the step"
PASSED = "distance from goals"
BEYOND_ZONES = "arrival beyond what is known of observed obstacles"
INSTANTS = (EARLIEST, LATEST, BEYOND_ZONES)  # what is said of these are times, not durations
UNITS = {
    "clearance": "m",
    "workspace bounds": "m",
    "distance beyond the path": "m",
    "error of the positions": "m",
    "distance from the start": "m",
    "gap between legs": "m",
    "overlap of legs": "s",
    "distance from the goal": "m",
    "distance from the goal region": "m",
    PASSED: "m",
    OFF_STEP: "s",
    "goal speed": "m/s",
    "total_acceleration": "m/s2",
    "power": "m2/s3",
    "start time": "s",
    "travel time": "s",
    EARLIEST: "s",
    LATEST: "s",
    "turn while standing": "rad",
    "speed at rest": "m/s",
    BEYOND_ZONES: "s",
    "start heading": "rad",
    "goal heading": "rad",
    "speed": "m/s",
    "speed_limits": "m/s",
    "start speed": "m/s",
    "goal speed error": "m/s",
    "acceleration": "m/s2",
    "start acceleration error": "m/s2",
    "lateral_acceleration": "m/s2",
    "jerk": "m/s3",
    "curvature": "1/m",
    "curvature_rate": "1/(m s)",
}
"""Units of violations; excesses over users' own constraints have none."""
LIMITS = (
    "speed",
    "speed_limits",
    "acceleration",
    "lateral_acceleration",
    "total_acceleration",
    "jerk",
    "curvature",
    "curvature_rate",
    "power",
)


@dataclass(frozen=True)
class Violation:
    """Something that a plan does not keep.

    Attributes
    ----------
    what : str
        ``clearance``, a limit's name, or an end condition.
    value : float
        The value found, SI.
    allowed : float
        What is allowed, SI.
    time : float
        Absolute time, s.
    obstacle : str or None
        Id, for clearance.
    rounding : float
        A clearance that is not below nothing by more than this is no contact that can be told, m.
    """

    what: str
    value: float
    allowed: float
    time: float
    obstacle: str | None = None
    rounding: float = LENGTH_TOLERANCE

    def outside(self, units: NaturalUnits) -> Violation:
        """Return a violation in the units of its scene in SI units."""
        time = units.absolute(self.time)
        if self.what in INSTANTS:
            value, allowed = units.absolute(self.value), units.absolute(self.allowed)
            return replace(self, value=value, allowed=allowed, time=time)
        factor = units.factor(self.unit.strip())
        return replace(
            self,
            value=self.value * factor,
            allowed=self.allowed * factor,
            time=time,
            rounding=self.rounding * units.length,
        )

    @property
    def unit(self) -> str:
        """Unit of value and allowed, after a space; empty without one."""
        unit = UNITS.get(self.what.partition("[")[0])
        return "" if unit is None else f" {unit}"

    @property
    def is_of_limit(self) -> bool:
        """True if a limit of the vehicle, or of the speed at a place, is not kept."""
        return self.what.partition("[")[0] in LIMITS

    def __str__(self) -> str:
        whom = f" to {self.obstacle}" if self.obstacle is not None else ""
        found, allowed = f"{self.value:.6g}{self.unit}", f"{self.allowed:.6g}{self.unit}"
        if self.obstacle is not None and self.value > -self.rounding:
            found, allowed = "too near 0 m to tell from contact", "0 m"
        return f"{self.what}{whom} {found} at t = {self.time:.3f} s, allowed {allowed}"


def off_a_step(step: float, unit: float = 1.0) -> float:
    """By how much an arrival may miss a step of time, of the same unit as that of the trip's unit of time."""
    return min(LARGEST_OFF_STEP * unit, STEP_TOLERANCE * step)


@dataclass(frozen=True)
class Certificate:
    """The outcome of a check in continuous time.

    Attributes
    ----------
    holds : bool
        Whether every limit and clearance is kept at all times.
    clearance : Clearance
        Least signed distance of the vehicle's disc to the zones; a lower bound if it holds.
    limits : dict of str to LimitUse
    violations : tuple of Violation
    """

    holds: bool
    clearance: Clearance
    limits: dict[str, LimitUse]
    violations: tuple[Violation, ...] = field(default=())

    def __repr__(self) -> str:
        if self.holds:
            return f"Certificate(holds, {self.clearance})"
        more = f", and {len(self.violations) - 1} more" if len(self.violations) > 1 else ""
        return f"Certificate(does not hold: {self.violations[0] if self.violations else 'nothing is known'}{more})"

    def outside(self, units: NaturalUnits) -> Certificate:
        """Return a certificate in the units of its scene in SI units."""
        if units.are_those_of_the_user:
            return self
        violations = tuple(violation.outside(units) for violation in self.violations)
        return Certificate(self.holds, self.clearance.outside(units), uses_outside(self.limits, units), violations)

    @property
    def limits_broken(self) -> int:
        """Number of limits of the vehicle, and of the speed at places, that are not kept."""
        return sum(violation.is_of_limit for violation in self.violations)

    @property
    def late(self) -> bool:
        """True if the trip arrives later than it may, and nothing else is wrong with it."""
        return bool(self.violations) and all(violation.what == LATEST for violation in self.violations)


class Ends(Flag):
    """Ends of a trip that must be those of the scenario."""

    START = auto()
    GOAL = auto()
    BOTH = START | GOAL


def uses_outside(limits: Mapping[str, LimitUse], units: NaturalUnits) -> dict[str, LimitUse]:
    """Return uses of limits, by name, in the units of their scene in SI units."""
    return {name: use.outside(units, UNITS[name.partition("[")[0]]) for name, use in limits.items()}
