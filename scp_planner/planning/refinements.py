"""From a good trip to a better one: over another guide, with finer spans, or to a step of time.

How fine the splines have to be is told by the trip that was found: they become finer where it says so, and only as long
as that gains something.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.certificate.verdict import ARRIVAL_TOLERANCE, off_a_step
from scp_planner.mathematics.splines import greville_sites
from scp_planner.planning.attempts import HARDLY
from scp_planner.planning.runs import CheckedRuns, ScpAttempt
from scp_planner.problem.guides import may_want_another_guide
from scp_planner.problem.problem import Problem
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import changed
from scp_planner.scp.goal import to_beat
from scp_planner.settings.planning import SceneSettings, Settings, for_scene
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory, arriving

logger = logging.getLogger(__name__)

WORK, LEAST_WORK = 3, 250  # times the iterations until a trip was found, and iterations: what a better one may cost
GUIDES = 6  # how often the best path becomes the guide
WORTH_A_GUIDE = 1e-3  # relative gain below which it does not again
SMALL = 0.1  # of a span of the path: zones of a smaller radius are passed by turns that it cannot make
ZONES_TO_A_SPAN = 3  # of those, at most
FINER_PATHS, MOST_PATH_SPANS = 3, 200  # how often there are twice as many spans of the path, and the most of them
WORTH_FINER_PATHS = 2e-3  # relative gain below which there are no more of them
NOTABLE = 5e-4  # relative gain that is expected of them at least: a run that promises less ends early
SLOWED = 1.25e-2  # relative to the kinematic bound: what less is lost to is hardly the path's splines
UNSEEN, TIGHT = 1.0, 1.5  # slope of a path that its spans can hardly follow; spans to the radius of the tightest bend
FINER, MOST_SPANS = 2, 200  # how often there are three times as many spans of the acceleration, and the most of them
WORTH_MORE_SPANS = 2e-3  # relative gain below which there are no more of them
HOPED = 0.5  # of the last gain by more spans: the next is a third of it, as what they lose goes with their length
FEWEST_STEPS, MOST_STEPS = 8, 2  # to a trip whose accelerations change on them; times the wanted number of spans
STRAYING = 0.03  # radii of the vehicle, by which it may be elsewhere after a step of one acceleration
LATER_STEPS = 3  # at which a trip that is to arrive on a step of time is asked to arrive


@dataclass(frozen=True)
class Found:
    """The best trip so far.

    Attributes
    ----------
    runs : CheckedRuns
        With whose splines and settings it was found.
    best : ScpAttempt
    most : int
        Iterations of the whole task, after which nothing further is tried.
    """

    runs: CheckedRuns
    best: ScpAttempt
    most: int

    @property
    def exhausted(self) -> bool:
        """Whether there is no time for anything further, it would be too much work, or no trip can be fast enough."""
        task = self.runs.task
        return task.out_of_time or task.tally.iterations > self.most or self.to_beat < self.runs.lower_bound

    @property
    def to_beat(self) -> float:
        """The travel time that counts as faster, s; inf if it is not certified."""
        return to_beat(self.best.travel_time, self.runs.task.arrival_step) if self.best.holds else np.inf

    @property
    def hopeless(self) -> bool:
        """Whether it is proved that no trip is faster."""
        return self.to_beat < self.runs.lower_bound

    def may_count(self, gain: float) -> bool:
        """Whether a trip that is sooner by so many s counts as faster: always, but where arrivals count in steps."""
        return self.best.travel_time - gain <= self.to_beat

    def after(self, runs: CheckedRuns, attempt: ScpAttempt, least: float) -> tuple[Found, bool]:
        """The best after an attempt, and whether it gains at least so much, relative to its travel time."""
        if not attempt.better_than(self.best):
            return self, False
        gained = self.best.travel_time - attempt.travel_time
        much = attempt.holds and (not self.best.holds or gained >= least * attempt.travel_time)
        return Found(runs, attempt, self.most), much


def among_small_zones(runs: CheckedRuns) -> CheckedRuns:
    """Return runs with shorter spans of the path, where many zones to a span are far smaller than it; else the same.

    Which of them are passed on which side could not be told by one span, and runs from hardly any way would end well.
    Spans of a length that the user gave stay as they are, and those over a curved guide, which has as many as it needs.
    """
    problem, task = runs.problem, runs.task
    space, spans, radius = problem.space, len(problem.space.path.widths), problem.zones.typical_radius
    usual = task.settings.path_span == SceneSettings.path_span and space.guide.straight
    if not usual or radius is None or radius > SMALL * space.length / spans:
        return runs
    wanted = min(ceil(problem.zones.size / ZONES_TO_A_SPAN), task.settings.max_path_spans)
    return runs if wanted <= spans else CheckedRuns(task, space.guide, _breakpoints_of(space), wanted)


def refined(runs: CheckedRuns, best: ScpAttempt) -> ScpAttempt:
    """Go on from the best trip with better guides and finer splines, while that makes it much faster or certified."""
    done = runs.task.tally.iterations
    found = Found(runs, best, done + max(WORK * done, LEAST_WORK))
    found, much = with_finer_paths(over_better_guides(found), 1)
    # Paths with ever more spans would swerve for what a drive with too few of them loses: first as many as it takes.
    found = with_finer_spans(found)
    if much:
        found, _ = with_finer_paths(found, FINER_PATHS - 1)
    return found.best


def over_better_guides(found: Found) -> Found:
    """Where the guide limits the best path, take the path as the guide and go on from there, while that gains much."""
    task = found.runs.task
    for _ in range(GUIDES):
        problem, trajectory = found.runs.problem, found.best.trajectory
        hopeful = not found.best.holds and not problem.space.guide.straight
        if not (hopeful or may_want_another_guide(problem, trajectory.path)) or found.exhausted or found.hopeless:
            break
        again = CheckedRuns.along(task, trajectory.path)
        attempt = again.along_the_guide(trajectory.beta, trajectory.travel_time, found.to_beat)
        logger.info("a new guide: %.4f units of time after %.4f", attempt.travel_time, found.best.travel_time)
        found, much = found.after(again, attempt, WORTH_A_GUIDE)
        if not much:
            break
    return found


def with_finer_paths(found: Found, most: int = FINER_PATHS) -> tuple[Found, bool]:
    """Where the path bends within its spans, or fails by little, take shorter ones while that gains much.

    At most so many times; tells as well whether it gained much to the last.
    """
    much = False
    for _ in range(most):
        much = False
        task, space = found.runs.task, found.best.trajectory.space
        spans = 2 * len(space.path.widths)
        if spans > MOST_PATH_SPANS or found.exhausted or found.hopeless or not _may_gain_by_spans(found):
            break
        settings = replace(for_scene(task.settings), path_span=space.length / spans)
        breakpoints = _breakpoints_of(space)
        again = CheckedRuns(replace(task, settings=settings), space.guide, breakpoints, spans)
        start = _refined(again.problem, found.best.trajectory)
        cutoff = found.to_beat * (1.0 - NOTABLE)
        attempt = again.attempt(start, cutoff)
        logger.info(
            "%d spans of the path: %.4f units of time after %.4f", spans, attempt.travel_time, found.best.travel_time
        )
        found, much = found.after(again, attempt, WORTH_FINER_PATHS)
        if not much:
            break
    return found, much


def _may_gain_by_spans(found: Found) -> bool:
    """Whether shorter spans of the path may make a trip faster, or a certified one.

    A path cannot follow within a span what its third derivative jumps by from span to span: times the span squared
    this is a slope, and in control points their fourth difference over the span.
    """
    best = found.best
    if not best.holds:
        return best.run.evaluation.worst_violation < HARDLY
    theta, space = best.trajectory.theta, best.trajectory.space
    span = space.length / len(space.path.widths)
    unseen = float(np.abs(np.diff(theta, 4)).max(initial=0.0)) / span
    tight = span * float(np.abs(best.trajectory.path.station_bend.curvature).max())
    slowed = best.travel_time > (1.0 + SLOWED) * kinematic_bound(found.runs.task.scenario)
    return slowed and (unseen > UNSEEN or tight > TIGHT)


def _refined(problem: Problem, trip: Trajectory) -> Trajectory:
    """A trip over a space whose spans of the path are parts of its own: the very same trip."""
    basis, ends = problem.space.path, problem.ends
    sites = greville_sites(tuple(basis.breakpoints.tolist()), basis.coefficients.shape[1] - 1)
    theta: Array = np.linalg.solve(basis.rows(sites), trip.space.path.rows(sites) @ trip.theta).astype(float)
    theta[: ends.free.start], theta[ends.free.stop :] = ends.theta[: ends.free.start], ends.theta[ends.free.stop :]
    return Trajectory.of(problem.space, theta, trip.beta, trip.travel_time)


def with_finer_spans(found: Found) -> Found:
    """Where speed limits of places or of the jerk ask for many switches, take more spans while that gains much."""
    if found.runs.problem.profile is None and found.runs.task.scenario.vehicle.max_jerk is None:
        return found
    hoped = np.inf
    for _ in range(FINER):
        task, trip = found.runs.task, found.best.trajectory
        spans = 3 * task.settings.acceleration_spans
        if spans > MOST_SPANS or found.exhausted or found.hopeless or not found.may_count(hoped):
            break
        finer = replace(task, settings=replace(task.settings, acceleration_spans=spans))
        again = CheckedRuns(finer, trip.space.guide, spans=len(trip.space.path.widths))
        problem = again.problem
        beta = _driven_over(problem.space, trip)
        start = arriving(problem.space, trip.theta, beta, problem.limits.acceleration, trip.travel_time)
        attempt = again.attempt(start, found.to_beat)
        logger.info(
            "%d spans of the drive: %.4f units of time after %.4f", spans, attempt.travel_time, trip.travel_time
        )
        found, much = found.after(again, attempt, WORTH_MORE_SPANS)
        if not much:
            break
        gained = trip.travel_time - attempt.travel_time
        hoped = HOPED * gained if gained > 0.0 else np.inf
    return found


def _breakpoints_of(space: TripSpace) -> tuple[float, ...]:
    """Of the acceleration, in normalised time."""
    return tuple(space.acceleration.breakpoints.tolist())


def at_any_time(scenario: Scenario) -> Scenario:
    """Return the scenario without the step of its arrival."""
    if scenario.goal.arrival_step is None:
        return scenario
    return changed(scenario, goal=changed(scenario.goal, arrival_step=None))


def on_a_step(runs: CheckedRuns, scenario: Scenario, fastest: ScpAttempt) -> ScpAttempt:
    """Go on from the fastest trip to one that arrives on the next step of time, or a later one if that fails."""
    task, goal, trajectory = runs.task, scenario.goal, fastest.trajectory
    step = goal.arrival_step
    if step is None or not fastest.holds:
        return fastest
    best = runs.judged(fastest.run, scenario)  # As it is it is certified for another scenario.
    smooth = commanded_in_steps(trajectory, step, scenario.vehicle.radius)
    first = ceil((trajectory.travel_time - off_a_step(step)) / step)
    for steps in range(first, first + LATER_STEPS):
        arrival = scenario.start.time + steps * step
        too_late = goal.latest_arrival is not None and arrival > goal.latest_arrival + ARRIVAL_TOLERANCE * steps * step
        if (best.holds and smooth) or too_late or task.out_of_time:
            break
        # Planned for without a margin: the step may be missed to both sides.
        timed = changed(scenario, goal=changed(goal, earliest_arrival=arrival, latest_arrival=arrival))
        breakpoints = _in_step(trajectory, steps, task.settings)
        spans = len(trajectory.space.path.widths)
        again = CheckedRuns(
            replace(task, scenario=timed, arrival_step=None), trajectory.space.guide, breakpoints, spans
        )
        space = again.problem.space
        # Over other breakpoints the same mean accelerations may end before the trip does.
        beta, limit = _driven_over(space, trajectory), again.problem.limits.acceleration
        start = arriving(space, trajectory.theta, beta, limit, trajectory.travel_time)
        attempt = again.attempt(start, loop=again.patient_loop)
        if best.holds:
            return attempt if attempt.holds else best
        best = attempt if attempt.better_than(best) else best
        smooth = True
    return best


def commanded_in_steps(trip: Trajectory, step: float, radius: float) -> bool:
    """Return whether one acceleration a step drives about as far in each step as a trip, whose own may change within.

    Parameters
    ----------
    trip : Trajectory
    step : float
        s.
    radius : float
        Of the vehicle, m.

    Returns
    -------
    bool
    """
    times = np.arange(0.0, trip.travel_time, step)
    drive = trip.drive_at(times / trip.travel_time)
    joined = 0.5 * step * (drive.speed[1:] + drive.speed[:-1])
    return bool(np.abs(np.diff(drive.distance) - joined).max(initial=0.0) <= STRAYING * radius)


def _in_step(trajectory: Trajectory, steps: int, settings: Settings) -> tuple[float, ...]:
    """Breakpoints of the acceleration on steps of time, if these are not too many; else those of a trip."""
    basis = trajectory.space.acceleration
    constant = basis.coefficients.shape[1] == 1
    if constant and FEWEST_STEPS <= steps <= MOST_STEPS * settings.acceleration_spans:
        return tuple(np.linspace(0.0, 1.0, steps + 1).tolist())
    return _breakpoints_of(trajectory.space)


def _driven_over(space: TripSpace, trip: Trajectory) -> Array:
    """Accelerations of a trip over a space whose breakpoints of them may be others.

    Where they are constant between those, they lead to the same speeds there.
    """
    basis = space.acceleration
    if np.array_equal(basis.breakpoints, trip.space.acceleration.breakpoints):
        return trip.beta
    degree = basis.coefficients.shape[1] - 1
    if degree > 0:
        return trip.drive_at(greville_sites(_breakpoints_of(space), degree)).acceleration
    beta: Array = np.diff(trip.speed_at(basis.breakpoints)) / (np.diff(basis.breakpoints) * trip.travel_time)
    return beta
