"""Lower bounds of the travel time: true for every trip, and near to what waiting and going round must cost."""

from __future__ import annotations

import math
from heapq import heappop, heappush
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import CROSSERS, POCKET, disc, scene

import scp_planner as sp
from benchmarks import families
from benchmarks.common import REFERENCE_FAMILIES
from scp_planner import builtin
from scp_planner.certificate.cell_grid import CellGrid, widths
from scp_planner.certificate.fastest_drive import Speeds
from scp_planner.certificate.inscribed import CORNERS, polygons_inside
from scp_planner.certificate.lower_bound import goal_is_covered_for_good, kinematic_bound
from scp_planner.certificate.relaxation import Relaxation
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.scenario.limits import Box
from scp_planner.threat_zones.batch import ZoneBatch

SUITE = Path(__file__).parents[1] / "suite"
SOME_OF_THE_SUITE = [
    pytest.param(path, id=path.stem, marks=() if place % 3 == 1 else pytest.mark.slow)
    for place, path in enumerate(sorted(SUITE.glob("*.yaml")))
]
"""All of them where there is time."""
LANE = {"min": [-1.0, -1.0], "max": [21.0, 1.0]}


def wall(
    name: str, position: tuple[float, float], velocity: tuple[float, float], size: tuple[float, float]
) -> dict[str, Any]:
    """A rectangle along the axes."""
    return {
        "id": name,
        "shape": {"rectangle": size, "heading": 0.0},
        "motion": {"position": position, "velocity": velocity},
    }


# true: never above a trip that there is


def not_excluded(scenario: sp.Scenario, travel_time: float, longest: float = 1.2) -> bool:
    """Whether a trip of this duration is possible in the relaxation, on a grid for somewhat longer ones."""
    return Relaxation(scenario, sp.zones(scenario), longest * travel_time).possible(travel_time)


@pytest.mark.parametrize("scenario", SOME_OF_THE_SUITE)
def test_no_certified_plan_of_the_suite_is_excluded(scenario: Path) -> None:
    loaded = sp.Scenario.load(scenario)
    plan = sp.plan(loaded)
    assert plan.certified
    assert not_excluded(loaded, plan.travel_time)


@pytest.mark.parametrize("name", builtin.names())
def test_the_bound_lies_between_the_kinematic_one_and_the_plan(name: str) -> None:
    scenario = builtin.load(name)
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    bound = sp.lower_bound(scenario, at_most=plan.travel_time)
    assert kinematic_bound(scenario) <= bound <= plan.travel_time


@pytest.mark.parametrize(
    "number", [pytest.param(number, marks=() if number == 3 else pytest.mark.slow) for number in range(10)]
)
@pytest.mark.parametrize("family", REFERENCE_FAMILIES)
def test_bounds_of_reference_scenarios_are_below_their_plans(
    family: str, number: int, reference_scenarios: Path
) -> None:
    scenario = sp.Scenario.load(reference_scenarios / f"{family}-{number}.json")
    plan = sp.plan(scenario)
    assert plan.certified
    assert all(not_excluded(scenario, plan.travel_time, longest) for longest in (1.0, 1.5, 3.0))
    assert sp.lower_bound(scenario) <= plan.travel_time


@pytest.mark.parametrize("family", ["walls", "convoy", "noisy5", "crossing20"])
def test_no_certified_plan_of_random_scenarios_is_excluded(family: str) -> None:
    scenario = families.as_scenario(families.random_scenario(family, np.random.default_rng(7)))
    plan = sp.plan(scenario)
    assert plan.certified
    assert not_excluded(scenario, plan.travel_time)


@pytest.mark.slow
def test_no_certified_plan_of_many_random_scenarios_is_excluded() -> None:
    random = np.random.default_rng(5)
    certified = 0
    for family in families.FAMILIES * 20:
        scenario = families.as_scenario(families.random_scenario(family, random))
        plan = sp.plan(scenario)
        if plan.certified:
            certified += 1
            assert not_excluded(scenario, plan.travel_time), scenario.name
    assert certified > 150


