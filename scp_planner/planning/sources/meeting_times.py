"""Times of meetings where more than one trip is decided."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from math import inf

from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.pauses import Budget
from scp_planner.planning.plan import Plan
from scp_planner.planning.search import Search, Source
from scp_planner.planning.sources.one_meeting import MEETING
from scp_planner.planning.task import PlanOne, Skeleton
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.reversing import ahead
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.target import TargetMotion


class MeetingTimes(Source[Skeleton, Plan]):
    """The time of the meeting where more than one trip is to be decided: each try is a search for a goal that stands.

    Trips to where the target is after a time take tau(T); T becomes tau(T) until that is no later. Then the goal is to
    be reached at that time, neither sooner nor later.
    """

    name = "meeting"

    def __init__(
        self, search: Search[Skeleton, Plan], plan_one: PlanOne, solve: Callable[[Skeleton, Budget], Plan]
    ) -> None:
        self.search, self.plan_one, self.solve = search, plan_one, solve

    def decides(self, skeleton: Skeleton) -> bool:
        """True if a target is to be met, and the ground is decided, or there are places to pass."""
        scenario = skeleton.scenario
        ready = scenario.ground is None or bool(scenario.goals)
        return skeleton.planned is None and scenario.goal.target is not None and ready

    def children(self, skeleton: Skeleton, found: Plan | None) -> Iterator[tuple[float, Skeleton]]:  # noqa: ARG002
        """Yield one trip ahead, if that may do, and the search for the time where none is certified."""
        if self.search.due(skeleton) != self.name:
            return
        scenario = skeleton.scenario
        if not scenario.goals:
            one = partial(self._ahead, Skeleton(ahead(scenario)))
            yield 0.0, replace(skeleton.after("one trip"), planned=one)
        if not self.search.certified and kinematic_bound(scenario) < inf:
            planned = partial(self._met, scenario)
            yield (
                kinematic_bound(scenario),
                replace(skeleton.after("time of the meeting", exact=False), planned=planned),
            )

    def _ahead(self, skeleton: Skeleton, budget: Budget) -> Plan | None:
        return self.plan_one(skeleton, budget, True)

    def _met(self, scenario: Scenario, budget: Budget) -> Plan | None:
        target, time = TargetMotion.met(scenario, scenario.goal), kinematic_bound(scenario)
        least = (scenario.goal.earliest_arrival or scenario.start.time) - scenario.start.time
        for _ in range(MEETING.searches):
            before = time = max(time, least)
            if time == inf:
                return None
            made = self.solve(Skeleton(self._at(scenario, target, time)), budget.part(MEETING.share))
            time = made.travel_time if made.certified else MEETING.later * time
            if made.certified and time <= (1.0 + MEETING.far) * before:
                break
        for slower in MEETING.slower:
            on_time = slower * max(time, before)
            made = self.solve(Skeleton(self._at(scenario, target, on_time, exactly=True)), budget.part())
            if made.certified:
                break
        return made

    @staticmethod
    def _at(scenario: Scenario, target: TargetMotion, time: float, *, exactly: bool = False) -> Scenario:
        """Return the scene with a goal that stands where the target is after a time, s."""
        arrival = scenario.start.time + time
        goal = changed(target.goal_at(scenario.goal, arrival), earliest_arrival=None, latest_arrival=None)
        if exactly:
            goal = changed(goal, earliest_arrival=arrival, latest_arrival=arrival)
        return changed(scenario, goal=goal)
