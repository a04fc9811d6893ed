"""Places that are left to pass: in which order, and where those that move are by then, by the newest estimates."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from math import cos, inf, sin

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.passing import passes, passes_of
from scp_planner.online.moving_goal import MOVING_GOAL, doubt, motion_seen
from scp_planner.online.plan import AWAY, OnlinePlan
from scp_planner.online.remaining import State
from scp_planner.planning.plan import PlanStatus
from scp_planner.routes.visits import Visit, visits
from scp_planner.scenario.models import Order, Passage, Scenario
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.target import Followed
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trip import Trip

UNSEEN = "a target on the way is not seen"
OUT_OF_REACH = "a target on the way gets away"


class PlacesAhead:
    """The places to pass of a scenario that are left, in units of the scene."""

    def __init__(self, given: Scenario) -> None:
        self.goals = given.goals
        self.left = tuple(range(len(self.goals)))
        self._free = given.goals_order is Order.FASTEST
        self._order: tuple[int, ...] = ()  # Of those that are left; none: not known yet
        self._seen: dict[int, Passage] = {k: one for k, one in enumerate(self.goals) if one.target is None}
        self._taken: Scenario | None = None  # With the places where the last trip was to pass them
        self.passing: tuple[Passage, ...] = ()  # Those that are left in their order, as a trip has to pass them

    @property
    def are_fixed(self) -> bool:
        """True if all that are left stand, and are passed as they are listed."""
        return not self.left or not (self._free or any(self.goals[k].target is not None for k in self.left))

    def drop(self, given: Scenario, state: State, before: State | None, driven: Trip | None) -> tuple[Passage, ...]:
        """Drop the places that are passed, at a state or on a trip since the one before; return those that are left."""
        ahead, now = state.heading or 0.0, state.time

        def here(times: Array) -> tuple[Array, Array]:
            return np.full((len(times), 2), state.position), np.full((len(times), 2), (cos(ahead), sin(ahead)))

        def passed(*some: int) -> int:
            places = tuple(_narrower(self._seen[k], now) for k in some)
            asked = changed(given, goals=places, goals_order=Order.GIVEN)
            found = [passes(here, now, now, asked)]
            if driven is not None and before is not None:
                found.append(passes_of(driven, asked, before.time))
            return max(sum(one.passed and one.time <= now for one in each) for each in found)

        if self._free:
            gone = {k for k in self.left if k in self._seen and passed(k)}
        else:
            known = list(takewhile(self._seen.__contains__, self.left))
            gone = set(known[: passed(*known)])
        if gone:
            kept = [place for place, k in enumerate(self._order) if k not in gone]
            if self._taken is not None:
                self._taken = changed(self._taken, goals=tuple(self._taken.goals[place] for place in kept))
            self.left = tuple(k for k in self.left if k not in gone)
            self._order = () if self._free else self.left
        return tuple(self.goals[k] for k in self.left)

    def placed(self, scenario: Scenario, zones: Sequence[ThreatZone], last: OnlinePlan | None) -> Scenario | str:
        """Return a scenario with the places where they are passed, or why there is none."""
        for k in self.left:
            seen = _followed(self.goals[k], zones)
            if seen is None:
                return UNSEEN
            self._seen[k] = seen
        if not self._order:
            scene = changed(scenario, goals=tuple(self._seen[k] for k in self.left))
            self._order = tuple(self.left[place] for place in visits(scene, 1)[0].order)
            self._taken = None
        ahead = tuple(self._seen[k] for k in self._order)
        scene = changed(scenario, goals=ahead, goals_order=Order.GIVEN)
        visit = self._visit(scene, last)
        if any(time == inf and one.target is not None for time, one in zip(visit.times, ahead, strict=True)):
            return OUT_OF_REACH
        self.passing = tuple(_narrower(one, time) for one, time in zip(ahead, visit.times, strict=True))
        taken = visit.taken(scene)
        self._taken = changed(taken, goals=tuple(map(_narrowest, taken.goals)))
        return self._taken

    def _visit(self, scene: Scenario, last: OnlinePlan | None) -> Visit:
        """Times at which the places are passed: as much later than straight at top speed as on the last trip."""
        follows = last is not None and last.outcome not in AWAY and last.status is not PlanStatus.INFEASIBLE
        if last is not None and follows and self._taken is not None:
            unknown = Visit.at_unknown_times(scene)
            led = unknown.led_by(self._taken, last.trip, scene)
            if led is not unknown:
                return led
        return visits(scene, 1)[0]


def _followed(goal: Passage, zones: Sequence[ThreatZone]) -> Passage | None:
    """A place with the motion by which its target is seen; None where it is not."""
    if goal.target is None:
        return goal
    motion = motion_seen(goal, zones)
    return None if motion is None else changed(goal, target=Followed.model_construct(seen=motion))


def _narrowest(goal: Passage) -> Passage:
    """A place as it is aimed at: within as much of its radius as is left where its target is least known."""
    if not isinstance(goal.target, Followed) or goal.radius is None or goal.target.seen.covariances is None:
        return goal
    return changed(goal, radius=goal.radius * (1.0 - MOVING_GOAL.widest))


def _narrower(goal: Passage, time: float) -> Passage:
    """A place whose target is surely within its radius at a time, s, where its estimate is within this one."""
    if not isinstance(goal.target, Followed) or goal.radius is None or time == inf:
        return goal
    return changed(goal, radius=goal.radius - doubt(goal.target.seen, time, goal.radius))
