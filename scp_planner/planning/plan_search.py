"""The search for the fastest plan of a scenario, and its public function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import cos, inf, sin
from typing import TYPE_CHECKING

from scp_planner.arrays import Array
from scp_planner.certificate.check import certify
from scp_planner.certificate.lower_bound import lower_bound
from scp_planner.pauses import BEFORE_CHECK, Budget, OutOfTimeError
from scp_planner.planning.one_trip import plan_trip
from scp_planner.planning.plan import Plan, PlanStatus, judged_by
from scp_planner.planning.retries import plan_in_tube
from scp_planner.planning.search import Search, Source
from scp_planner.planning.sources.gears import Gears
from scp_planner.planning.sources.meeting_times import MeetingTimes
from scp_planner.planning.sources.orders import Orders
from scp_planner.planning.sources.routes import RoutesOverMap
from scp_planner.planning.task import Request, Skeleton, check_scenario
from scp_planner.scenario.checks import same_place
from scp_planner.scenario.goal_checks import goal_is_elsewhere
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.tolerances import SAME_PLACE
from scp_planner.scenario.units import changed
from scp_planner.settings.planning import Settings
from scp_planner.solvers import QpSolver
from scp_planner.threat_zones.zone import ThreatZone

if TYPE_CHECKING:
    from scp_planner.scp.given import UserConstraints
    from scp_planner.threat_zones.error_tube import TrackingTube
    from scp_planner.trips.trip import Trip


def plan(
    scenario: Scenario,
    settings: Settings | None = None,
    solver: str | QpSolver | None = None,
    time_limit: float | None = None,
    constraints: UserConstraints | None = None,
    tube: TrackingTube | None = None,
    sources: Sequence[Source[Skeleton, Plan]] = (),
    prove: float | None = None,
) -> Plan:
    """Plan the fastest safe trip of a scenario. Nothing is drawn at random: the same input gives the same plan.

    Parameters
    ----------
    scenario : Scenario
    settings : Settings, optional
    solver : str or QpSolver, optional
        Overrides ``settings.solver``: a name, or a solver of one's own. No other solver takes the place of one's own
        when that fails.
    time_limit : float, optional
        Wall time in s after which the best plan so far is returned.
    constraints : callable, optional
        ``constraints(trip)`` returns convex CVXPY constraints on a :class:`scp_planner.TripVariables`. They go into
        every subproblem, which CVXPY then solves (``solver`` may be a ``CvxpySolver`` with another solver inside).
    tube : TrackingTube, optional
        How far the vehicle may be from its plan, by speed and lateral acceleration: wherever it may be, it keeps clear
        and in the workspace. Then several trips may have to be planned.
    sources : sequence of Source, optional
        Further sources of skeletons, such as guides that were drawn by hand: see :class:`scp_planner.Source`.
    prove : float, optional
        Relative gap that is to be proven: 0.01 asks whether any trip is faster by more than 1 %. ``plan.lower_bound``
        is what was proven in the time that is left, and ``plan.gap`` the gap.

    Returns
    -------
    Plan
        With status ``certified`` only if the continuous-time certificate holds, and the given constraints are kept to
        a hundred-thousandth of the trip's length; else the best attempt, with the reason.

    Raises
    ------
    ValueError
        If the time limit or the gap to prove is negative; if no solver has that name; if there are constraints and the
        solver is another than CVXPY; if a constraint is not convex by the rules of CVXPY.
    TypeError
        If the scenario is none, or ``constraints`` returns something else than constraints.
    EstimationError
        If the vehicle may drive or turn faster than the tube was recorded for.
    TooLargeError
        If it would take more than 500 MB; with the reason, and what to change.
    """
    if time_limit is not None and not time_limit >= 0.0:
        raise ValueError(f"time_limit: {time_limit!r} must not be negative")
    if prove is not None and not prove >= 0.0:
        raise ValueError(f"prove: {prove!r} must not be negative")
    budget = Budget.within(time_limit)
    if tube is None:
        made = solve(scenario, Request.of(settings, solver, constraints, budget), sources=sources)
    else:

        def without(roomier: Scenario, part: Budget) -> Plan:
            return solve(roomier, Request.of(settings, solver, constraints, part), sources=sources)

        made = plan_in_tube(scenario, tube, budget, without)
    if prove is not None and made.certified and made.gap > prove:
        left = budget.left if budget.left < inf else None
        bound = lower_bound(scenario, at_most=made.travel_time, time_limit=left, gap=prove)
        made = replace(made, lower_bound=max(made.lower_bound, bound))
    return replace(made, wall_time=budget.spent)


def planned(
    scenario: Scenario,
    settings: Settings | None = None,
    solver: str | QpSolver | None = None,
    time_limit: float | None = None,
    *,
    thorough: bool = True,
    threat_zones: Sequence[ThreatZone] | None = None,
    along: Array | None = None,
    begin: Trip | None = None,
    sources: Sequence[Source[Skeleton, Plan]] = (),
) -> Plan:
    """Plan a trip ahead, without a map: see :func:`plan`; among zones that are at hand, if there are some.

    A route from start to goal, (n, 2) m, is driven ``along`` at first; or a trip is where the search begins.
    """
    budget, scenario = Budget.within(time_limit), _set_apart(scenario)
    request = Request.of(settings, solver, None, budget, thorough=thorough, threat_zones=threat_zones)
    made = PlanSearch(scenario, request, sources=sources, only=Orders.name).run(
        Skeleton(scenario, line=along, begin=begin)
    )
    return replace(made, wall_time=budget.spent)


def _set_apart(scenario: Scenario) -> Scenario:
    """Return a scenario whose start is not at its goal: a vehicle in a wide goal that is not as asked has to move."""
    start, goal = scenario.start.position, scenario.goal
    if goal.target is not None or not any(goal_is_elsewhere(scenario)):
        return scenario
    goal = changed(goal, radius=0.0, region=None)
    if not same_place(start, goal.position):
        return changed(scenario, goal=goal)
    away = 4.0 * SAME_PLACE * max(scenario.vehicle.radius, *map(abs, start))
    angle = scenario.start.heading or 0.0
    ahead = (start[0] + away * cos(angle), start[1] + away * sin(angle))
    return changed(scenario, goal=changed(goal, position=ahead), guide=None)


def plan_of_legs(
    scenario: Scenario,
    plan_one: Callable[[Scenario, float | None, bool], Plan],
    zones: Sequence[ThreatZone],
    time_limit: float | None = None,
) -> Plan:
    """Plan the fastest trip of several legs, or of one ahead, among zones.

    Each is planned by ``plan_one(scenario, wall time in s, thoroughly)``.
    """
    request = Request.of(None, None, None, Budget.within(time_limit), threat_zones=zones)

    def one(request: Request, skeleton: Skeleton) -> Plan:
        left = request.budget.left
        return plan_one(skeleton.scenario, left if left < inf else None, request.thorough)

    return PlanSearch(scenario, request, one, only=Gears.name).run(Skeleton(scenario))


def solve(scenario: Scenario, request: Request, sources: Sequence[Source[Skeleton, Plan]] = ()) -> Plan:
    """Plan a scenario by all sources."""
    return PlanSearch(scenario, request, sources=sources).run(Skeleton(scenario))


class PlanSearch(Search[Skeleton, Plan]):
    """Search for the fastest plan of a scenario: the order of places, the ground and gears, then single trips."""

    def __init__(
        self,
        scenario: Scenario,
        request: Request,
        plan_one: Callable[[Request, Skeleton], Plan | None] = plan_trip,
        sources: Sequence[Source[Skeleton, Plan]] = (),
        only: str | None = None,
    ) -> None:
        check_scenario(scenario)
        super().__init__(request.log, request.budget)
        self.scenario, self.request, self._plan_one, self._only = scenario, request, plan_one, only
        self.map = RoutesOverMap(self)
        built_in: list[Source[Skeleton, Plan]] = [
            MeetingTimes(self, self.plan_one, self._solve),
            Orders(self, self._solve, request.settings),
            self.map,
            Gears(self, self.plan_one, request.threat_zones),
        ]
        self.sources = [*sources, *(one for one in built_in if only in (None, one.name))]

    def run(self, skeleton: Skeleton) -> Plan:
        """Return the fastest certified plan, or the best attempt."""
        best = self.explore(skeleton)
        if best is None:
            best = self._certify(self.plan_one(Skeleton(self.scenario), Budget.within(0.0), False))
        log = self.log
        made = replace(
            best, planned=self.scenario, iterations=log.iterations, timings=log.timings, tried=(*log.skeletons,)
        )
        if self.map.why_none and not made.certified:
            return replace(made, status=PlanStatus.INFEASIBLE, reason=self.map.why_none)
        return made

    def plan_one(self, skeleton: Skeleton, budget: Budget, thorough: bool) -> Plan:
        """Plan one trip of a skeleton, and log its work."""
        made = self._plan_faster(inf, skeleton, budget, thorough)
        assert made is not None, "without a known time there is a trip"
        return made

    def _plan_faster(self, known: float, skeleton: Skeleton, budget: Budget, thorough: bool) -> Plan | None:
        """Plan one trip of a skeleton that takes less than a known time, s, and log its work."""
        request = replace(self.request, budget=budget, thorough=self.request.thorough and thorough, known=known)
        made = self._plan_one(request, skeleton)
        if made is not None:
            self.log.add(made.timings, made.iterations, made.tried)
        return made

    def _solve(self, skeleton: Skeleton, budget: Budget) -> Plan:
        """Plan a skeleton by all sources, within a part of the budget."""
        return PlanSearch(skeleton.scenario, replace(self.request, budget=budget), only=self._only).run(skeleton)

    def accepts(self, result: Plan) -> bool:
        """True if a plan is certified."""
        return result.certified

    def is_better(self, result: Plan, other: Plan) -> bool:
        """Certified before not certified, then faster; of attempts the first."""
        if result.certified != other.certified:
            return result.certified
        return result.certified and result.travel_time < other.travel_time

    def describe(self, skeleton: Skeleton) -> str:
        """Name the decisions of a skeleton."""
        return ", ".join(skeleton.decided) or "one trip"

    def complete(self, skeleton: Skeleton) -> Plan | None:
        """Plan a skeleton without open decisions, and certify the plan for the scenario."""
        budget = self.budget if skeleton.exact else self.budget.part(BEFORE_CHECK)
        if skeleton.limit < inf:
            budget = budget.part(limit=skeleton.limit)
        try:
            if skeleton.planned is not None:
                made = skeleton.planned(budget)
            else:
                # A line over a map is only about the route of its trip: what begins slower may end faster
                known = self.cutoff if skeleton.line is None else inf
                made = self._plan_faster(known, skeleton, budget, True)
        except OutOfTimeError:
            return None
        return made if made is None or skeleton.exact else self._certify(made)

    def _certify(self, made: Plan) -> Plan:
        """Certify a plan for the scenario that was asked for."""
        with self.log.timed("certificate"):
            checked = certify(self.scenario, made, self.request.threat_zones, deadline=self.budget.last_check)
        return judged_by(made, self.scenario, checked)
