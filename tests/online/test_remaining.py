"""What is left of a trip, against the trip itself at dense times, where it is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import scene

from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.remaining import State, _guide_from, remaining_trip
from scp_planner.problem.build import build_problem
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


def old_trip(bow: float) -> Trip:
    """From (0, 0) to (20, 0) at time 3; beside the straight line by as much as ``bow``, in the middle."""
    breaks = tuple(np.linspace(0.0, 1.0, SPANS + 1).tolist())
    space = TripSpace(StraightGuide(LENGTH), START, 5, 8, 0, breaks)
    theta = bow * np.sin(np.pi * np.linspace(0.0, 1.0, space.path_size)) ** 3
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


def test_what_is_left_of_a_guide_begins_where_the_vehicle_is() -> None:
    guide = ((0.0, 0.0), (8.0, 0.0), (8.0, 6.0))
    assert _guide_from(guide, (3.0, 0.0)) == ((3.0, 0.0), (8.0, 0.0), (8.0, 6.0))
    assert _guide_from(guide, (7.8, 0.3)) == ((7.8, 0.3), (8.0, 6.0))  # the vertex is about to be passed
    assert _guide_from(guide, (8.1, 5.0)) == ((8.1, 5.0), (8.0, 6.0))
