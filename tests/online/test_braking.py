"""Stops of a vehicle whose jerk is limited, and all else that it drives: the acceleration never jumps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.plan import Outcome
from scp_planner.online.planner import Planner
from scp_planner.online.remaining import State
from scp_planner.online.stops import EvenBraking, RampedBraking, braking_of, fits, standing_from, straight_stop
from scp_planner.scenario.models import Vehicle
from scp_planner.settings.online import OnlineSettings
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.guide import StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory

JERK, FALL = 4.0, 2.0
BRAKING = RampedBraking(FALL, JERK)
BREAKS = tuple(np.linspace(0.0, 1.0, 21).tolist())
FRAME = PlanningFrame.between((0.0, 0.0), (20.0, 0.0), 0.0)


def cruise(length: float, travel_time: float, *beta: float) -> Trajectory:
    """A trip from 2 m/s with accelerations at breakpoints, straight in between; nothing more after those."""
    space = TripSpace(StraightGuide(length), 2.0, 3, 4, 1, BREAKS)
    values = np.zeros(space.acceleration_size)
    values[: len(beta)] = beta
    return Trajectory(Path(space, np.zeros(space.path_size)), values, travel_time)


def slopes(trajectory: Trajectory) -> np.ndarray:
    """The jerk on each piece, m/s3."""
    return np.diff(trajectory.beta) / (np.diff(trajectory.space.acceleration.breakpoints) * trajectory.travel_time)


def test_a_vehicle_brakes_evenly_unless_its_jerk_is_limited() -> None:
    vehicle = scene().vehicle
    assert braking_of(vehicle, 0.1) == EvenBraking(0.9 * vehicle.max_deceleration)
    limited = braking_of(Vehicle(**{**vehicle.model_dump(), "max_jerk": JERK}))
    assert isinstance(limited, RampedBraking)
    assert 0.999 * JERK < limited.jerk < JERK
    # v / d, and the time in which the brake is put on and let go of
    assert limited.time(3.0) == pytest.approx(3.0 / 2.0 + 2.0 / JERK, rel=1e-3)
    assert limited.time(0.5) == pytest.approx(2.0 * math.sqrt(0.5 / JERK), rel=1e-3)


@pytest.mark.parametrize("spans", [0, 2, 3, 12])
def test_a_stop_leaves_a_trip_without_a_jump(spans: int) -> None:
    """The trip speeds up first, and the stop may have to take that away."""
    trip = cruise(60.0, 20.0, 0.0, 0.5, 0.5, 0.2)
    stop = BRAKING.stop_after(trip, spans)
    branch = float(spans)
    times = np.linspace(0.0, branch, 7)
    kept, mine = trip.drive_at(times / 20.0), stop.drive_at(times / stop.travel_time)
    assert mine.distance == pytest.approx(kept.distance, abs=1e-9)
    assert mine.acceleration == pytest.approx(kept.acceleration, abs=1e-9)
    assert np.abs(slopes(stop)).max() <= JERK * (1.0 + 1e-9)
    assert stop.beta.min() >= -FALL - 1e-9
    end = stop.drive_at(np.ones(1))
    assert end.speed[0] == pytest.approx(0.0, abs=1e-9) and stop.beta[-1] == 0.0
    assert stop.speed_at(np.linspace(0.0, 1.0, 500)).min() >= -1e-9
    assert standing_from(stop) == pytest.approx(stop.travel_time) and fits(stop)


def test_room_to_stop_is_the_gap_that_is_left() -> None:
    """At 2 m/s towards a post, against the way of a stop by hand: 1 m and 0.5 s of ramps at 2 m/s in all."""
    zones = ZoneBatch.of(sp.zones(scene(disc("post", (9.0, 0.0), radius=0.5))), FRAME, 0.3)
    trip = cruise(12.0, 6.0)
    leads = np.array([1.8, 2.1, 3.0, 5.7])
    room = BRAKING.room(trip, leads, zones, 0.0, 0.0)
    way = 2.0**2 / (2.0 * FALL) + 2.0 * 0.5 * FALL / JERK
    assert room[:3] == pytest.approx(9.0 - 0.8 - 2.0 * leads[:3] - way, abs=1e-6)
    assert room[3] == -np.inf


@pytest.mark.parametrize(("speed", "acceleration"), [(2.4, 0.0), (1.0, 1.2), (0.7, -1.1), (0.0, 0.0)])
def test_a_straight_stop_goes_on_with_the_acceleration(speed: float, acceleration: float) -> None:
    state = State(7.0, (2.0, -1.0), 0.6, speed, acceleration)
    stop = straight_stop(state, BRAKING, Settings(), BREAKS)
    assert stop.trajectory.beta[0] == acceleration and stop.trajectory.beta[-1] == 0.0
    assert fits(stop.trajectory)
    times = np.linspace(7.0, 7.0 + stop.trajectory.travel_time, 4001)
    points, _ = stop.at(times)
    way = float(np.sum(0.5 * (points.speed[1:] + points.speed[:-1]) * np.diff(times)))
    end = stop.frame.to_world(points.path.position[-1:])[0]
    assert end == pytest.approx([2.0 + way * math.cos(0.6), -1.0 + way * math.sin(0.6)], abs=1e-6)
    assert points.speed[-1] == pytest.approx(0.0, abs=1e-9)


# closed loops

PERIOD = 0.2
BAR = {
    "id": "bar",
    "shape": {"rectangle": [0.4, 4.0], "heading": 0.0},
    "motion": {"position": (4.0, -0.5), "velocity": (0.0, 0.4)},
}
"""Across all of the way until it has moved aside."""
BLOCKED = scene(
    BAR, goal={"position": (8.0, 0.0)}, bounds={"min": (-2.0, -1.0), "max": (10.0, 1.0)}, vehicle={"max_jerk": JERK}
)


def driven(scenario: sp.Scenario, online: OnlineSettings, most: int) -> list[sp.OnlinePlan]:
    """Plans one period apart, each from where the last one has the vehicle; what seams are is up to the planner."""
    planner = Planner(scenario, online=online)
    start, plans = (
        scenario.start,
        [planner.replan(0.0, scenario.start.position, scenario.start.heading, scenario.start.speed)],
    )
    while len(plans) < most and not plans[-1].arrived:
        time, last = start.time + len(plans) * PERIOD, plans[-1]
        if last.outcome is not Outcome.BRAKING and last.arrival_time <= time:
            break
        plans.append(
            planner.replan(time, last.position(time), float(last.heading(time)), max(float(last.speed(time)), 0.0))
        )
    assert not planner.doubts
    return plans


def jerk_of(plan: sp.OnlinePlan, begin: float, end: float) -> float:
    """The largest slope of the acceleration that is driven between two times, by differences, m/s3."""
    times = np.linspace(begin, min(end, plan.arrival_time - 1e-9), 101)
    return float(np.abs(np.diff(plan.acceleration(times)) / np.diff(times)).max()) if times[-1] > begin else 0.0


def at_end(plan: sp.OnlinePlan, time: float) -> float:
    """The acceleration at a time, m/s2; who has come to the end of a stop stands."""
    return float(plan.acceleration(time)) if time < plan.arrival_time else 0.0


@pytest.fixture(scope="module")
def loop() -> list[sp.OnlinePlan]:
    return driven(BLOCKED, OnlineSettings(period=PERIOD), 60)


def test_a_vehicle_stops_for_what_is_in_the_way_and_goes_on(loop: list[sp.OnlinePlan]) -> None:
    assert all(plan.safe for plan in loop)
    outcomes = {plan.outcome for plan in loop}
    assert outcomes & {Outcome.BRAKING, Outcome.EVADING} and outcomes >= {Outcome.IMPROVED, Outcome.KEPT}
    slowest = min(float(plan.speed(k * PERIOD)) for k, plan in enumerate(loop))
    assert slowest < 0.2 and loop[-1].certified and loop[-1].arrival_time < 12.0


def test_the_acceleration_never_jumps_and_changes_no_faster_than_it_may(loop: list[sp.OnlinePlan]) -> None:
    for k, (plan, following) in enumerate(zip(loop, [*loop[1:], None], strict=True)):
        begin, end = k * PERIOD, (k + 1) * PERIOD
        assert jerk_of(plan, begin, end) <= JERK * (1.0 + 1e-6)
        assert plan.limits["jerk"].worst <= JERK * (1.0 + 1e-9)
        if following is not None:
            assert at_end(following, end) == pytest.approx(at_end(plan, end), abs=1e-6)
            assert following.speed(end) == pytest.approx(plan.speed(end), abs=1e-9)


def test_stops_are_left_for_without_a_jump_and_end_without_one(loop: list[sp.OnlinePlan]) -> None:
    for k, plan in enumerate(loop):
        if plan.stop is None:
            continue
        begin = k * PERIOD
        assert jerk_of(sp.OnlinePlan(**{**vars(plan), "trip": plan.stop}), begin, math.inf) <= JERK * (1.0 + 1e-6)
        branch = min(plan.branch_time, plan.arrival_time)
        assert plan.stop.at(branch)[0].acceleration[0] == pytest.approx(at_end(plan, branch), abs=1e-6)
        last, _ = plan.stop.at(plan.stop.frame.time + plan.stop.trajectory.travel_time)
        assert last.speed[0] == pytest.approx(0.0, abs=1e-6) and last.acceleration[0] == pytest.approx(0.0, abs=1e-6)


def test_a_plan_begins_with_the_acceleration_that_it_is_told() -> None:
    scenario = scene(vehicle={"max_jerk": JERK}, goal={"position": (6.0, 0.0)})
    planner = Planner(scenario)
    assert planner.replan(0.0, (0.0, 0.0), 0.0, 1.0).acceleration(0.0) == 0.0
    assert Planner(scenario).replan(0.0, (0.0, 0.0), 0.0, 1.0, -0.7).acceleration(0.0) == pytest.approx(-0.7)
    given = scene(vehicle={"max_jerk": JERK}, start={"acceleration": 0.4}, goal={"position": (6.0, 0.0)})
    assert Planner(given).replan(0.0, (0.0, 0.0), 0.0, 1.0).acceleration(0.0) == pytest.approx(0.4)
    beyond = Planner(scenario).replan(0.0, (0.0, 0.0), 0.0, 1.0, 9.0)
    assert beyond.acceleration(0.0) == pytest.approx(scenario.vehicle.max_acceleration)


def test_with_a_reaction_time_a_plan_begins_where_the_last_one_leads() -> None:
    """The vehicle is a little aside, and follows the last plan for 0.1 s more."""
    scenario = scene(vehicle={"max_jerk": JERK}, goal={"position": (8.0, 0.0)})
    planner = Planner(scenario, online=OnlineSettings(period=PERIOD, reaction_time=0.1, improve_every=1))
    first = planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    aside = np.array([0.0, 1e-3])
    plan = planner.replan(
        PERIOD, first.position(PERIOD) + aside, float(first.heading(PERIOD)), float(first.speed(PERIOD))
    )
    assert plan.outcome is Outcome.IMPROVED and plan.start_time == pytest.approx(PERIOD + 0.1)
    assert plan.position(plan.start_time) == pytest.approx(first.position(plan.start_time) + aside, abs=1e-6)
    assert plan.speed(plan.start_time) == pytest.approx(float(first.speed(plan.start_time)))
    assert plan.acceleration(plan.start_time) == pytest.approx(float(first.acceleration(plan.start_time)))
