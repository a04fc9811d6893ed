"""What kinds of obstacles, goals and starts of CommonRoad become, in the classes of its older and newer packages."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

pytest.importorskip("shapely", reason="needs commonroad-io, which is not installed")

from shapely import Point, Polygon, box

from scp_planner.errors import ScenarioError
from scp_planner.formats.commonroad.cars import CARS
from scp_planner.formats.commonroad.goals import GoalState, ahead_of, goal_states, polygons_of
from scp_planner.formats.commonroad.obstacles import obstacles_of, touched_by
from scp_planner.formats.commonroad.roads import drivable

STEP = 0.1


class Interval(NamedTuple):
    start: float
    end: float


def placed(polygon: Any) -> SimpleNamespace:
    return SimpleNamespace(shapely_object=polygon)


def obstacles(*those: Any) -> list[dict[str, Any]]:
    return obstacles_of(SimpleNamespace(obstacles=those), STEP, "road.xml")


def problem(**state: Any) -> SimpleNamespace:
    return SimpleNamespace(
        planning_problem_id=1,
        initial_state=SimpleNamespace(time_step=10),
        goal=SimpleNamespace(state_list=[SimpleNamespace(**state)]),
    )


@pytest.mark.parametrize("center", [np.array([3.0, 4.0]), Point(3.0, 4.0)])
def test_discs_are_polygons_inside_of_them(center: Any) -> None:
    (polygon,) = polygons_of(SimpleNamespace(radius=2.0, center=center))
    assert polygon.within(Point(3.0, 4.0).buffer(2.0 + 1e-9, quad_segs=64))
    assert polygon.area > 0.98 * math.pi * 4.0


def test_sets_are_courses_of_their_middles() -> None:
    """As a list of sets with their times, and as a mapping from times, in any order."""
    sets = {Interval(4, 6): placed(box(4.0, -1.0, 8.0, 1.0)), 1: placed(box(0.0, -1.0, 4.0, 1.0))}
    listed = [SimpleNamespace(time_step=time, shape=shape) for time, shape in sets.items()]
    found = obstacles(
        SimpleNamespace(obstacle_id=5, initial_state=None, prediction=SimpleNamespace(occupancies=sets)),
        SimpleNamespace(obstacle_id=5, initial_state=None, prediction=SimpleNamespace(occupancy_set=listed)),
    )
    assert found[0] == found[1]
    assert found[0]["motion"]["time"] == pytest.approx([0.1, 0.5])
    np.testing.assert_allclose(found[0]["motion"]["position"], [[2.0, 0.0], [6.0, 0.0]])
    assert Polygon(found[0]["shape"]["polygon"]).equals(box(-2.0, -1.0, 2.0, 1.0))


def test_buildings_stand_and_phantoms_are_where_they_are_predicted() -> None:
    house = placed(box(10.0, 5.0, 14.0, 9.0))
    newer, older = SimpleNamespace(obstacle_id=1, occupancy=house), SimpleNamespace(obstacle_id=1, obstacle_shape=house)
    phantom = SimpleNamespace(obstacle_id=2, prediction=SimpleNamespace(occupancies={3: house}))
    unseen = SimpleNamespace(obstacle_id=3, prediction=None)
    one, other, seen = obstacles(newer, older, phantom, unseen)
    assert one == other
    assert one["motion"] == {"position": [12.0, 7.0]}
    assert Polygon(one["shape"]["polygon"]).equals(box(-2.0, -2.0, 2.0, 2.0))
    assert (seen["id"], seen["motion"]) == ("2", {"position": [12.0, 7.0]})
    with pytest.raises(ScenarioError, match="a trajectory or sets"):
        obstacles(SimpleNamespace(obstacle_id=4, initial_state=None, prediction=SimpleNamespace(occupancies={})))


def test_of_a_goal_that_holds_the_start_there_is_what_lies_ahead() -> None:
    lane, elsewhere = box(0.0, -2.0, 40.0, 2.0), box(60.0, -2.0, 70.0, 2.0)
    state = GoalState((lane, elsewhere), None, None, None, None)
    forth = ahead_of(state, (10.0, 0.0), 0.0, 1.0)
    assert forth.places[0].equals(box(11.0, -2.0, 40.0, 2.0))
    assert forth.places[1] is elsewhere
    assert (
        ahead_of(state, (10.0, 0.0), math.pi, 1.0).places[0].symmetric_difference(box(0.0, -2.0, 9.0, 2.0)).area < 1e-9
    )
    alone = GoalState((lane,), None, None, None, None)
    assert ahead_of(alone, (39.5, 0.0), 0.0, 1.0) is alone  # nothing is left of it
    assert ahead_of(alone, (50.0, 0.0), 0.0, 1.0) == alone


def test_goals_that_nobody_gets_to_are_refused() -> None:
    (kept,) = goal_states(problem(time_step=Interval(11, 20), velocity=Interval(-1.0, 3.0)), STEP, "road.xml").values()
    assert kept.latest == pytest.approx(2.0)
    assert kept.speed == (0.0, 3.0)
    with pytest.raises(ScenarioError, match=r"goalState\[0\].time = 10.0: must end after the start, at step 10"):
        goal_states(problem(time_step=Interval(5, 10)), STEP, "road.xml")
    with pytest.raises(ScenarioError, match="must not be backwards"):
        goal_states(problem(time_step=Interval(11, 20), velocity=Interval(-3.0, -1.0)), STEP, "road.xml")


def lane_of(length: float) -> SimpleNamespace:
    """A straight lane along the x axis, 4 m wide."""
    left, right = (np.array([[0.0, y], [length, y]]) for y in (2.0, -2.0))
    return SimpleNamespace(lanelet_id=1, left_vertices=left, right_vertices=right, adj_left=None, adj_right=None)


def test_a_road_around_one_point() -> None:
    """Of a guide that ends where it begins."""
    lane = lane_of(100.0)
    area = drivable(SimpleNamespace(lanelets=[lane]), np.array([[50.0, 0.0]]), 10.0, 1.8, 0.1)
    assert area.centroid.x == pytest.approx(50.0, abs=0.5)
    assert area.bounds[2] - area.bounds[0] == pytest.approx(20.0, rel=0.05)


@pytest.mark.parametrize("as_shape", [True, False])
def test_a_car_that_touches_something_where_it_starts_is_told_what(as_shape: bool) -> None:
    car = CARS["BMW_320i"]
    half = 0.5 * car.width
    lane = lane_of(40.0)
    seen = placed(box(20.0, -2.0, 24.0, 0.0))
    occupancy = SimpleNamespace(shape=seen) if as_shape else seen
    parked = SimpleNamespace(obstacle_id=7, occupancy_at_time=lambda step: occupancy if step == 3 else None)
    world = SimpleNamespace(obstacles=[parked], lanelet_network=SimpleNamespace(lanelets=[lane]))

    def told(x: float, y: float, time_step: int = 3) -> str | None:
        return touched_by((x, y), 0.0, car, world, time_step)

    assert told(10.0, 0.0) is None
    assert told(10.0, 2.0 - half - 1e-6) is None
    assert told(10.0, 2.0 - half + 0.05) == "reaches 0.05 m beyond the border of the road"
    assert told(10.0, 9.0) == "stands beside the road"
    assert told(19.0, 0.0) == "meets obstacle 7"
    assert told(19.0, 0.0, 4) is None
    assert told(19.0, half + 1e-3) is None
    world.lanelet_network.lanelets = []
    assert told(10.0, 9.0) is None
