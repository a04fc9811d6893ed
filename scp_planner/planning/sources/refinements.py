"""Refinements of the best trip: over its path as the guide, with finer splines, or to a step of time."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from math import ceil, inf

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.tolerances import ARRIVAL_TOLERANCE
from scp_planner.certificate.verdict import off_a_step
from scp_planner.mathematics.splines import greville_sites
from scp_planner.planning.checked import QUALITY
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.planning.search import Source
from scp_planner.planning.starts import SCENE, OverGuide, Start, TripSearch
from scp_planner.planning.task import Task
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
    mended: float = 0.02  # violation along a route round what stands, that stricter constraints may mend
    most_along_routes: int = 120  # spans there: with more of them an iteration takes seconds
    finer_paths: int = 3  # how often there are twice as many spans of the path
    shortest: float = 0.1  # units of length, of a span in settings
    most_path_spans: int = 200
    worth_finer_paths: float = 2e-3  # relative gain below which there are no more of them
    notable: float = 5e-4  # relative gain that is expected of them at least: a run that promises less ends early
    slowed: float = 1.25e-2  # relative to the lower bound: what less is lost to is hardly the path's splines
    unseen: float = 1.0  # slope of a path that its spans can hardly follow
    tight: float = 1.5  # spans to the radius of the tightest bend
    spans_to_bend: int = 40  # for the least radius of the vehicle, at most
    far_more: float = 1.5  # times as many as usual, from which on there are more at once
    finer: int = 2  # how often there are three times as many spans of the acceleration
    most_spans: int = 200  # of the acceleration
    worth_more_spans: float = 2e-3  # relative gain below which there are no more of them
    # of the last gain by more spans: the next is a third of it, as what they lose goes with their length
    hoped: float = 0.5
    fewest_steps: int = 8  # to a trip whose accelerations change on steps of time
    most_steps: int = 2  # times the wanted number of spans, to such a trip
    straying: float = 0.03  # radii of the vehicle, by which it may be elsewhere after a step of one acceleration
    later_steps: int = 3  # at which a trip that is to arrive on a step of time is asked to arrive


REFINEMENT = RefinementSettings()


def with_short_spans(runs: CheckedRuns, *, bends: bool) -> CheckedRuns:
    """Return runs with shorter spans of the path, where the usual ones do not follow what is in the way; else the same.

    Many zones to a span may be far smaller than it; or the shortest route ``bends`` tighter than spans can.
    """
    # One span could not tell which of them are passed on which side, and runs from hardly any class would end well.
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


@dataclass(frozen=True)
class _Kind:
    """One kind of refinement."""

    what: str
    worth: float  # relative gain below which there is no further one
    promising: Callable[[ScpRun], bool]
    further: Callable[[ScpRun], ScpRun]


class Refinements(Source[Start, ScpRun]):
    """The best trip over another problem, each time while that makes it much faster or certified.

    Paired on the hard set: without the path as the guide, trips are slower by up to 0.39 %; without shorter spans of
    the path, by up to 0.9 %. Shorter spans of the drive are for limits of places and of the jerk alone.
    """

    name, rank = "refinements", 3

    def __init__(self, search: TripSearch) -> None:
        self.search = search
        self._hoped = inf  # gain of the next run with more spans of the drive, s

    def children(self, skeleton: Start, found: ScpRun | None) -> Iterator[tuple[float, Start]]:  # noqa: ARG002
        """Yield the best trip refined; that may cost a multiple of the work so far."""
        search, over = self.search, skeleton.over
        if skeleton.what != SCENE:
            return
        search.best = search.best or search.rival
        best, goal = search.best, search.task.scenario.goal
        if search.task.given is not None or best is None:  # constraints are written in stations of the guide
            return
        arrival, latest = search.task.scenario.start.time + best.travel_time, goal.latest_arrival
        if not (search.task.thorough or best.holds) and latest is not None and arrival > latest:
            return
        done = search.log.iterations
        most = done + max(REFINEMENT.work * done, REFINEMENT.least_work)
        guide = _Kind("guide along the path", REFINEMENT.worth_a_guide, self._may_gain_by_a_guide, self._along_the_path)
        yield from self._while_worth(over, guide, REFINEMENT.guides, most)
        # Paths with ever more spans would swerve for what a drive with too few of them loses: first as many as it takes
        worth = REFINEMENT.worth_finer_paths
        path = _Kind("path with shorter spans", worth, self._may_gain_by_a_finer_path, self._over_finer_path)
        worth = REFINEMENT.worth_more_spans
        drive = _Kind("drive with shorter spans", worth, self._may_gain_by_a_finer_drive, self._over_finer_drive)
        search.gained = 0.0
        yield from self._while_worth(over, path, 1, most)
        pays = search.gained >= path.worth
        yield from self._while_worth(over, drive, REFINEMENT.finer, most)
        if pays:
            yield from self._while_worth(over, path, REFINEMENT.finer_paths - 1, most)

    def _while_worth(self, over: OverGuide, kind: _Kind, times: int, most: float) -> Iterator[tuple[float, Start]]:
        search = self.search
        for _ in range(times):
            best = search.best
            if best is None or search.log.iterations > most or not kind.promising(best):
                return
            yield 0.0, Start(kind.what, over, partial(kind.further, best))
            assert search.best is not None
            logger.info("%s: %.4f units of time after %.4f", kind.what, search.best.travel_time, best.travel_time)
            if search.gained < kind.worth:
                return

    def _may_gain_by_a_guide(self, best: ScpRun) -> bool:
        curved = not best.holds and not best.runs.problem.space.guide.straight
        return curved or may_want_another_guide(best.runs.problem, best.trajectory.path)

    def _along_the_path(self, best: ScpRun) -> ScpRun:
        runs = CheckedRuns.along(self.search.task, best.trajectory)
        return runs.along_the_guide(best.trajectory.beta, best.travel_time, self.search.cutoff)

    def _may_gain_by_a_finer_path(self, best: ScpRun) -> bool:
        most = REFINEMENT.most_path_spans if best.runs.task.least_time == 0.0 else REFINEMENT.most_along_routes
        return 2 * len(best.trajectory.space.path.widths) <= most and may_gain_by_spans(best)

    def _over_finer_path(self, best: ScpRun) -> ScpRun:
        """Go on from a trip with path spans of half the length."""
        task, space = best.runs.task, best.trajectory.space
        spans = 2 * len(space.path.widths)
        path_span = min(max(space.length / spans, REFINEMENT.shortest), LONGEST_SPAN)
        settings = replace(for_scene(task.settings), path_span=path_span)
        runs = CheckedRuns.over(replace(task, settings=settings), space, spans=spans)
        start, cutoff = over_finer_path(runs.problem, best.trajectory), self.search.cutoff * (1.0 - REFINEMENT.notable)
        return runs.attempt(start, cutoff, mended=REFINEMENT.mended if task.least_time > 0.0 else 0.0)

    def _may_gain_by_a_finer_drive(self, best: ScpRun) -> bool:
        """True where limits of places or of the jerk ask for many switches of the acceleration."""
        if best.runs.problem.profile is None and best.runs.task.scenario.vehicle.max_jerk is None:
            return False
        few = 3 * best.runs.task.settings.acceleration_spans <= REFINEMENT.most_spans
        # Where arrivals count in steps, a gain within one is none
        return few and best.travel_time - self._hoped <= self.search.cutoff

    def _over_finer_drive(self, best: ScpRun) -> ScpRun:
        """Go on from a trip with three times as many spans of the acceleration."""
        task, trip = best.runs.task, best.trajectory
        finer = replace(task, settings=replace(task.settings, acceleration_spans=3 * task.settings.acceleration_spans))
        runs = CheckedRuns(finer, trip.space.guide, spans=len(trip.space.path.widths))
        found = runs.attempt(over_other_breakpoints(runs.problem, trip), self.search.cutoff)
        gained = trip.travel_time - found.travel_time
        self._hoped = REFINEMENT.hoped * gained if gained > 0.0 else inf
        return found


def may_gain_by_spans(best: ScpRun) -> bool:
    """True if shorter spans of the path may make a trip faster, or a certified one."""
    if not best.holds:
        return best.run.evaluation.worst_violation < QUALITY.hardly
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


class StepsOfTime(Source[Start, ScpRun]):
    """The fastest trip, slowed down to the next step of time, or to a later one where that fails."""

    name = "steps of time"

    def __init__(self, search: TripSearch, scenario: Scenario, fastest: Trajectory, most: int) -> None:
        self.search, self.scenario, self.fastest, self.most = search, scenario, fastest, most

    def children(self, skeleton: Start, found: ScpRun | None) -> Iterator[tuple[float, Start]]:  # noqa: ARG002
        """Yield the trip on one step after the other."""
        step = self.scenario.goal.arrival_step
        if skeleton.what != SCENE or step is None:
            return
        goal, begun = self.scenario.goal, self.scenario.start.time
        first = ceil((self.fastest.travel_time - off_a_step(step)) / step)
        for steps in range(first, first + self.most):
            arrival, allowed = begun + steps * step, ARRIVAL_TOLERANCE * steps * step
            if self.search.certified or (goal.latest_arrival is not None and arrival > goal.latest_arrival + allowed):
                return
            yield steps * step, Start("arrival on a step", skeleton.over, partial(self._on, arrival, steps))

    def _on(self, arrival: float, steps: int) -> ScpRun:
        # Planned for without a margin: the step may be missed to both sides
        timed = changed(self.scenario.goal, earliest_arrival=arrival, latest_arrival=arrival)
        task = replace(self.search.task, scenario=changed(self.scenario, goal=timed), arrival_step=None)
        runs = CheckedRuns.over(task, self.fastest.space, _in_step(self.fastest, steps, task.settings))
        return runs.attempt(over_other_breakpoints(runs.problem, self.fastest), loop=runs.patient_loop)


def on_a_step(task: Task, scenario: Scenario, fastest: ScpRun) -> ScpRun:
    """Go on from the fastest trip to one that arrives on the next step of time, or a later one if that fails."""
    step = scenario.goal.arrival_step
    if step is None or not fastest.holds:
        return fastest
    best = fastest.runs.judged(fastest.run, scenario)  # As it is it is certified for another scenario.
    if best.holds and commanded_in_steps(fastest.trajectory, step, scenario.vehicle.radius):
        return best
    search = TripSearch(fastest.runs)
    search.task, search.arrival_step = task, None
    search.enough = search.lower_bound = 0.0
    search.best = None if best.holds else best
    search.sources = [StepsOfTime(search, scenario, fastest.trajectory, 1 if best.holds else REFINEMENT.later_steps)]
    found = search.explore(Start(SCENE, OverGuide(fastest.runs)))
    return best if best.holds and not search.certified else found or best


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
