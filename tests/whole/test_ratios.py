"""Vehicles and trips of all ratios: no exception, no warning, no silence; empty scenes are driven in the best time."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from memory import MEGABYTE, traced
from scenes import disc, drone, scene

import scp_planner as sp


def ratios(least: float, most: float) -> st.SearchStrategy[float]:
    """Numbers whose exponents of ten are evenly spread."""
    return st.floats(least, most).map(lambda power: 10.0**power)


def fastest(length: float, a: float, d: float, top: float, start: float, end: float | None) -> float:
    """Time of full acceleration, cruise and full braking to the speed at the goal, found by bisection of the peak."""

    def driven(peak: float) -> float:
        rise = (peak**2 - start**2) / (2.0 * a)
        return rise if end is None else rise + (peak**2 - end**2) / (2.0 * d)

    low, high = start if end is None else max(start, end), top
    if driven(high) > length:
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if driven(middle) <= length else (low, middle)
        peak = low
    else:
        peak = top
    slowing = 0.0 if end is None else (peak - end) / d
    return (peak - start) / a + slowing + (length - driven(peak)) / peak


@st.composite
def empty_scenes(draw: st.DrawFn) -> sp.Scenario:
    """A straight trip, its speeds at the ends within what the vehicle can do on it."""
    length, top = draw(ratios(-2.0, 5.0)), draw(ratios(-2.0, 3.0))
    a = draw(ratios(-3.0, 3.0)) * top**2 / length
    d = a * draw(ratios(-2.0, 2.0))
    start = draw(st.sampled_from([0.0, 0.01, 0.5, 1.0])) * top
    end = draw(st.sampled_from([None, 0.0, 0.1, 1.0]))
    if end is not None:
        end *= top
        need = (start**2 - end**2) / (2.0 * d) if end < start else (end**2 - start**2) / (2.0 * a)
        end = None if need > 0.9 * length else end
    vehicle: dict[str, Any] = {
        "radius": length * draw(ratios(-4.0, 1.0)),
        "max_speed": top,
        "max_acceleration": a,
        "max_deceleration": d,
        "max_lateral_acceleration": draw(st.none() | ratios(-2.0, 2.0).map(lambda share: share * a)),
        "max_curvature": draw(st.none() | ratios(-2.0, 3.0).map(lambda turns: turns / length)),
    }
    return sp.Scenario(
        vehicle=vehicle,
        start={"time": 0.0, "position": [0.0, 0.0], "heading": draw(st.sampled_from([None, 0.0])), "speed": start},
        goal={"position": [length, 0.0], "speed": end},
    )


@settings(max_examples=25, deadline=None, derandomize=True)
@given(empty_scenes())
def test_empty_scenes_are_driven_in_the_best_time(scenario: sp.Scenario) -> None:
    with warnings.catch_warnings(), np.errstate(over="raise", divide="raise", invalid="raise"):
        warnings.simplefilter("error")
        plan = sp.plan(scenario)
    vehicle, goal = scenario.vehicle, scenario.goal
    best = fastest(
        goal.position[0],
        vehicle.max_acceleration,
        vehicle.max_deceleration,
        vehicle.max_speed,
        scenario.start.speed,
        goal.speed,
    )
    assert plan.certified, plan.reason
    assert best * (1.0 - 1e-5) <= plan.travel_time <= best * 1.001
    assert plan.lower_bound == pytest.approx(best, rel=1e-6)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(st.data())
def test_crossers_of_all_ratios_are_passed_or_named(data: st.DataObject) -> None:
    """Obstacles from a thousandth of the trip to a fifth of it, slow and fast, for vehicles agile and not."""
    size, pace = data.draw(ratios(-3.0, -0.7)), data.draw(ratios(-2.0, 0.5))
    places = data.draw(st.lists(st.tuples(st.floats(0.2, 0.9), st.sampled_from([-1.0, 1.0])), max_size=3))
    obstacles = [
        disc(f"o{k}", (20.0 * along, -side * 60.0 * pace * along / 3.0), (0.0, side * 3.0 * pace), radius=20.0 * size)
        for k, (along, side) in enumerate(places)
    ]
    try:
        scenario = scene(
            *obstacles,
            vehicle={"radius": 20.0 * data.draw(ratios(-3.0, -1.3)), "max_acceleration": data.draw(ratios(-1.0, 1.5))},
        )
    except sp.ScenarioError as refused:
        assert "obstacle" in str(refused) or "start" in str(refused)
        return
    with warnings.catch_warnings(), np.errstate(over="raise", divide="raise", invalid="raise"):
        warnings.simplefilter("error")
        plan = sp.plan(scenario, sp.Settings(max_runs=3))
    assert plan.certified or plan.reason
    assert plan.converged is not None
    assert plan.travel_time >= plan.lower_bound * (1.0 - 1e-5)
    assert sp.certify(scenario, plan).holds is plan.certified


@pytest.mark.parametrize("length", [160.0, 320.0, 5000.0])
def test_long_straight_trips_keep_the_switch_of_the_acceleration(length: float) -> None:
    plan = sp.plan(scene(goal={"position": [length, 0.0]}))
    assert plan.certified
    assert plan.travel_time == pytest.approx(fastest(length, 1.5, 2.0, 3.0, 1.0, None), rel=2e-4)


def test_a_hundred_spacecraft_lengths_of_memory_are_not_needed_for_a_long_trip() -> None:
    """60 km at 30 km/s among what crosses: as little memory as any other trip."""
    crossers = [disc(f"o{k}", (6e3 * k, -300.0 * k), (0.0, 1500.0), radius=50.0) for k in range(1, 9)]
    scenario = scene(
        *crossers,
        vehicle={
            "radius": 20.0,
            "max_speed": 3e4,
            "max_acceleration": 3e4,
            "max_deceleration": 3e4,
            "max_lateral_acceleration": 3e4,
            "max_curvature": None,
        },
        start={"speed": 3e4},
        goal={"position": [6e4, 0.0]},
    )
    sp.plan(scene())
    plan, most = traced(lambda: sp.plan(scenario))
    assert plan.certified
    assert most < 200 * MEGABYTE


def test_many_crossers_on_a_long_trip() -> None:
    rng = np.random.default_rng(79)
    along = np.linspace(15.0, 315.0, 79)
    pace = rng.choice([-1.0, 1.0], 79) * rng.uniform(0.4, 1.5, 79)
    when = along / 3.0 + rng.uniform(-3.0, 3.0, 79)
    crossers = [
        disc(f"o{k}", (x, -v * t), (0.0, v), radius=0.5)
        for k, (x, v, t) in enumerate(zip(along, pace, when, strict=True))
    ]
    plan = sp.plan(scenario := scene(*crossers, goal={"position": [320.0, 0.0]}), time_limit=20.0)
    assert plan.certified, plan.reason
    assert plan.gap < 0.15
    assert sp.certify(scenario, plan).holds


@pytest.mark.parametrize("seed", range(4))
def test_a_drone_among_others_needs_no_finer_spans(seed: int) -> None:
    scenario = drone(seed)
    plan, finer = sp.plan(scenario), sp.plan(scenario, sp.Settings(path_span=11.25, max_iterations=200))
    assert plan.certified and finer.certified and plan.converged
    assert plan.travel_time < 1.002 * finer.travel_time


WAREHOUSE: dict[str, Any] = {
    "vehicle": {"max_speed": 1.6, "max_acceleration": 0.6, "max_deceleration": 0.8, "max_jerk": 1.5, "radius": 0.5},
    "start": {"speed": 0.0},
    "goal": {"position": [24.0, 14.0], "heading": np.pi / 2, "speed": 0.0},
    "speed_limits": [{"from": 16.0, "to": 26.0, "speed": 0.8, "line": [[0, 0], [20, 0], [24, 4], [24, 14]]}],
}


def test_an_empty_warehouse_is_no_harder_than_one_with_obstacles() -> None:
    full = scene(disc("pallet", (7.0, -1.4), radius=0.6), disc("rack", (13.0, 2.2), radius=1.2), **WAREHOUSE)
    empty = scene(**WAREHOUSE)
    among, alone = sp.plan(full), sp.plan(empty)
    assert among.certified and alone.certified, (among.reason, alone.reason)
    finer = sp.plan(empty, sp.Settings(acceleration_spans=60))
    assert alone.travel_time <= 1.02 * finer.travel_time
    assert alone.travel_time <= 1.002 * among.travel_time
    assert alone.travel_time <= 1.055 * alone.lower_bound  # the straight line passes beside the slow zone
