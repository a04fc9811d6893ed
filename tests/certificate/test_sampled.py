"""The certificate of samples, against dense evaluation of the same motion by scipy, and by what is wrong by little."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from reference_trips import UNLIMITED
from scenes import CROSSERS, disc, scene
from scipy.interpolate import PPoly

import scp_planner as sp
from scp_planner.certificate.verdict import BEYOND_ZONES

pytestmark = pytest.mark.numerics

Array = np.ndarray


def samples_of(plan: sp.Plan, times: Array) -> sp.SampledTrajectory:
    return sp.SampledTrajectory(times, plan.position(times), plan.heading(times), plan.speed(times))


def reference(samples: sp.SampledTrajectory) -> PPoly:
    """The motion as scipy's piecewise polynomial: two parabolas between two samples, by solving for them."""
    assert samples.heading is not None and samples.speed is not None
    velocity = samples.speed[:, None] * np.stack([np.cos(samples.heading), np.sin(samples.heading)], axis=1)
    breaks, pieces = [samples.time[0]], []
    for k, step in enumerate(np.diff(samples.time)):
        half = 0.5 * step
        system = np.array([[half, half], [1.5 * half**2, 0.5 * half**2]])
        moved = samples.position[k + 1] - samples.position[k] - velocity[k] * step
        a, b = np.linalg.solve(system, np.stack([velocity[k + 1] - velocity[k], moved]))
        middle = samples.position[k] + half * velocity[k] + 0.5 * half**2 * a
        pieces += [(0.5 * a, velocity[k], samples.position[k]), (0.5 * b, velocity[k] + half * a, middle)]
        breaks += [samples.time[k] + half, samples.time[k + 1]]
    return PPoly(np.array(pieces).transpose(1, 0, 2), np.array(breaks))


def dense_times(samples: sp.SampledTrajectory, each: int = 4000) -> Array:
    """Just inside of the pieces, too, as accelerations jump at their ends."""
    grid = np.concatenate([[1e-9], np.linspace(0.0, 1.0, each + 2)[1:-1], [1.0 - 1e-9]])
    edges = np.sort(np.concatenate([samples.time, 0.5 * (samples.time[1:] + samples.time[:-1])]))
    return (edges[:-1, None] + np.diff(edges)[:, None] * grid).ravel()


