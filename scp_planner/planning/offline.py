"""From a scenario to a certified plan: ways round, runs of the loop, the best trip that the certificate holds for."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil, log2
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.check import certify_trip, tell_of_horizon
from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.certificate.verdict import ARRIVAL_TOLERANCE, Certificate, off_a_step
from scp_planner.mathematics.splines import greville_sites
from scp_planner.planning.explain import Ending, explain
from scp_planner.planning.plan import Plan, PlanStatus
from scp_planner.problem.build import EARLIEST_MARGIN, build_problem
from scp_planner.problem.guides import guide_along, may_want_another_guide
from scp_planner.problem.limits.discs import DiscClearance
from scp_planner.problem.near_zones import LONGEST_TRIP, without_far_zones
from scp_planner.problem.problem import Problem
from scp_planner.problem.tightening import TIGHTENINGS, URGENCY, tightened
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.search.first_trips import CLOSE_SMOOTHING, SMOOTHING, bows, trip_along
from scp_planner.search.grid import Fineness
from scp_planner.search.starts import COARSENESSES
from scp_planner.search.ways import WaySearch, WayTree
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.solvers import QpSolver, solver_named
from scp_planner.threat_zones.of_scenario import ZonesOf, zones
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.guide import Guide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory, arriving
from scp_planner.trips.trip import Trip

if TYPE_CHECKING:
    from scp_planner.scp.given import UserConstraints

logger = logging.getLogger(__name__)

CONTINUATIONS = 4  # how often a run that is at its limit of iterations goes on
TOUCHING = 0.02  # units of length; a converged trip is held up only by zones nearer than this
GUIDES = 6  # how often the best path becomes the guide
WORTH_A_GUIDE = 1e-3  # relative gain below which it does not again
FINER, MOST_SPANS = 2, 200  # how often there are three times as many spans of the acceleration, and the most of them
WORTH_MORE_SPANS = 2e-3  # relative gain below which there are no more of them
PROOF_TIME = 1.0  # s of wall time; what a proof that there is no trip may take
GOOD_ENOUGH = 1e-3  # relative distance to the lower bound at which no other way is looked for
SECOND_THOUGHTS = 3  # ways that are started again, closer to them, where no run from any way was certified
ESTIMATE_ERROR = 3.2  # steps of the delay by which a way may turn out better than its estimate
FAR_FROM_BOUND = 1.1  # times the lower bound: trips above that are compared with bows
HOPELESS_AFTER = 8  # iterations, after which a run from a way that is far from feasible makes room for other ways
HARDLY = 0.15  # largest violation of a run that is worth another one, closer to the way
FINER_EFFORT = 2.0  # from this effort on finer grids are searched as well
FINER_GRIDS = (Fineness(stations=1.3, shrunk=0.8), Fineness(stations=1.8, shrunk=0.6))
FEWEST_STEPS, MOST_STEPS = 8, 2  # to a trip whose accelerations change on them; times the wanted number of spans
LATER_STEPS = 3  # at which a trip that is to arrive on a step of time is asked to arrive


def plan(
    scenario: Scenario,
    settings: Settings | None = None,
    solver: str | QpSolver | None = None,
    time_limit: float | None = None,
    constraints: UserConstraints | None = None,
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

    Returns
    -------
    Plan
        With status ``certified`` only if the continuous-time certificate holds, and the given constraints are kept to
        a hundred-thousandth of the trip's length; else the best attempt, with the reason.

    Raises
    ------
    ValueError
        If no solver has that name; if there are constraints and the solver is another than CVXPY; if a constraint is
        not convex by the rules of CVXPY.
    TypeError
        If ``constraints`` returns something else than constraints.
    """
    began = perf_counter()
    settings = settings or Settings()
    if constraints is not None and solver is None and settings.solver == Settings.solver:
        solver = "cvxpy"
    if isinstance(solver, str):
        settings, solver = replace(settings, solver=solver), None
    deadline = np.inf if time_limit is None else began + time_limit
    units = NaturalUnits.of(scenario)
    settings, inside = for_scene(settings, units), units.scenario(scenario)
    given = None if constraints is None else Given(constraints, units)
    at_any_time = _at_any_time(inside)
    search = _Planning(at_any_time, ZonesOf(at_any_time), settings, deadline, own_solver=solver, given=given)
    run, certificate = search.best()
    if constraints is None:  # those are written in stations of the guide
        run, certificate = _over_better_guides(search, run, certificate)
        run, certificate = _with_finer_spans(search, run, certificate)
    if inside.goal.arrival_step is not None:
        run, certificate = _on_a_step(search, inside, run, certificate)
    trip, found = search.trip(run).outside(units), certificate.outside(units)
    status, reason = _status(run, certificate), None
    if status is not PlanStatus.CERTIFIED:
        now = perf_counter()
        hopeless = deadline - now > PROOF_TIME and (certificate.late or not run.feasible)
        ending = Ending.of(run, search.tried, units.time)
        until = deadline if hopeless else now
        reason = explain(scenario, zones(scenario), trip, ending, found, prove_until=until)
    else:
        tell_of_horizon(inside, search.trip(run), units)
    return Plan(
        scenario=scenario.name,
        status=status,
        reason=reason,
        trip=trip,
        method="scp",
        solver=search.solver.name,
        iterations=search.iterations,
        wall_time=perf_counter() - began,
        clearance=found.clearance,
        limits=found.limits,
        lower_bound=search.lower_bound * units.time,
        timings=search.timings,
        converged=run.status is LoopStatus.CONVERGED,
    )