def driven_at_random(scenario: sp.Scenario, count: int, random: np.random.Generator) -> list[float]:
    """Times of trips that are driven within the limits, in small steps, at random, and end safely in the goal, s.

    The vehicle speeds up or brakes and turns towards a point of its own beside the line, then towards the goal. It
    shares nothing with the package but the scenario.
    """
    vehicle, goal, step = scenario.vehicle, scenario.goal, 0.005
    assert vehicle.max_lateral_acceleration is not None and vehicle.max_curvature is not None
    x, y, heading = np.zeros(count), np.zeros(count), np.zeros(count)
    speed = np.full(count, scenario.start.speed)
    turn_point = goal.position[0] * random.uniform(0.2, 0.8, count), random.uniform(-2.5, 2.5, count)
    most = random.uniform(0.5, 1.0, count) * vehicle.max_speed
    alive, arrived = np.ones(count, dtype=bool), np.full(count, np.inf)
    for k in range(int(8.0 / step)):
        time = k * step
        for obstacle in scenario.obstacles:
            motion, shape = obstacle.motion, obstacle.shape
            assert isinstance(motion, sp.Motion) and isinstance(shape, sp.Disc)
            px, py = np.array(motion.position) + np.array(motion.velocity) * time
            alive &= np.hypot(x - px, y - py) >= shape.disc + vehicle.radius
        ended = alive & np.isinf(arrived) & (np.hypot(x - goal.position[0], y - goal.position[1]) <= goal.radius)
        arrived[ended] = time
        before = x < turn_point[0] - 0.5
        wanted = np.arctan2(
            np.where(before, turn_point[1], goal.position[1]) - y,
            np.where(before, turn_point[0], goal.position[0]) - x,
        )
        bend = np.minimum(vehicle.max_curvature, vehicle.max_lateral_acceleration / np.maximum(speed, 1e-3) ** 2)
        off = np.remainder(wanted - heading + np.pi, 2.0 * np.pi) - np.pi
        heading = heading + np.clip(off, -bend * speed * step, bend * speed * step)
        x, y = x + speed * step * np.cos(heading), y + speed * step * np.sin(heading)
        change = np.clip(most - speed, -vehicle.max_deceleration * step, vehicle.max_acceleration * step)
        speed = np.clip(speed + change, 0.0, vehicle.max_speed)
    return sorted(arrived[np.isfinite(arrived)].tolist())


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
def test_no_trip_that_is_driven_at_random_is_faster(seed: int) -> None:
    random = np.random.default_rng(seed)
    crossing = [
        disc(f"o{k}", (2.0 + 1.5 * k, float(-side * v * (2.0 + 1.5 * k) / 2.5)), (0.0, float(side * v)), radius=0.5)
        for k, (side, v) in enumerate(zip(random.choice([-1, 1], 3), random.uniform(0.3, 1.5, 3), strict=True))
    ]
    scenario = scene(*crossing, goal={"position": [8.0, 0.0], "radius": 0.4})
    fastest = driven_at_random(scenario, 2000, random)[0]
    bound = sp.lower_bound(scenario, at_most=1.1 * fastest)
    assert kinematic_bound(scenario) <= bound <= fastest
    assert bound > 0.8 * fastest  # it is a trial: chance comes near


def brute_force(scenario: sp.Scenario, cell: float, step: float) -> float:
    """Shortest time of a point that hops between the nodes of a lattice at the relaxation's speeds, s.

    Each hop is looked at so densely, and zones are taken so much larger, that all of it is clear: these are trips of
    the relaxation, though not its fastest.
    """
    frame = PlanningFrame.between(scenario.start.position, scenario.goal.position, scenario.start.time)
    zones, box = ZoneBatch.of(sp.zones(scenario), frame, scenario.vehicle.radius + 0.02), Box.of(scenario, frame, 0.0)
    length = float(np.hypot(*np.subtract(scenario.goal.position, scenario.start.position)))
    top = scenario.vehicle.max_speed
    assert scenario.start.speed == top
    reach = int(top * step / cell + 1e-9)
    hops = [
        (i, j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1) if np.hypot(i, j) <= reach + 1e-9
    ]
    shares = np.linspace(0.0, 1.0, 9)
    goal = round(length / cell)
    queue, seen = [(0, 0, 0)], {(0, 0, 0)}
    while queue:
        count, x, y = heappop(queue)
        if (x, y) == (goal, 0):
            return count * step
        here = np.array([x, y]) * cell
        ends = here + cell * np.array(hops)
        points = (here + shares[:, None, None] * (ends - here)).reshape(-1, 2)
        times = np.repeat((count + shares) * step, len(hops))
        clear = zones.distances(times, points).min(axis=1) >= 0.0
        clear &= np.all(points @ box.normals.T <= box.offsets, axis=1)
        for (i, j), free in zip(hops, clear.reshape(len(shares), -1).all(axis=0), strict=True):
            node = (count + 1, x + i, y + j)
            # the fastest stay near the line: farther away they are not looked for, which makes none of them faster
            near = abs(y + j) * cell < 3.0 and -1.0 <= (x + i) * cell <= length + 1.0
            if free and near and node not in seen:
                seen.add(node)
                heappush(queue, node)
    raise AssertionError("the goal is not reached")


