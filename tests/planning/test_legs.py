"""Trips of several legs: parking, turning round, turning on the spot; their certificate, and their files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from math import pi
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pytest
import shapely

import scp_planner as sp
from scp_planner.pauses import Budget
from scp_planner.planning.plan import PlanStatus
from scp_planner.planning.plan_search import plan_of_legs
from scp_planner.planning.sources.gears import LegPlans
from scp_planner.routes.manoeuvres import ManoeuvreSearch
from scp_planner.trips.legs import Leg, Legs, Stand

CAR = {
    "radius": 0.95,
    "discs": [0.0, 1.3, 2.6],
    "max_speed": 3.0,
    "max_acceleration": 1.5,
    "max_deceleration": 2.0,
    "max_curvature": 0.2,
    "max_lateral_acceleration": 2.0,
    "reverse": {"max_speed": 1.5, "max_acceleration": 1.0},
}
ROBOT = {"radius": 0.3, "max_speed": 1.0, "max_acceleration": 1.0, "max_deceleration": 1.0}


def box(left: float, low: float, right: float, high: float) -> list[list[float]]:
    return [[left, low], [right, low], [right, high], [left, high]]


@cache
def parking(walker: bool = False) -> sp.Scenario:
    walks = {"id": "walker", "shape": {"disc": 0.3}, "motion": {"position": [0.5, 5.5], "velocity": [0.0, -1.0]}}
    return sp.Scenario(
        name="parking",
        vehicle=CAR,
        start={"time": 5.0, "position": [6.0, 2.6], "heading": 0.0, "speed": 0.0},
        goal={"position": [0.3, 0.0], "heading": 0.0, "speed": 0.0},
        walls=[box(-8, -1, -1.25, 1), box(5, -1, 12, 1), box(-8, -2.2, 16, -1.2)],
        bounds={"min": [-10, -3], "max": [18, 7]},
        obstacles=[walks] if walker else [],
    )


@cache
def parked(walker: bool = False) -> sp.Plan:
    return sp.plan(parking(walker))


def check_densely(scenario: sp.Scenario, plan: sp.Plan) -> None:
    """Check a plan at many times, by differences and with another library, as its certificate says it is."""
    times = np.linspace(plan.start_time, plan.arrival_time, 4001)
    step = times[1] - times[0]
    place, heading, speed, back = plan.position(times), plan.heading(times), plan.speed(times), plan.backward(times)
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    assert plan.velocity(times) == pytest.approx(np.where(back, -speed, speed)[:, None] * ahead, abs=1e-9)
    assert np.diff(place, axis=0) / step == pytest.approx(plan.velocity(times[:-1] + 0.5 * step), abs=2e-3)
    turned = np.diff(np.unwrap(heading)) / step
    assert turned == pytest.approx((plan.speed(times) * plan.curvature(times))[:-1], abs=0.02)
    vehicle = scenario.vehicle
    assert vehicle.reverse is not None
    assert speed[~back].max() <= vehicle.max_speed * (1 + 1e-9)
    assert speed[back].max() <= vehicle.reverse.max_speed * (1 + 1e-9)
    gained = plan.acceleration(times)
    assert gained[back].max() <= (vehicle.reverse.max_acceleration or 0.0) * (1 + 1e-9)
    assert gained.min() >= -vehicle.max_deceleration * (1 + 1e-9)
    assert place[-1] == pytest.approx(scenario.goal.position, abs=1e-5)
    assert np.cos(heading[-1] - scenario.goal.heading) == pytest.approx(1.0)
    walls = shapely.MultiPolygon([shapely.Polygon(wall) for wall in scenario.walls])
    for offset in vehicle.discs:
        centres = place + offset * ahead
        assert shapely.distance(shapely.points(centres), walls).min() >= vehicle.radius - 1e-9
        for zone in sp.zones(scenario):
            assert zone.signed_distance(times, centres).min() >= vehicle.radius - 1e-6


@pytest.mark.parametrize("walker", [False, True])
def test_a_car_parks_backwards(walker: bool) -> None:
    plan = parked(walker)
    assert plan.certified
    assert plan.legs is not None
    assert {leg.backward for leg in plan.legs.legs} == {True, False}
    assert plan.travel_time < (6.95 if not walker else 12.0)
    check_densely(parking(walker), plan)


def test_a_plan_of_legs_is_read_as_it_was_saved(tmp_path: Path) -> None:
    plan, scenario = parked(), parking()
    plan.save(tmp_path / "plan.json")
    read = sp.Plan.load(tmp_path / "plan.json")
    times = np.linspace(4.0, 15.0, 50)
    for name in ("position", "velocity", "heading", "speed", "acceleration", "curvature", "backward"):
        assert getattr(read, name)(times) == pytest.approx(getattr(plan, name)(times), abs=1e-9)
    assert (read.status, read.travel_time) == ("unverified", plan.travel_time)
    assert read.verified(scenario).certified
    assert sp.certify(scenario, read).holds
    plan.draw(scenario, tmp_path / "plan.html")
    data = json.loads((tmp_path / "plan.json").read_text())
    data["legs"][1]["start_time"] -= 1.0
    with pytest.raises(sp.PlanError, match=r"legs\[1\]\.start_time"):
        sp.Plan.from_dict(data, "plan.json")


def slower(vehicle: dict[str, Any]) -> sp.Scenario:
    return parking().model_copy(update={"vehicle": sp.Vehicle(**{**CAR, **vehicle})})


def shifted(legs: Legs) -> Legs:
    """The second leg begins beside the end of the first one."""
    first, second = legs.legs
    frame = replace(second.trip.frame, origin=(second.trip.frame.origin[0] + 0.01, second.trip.frame.origin[1]))
    return replace(legs, legs=(first, Leg(replace(second.trip, frame=frame), second.backward)))


@pytest.mark.parametrize(
    ("what", "scenario", "change"),
    [
        ("speed", slower({"reverse": {"max_speed": 1.4}}), lambda legs: legs),
        ("acceleration", slower({"reverse": {"max_speed": 1.5, "max_acceleration": 0.9}}), lambda legs: legs),
        ("speed", slower({"reverse": None}), lambda legs: legs),
        ("curvature", slower({"max_curvature": 0.19}), lambda legs: legs),
        ("clearance", slower({"discs": [0.0, -1.3, -2.6]}), lambda legs: legs),
        ("gap between legs", parking(), shifted),
        ("turn while standing", parking(), lambda legs: replace(legs, legs=(replace(legs.legs[0], backward=False),))),
        ("turn while standing", parking(), lambda legs: replace(legs, last=Stand(legs.last.time + 9.0, 0.3))),
        ("goal heading", parking(), lambda legs: replace(legs, last=Stand(legs.last.time + 9.0, 0.3))),
        ("start time", parking(), lambda legs: replace(legs, first=Stand(4.0, 0.0))),
        ("distance from the goal", parking(), lambda legs: replace(legs, legs=legs.legs[:1])),
    ],
)
def test_the_certificate_finds(what: str, scenario: sp.Scenario, change: Callable[[Legs], Legs]) -> None:
    plan = parked()
    assert plan.legs is not None
    found = sp.certify(scenario, replace(plan, legs=change(plan.legs)))
    assert not found.holds
    assert what in {violation.what for violation in found.violations}


def test_where_it_stands_it_keeps_clear() -> None:
    """A wait before the first leg, which somebody walks through."""
    scenario = parking(walker=True)
    plan = parked()
    assert plan.legs is not None
    begin = scenario.start.time + 20.0
    later = [replace(leg.trip, frame=replace(leg.trip.frame, time=leg.begin + 20.0)) for leg in plan.legs.legs]
    legs = tuple(Leg(trip, leg.backward) for trip, leg in zip(later, plan.legs.legs, strict=True))
    waits = replace(plan, legs=Legs(legs, plan.legs.first, Stand(plan.arrival_time + 20.0, 0.0)))
    assert sp.certify(scenario, waits).holds
    assert waits.speed(begin - 1.0) == pytest.approx(0.0)
    runs_over = {"id": "walker", "shape": {"disc": 0.3}, "motion": {"position": [7.0, 7.0], "velocity": [0.0, -1.0]}}
    met = sp.certify(scenario.model_copy(update={"obstacles": (sp.Obstacle(**runs_over),)}), waits)
    assert "walker" in {violation.obstacle for violation in met.violations if violation.time < begin - 10.0}


def test_a_robot_turns_on_the_spot() -> None:
    robot = {**ROBOT, "max_curvature": 1.0, "steering": "on_the_spot", "max_turn_rate": 0.8}
    scene = {
        "start": {"time": 0.0, "position": [0, 0], "heading": 0.0, "speed": 0.0},
        "goal": {"position": [-5, 0], "heading": pi / 2, "speed": 0.0},
        "walls": [box(0.5, -2, 1, 2)],
    }
    scenario = sp.Scenario(vehicle=robot, **scene)
    plan = sp.plan(scenario)
    assert plan.certified
    assert plan.legs is not None
    # It need not turn on the spot all of the time that half a turn, 5 m with both ramps, and a quarter of a turn take
    assert pi / 0.8 + 5.0 < plan.travel_time < pi / 0.8 + 6.0 + pi / 2 / 0.8
    times = np.linspace(0.0, plan.legs.legs[0].begin, 201)
    assert np.abs(np.diff(np.unwrap(plan.heading(times)))).max() <= 0.8 * (times[1] - times[0]) * (1 + 1e-6)
    assert not sp.certify(
        scenario.model_copy(update={"vehicle": sp.Vehicle(**{**robot, "max_turn_rate": 0.7})}), plan
    ).holds


def test_a_leg_waits_only_for_what_is_in_its_way() -> None:
    robot = {**ROBOT, "max_curvature": 2.0, "reverse": {"max_speed": 1.0}}
    start = {"time": 0.0, "position": [0, 0], "heading": 0.0, "speed": 0.0}
    far = {"id": "far", "shape": {"disc": 0.3}, "motion": {"position": [20, 20], "velocity": [0.1, 0]}}
    goal = {"position": [-0.1, 1.3], "heading": 1.8}
    scenario = sp.Scenario(vehicle=robot, start=start, goal=goal, obstacles=[far])
    begins = set[float]()

    def too_tight(scene: sp.Scenario, left: float | None, thorough: bool) -> sp.Plan:
        begins.add(scene.start.time)
        return replace(sp.plan(scene), status=PlanStatus.INFEASIBLE)

    plan_of_legs(scenario, too_tight, sp.zones(scenario))
    assert begins == {0.0}


def test_a_leg_is_held_back_where_somebody_comes_between_two() -> None:
    walks = {"id": "walker", "shape": {"disc": 0.3}, "motion": {"position": [-4.85, -2.24], "velocity": [1.05, 0.67]}}
    scenario = sp.Scenario(
        name="perpendicular",
        vehicle=CAR,
        start={"time": 0.0, "position": [-4.25, 3.48], "heading": -0.14, "speed": 0.0},
        goal={"position": [0.0, -3.8], "heading": pi / 2, "speed": 0.0},
        walls=[box(-12, -6, -1.35, 0), box(1.35, -6, 12, 0)],
        bounds={"min": [-12, -6], "max": [12, 5.72]},
        obstacles=[walks],
    )
    plan = sp.plan(scenario)
    assert plan.certified and plan.legs is not None
    check_densely(scenario, plan)
    times = np.linspace(plan.start_time, plan.arrival_time, 2001)
    walker = np.array([-4.85, -2.24]) + times[:, None] * [1.05, 0.67]
    heading = plan.heading(times)
    for offset in scenario.vehicle.discs:
        disc = plan.position(times) + offset * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        assert np.hypot(*(disc - walker).T).min() > scenario.vehicle.radius + 0.3 - 1e-6


@pytest.mark.parametrize("speed", [None, 0.0])
def test_out_of_a_dead_end_it_backs_to_a_goal_of_any_heading(speed: float | None) -> None:
    """There is no room to turn in 6 m between walls 1.6 m apart; the goal lies outside, to the left of the mouth."""
    vehicle = {**ROBOT, "max_speed": 1.5, "max_curvature": 1.2, "reverse": {"max_speed": 0.8, "max_acceleration": 0.8}}
    scenario = sp.Scenario(
        vehicle=vehicle,
        start={"time": 0.0, "position": [5, 0], "heading": 0.0, "speed": 0.0},
        goal={"position": [-3, 3], "speed": speed},
        walls=[box(0, 0.8, 6, 1), box(0, -1, 6, -0.8), box(6, -1, 6.2, 1)],
    )
    plan = sp.plan(scenario)
    assert plan.certified and plan.legs is not None
    assert plan.legs.legs[0].backward
    times = np.linspace(plan.start_time, plan.arrival_time, 4001)
    walls = shapely.MultiPolygon([shapely.Polygon(wall) for wall in scenario.walls])
    assert shapely.distance(shapely.points(plan.position(times)), walls).min() >= 0.3 - 1e-9


def test_a_goal_of_any_heading_is_given_up_as_soon_as_one_of_one() -> None:
    start = {"time": 0.0, "position": [0, 0], "heading": 0.0, "speed": 0.0}
    shut = [box(3, -1, 3.2, 1), box(5, -1, 5.2, 1), box(3, 1, 5.2, 1.2), box(3, -1.2, 5.2, -1)]
    took = list[float]()
    for heading in (0.0, None):
        goal = {"position": [4, 0], "heading": heading}
        vehicle = {**ROBOT, "max_curvature": 2.0, "reverse": {"max_speed": 1.0}}
        scenario = sp.Scenario(vehicle=vehicle, start=start, goal=goal, walls=shut)
        search = LegPlans(scenario, lambda skeleton, *_: sp.plan(skeleton.scenario), sp.zones(scenario), Budget())
        began = process_time()
        assert not ManoeuvreSearch(search.inside, search.batch, search.curvature).run()
        took.append(process_time() - began)
    assert took[1] < 3.0 * took[0]


@pytest.mark.parametrize(
    ("vehicle", "message"),
    [
        ({"reverse": {"max_speed": 2.0}}, r"reverse\.max_speed.*at most vehicle\.max_speed, 1"),
        ({"reverse": {"max_speed": -1.0}}, r"reverse\.max_speed"),
        ({"max_turn_rate": 1.0}, r"max_turn_rate.*on_the_spot"),
    ],
)
def test_bad_limits_are_told(vehicle: dict[str, Any], message: str) -> None:
    with pytest.raises(sp.ScenarioError, match=message):
        sp.Vehicle(**{**ROBOT, **vehicle})
