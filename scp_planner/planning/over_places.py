"""Trips over places to pass: the orders that there are, and guides that lead over them, round what stands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import dist, inf
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.passing import passes_of
from scp_planner.errors import TooLargeError
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.taut import TautLines
from scp_planner.pauses import OutOfTimeError
from scp_planner.planning.plan import Plan
from scp_planner.problem.guides import over_places
from scp_planner.routes.outlines import polygons_around, standing_shapes
from scp_planner.scenario.limits import Box
from scp_planner.scenario.models import Goal, Order, Passage, Scenario
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.threat_zones.target import TargetMotion
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class OverPlacesSettings:
    """Work of a plan over places."""

    orders: int = 3  # that are planned, where any will do
    most_orders: int = 8  # where none of those has a certified plan
    rounds: int = 4  # to targets that move, at most
    slow: float = 1.05  # times the time that is expected of a trip, from which on other guides are tried, too
    gain: float = 1e-3  # relative, of a trip that is led to its targets, below which there are no more rounds


OVER_PLACES = OverPlacesSettings()
PlanOne = Callable[[Scenario, float | None, Trip | None], Plan]
"""Plans a trip along the guide of a scenario within a wall time, s; from a trip over it, if there is one."""


@dataclass(frozen=True)
class _Tried:
    """A plan, and whether it is one of the scenario: not one to where its targets stood in for themselves."""

    plan: Plan
    counts: bool


def plan_over_places(scenario: Scenario, settings: Settings, plan_one: PlanOne, time_limit: float | None) -> Plan:
    """Plan over the places to pass, in the best orders; return the fastest of the certified plans.

    Targets stand at first where they are about when they are met, and then move: the trip over those places is led to
    where they really are. It says when they are met, and they stand there for the next one, while that gains.
    """
    began, tried = perf_counter(), list[_Tried]()
    deadline = inf if time_limit is None else began + time_limit
    asked = visits(scenario, OVER_PLACES.most_orders)
    usual = min(len(asked), OVER_PLACES.orders)
    for place, visit in enumerate(asked):
        best = min((one.plan for one in tried if one.counts), key=_rank, default=None)
        enough = best is not None and best.certified and (place >= usual or best.travel_time <= visit.arrival)
        if enough or (best is not None and perf_counter() > deadline):
            break
        share = deadline if time_limit is None else began + time_limit * min((place + 1) / usual, 1.0)
        tried += _in_order(scenario, visit, settings, plan_one, share)
    iterations = sum(one.plan.iterations for one in tried)
    best = min((one.plan for one in tried if one.counts), key=_rank)
    return replace(best, planned=scenario, iterations=iterations, wall_time=perf_counter() - began)


def _in_order(
    scenario: Scenario, visit: Visit, settings: Settings, plan_one: PlanOne, deadline: float
) -> Iterator[_Tried]:
    """Plan over the places in one order; where targets move, while the trips that are led to them gain."""
    moves = any(one.target is not None for one in scenario.goals)

    def planned(one: Scenario, parts: int, begin: Trip | None = None) -> Plan:
        left = None if deadline == inf else max(deadline - perf_counter(), 0.0) / parts
        return plan_one(one, left, begin)

    again = visit.taken(scenario)
    if not moves:
        guides = over_places(fixed(again), _legs(again, settings, deadline))
        for tried, guided in enumerate(guides):
            yield _Tried(planned(guided, len(guides) - tried), True)
        return
    best_guide, best = 0, inf
    for _ in range(OVER_PLACES.rounds):
        one, led = again, dict[int, tuple[Plan, Plan]]()
        guides = over_places(fixed(one), _legs(one, settings, deadline))
        for place in sorted(range(len(guides)), key=lambda place: place != best_guide):
            nearest = planned(guides[place], 2 * (len(guides) - len(led)))
            yield _Tried(nearest, False)
            assert nearest.planned is not None
            led[place] = nearest, planned(changed(one, guide=nearest.planned.guide), 1, nearest.trip)
            yield _Tried(led[place][1], True)
            if _expected(led[place][1], visit):
                break
        best_guide = min(led, key=lambda place: (not led[place][1].certified, *_rank(led[place][0])))
        nearest, last = led[best_guide]
        visit = visit.led_by(one, nearest.trip)
        again = visit.taken(scenario)
        gains = last.certified and last.travel_time < best * (1.0 - OVER_PLACES.gain)
        if again == one or perf_counter() > deadline or not (gains or best == inf):
            return
        best = last.travel_time if last.certified else best


def _expected(plan: Plan, visit: Visit) -> bool:
    return plan.certified and plan.travel_time <= OVER_PLACES.slow * visit.arrival


def _rank(plan: Plan) -> tuple[bool, float]:
    return not plan.certified, plan.travel_time


def _legs(scenario: Scenario, settings: Settings, deadline: float) -> list[Array]:
    """The shortest way from each place to the next one, (n, 2) m, round what stands; straight where there is none."""
    places = [scenario.start.position, *(one.position for one in scenario.goals), scenario.goal.position]
    straight = [np.array(pair) for pair in pairwise(places)]
    if not (scenario.obstacles or scenario.walls):
        return straight
    units, world = NaturalUnits.of(scenario), PlanningFrame((0.0, 0.0), 0.0, 0.0)
    margin = for_scene(settings, units)
    length = units.length
    batch = ZoneBatch.of(zones(scenario), world, scenario.vehicle.radius + length * margin.clearance_margin)
    shapes = standing_shapes(batch)
    box = Box.of(scenario, world, length * margin.box_margin)
    inside = list(zip(box.normals, box.offsets.tolist(), strict=True))
    found = list[Array]()
    for leg in straight:
        try:
            line = next(iter(TautLines(polygons_around(shapes, leg), leg[0], leg[1], inside, deadline)), None)
        except (OutOfTimeError, TooLargeError):
            line = None
        found.append(leg if line is None else line.points)
    return found


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
