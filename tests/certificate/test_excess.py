"""The excess of a start over a limit, against numerical simulations of the hardest braking."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import scp_planner as sp
from scp_planner.arrays import Array
from scp_planner.certificate.excess import HardestStop
from scp_planner.certificate.tolerances import BRAKING_SHARE
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.trips.guide import StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

DECELERATION, JERK, STEP = 2.0, 2.0, 2e-4
LENGTH = 30.0


def simulated(speed: float, acceleration: float, deceleration: float, jerk: float | None) -> tuple[Array, Array]:
    """Brake step by step: as hard as allowed, until the brakes have to be released to stand without a jerk."""
    speeds = [speed]
    while speeds[-1] > 0.0 and len(speeds) < 60_000:
        before = acceleration
        if jerk is None:
            before = acceleration = -deceleration
        elif acceleration < 0.0 and acceleration**2 >= 2.0 * jerk * speeds[-1]:
            acceleration = min(acceleration + jerk * STEP, 0.0)
        else:
            change = np.clip(-deceleration - acceleration, -jerk * STEP, jerk * STEP)
            acceleration += float(change)
        speeds.append(speeds[-1] + 0.5 * (before + acceleration) * STEP)
        if acceleration == 0.0:
            break
    return np.linspace(0.0, STEP * (len(speeds) - 1), len(speeds)), np.array(speeds)


@pytest.mark.parametrize(
    ("speed", "acceleration", "jerk"),
    [(3.0, 0.0, None), (3.0, 1.5, 2.0), (0.4, 0.0, 2.0), (3.0, -1.0, 4.0), (0.5, 1.5, 2.0)],
)
def test_hardest_stop_is_the_simulated_one(speed: float, acceleration: float, jerk: float | None) -> None:
    vehicle: Any = SimpleNamespace(max_deceleration=DECELERATION, max_total_acceleration=None, max_jerk=jerk)
    stop = HardestStop.from_state(speed, acceleration, vehicle)
    times, speeds = simulated(
        speed, acceleration, BRAKING_SHARE * DECELERATION, None if jerk is None else BRAKING_SHARE * jerk
    )
    np.testing.assert_allclose(stop.speed_at(times), np.maximum(speeds, 0.0), atol=2e-3)
    for limit in (0.2 * speed, 0.7 * speed):
        (last,) = np.flatnonzero(speeds > limit)[-1:]
        assert stop.slows_to(limit) == pytest.approx(times[last], abs=2e-3)


def driven(start_speed: float, times: list[float], accelerations: list[float]) -> Trip:
    """A drive straight ahead: of constant accelerations between times, or, if as many, straight in between."""
    degree = int(len(accelerations) == len(times))
    shares = tuple(time / times[-1] for time in times)
    space = TripSpace(StraightGuide(LENGTH), start_speed, 3, 4, degree, shares)
    trajectory = Trajectory(Path(space, np.zeros(space.path_size)), np.array(accelerations), times[-1])
    return Trip(PlanningFrame((0.0, 0.0), 0.0, 0.0), trajectory)


def broken(trip: Trip, vehicle: dict[str, Any], **changes: Any) -> set[str]:
    """Limits that are broken by a drive from its own state, with limits that were changed under way."""
    usual = {"max_speed": 10.0, "max_acceleration": 10.0, "max_deceleration": DECELERATION, "radius": 0.3}
    start: dict[str, Any] = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}
    scenario = sp.Scenario.model_validate(
        {"vehicle": usual, "start": start, "goal": {"position": [LENGTH, 0.0]}} | changes
    )
    state = trip.trajectory.drive_at(np.zeros(1))
    acceleration = float(state.acceleration[0]) if "max_jerk" in vehicle else None
    begins = scenario.start.model_copy(update={"speed": float(state.speed[0]), "acceleration": acceleration})
    vehicle_then = scenario.vehicle.model_copy(update=vehicle)
    scenario = scenario.model_copy(update={"start": begins, "vehicle": vehicle_then})
    certificate = sp.certify(scenario, SimpleNamespace(trip=trip))
    return {each.what for each in certificate.violations if each.is_of_limit}


SLOW = {"from": 0.0, "to": 50.0, "speed": 1.0, "line": [[0.0, 0.0], [60.0, 0.0]]}
BRAKES = driven(3.0, [0.0, 1.0, 6.0], [-DECELERATION, 0.0])
LATE = driven(3.0, [0.0, 0.05, 1.05, 6.0], [0.0, -DECELERATION, 0.0])
SOFTLY = driven(3.0, [0.0, 1.0 / 0.999, 6.0], [-0.999 * DECELERATION, 0.0])


@pytest.mark.parametrize(("trip", "kept"), [(BRAKES, True), (LATE, False), (SOFTLY, False)])
def test_speed_above_a_limit_falls_as_fast_as_the_vehicle_brakes(trip: Trip, kept: bool) -> None:
    assert broken(trip, {"max_speed": 1.0}) == (set() if kept else {"speed"})
    assert broken(trip, {}, speed_limits=[SLOW]) == (set() if kept else {"speed_limits[0]"})
    assert broken(trip, {"max_speed": 3.0}) == set()


def test_speed_limit_that_is_not_there_at_the_start_excuses_nothing() -> None:
    assert broken(BRAKES, {}, speed_limits=[SLOW | {"from": 0.1}]) == {"speed_limits[0]"}


@pytest.mark.parametrize("held", [0.0, 0.05])
def test_speed_with_a_jerk_limit_falls_along_ramps(held: float) -> None:
    """From 5 m/s at 1 m/s2: 1.5 s until it brakes with 2 m/s2, 1.625 s of that, 1 s to release."""
    times, values = np.array([0.0, 1.5, 3.125, 4.125, 8.0]), [1.0, -2.0, -2.0, 0.0, 0.0]
    times, values = (np.append(0.0, times + held), [1.0, *values]) if held else (times, values)
    trip = driven(5.0, times.tolist(), values)
    assert broken(trip, {"max_speed": 1.5, "max_jerk": JERK}) == ({"speed"} if held else set())


@pytest.mark.parametrize("held", [0.0, 0.05])
@pytest.mark.parametrize(
    ("sign", "limits", "names"),
    [
        (1.0, {"max_acceleration": 1.0}, {"acceleration"}),
        (-1.0, {"max_deceleration": 1.0}, {"acceleration"}),
        (1.0, {"max_total_acceleration": 1.0}, {"total_acceleration"}),
        (-1.0, {"max_total_acceleration": 1.0}, {"total_acceleration"}),
        (1.0, {"max_power": 3.0}, {"power"}),
    ],
)
def test_acceleration_above_a_limit_falls_at_the_largest_jerk(
    sign: float, limits: dict[str, float], names: set[str], held: float
) -> None:
    """From 2 m/s2 of either sign, at the largest jerk, to none."""
    times = [0.0, held, held + 1.0, 4.0] if held else [0.0, 1.0, 4.0]
    values = [sign * 2.0, sign * 2.0, 0.0, 0.0] if held else [sign * 2.0, 0.0, 0.0]
    assert broken(driven(3.0, times, values), limits | {"max_jerk": JERK}) == (names if held else set())


def test_acceleration_that_may_jump_is_within_its_limit_at_once() -> None:
    assert broken(SOFTLY, {"max_deceleration": 1.0}) == {"acceleration"}
    assert broken(SOFTLY, {"max_total_acceleration": 1.0}) == {"total_acceleration"}
    assert broken(driven(3.0, [0.0, 1.0, 4.0], [2.0, 0.0, 0.0]), {"max_jerk": 1.0}) == {"jerk"}


@pytest.mark.parametrize(("late", "kept"), [(0.0, True), (0.05, False)])
def test_samples_slow_down_as_fast_as_the_vehicle_brakes(late: float, kept: bool) -> None:
    times = np.linspace(0.0, 6.0, 601)
    speeds = np.maximum(3.0 - DECELERATION * np.maximum(times - late, 0.0), 1.0)
    places = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times))])
    samples = sp.SampledTrajectory(
        time=times,
        position=np.column_stack([places, np.zeros_like(places)]),
        heading=np.zeros_like(places),
        speed=speeds,
    )
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 3.0}
    vehicle = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 3.0, "max_deceleration": DECELERATION}
    scenario = sp.Scenario.model_validate(
        {"vehicle": vehicle, "start": start, "goal": {"position": [float(places[-1]), 0.0]}}
    )
    slower = scenario.model_copy(update={"vehicle": scenario.vehicle.model_copy(update={"max_speed": 1.0})})
    found = {each.what for each in sp.certify(slower, samples).violations}
    assert found == (set() if kept else {"speed"})


def test_drive_that_ends_before_its_excess_does_is_refused() -> None:
    trip = driven(3.0, [0.0, 0.5, 1.0], [-DECELERATION, -DECELERATION])
    assert broken(trip, {"max_speed": 0.5}) == {"speed"}
    assert broken(trip, {}, speed_limits=[SLOW | {"speed": 0.5}]) == {"speed_limits[0]"}
