"""Attempts that go on from the best trip: over another guide, with finer splines, or to a step of time."""

from __future__ import annotations

import logging
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import ceil, inf

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.tolerances import ARRIVAL_TOLERANCE
from scp_planner.certificate.verdict import off_a_step
from scp_planner.mathematics.splines import greville_sites
from scp_planner.planning.attempts import ATTEMPTS, Attempt
from scp_planner.planning.runs import CheckedRuns, ScpRun, Task
from scp_planner.planning.trip_search import TripSearch
from scp_planner.problem.guides import may_want_another_guide
from scp_planner.problem.problem import Problem
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import changed
from scp_planner.settings.planning import LONGEST_SPAN, SceneSettings, Settings, for_scene
from scp_planner.trips.trajectory import Trajectory, arriving

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RefinementSettings:
    """Gains that are worth a finer trip, and the finest one."""

    # times the iterations until a trip was found, and iterations: what a better one may cost
    work: int = 3
    least_work: int = 250
    guides: int = 6  # how often the best path becomes the guide
    worth_a_guide: float = 1e-3  # relative gain below which it does not again
    small: float = 0.1  # of a span of the path: zones of a smaller radius are passed by turns that it cannot make
    zones_to_a_span: int = 3  # of those, at most
    # how often there are twice as many spans of the path, and the most of them
    mended: float = 0.02  # violation along a way round what stands, that stricter constraints may mend
    most_along_routes: int = 120  # spans there: with more of them an iteration takes seconds
    finer_paths: int = 3
    shortest: float = 0.1  # units of length, of a span in settings
    most_path_spans: int = 200
    worth_finer_paths: float = 2e-3  # relative gain below which there are no more of them
    notable: float = 5e-4  # relative gain that is expected of them at least: a run that promises less ends early
    mending: float = 0.7  # of the violation of a trip that hardly fails: where shorter spans leave more, they end there
    slowed: float = 1.25e-2  # relative to the lower bound: what less is lost to is hardly the path's splines
    # slope of a path that its spans can hardly follow; spans to the radius of the tightest bend
    unseen: float = 1.0
    tight: float = 1.5
    # for the least radius of the vehicle, at most; and times as many as usual, from which on there are more at once
    spans_to_bend: int = 40
    far_more: float = 1.5
    # how often there are three times as many spans of the acceleration, and the most of them
    finer: int = 2
    most_spans: int = 200
    worth_more_spans: float = 2e-3  # relative gain below which there are no more of them
    # of the last gain by more spans: the next is a third of it, as what they lose goes with their length
    hoped: float = 0.5
    # to a trip whose accelerations change on them; times the wanted number of spans
    fewest_steps: int = 8
    most_steps: int = 2
    straying: float = 0.03  # radii of the vehicle, by which it may be elsewhere after a step of one acceleration
    later_steps: int = 3  # at which a trip that is to arrive on a step of time is asked to arrive


REFINEMENT = RefinementSettings()


def with_short_spans(runs: CheckedRuns, *, bends: bool) -> CheckedRuns:
    """Return runs with shorter spans of the path, where the usual ones do not follow what is in the way; else the same.

    Many zones to a span may be far smaller than it; or the way ``bends`` round what stands, tighter than spans can.
    """
    # One span could not tell which of them are passed on which side, and runs from hardly any way would end well.
    # Spans of a length that the user gave stay as they are, and those over a curved guide, which has enough of them.
    problem, task = runs.problem, runs.task
    space, spans, radius = problem.space, len(problem.space.path.widths), problem.zones.typical_radius
    if task.settings.path_span != SceneSettings.path_span or not space.guide.straight or radius is None:
        return runs
    wanted = 0
    if radius <= REFINEMENT.small * space.length / spans:
        wanted = min(ceil(problem.zones.size / REFINEMENT.zones_to_a_span), task.settings.max_path_spans)
    if bends and np.isfinite(problem.limits.curvature):
        needed = min(ceil(space.length * problem.limits.curvature / REFINEMENT.tight), REFINEMENT.spans_to_bend)
        if needed > REFINEMENT.far_more * spans:
            wanted = max(wanted, min(needed, task.settings.max_path_spans))
    return runs if wanted <= spans else CheckedRuns.over(task, space, spans=wanted)


