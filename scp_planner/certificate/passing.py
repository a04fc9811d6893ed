"""Places to pass and targets to meet on the way: instants at which a motion is within the radius of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from scp_planner.arrays import Array, Mask, unit_vectors
from scp_planner.certificate.tolerances import END_TOLERANCE, ROUNDING
from scp_planner.certificate.verdict import PASSED, Violation
from scp_planner.scenario.models import Order, Passage, Scenario
from scp_planner.threat_zones.target import TargetMotion
from scp_planner.trips.legs import Legs
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class Looks:
    """Instants of a motion that are looked at: one that serves is proof enough."""

    samples: int = 2001  # for each place; round the nearest one an instant is narrowed down
    thirds: int = 60  # times that a third of an interval is left out


LOOKS = Looks()

Motion = Callable[[Array], tuple[Array, Array]]
"""World coordinates, (n, 2), and velocities or directions, (n, 2), at absolute times, (n,)."""


@dataclass(frozen=True)
class Pass:
    """The first instant at which a place is passed; the nearest one of a place that is not."""

    number: int  # of the place among the scenario's goals
    time: float
    distance: float
    passed: bool


def passes(
    motion: Motion, begin: float, end: float, scenario: Scenario, tolerance: float = END_TOLERANCE
) -> tuple[Pass, ...]:
    """Pass the places of a scenario between two times; the last pass may be one of a place that is missed.

    Each is passed after those before it, or, in the fastest order, whenever that is first possible; radii are kept to a
    tolerance, m.
    """
    found, since = list[Pass](), begin
    for number, asked in enumerate(scenario.goals):
        target = TargetMotion.met(scenario, asked)
        begin = since if scenario.goals_order is Order.FASTEST or not found else found[-1].time
        first = begin if asked.earliest_arrival is None else asked.earliest_arrival
        last = end if asked.latest_arrival is None else asked.latest_arrival
        times = np.linspace(min(max(first, begin), end), max(min(last, end), begin), LOOKS.samples)
        radius = asked.within(scenario.vehicle)
        away, ahead = _seen(motion, asked, target, times)
        within = np.flatnonzero(ahead & (away <= radius))
        if len(within):
            k = int(within[0])
            found.append(Pass(number, float(times[k]), float(away[k]), first <= times[k] <= last))
        else:
            k = int(np.argmin(away))
            low, high = times[max(k - 1, 0)], times[min(k + 1, len(times) - 1)]
            time = _nearest(motion, asked, target, float(low), float(high))
            near, turned = _seen(motion, asked, target, np.array([time]))
            passed = bool(turned[0]) and near[0] <= radius + tolerance and first <= time <= last
            found.append(Pass(number, time, float(near[0]), passed))
        if not found[-1].passed:
            break
    return tuple(found)


def passes_of(
    driven: Trip | Legs, scenario: Scenario, since: float | None = None, tolerance: float = END_TOLERANCE
) -> tuple[Pass, ...]:
    """Pass the places of a scenario on a trip, or on legs, from an absolute time on, s."""
    legs = driven if isinstance(driven, Legs) else Legs.of(driven)
    begin, end = legs.first.time, legs.last.time
    begin = begin if since is None else min(max(begin, since), end)

    def motion(times: Array) -> tuple[Array, Array]:
        poses = legs.poses(times)
        return poses[:, :2], unit_vectors(poses[:, 2])

    return passes(motion, begin, end, scenario, tolerance)


def places_missed(found: Sequence[Pass], scenario: Scenario) -> Iterator[Violation]:
    """Yield the violation of the first place that is not passed after those before it, in its heading and time."""
    for one in found:
        if not one.passed:
            radius = scenario.goals[one.number].within(scenario.vehicle)
            yield Violation(f"{PASSED}[{one.number}]", one.distance, radius, one.time)


def _seen(motion: Motion, asked: Passage, target: TargetMotion, times: Array) -> tuple[Array, Mask]:
    """Distances from a place at times, (n,) m, and whether the heading there is one that it asks for."""
    position, direction = motion(times)
    away: Array = np.hypot(*(position - target.places(times)).T)
    if asked.heading_range is None:
        return away, np.ones(len(times), dtype=np.bool_)
    low, high = asked.heading_range
    turn = np.arctan2(direction[:, 1], direction[:, 0]) - 0.5 * (low + high)
    turn -= 2.0 * pi * np.round(turn / (2.0 * pi))
    return away, np.abs(turn) <= 0.5 * (high - low) + ROUNDING


def _nearest(motion: Motion, asked: Passage, target: TargetMotion, low: float, high: float) -> float:
    for _ in range(LOOKS.thirds):
        third = (high - low) / 3.0
        left, right = _seen(motion, asked, target, np.array([low + third, high - third]))[0].tolist()
        low, high = (low, high - third) if left <= right else (low + third, high)
    return 0.5 * (low + high)
