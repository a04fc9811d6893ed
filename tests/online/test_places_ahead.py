"""Places to pass while driving, of which some move or the order is free: simulations against the true positions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from replanning import begin, follow
from scenes import disc

import scp_planner as sp

pytestmark = pytest.mark.numerics

VEHICLE = {
    "radius": 0.3,
    "max_speed": 2.0,
    "max_acceleration": 1.0,
    "max_deceleration": 1.5,
    "max_lateral_acceleration": 2.0,
}


BOATS = [
    disc("ann", (6.0, 3.0), (0.1, -0.4), radius=0.3),
    disc("bob", (12.0, -2.0), (-0.3, 0.2), radius=0.3),
    disc("cem", (9.0, 5.0), (0.0, -0.3), radius=0.3),
]


def scene(goals: list[dict[str, Any]], obstacles: list[dict[str, Any]] = BOATS, **more: Any) -> sp.Scenario:
    return sp.Scenario(
        vehicle=VEHICLE,
        start={"time": 0.0, "position": (0.0, 0.0), "speed": 0.0},
        goal={"position": (16.0, 0.0)},
        goals=goals,
        obstacles=obstacles,
        **more,
    )


def first_within(run: sp.Run, name: str, radius: float) -> int:
    """Number of the first instant that was written down at which the vehicle is so near to a boat; -1: never."""
    near = np.hypot(*(run.position - run.obstacles[name]).T) <= radius
    return int(np.argmax(near)) if near.any() else -1


@pytest.mark.parametrize("seed", [0, 1])
def test_two_boats_are_met_in_their_order_and_the_third_is_kept_clear_of(seed: int) -> None:
    asked = scene([{"target": "ann", "radius": 0.5}, {"target": "bob", "radius": 0.5}])
    run = sp.simulate(asked, noise=0.05, rate=10.0, seed=seed)
    met = [first_within(run, name, 0.5) for name in ("ann", "bob")]
    assert run.arrived and not run.contact and 0 < met[0] < met[1]
    assert run.travel_time < 1.25 * sp.plan(asked).travel_time
    assert np.hypot(*(run.position - run.obstacles["cem"]).T).min() > 0.6


def test_the_fastest_order_of_places_is_driven_whatever_the_list_says() -> None:
    places = [{"position": (12.0, -2.0)}, {"position": (4.0, 1.5)}, {"position": (8.0, 3.0)}]
    first, other = (
        sp.simulate(scene(some, [], goals_order="fastest"), noise=0.0, rate=10.0).travel_time
        for some in (places, places[::-1])
    )
    given = sp.simulate(scene(places, []), noise=0.0, rate=10.0).travel_time
    assert first == pytest.approx(other, rel=1e-6)
    assert first < 0.7 * given


@pytest.mark.parametrize("kind", ["places", "target", "target on the way"])
def test_a_wall_on_the_way_is_driven_round(kind: str) -> None:
    """Once the vehicle has come no nearer for a while; until then it stands before it."""
    ann = disc("ann", (10.0, -1.0), (0.0, 0.25), radius=0.3)
    wall = [(5.0, -6.0), (5.3, -6.0), (5.3, 6.0), (5.0, 6.0)]
    goals: dict[str, list[dict[str, Any]]] = {
        "places": [{"position": (8.0, 1.0)}],
        "target": [],
        "target on the way": [{"target": "ann", "radius": 0.5}],
    }
    obstacles = [] if kind == "places" else [ann]
    asked = scene(goals[kind], obstacles, walls=[wall])
    if kind == "target":
        asked = sp.Scenario(**{**asked.to_dict(), "goal": {"target": "ann", "radius": 0.5}})
    run = sp.simulate(asked, noise=0.05, rate=10.0, seed=1)
    assert run.arrived and all(one.safe for one in run.records)
    assert run.travel_time < 2.5 * sp.plan(asked).travel_time


def test_a_target_that_is_not_seen_is_waited_for() -> None:
    planner = sp.Planner(scene([{"target": "ann", "radius": 0.5}], BOATS[:1]))
    before = begin(planner, planner.scenario)
    planner.remove_obstacle("ann")
    lost = follow(planner, 0.1)
    assert before.certified
    assert lost.safe and lost.code == "blocked" and "not seen" in str(lost.reason)


def test_targets_on_the_way_can_be_given_while_driving() -> None:
    """With limits that change besides, the places that are left stay."""
    planner = sp.Planner(scene([], BOATS))
    begin(planner, planner.scenario)
    planner.set_goal({"position": (16.0, 0.0)}, goals=[{"target": "ann", "radius": 0.5}, {"position": (12.0, 1.0)}])
    planner.set_limits(max_speed=1.5)
    for now in np.arange(1, 11) / 10.0:
        plan = follow(planner, float(now))
    assert plan.certified and len(planner.given.goals) == 2
    there = np.linspace(1.0, plan.arrival_time, 2000)
    ann = np.array(BOATS[0]["motion"]["position"]) + there[:, None] * BOATS[0]["motion"]["velocity"]
    assert np.hypot(*(plan.position(there) - ann).T).min() < 0.5
    with pytest.raises(ValueError, match="nobody"):
        planner.set_goal({"position": (16.0, 0.0)}, goals=[{"target": "nobody"}])