def refinements(task: Task) -> list[Refinement]:
    """Return the attempts to improve a trip; they may cost a multiple of the work so far."""
    done = task.tally.iterations
    most = done + max(REFINEMENT.work * done, REFINEMENT.least_work)
    finer = FinerPath(1, most)
    # Paths with ever more spans would swerve for what a drive with too few of them loses: first as many as it takes.
    return [
        FinerNearly(REFINEMENT.finer_paths, most),
        BetterGuide(REFINEMENT.guides, most),
        finer,
        FinerDrive(REFINEMENT.finer, most),
        FinerPath(REFINEMENT.finer_paths - 1, most, finer),
    ]


def from_trip(task: Task, trip: Trajectory) -> TripSearch:
    """Return a search over the guide of a trip, warm-started by it."""
    runs = CheckedRuns.over(task, trip.space)
    theta = runs.problem.ends.around(trip.theta[runs.problem.ends.free])
    begin = Trajectory.of(runs.problem.space, theta, trip.beta, trip.travel_time)
    search = TripSearch(runs)
    search.best = runs.attempt(begin, loop=runs.patient_loop)
    task.tally.tried["given trip"] += 1
    return search


class Refinement(Attempt[TripSearch, ScpRun]):
    """Goes on from the best trip over another problem, while that makes it much faster or certified."""

    worth: float  # relative gain below which there is no further one

    def __init__(self, most: int, iterations: float, after: Refinement | None = None) -> None:
        self.most, self.iterations, self.after = most, iterations, after

    def due(self, search: TripSearch) -> bool:  # noqa: ARG002
        """True unless it goes on with a refinement that did not gain much."""
        return self.after is None or self.after.gained >= self.worth

    def runs(self, search: TripSearch) -> Iterator[ScpRun]:
        while search.best is not None and self.promising(search, search.best):
            before = search.best
            yield self.further(search, before)
            after = search.best.travel_time
            logger.info("%s: %.4f units of time after %.4f", self.what, after, before.travel_time)
            if self.gained < self.worth:
                return

    @abstractmethod
    def promising(self, search: TripSearch, best: ScpRun) -> bool:
        """True if the best trip shows that it may gain."""

    @abstractmethod
    def further(self, search: TripSearch, best: ScpRun) -> ScpRun:
        """Go on from the best trip."""


class BetterGuide(Refinement):
    """The path as guide, where the guide limits it."""

    what, worth = "guide along the path", REFINEMENT.worth_a_guide

    def promising(self, search: TripSearch, best: ScpRun) -> bool:  # noqa: ARG002
        curved = not best.holds and not best.runs.problem.space.guide.straight
        return curved or may_want_another_guide(best.runs.problem, best.trajectory.path)

    def further(self, search: TripSearch, best: ScpRun) -> ScpRun:
        runs = CheckedRuns.along(search.task, best.trajectory.path)
        return runs.along_the_guide(best.trajectory.beta, best.travel_time, search.cutoff)


class FinerPath(Refinement):
    """Path spans of half the length, where the path bends within its spans, or fails by little."""

    what, worth = "path with shorter spans", REFINEMENT.worth_finer_paths

    def promising(self, search: TripSearch, best: ScpRun) -> bool:  # noqa: ARG002
        most = REFINEMENT.most_path_spans if best.runs.task.least_time == 0.0 else REFINEMENT.most_along_routes
        return 2 * len(best.trajectory.space.path.widths) <= most and may_gain_by_spans(best)

    def further(self, search: TripSearch, best: ScpRun) -> ScpRun:
        task, space = best.runs.task, best.trajectory.space
        spans = 2 * len(space.path.widths)
        path_span = min(max(space.length / spans, REFINEMENT.shortest), LONGEST_SPAN)
        settings = replace(for_scene(task.settings), path_span=path_span)
        runs = CheckedRuns.over(replace(task, settings=settings), space, spans=spans)
        start, cutoff = over_finer_path(runs.problem, best.trajectory), search.cutoff * (1.0 - REFINEMENT.notable)
        return runs.attempt(start, cutoff, mended=REFINEMENT.mended if task.least_time > 0.0 else 0.0)


