"""Driving over a map: what is driven, and each stop that is promised, keeps clear of the cells of that moment."""

from __future__ import annotations

import copy
import pickle
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from replanning import begun_since, threads, threads_end
from shapely import MultiPoint, box, unary_union

import scp_planner as sp
from benchmarks.maps import scene

RADIUS, CELL = 0.3, 0.1
START, GOAL = (1.0, 4.0), (7.0, 1.5)
Cells = np.ndarray[Any, np.dtype[np.bool_]]


def room(*doors: int) -> Cells:
    """Eight by six metres with a wall across that has doors, 1.2 m wide."""
    cells = np.zeros((60, 80), dtype=bool)
    cells[:, 38:42] = True
    for low in doors:
        cells[low : low + 12, 38:42] = False
    return cells


@lru_cache
def squares(cells: bytes) -> Any:
    """The occupied cells of a room, and what lies beyond it."""
    rows, columns = np.nonzero(np.frombuffer(cells, dtype=bool).reshape(60, 80))
    found = [box(x, y, x + CELL, y + CELL) for x, y in zip(CELL * columns, CELL * rows, strict=True)]
    return unary_union([*found, box(-9.0, -9.0, 17.0, 15.0) - box(0.0, 0.0, 8.0, 6.0)])


def apart(cells: Cells, places: Any) -> float:
    """Distance that the vehicle keeps from occupied cells, and from what lies beyond the map, m."""
    return float(squares(cells.tobytes()).distance(MultiPoint(np.asarray(places)))) - RADIUS


class Drive:
    """A vehicle that follows its plans, each of which is looked at."""

    def __init__(self, cells: Cells, deadline: float | None = None, **fields: Any) -> None:
        vehicle = {"radius": RADIUS, "max_speed": 2.0, "max_acceleration": 1.5, "max_deceleration": 2.0}
        scenario = sp.Scenario(
            vehicle={**vehicle, "max_curvature": 2.0},
            start={"time": 0.0, "position": START, "speed": 0.0},
            goal={"position": GOAL, "speed": 0.0},
            obstacles=[],
            ground={"map": sp.OccupancyMap(cells, CELL)},
            **fields,
        )
        self.planner = sp.Planner(scenario, online=sp.OnlineSettings(period=0.11))
        self.cells, self.deadline = cells, deadline
        self.time, self.position, self.speed = 0.0, np.array(START), 0.0
        self.heading: float | None = None

    def update(self, cells: Cells) -> None:
        self.planner.update_map(sp.OccupancyMap(cells, CELL))
        self.cells = cells

    def on(self, until: float) -> list[sp.OnlinePlan]:
        plans: list[sp.OnlinePlan] = []
        while self.time < until - 1e-9:
            plan = self.planner.replan(self.time, self.position, self.heading, self.speed, deadline=self.deadline)
            plans.append(plan)
            if plan.safe:
                trip = plan.trip if plan.stop is None else plan.stop
                times = np.linspace(self.time, trip.frame.time + trip.trajectory.travel_time, 60)
                assert apart(self.cells, trip.frame.to_world(trip.positions_at(times))) > -1e-6
            if plan.arrived:
                break
            after = round(self.time + 0.1, 6)
            if plan.safe:
                assert apart(self.cells, plan.position(np.linspace(self.time, after, 20))) > -1e-6
            self.time, ends = after, plan.arrival_time <= after
            self.position, self.heading = plan.position(self.time), float(plan.heading(self.time))
            self.speed = 0.0 if ends else float(plan.speed(self.time))
        return plans


def test_as_fast_as_the_trip_that_is_planned_offline() -> None:
    drive = Drive(room(5))
    offline = sp.plan(drive.planner.scenario)
    plans = drive.on(20.0)
    assert plans[-1].arrived and all(plan.safe for plan in plans)
    assert drive.time < 1.05 * offline.travel_time + 0.1


def test_people_cross_a_room() -> None:
    scenario = Drive(room(5, 43)).planner.scenario
    walkers = [
        {
            "id": f"w{k}",
            "shape": {"disc": 0.3},
            "motion": {"position": [5.0 + k, 1.0], "velocity": [0.0, 0.3 * k - 0.1]},
        }
        for k in range(2)
    ]
    run = sp.simulate(sp.Scenario(**{**dict(scenario), "obstacles": walkers}), seed=1, rate=8.0, time_limit=20.0)
    assert run.arrived and not run.contact
    assert apart(room(5, 43), run.position) > -1e-6


