"""The rest of a trip, against the trip itself at dense times, known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import scene

from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.remaining import State, eased, remaining_trip
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.settings.planning import Settings
from scp_planner.trips.guide import StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics

LENGTH, START = 20.0, 1.0
RATE = 0.15  # the goal is passed at 2.6 m/s, below the top speed
SPANS = 20


def driven(time: np.ndarray | float) -> np.ndarray | float:
    """Way of a drive that speeds up evenly, m."""
    return START * time + 0.5 * RATE * np.square(time)


DURATION = (np.sqrt(START**2 + 2.0 * RATE * LENGTH) - START) / RATE


def old_trip(arc: float) -> Trip:
    """From (0, 0) to (20, 0) at time 3; beside the straight line by as much as ``arc``, in the middle."""
    breaks = tuple(np.linspace(0.0, 1.0, SPANS + 1).tolist())
    space = TripSpace(StraightGuide(LENGTH), START, 5, 8, 0, breaks)
    theta = arc * np.sin(np.pi * np.linspace(0.0, 1.0, space.path_size)) ** 3
    path = Path(space, theta)
    time = (np.sqrt(START**2 + 2.0 * RATE * path.arc_length) - START) / RATE
    frame = PlanningFrame.between((0.0, 0.0), (LENGTH, 0.0), 3.0)
    return Trip(frame, Trajectory(path, np.full(SPANS, RATE), float(time)))


def rest_of(old: Trip, state: State) -> Trip:
    start = {"time": state.time, "position": state.position, "heading": state.heading, "speed": state.speed}
    scenario = scene(start=start)
    breaks = tuple(np.linspace(0.0, 1.0, SPANS + 1).tolist())
    problem = build_problem(scenario, (), Settings(acceleration_degree=0), breaks)
    return Trip(problem.frame, remaining_trip(problem, old, state))


@pytest.mark.parametrize("passed", [0.0, 1.3, 4.0, 6.5])
def test_the_rest_of_a_straight_drive_is_that_drive(passed: float) -> None:
    speed = START + RATE * passed
    rest = rest_of(old_trip(0.0), State(3.0 + passed, (float(driven(passed)), 0.0), 0.0, speed))
    assert rest.trajectory.travel_time == pytest.approx(DURATION - passed, abs=1e-6)
    times = np.linspace(passed, DURATION - 1e-3, 400)
    points = rest.at(3.0 + times)[0]
    world = rest.frame.to_world(points.path.position)
    assert world[:, 0] == pytest.approx(driven(times), abs=1e-5)
    assert np.abs(world[:, 1]).max() < 1e-9
    assert points.speed == pytest.approx(START + RATE * times, abs=1e-5)


@pytest.mark.parametrize("passed", [0.0, 2.0, 5.0])
def test_the_rest_of_a_winding_drive_passes_where_that_did(passed: float) -> None:
    old = old_trip(1.0)
    when = 3.0 + passed
    here = old.at(np.array([when]))[0]
    tangent = np.diff(old.frame.to_world(old.at(when + np.array([0.0, 1e-6]))[0].path.position), axis=0)[0]
    (x, y), heading = old.frame.to_world(here.path.position)[0], float(np.arctan2(tangent[1], tangent[0]))
    rest = rest_of(old, State(when, (float(x), float(y)), heading, float(here.speed[0])))
    times = np.linspace(when, 3.0 + old.trajectory.travel_time - 0.1, 300)
    new, was = rest.at(times)[0], old.at(times)[0]
    away = rest.frame.to_world(new.path.position) - old.frame.to_world(was.path.position)
    assert np.hypot(*away.T).max() < 0.02
    assert new.speed == pytest.approx(was.speed, abs=0.01)


def test_who_is_off_the_path_and_too_fast_is_led_back() -> None:
    passed = 1.0
    rest = rest_of(old_trip(0.0), State(3.0 + passed, (float(driven(passed)), 0.2), 0.0, START + RATE * passed + 0.3))
    points = rest.at(3.0 + np.linspace(passed, 5.0, 200))[0]
    world = rest.frame.to_world(points.path.position)
    assert world[0] == pytest.approx([driven(passed), 0.2], abs=1e-9)
    assert points.speed[0] == pytest.approx(START + RATE * passed + 0.3)
    assert np.abs(world[world[:, 0] > 6.0, 1]).max() < 0.02
    assert points.speed[-1] == pytest.approx(START + RATE * 5.0, abs=0.02)


JERK = 2.0


def ramped_problem(state: State) -> Problem:
    """From a state to the goal, for a vehicle whose jerk is limited."""
    start = {"time": state.time, "position": state.position, "heading": state.heading, "speed": state.speed}
    scenario = scene(start={**start, "acceleration": state.acceleration}, vehicle={"max_jerk": JERK})
    breaks = tuple(np.linspace(0.0, 1.0, SPANS + 1).tolist())
    return build_problem(scenario, (), Settings(), breaks)


def slopes(beta: np.ndarray, duration: float) -> np.ndarray:
    return np.diff(beta) / (duration / SPANS)


@pytest.mark.parametrize("acceleration", [RATE, -1.2, 0.9])
def test_the_rest_of_a_drive_begins_with_the_present_acceleration(acceleration: float) -> None:
    """And is that drive again as soon as the jerk lets it be."""
    passed, speed = 1.0, START + RATE
    problem = ramped_problem(State(4.0, (float(driven(1.0)), 0.0), 0.0, speed, acceleration))
    state = State(4.0, (float(driven(passed)), 0.0), 0.0, speed, acceleration)
    rest = remaining_trip(problem, old_trip(0.0), state)
    assert rest.beta[0] == acceleration
    assert np.abs(slopes(rest.beta, DURATION - passed)).max() <= JERK * (1.0 + 1e-9)
    later = problem.space.acceleration.breakpoints * (DURATION - passed) > abs(acceleration - RATE) / JERK
    assert rest.beta[later] == pytest.approx(RATE)


def test_a_drive_that_would_not_arrive_speeds_up_along_a_ramp() -> None:
    """The old trip stopped on its way; from then on a new one leads to the goal."""
    old = old_trip(0.0)
    stop = Trip(old.frame, Trajectory(old.trajectory.path, np.full(SPANS, -START / 5.0), 5.0))
    state = State(3.0 + 5.0, (2.5, 0.0), 0.0, 0.0, -0.1)
    rest = remaining_trip(ramped_problem(state), stop, state)
    assert np.isfinite(rest.travel_time) and rest.beta[0] == -0.1
    assert rest.beta.max() > 1.0
    time = rest.travel_time
    assert float(rest.at(rest.space.time_table(np.ones(1))).distance[0]) == pytest.approx(rest.path.arc_length)
    assert np.abs(slopes(rest.beta, time)).max() <= JERK * 1.05


@pytest.mark.parametrize("share", [0.6, 0.0])
def test_easing_off_goes_no_faster_than_the_jerk(share: float) -> None:
    state = State(4.0, (float(driven(1.0)), 0.0), 0.0, START + RATE, 0.3)
    problem = ramped_problem(state)
    ahead = remaining_trip(problem, old_trip(0.0), state)
    beta = eased(problem, ahead, share)
    assert beta[0] == 0.3 and beta[1] < ahead.beta[1]
    assert np.abs(slopes(beta, ahead.travel_time)).max() <= JERK * (1.0 + 1e-9)
    assert beta[SPANS // 2 :] == pytest.approx(ahead.beta[SPANS // 2 :])