class FinerNearly(FinerPath):
    """Path spans of half the length for a trip that hardly fails, and would be faster than the best."""

    what = "faster path that hardly fails"

    def due(self, search: TripSearch) -> bool:
        worthwhile = (1.0 - REFINEMENT.notable) * search.cutoff
        return search.certified and search.nearly is not None and search.nearly.travel_time < worthwhile

    def runs(self, search: TripSearch) -> Iterator[ScpRun]:
        nearly = search.nearly
        while nearly is not None and self.promising(search, nearly):
            before, finer = nearly.run.evaluation.worst_violation, self.further(search, nearly)
            yield finer
            mends = finer.hardly_fails and finer.run.evaluation.worst_violation < REFINEMENT.mending * before
            nearly = finer if mends else None


class FinerDrive(Refinement):
    """Three times as many spans of the acceleration, where limits of places or of the jerk ask for many switches."""

    what, worth = "drive with shorter spans", REFINEMENT.worth_more_spans
    hoped = inf  # gain of the next run, s

    def promising(self, search: TripSearch, best: ScpRun) -> bool:
        if best.runs.problem.profile is None and best.runs.task.scenario.vehicle.max_jerk is None:
            return False
        few = 3 * best.runs.task.settings.acceleration_spans <= REFINEMENT.most_spans
        # Where arrivals count in steps, a gain within one is none.
        return few and best.travel_time - self.hoped <= search.cutoff

    def further(self, search: TripSearch, best: ScpRun) -> ScpRun:
        task, trip = best.runs.task, best.trajectory
        finer = replace(task, settings=replace(task.settings, acceleration_spans=3 * task.settings.acceleration_spans))
        runs = CheckedRuns(finer, trip.space.guide, spans=len(trip.space.path.widths))
        attempt = runs.attempt(over_other_breakpoints(runs.problem, trip), search.cutoff)
        gained = trip.travel_time - attempt.travel_time
        self.hoped = REFINEMENT.hoped * gained if gained > 0.0 else inf
        return attempt


def may_gain_by_spans(best: ScpRun) -> bool:
    """True if shorter spans of the path may make a trip faster, or a certified one."""
    if not best.holds:
        return best.run.evaluation.worst_violation < ATTEMPTS.hardly
    theta, space = best.trajectory.theta, best.trajectory.space
    span = space.length / len(space.path.widths)
    # A path cannot follow within a span what its third derivative jumps by from span to span: times the span squared
    # this is a slope, and in control points their fourth difference over the span.
    unseen = float(np.abs(np.diff(theta, 4)).max(initial=0.0)) / span
    tight = span * float(np.abs(best.trajectory.path.station_bend.curvature).max())
    slowed = best.travel_time > (1.0 + REFINEMENT.slowed) * best.runs.lower_bound
    return slowed and (unseen > REFINEMENT.unseen or tight > REFINEMENT.tight)


def over_finer_path(problem: Problem, trip: Trajectory) -> Trajectory:
    """Return the very same trip over a space whose spans of the path are parts of its own."""
    basis, ends = problem.space.path, problem.ends
    sites = greville_sites(tuple(basis.breakpoints.tolist()), basis.coefficients.shape[1] - 1)
    theta: Array = np.linalg.solve(basis.rows(sites), trip.space.path.rows(sites) @ trip.theta).astype(float)
    return Trajectory.of(problem.space, ends.around(theta[ends.free]), trip.beta, trip.travel_time)


