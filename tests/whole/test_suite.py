"""Named scenes, each a claim: planned by two solvers, certified, and checked by distances of polygons at dense times.

The check knows nothing of the planner but positions at times: obstacles are drawn with shapely at each time.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from shapely import affinity, distance, points, unary_union
from shapely.geometry import Point, Polygon, box
from shapely.geometry.base import BaseGeometry

import scp_planner as sp
from scp_planner.trips.trip import discs_at
from verification.dense_check import check_trip

Array = np.ndarray
SUITE = Path(__file__).parents[1] / "suite"
SCENES = {path.stem: sp.Scenario.load(path) for path in sorted(SUITE.glob("*.yaml"))}
CHECKS = 1200
SLOWEST = {  # s: a plan that is slower than this has lost something; about 1 % above what is found
    "arrive-at-a-heading-and-speed": 6.95,
    "arrive-in-a-window": 12.001,
    "carry-a-full-tank": 8.75,
    "drive-a-long-truck": 8.35,
    "follow-a-convoy": 11.05,
    "out-of-a-pocket": 6.7,
    "let-a-forecast-pass": 6.65,
    "overtake-a-truck": 13.65,
    "s-shaped-corridor": 14.65,
    "slow-past-a-school": 13.0,
    "stay-in-the-corridor": 7.3,
    "steer-slowly-round-a-post": 5.6,
    "stop-at-the-goal": 6.2,
    "u-turn-around-a-wall": 8.9,
    "wait-for-a-convoy": 13.9,
    "weave-through-three-walls": 7.9,
}
LONGEST = "slow-past-a-school"
"""The scene that takes as much work as the others together."""
BY_ANOTHER = (
    "carry-a-full-tank",
    "drive-a-long-truck",
    "stay-in-the-corridor",
    "steer-slowly-round-a-post",
)
"""Scenes of every kind of limit, planned by another solver, too; the others where there is time."""
TURNED = (
    "arrive-at-a-heading-and-speed",
    "drive-a-long-truck",
    "let-a-forecast-pass",
    "overtake-a-truck",
    "stay-in-the-corridor",
    "u-turn-around-a-wall",
)
"""Scenes with every kind of place and direction; the others where there is time."""


@cache
def planned(name: str, solver: str = "daqp") -> sp.Plan:
    return sp.plan(SCENES[name], solver=solver)


def drawn(obstacle: sp.Obstacle, t: float) -> BaseGeometry:
    """The obstacle at a time."""
    motion, shape = obstacle.motion, obstacle.shape
    assert isinstance(motion, sp.Motion | sp.Course)
    if isinstance(motion, sp.Course):
        spline = CubicSpline(motion.time, motion.position, bc_type="natural")
        inside = np.clip(t, motion.time[0], motion.time[-1])
        going = spline(inside, 1)
        centre = spline(inside) + (t - inside) * going
    else:
        start, velocity, acceleration = (np.array(v) for v in (motion.position, motion.velocity, motion.acceleration))
        centre, going = start + velocity * t + acceleration * t**2 / 2, velocity + acceleration * t
    if isinstance(shape, sp.Disc):
        return Point(centre).buffer(shape.disc, quad_segs=512)
    if isinstance(shape, sp.PolygonShape):
        return affinity.translate(Polygon(shape.polygon), *centre)
    if isinstance(shape, sp.Rectangle):
        length, width = shape.rectangle
        figure: BaseGeometry = box(-length / 2, -width / 2, length / 2, width / 2)
    else:
        figure = affinity.scale(Point(0.0, 0.0).buffer(1.0, quad_segs=2048), *shape.ellipse)
    heading = shape.heading if shape.heading is not None else np.arctan2(going[1], going[0])
    c, s = np.cos(heading), np.sin(heading)
    return affinity.affine_transform(figure, [c, -s, s, c, *centre])


def spread(obstacle: sp.Obstacle, t: float, scenario: sp.Scenario) -> BaseGeometry:
    """A disc on a course with a covariance, with the ellipse that holds its centre at all times of the course."""
    motion, shape = obstacle.motion, obstacle.shape
    assert isinstance(motion, sp.Course)
    assert isinstance(shape, sp.Disc)
    inside = np.clip(t, motion.time[0], motion.time[-1])
    given = np.array(motion.covariance).reshape(-1, 4)
    squares, axes = np.linalg.eigh(
        [[np.interp(inside, motion.time, given[:, 2 * i + j]) for j in (0, 1)] for i in (0, 1)]
    )
    scale = -2.0 * np.log1p(-(scenario.confidence.probability ** (1.0 / len(motion.time))))
    half_axes = np.sqrt(scale * squares)
    ellipse = affinity.scale(Point(0.0, 0.0).buffer(1.0, quad_segs=512), *half_axes)
    turned = affinity.rotate(ellipse, np.arctan2(axes[1, 0], axes[0, 0]), origin=(0, 0), use_radians=True)
    still = obstacle.model_copy(update={"motion": motion.model_copy(update={"covariance": None})})
    center = drawn(still, t).centroid
    return affinity.translate(turned, center.x, center.y).buffer(shape.disc, quad_segs=128)


def assert_safe(scenario: sp.Scenario, plan: sp.Plan) -> None:
    """Limits and ends by differences of positions, clearances by distances of drawn polygons."""
    report = check_trip({**scenario.to_dict(), "obstacles": []}, plan.position, plan.start_time, plan.arrival_time)
    assert report.ok, str(report)
    times = np.linspace(plan.start_time, plan.arrival_time, CHECKS)
    # of the vehicle's discs, (discs, times)
    places = np.array([points(c) for c in discs_at(plan.position(times), plan.heading(times), scenario.vehicle.discs)])
    assert_clear(scenario, times, places)


def assert_clear(scenario: sp.Scenario, times: Array, places: Array) -> None:
    """Clearances of the discs of the vehicle, their centres drawn, (discs, times)."""
    if scenario.corridor is not None:
        corridor = unary_union([Polygon(polygon) for polygon in scenario.corridor])
        assert corridor.contains(places).all()
        assert distance(corridor.boundary, places).min() >= scenario.vehicle.radius - 2e-6
    for obstacle in scenario.obstacles:
        assert isinstance(obstacle.motion, sp.Motion | sp.Course)
        if isinstance(obstacle.motion, sp.Course):
            # ellipses are drawn with care, which takes time: every fourth will do
            exact, some = obstacle.motion.covariance is None, slice(None, None, 4)
            figures = [drawn(obstacle, t) if exact else spread(obstacle, t, scenario) for t in times[some]]
            gaps = distance(figures, places[:, some])
        elif not any((*obstacle.motion.velocity, *obstacle.motion.acceleration)):
            gaps = distance(drawn(obstacle, 0.0), places)
        else:
            gaps = distance([drawn(obstacle, t) for t in times], places)
        gaps = gaps.min(axis=0)
        least = gaps.min() - obstacle.margin - scenario.vehicle.radius
        assert least >= -2e-6, f"{obstacle.id}: {least} at {times[:: len(times) // len(gaps)][gaps.argmin()]}"


@pytest.mark.parametrize(
    ("name", "solver"),
    [
        *(pytest.param(n, "daqp", marks=pytest.mark.slow if n == LONGEST else ()) for n in SCENES),
        *(pytest.param(n, "clarabel", marks=() if n in BY_ANOTHER else pytest.mark.slow) for n in SCENES),
    ],
)
def test_the_scene_is_planned_certified_and_safe(name: str, solver: str) -> None:
    scenario = SCENES[name]
    assert scenario.name == name
    plan = planned(name, solver)
    assert plan.certified, plan.reason
    assert plan.travel_time <= SLOWEST[name]
    assert_safe(scenario, plan)


def turned_and_moved(scenario: sp.Scenario, angle: float, shift: Array) -> sp.Scenario:
    """A scene elsewhere; a box stays along the axes: it is only moved."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def place(point: object) -> list[float]:
        return (turn @ np.array(point) + shift).tolist()

    def vector(value: object) -> list[float]:
        return (turn @ np.array(value)).tolist()

    data = scenario.to_dict()
    if data["bounds"] is not None:
        assert angle == 0.0
        data["bounds"] = {corner: place(point) for corner, point in data["bounds"].items()}
    for end in (data["start"], data["goal"]):
        end["position"] = place(end["position"])
        if end["heading"] is not None:
            end["heading"] += angle
    if data["corridor"] is not None:
        data["corridor"] = [[place(point) for point in polygon] for polygon in data["corridor"]]
    assert not any(limit["line"] for limit in data["speed_limits"])
    if data["guide"] is not None:
        data["guide"] = [data["start"]["position"], *map(place, data["guide"][1:-1]), data["goal"]["position"]]
    for obstacle in data["obstacles"]:
        motion, shape = obstacle["motion"], obstacle["shape"]
        if isinstance(motion["time"], list):
            motion["position"] = [place(point) for point in motion["position"]]
            if motion["covariance"] is not None:
                motion["covariance"] = [(turn @ np.array(each) @ turn.T).tolist() for each in motion["covariance"]]
            continue
        moves = any((*motion["velocity"], *motion["acceleration"]))
        motion.update(
            position=place(motion["position"]),
            velocity=vector(motion["velocity"]),
            acceleration=vector(motion["acceleration"]),
        )
        if "polygon" in shape:
            shape["polygon"] = [vector(vertex) for vertex in shape["polygon"]]
        elif "disc" not in shape and (shape["heading"] is not None or not moves):
            shape["heading"] = (shape["heading"] or 0.0) + angle
    return sp.Scenario(**data)


