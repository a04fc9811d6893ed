"""From a good trip to a better one: over another guide, with finer spans, or to a step of time."""

from __future__ import annotations

import logging
from dataclasses import replace
from math import ceil

import numpy as np

from scp_planner.certificate.verdict import ARRIVAL_TOLERANCE, off_a_step
from scp_planner.mathematics.splines import greville_sites
from scp_planner.planning.attempts import to_beat
from scp_planner.planning.runs import CheckedRuns, ScpAttempt
from scp_planner.problem.guides import may_want_another_guide
from scp_planner.problem.limits.arrival import EARLIEST_MARGIN
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import changed
from scp_planner.settings.planning import Settings
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory

logger = logging.getLogger(__name__)

GUIDES = 6  # how often the best path becomes the guide
WORTH_A_GUIDE = 1e-3  # relative gain below which it does not again
FINER, MOST_SPANS = 2, 200  # how often there are three times as many spans of the acceleration, and the most of them
WORTH_MORE_SPANS = 2e-3  # relative gain below which there are no more of them
FEWEST_STEPS, MOST_STEPS = 8, 2  # to a trip whose accelerations change on them; times the wanted number of spans
STRAYING = 0.03  # radii of the vehicle, by which it may be elsewhere after a step of one acceleration
LATER_STEPS = 3  # at which a trip that is to arrive on a step of time is asked to arrive


def over_better_guides(runs: CheckedRuns, best: ScpAttempt) -> ScpAttempt:
    """Where the guide limits the best path, take the path as the guide and go on from there, while that gains much."""
    task, problem = runs.task, runs.problem
    for _ in range(GUIDES):
        trajectory = best.trajectory
        hopeful = not best.holds and not problem.space.guide.straight
        if not (hopeful or may_want_another_guide(problem, trajectory.path)) or task.out_of_time:
            break
        beat = _to_beat(runs, best)
        if beat < runs.lower_bound:
            break
        again = CheckedRuns.along(task, trajectory.path)
        attempt = again.along_the_guide(trajectory.beta, trajectory.travel_time, beat)
        logger.info("a new guide: %.4f s after %.4f s", attempt.travel_time, best.travel_time)
        if not attempt.better_than(best):
            break
        much = _gains(best, attempt, WORTH_A_GUIDE)
        best, problem = attempt, again.problem
        if not much:
            break
    return best


def with_finer_spans(runs: CheckedRuns, best: ScpAttempt) -> ScpAttempt:
    """Where speed limits of places or of the jerk ask for many switches, take more spans while that gains much."""
    task = runs.task
    if runs.problem.profile is None and task.scenario.vehicle.max_jerk is None:
        return best
    spans = task.settings.acceleration_spans
    for _ in range(FINER):
        spans *= 3
        beat = _to_beat(runs, best)
        if spans > MOST_SPANS or beat < runs.lower_bound or task.out_of_time:
            break
        trip = best.trajectory
        finer = replace(task, settings=replace(task.settings, acceleration_spans=spans))
        again = CheckedRuns(finer, trip.space.guide)
        space = again.problem.space
        degree = space.acceleration.coefficients.shape[1] - 1
        sites = greville_sites(tuple(space.acceleration.breakpoints.tolist()), degree)
        start = Trajectory.of(space, trip.theta, trip.drive_at(sites).acceleration, trip.travel_time)
        attempt = again.attempt(start, beat)
        if not attempt.better_than(best):
            break
        much = _gains(best, attempt, WORTH_MORE_SPANS)
        best = attempt
        if not much:
            break
    return best


def _to_beat(runs: CheckedRuns, best: ScpAttempt) -> float:
    return to_beat(best.travel_time, runs.task.arrival_step) if best.holds else np.inf


def _gains(best: ScpAttempt, attempt: ScpAttempt, least: float) -> bool:
    """Whether a better attempt gains at least so much, relative to its travel time."""
    return not best.holds or best.travel_time - attempt.travel_time >= least * attempt.travel_time


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
        too_late = goal.latest_arrival is not None and arrival > goal.latest_arrival + ARRIVAL_TOLERANCE
        if (best.holds and smooth) or too_late or task.out_of_time:
            break
        # The step itself is planned for, not the margin later: it may be missed to both sides.
        timed = changed(scenario, goal=changed(goal, earliest_arrival=arrival - EARLIEST_MARGIN))
        breakpoints = _in_step(trajectory, steps, task.settings)
        again = CheckedRuns(replace(task, scenario=timed), trajectory.space.guide, breakpoints)
        attempt = again.attempt(_driven_over(again.problem.space, trajectory), loop=again.patient_loop)
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
    return tuple(basis.breakpoints.tolist())


def _driven_over(space: TripSpace, trip: Trajectory) -> Trajectory:
    """A trip over a space whose breakpoints of the acceleration may be others: it has the same speeds at them."""
    basis = space.acceleration
    if np.array_equal(basis.breakpoints, trip.space.acceleration.breakpoints):
        return Trajectory.of(space, trip.theta, trip.beta, trip.travel_time)
    speeds = trip.speed_at(basis.breakpoints)
    beta = np.diff(speeds) / (np.diff(basis.breakpoints) * trip.travel_time)
    return Trajectory.of(space, trip.theta, beta, trip.travel_time)
