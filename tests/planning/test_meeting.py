"""Trips to targets that move, against closed forms, fixed goals and Monte Carlo."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import scp_planner as sp
from scp_planner.cli.summaries import of_plan
from scp_planner.planning.meeting import within
from scp_planner.plotting.recording import record_plan

pytestmark = pytest.mark.numerics

VEHICLE = {
    "radius": 0.3,
    "max_speed": 3.0,
    "max_acceleration": 2.0,
    "max_deceleration": 2.0,
    "max_lateral_acceleration": 2.0,
}
OBSTACLES = [
    {"id": "a", "shape": {"disc": 0.5}, "motion": {"position": [8.0, 1.0], "velocity": [0.3, -0.5]}},
    {"id": "b", "shape": {"disc": 0.5}, "motion": {"position": [10.0, 3.0], "velocity": [-0.3, 0.0]}},
]


def scenario(goal: dict[str, Any], obstacles: Any = (), start: Any = None, **vehicle: float) -> sp.Scenario:
    begin = start or {"time": 5.0, "position": [0.0, 0.0], "speed": 0.0}
    return sp.Scenario(vehicle={**VEHICLE, **vehicle}, start=begin, goal=goal, obstacles=obstacles)


def driven(time: float, speed: float, rate: float, top: float) -> float:
    """Distance of a straight drive at full acceleration up to a top speed."""
    rise = (top - speed) / rate
    within_rise = min(time, rise)
    return speed * within_rise + 0.5 * rate * within_rise**2 + top * max(time - rise, 0.0)


@pytest.mark.parametrize("seed", range(12))
def test_on_free_ground_the_meeting_is_the_closed_form(seed: int) -> None:
    """The straight drive that is first as long as the target is away; anywhere, of any size and at any time."""
    rng = np.random.default_rng(seed)
    size, top, turn = 10.0 ** rng.uniform(-1.0, 3.0), 10.0 ** rng.uniform(-1.0, 1.5), rng.uniform(0.0, 2.0 * math.pi)
    rate, clock = top * top / size * rng.uniform(1.0, 5.0), rng.uniform(0.0, 1e4)
    origin, away = rng.normal(size=2) * size, size * np.array([math.cos(turn), math.sin(turn)])
    speed, course = rng.uniform(0.0, 0.7) * top, rng.uniform(0.0, 2.0 * math.pi)
    velocity = speed * np.array([math.cos(course), math.sin(course)])
    target = {"motion": {"position": (origin + away).tolist(), "velocity": velocity.tolist()}}
    given = scenario(
        {"target": target},
        start={"time": clock, "position": origin.tolist(), "speed": 0.0},
        radius=size / 50.0,
        max_speed=top,
        max_acceleration=rate,
        max_deceleration=rate,
    )

    def gap(time: float) -> float:
        return float(np.hypot(*(away + time * velocity))) - driven(time, 0.0, rate, top)

    grid = np.linspace(0.0, 50.0 * size / top, 20_001)
    last = int(np.argmax([gap(time) <= 0.0 for time in grid]))
    wanted = brentq(gap, grid[last - 1], grid[last])
    plan = sp.plan(given)
    assert plan.certified
    assert sp.certify(given, plan).holds
    assert plan.lower_bound == pytest.approx(wanted, rel=1e-6)
    assert wanted * (1.0 - 1e-6) <= plan.travel_time <= wanted * (1.0 + 1e-3)


@pytest.mark.parametrize(("away", "speed"), [(5.0, 1.5), (10.0, 2.1), (5.0, 2.5)])
def test_a_velocity_is_matched_in_the_time_of_the_closed_form(away: float, speed: float) -> None:
    """Along one line: full acceleration up to the top speed or a peak, and full deceleration to the target's speed."""
    target = {"motion": {"position": [away, 0.0], "velocity": [speed, 0.0]}}
    plan = sp.plan(scenario({"target": target, "match_velocity": True}))
    top, rate = VEHICLE["max_speed"], VEHICLE["max_acceleration"]
    peak = speed + math.sqrt(rate * away + 0.5 * speed**2)
    wanted = (2.0 * peak - speed) / rate
    if peak > top:
        wanted = (away + 0.5 * top**2 / rate + 0.5 * (top - speed) ** 2 / rate) / (top - speed)
    assert plan.certified
    assert wanted * (1.0 - 1e-6) <= plan.travel_time <= wanted * (1.0 + 7e-4)


