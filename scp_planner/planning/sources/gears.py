"""Sequences of gears: legs ahead and backwards, with turns on the spot, each leg planned as a trip of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from math import inf, pi, remainder
from typing import TypeVar

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.mathematics.dubins import Pose, shortest_paths
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.pauses import Budget, OutOfTimeError
from scp_planner.planning.plan import Plan
from scp_planner.planning.search import Search, Source
from scp_planner.planning.task import PlanOne, Skeleton, is_plain, may_have_legs
from scp_planner.routes.manoeuvres import ManoeuvreSearch
from scp_planner.routes.steered import STEERING, Drive, Steered, SteeredLeg, Steering
from scp_planner.scenario.limits import Limits, straight_travel_time
from scp_planner.scenario.models import Goal, Scenario, Start
from scp_planner.scenario.reversing import ahead, backwards, with_lines
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import zones_of
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.legs import Leg, Legs, Stand


@dataclass(frozen=True)
class GearSettings:
    """Switching poses that leave room for trips between them, and delays of legs."""

    # Of the largest curvature, and radii kept from what moves besides, one after the other
    shares: tuple[tuple[float, float], ...] = ((0.99, 0.0), (0.97, 0.01), (0.93, 0.02))
    room: float = 1e-3  # radii, kept from all that is
    delays: tuple[float, ...] = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0)  # of a leg's time, before it sets out
    corners: int = 8  # pieces of a leg's guide
    steep: float = 0.9  # rad, by which a leg may turn from the straight line to its end, that needs no other guide
    plans: int = 32  # of legs, after which the best so far is taken: four times as many as it takes to park
    share: float = 0.5  # of the time, that the search may take: a trip ahead may be all that there is
    searches: int = 3  # for manoeuvres of other kinds, where those so far lead nowhere
    worth: float = 0.02  # relative: what waits may cost before more curvatures are looked at
    same: float = 1e-3  # relative: a manoeuvre that promises to gain less is not tried


GEARS = GearSettings()
_ANYWHEN = Goal(position=(0.0, 0.0))
EndT = TypeVar("EndT", Start, Goal)


class Gears(Source[Skeleton, Plan]):
    """Legs between the switching poses of manoeuvres, the fastest first; and a trip ahead."""

    name = "gears"

    def __init__(self, search: Search[Skeleton, Plan], plan_one: PlanOne, zones: Sequence[ThreatZone] | None) -> None:
        self.search, self.plan_one, self.zones = search, plan_one, zones

    def decides(self, skeleton: Skeleton) -> bool:
        """True if the vehicle may drive backwards, or turn on the spot."""
        return skeleton.planned is None and may_have_legs(skeleton.scenario)

    def children(self, skeleton: Skeleton, found: Plan | None) -> Iterator[tuple[float, Skeleton]]:
        """Yield legs as they are found, and a trip ahead where none is found, or it may be faster.

        Where one trip came to nothing certified, yield manoeuvres ahead that the vehicle can follow.
        """
        scenario = skeleton.scenario
        if self.search.due(skeleton) != self.name:
            stuck = found is not None and not found.certified and not self.search.certified
            if stuck and skeleton.planned is None and _may_manoeuvre(scenario):
                yield from self._ahead_round(skeleton)
            return
        plans = LegPlans(scenario, self.plan_one, self.zones, self.search.budget)
        least, is_slower = kinematic_bound(scenario), False  # than a trip ahead may be
        with suppress(OutOfTimeError):
            for at_start, at_goal in _turns(scenario):
                what = " and ".join(["turn first"] * at_start + ["turn last"] * at_goal)
                yield least, replace(skeleton.after(what), planned=partial(plans.turned, at_start, at_goal))
            if plans.inside.vehicle.reverse is not None:
                for legs in self._manoeuvres(plans):
                    what = ", ".join("back" if leg.backward else "ahead" for leg in legs.legs)
                    planned = partial(plans.planned, legs)
                    yield legs.time * plans.units.time, replace(skeleton.after(what), planned=planned)
            known = self.search.cutoff
            is_slower = _least_ahead(scenario) < known < inf and plans.leads_ahead(known)
        if is_slower or not self.search.certified:
            planned = partial(self._ahead, Skeleton(ahead(scenario)))
            yield _least_ahead(scenario) if is_slower else 0.0, replace(skeleton.after("ahead"), planned=planned)

    def _ahead_round(self, skeleton: Skeleton) -> Iterator[tuple[float, Skeleton]]:
        plans = LegPlans(skeleton.scenario, self.plan_one, self.zones, self.search.budget)
        with suppress(OutOfTimeError):
            for legs in self._manoeuvres(plans):
                planned = partial(plans.planned, legs)
                yield legs.time * plans.units.time, replace(skeleton.after("manoeuvre ahead"), planned=planned)

    def _ahead(self, skeleton: Skeleton, budget: Budget) -> Plan | None:
        return self.plan_one(skeleton, budget, not self.search.certified)

    def _manoeuvres(self, plans: LegPlans) -> Iterator[Steered]:
        """Yield legs of manoeuvres of the kinds that are found, or of others where those lead nowhere."""
        search = ManoeuvreSearch(plans.inside, plans.batch, plans.curvature, plans.budget)
        kinds, tried = list[tuple[int, ...]](), dict[float, list[Drive]]()
        for _ in range(GEARS.searches):
            manoeuvres = search.run(without=kinds)
            for share, passing in GEARS.shares:
                steering = plans.steering(share, passing)
                drives = [steering.among_standing(each) for each in manoeuvres]
                known = tried.setdefault(share, [])
                yield from self._legs(plans, steering, _others([each[-1] for each in drives], known))
                if not self.search.certified:  # with the legs that they can spare
                    yield from self._legs(
                        plans, steering, _others([one for each in drives for one in each[:-1]], known)
                    )
                if self.search.cutoff <= (1.0 + GEARS.worth) * plans.least:
                    break
            # Other kinds are worth a search while a good part of the budget is left
            if self.search.certified or not manoeuvres or plans.budget.steps <= GEARS.plans // 4:
                return
            kinds += [each.kind for each in manoeuvres]

    def _legs(self, plans: LegPlans, steering: Steering, drives: Sequence[Drive]) -> Iterator[Steered]:
        """Yield the legs of drives, the fastest first, until other ones can gain little."""
        for drive in drives:
            known = self.search.cutoff / plans.units.time * (1.0 - GEARS.same)
            if drive.time >= known:
                break
            legs = steering.improved(drive)
            if legs.good and legs.time < known:
                yield legs
            if drive.missed + drive.deep <= 2.0 * STEERING.missed:
                plans.least = min(plans.least, drive.time * plans.units.time)


class LegPlans:
    """Plans of legs of one scene."""

    def __init__(
        self, scenario: Scenario, plan_one: PlanOne, zones: Sequence[ThreatZone] | None, budget: Budget
    ) -> None:
        """Take a scenario with zones in its units."""
        self.scenario, self.plan_one = with_lines(scenario), plan_one
        self.budget = replace(budget.part(GEARS.share), steps=GEARS.plans)
        self.units = NaturalUnits.of(scenario)
        self.inside = self.units.scenario(self.scenario)
        self.curvature = self.inside.vehicle.max_curvature or 1.0 / self.inside.vehicle.radius
        self.room, frame = GEARS.room / self.curvature, PlanningFrame((0.0, 0.0), 0.0, self.inside.start.time)
        self.radius = self.inside.vehicle.radius + self.room
        # What is estimated is known less well at a later start: all legs keep clear of the zones at the first one
        self.zones = tuple(zones_of(scenario, budget.go_on)) if zones is None else zones
        self.batch = ZoneBatch.of([zone.inside(self.units) for zone in self.zones], frame, self.radius)
        self.least = inf  # s that a manoeuvre takes among what stands alone

    def steering(self, share: float, passing: float) -> Steering:
        """Return what improves drives with a share of the curvature, and a clearance from what moves, radii."""
        radius = self.batch.radius.copy()
        radius[self.batch.moving] += passing / self.curvature
        batch = replace(self.batch, radius=radius)
        return Steering(self.inside, batch, self.radius, share * self.curvature, self.budget)

    def leads_ahead(self, within: float) -> bool:
        """True if a manoeuvre of one leg ahead may take less than a time, s."""
        if self.inside.vehicle.reverse is None:
            return True
        alone = changed(self.inside, vehicle=changed(self.inside.vehicle, reverse=None))
        return bool(ManoeuvreSearch(alone, self.batch, self.curvature, self.budget).run(within / self.units.time))

    def planned(self, steered: Steered, budget: Budget) -> Plan | None:  # noqa: ARG002
        """Plan legs that set out as soon as may be, or else as late as they are known to be clear."""
        made = self._one_by_one(steered, held=False)
        if (made is None or not made.certified) and any(leg.slack > leg.wait for leg in steered.legs):
            return self._one_by_one(steered, held=True) or made
        return made

    def _one_by_one(self, steered: Steered, held: bool) -> Plan | None:
        """Plan legs one after the other, each from where and when the one before it ends."""
        scenario, legs, plans, time = self.scenario, list[Leg](), list[Plan](), self.scenario.start.time
        last = len(steered.legs) - 1
        for number, leg in enumerate(steered.legs):
            start = scenario.start if number == 0 else self._end(scenario.start, leg.poses[0])
            goal = scenario.goal if number == last else self._end(_ANYWHEN, leg.poses[-1])
            made = self._leg(leg, start, goal, time, held)
            if made is None:
                return None
            plans.append(made)
            legs.append(Leg(made.trip, leg.backward))
            time = made.arrival_time
        return self._whole(plans, Legs(tuple(legs), self._begin, Stand(time, legs[-1].state(time)[1])))

    @property
    def _begin(self) -> Stand:
        start = self.scenario.start
        assert start.heading is not None
        return Stand(start.time, start.heading)

    def _whole(self, plans: Sequence[Plan], legs: Legs) -> Plan:
        """One plan of several, and what its certificate says; one leg ahead that sets out at once is a trip."""
        alone = len(legs.legs) == 1 and not legs.legs[0].backward
        at_once = legs.first.time == legs.legs[0].begin and legs.last.time == legs.legs[0].end
        made = replace(
            plans[0],
            scenario=self.scenario.name,
            legs=None if alone and at_once else legs,
            reason=None,
            lower_bound=0.0,
            converged=all(plan.converged for plan in plans),
            timings={},
            iterations=sum(plan.iterations for plan in plans),
            tried=(),
        )
        return made.verified(self.scenario, threat_zones=self.zones, deadline=self.budget.last_check)

    def _leg(self, leg: SteeredLeg, start: Start, goal: Goal, time: float, held: bool) -> Plan | None:
        """Plan a leg that sets out at a time, s, or later if it is not clear then: whichever arrives first."""
        moving = {self.batch.ids[number] for number in self.batch.moving}
        at_once = self._from(leg, changed(start, time=time), goal) if leg.wait > 0.0 and not held else None
        for delay in GEARS.delays:
            begin = time + ((leg.slack if held else leg.wait) + delay * leg.time) * self.units.time
            made = self._from(leg, changed(start, time=begin), goal)
            touched = made.clearance.minimum < self.room * self.units.length and made.clearance.obstacle in moving
            if made.certified or not touched or start.speed > 0.0:
                break
        some = [each for each in (at_once, made) if each is not None and each.certified]
        return min(some, key=lambda each: each.arrival_time, default=None)

    def _from(self, leg: SteeredLeg, start: Start, goal: Goal) -> Plan:
        """Plan a leg from a start, along one guide or another."""
        for corners in _guides(leg.poses[:, :2]):
            places = [self.units.world(place) for place in corners.tolist()]
            guide = (start.position, *places[1:-1], goal.position)
            made = self._one(changed(self.scenario, start=start, goal=goal, guide=guide), leg.backward)
            if made.certified:
                break
        return made

    def _one(self, scene: Scenario, backward: bool = False) -> Plan:
        self.budget.step()
        scene = backwards(scene) if backward else ahead(scene)
        return self.plan_one(Skeleton(scene), self.budget.part(), False)

    def _end(self, end: EndT, pose: Array) -> EndT:
        """An end of a leg at which the vehicle stands."""
        x, y, heading = pose.tolist()
        return changed(end, position=self.units.world((x, y)), heading=heading, speed=0.0)

    def turned(self, at_start: bool, at_goal: bool, budget: Budget) -> Plan | None:  # noqa: ARG002
        """Plan a trip in any direction, after or before turns on the spot."""
        scenario, begin, rate = self.scenario, self._begin, self.scenario.vehicle.max_turn_rate
        assert rate is not None
        goal = changed(scenario.goal, heading=None, speed=0.0) if at_goal else scenario.goal
        scene = changed(scenario, goal=goal)
        if at_start:  # it turns in the direction in which it would set out, and sets out when it has turned
            free = self._one(changed(scene, start=changed(scenario.start, heading=None)))
            heading = float(free.heading(free.start_time))
            turned = begin.time + abs(remainder(heading - begin.heading, 2.0 * pi)) / rate
            scene = changed(scene, start=changed(scenario.start, heading=heading, time=turned))
        made = self._one(scene)
        if not made.certified:
            return None
        leg, time = Leg(made.trip), made.arrival_time
        last = leg.state(time)[1]
        if at_goal and scenario.goal.heading is not None:
            time += abs(remainder(scenario.goal.heading - last, 2.0 * pi)) / rate
            last = scenario.goal.heading
        return self._whole([made], Legs((leg,), begin, Stand(time, last)))


def _others(drives: Sequence[Drive], tried: list[Drive]) -> list[Drive]:
    """Return drives that are not like any that was tried, the fastest first, and count them as tried."""
    found = list[Drive]()
    for drive in sorted(drives, key=lambda each: each.time):
        alike = [each.time for each in tried if each.signs == drive.signs]
        if not any(abs(time - drive.time) <= GEARS.same * drive.time for time in alike):
            found.append(drive)
            tried.append(drive)
    return found


def _guides(places: Array) -> list[Array]:
    """Return guides (m, 2) along places (n, 2) m of a leg: the straight line, if it turns little, and with corners."""
    steps, (x, y) = np.diff(places, axis=0), places[-1] - places[0]
    turned = np.arctan2(x * steps[:, 1] - y * steps[:, 0], x * steps[:, 0] + y * steps[:, 1])
    straight = [places[[0, -1]]] if np.abs(turned).max() < GEARS.steep else []
    return [*straight, places[np.linspace(0, len(places) - 1, GEARS.corners + 1).round().astype(int)]]


def _least_ahead(scenario: Scenario) -> float:
    """No trip that leads ahead alone takes less, s: the shortest way of its curvature over free ground."""
    start, goal, limits = scenario.start, scenario.goal, Limits.of(scenario)
    if scenario.vehicle.max_curvature is None or goal.radius > 0.0 or goal.region is not None or goal.heading is None:
        return kinematic_bound(scenario)
    ends = Pose(start.position, start.heading), Pose(goal.position, goal.heading)
    length = min(path.length for path in shortest_paths(*ends, 1.0 / scenario.vehicle.max_curvature).values())
    return straight_travel_time(length, start.speed, limits, goal.speed)[0]


def _may_manoeuvre(scenario: Scenario) -> bool:
    """True if the vehicle turns in arcs, round what stands."""
    stands = bool(scenario.walls or scenario.obstacles)
    return stands and is_plain(scenario) and None not in (scenario.start.heading, scenario.vehicle.max_curvature)


def _turns(scenario: Scenario) -> list[tuple[bool, bool]]:
    """Return the turns on the spot that are possible: at the start, at the goal, or at both."""
    start, goal = scenario.start, scenario.goal
    if scenario.vehicle.max_turn_rate is None:
        return []
    at_start = [True, False] if start.speed == 0.0 else [False]
    at_goal = [True, False] if goal.heading is not None and not goal.speed else [False]
    return [(first, last) for first in at_start for last in at_goal if first or last]