@pytest.mark.parametrize(
    "name", [name if name in TURNED else pytest.param(name, marks=pytest.mark.slow) for name in SCENES]
)
def test_turning_the_scene_and_moving_it_by_10_km_changes_nothing(name: str) -> None:
    here = planned(name)
    angle = 0.7 if SCENES[name].bounds is None else 0.0
    there = sp.plan(turned_and_moved(SCENES[name], angle, np.array([8_000.0, -6_000.0])))
    assert there.certified, there.reason
    assert there.travel_time == pytest.approx(here.travel_time, rel=1e-6)


def fastest_profile(scenario: sp.Scenario, plan: sp.Plan) -> float:
    """Least travel time over all speed profiles on the path of a plan: a search over (time, place, speed).

    On a lattice of 0.1 s, 0.05 m/s and 2.5 mm every change of speed within the limits is a step; what can be reached
    is found step by step.
    """
    step, quantum = 0.1, 0.05
    cell = 0.5 * step * quantum
    dense = np.linspace(plan.start_time, plan.arrival_time, 20_001)
    position = plan.position(dense)
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(position, axis=0).T))])
    cells = int(np.ceil(driven[-1] / cell)) + 1
    coarse = np.linspace(0.0, driven[-1], 400)
    place = points(np.stack([np.interp(coarse, driven, position[:, axis]) for axis in (0, 1)], axis=1))
    speeds = int(scenario.vehicle.max_speed / quantum) + 1
    up = round(scenario.vehicle.max_acceleration * step / quantum)
    down = round(scenario.vehicle.max_deceleration * step / quantum)
    reached = np.zeros((cells, speeds), dtype=bool)
    reached[0, round(scenario.start.speed / quantum)] = True
    for number in range(1, 1000):
        t = scenario.start.time + number * step
        after = np.zeros_like(reached)
        for speed in np.flatnonzero(reached.any(axis=0)).tolist():
            for faster in range(max(speed - down, 0), min(speed + up, speeds - 1) + 1):
                shift = speed + faster
                after[shift:, faster] |= reached[: cells - shift, speed]
                if reached[cells - 1 - shift :, speed].any():
                    return t - scenario.start.time
        gaps = np.min([distance(drawn(obstacle, t), place) for obstacle in scenario.obstacles], axis=0)
        free = np.interp(np.arange(cells) * cell, coarse, gaps) > scenario.vehicle.radius
        reached = after & free[:, None]
    raise AssertionError("never arrives")


@pytest.mark.parametrize("name", ["wait-for-a-convoy", pytest.param("follow-a-convoy", marks=pytest.mark.slow)])
def test_a_convoy_is_waited_for_no_longer_than_the_best_speed_profile_does(name: str) -> None:
    plan = planned(name)
    best = fastest_profile(SCENES[name], plan)
    assert plan.travel_time <= 1.02 * best
    assert plan.travel_time > 1.3 * plan.lower_bound