@pytest.mark.parametrize("more", [{}, {"radius": 1.0}, {"match_velocity": True}, {"offset": [-2.0, 0.5]}])
def test_the_target_is_met_where_it_is_on_arrival(more: dict[str, Any]) -> None:
    target = {"motion": {"position": [20.0, 0.0], "velocity": [-1.0, 1.0], "acceleration": [0.1, 0.0]}}
    given = scenario({"target": target, **more}, OBSTACLES)
    plan = sp.plan(given)
    assert plan.certified
    passed = plan.travel_time
    shift = more.get("offset", [0.0, 0.0])
    place = np.array([20.0 - passed + 0.05 * passed**2 + shift[0], passed + shift[1]])
    end = plan.position(np.array([plan.arrival_time]))[0]
    assert float(np.hypot(*(end - place))) <= more.get("radius", 0.0) + 1e-5
    if "match_velocity" in more:
        velocity = plan.velocity(np.array([plan.arrival_time]))[0]
        assert velocity == pytest.approx([-1.0 + 0.1 * passed, 1.0], abs=1e-3)
    met = sp.meeting(given, plan)
    assert met.place == pytest.approx(place, abs=1e-9)
    assert met.probability == 1.0


@pytest.mark.parametrize("brakes", [1e-3, 1e-5])
def test_a_target_is_met_far_from_where_it_is_expected(brakes: float) -> None:
    """It is faster than the vehicle, a metre ahead, and slows down: it is caught after kilometres."""
    target = {"motion": {"position": [1.0, 0.0], "velocity": [3.5, 0.0], "acceleration": [-brakes, 0.0]}}
    given = scenario({"target": target})
    plan = sp.plan(given)
    assert plan.certified
    assert plan.lower_bound > 0.9 / brakes
    assert plan.travel_time <= 1.001 * plan.lower_bound


def test_it_takes_as_long_as_to_a_goal_that_stands_there() -> None:
    given = scenario({"target": {"motion": {"position": [20.0, 0.0], "velocity": [-1.0, 1.0]}}}, OBSTACLES)
    plan = sp.plan(given)
    fixed = sp.plan(scenario({"position": sp.meeting(given, plan).place}, OBSTACLES))
    assert plan.travel_time == pytest.approx(fixed.travel_time, rel=1e-3)


def test_a_plan_that_misses_its_target_is_no_certificate() -> None:
    target = {"motion": {"position": [20.0, 0.0], "velocity": [-1.0, 1.0]}}
    plan = sp.plan(scenario({"target": target}))
    slower = {"motion": {"position": [20.0, 0.0], "velocity": [-1.0, 0.999]}}
    found = sp.certify(scenario({"target": slower}), plan)
    assert not found.holds
    assert found.violations[0].what == "distance from the goal"


@pytest.mark.parametrize(("course", "accelerates"), [(2.0, 0.0), (-2.5, 0.05)])
def test_the_approach_is_from_the_side_that_is_asked_for(course: float, accelerates: float) -> None:
    """From behind, within 0.3 rad, by the target's direction of motion on arrival; any other way is no certificate."""
    velocity = [0.8 * math.cos(course), 0.8 * math.sin(course)]
    motion = {"position": [12.0, 3.0], "velocity": velocity, "acceleration": [0.0, accelerates]}
    anyhow = {"target": {"motion": motion}, "radius": 0.3}
    asked = scenario({**anyhow, "approach": [-0.3, 0.3]}, max_curvature=1.0)
    plan = sp.plan(asked)
    ahead = velocity[1] + accelerates * plan.travel_time
    assert plan.certified
    turned = float(plan.heading(plan.arrival_time)) - math.atan2(ahead, velocity[0])
    assert abs(math.remainder(turned, 2.0 * math.pi)) <= 0.3 + 1e-6
    free = sp.plan(scenario(anyhow, max_curvature=1.0))
    assert free.travel_time < plan.travel_time
    assert [one.what for one in sp.certify(asked, free).violations] == ["goal heading"]


@pytest.mark.parametrize(
    ("goal", "key"),
    [
        ({"position": [9.0, 0.0], "approach": [-0.3, 0.3]}, "approach"),
        ({"approach": [0.3, -0.3]}, r"approach\[1\]"),
        ({"approach": [-0.3, 0.3], "heading_range": [0.0, 1.0]}, "heading_range"),
        ({"approach": [-0.3, 0.3], "match_velocity": True}, "approach"),
    ],
)
def test_an_approach_that_is_not_allowed_is_refused(goal: dict[str, Any], key: str) -> None:
    moves = {} if "position" in goal else {"target": {"motion": {"position": [9.0, 0.0], "velocity": [1.0, 0.0]}}}
    with pytest.raises(sp.ScenarioError, match=rf"goal\.{key}"):
        scenario({**moves, **goal})


def test_a_target_that_gets_away_is_told() -> None:
    given = scenario({"target": {"motion": {"position": [5.0, 0.0], "velocity": [3.1, 0.0]}}})
    plan = sp.plan(given)
    assert plan.status == "infeasible"
    assert math.isinf(sp.lower_bound(given))
    assert plan.reason is not None
    assert plan.reason.startswith("no trip meets the target")
    nearly = scenario({"target": {"motion": {"position": [5.0, 0.0], "velocity": [2.9, 0.0]}}})
    assert math.isfinite(sp.lower_bound(nearly))


