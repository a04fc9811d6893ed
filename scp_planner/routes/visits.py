"""Orders of places to pass, and times at which targets are met, by straight legs at top speed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import dist, inf

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.passing import passes_of
from scp_planner.scenario.models import Goal, Order, Passage, Scenario
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.target import TargetMotion
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class VisitSettings:
    """Times at which meetings are looked for."""

    instants: int = 2001
    first: float = 2.0  # times the drive over all places, until which they are looked for
    doublings: int = 6  # of that, until there is an order


VISITS = VisitSettings()


@dataclass(frozen=True)
class Visit:
    """Places to pass in one order."""

    order: tuple[int, ...]  # of the scenario's goals
    times: tuple[float, ...]  # s, absolute, at which each is passed
    arrival: float  # s after the start, of the model of straight legs

    @classmethod
    def at_unknown_times(cls, scenario: Scenario) -> Visit:
        """Return the order in which a scenario lists its places."""
        return cls(tuple(range(len(scenario.goals))), (inf,) * len(scenario.goals), 0.0)

    def taken(self, scenario: Scenario) -> Scenario:
        """Return a scenario whose goals are in this order, and its targets where they are met."""
        goals = list[object]()
        for k, time in zip(self.order, self.times, strict=True):
            one, motion = scenario.goals[k], TargetMotion.of(scenario, scenario.goals[k])
            goals.append(one if motion is None or time == inf else changed(one, position=motion.place(time)))
        return changed(scenario, goals=tuple(goals), goals_order=Order.GIVEN)

    def led_by(self, taken: Scenario, trip: Trip, onward: Scenario | None = None) -> Visit:
        """Return the same order at times of straight legs that take as long as those of a trip over the places.

        The trip may be under way, in a scenario that begins later, with targets as they are seen then.
        """
        onward = onward or taken
        begun, ends = onward.start.time, trip.frame.time + trip.trajectory.travel_time
        found = passes_of(trip, fixed(taken), begun)
        if not found[-1].passed:
            return self
        legs = _Legs(onward, VISITS.first * (ends - begun))
        times = [0.0, *(one.time - begun for one in found), ends - begun]
        places = [onward.start.position, *(one.position for one in taken.goals), taken.goal.position]
        radii = [0.0, *legs.radii.tolist()]
        delays = [
            times[k + 1] - times[k] - (dist(places[k], places[k + 1]) - radii[k] - radii[k + 1]) / legs.top
            for k in range(len(places) - 1)
        ]
        best = next(legs.best(1, delays), None)
        return self if best is None else replace(best, order=self.order)


def fixed(scenario: Scenario) -> Scenario:
    """Return a scenario whose targets stand where they are about when they are met."""
    return changed(scenario, goals=tuple(changed(one, target=None, offset=(0.0, 0.0)) for one in scenario.goals))


def visits(scenario: Scenario, most: int) -> list[Visit]:
    """Return the fastest orders, fastest first, at most so many; one where the order is given."""
    unknown = Visit.at_unknown_times(scenario)
    given, vehicle, start = scenario.goals_order is Order.GIVEN, scenario.vehicle, scenario.start
    if given and all(one.target is None for one in scenario.goals):
        return [unknown]
    top = max(vehicle.max_speed, start.speed)
    speeding_up = 0.5 * (top - start.speed) ** 2 / (vehicle.max_acceleration * top)
    places = [start.position, *(one.position for one in scenario.goals), scenario.goal.position]
    span = VISITS.first * (sum(dist(p, q) for p, q in pairwise(places)) / top + speeding_up)
    for _ in range(VISITS.doublings):
        found = list(_Legs(scenario, span).best(1 if given else most, (speeding_up, *[0.0] * len(scenario.goals))))
        if found:
            return found
        span *= 2.0
    return [unknown]


@dataclass(frozen=True)
class _Label:
    """The first places of an order: the last of them, where and when that is passed."""

    order: tuple[int, ...]
    times: tuple[float, ...]  # s after the start
    position: Array


class _Legs:
    """Straight legs between places, at top speed, in a span of time, s."""

    def __init__(self, scenario: Scenario, span: float) -> None:
        start, vehicle, count = scenario.start, scenario.vehicle, len(scenario.goals)
        self.scenario, self.times = scenario, np.linspace(0.0, span, VISITS.instants)
        self.top = max(vehicle.max_speed, start.speed)
        self.places = np.empty((count + 1, len(self.times), 2))
        self.radii = np.array([*(one.within(vehicle) for one in scenario.goals), scenario.goal.radius])
        self.windows = np.empty((count + 1, 2))
        goals: list[Goal | Passage] = [*scenario.goals, scenario.goal]
        for k, one in enumerate(goals):
            self.places[k] = TargetMotion.met(scenario, one).places(start.time + self.times)
            low, high = one.earliest_arrival, one.latest_arrival
            self.windows[k] = -inf if low is None else low - start.time, inf if high is None else high - start.time

    def best(self, most: int, delays: Sequence[float]) -> Iterator[Visit]:
        """Yield the fastest orders: of each set of places and its last one, as many are kept.

        Legs take so much longer than at top speed, (K + 1,) s.
        """
        count, begun = len(self.scenario.goals), self.scenario.start.time
        given = self.scenario.goals_order is Order.GIVEN
        labels = [_Label((), (), np.array(self.scenario.start.position))]
        for done in range(count):
            known = dict[tuple[frozenset[int], int], list[_Label]]()
            for label in labels:
                times, positions = self._next(label, delays[done])
                for k in (done,) if given else set(range(count)) - set(label.order):
                    if np.isfinite(times[k]):
                        longer = _Label((*label.order, k), (*label.times, float(times[k])), positions[k])
                        known.setdefault((frozenset(longer.order), k), []).append(longer)
            labels = [one for some in known.values() for one in sorted(some, key=lambda one: one.times[-1])[:most]]
        arrivals = [(float(self._next(label, delays[count])[0][-1]), label) for label in labels]
        for arrival, label in sorted(arrivals, key=lambda one: one[0])[:most]:
            if np.isfinite(arrival):
                yield Visit(label.order, tuple(begun + time for time in label.times), arrival)

    def _next(self, label: _Label, delay: float) -> tuple[Array, Array]:
        """Tell when, (K + 1,) s, or inf, and where, (K + 1, 2) m, each place and the goal is reached after a label."""
        now = (label.times[-1] if label.times else 0.0) + delay
        radius = self.radii[label.order[-1]] if label.order else 0.0
        away = np.hypot(*np.moveaxis(self.places - label.position, 2, 0)) - self.radii[:, None] - radius
        short, late = away - self.top * (self.times - now), np.maximum(now, self.windows[:, 0])
        reached = (short <= 0.0) & (self.times >= late[:, None])
        first, every = reached.argmax(axis=1), np.arange(len(short))
        before = np.maximum(first - 1, 0)
        open_, met = short[every, before], short[every, first]
        share = np.clip(open_ / np.maximum(open_ - met, 1e-300), 0.0, 1.0)
        times = np.maximum(self.times[before] + share * (self.times[first] - self.times[before]), late)
        times = np.where(reached.any(axis=1) & (times <= self.windows[:, 1]), times, inf)
        share = np.where(np.isfinite(times), share, 0.0)[:, None]
        return times, (1.0 - share) * self.places[every, before] + share * self.places[every, first]