FAST = {"speed": 3.0}


@pytest.mark.parametrize(
    "scenario",
    [
        scene(disc("still", (4.0, 0.2), radius=1.5), start=FAST, goal={"position": [8.0, 0.0]}),
        scene(
            disc("one", (3.0, -4.0), (0.0, 1.5), radius=1.0),
            disc("two", (5.0, 3.0), (-0.5, -1.0), radius=0.8),
            start=FAST,
            goal={"position": [8.0, 0.0]},
        ),
        pytest.param(
            scene(
                wall("gate", (4.0, 0.0), (0.0, 0.6), (1.0, 2.6)),
                start=FAST,
                goal={"position": [8.0, 0.0]},
                bounds={"min": [-1.0, -1.3], "max": [9.0, 1.3]},
            ),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["disc", "crossers", "gate"],
)
def test_the_bound_is_below_what_brute_force_finds_and_not_far_below(scenario: sp.Scenario) -> None:
    fastest = brute_force(scenario, 0.25, 0.25)
    bound = sp.lower_bound(scenario)
    assert kinematic_bound(scenario) <= bound <= fastest
    assert fastest <= bound + 3 * 0.25


# and it shows what obstacles cost


def test_without_obstacles_it_is_the_kinematic_bound() -> None:
    assert sp.lower_bound(scene()) == kinematic_bound(scene())
    assert sp.lower_bound(scene(disc("far", (10.0, 300.0)))) == pytest.approx(kinematic_bound(scene()), rel=3e-3)


def test_a_gate_that_opens_late_has_to_be_waited_for() -> None:
    """The lane is free below the gate from 5 s on; the vehicle may then be just before it, at top speed."""
    speed = 0.4
    edge = -1.0 - 5.0 * speed + 2 * 0.3  # lowest edge at time 0, so that it frees a vehicle's width at 5 s
    gate = wall("gate", (10.0, edge + 5.0), (0.0, speed), (1.0, 10.0))
    scenario = scene(gate, bounds=LANE)
    bound = sp.lower_bound(scenario)
    # between the round corner of the grown gate and its straight lower edge
    assert 5.0 + 10.5 / 3.0 - 0.1 <= bound <= 5.0 + 10.8 / 3.0
    assert bound > 1.15 * kinematic_bound(scenario)
    plan = sp.plan(scenario)
    assert plan.certified
    assert bound <= plan.travel_time <= 1.02 * bound


def test_a_convoy_that_fills_the_lane_has_to_be_waited_for() -> None:
    scenario = sp.Scenario.load(SUITE / "wait-for-a-convoy.yaml")
    plan = sp.plan(scenario)
    bound = sp.lower_bound(scenario, at_most=plan.travel_time)
    assert bound > 1.9 * kinematic_bound(scenario)
    assert bound <= plan.travel_time <= 1.005 * bound


def test_a_goal_that_is_taken_has_to_be_waited_for() -> None:
    """A disc leaves the goal behind it at a known time."""
    scenario = scene(disc("parked", (20.0, 0.0), (0.0, 0.1), radius=0.8))
    free_from = (0.8 + 0.3) / 0.1
    assert 0.98 * free_from <= sp.lower_bound(scenario) <= free_from


def test_a_long_wall_has_to_be_gone_round() -> None:
    scenario = scene(wall("wall", (10.0, 0.0), (0.0, 0.0), (0.4, 12.0)), start={"heading": None})
    # a taut string: to the corner, which is round by the vehicle's radius, along its arc, and along the top
    away = np.array([10.0 - 0.2, 6.0])
    tangent = float(np.sqrt(away @ away - 0.3**2))
    arc = float(np.arctan2(away[1], away[0]) + np.arctan2(0.3, tangent))
    shortest = 2.0 * (tangent + 0.3 * arc) + 0.4
    least = kinematic_bound(scenario) + (shortest - 20.0) / 3.0
    assert 0.97 * least <= sp.lower_bound(scenario) <= least


def test_a_known_trip_makes_it_finer_not_higher() -> None:
    scenario = scene(*CROSSERS)
    plan = sp.plan(scenario)
    bound = sp.lower_bound(scenario, at_most=plan.travel_time)
    assert kinematic_bound(scenario) <= bound <= plan.travel_time
    assert bound == pytest.approx(sp.lower_bound(scenario), rel=0.01)


def test_an_arrival_that_must_not_be_early_counts() -> None:
    scenario = scene(*CROSSERS, goal={"position": [20.0, 0.0], "earliest_arrival": 9.0})
    assert sp.lower_bound(scenario) >= 9.0


def test_it_does_not_depend_on_where_the_scene_is() -> None:
    moved = scene(
        disc("still", (1004.0, 500.2), radius=1.5),
        start={"position": [1000.0, 500.0], "time": 1e6},
        goal={"position": [1008.0, 500.0]},
    )
    here = scene(disc("still", (4.0, 0.2), radius=1.5), goal={"position": [8.0, 0.0]})
    assert sp.lower_bound(moved) == pytest.approx(sp.lower_bound(here), rel=1e-3)


# its parts


@pytest.mark.parametrize("goal_speed", [None, 0.0, 2.0])
@pytest.mark.parametrize("duration", [1.0, 6.0, 9.0])
def test_distances_driven_are_the_integral_of_the_highest_speeds(goal_speed: float | None, duration: float) -> None:
    speeds = Speeds(scene(goal={"speed": goal_speed}), duration)
    times = np.linspace(0.0, duration, 20_001)
    highest = speeds.at(times)
    driven = np.concatenate([[0.0], np.cumsum(0.5 * (highest[1:] + highest[:-1])) * times[1]])
    assert np.abs(speeds.driven(times) - driven).max() <= 1e-6
    assert highest.max() <= 3.0
    if goal_speed is not None:
        assert speeds.at(np.array([duration]))[0] <= goal_speed + 2e-3


@pytest.mark.parametrize("start_speed", [0.0, 1.0, 3.0])
def test_instants_are_a_step_apart_where_the_vehicle_is_fast(start_speed: float) -> None:
    speeds = Speeds(scene(start={"speed": start_speed}), 8.0)
    times = speeds.instants(0.3)
    assert times[0] == 0.0
    assert times[-1] >= 8.0
    assert np.diff(times).max() <= 0.25 + 1e-12
    inside = times[times < 8.0]
    assert np.diff(speeds.driven(inside)).max() <= 0.3 + 1e-6
    assert np.diff(speeds.driven(inside))[-5:] == pytest.approx(np.full(5, 0.3), abs=1e-6)


def small_grid() -> CellGrid:
    return CellGrid(np.array([-0.5, -1.0]), np.array([2.0, 1.0]), np.array([0.05, 0.2]), 16)


def corners_of(grid: CellGrid) -> np.ndarray:
    """Lower left corners of all cells, (rows, columns, 2)."""
    x = grid.origin[0] + grid.cell[0] * np.arange(grid.columns)
    y = grid.origin[1] + grid.cell[1] * np.arange(grid.rows)
    return np.stack(np.meshgrid(x, y), axis=-1)


def unpacked(grid: CellGrid, bits: int) -> np.ndarray:
    data = bits.to_bytes(grid.rows * grid.stride // 8 + 1, "little")
    flat = np.unpackbits(np.frombuffer(data, dtype=np.uint8), bitorder="little")[: grid.rows * grid.stride]
    return flat.reshape(grid.rows, grid.stride)[:, : grid.columns].astype(bool)


def test_the_start_lies_in_its_cell() -> None:
    grid = small_grid()
    ((row, column),) = np.argwhere(unpacked(grid, grid.start(grid.whole)))
    low = corners_of(grid)[row, column]
    assert np.all(low <= 0.0)
    assert np.all(low + grid.cell >= 0.0)
    assert low[0] + grid.cell[0] == pytest.approx(0.0, abs=1e-5)


def test_a_window_holds_what_the_whole_grid_holds_there() -> None:
    low, high, cell = np.array([-0.5, -1.0]), np.array([2.0, 1.0]), np.array([0.05, 0.2])
    whole, narrow = CellGrid(low, high, cell, 16), CellGrid(low, high, cell, 16, window=20)
    before, after = narrow.windows(np.array([-0.1, 0.2]), np.array([0.1, 0.5]))
    seen = whole.disc((0.7, 0.1), 0.6, whole.whole)[
        after.row : after.row + after.rows, after.column : after.column + 20
    ]
    assert np.array_equal(narrow.disc((0.7, 0.1), 0.6, after)[:, :20], seen)
    assert 0 < seen.sum() < seen.size

    moved = after.bits_after(before, narrow.stride)
    bits = narrow.reached_from(narrow.start(before), 0.31)
    bits = bits >> moved if moved >= 0 else bits << -moved
    size = (after.rows + 1) * narrow.stride
    flat = np.array([bits >> place & 1 for place in range(size)], dtype=bool)
    reached = unpacked(whole, whole.reached_from(whole.start(whole.whole), 0.31))
    there = reached[after.row : after.row + after.rows, after.column : after.column + 20]
    assert np.array_equal(flat.reshape(-1, narrow.stride)[: after.rows, :20], there)
    assert there.any()


@pytest.mark.parametrize("distance", [0.03, 0.2, 0.31, 0.7])
def test_reached_cells_are_all_those_near_enough_and_no_others(distance: float) -> None:
    grid, random = small_grid(), np.random.default_rng(0)
    mask = np.zeros((grid.rows, grid.stride), dtype=bool)
    mask[random.integers(grid.rows, size=4), random.integers(grid.columns, size=4)] = True
    inside = grid.packed(np.ones((grid.rows, grid.stride), dtype=bool))
    reached = unpacked(grid, grid.reached_from(grid.packed(mask), distance) & inside)
    index = np.stack(np.meshgrid(np.arange(grid.columns), np.arange(grid.rows)), axis=-1)
    apart = np.maximum(np.abs(index[None, None] - index[mask[:, : grid.columns]][:, None, None]) - 1, 0) * grid.cell
    nearest = np.hypot(apart[..., 0], apart[..., 1]).min(axis=(0, 1))
    assert np.all(reached[nearest <= distance - 1e-9])
    assert not np.any(reached[nearest > distance + 1e-6])
    assert widths(distance, 0.05, 0.2)[-1] == int(distance / 0.05 + 1e-9) + 1


@pytest.mark.parametrize("radius", [0.05, 0.4, 3.0])
def test_discs_touch_all_cells_that_hold_one_of_their_points(radius: float) -> None:
    grid, center = small_grid(), (0.71, 0.13)
    mask = grid.disc(center, radius, grid.whole)[:, : grid.columns]
    low = corners_of(grid)
    nearest = np.clip(center, low, low + grid.cell)
    away = np.hypot(*np.moveaxis(nearest - center, -1, 0))
    assert np.all(mask[away <= radius])
    assert not np.any(mask[away > radius + 1e-6])


def test_covered_cells_lie_wholly_in_their_polygon() -> None:
    grid, random = small_grid(), np.random.default_rng(2)
    angles = np.sort(random.uniform(0.0, 2.0 * np.pi, (30, 12)), axis=1)
    middle = random.uniform([-0.5, -1.0], [2.0, 1.0], (30, 1, 2))
    polygons = middle + np.stack([np.cos(angles), np.sin(angles)], axis=-1) * random.uniform(0.2, 1.2, (30, 1, 1))
    which, row, begin, end = grid.covered(polygons)
    covered = np.zeros((30, grid.rows, grid.columns), dtype=bool)
    for k, j, first, last in zip(which, row, begin, end, strict=True):
        covered[k, j, first:last] = True
    low = corners_of(grid)
    for k, polygon in enumerate(polygons):
        edges = np.roll(polygon, -1, axis=0) - polygon
        inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1)
        inside = np.ones(covered[k].shape, dtype=bool)
        for corner in ([0, 0], [0, 1], [1, 0], [1, 1]):
            point = low + grid.cell * corner
            inside &= np.all(np.einsum("rcvi,vi->rcv", point[:, :, None] - polygon, inward) > -1e-12, axis=2)
        assert np.array_equal(covered[k], inside)
    assert covered.any()


SHAPES: dict[str, dict[str, Any]] = {
    "disc": {"shape": {"disc": 0.6}},
    "rectangle": {"shape": {"rectangle": [3.0, 1.0]}},
    "fixed rectangle": {"shape": {"rectangle": [3.0, 1.0], "heading": 0.4}},
    "ellipse": {"shape": {"ellipse": [2.0, 0.5]}},
    "fixed ellipse": {"shape": {"ellipse": [2.0, 0.5], "heading": -0.7}},
    "pocket": {"shape": {"polygon": POCKET}},
}


@pytest.mark.parametrize("shape", SHAPES)
def test_polygons_fill_their_zones_from_inside(shape: str) -> None:
    motion = {"position": [8.0, -3.0], "velocity": [0.3, 1.2], "acceleration": [-0.15, 0.1]}
    check_polygons(scene({"id": "it", **SHAPES[shape], "motion": motion}))


@pytest.mark.parametrize("shape", [{"disc": 0.5}, {"polygon": [[-1, -1], [1, -1], [1, 1], [-1, 1]]}])
def test_polygons_fill_estimated_zones_from_inside(shape: dict[str, Any]) -> None:
    random = np.random.default_rng(3)
    times = np.linspace(-4.0, 0.0, 40)
    seen = np.stack([8.0 - 0.4 * times, -2.0 + 0.5 * times], axis=1) + 0.05 * random.normal(size=(40, 2))
    observations = {"time": times.tolist(), "position": seen.tolist(), "covariance": None}
    check_polygons(scene({"id": "it", "shape": shape, "observations": observations}))


def check_polygons(scenario: sp.Scenario) -> None:
    frame = PlanningFrame.between(scenario.start.position, scenario.goal.position, scenario.start.time)
    batch = ZoneBatch.of(sp.zones(scenario), frame, scenario.vehicle.radius)
    times = np.array([0.0, 1.3, 4.0])
    found = list(polygons_inside(batch, times, np.full(2, -50.0), np.full(2, 50.0)))
    assert len(found) == batch.size
    for part, (instants, polygons) in enumerate(found):
        assert np.array_equal(instants, np.arange(3))
        count = polygons.shape[1]
        assert count >= CORNERS
        index, when = np.full(3 * count, part), np.repeat(times, count)
        corner = batch.contacts(index, when, polygons.reshape(-1, 2)).distance
        assert np.abs(corner).max() < 1e-6  # on the border
        middle = batch.contacts(index, when, 0.5 * (polygons + np.roll(polygons, -1, axis=1)).reshape(-1, 2)).distance
        assert middle.max() < 1e-6
        assert middle.min() > -0.1  # and not much is left out
        edges = np.roll(polygons, -1, axis=1) - polygons
        after = np.roll(edges, -1, axis=1)
        assert (edges[..., 0] * after[..., 1] - edges[..., 1] * after[..., 0]).min() > -1e-9  # convex, anticlockwise


@pytest.mark.parametrize(
    ("away", "velocity", "goal_radius", "covered"),
    [
        (1.25, 0.0, 0.0, True),  # a disc of 1 m and a vehicle of 0.3 m
        (1.35, 0.0, 0.0, False),
        (0.5, 0.0, 0.75, True),
        (0.5, 0.0, 0.85, False),  # some of the goal is free
        (0.5, 1e-3, 0.0, False),  # it will be gone some day
    ],
)
def test_only_what_stands_and_covers_all_of_the_goal_does_so_for_good(
    away: float, velocity: float, goal_radius: float, covered: bool
) -> None:
    lid = disc("lid", (20.0, away), (velocity, 0.0), radius=1.0)
    scenario = scene(disc("far", (5.0, 9.0)), lid, goal={"radius": goal_radius})
    assert goal_is_covered_for_good(scenario, sp.zones(scenario)) is covered


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_it_knows_the_way_round_walls(turn: float) -> None:
    """A wall of 18 m across the line: over its corners, less what the vehicle is round."""
    wall = {"rectangle": [1.0, 18.0], "heading": turn}
    c, s = math.cos(turn), math.sin(turn)
    scenario = scene(
        {"id": "wall", "shape": wall, "motion": {"position": [10.0 * c, 10.0 * s]}},
        start={"heading": None, "speed": 3.0},
        goal={"position": [20.0 * c, 20.0 * s]},
    )
    sharp, rounded = 2.0 * math.hypot(9.5, 9.0) + 1.0, 2.0 * math.hypot(9.2, 9.3) + 1.6
    bound = sp.lower_bound(scenario)
    assert sharp / 3.0 < bound < rounded / 3.0
    plan = sp.plan(scenario)
    assert plan.certified and plan.lower_bound <= plan.travel_time < 1.03 * plan.lower_bound


def test_it_is_infinite_where_nothing_leads_through() -> None:
    sides = [
        {"id": f"{x} {y}", "shape": {"rectangle": size, "heading": 0.0}, "motion": {"position": [20.0 + x, y]}}
        for x, y, size in (
            (3.0, 0.0, [1.0, 7.0]),
            (-3.0, 0.0, [1.0, 7.0]),
            (0.0, 3.0, [7.0, 1.0]),
            (0.0, -3.0, [7.0, 1.0]),
        )
    ]
    assert sp.lower_bound(scene(*sides)) == math.inf
    assert math.isfinite(sp.lower_bound(scene(*sides[:3])))