@dataclass(frozen=True)
class _Attempt:
    """A run and what its certificate says; without one if the run was cut off."""

    run: LoopRun
    certificate: Certificate | None

    @property
    def travel_time(self) -> float:
        return self.run.evaluation.trajectory.travel_time

    @property
    def holds(self) -> bool:
        return self.certificate is not None and self.certificate.holds

    @property
    def late(self) -> bool:
        return self.certificate is not None and self.certificate.late

    def better_than(self, other: _Attempt | None) -> bool:
        """Certified before not certified, then faster; without certificates the lesser violation."""
        if self.certificate is None:
            return False
        if other is None:
            return True
        if self.holds != other.holds:
            return self.holds
        if self.holds or (other.late and self.late):
            return self.travel_time < other.travel_time
        return self._wrongs() < other._wrongs()

    def _wrongs(self) -> tuple[float, int, float]:
        """What is worst, to a tenth of a micrometre; how much is wrong; the travel time."""
        wrong = 0 if self.certificate is None else len(self.certificate.violations)
        return round(self.run.evaluation.worst_violation, 7), wrong, self.travel_time


@dataclass
class _Branch:
    """Starts, given how smooth, with the estimate of their travel time, and what the trip from one touched."""

    estimate: float
    start: Callable[[float], Trajectory]
    touched: tuple[tuple[int, int], ...] = ()


def _promise(run: LoopRun) -> tuple[bool, float]:
    """What makes a run better than others: to keep all constraints, and be fast; else to miss them by little."""
    evaluation = run.evaluation
    return not run.feasible, evaluation.trajectory.travel_time if run.feasible else evaluation.worst_violation


def _touched(problem: Problem, run: LoopRun) -> tuple[tuple[int, int], ...]:
    """Zones that a trip touches or enters, the deepest first, and on which side of them it is."""
    evaluation = run.evaluation
    contacts = evaluation.minima_contacts
    near = np.flatnonzero(contacts.distance < TOUCHING)
    order = near[np.argsort(contacts.distance[near], kind="stable")]
    normal = np.broadcast_to(evaluation.minima.path.normal, contacts.normal.shape)
    side = np.einsum("ij,ij->i", contacts.normal, normal)
    found = {int(evaluation.minima_zone[k]): 1 if side[k] > 0.0 else -1 for k in order[::-1]}
    for limit, depth in zip(problem.optional, evaluation.optional, strict=True):
        if isinstance(limit, DiscClearance):
            found.update(limit.touched(evaluation.trajectory, depth, TOUCHING))
    return tuple(reversed(found.items()))


@dataclass(frozen=True)
class Given:
    """A user's own constraints, and the units of the scene, in which they are not written."""

    constraints: UserConstraints
    units: NaturalUnits


