"""Attempts where none before led to a certified trip: within stricter limits, and with all the time there is."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import isfinite

from scp_planner.planning.attempts import Attempt
from scp_planner.planning.runs import CheckedRuns, ScpRun, Task
from scp_planner.planning.trip_search import TripSearch
from scp_planner.planning.ways_round import CloserWays, Ways, ways_round
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import changed
from scp_planner.search.starts import coarsenesses

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class StricterSettings:
    """Limits, relative to the scenario's, and efforts, relative to the settings', that are tried in turn."""

    shares: tuple[float, ...] = (0.9, 0.7, 0.5, 0.35)
    most_effort: float = 1000.0  # that settings allow
    efforts: tuple[float, ...] = (2.0, 4.0, 8.0, 16.0)


STRICTER = StricterSettings()
LIMITS = {
    "jerk": ("max_jerk",),
    "curvature": ("max_curvature",),
    "lateral_acceleration": ("max_lateral_acceleration",),
    "acceleration": ("max_acceleration", "max_deceleration"),
}
"""Limits of the vehicle by what a certificate calls them; where none of them is broken, the top speed is lowered."""


class StricterLimits(Attempt[TripSearch, ScpRun]):
    """A trip within stricter limits of what the best trip exceeds, and the fastest one near it: it keeps both."""

    what, most = "start from stricter limits", 2

    def due(self, search: TripSearch) -> bool:
        best = search.best
        if best is None or best.holds or search.cut_off or not search.task.thorough:
            return False
        # What stands stands as well for a slower vehicle
        blocked = any(each.obstacle is not None for each in best.verdict.violations)
        return not blocked or len(best.runs.problem.zones.standing) == 0

    def runs(self, search: TripSearch) -> Iterator[ScpRun]:
        best, task = search.best, search.task
        assert best is not None
        broken = [LIMITS[each.what] for each in best.verdict.violations if each.what in LIMITS]
        fields = tuple(dict.fromkeys(name for names in broken for name in names)) or ("max_speed",)
        for share in STRICTER.shares:
            scenario = _within(task.scenario, fields, share)
            if scenario is None or search.out_of_time:
                return
            found = self._planned(replace(task, scenario=scenario), best)
            if found is not None:
                logger.info("%s: certified at %g of %s", self.what, share, ", ".join(fields))
                runs = CheckedRuns.over(task, found.trajectory.space)
                yield runs.judged(found.run)
                yield runs.attempt(found.trajectory, search.cutoff)
                return

    def _planned(self, task: Task, best: ScpRun) -> ScpRun | None:
        """The fastest certified trip of a stricter scene over the guide of the best trip."""
        runs = CheckedRuns(task, best.trajectory.space.guide)
        search = TripSearch(runs)
        search.walk([*(Ways(runs, coarseness) for coarseness in coarsenesses(runs.problem)), CloserWays()])
        return search.best if search.certified else None


class MoreEffort(Attempt[TripSearch, ScpRun]):
    """The search once more, finer and for more ways each time, until a time limit is used up."""

    what, most = "search with more effort", len(STRICTER.efforts)

    def due(self, search: TripSearch) -> bool:
        limited = isfinite(search.task.deadline) and not search.cut_off
        return limited and search.best is not None and not search.best.holds and search.task.thorough

    def runs(self, search: TripSearch) -> Iterator[ScpRun]:
        task, best = search.task, search.best
        assert best is not None
        for effort in STRICTER.efforts:
            if search.out_of_time or search.certified:
                return
            settings = replace(task.settings, effort=min(effort * task.settings.effort, STRICTER.most_effort))
            runs = CheckedRuns(replace(task, settings=settings), best.trajectory.space.guide)
            over = TripSearch(runs)
            over.walk(ways_round(runs))
            if over.best is not None and over.best.certificate is not None:
                yield over.best


def _within(scenario: Scenario, fields: tuple[str, ...], share: float) -> Scenario | None:
    """A scenario with a share of some limits of the vehicle; None where it begins or ends beyond them."""
    limits = {name: share * getattr(scenario.vehicle, name) for name in fields}
    start, goal = scenario.start, scenario.goal
    least = goal.speed_range[0] if goal.speed_range is not None else goal.speed or 0.0
    if limits.get("max_speed", max(start.speed, least)) < max(start.speed, least):
        return None
    return changed(scenario, vehicle=changed(scenario.vehicle, **limits))