def wavy(seed: int, count: int = 21) -> sp.SampledTrajectory:
    """Samples, unevenly spaced, of a winding trip that never stops, with headings and speeds that are a little off."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 9.0, count)
    time[1:-1] += rng.uniform(-0.1, 0.1, count - 2)
    x = 20.0 * time / 9.0 + 0.6 * np.sin(time)
    y = rng.uniform(-2.0, 2.0) * np.sin(0.35 * time) + rng.uniform(-0.5, 0.5) * np.sin(1.3 * time)
    rough = np.gradient(np.stack([x, y], axis=1), time, axis=0)
    heading = np.arctan2(rough[:, 1], rough[:, 0]) + rng.normal(0.0, 0.02, count)
    return sp.SampledTrajectory(time, np.stack([x, y], axis=1), heading, np.hypot(*rough.T))


def wide_open(samples: sp.SampledTrajectory, *obstacles: dict[str, Any], **changes: Any) -> sp.Scenario:
    """A scene that begins and ends as samples do and has no other limits but what changes say."""
    assert samples.heading is not None and samples.speed is not None
    start = {
        "time": float(samples.time[0]),
        "position": samples.position[0].tolist(),
        "heading": float(samples.heading[0]),
        "speed": float(samples.speed[0]),
    }
    goal = {"position": samples.position[-1].tolist()}
    vehicle = {**UNLIMITED, **changes.pop("vehicle", {})}
    return scene(*obstacles, **{"start": start, "goal": goal, "vehicle": vehicle, **changes})


@pytest.mark.parametrize("seed", range(6))
def test_limits_are_used_as_far_as_dense_samples_say(seed: int) -> None:
    samples = wavy(seed)
    motion, times = reference(samples), dense_times(samples)
    velocity, acceleration = motion(times, 1), motion(times, 2)
    speed = np.hypot(*velocity.T)
    along = (velocity * acceleration).sum(axis=1) / speed
    across = (velocity[:, 0] * acceleration[:, 1] - velocity[:, 1] * acceleration[:, 0]) / speed
    wanted = {
        "speed": speed,
        "acceleration": np.abs(along),
        "lateral_acceleration": np.abs(across),
        "curvature": np.abs(across) / speed**2,
        "total_acceleration": np.hypot(*acceleration.T),
        "power": np.maximum(along, 0.0) * speed,
    }
    more = {"max_total_acceleration": 1e3, "max_power": 1e6}
    certificate = sp.certify(wide_open(samples, vehicle=more), samples)
    assert certificate.holds, certificate.violations
    for name, values in wanted.items():
        use = certificate.limits[name]
        assert abs(use.worst) == pytest.approx(values.max(), rel=1e-6), name
        near = np.abs(times - use.time) < 1e-3
        assert values[near].max() == pytest.approx(values.max(), rel=1e-2), name


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("limit", "name"),
    [
        ("max_speed", "speed"),
        ("max_lateral_acceleration", "lateral_acceleration"),
        ("max_curvature", "curvature"),
        ("max_total_acceleration", "total_acceleration"),
        ("max_power", "power"),
    ],
)
def test_a_limit_broken_by_a_millionth_is_refused(seed: int, limit: str, name: str) -> None:
    samples = wavy(seed)
    free = sp.certify(wide_open(samples, vehicle={"max_power": 1e6, "max_total_acceleration": 1e3}), samples)
    worst = free.limits[name].worst
    for share, holds in ((1.0 + 1e-6, True), (1.0 - 1e-6, False)):
        vehicle = {"max_speed": 1e3, limit: worst * share}
        certificate = sp.certify(wide_open(samples, vehicle=vehicle), samples)
        assert certificate.holds is holds
        assert holds or [violation.what for violation in certificate.violations] == [name]


@pytest.mark.parametrize("discs", [(0.0,), (0.0, 0.4, -0.7)])
def test_trips_among_obstacles_are_judged_as_by_dense_samples(discs: tuple[float, ...], count: int = 18) -> None:
    """The verdict, but within a micrometre, and the least clearance, of random trips past many discs."""
    rng, verdicts = np.random.default_rng(len(discs)), []
    for trial in range(count):
        samples = wavy(trial)
        motion, times = reference(samples), dense_times(samples, 300)
        spots, pace = rng.uniform((4.0, -4.0), (18.0, 4.0), (3, 2)), rng.normal(0.0, 0.3, (3, 2))
        pull = rng.normal(0.0, 0.02, (3, 2))
        centers = spots + times[:, None, None] * pace + 0.5 * times[:, None, None] ** 2 * pull
        unit = motion(times, 1) / np.hypot(*motion(times, 1).T)[:, None]
        places = np.stack([motion(times) + offset * unit for offset in discs])
        least = float(np.linalg.norm(places[:, :, None] - centers, axis=3).min()) - 0.3 - 0.4
        first = np.linalg.norm(places[:, :1] - spots, axis=2).min() - 0.7
        if abs(least) < 1e-6 or first < 1e-3:
            continue
        moving = [disc(f"o{k}", tuple(spots[k]), tuple(pace[k]), tuple(pull[k]), 0.4) for k in range(3)]
        found = sp.certify(wide_open(samples, *moving, vehicle={"discs": discs}), samples)
        verdicts.append(found.holds)
        assert found.holds is (least > 0.0)
        if found.holds:
            assert least - 1.1e-3 <= found.clearance.minimum <= least + 1e-6
    assert len(set(verdicts)) == 2


@pytest.mark.parametrize(("gap", "holds"), [(-1e-3, False), (-1e-6, False), (1e-6, True)])
def test_an_obstacle_clipped_between_samples_is_seen(gap: float, holds: bool) -> None:
    """A small disc beside the line, a second and more from every sample."""
    time = np.arange(0.0, 11.0, 2.0)
    position = np.stack([2.0 * time, np.zeros(len(time))], axis=1)
    samples = sp.SampledTrajectory(time, position, np.zeros(len(time)), np.full(len(time), 2.0))
    post = disc("post", (10.0, -(0.3 + 0.05 + gap)), radius=0.05)
    at_samples = np.hypot(*(position - np.array([10.0, -0.35])).T).min() - 0.35
    assert at_samples > 1.0
    certificate = sp.certify(scene(post, start={"speed": 2.0}), samples)
    assert certificate.holds is holds
    if not holds:
        assert [violation.what for violation in certificate.violations] == ["clearance"]
        assert certificate.clearance.time == pytest.approx(5.0, abs=0.05)


@pytest.mark.parametrize(
    ("begin", "first", "last"),
    [
        (7.734338625782538, (104.27179467491568, 3.229485931355296), (82.13106288065389, 5.239750768722935)),
        (7.500202917969993, (84.1557870357143, 3.1419336688254322), (99.04247229215792, 4.429459869935247)),
        (7.775930093759994, (79.04660266489049, 2.7267855133360546), (101.87247678930521, 4.630288597849843)),
        (8.246091240674456, (81.82522533882252, 3.1464042382173085), (102.00360998062885, 3.7709747252215667)),
    ],
)
def test_a_rectangle_in_a_slow_turn_heads_along_its_velocity(
    begin: float, first: tuple[float, float], last: tuple[float, float]
) -> None:
    """These trips are up to a metre inside of it, for a tenth of a second, at 5.2 % of its top speed."""
    points = [[0.0, 0.0], [80.0, 0.0], [80.0, 4.0], [0.0, 4.0]]
    course = {"time": [0.0, 8.0, 16.0, 24.0], "position": points}
    (x, y), lasts = np.subtract(last, first).tolist(), 8.0
    heading, speed = float(np.arctan2(y, x)), float(np.hypot(x, y)) / lasts
    scenario = sp.Scenario(
        vehicle={"radius": 0.3, "max_speed": 3.01, "max_acceleration": 1.5, "max_deceleration": 2.0},
        start={"time": begin, "position": list(first), "heading": heading, "speed": speed},
        goal={"position": list(last)},
        obstacles=[{"id": "car", "shape": {"rectangle": [4.5, 1.8]}, "motion": course}],
    )
    samples = sp.SampledTrajectory([begin, begin + lasts], [list(first), list(last)], [heading] * 2, [speed] * 2)
    certificate = sp.certify(scenario, samples)
    assert {violation.what for violation in certificate.violations} == {"clearance"}


def test_our_own_plan_is_certified_from_its_samples_but_for_what_they_lose() -> None:
    """With the times at which its acceleration jumps, and a limit that is a little wider, for the rest."""
    scenario = scene(*CROSSERS)
    plan = sp.plan(scenario)
    assert plan.certified
    excess = []
    for count in (100, 200, 400, 800):
        times = np.union1d(np.linspace(plan.start_time, plan.arrival_time, count), plan.knot_times)
        found = sp.certify(scenario, samples_of(plan, times))
        assert {violation.what for violation in found.violations} <= {"acceleration", "speed", "lateral_acceleration"}
        assert found.clearance.minimum >= -1e-9
        excess.append(max(abs(use.worst / use.limit) for use in found.limits.values() if use.limit) - 1.0)
    # At least of first order in the step
    assert excess[-1] < 0.3 * excess[0] < 0.01
    parts = scenario.to_dict()
    for name in ("max_speed", "max_acceleration", "max_deceleration", "max_lateral_acceleration", "max_curvature"):
        parts["vehicle"][name] *= 1.01
    assert sp.certify(sp.Scenario(**parts), samples_of(plan, times)).holds


def straight(time: list[float], x: list[float], speed: list[float] | None = None) -> sp.SampledTrajectory:
    heading = None if speed is None else [0.0] * len(time)
    return sp.SampledTrajectory(time, [[value, 0.0] for value in x], heading, speed)


def test_a_trip_from_rest_with_a_stop_on_its_way_is_certified() -> None:
    samples = straight(
        [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 17.0],
        [0.0, 2.0, 4.0, 4.0, 6.0, 8.0, 20.0],
        [0.0, 2.0, 0.0, 0.0, 2.0, 0.0, 12 / 7],
    )
    scenario = scene(start={"speed": 0.0})
    certificate = sp.certify(scenario, samples)
    assert [violation.what for violation in certificate.violations] == []
    assert certificate.limits["speed"].worst == pytest.approx(18.0 / 7.0)  # in the middle of the last step


def test_driving_backwards_is_refused() -> None:
    samples = straight([0.0, 2.0, 4.0, 6.0, 9.0], [0.0, 2.0, 1.0, 2.0, 20.0])
    certificate = sp.certify(scene(vehicle=UNLIMITED), samples)
    back = next(violation for violation in certificate.violations if violation.what == "speed")
    assert back.value < 0.0 and back.allowed == 0.0


@pytest.mark.parametrize(
    ("vehicle", "holds"), [({"max_curvature": None}, True), ({}, False), ({"discs": [0.0, 0.5]}, False)]
)
def test_turning_where_it_stands_is_only_for_what_has_no_curvature(vehicle: dict[str, Any], holds: bool) -> None:
    samples = sp.SampledTrajectory(
        [0.0, 10.0, 20.0],
        [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]],
        [0.0, 0.0, np.pi / 2],
        [1.0, 0.0, 1.0],
    )
    limits = {"max_lateral_acceleration": None, "max_curvature": None if "discs" in vehicle else 5.0, **vehicle}
    scenario = scene(vehicle=limits, goal={"position": [10.0, 10.0]})
    certificate = sp.certify(scenario, samples)
    assert certificate.holds is holds
    assert holds or [violation.what for violation in certificate.violations] == ["turn while standing"]


def test_moving_off_in_another_direction_than_the_start_asks_is_refused() -> None:
    time = [0.0, 5.0, 10.0]
    position = [[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]]
    samples = sp.SampledTrajectory(time, position, speed=[0.0, 2.0, 2.0])
    for heading, holds in ((0.0, True), (0.01, False)):
        scenario = scene(start={"heading": heading, "speed": 0.0}, vehicle=UNLIMITED)
        certificate = sp.certify(scenario, samples)
        assert certificate.holds is holds
        assert holds or certificate.violations[0].what == "start heading"


@pytest.mark.parametrize("centre", [1.0, -1.0])
@pytest.mark.parametrize(("way", "heading"), [(-4.5, np.pi), (4.5, 0.0)], ids=["backwards", "ahead"])
def test_the_middle_of_a_vehicle_is_towards_its_front_whichever_way_it_drives(
    centre: float, way: float, heading: float
) -> None:
    """The front heads along x all the time."""
    samples = sp.SampledTrajectory(
        [0.0, 1.0, 5.0], [[0.0, 0.0], [way / 9.0, 0.0], [way, 0.0]], [heading] * 3, [0.0, 1.0, 1.0]
    )
    for middle, holds in ((way + centre, True), (way - centre, False)):
        region = [[middle + x, y] for x, y in ((-0.4, -0.4), (0.4, -0.4), (0.4, 0.4), (-0.4, 0.4))]
        scenario = sp.Scenario(
            vehicle={"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0}
            | {"steering": "both_ways", "centre": centre},
            start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0},
            goal={"region": region, "position": [way, 0.0]},
        )
        certificate = sp.certify(scenario, samples)
        assert certificate.holds is holds
        names = {violation.what for violation in certificate.violations}
        assert names == (set() if holds else {"distance from the goal region"})


def test_ends_that_differ_from_the_scenario_are_refused() -> None:
    samples = straight([0.0, 10.0], [0.0, 20.0], [2.0, 2.0])
    assert sp.certify(scene(start={"speed": 2.0}), samples).holds
    for changes, what in (
        ({"start": {"speed": 1.9}}, "start speed"),
        ({"start": {"speed": 2.0, "time": 0.1}}, "start time"),
        ({"start": {"speed": 2.0, "position": [0.0, 0.01]}}, "distance from the start"),
        ({"start": {"speed": 2.0, "heading": 0.001}}, "start heading"),
        ({"start": {"speed": 2.0, "acceleration": 0.1}}, "start acceleration error"),
        ({"start": {"speed": 2.0}, "goal": {"position": [20.0, 0.1]}}, "distance from the goal"),
        ({"start": {"speed": 2.0}, "goal": {"heading": 0.1}}, "goal heading"),
        ({"start": {"speed": 2.0}, "goal": {"heading_range": [0.1, 0.2]}}, "goal heading"),
        ({"start": {"speed": 2.0}, "goal": {"speed": 1.9}}, "goal speed error"),
        ({"start": {"speed": 2.0}, "goal": {"speed_range": [0.0, 1.9]}}, "goal speed"),
        ({"start": {"speed": 2.0}, "goal": {"latest_arrival": 9.9}}, "latest arrival"),
        ({"start": {"speed": 2.0}, "goal": {"earliest_arrival": 10.1}}, "earliest arrival"),
        ({"start": {"speed": 2.0}, "goal": {"arrival_step": 0.3}}, "arrival off the step"),
        (
            {
                "start": {"speed": 2.0},
                "goal": {"position": [22.0, 0.0], "region": [[21, -1], [23, -1], [23, 1], [21, 1]]},
            },
            "distance from the goal region",
        ),
    ):
        certificate = sp.certify(scene(**changes), samples)
        assert [violation.what for violation in certificate.violations] == [what], what


@pytest.mark.parametrize(("speed", "length"), [(3.0, 20.0), (0.001, 20.0), (3.0, 2e4), (1.0, 1e6)])
@pytest.mark.parametrize("share", [1e-4, 1e-6, 1e-8])
def test_windows_of_arrival_are_kept_to_a_share_of_the_travel_time(speed: float, length: float, share: float) -> None:
    """Slow vehicles and long ways have no longer grace."""
    time = length / speed
    limits = {"max_speed": speed, "max_acceleration": speed**2 / length, "max_deceleration": speed**2 / length}
    samples = sp.SampledTrajectory([0.0, time], [[0.0, 0.0], [length, 0.0]], [0.0, 0.0], [speed, speed])
    for key, missed in (("earliest_arrival", 1.0), ("latest_arrival", -1.0)):
        for miss in (missed * share, 0.0, -missed * share):
            scenario = sp.Scenario(
                vehicle={"radius": 0.01, **limits},
                start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": speed},
                goal={"position": [length, 0.0], key: time * (1.0 + miss)},
            )
            certificate = sp.certify(scenario, samples)
            assert certificate.holds is (miss != missed * share or share < 1e-7)
            names = {violation.what for violation in certificate.violations}
            assert names <= {key.replace("_", " ")}


@pytest.mark.parametrize(("room", "holds"), [(1e-4, True), (-1e-5, False)])
def test_workspace_corridors_and_walls_are_kept_between_samples(room: float, holds: bool) -> None:
    """A swing of the way to the left and back, between samples on the line."""
    time, position = [0.0, 4.0, 8.0], [[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]]
    samples = sp.SampledTrajectory(time, position, [0.6, -0.6, 0.6], [2.5, 2.5, 2.5])
    across = reference(samples)(dense_times(samples))[:, 1]
    low, high = float(across.min()) - 0.3 - room, float(across.max()) + 0.3 + room
    box = sp.certify(wide_open(samples, bounds={"min": [-1.0, low], "max": [21.0, high]}), samples)
    assert {violation.what for violation in box.violations} == (set() if holds else {"workspace bounds"})
    corridor = [[[-2.0, -5.0], [22.0, -5.0], [22.0, high], [-2.0, high]]]
    assert sp.certify(wide_open(samples, corridor=corridor), samples).holds is holds
    wall = [[[2.0, high], [8.0, high], [8.0, high + 1.0], [2.0, high + 1.0]]]
    assert sp.certify(wide_open(samples, walls=wall), samples).holds is holds


@pytest.mark.parametrize(("ahead", "holds"), [(1.5, True), (2.4, False), (30.0, False)])
def test_a_disc_that_begins_beyond_the_corridor_is_refused(ahead: float, holds: bool) -> None:
    """Walls outside of it have a thickness; a disc beyond them touches none of them."""
    samples = straight([0.0, 6.0], [0.0, 3.0], [0.5, 0.5])
    vehicle = {"radius": 0.3, "max_speed": 1.0, "max_acceleration": 1.0, "max_deceleration": 1.0}
    scenario = sp.Scenario(
        vehicle=vehicle | {"discs": [0.0, ahead]},
        start={"time": 0.0, "position": [0.0, 0.0], "speed": 0.5},
        goal={"position": [3.0, 0.0]},
        corridor=[[[-1.0, -1.0], [5.0, -1.0], [5.0, 1.0], [-1.0, 1.0]]],
    )
    certificate = sp.certify(scenario, samples)
    assert certificate.holds is holds
    assert {violation.obstacle for violation in certificate.violations} == (set() if holds else {"corridor"})


def test_speed_limits_by_place_hold_between_samples() -> None:
    """Fast only within 2 m in the middle of an interval."""
    faster = straight([0.0, 4.0, 6.0, 10.0], [0.0, 8.0, 12.5, 20.5], [2.0, 2.0, 2.0, 2.0])
    slow = [{"from": 9.9, "to": 10.6, "speed": 2.4}]
    clear = [{"from": 1.0, "to": 7.9, "speed": 2.4}]
    goal = {"position": [20.5, 0.0]}
    refused = sp.certify(scene(start={"speed": 2.0}, goal=goal, speed_limits=slow), faster)
    assert [violation.what for violation in refused.violations] == ["speed_limits[0]"]
    assert sp.certify(scene(start={"speed": 2.0}, goal=goal, speed_limits=clear), faster).holds


def test_where_the_jerk_is_limited_a_jump_is_refused_and_a_smooth_trip_is_not() -> None:
    smooth = straight([0.0, 5.0, 10.0], [0.0, 8.75, 20.0], [1.5, 2.0, 2.5])
    scenario = scene(start={"speed": 1.5}, vehicle={"max_jerk": 1.0, "max_curvature_rate": 1.0})
    certificate = sp.certify(scenario, smooth)
    assert certificate.holds, certificate.violations
    assert certificate.limits["jerk"].worst == pytest.approx(0.0, abs=1e-9)
    jumping = straight([0.0, 5.0, 10.0], [0.0, 9.0, 20.0], [1.5, 2.0, 2.5])
    refused = sp.certify(scenario, jumping)
    assert [violation.what for violation in refused.violations] == ["jerk"]
    turning = sp.certify(wide_open(wavy(0), vehicle={"max_curvature_rate": 1e9}), wavy(0))
    assert [violation.what for violation in turning.violations] == ["curvature_rate"]


@pytest.mark.parametrize("seed", range(3))
def test_the_verdict_does_not_depend_on_units_or_place(seed: int) -> None:
    samples = wavy(seed)
    obstacle = disc("a", (9.0, 5.0), (0.0, -0.4))
    near = sp.certify(wide_open(samples, obstacle), samples)
    shifted = sp.SampledTrajectory(
        samples.time + 1e6, samples.position + np.array([4e5, -7e5]), samples.heading, samples.speed
    )
    moved = disc("a", (4e5 + 9.0, -7e5 + 5.0), (0.0, -0.4))
    far = sp.certify(wide_open(shifted, moved), shifted)
    assert near.holds is far.holds
    assert far.clearance.minimum == pytest.approx(near.clearance.minimum, abs=2e-3)


def test_samples_of_observed_obstacles_keep_clear_of_their_zones() -> None:
    rng = np.random.default_rng(0)
    seen_at = np.linspace(-2.0, 0.0, 21)
    truth = np.array([10.0, -6.0]) + np.outer(seen_at, [0.0, 0.3])
    seen = {
        "id": "seen",
        "shape": {"disc": 0.4},
        "observations": {
            "time": seen_at.tolist(),
            "position": (truth + rng.normal(0.0, 0.05, truth.shape)).tolist(),
            "covariance": [[0.0025, 0.0], [0.0, 0.0025]],
        },
        "model": {"order": 1},
    }
    samples = straight([0.0, 10.0], [0.0, 20.0], [2.0, 2.0])
    scenario = scene(seen, start={"speed": 2.0})
    (zone,) = sp.zones(scenario)
    times = np.linspace(0.0, 10.0, 4001)
    least = zone.signed_distance(times, np.stack([2.0 * times, 0.0 * times], axis=1)).min() - 0.3
    certificate = sp.certify(scenario, samples)
    assert certificate.holds is bool(least > 0.0)
    assert certificate.clearance.minimum == pytest.approx(least, abs=1.1e-3)


@pytest.mark.parametrize(("seconds", "holds"), [(110.0, True), (130.0, False)])
def test_samples_beyond_what_is_known_of_observed_obstacles_are_refused(seconds: float, holds: bool) -> None:
    seen = {"time": [-0.2, -0.1, 0.0], "position": [[0.0, 900.0]] * 3, "covariance": [[0.01, 0.0], [0.0, 0.01]]}
    far = {"id": "far", "shape": {"disc": 0.1}, "observations": seen, "model": {"order": 0}}
    pace = 20.0 / seconds
    scenario = scene(far, start={"speed": pace})
    certificate = sp.certify(scenario, straight([0.0, seconds], [0.0, 20.0], [pace, pace]))
    assert certificate.holds == holds
    assert [violation.what for violation in certificate.violations] == ([] if holds else [BEYOND_ZONES])