def _with_given(problem: Problem, given: Given, solver: QpSolver) -> tuple[Problem, QpSolver]:
    """A problem with a user's own constraints, and the solver that keeps them."""
    from scp_planner.scp.given import GivenConstraints
    from scp_planner.solvers.cvxpy_solver import CvxpySolver

    if not isinstance(solver, CvxpySolver):
        raise ValueError(f"solver: {solver.name!r} cannot take constraints of one's own; cvxpy can")
    kept = GivenConstraints(problem, given.constraints, given.units)
    return replace(problem, given=kept), solver.keeping(kept.on)


@dataclass
class _Planning:
    """The state of one call of :func:`plan`, all of it in the units of the scene."""

    scenario: Scenario
    threat_zones: Sequence[ThreatZone]
    settings: Settings
    deadline: float
    timings: dict[str, float] = field(
        default_factory=lambda: {"build": 0.0, "search": 0.0, "scp": 0.0, "certificate": 0.0}
    )
    iterations: int = 0
    tried: int = 0
    along: Path | None = None  # a path that becomes the guide
    guide: Guide | None = None  # the guide itself
    breakpoints: tuple[float, ...] | None = None  # of the acceleration
    own_solver: QpSolver | None = None
    given: Given | None = None
    incumbent: _Attempt | None = None

    def __post_init__(self) -> None:
        clock = perf_counter()
        if self.along is None:
            everything = build_problem(self.scenario, self.threat_zones, self.settings, self.breakpoints, self.guide)
        else:
            breakpoints = tuple(self.along.space.acceleration.breakpoints.tolist())
            guide = guide_along(self.along, self.settings)
            everything = build_problem(self.scenario, self.threat_zones, self.settings, breakpoints, guide)
        self.solver, fallback = self._solvers()
        if self.given is not None:
            everything, self.solver = _with_given(everything, self.given, self.solver)
        self.lower_bound = kinematic_bound(self.scenario)
        self.everything = everything
        self.problem = without_far_zones(everything, LONGEST_TRIP * self.lower_bound)
        self.loop = ScpLoop(self.problem, self.solver, fallback, HOPELESS_AFTER)
        self.patient_loop = ScpLoop(self.problem, self.solver, fallback)
        self.timings["build"] += perf_counter() - clock

    def _solvers(self) -> tuple[QpSolver, str | None]:
        """The solver, and the name of the one to fall back to, which no user's own solver or constraints allow."""
        if self.own_solver is not None:
            return self.own_solver, None
        name = self.settings.solver
        if self.given is not None:
            return solver_named(name), None
        return solver_named(name), "clarabel" if name != "clarabel" else "daqp"

    def trip(self, run: LoopRun) -> Trip:
        """Return the trip that a run ended with."""
        return Trip(self.problem.frame, run.evaluation.trajectory.settled())

    def judged(self, scenario: Scenario, run: LoopRun) -> Certificate:
        """Return what a certificate, and a user's own constraints, say of the trip that a run ended with."""
        certificate = certify_trip(scenario, self.trip(run), self.threat_zones)
        given = self.problem.given
        return certificate if given is None else given.judged(certificate, run.evaluation.trajectory)

    def best(self) -> tuple[LoopRun, Certificate]:
        """Try ways round, the fastest estimate first, until no other can be expected to be better.

        Other ways than the one just tried differ in the side on which some obstacle is passed. Only obstacles that the
        trip touches can hold it up, so only their sides are closed in turn.
        """
        failed: list[_Branch] = []
        for branch in self._branches():
            attempt = self._try(branch)
            if not attempt.run.feasible and not self._certified:
                failed.append(branch)
            if perf_counter() > self.deadline or self._good_enough:
                break
        best = self.incumbent
        broken = best is not None and best.run.status is LoopStatus.SOLVER_FAILED
        if best is None or not (best.holds or broken or perf_counter() > self.deadline):
            for attempt in self._second_thoughts(failed):
                best = attempt if attempt.better_than(best) else best
                if attempt.holds or perf_counter() > self.deadline:
                    break
        elif best.holds and self._may_be_poor(best):
            attempt = self._from_bows(best)
            best = attempt if attempt.better_than(best) else best
        assert best is not None and best.certificate is not None, "the first start is never cut off"
        return best.run, best.certificate

    def _try(self, branch: _Branch) -> _Attempt:
        """Run the loop from a way, and closer to it once more if that ends hardly infeasible."""
        best = self.incumbent
        rival, cutoff = (best, best.travel_time) if best is not None and best.holds else (None, np.inf)
        self.tried += 1
        attempt = self._attempt(branch.start(SMOOTHING), cutoff, rival)
        run = attempt.run
        if run.status is LoopStatus.INFEASIBLE and run.evaluation.worst_violation < HARDLY:
            self.tried += 1
            again = self._attempt(branch.start(CLOSE_SMOOTHING), cutoff, rival)
            attempt = again if again.better_than(attempt) else attempt
        branch.touched = _touched(self.problem, attempt.run)
        if attempt.better_than(best):
            self.incumbent = attempt
        logger.debug("a way of about %.4f s led to %.4f s", branch.estimate, attempt.travel_time)
        return attempt

    def _second_thoughts(self, failed: Sequence[_Branch]) -> Iterator[_Attempt]:
        """Runs from starts that keep closer to the ways, then from bows: where nothing is certified yet."""
        for branch in failed[:SECOND_THOUGHTS]:
            self.tried += 1
            yield self._attempt(branch.start(CLOSE_SMOOTHING), np.inf, loop=self.patient_loop)
        if self.tried < self.settings.max_runs:
            yield self._from_bows()

    def _from_bows(self, rival: _Attempt | None = None) -> _Attempt:
        """Run the loop from bows, in a race, where the search finds no way, or leads to none that is fast."""
        logger.info("starting from bows")
        clock = perf_counter()
        cutoff = np.inf if rival is None else rival.travel_time
        starts = list(bows(self.problem))
        runs = self.patient_loop.run_all(starts, self.settings.max_iterations, cutoff, self.deadline, race=True)
        self.timings["scp"] += perf_counter() - clock
        self.iterations += sum(len(run.record) for run in runs)
        self.tried += len(runs)
        best = min(runs, key=_promise)
        if rival is not None and _promise(best) >= _promise(rival.run):
            return _Attempt(best, None)
        # Once more from where it ended, with what the samples missed
        return self._attempt(best.evaluation.trajectory, cutoff)

    @property
    def _certified(self) -> bool:
        return self.incumbent is not None and self.incumbent.holds

    @property
    def _good_enough(self) -> bool:
        best, effort = self.incumbent, self.settings.effort
        return best is not None and best.holds and best.travel_time <= self.lower_bound * (1.0 + GOOD_ENOUGH / effort)

    def _may_be_poor(self, best: _Attempt) -> bool:
        """Whether bows are worth a trial, with more effort than usual: the search itself hardly ever needs them."""
        far = best.travel_time > FAR_FROM_BOUND * self.lower_bound
        return far and self.settings.effort >= FINER_EFFORT and perf_counter() < self.deadline

    def _within(self, search: WaySearch) -> float:
        """Estimates above this, s, are of ways that hardly lead to a faster trip."""
        if self.incumbent is None or not self.incumbent.holds:
            return np.inf
        error = ESTIMATE_ERROR * search.grid.delay_step * (1.0 + log2(max(self.settings.effort, 1.0)))
        return self.incumbent.travel_time + error

    def _branches(self) -> Iterator[_Branch]:
        """Ways round with starts for the loop."""
        effort = self.settings.effort
        for coarseness in COARSENESSES:
            count = 0
            for branch in self._branches_on(WaySearch(self.problem, coarseness)):
                count += 1
                yield branch
            if count:
                break
        if effort >= FINER_EFFORT:
            for fineness in FINER_GRIDS:
                yield from self._branches_on(WaySearch(self.problem, fineness=fineness))

    def _branches_on(self, search: WaySearch) -> Iterator[_Branch]:
        """Ways round on one grid."""
        clock = perf_counter()
        effort = self.settings.effort
        tree = WayTree(search, max(1, round(self.settings.searches * effort)), self._within(search))
        for _ in range(max(1, round(self.settings.max_runs * effort))):
            way = tree.next()
            if way is None or way.travel_time > self._within(search):
                break
            branch = _Branch(way.travel_time, partial(trip_along, self.problem, way))
            self.timings["search"] += perf_counter() - clock
            yield branch
            clock = perf_counter()
            tree.branch(branch.touched, self._within(search))
        self.timings["search"] += perf_counter() - clock

    def along_the_guide(self, beta: Array, near: float, cutoff: float) -> _Attempt:
        """Run the loop from the guide itself, driven with given accelerations in about the given time, s."""
        # The new guide may be a little longer than the path that it is: the same accelerations may end before it does.
        problem = self.problem
        return self.from_start(
            arriving(problem.space, problem.ends.theta, beta, problem.limits.acceleration, near),
            cutoff,
            self.patient_loop,
        )

    def from_start(self, start: Trajectory, cutoff: float, loop: ScpLoop | None = None) -> _Attempt:
        """Run the loop from a trip of the problem's space."""
        return self._attempt(start, cutoff, loop=loop)

    def _run(self, loop: ScpLoop, start: Trajectory, cutoff: float, rival: Evaluation | None) -> LoopRun:
        """Run the loop from a start; go on from where it was at its limit of iterations, while it gains by that."""
        most = self.settings.max_iterations
        run = loop.run(start, most, cutoff, self.deadline, rival=rival)
        self.iterations += len(run.record)
        for _ in range(CONTINUATIONS):
            if run.status is not LoopStatus.ITERATION_LIMIT or perf_counter() > self.deadline:
                break
            logger.info("at the limit of %d iterations after %.4f units; going on", most, _promise(run)[1])
            further = loop.run(run.evaluation.trajectory, most, cutoff, self.deadline, rival=rival)
            self.iterations += len(further.record)
            if not _promise(further) < _promise(run):
                break
            run = further
        return run

    def _attempt(
        self, start: Trajectory, cutoff: float, rival: _Attempt | None = None, loop: ScpLoop | None = None
    ) -> _Attempt:
        """Run the loop from a start, and check the result unless it is cut off or no better than the cutoff."""
        loop, problem = loop or self.loop, self.problem
        for repeat in range(TIGHTENINGS + 1):
            clock = perf_counter()
            against = None if rival is None else rival.run.evaluation
            run = self._run(loop, start, cutoff, against)
            self.timings["scp"] += perf_counter() - clock
            slower = not run.feasible or run.evaluation.trajectory.travel_time >= cutoff
            if run.status is LoopStatus.SAME_WAY or (np.isfinite(cutoff) and slower):
                return _Attempt(run, None)
            clock = perf_counter()
            certificate = self.judged(self.scenario, run)
            self.timings["certificate"] += perf_counter() - clock
            if certificate.holds or not run.feasible or certificate.late:
                break
            # What the samples missed: ask for a little more of it, and go on from here.
            if any(v.obstacle is not None and v.obstacle not in problem.zones.ids for v in certificate.violations):
                problem = self.everything  # a trip longer than expected met what was left out
            else:
                problem = tightened(problem, certificate, URGENCY**repeat)
            loop = ScpLoop(problem, self.solver, loop.fallback)
            start = run.evaluation.trajectory
        return _Attempt(run, certificate)


