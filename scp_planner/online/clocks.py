"""Stamps of sensors and trackers against the clock of the replans."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Self

from scp_planner.online.tolerances import RELATIVE


@dataclass(frozen=True)
class ClockParameters:
    most_held: int = 1000  # Measurements of one obstacle that are held back; what comes then is dropped
    # Stamps too late by about as much, by which a lead of a sensor's clock is told from single wrong stamps
    alike: int = 5
    calm: int = 50  # Stamps in time in a row after which there is no lead any more: another one is reported anew


CLOCKS = ClockParameters()


@dataclass(frozen=True)
class Stamped:
    """A measurement or a tracker's state of an obstacle."""

    obstacle: str  # Its id
    time: float  # Its stamp, s

    def at(self, time: float) -> Self:
        """A copy with another stamp, s."""
        return replace(self, time=time)


@dataclass
class Lead:
    """Stamps of one obstacle that are too late."""

    held: list[Stamped] = field(default_factory=list)
    ahead: deque[float] = field(default_factory=lambda: deque(maxlen=CLOCKS.alike))  # s
    reported: bool = False
    dropped: bool = False
    calm: int = 0  # Stamps in time since the last one that was too late


class Stamps:
    """Measurements held back, and leads of their stamps."""

    def __init__(self, start: float, period: float) -> None:
        self.now = start
        self._period = period
        self._interval: float | None = None  # between the last two replans; None before the first one
        self._leads: dict[str, Lead] = {}

    @property
    def begun(self) -> bool:
        """True if there has been a replan."""
        return self._interval is not None

    def tick(self, now: float) -> None:
        """Begin a replan at a time, s."""
        self._interval = 0.0 if self._interval is None else now - self.now
        self.now = now

    def latest(self, replanning: bool) -> float:
        """Latest stamp that is in time, s; between replans the next one is expected as late as the last."""
        ahead = self._period if replanning else max(self._period, self._interval or 0.0)
        return self.now + ahead * (1.0 + RELATIVE)

    def due(self) -> Iterator[Stamped]:
        """Take out of what is held back all whose time has come, in order of time."""
        found = []
        for lead in self._leads.values():
            if lead.held:
                found += [one for one in lead.held if one.time <= self.now]
                lead.held = [one for one in lead.held if one.time > self.now]
        yield from sorted(found, key=lambda one: one.time)

    def in_time(self, one: Stamped) -> bool:
        """Note a stamp in time, and drop what is held back of its obstacle; tell if that is the first to be dropped."""
        lead = self._leads.get(one.obstacle)
        if lead is None:
            return False
        first = bool(lead.held) and not lead.dropped
        lead.held, lead.dropped, lead.calm = [], lead.dropped or first, lead.calm + 1
        if lead.calm >= CLOCKS.calm:
            del self._leads[one.obstacle]
        return first

    def hold(self, one: Stamped) -> bool:
        """Hold a measurement back; tell if it is the first one of its obstacle for long."""
        first = one.obstacle not in self._leads
        lead = self._leads.setdefault(one.obstacle, Lead())
        if len(lead.held) < CLOCKS.most_held:
            lead.held.append(one)
        lead.ahead.append(one.time - self.now)
        lead.calm = 0
        return first

    def leading(self) -> dict[str, float]:
        """Leads of obstacles that are constant and have not been reported yet, s: now they have."""
        found, spread = {}, 2.0 * max(self._period, self._interval or 0.0)
        for name, lead in self._leads.items():
            if not lead.reported and len(lead.ahead) == CLOCKS.alike and max(lead.ahead) - min(lead.ahead) <= spread:
                found[name], lead.reported = sum(lead.ahead) / CLOCKS.alike, True
        return found

    def forget(self, name: str) -> None:
        """Drop what is known of the stamps of an obstacle."""
        self._leads.pop(name, None)
