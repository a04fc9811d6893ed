"""Search for manoeuvres: its memory, its budget, and the room that it keeps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from memory import MEGABYTE, traced

import scp_planner as sp
from scp_planner.pauses import Budget, OutOfTimeError
from scp_planner.planning.sources.gears import LegPlans
from scp_planner.routes.manoeuvres import ManoeuvreSearch

CAR = {
    "radius": 0.3,
    "max_speed": 3.0,
    "max_acceleration": 1.5,
    "max_deceleration": 2.0,
    "max_curvature": 1.0,
    "reverse": {"max_speed": 1.5},
}


def search_to(place: tuple[float, float], budget: Budget | None = None, **scene: Any) -> ManoeuvreSearch:
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}
    goal = {"position": place, "heading": 0.0, "speed": 0.0}
    scenario = sp.Scenario(vehicle=CAR, start=start, goal=goal, **scene)
    legs = LegPlans(scenario, lambda skeleton, *_: sp.plan(skeleton.scenario), sp.zones(scenario), Budget())
    return ManoeuvreSearch(legs.inside, legs.batch, legs.curvature, budget)


@pytest.mark.parametrize("far", [10.0, 400.0])
def test_a_search_takes_no_more_memory_for_a_goal_that_is_farther_away(far: float) -> None:
    found, peak = traced(lambda: search_to((far, far)).run())
    assert found and found[0].kind == (1,)
    assert peak < 60 * MEGABYTE


def test_a_way_past_walls_is_clear_only_if_all_of_it_is() -> None:
    beside = [[50.0, -5.0], [50.2, -5.0], [50.2, -0.4], [50.0, -0.4]]
    across = [[90.0, -5.0], [90.2, -5.0], [90.2, 0.1], [90.0, 0.1]]
    assert search_to((100.0, 0.0), walls=[beside]).run()[0].lengths.sum() == pytest.approx(20.0, rel=1e-6)
    found = search_to((100.0, 0.0), walls=[beside, across]).run()
    assert found and np.abs(found[0].lengths).sum() > 20.0 * (1.0 + 1e-6)


def test_the_room_is_the_distance_to_walls() -> None:
    wall = [[2.0, -1.0], [3.0, -1.0], [3.0, 1.0], [2.0, 1.0]]
    search = search_to((6.0, 0.0), walls=[wall])
    unit = 6.0 / 20.0
    places = np.random.default_rng(3).uniform([-2.0, -3.0], [8.0, 3.0], (500, 2)) / unit
    found = search.room.exact(np.column_stack([places, np.zeros(500)])) * unit
    apart = shapely.distance(shapely.points(places * unit), shapely.Polygon(wall)) - 0.3
    near = (apart > 0.0) & (found < 0.9 * found.max())
    np.testing.assert_allclose(found[near], apart[near], atol=2e-3)


def test_a_search_ends_with_its_budget_and_a_vehicle_at_its_goal_needs_none() -> None:
    with pytest.raises(OutOfTimeError):
        search_to((5.0, 0.0), Budget(deadline=-1.0)).run()
    assert all(len(each.lengths) for each in search_to((3e-9, 0.0)).run())
