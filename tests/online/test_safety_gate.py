"""Trips that may be driven: a straight drive at 2 m/s, with answers known beforehand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.online.following import Following
from scp_planner.online.reasons import worded
from scp_planner.online.remaining import State
from scp_planner.online.safety_gate import Moment, Refusal, SafetyGate, Vetted
from scp_planner.problem.build import build_problem
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics

SPEED = 2.0
PERIOD = 0.5
BREAKS = tuple(np.linspace(0.0, 1.0, 21).tolist())  # spans of half a second


def vetted(*obstacles: dict[str, Any], stops_will_do: bool, acceleration: float = 0.0) -> Vetted | Refusal:
    """Verdict on driving 20 m straight on."""
    scenario = scene(*obstacles, start={"speed": SPEED})
    zones = sp.zones(scenario)
    problem = build_problem(scenario, zones, Settings(acceleration_degree=0), BREAKS)
    space = problem.space
    trajectory = Trajectory.of(space, np.zeros(space.path_size), np.full(space.acceleration_size, acceleration))
    state = State(0.0, (0.0, 0.0), 0.0, SPEED)
    return SafetyGate(PERIOD, stops_will_do, Following(scenario.vehicle, 0.0)).vet(
        Moment(state, scenario, zones), problem.frame, trajectory
    )


@pytest.mark.parametrize("stops_will_do", [False, True])
@pytest.mark.parametrize("side", [0.81, 5.0])
def test_a_trip_that_passes_clear_may_be_driven_to_the_goal(stops_will_do: bool, side: float) -> None:
    """The bodies' radii add up to 0.8 m."""
    answer = vetted(disc("post", (10.0, side)), stops_will_do=stops_will_do)
    assert isinstance(answer, Vetted) and answer.certified and answer.stop is None
    assert answer.arrival == pytest.approx(20.0 / SPEED)


def test_a_trip_into_an_obstacle_may_be_driven_only_as_far_as_a_stop() -> None:
    post = disc("post", (10.0, 0.79))
    refused = vetted(post, stops_will_do=False)
    assert isinstance(refused, Refusal) and "post" in worded(refused.why, NaturalUnits())
    answer = vetted(post, stops_will_do=True)
    assert isinstance(answer, Vetted) and answer.stop is not None and not answer.certified
    assert PERIOD <= answer.stop.branch < answer.stop.stands
    stands = answer.stop.trip.frame.to_world(answer.stop.trip.at(np.array([answer.stop.stands]))[0].path.position)[0]
    assert np.hypot(*(stands - [10.0, 0.79])) > 0.8
    assert answer.stop.stands - answer.stop.branch == pytest.approx(1.0, abs=1e-6)  # from 2 m/s at 2 m/s2


@pytest.mark.parametrize(("gap", "stops"), [(1.95, False), (2.05, True)])
def test_a_stop_needs_the_next_period_and_the_braking_distance(gap: float, stops: bool) -> None:
    """2 m/s for half a second and v^2 / 2 d = 1 m: 2 m, and not less, are needed in front of the vehicle."""
    answer = vetted(disc("wall", (gap + 0.8, 0.0)), stops_will_do=True)
    assert isinstance(answer, Vetted) is stops
    if isinstance(answer, Refusal):
        assert any(word in worded(answer.why, NaturalUnits()) for word in ("wall", "stop"))


@pytest.mark.parametrize(("acceleration", "kept"), [(0.12, True), (0.13, False)])
def test_a_trip_above_the_top_speed_is_refused_whole(acceleration: float, kept: bool) -> None:
    """The top speed is 3 m/s; after 20 m the speed is sqrt(4 + 40 a), so a = 0.125 m/s2 reaches it."""
    answer = vetted(stops_will_do=False, acceleration=acceleration)
    assert isinstance(answer, Vetted) is kept
    if isinstance(answer, Refusal):
        assert "speed" in worded(answer.why, NaturalUnits())


@pytest.mark.parametrize("gap", [0.0, 1.0, 1.9])
def test_a_refusal_tells_how_deep_the_best_stop_is_inside(gap: float) -> None:
    """It stands 2 m farther on, and what is beyond the middle of the obstacle is nearer to its far side."""
    answer = vetted(disc("wall", (gap + 0.8, 0.0)), stops_will_do=True)
    assert isinstance(answer, Refusal)
    assert answer.room == pytest.approx(gap - 2.0 if gap > 1.2 else -0.8, abs=0.08)  # of samples


@pytest.mark.parametrize("side", [0.3, 0.79, 2.0])
def test_the_most_room_of_the_stops_is_that_of_one_that_is_sampled_densely(side: float) -> None:
    """Each keeps to the trip up to the end of a span, and then brakes: all on the line that the trip is."""
    scenario = scene(disc("post", (4.0, side)), start={"speed": SPEED})
    zones = sp.zones(scenario)
    problem = build_problem(scenario, zones, Settings(acceleration_degree=0), BREAKS)
    space = problem.space
    trip = Trip(problem.frame, Trajectory.of(space, np.zeros(space.path_size), np.zeros(space.acceleration_size)))
    moment = Moment(State(0.0, (0.0, 0.0), 0.0, SPEED), scenario, zones)
    ends = SPEED * np.arange(PERIOD, PERIOD + 3.01, 0.5) + 0.5 * SPEED**2 / scenario.vehicle.max_deceleration
    rooms = [np.hypot(np.linspace(0.0, end, 2001) - 4.0, side).min() - 0.8 for end in ends]
    found = SafetyGate(PERIOD, True, Following(scenario.vehicle, 0.0)).most_room(moment, trip)
    assert max(rooms) - 1e-9 <= found <= max(rooms) + 0.02


def test_there_is_no_room_where_the_trip_ends_before_a_stop() -> None:
    scenario = scene(start={"speed": SPEED})
    zones = sp.zones(scenario)
    problem = build_problem(scenario, zones, Settings(acceleration_degree=0), BREAKS)
    space = problem.space
    trip = Trip(problem.frame, Trajectory.of(space, np.zeros(space.path_size), np.zeros(space.acceleration_size)))
    moment = Moment(State(0.0, (0.0, 0.0), 0.0, SPEED), scenario, zones)
    assert SafetyGate(20.0, True, Following(scenario.vehicle, 0.0)).most_room(moment, trip) == -np.inf