def _over_better_guides(search: _Planning, run: LoopRun, certificate: Certificate) -> tuple[LoopRun, Certificate]:
    """Where the guide limits the best path, take the path as the guide and go on from there, while that gains much."""
    best, problem = _Attempt(run, certificate), search.problem
    for _ in range(GUIDES):
        trajectory = best.run.evaluation.trajectory
        hopeful = not best.holds and not problem.space.guide.straight
        if not (hopeful or may_want_another_guide(problem, trajectory.path)) or perf_counter() > search.deadline:
            break
        again = replace(search, along=trajectory.path)
        attempt = again.along_the_guide(
            trajectory.beta, trajectory.travel_time, best.travel_time if best.holds else np.inf
        )
        search.iterations = again.iterations
        logger.info("a new guide: %.4f s after %.4f s", attempt.travel_time, best.travel_time)
        if not attempt.better_than(best):
            break
        gain = best.travel_time - attempt.travel_time if best.holds else np.inf
        best, problem = attempt, again.problem
        if gain < WORTH_A_GUIDE * best.travel_time:
            break
    assert best.certificate is not None
    return best.run, best.certificate


def _with_finer_spans(search: _Planning, run: LoopRun, certificate: Certificate) -> tuple[LoopRun, Certificate]:
    """Where speed limits of places or of the jerk ask for many switches, take more spans while that gains much."""
    best, spans = _Attempt(run, certificate), search.settings.acceleration_spans
    if search.problem.profile is None and search.scenario.vehicle.max_jerk is None:
        return run, certificate
    for _ in range(FINER):
        spans *= 3
        if spans > MOST_SPANS or perf_counter() > search.deadline:
            break
        trip = best.run.evaluation.trajectory
        finer = replace(search.settings, acceleration_spans=spans)
        again = replace(search, settings=finer, along=None, guide=trip.space.guide, breakpoints=None)
        space = again.problem.space
        degree = space.acceleration.coefficients.shape[1] - 1
        sites = greville_sites(tuple(space.acceleration.breakpoints.tolist()), degree)
        start = Trajectory.of(space, trip.theta, trip.drive_at(sites).acceleration, trip.travel_time)
        attempt = again.from_start(start, best.travel_time if best.holds else np.inf)
        search.iterations = again.iterations
        if not attempt.better_than(best):
            break
        gain = best.travel_time - attempt.travel_time if best.holds else np.inf
        best = attempt
        if gain < WORTH_MORE_SPANS * best.travel_time:
            break
    assert best.certificate is not None
    return best.run, best.certificate