def test_a_door_that_shuts_and_opens() -> None:
    drive = Drive(room(5, 43))
    assert all(plan.safe for plan in drive.on(1.5))
    drive.update(room(43))
    plans = drive.on(2.0)
    assert all(plan.safe for plan in plans)
    drive.update(room())
    plans = drive.on(6.0)
    assert all(plan.safe for plan in plans) and drive.speed == 0.0
    assert plans[-1].code is sp.ReasonCode.BLOCKED and "No way over the map" in (plans[-1].reason or "")
    drive.update(room(5))
    plans = drive.on(20.0)
    assert plans[-1].arrived and all(plan.safe for plan in plans)


@pytest.mark.parametrize("deadline", [None, 0.02])
def test_another_goal_on_the_way(deadline: float | None) -> None:
    drive = Drive(room(5, 43), deadline)
    drive.on(3.0)
    drive.planner.set_goal({"position": [1.0, 1.0], "speed": 0.0})
    drive.planner = pickle.loads(pickle.dumps(copy.copy(drive.planner)))
    plans = drive.on(30.0)
    assert plans[-1].arrived and all(plan.safe for plan in plans)
    assert drive.position == pytest.approx([1.0, 1.0], abs=0.3)


def test_goals_in_turn_behind_the_vehicle() -> None:
    """It stands with its nose at a wall, cannot back up, and the door is behind it."""
    drive = Drive(room(5))
    for place in ((7.2, 4.5), (0.9, 4.8), (7.3, 1.0)):
        drive.planner.set_goal({"position": place, "speed": 0.0})
        plans = drive.on(drive.time + 25.0)
        assert plans[-1].arrived and all(plan.safe for plan in plans)
        assert drive.position == pytest.approx(place, abs=0.3)


def test_the_vehicle_and_the_goal_on_occupied_cells() -> None:
    drive = Drive(room(5))
    drive.on(1.0)
    cells = room(5)
    cells[10:20, 60:75] = True  # the goal
    drive.update(cells)
    plans = drive.on(4.0)
    assert all(plan.safe for plan in plans) and drive.speed == 0.0
    assert "goal is on occupied cells" in (plans[-1].reason or "")
    with pytest.raises(sp.ScenarioError, match=r"goal.position.*from occupied cells"):
        drive.planner.set_goal({"position": [6.5, 1.5]})
    drive.planner.set_limits(max_speed=1.0)
    drive.update(np.ones_like(cells))
    plan = drive.on(4.1)[-1]
    assert not plan.safe and plan.obstacle == "map"
    assert "on occupied cells" in drive.planner.doubts[-1]
    drive.update(room(5))
    assert drive.on(20.0)[-1].arrived


def test_a_map_that_cannot_be(tmp_path: Path) -> None:
    planner = Drive(room(5)).planner
    for wrong, told in ((3, "map"), (tmp_path / "missing.yaml", "can be read"), ({"maps": 1}, "maps")):
        with pytest.raises(sp.ScenarioError, match=told):
            planner.update_map(wrong)  # type: ignore[arg-type]
    sp.save_map(sp.OccupancyMap(room(43), CELL), tmp_path / "map.yaml")
    planner.update_map(tmp_path / "map.yaml")
    assert planner.scenario.ground is not None
    assert planner.scenario.ground.map == sp.OccupancyMap(room(43), CELL)
    lane = sp.Planner(
        sp.Scenario(
            vehicle={"radius": RADIUS, "max_speed": 2.0, "max_acceleration": 1.5, "max_deceleration": 2.0},
            start={"time": 0.0, "position": START, "speed": 0.0},
            goal={"position": (7.0, 4.0)},
            corridor=[[[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]]],
        )
    )
    with pytest.raises(sp.ScenarioError, match="corridor"):
        lane.update_map(sp.OccupancyMap(room(5), CELL))


def test_a_vehicle_that_creeps_where_it_stands_finds_a_route() -> None:
    drive = Drive(room(20))
    for number in range(400):
        time, creep = 0.1 * number, 1e-5 * number
        plan = drive.planner.replan(time, (START[0] + creep, START[1]), 0.0, 1e-4, deadline=1e-3)
        if plan.code is not sp.ReasonCode.OUT_OF_TIME:
            break
    assert plan.safe and plan.code is not sp.ReasonCode.OUT_OF_TIME, plan.reason


