"""The search once more: within stricter limits, or with more clearance, until what came of it is certified."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

from scp_planner.certificate.check import certify
from scp_planner.certificate.verdict import Violation
from scp_planner.pauses import BEFORE_CHECK, Budget
from scp_planner.planning.plan import Plan, judged_by
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.planning.search import Source
from scp_planner.planning.sources.sides import Sides
from scp_planner.planning.starts import SCENE, OverGuide, Start, TripSearch
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.error_tube import TrackingTube

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RetrySettings:
    """Limits and clearances of further searches."""

    shares: tuple[float, ...] = (0.9, 0.7, 0.5, 0.35)  # of the limits that the best trip breaks, in turn
    most: int = 6  # trips that are planned in a tube; the last has the most clearance that the tube can take
    more: float = 1.05  # times of the missing clearance that are added: the next trip may be a little faster there


RETRIES = RetrySettings()
LIMITS = {
    "jerk": ("max_jerk",),
    "curvature": ("max_curvature",),
    "lateral_acceleration": ("max_lateral_acceleration",),
    "acceleration": ("max_acceleration", "max_deceleration"),
}
"""Limits of the vehicle by what a certificate calls them; where none of them is broken, the top speed is lowered."""


class StricterLimits(Source[Start, ScpRun]):
    """A trip within stricter limits of what the best trip exceeds, and the fastest one near it: it keeps both."""

    name, rank = "stricter limits", 2

    def __init__(self, search: TripSearch) -> None:
        self.search = search

    def children(self, skeleton: Start, found: ScpRun | None) -> Iterator[tuple[float, Start]]:  # noqa: ARG002
        """Yield starts from trips within ever stricter limits, where no trip is certified."""
        search, best = self.search, self.search.best
        task, over = search.task, skeleton.over
        if skeleton.what != SCENE or best is None or best.certificate is None or best.holds:
            return
        if over.cut_off or not task.thorough or task.given is not None:
            return
        violations = best.verdict.violations
        # What stands stands as well for a slower vehicle
        if any(each.obstacle is not None for each in violations) and len(best.runs.problem.zones.standing) > 0:
            return
        broken = [LIMITS[each.what] for each in violations if each.what in LIMITS]
        fields = tuple(dict.fromkeys(name for names in broken for name in names)) or ("max_speed",)
        for share in RETRIES.shares:
            scenario = _within(task.scenario, fields, share)
            if scenario is None or search.certified:
                return
            run = partial(self._from_stricter, best, scenario)
            yield 0.0, Start("start from stricter limits", over, run)

    def _from_stricter(self, best: ScpRun, scenario: Scenario) -> ScpRun | None:
        """Plan within stricter limits, over the guide of the best trip, and go on from there within its own."""
        task = replace(self.search.task, scenario=scenario, thorough=False)
        stricter = TripSearch(CheckedRuns(task, best.trajectory.space.guide))
        stricter.sources = [Sides(stricter)]
        found = stricter.explore(Start(SCENE, OverGuide(stricter.runs)))
        if found is None or not found.holds:
            return None
        runs = CheckedRuns.over(self.search.task, found.trajectory.space)
        kept, faster = runs.judged(found.run), runs.attempt(found.trajectory, self.search.cutoff)
        return faster if faster.better_than(kept) else kept


def _within(scenario: Scenario, fields: tuple[str, ...], share: float) -> Scenario | None:
    """A scenario with a share of some limits of the vehicle; None where it begins or ends beyond them."""
    limits = {name: share * getattr(scenario.vehicle, name) for name in fields}
    start, goal = scenario.start, scenario.goal
    least = goal.speed_range[0] if goal.speed_range is not None else goal.speed or 0.0
    if limits.get("max_speed", max(start.speed, least)) < max(start.speed, least):
        return None
    return changed(scenario, vehicle=changed(scenario.vehicle, **limits))


def plan_in_tube(
    scenario: Scenario, tube: TrackingTube, budget: Budget, plan_one: Callable[[Scenario, Budget], Plan]
) -> Plan:
    """Plan a trip whose tube is certified."""
    # The tube is as wide as the speed and the turns of the trip that is looked for, between its width where the vehicle
    # stands and its bound over all that the vehicle may do. So a first trip keeps the least of it from all obstacles;
    # those that its tube touches get as much more as is missing, until the certificate holds for the tube; at last all
    # get the bound. Obstacles that are passed slowly and straight on take no more clearance than that asks for.
    widest = tube.bound(scenario.vehicle)
    # From each obstacle by its id, and from the walls of the workspace, None, which all keep at least.
    clearances: dict[str | None, float] = dict.fromkeys([None, *(one.id for one in scenario.obstacles)], tube.standing)
    iterations, lower_bound = 0, 0.0
    for left in reversed(range(RETRIES.most)):
        made = plan_one(_with_clearances(scenario, clearances), budget.part(BEFORE_CHECK))
        iterations += made.iterations
        # Every trip with this tube keeps the first, the least clearance of all; of later ones that is not sure.
        lower_bound = lower_bound or made.lower_bound
        found = certify(scenario, made, tube=tube, deadline=budget.last_check)
        # Where there is no trip with this clearance, there is none with more.
        if found.holds or budget.is_over or not made.certified or min(clearances.values()) >= widest:
            break
        clearances = _more(clearances, found.violations, widest) if left > 1 else dict.fromkeys(clearances, widest)
    told = replace(judged_by(made, scenario, found), iterations=iterations, lower_bound=lower_bound)
    return told if found.holds else replace(told, reason=f"with room for the tube of tracking errors: {told.reason}")


def _with_clearances(scenario: Scenario, clearances: Mapping[str | None, float]) -> Scenario:
    """The scenario with a larger vehicle, and with obstacles that are larger still, by the clearance from each, m."""
    radius, walls = scenario.vehicle.radius, clearances[None]
    obstacles = tuple(
        one.model_copy(update={"margin": one.margin + max(clearances[one.id] - walls, 0.0)})
        for one in scenario.obstacles
    )
    vehicle = scenario.vehicle.model_copy(update={"radius": radius + walls})
    return scenario.model_copy(update={"obstacles": obstacles, "vehicle": vehicle})


def _more(
    clearances: Mapping[str | None, float], violations: Iterable[Violation], widest: float
) -> dict[str | None, float]:
    """The clearances, and so much more of them as is missing from what a tube touches; or most of it from all."""
    more = dict(clearances)
    for violation in violations:
        whom = violation.obstacle if violation.obstacle in clearances else None
        missing = max(violation.allowed - violation.value, 0.0)
        more[whom] = min(max(clearances[whom], clearances[None]) + RETRIES.more * missing, widest)
    return more if more != clearances else dict.fromkeys(clearances, widest)
