"""Search for the fastest trip of one task: guides, starts over them, and the best run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf

from scp_planner.planning.checked import QUALITY
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.planning.search import Search
from scp_planner.scp.goal import to_beat

SCENE, ROUTE = "scene", "route"


@dataclass
class OverGuide:
    """A problem over one guide, and what its starts came to."""

    runs: CheckedRuns
    is_route: bool = False  # the guide is a route, which may be driven as it is
    classes: int = 0  # homotopy classes that were tried
    certified: bool = False
    failed: bool = False  # a homotopy class led to no trip
    cut_off: bool = False  # there was no time for even the first homotopy class


@dataclass(frozen=True)
class Start:
    """A start of the loop over a guide; without a run, the guide for which starts are to be found."""

    what: str
    over: OverGuide
    run: Callable[[], ScpRun | None] | None = field(default=None, compare=False)


class TripSearch(Search[Start, ScpRun]):
    """Search for the fastest trip of a task, or for one that is faster than a known travel time, s, of a rival."""

    def __init__(self, runs: CheckedRuns, known: float = inf, rival: ScpRun | None = None) -> None:
        task = runs.task
        enough = runs.lower_bound * (1.0 + QUALITY.good_enough / task.settings.effort)
        super().__init__(task.log, task.budget, least=runs.lower_bound, enough=enough, step=task.arrival_step)
        self.runs, self.task, self.known, self.rival = runs, task, known, rival
        self.gained = 0.0  # by the last run over the best before, relative; inf if that is the first that is certified

    @property
    def cutoff(self) -> float:
        """Travel time that another trip has to beat, s."""
        return to_beat(self.best.travel_time, self.arrival_step) if self.best and self.best.holds else self.known

    @property
    def fastest(self) -> ScpRun | None:
        """The best certified run, or else the rival."""
        return self.best if self.certified else self.rival

    def accepts(self, result: ScpRun) -> bool:
        """True if a run is certified."""
        return result.holds

    def is_better(self, result: ScpRun, other: ScpRun) -> bool:
        """Certified before not certified, then faster; without certificates the lesser violation."""
        return result.better_than(other)

    def complete(self, skeleton: Start) -> ScpRun | None:
        """Run the loop from a start; nothing comes of a run that was cut off."""
        assert skeleton.run is not None
        before, self.gained = self.best, 0.0
        found = skeleton.run()
        if found is None:
            return None
        self.log.tried[skeleton.what] += 1
        if found.certificate is None and not found.holds:
            self.count += 1
            return None
        if found.holds and found.better_than(before):
            self.gained = before.travel_time / found.travel_time - 1.0 if before is not None and before.holds else inf
            skeleton.over.certified = True
        return found

    def is_open(self, skeleton: Start) -> bool:
        """True if starts over a guide are still to be found."""
        return skeleton.run is None

    def describe(self, skeleton: Start) -> str:
        """Name a start."""
        return skeleton.what