def test_a_target_that_gets_away_behind_a_rock_is_not_followed_for_ever() -> None:
    """It is met before that, or the best trip is one to where it could have been; the proof is of standing goals."""
    motion = {"position": [8.0, 1.0], "velocity": [0.0, -0.2], "acceleration": [0.45, 0.0]}
    rock = {"id": "rock", "shape": {"disc": 4.0}, "motion": {"position": [9.5, 0.3]}}
    start = {"time": 0.0, "position": [0.0, 0.0], "speed": 1.0, "heading": 0.0}
    plan = sp.plan(scenario({"target": {"motion": motion}, "radius": 0.3}, [rock], start))
    assert plan.travel_time < 20.0
    assert plan.certified or "No trip at all" not in (plan.reason or "")


def test_the_obstacle_that_is_met_is_no_obstacle_but_where_the_vehicle_is_to_pass_it() -> None:
    boat = {"id": "boat", "shape": {"disc": 0.5}, "motion": {"position": [20.0, 0.0], "velocity": [-1.0, 0.0]}}
    onto = scenario({"target": "boat"}, [boat])
    plan = sp.plan(onto)
    assert plan.certified
    beyond = scenario({"target": "boat", "offset": [3.0, 0.0]}, [boat])
    past = sp.plan(beyond)
    assert past.certified
    times = np.linspace(past.start_time, past.arrival_time, 500)
    boat_at = np.stack([20.0 - (times - 5.0), np.zeros_like(times)], axis=-1)
    assert float(np.hypot(*(past.position(times) - boat_at).T).min()) >= 0.8 - 1e-9


def test_an_estimate_is_met_and_its_probability_told() -> None:
    seen = {
        "observations": {
            "time": [3.0, 3.5, 4.0, 4.5, 5.0],
            "position": [[12.0, -2.0], [12.1, -1.5], [12.0, -1.0], [11.9, -0.5], [12.0, 0.0]],
            "covariance": [[0.01, 0.0], [0.0, 0.01]],
        },
        "model": {"order": 1},
    }
    given = scenario({"target": seen, "radius": 0.5})
    plan = sp.plan(given)
    assert plan.certified
    met = sp.meeting(given, plan)
    assert met.distance < 1e-4
    assert 0.2 < met.probability < 0.99


@pytest.mark.parametrize("mean", [(0.0, 0.0), (0.2, -0.1), (2.0, 1.0)])
def test_the_probability_is_that_of_drawn_errors(mean: tuple[float, float]) -> None:
    covariance = np.array([[0.2, 0.1], [0.1, 0.3]])
    drawn = np.random.default_rng(0).multivariate_normal(mean, covariance, 200_000)
    share = float((np.hypot(*drawn.T) < 0.5).mean())
    assert within(0.5, np.array(mean), covariance) == pytest.approx(share, abs=4.0 * math.sqrt(0.25 / 200_000))


def test_summary_of_the_command_line_tells_the_meeting() -> None:
    """A trip straight towards a target that comes along the same line: their speeds add up."""
    given = scenario({"target": {"motion": {"position": [20.0, 0.0], "velocity": [-1.0, 0.0]}}})
    plan = sp.plan(given)
    told = of_plan(given, plan)
    assert told["meeting_x"] == pytest.approx(20.0 - plan.travel_time, abs=1e-3)
    assert told["relative_speed"] == pytest.approx(4.0, rel=1e-2)
    assert told["probability_within"] == 1.0


def test_pictures_show_the_target_and_where_it_is_met() -> None:
    ship = {"id": "boat", "shape": {"disc": 0.5}, "motion": {"position": [9.0, 0.0], "velocity": [-1.0, 0.5]}}
    for goal, obstacles in (({"target": "boat"}, [ship]), ({"target": {"motion": ship["motion"]}}, [])):
        given = scenario(goal, obstacles)
        plan = sp.plan(given)
        recording = record_plan(plan, given)
        assert recording.goal == pytest.approx(sp.meeting(given, plan).place)
        (target,) = recording.obstacles
        assert target.center[-1] == pytest.approx(recording.goal)


def test_a_target_that_is_near_enough_at_the_start_is_matched_all_the_same() -> None:
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0}
    passing = {"motion": {"position": [0.5, 0.0], "velocity": [1.0, 0.1]}}
    goal = {"target": passing, "radius": 1.0, "match_velocity": True}
    vehicle = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 2.0, "max_deceleration": 2.0}
    assert sp.plan(sp.Scenario(vehicle=vehicle, start=start, goal=goal)).certified
