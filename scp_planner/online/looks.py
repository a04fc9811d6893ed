"""Looks at other ways round, each spread over several replans."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from scp_planner.online.means import IMPROVEMENT, REPLAN, Means, Renewal, Replan
from scp_planner.online.reasons import CandidateKind
from scp_planner.online.remaining import remaining_trip
from scp_planner.online.safety_gate import Vetted
from scp_planner.online.stops import STOPS
from scp_planner.pauses import Coroutine
from scp_planner.planning.plan import Plan
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.parameters import LOOP
from scp_planner.scp.record import FEASIBILITY, LoopRun, LoopStatus
from scp_planner.search.ways import WAYS
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class LookParameters:
    # Units of time to one of length. What the entry into a foreseen zone counts, in comparing ways
    violation_cost: float = 5.0
    # Units of length. Another way that enters foreseen zones, which change with each observation, by less than this may
    # be driven
    nearly_clear: float = 5e-3
    # Of the run that goes on with a route from the last replan
    trust: TrustRegion = field(default=TrustRegion(theta=0.7, beta=2.0, rho=0.2))
    # Share by which another route must be faster, besides `ReplanParameters.route_gain`, for the vehicle to change over
    gain: float = 0.02
    # Without a plan that keeps clear of foreseen zones, looks at other ways round come so many times as often
    sooner: int = 2
    part: int = 3  # Branches of a way that are searched for in one replan
    runs: int = 2  # Ways that are looked at in turn while there is a plan
    # Steps of the loop from another way before a feasible trip is good enough to be driven, and improved on the way
    fewest_steps: int = 2
    spared: int = 1  # Steps fewer are taken in a replan while there is a plan to drive
    # Steps fewer while there is an evasive manoeuvre or a stop, which is evaluated in the same replan
    spared_falling_back: int = 2
    # Relative excess over a limit, or units of length outside of the workspace, from which on no way is begun
    hopeless: float = 0.05


LOOKS = LookParameters()


OVER = object()
"""Stands for a start after the last one."""


@dataclass
class Cutoff:
    """Travel time that ways must beat. A search holds it in place of its look, and so ends when that is dropped."""

    value: float  # Units of time


@dataclass
class Look:
    """A look at other ways round, which goes on from replan to replan."""

    runs: int
    cutoff: Cutoff
    starts: Iterator[Trip | Plan | None] = field(default_factory=lambda: iter(()))
    trip: Trip | None = None
    whole: bool = False  # The trip is a certified plan, to be driven as planned where the loop fails to improve it
    steps: int = 0  # ...after so many steps of the loop
    searching: Coroutine[Any] | None = None  # The search for the next start, where it is under way

    @property
    def over(self) -> bool:
        return self.trip is None and self.searching is None and self.runs <= 0

    def begin_next(self, until: float) -> bool:
        """Search for the next start up to a wall time; whether there is one, or may be one after more of a search."""
        self.trip, self.steps = None, 0
        if self.searching is None:
            if self.runs <= 0:
                return False
            self.searching = Coroutine(partial(next, self.starts, OVER))
        if not self.searching.resume(until):
            return True
        found, self.searching = self.searching.result, None
        if found is OVER:
            return False
        self.whole = isinstance(found, Plan)
        self.trip = found.trip if isinstance(found, Plan) else found
        self.runs -= 0 if found is None else 1
        return True


class Looks:
    """Looks at other ways round, and what is remembered of them between replans."""

    def __init__(self, means: Means) -> None:
        self._means = means
        self._look: Look | None = None
        self._looked = 0

    def __getstate__(self) -> dict[str, Any]:
        """Copies and pickles begin a look under way anew."""
        return {**self.__dict__, "_look": None}

    @property
    def under_way(self) -> bool:
        return self._look is not None and self._look.trip is not None

    def is_due(self, now: Replan, best: Vetted | None) -> bool:
        """True if there is to be a look at other ways in this replan: at once where there is nothing to drive."""
        if now.last is None:
            return True  # a plan is worth waiting for only where there is none at all
        clear = best is None or best.violation <= LOOKS.nearly_clear
        every = self._means.online.look_every // (1 if clear else LOOKS.sooner)
        if best is not None:
            if self._look is None and now.cycle - self._looked < every:
                return False
            if _cutoff(now, best) <= self._means.least_time(now.moment.scenario):
                self._look = None
                return False
        return now.has_time("look", *(IMPROVEMENT if self.under_way else ("problem",)))

    def look(self, now: Replan, fresh: Renewal, best: Vetted | None) -> Vetted | None:
        """Look for a way that is clearly faster than the best so far, or for any; go on with it at the next replan."""
        first, cutoff = now.aimless, math.inf if best is None else _cutoff(now, best)
        if self._look is None:
            runs = self._means.online.first_runs if best is None else LOOKS.runs
            known = Cutoff(cutoff)
            self._look = look = Look(runs, known)
            part = WAYS.branches if first else LOOKS.part
            look.starts = self._means.starts(fresh.problem, lambda: known.value, part)
        look, self._looked = self._look, now.cycle
        # Only a trip that keeps clear takes the place of one that is certified to the goal.
        strict = first or (best is not None and best.certified)
        tolerance = FEASIBILITY if strict else LOOKS.nearly_clear
        found = self._try_ways(now, fresh, look, cutoff, tolerance, best is None)
        if (first and not now.late) or look.over or (found is not None and found.violation <= LOOKS.nearly_clear):
            self._look = None
        return found

    def _spared(self, now: Replan, any_will_do: bool) -> int:
        if not any_will_do:
            return LOOKS.spared
        return LOOKS.spared_falling_back if self._means.gives_way_late and now.last is not None and now.last.safe else 0

    def _try_ways(
        self, now: Replan, fresh: Renewal, look: Look, cutoff: float, tolerance: float, any_will_do: bool
    ) -> Vetted | None:
        """Go on with a look; return the first way that is clear and fast enough, or else one that may become so."""
        first = now.aimless
        most = self._means.settings.max_iterations if first else self._means.online.look_iterations
        left = most * self._means.online.first_runs
        if not first:
            left = max(self._means.online.look_steps - self._spared(now, any_will_do), 1)
        overdue = now.late  # its turn has come all the same: for one step
        left, deadline = 1 if overdue else left, now.until_answer(overdue=overdue)
        spare: Vetted | None = None
        while left > 0:
            if look.trip is None and not self._begins(now, look):
                break
            whole, look.whole = look.trip if look.whole else None, False
            run = self._go_on(now, fresh.loop, look, min(left, most - look.steps), cutoff, deadline)
            evaluation, left = run.evaluation, left - max(len(run.record), 1)
            clear = evaluation.worst_violation <= tolerance
            faster = evaluation.trajectory.travel_time + LOOKS.violation_cost * evaluation.worst_violation < cutoff
            ended = run.status not in (LoopStatus.ITERATION_LIMIT, LoopStatus.TIME_LIMIT) or look.steps >= most
            hopeful = (
                any_will_do and spare is None and (ended or left <= 0) and (first or self._is_hopeful(now, evaluation))
            )
            as_planned = None if whole is None or (clear and faster) else self.as_planned(now, whole)
            if as_planned is not None and as_planned.arrival - now.moment.state.time < cutoff:
                look.trip = None
                return as_planned
            if (clear and faster) or hopeful:
                kind = CandidateKind.ROUTE
                vetted = self._means.vet(now, kind, fresh.problem.frame, evaluation.trajectory, evaluation, look.steps)
                ended = ended or clear
                if isinstance(vetted, Vetted) and clear and not first:
                    return vetted
                if isinstance(vetted, Vetted) and (clear or spare is None):
                    spare = vetted
                    look.cutoff.value = cutoff = vetted.trip.trajectory.travel_time if clear else cutoff
            if ended:
                look.trip = None
            if now.late or (ended and not first):
                break
        return spare

    def as_planned(self, now: Replan, trip: Trip) -> Vetted | None:
        """Pass a planned trip, begun now if the vehicle stands, through the safety gate, if the vehicle is on it."""
        state = now.moment.state
        if state.speed <= STOPS.standing:
            trip = Trip(replace(trip.frame, time=state.time), trip.trajectory)
        if not self._means.safety_gate.is_on(now.moment, trip):
            return None
        vetted = self._means.vet(now, CandidateKind.ROUTE, trip.frame, trip.trajectory)
        return vetted if isinstance(vetted, Vetted) else None

    def _begins(self, now: Replan, look: Look) -> bool:
        """Turn to the next way; whether to go on with it at once: the search is work enough for most replans."""
        more = look.begin_next(now.deadline)
        now.lap("search")
        if not more:
            self._look = None
        return more and now.aimless and look.trip is not None

    def _go_on(self, now: Replan, loop: ScpLoop, look: Look, most: int, cutoff: float, deadline: float) -> LoopRun:
        """Go on with the way that is being tried, by so many steps at most."""
        assert look.trip is not None
        start, trust = look.trip.trajectory, LOOP.first_trust
        if look.trip.frame != loop.problem.frame or start.space is not loop.problem.space:
            led = now.moment.moving is not None
            start = remaining_trip(loop.problem, look.trip, now.moment.state, led=led)
            trust = LOOKS.trust if look.steps else LOOP.first_trust
        enough = None if now.aimless else LOOKS.fewest_steps
        run = loop.run(start, most, cutoff, deadline, trust, enough)
        now.lap("scp", len(run.record))
        look.trip, look.steps = (
            Trip(loop.problem.frame, run.evaluation.trajectory),
            look.steps + max(len(run.record), 1),
        )
        return run

    @staticmethod
    def _is_hopeful(now: Replan, evaluation: Evaluation) -> bool:
        """True if a way that is not clear may become so: others move on, limits do not."""
        return now.moment.state.speed > STOPS.standing and evaluation.limit_violation <= LOOKS.hopeless


def _cutoff(now: Replan, best: Vetted) -> float:
    """In how many units of time another way must reach the goal to be worth changing over to."""
    tau = best.arrival - now.moment.state.time + LOOKS.violation_cost * best.violation
    return tau - max(LOOKS.gain * tau, REPLAN.route_gain)