@pytest.mark.parametrize("times", [1, 12])  # while a route is looked for, and a way along it
def test_searches_end_with_their_planner(times: int) -> None:
    before = threads()
    drive, under_way = Drive(room(20)), False
    for goal in (GOAL, (7.0, 3.0)):  # another goal: another search
        drive.planner.set_goal({"position": goal})
        for _ in range(times):
            drive.planner.replan(0.0, START, 0.0, 0.0, deadline=1e-3)
            under_way |= bool(begun_since(before))
    assert under_way
    del drive
    assert threads_end(before)


def test_sets_out_on_any_way_through_the_ground_where_that_along_the_route_is_too_tight() -> None:
    """It begins with a turn about that the route leaves no room for, as a trip that is planned at once finds."""
    made = scene("blobs", 4, moving=False)
    assert made is not None
    scenario, _, _ = made
    (x, y), (goal_x, goal_y) = scenario.start.position, scenario.goal.position
    plan = sp.Planner(scenario).replan(0.0, (x, y), float(np.arctan2(goal_y - y, goal_x - x)), 0.0)
    assert plan.safe
    assert plan.code is sp.ReasonCode.DRIVING


def test_a_search_goes_on_in_each_replan_in_which_there_is_time_for_nothing_else() -> None:
    """It takes the time that is left, so what it took before does not say whether there is enough for it."""
    cells = np.zeros((50, 60), dtype=bool)
    cells[[0, -1]] = cells[:, [0, -1]] = True
    cells[8:10, 18:35] = cells[8:13, 27:30] = cells[12:18, 35:41] = cells[32:38, 7:13] = True
    robot = {"radius": 0.2, "max_speed": 1.5, "max_acceleration": 1.0, "max_deceleration": 1.5}
    place, heading = (1.74, 2.34), -2.938
    start = {"time": 0.0, "position": place, "heading": heading, "speed": 0.0}
    ground, goal = {"map": sp.OccupancyMap(cells, resolution=0.1)}, {"position": [5.24, 0.89]}
    planner = sp.Planner(
        sp.Scenario(vehicle={**robot, "max_lateral_acceleration": 1.0}, start=start, goal=goal, ground=ground)
    )
    idle, deadline = 0, 0.05
    for stood in range(140):
        plan = planner.replan(0.1 * stood, place, heading, 0.0, deadline=deadline)
        if plan.outcome is not sp.Outcome.BRAKING:
            break
        idle += sum(plan.timings.values()) < 0.2 * deadline
    assert idle <= max(stood, 4) / 2


def test_a_trap_on_a_map_is_driven_round_though_there_is_never_time() -> None:
    cells = np.zeros((60, 100), dtype=bool)
    cells[10:50, 60:63] = cells[10:13, 30:60] = cells[47:50, 30:60] = True
    scenario = sp.Scenario(
        vehicle={
            "radius": RADIUS,
            "max_speed": 2.0,
            "max_acceleration": 1.5,
            "max_deceleration": 2.0,
            "max_curvature": 2.0,
        },
        start={"time": 0.0, "position": (5.0, 3.0), "heading": 0.0, "speed": 0.0},
        goal={"position": (8.5, 3.0), "speed": 0.0},
        obstacles=[],
        ground={"map": sp.OccupancyMap(cells, CELL)},
    )
    run = sp.simulate(scenario, deadline=1e-9, time_limit=30.0)
    assert run.arrived
    plans = [plan for plan in run.plans if isinstance(plan, sp.OnlinePlan)]
    assert plans
    assert all(plan.safe for plan in plans)


@pytest.mark.parametrize("made", ["array", "map", "ground"])
def test_cells_that_were_changed_in_place_are_another_map(made: str) -> None:
    """A map shared the array of its caller: handed over again after a change, it equalled the planner's own."""
    cells = room(5, 40)
    drive = Drive(cells)
    ground = drive.planner.scenario.ground
    assert ground is not None
    own, again = sp.OccupancyMap(cells, CELL), sp.Ground(map=sp.OccupancyMap(cells, CELL))
    drive.planner.update_map(own if made == "map" else again)
    drive.on(0.3)
    digest = own.sha256
    for array in (cells, own.occupied, again.map.occupied):
        array[:, 38:42] = True
    assert own.sha256 != digest
    kinds: dict[str, Any] = {"array": sp.OccupancyMap(cells, CELL), "map": own, "ground": again}
    drive.planner.update_map(kinds[made])
    drive.cells = cells
    (plan,) = drive.on(drive.time + 0.05)
    assert plan.safe and not plan.certified
