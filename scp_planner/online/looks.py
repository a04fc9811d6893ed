"""Looks at other ways round, each spread over several replans."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from time import perf_counter

from scp_planner.online.means import LOOK_GAIN_TIME, Means, Replan
from scp_planner.online.remaining import remaining_trip
from scp_planner.online.stops import STANDING
from scp_planner.online.vetting import Refusal, Vetted
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.parameters import LOOP
from scp_planner.scp.record import FEASIBILITY, LoopRun, LoopStatus
from scp_planner.search.grid import Fineness
from scp_planner.search.ways import BRANCHES
from scp_planner.trips.trip import Trip

VIOLATION_COST = 5.0
"""Units of time to one of length. What the entry into a foreseen zone counts, in comparing ways."""
NEARLY_CLEAR = 5e-3
"""Units of length. Another way that enters foreseen zones, which change with each observation, by less than this may be
driven."""
LOOK_TRUST = TrustRegion(theta=0.7, beta=2.0, rho=0.2)
LOOK_GAIN = 0.02
"""Another way round must be faster by this share, and by `LOOK_GAIN_TIME`, for the vehicle to change over."""
LOOK_SOONER = 2
"""Without a plan that keeps clear of foreseen zones, looks at other ways round come so many times as often."""
FIRST_LOOK_TIME, LOOK_TIME_DECAY = 0.02, 0.8
"""Seconds of wall time, that a look is expected to take before one has been timed; and how soon it is forgotten."""
PART = 3
"""Branches of a way that are searched for in one replan."""
LOOK_RUNS = 2
"""Ways that are looked at in turn while there is a plan."""
FEWEST_LOOK_STEPS = 2
"""Steps of the loop from another way before a feasible trip is good enough to be driven, and improved on the way."""
SPARED, SPARED_FALLING_BACK = 1, 2
"""Steps fewer of a look are taken in a replan while there is a plan to drive, or a dodge or a stop, which is looked at
in the same replan."""
GRIDS = (Fineness(), Fineness(stations=0.45), Fineness(stations=0.225))
"""Grids of the search for ways: after one that was cut off, the next look takes the next..."""
IN_GOOD_TIME = 1.0 / 3.0
"""...and back to a finer one after a search that has found a way in less than this share of the time that it had."""
HOPELESS = 0.05
"""Relative excess over a limit, or units of length outside of the workspace, from which on no way is begun."""


@dataclass
class Look:
    """A look at other ways round, which goes on from replan to replan."""

    runs: int
    cutoff: float  # Units of time; only ways that may be faster are looked for
    starts: Iterator[Trip | None] = field(default_factory=lambda: iter(()))
    trip: Trip | None = None
    steps: int = 0  # ...after so many steps of the loop
    begun: bool = False

    @property
    def over(self) -> bool:
        """True if the last way has been tried."""
        return self.trip is None and self.runs <= 0

    def begin_next(self) -> bool:
        """Go on to the next start; whether there is one, or may be one after all that is still to be looked at."""
        self.trip, self.steps, self.begun = None, 0, True
        if self.runs <= 0:
            return False
        try:
            self.trip = next(self.starts)
        except StopIteration:
            return False
        self.runs -= 0 if self.trip is None else 1
        return True


class Looks:
    """Looks at other ways round, and what is remembered of them between replans."""

    def __init__(self, means: Means) -> None:
        self._means = means
        self._look_time = FIRST_LOOK_TIME
        self._look: Look | None = None
        self._looked = 0
        self._deadline = math.inf  # of the replan that is under way
        self._grid = 0  # which of `GRIDS` the next search is on

    @property
    def under_way(self) -> bool:
        """True if there is a way that is being tried."""
        return self._look is not None and self._look.trip is not None

    def is_due(self, now: Replan, best: Vetted | None) -> bool:
        """True if there is to be a look at other ways in this replan: at once where there is nothing to drive."""
        if now.last is None:
            return True  # a plan is worth waiting for only where there is none at all
        every = self._means.online.look_every // (1 if best is None or best.violation <= NEARLY_CLEAR else LOOK_SOONER)
        if best is not None:
            if self._look is None and now.cycle - self._looked < every:
                return False
            if _cutoff(now, best) <= self._means.least_time(now.moment.scenario):
                self._look = None
                return False
        # A search for ways that is broken off has found nothing.
        in_time = perf_counter() + self._look_time < now.deadline
        if not in_time:
            self._look_time *= LOOK_TIME_DECAY
        return in_time

    def look(self, now: Replan, loop: ScpLoop, best: Vetted | None) -> tuple[Vetted | None, str]:
        """Look for a way that is clearly faster than the best so far, or for any; go on with it at the next replan."""
        began, problem, first = perf_counter(), loop.problem, now.last is None
        cutoff, self._deadline = math.inf if best is None else _cutoff(now, best), now.deadline
        if self._look is None:
            runs = self._means.online.first_runs if best is None else LOOK_RUNS
            self._look = look = Look(runs, cutoff)
            look.starts = self._means.starts(
                problem, lambda: look.cutoff, lambda: self._deadline, GRIDS[self._grid], BRANCHES if first else PART
            )
        look, self._looked = self._look, now.cycle
        # Only a trip that keeps clear takes the place of one that is certified to the goal.
        strict = first or (best is not None and best.certified)
        tolerance = FEASIBILITY if strict else NEARLY_CLEAR
        found, said = self._try_ways(now, loop, look, cutoff, tolerance, best is None)
        if first or look.over or (found is not None and found.violation <= NEARLY_CLEAR):
            self._look = None
        if not first:
            self._look_time = max(LOOK_TIME_DECAY * self._look_time, perf_counter() - began)
        return found, said

    def _spared(self, now: Replan, any_will_do: bool) -> int:
        if not any_will_do:
            return SPARED
        return SPARED_FALLING_BACK if self._means.gives_way_late and now.last is not None and now.last.safe else 0

    def _try_ways(
        self, now: Replan, loop: ScpLoop, look: Look, cutoff: float, tolerance: float, any_will_do: bool
    ) -> tuple[Vetted | None, str]:
        """Go on with a look; return the first way that is clear and fast enough, or."""
        problem, first = loop.problem, now.last is None
        most = self._means.settings.max_iterations if first else self._means.online.look_iterations
        left = most * self._means.online.first_runs
        if not first:
            left = max(self._means.online.look_steps - self._spared(now, any_will_do), 1)
        spare: Vetted | None = None
        said = "no route was found"
        while left > 0 and perf_counter() <= now.deadline:
            if look.trip is None and not self._begins(now, look):
                break
            run = self._go_on(now, loop, look, min(left, most - look.steps), cutoff)
            evaluation, left = run.evaluation, left - max(len(run.record), 1)
            clear = evaluation.worst_violation <= tolerance
            faster = evaluation.trajectory.travel_time + VIOLATION_COST * evaluation.worst_violation < cutoff
            ended = run.status not in (LoopStatus.ITERATION_LIMIT, LoopStatus.TIME_LIMIT) or look.steps >= most
            hopeful = (
                any_will_do and spare is None and (ended or left <= 0) and (first or self._is_hopeful(now, evaluation))
            )
            if (clear and faster) or hopeful:
                vetted = self._means.vet(now, problem, evaluation.trajectory, evaluation, look.steps)
                ended = ended or clear
                if isinstance(vetted, Refusal):
                    said = vetted.why
                elif clear and not first:
                    return vetted, ""
                elif clear or spare is None:
                    spare = vetted
                    look.cutoff = cutoff = vetted.trip.trajectory.travel_time if clear else cutoff
            if ended:
                look.trip = None
                if not first:
                    break
        return spare, said

    def _begins(self, now: Replan, look: Look) -> bool:
        """Turn to the next way; whether to go on with it at once: the search is work enough for most replans."""
        began, any_way = perf_counter(), look.begun
        more = look.begin_next()
        now.lap("search")
        if now.late:
            self._grid = min(self._grid + 1, len(GRIDS) - 1)
        elif not any_way and now.clock - began < IN_GOOD_TIME * (now.deadline - began):
            self._grid = max(self._grid - 1, 0)
        if not more:
            self._look = None
        return more and now.last is None

    @staticmethod
    def _go_on(now: Replan, loop: ScpLoop, look: Look, most: int, cutoff: float) -> LoopRun:
        """Go on with the way that is being tried, by so many steps at most."""
        assert look.trip is not None
        start, trust = look.trip.trajectory, LOOP.first_trust
        if look.trip.frame != loop.problem.frame:
            start = remaining_trip(loop.problem, look.trip, now.moment.state)
            trust = LOOK_TRUST if look.steps else LOOP.first_trust
        enough = None if now.last is None else FEWEST_LOOK_STEPS
        run = loop.run(start, most, cutoff, now.deadline, trust, enough)
        now.lap("scp")
        look.trip, look.steps = (
            Trip(loop.problem.frame, run.evaluation.trajectory),
            look.steps + max(len(run.record), 1),
        )
        return run

    @staticmethod
    def _is_hopeful(now: Replan, evaluation: Evaluation) -> bool:
        """True if a way that is not clear may become so: others move on, limits do not."""
        return now.moment.state.speed > STANDING and evaluation.limit_violation <= HOPELESS


def _cutoff(now: Replan, best: Vetted) -> float:
    """In how many units of time another way must reach the goal to be worth changing over to."""
    tau = best.arrival - now.moment.state.time + VIOLATION_COST * best.violation
    return tau - max(LOOK_GAIN * tau, LOOK_GAIN_TIME)