def _at_any_time(scenario: Scenario) -> Scenario:
    """The scenario without the step of its arrival."""
    if scenario.goal.arrival_step is None:
        return scenario
    return changed(scenario, goal=changed(scenario.goal, arrival_step=None))


def _on_a_step(
    search: _Planning, scenario: Scenario, run: LoopRun, certificate: Certificate
) -> tuple[LoopRun, Certificate]:
    """Go on from the fastest trip to one that arrives on the next step of time, or a later one if that fails."""
    goal, trajectory = scenario.goal, run.evaluation.trajectory
    step = goal.arrival_step
    assert step is not None
    if not certificate.holds:
        return run, certificate
    # As it is it is certified for another scenario.
    best = _Attempt(run, search.judged(scenario, run))
    first = ceil((trajectory.travel_time - off_a_step(step)) / step)
    for steps in range(first, first + LATER_STEPS):
        arrival = scenario.start.time + steps * step
        too_late = goal.latest_arrival is not None and arrival > goal.latest_arrival + ARRIVAL_TOLERANCE
        if best.holds or too_late or perf_counter() > search.deadline:
            break
        # The step itself is planned for, not the margin later: it may be missed to both sides.
        timed = changed(scenario, goal=changed(goal, earliest_arrival=arrival - EARLIEST_MARGIN))
        breakpoints = _in_step(trajectory, steps, search.settings)
        again = replace(search, scenario=timed, along=None, guide=trajectory.space.guide, breakpoints=breakpoints)
        attempt = again.from_start(_driven_over(again.problem.space, trajectory), np.inf, again.patient_loop)
        search.iterations = again.iterations
        best = attempt if attempt.better_than(best) else best
    assert best.certificate is not None
    return best.run, best.certificate