def over_other_breakpoints(problem: Problem, trip: Trajectory, theta: Array | None = None) -> Trajectory:
    """Return about the same trip over a space with other breakpoints, and other offsets if given; it arrives."""
    space = problem.space
    basis = space.acceleration
    degree = basis.coefficients.shape[1] - 1
    if np.array_equal(basis.breakpoints, trip.space.acceleration.breakpoints):
        beta = trip.beta
    elif degree > 0:
        beta = trip.drive_at(greville_sites(tuple(basis.breakpoints.tolist()), degree)).acceleration
    else:
        beta = np.diff(trip.speed_at(basis.breakpoints)) / (np.diff(basis.breakpoints) * trip.travel_time)
    # The same mean accelerations may end before the trip does.
    theta = trip.theta if theta is None else theta
    return arriving(space, theta, beta, problem.limits.acceleration, trip.travel_time)


def at_any_time(scenario: Scenario) -> Scenario:
    """Return the scenario without the step of its arrival."""
    if scenario.goal.arrival_step is None:
        return scenario
    return changed(scenario, goal=changed(scenario.goal, arrival_step=None))


def on_a_step(task: Task, scenario: Scenario, fastest: ScpRun) -> ScpRun:
    """Go on from the fastest trip to one that arrives on the next step of time, or a later one if that fails."""
    step = scenario.goal.arrival_step
    if step is None or not fastest.holds:
        return fastest
    best = fastest.runs.judged(fastest.run, scenario)  # As it is it is certified for another scenario.
    if best.holds and commanded_in_steps(fastest.trajectory, step, scenario.vehicle.radius):
        return best
    search = TripSearch(fastest.runs)
    search.enough = search.lower_bound = 0.0
    search.best = None if best.holds else best
    search.walk([ArrivalOnStep(task, scenario, step, fastest.trajectory, 1 if best.holds else REFINEMENT.later_steps)])
    if best.holds and not search.certified:
        return best
    assert search.best is not None
    return search.best


class ArrivalOnStep(Attempt[TripSearch, ScpRun]):
    """The fastest trip, slowed down to the next step of time, or to a later one where that fails."""

    what = "arrival on a step"

    def __init__(self, task: Task, scenario: Scenario, step: float, fastest: Trajectory, most: int) -> None:
        self.task, self.scenario, self.step, self.fastest, self.most = task, scenario, step, fastest, most

    def runs(self, search: TripSearch) -> Iterator[ScpRun]:
        goal, trip = self.scenario.goal, self.fastest
        first = ceil((trip.travel_time - off_a_step(self.step)) / self.step)
        for steps in range(first, first + self.most):
            arrival = self.scenario.start.time + steps * self.step
            too_late = (
                goal.latest_arrival is not None
                and arrival > goal.latest_arrival + ARRIVAL_TOLERANCE * steps * self.step
            )
            if search.certified or too_late or search.out_of_time:
                return
            # Planned for without a margin: the step may be missed to both sides.
            timed = changed(self.scenario, goal=changed(goal, earliest_arrival=arrival, latest_arrival=arrival))
            task = replace(self.task, scenario=timed, arrival_step=None)
            runs = CheckedRuns.over(task, trip.space, _in_step(trip, steps, task.settings))
            yield runs.attempt(over_other_breakpoints(runs.problem, trip), loop=runs.patient_loop)


def commanded_in_steps(trip: Trajectory, step: float, radius: float) -> bool:
    """Return whether one acceleration a step, s, drives about as far in each step as a trip; the radius is in m."""
    times = np.arange(0.0, trip.travel_time, step)
    drive = trip.drive_at(times / trip.travel_time)
    joined = 0.5 * step * (drive.speed[1:] + drive.speed[:-1])
    return bool(np.abs(np.diff(drive.distance) - joined).max(initial=0.0) <= REFINEMENT.straying * radius)


def _in_step(trajectory: Trajectory, steps: int, settings: Settings) -> tuple[float, ...] | None:
    """Breakpoints of the acceleration on steps of time, if these are not too many; else None."""
    basis = trajectory.space.acceleration
    constant = basis.coefficients.shape[1] == 1
    if constant and REFINEMENT.fewest_steps <= steps <= REFINEMENT.most_steps * settings.acceleration_spans:
        return tuple(np.linspace(0.0, 1.0, steps + 1).tolist())
    return None