def _in_step(trajectory: Trajectory, steps: int, settings: Settings) -> tuple[float, ...]:
    """Breakpoints of the acceleration on steps of time, if these are not too many; else those of a trip."""
    basis = trajectory.space.acceleration
    constant = basis.coefficients.shape[1] == 1
    if constant and FEWEST_STEPS <= steps <= MOST_STEPS * settings.acceleration_spans:
        return tuple(np.linspace(0.0, 1.0, steps + 1).tolist())
    return tuple(basis.breakpoints.tolist())


def _driven_over(space: TripSpace, trip: Trajectory) -> Trajectory:
    """A trip over a space whose breakpoints of the acceleration may be others: it has the same speeds at them."""
    basis = space.acceleration
    if np.array_equal(basis.breakpoints, trip.space.acceleration.breakpoints):
        return Trajectory.of(space, trip.theta, trip.beta, trip.travel_time)
    speeds = trip.speed_at(basis.breakpoints)
    beta = np.diff(speeds) / (np.diff(basis.breakpoints) * trip.travel_time)
    return Trajectory.of(space, trip.theta, beta, trip.travel_time)


def _status(run: LoopRun, certificate: Certificate) -> PlanStatus:
    if certificate.holds:
        return PlanStatus.CERTIFIED
    if certificate.late:
        return PlanStatus.INFEASIBLE
    if run.status is LoopStatus.SOLVER_FAILED and not run.record:
        return PlanStatus.FAILED
    return PlanStatus.FEASIBLE if run.feasible else PlanStatus.INFEASIBLE
