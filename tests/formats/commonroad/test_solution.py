"""Solutions of CommonRoad's benchmark, on a road written for the test, judged by what is written here alone."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from command import run
from scipy.integrate import solve_ivp
from shapely import Polygon, box
from shapely.affinity import rotate, translate

import scp_planner as sp

pytest.importorskip("commonroad", reason="needs commonroad-io, which is not installed")

from scp_planner.formats.commonroad.cars import CARS, VehicleModel, car_named, vehicle_of
from scp_planner.formats.commonroad.goals import GoalAim, seen_heading
from scp_planner.formats.commonroad.planning import plan_commonroad
from scp_planner.formats.commonroad.reading import load_commonroad
from scp_planner.formats.commonroad.solution import export_commonroad_solution

LENGTH, LANE = 120.0, 3.5
STEP = 0.1
ROAD = box(0.0, -0.5 * LANE, LENGTH, 1.5 * LANE)
GOAL = {"x": 85.0, "y": 0.0, "length": 10.0, "width": 3.0}
PARKED = {"x": 45.0, "y": 0.4, "length": 4.6, "width": 1.9}

Array = np.ndarray


def bound(side: str, y: float) -> str:
    points = "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x in np.linspace(0.0, LENGTH, 13))
    return f"<{side}>{points}<lineMarking>solid</lineMarking></{side}>"


def lane(number: int, middle: float, beside: str) -> str:
    return (
        f'<lanelet id="{number}">{bound("leftBound", middle + 0.5 * LANE)}{bound("rightBound", middle - 0.5 * LANE)}'
        f"{beside}<laneletType>urban</laneletType><userOneWay>vehicle</userOneWay></lanelet>"
    )


def exactly(key: str, value: float) -> str:
    return f"<{key}><exact>{value}</exact></{key}>"


def rectangle(shape: dict[str, float], *, placed: bool) -> str:
    center = f"<center><x>{shape['x']}</x><y>{shape['y']}</y></center>" if placed else ""
    return (
        f"<rectangle><length>{shape['length']}</length><width>{shape['width']}</width>"
        f"<orientation>0.0</orientation>{center}</rectangle>"
    )


def state(x: float, y: float, time: int, speed: float | None = None) -> str:
    moving = "" if speed is None else exactly("velocity", speed)
    point = f"<position><point><x>{x}</x><y>{y}</y></point></position>"
    return f"{point}{exactly('orientation', 0.0)}<time><exact>{time}</exact></time>{moving}"


def goal(place: str = "", speed: str = "") -> str:
    time = "<time><intervalStart>1</intervalStart><intervalEnd>120</intervalEnd></time>"
    heading = "<orientation><intervalStart>-0.2</intervalStart><intervalEnd>0.2</intervalEnd></orientation>"
    return f"<goalState>{place}{heading if place else ''}{time}{speed}</goalState>"


def road(goals: str) -> str:
    """A straight road of two lanes, with a car that is parked half across the right one."""
    parked = (
        '<staticObstacle id="30"><type>parkedVehicle</type>'
        f"<shape>{rectangle({**PARKED, 'x': 0.0, 'y': 0.0}, placed=False)}"
        f"</shape><initialState>{state(PARKED['x'], PARKED['y'], 0)}</initialState></staticObstacle>"
    )
    start = f"{state(8.0, 0.0, 0, 12.0)}{exactly('yawRate', 0.0)}{exactly('slipAngle', 0.0)}"
    left, right = (f'<adjacent{side} ref="{other}" drivingDir="same"/>' for side, other in (("Left", 2), ("Right", 1)))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>'
        f'<commonRoad timeStepSize="{STEP}" commonRoadVersion="2020a" author="test" affiliation="test" source="test"'
        ' benchmarkID="ZAM_Parked-1_1_T-1" date="2026-01-01">'
        "<location><geoNameId>-999</geoNameId><gpsLatitude>999</gpsLatitude><gpsLongitude>999</gpsLongitude></location>"
        "<scenarioTags><urban/></scenarioTags>"
        f"{lane(1, 0.0, left)}{lane(2, LANE, right)}{parked}"
        f'<planningProblem id="7"><initialState>{start}</initialState>{goals}</planningProblem></commonRoad>'
    )


@pytest.fixture
def road_file(tmp_path: Path) -> Path:
    file = tmp_path / "ZAM_Parked-1_1_T-1.xml"
    file.write_text(road(goal(f"<position>{rectangle(GOAL, placed=True)}</position>")), encoding="utf-8")
    return file


def read(file: Path) -> Any:
    from commonroad.common.solution import CommonRoadSolutionReader

    (answer,) = CommonRoadSolutionReader.open(str(file)).planning_problem_solutions
    return answer


def states_of(file: Path) -> list[SimpleNamespace]:
    """The states of a solution file, from its elements: commonroad-io's reader knows no states with a trailer."""
    names = {"steeringAngle": "steering_angle"}
    (trajectory,) = ElementTree.parse(file).getroot()
    found = []
    for each in trajectory:
        values = {names.get(part.tag, part.tag): float(str(part.text)) for part in each}
        found.append(SimpleNamespace(**values, position=np.array([values["x"], values["y"]])))
    return found


def footprint(place: Array, heading: float, name: str) -> Polygon:
    car = CARS[name]
    around = box(-0.5 * car.length, -0.5 * car.width, 0.5 * car.length, 0.5 * car.width)
    return translate(rotate(around, heading, origin=(0.0, 0.0), use_radians=True), *place)


def assert_on_the_road(states: list[Any], headings: list[float], name: str) -> None:
    parked = box(-0.5 * PARKED["length"], -0.5 * PARKED["width"], 0.5 * PARKED["length"], 0.5 * PARKED["width"])
    parked = translate(parked, PARKED["x"], PARKED["y"])
    for each, heading in zip(states, headings, strict=True):
        body = footprint(each.position, heading, name)
        assert ROAD.contains(body)
        assert not parked.intersects(body)
    region = box(GOAL["x"] - 5.0, GOAL["y"] - 1.5, GOAL["x"] + 5.0, GOAL["y"] + 1.5)
    assert region.covers(Polygon(footprint(states[-1].position, headings[-1], name)).centroid)
    assert abs(headings[-1]) <= 0.2 + 1e-6


def test_point_mass_keeps_to_its_circle(road_file: Path, tmp_path: Path) -> None:
    made = plan_commonroad(road_file, model="PM")
    assert made.plan.certified, made.plan.reason
    export_commonroad_solution(made.plan, road_file, tmp_path / "pm.xml", model="PM", cost="JB1")
    answer = read(tmp_path / "pm.xml")
    assert (answer.vehicle_id, str(answer.cost_function.name), answer.planning_problem_id) == ("PM2", "JB1", 7)
    states = answer.trajectory.state_list
    assert [each.time_step for each in states] == list(range(len(states)))
    velocities = np.array([[each.velocity, each.velocity_y] for each in states])
    places = np.array([each.position for each in states])
    pushes = np.diff(velocities, axis=0) / STEP
    assert np.hypot(*pushes.T).max() <= 11.5
    joined = places[:-1] + STEP * velocities[:-1] + 0.5 * STEP**2 * pushes
    assert np.abs(joined - places[1:]).max() < 0.02
    assert_on_the_road(states, np.arctan2(velocities[:, 1], velocities[:, 0]).tolist(), "BMW_320i")


def steered(x0: Array, inputs: Array, wheelbase: float) -> Array:
    """One step of the kinematic single track: rear axle, steering angle, speed, heading."""

    def rate(_: float, x: Array) -> list[float]:
        v = x[3]
        return [v * math.cos(x[4]), v * math.sin(x[4]), inputs[0], inputs[1], v * math.tan(x[2]) / wheelbase]

    return np.asarray(solve_ivp(rate, (0.0, STEP), x0, rtol=1e-9, atol=1e-9).y[:, -1])


@pytest.mark.parametrize(("model", "name"), [("KS", "BMW_320i"), ("KST", "TRUCK")])
def test_single_track_keeps_to_its_steering(model: str, name: str, road_file: Path, tmp_path: Path) -> None:
    made = plan_commonroad(road_file, model=model)
    assert made.plan.certified, made.plan.reason
    export_commonroad_solution(made.plan, road_file, tmp_path / "ks.xml", model=model, cost="SM1")
    states = states_of(tmp_path / "ks.xml")
    car = CARS[name]
    behind = car.rear_axle if model == "KS" else 0.0
    rows = []
    for each in states:
        back = behind * np.array([math.cos(each.orientation), math.sin(each.orientation)])
        rows.append([*(each.position - back), each.steering_angle, each.velocity, each.orientation])
    table = np.array(rows)
    assert table[0, 3:] == pytest.approx([12.0, 0.0], abs=1e-6)
    inputs = np.diff(table[:, [2, 3]], axis=0) / STEP
    assert np.abs(inputs[:, 0]).max() <= car.steering_rate
    falling = car.acceleration * np.minimum(car.switching_speed / table[1:, 3], 1.0)
    assert np.all(inputs[:, 1] <= falling)
    across = table[:-1, 3] ** 2 * np.tan(table[:-1, 2]) / car.wheelbase
    assert np.hypot(inputs[:, 1], across).max() <= car.acceleration
    for (before, after), push in zip(pairwise(table), inputs, strict=True):
        there = steered(before, push, car.wheelbase)
        assert np.abs(there[:2] - after[:2]).max() < 0.02
        assert abs(there[4] - after[4]) < 0.03
    assert_on_the_road(states, table[:, 4].tolist(), name)


def test_trailer_follows(road_file: Path, tmp_path: Path) -> None:
    made = plan_commonroad(road_file, model="KST")
    export_commonroad_solution(made.plan, road_file, tmp_path / "kst.xml", model="KST")
    states = states_of(tmp_path / "kst.xml")
    plan = made.plan

    def rate(time: float, angle: Array) -> list[float]:
        return [-float(plan.speed(time)) * (math.sin(angle[0]) / 8.1 + float(plan.curvature(time)))]

    times = np.linspace(plan.start_time, plan.arrival_time, len(states))
    exact = solve_ivp(rate, (times[0], times[-1]), [0.0], t_eval=times, rtol=1e-8, atol=1e-10, max_step=0.01).y[0]
    assert [each.hitch_angle for each in states] == pytest.approx(exact.tolist(), abs=1e-4)
    assert np.abs(exact).max() > 1e-3


def test_goals_of_time_alone_and_none(tmp_path: Path) -> None:
    timed, none = tmp_path / "timed.xml", tmp_path / "none.xml"
    timed.write_text(road(goal().replace("<intervalStart>1<", "<intervalStart>20<")), encoding="utf-8")
    made = plan_commonroad(timed, model="PM")
    assert made.plan.certified, made.plan.reason
    assert made.plan.arrival_time == pytest.approx(2.0, abs=1.1e-3)
    none.write_text(road(""), encoding="utf-8")
    with pytest.raises(sp.ScenarioError, match="goalState: problem 7 has no goal"):
        load_commonroad(none)


def test_the_sooner_of_two_goals_counts(tmp_path: Path) -> None:
    near = {**GOAL, "x": 70.0}
    both = "".join(goal(f"<position>{rectangle(place, placed=True)}</position>") for place in (GOAL, near))
    file = tmp_path / "two.xml"
    file.write_text(road(both), encoding="utf-8")
    made = plan_commonroad(file, model="PM")
    alone = sp.plan(load_commonroad(file, model="PM", aim=GoalAim(0)))
    assert made.plan.certified
    assert made.plan.travel_time < alone.travel_time
    assert float(made.plan.position(made.plan.arrival_time)[0]) < 75.0


@pytest.mark.parametrize(
    "other",
    [
        goal(f"<position>{rectangle({**GOAL, 'x': 2.0}, placed=True)}</position>"),  # behind the car
        goal(f"<position>{rectangle(GOAL, placed=True)}</position>").replace("120<", "0<").replace(">1<", ">0<"),
    ],
)
def test_a_goal_that_nobody_gets_to_leaves_the_others(other: str, tmp_path: Path) -> None:
    file = tmp_path / "two.xml"
    file.write_text(road(other + goal(f"<position>{rectangle(GOAL, placed=True)}</position>")), encoding="utf-8")
    made = plan_commonroad(file, model="PM")
    assert made.plan.certified, made.plan.reason
    assert abs(float(made.plan.position(made.plan.arrival_time)[0]) - GOAL["x"]) <= 5.0 + 1e-6


def test_a_goal_of_time_alone_may_be_nearer_than_the_car_is_long(tmp_path: Path) -> None:
    file = tmp_path / "soon.xml"
    file.write_text(road(goal().replace(">1<", ">2<").replace("120<", "4<")), encoding="utf-8")
    made = plan_commonroad(file, model="KS")
    assert made.plan.certified, made.plan.reason
    assert 2 * STEP - 1e-3 <= made.plan.arrival_time <= 4 * STEP + 1e-3


def test_a_goal_in_a_turn_is_reached_where_no_trip_follows_the_lane(tmp_path: Path) -> None:
    """The car heads 0.6 rad off the lane, 8 m before the goal: steered back to the lane it would turn too fast."""
    place = {"x": 16.0, "y": 0.08, "length": 3.0, "width": 2.0}
    soon = goal(f"<position>{rectangle(place, placed=True)}</position>").replace("120<", "15<").replace("0.2<", "0.09<")
    before, problem = road(soon).split("<planningProblem")
    for old, new in (("<y>0.0<", "<y>2.0<"), ("<exact>0.0<", "<exact>-0.6<"), ("<exact>12.0<", "<exact>9.0<")):
        problem = problem.replace(old, new, 1)
    file = tmp_path / "turn.xml"
    file.write_text(f"{before}<planningProblem{problem}", encoding="utf-8")
    made = plan_commonroad(file, model="KS")
    assert made.plan.certified, made.plan.reason
    export_commonroad_solution(made.plan, file, tmp_path / "turn.sol.xml", model="KS")
    last = states_of(tmp_path / "turn.sol.xml")[-1]
    region = box(place["x"] - 1.5, place["y"] - 1.0, place["x"] + 1.5, place["y"] + 1.0)
    assert region.covers(footprint(last.position, last.orientation, "BMW_320i").centroid)
    assert abs(last.orientation) <= 0.09 + 1e-6


def test_headings_of_point_masses_are_those_that_are_seen() -> None:
    for wanted in ((-0.2, 0.3), (0.5, 0.7), (-7.0, -6.5), (3.0, 3.2)):
        for near in (0.0, 3.0):
            seen = seen_heading(wanted, near)
            for heading in np.linspace(-math.pi, math.pi, 721):
                told = math.atan2(math.sin(heading), 1.0)
                allowed = any(wanted[0] <= told + turn <= wanted[1] for turn in (-2 * math.pi, 0.0, 2 * math.pi))
                if seen is None:
                    assert not allowed
                elif allowed and abs(math.remainder(heading - near, 2 * math.pi)) < 0.5 * math.pi - 1e-9:
                    assert any(
                        seen[0] - 1e-9 <= heading + turn <= seen[1] + 1e-9 for turn in (-2 * math.pi, 0.0, 2 * math.pi)
                    )
    assert seen_heading((1.0, 2.0), 1.5) is None


def test_discs_cover_the_cars() -> None:
    for name, car in CARS.items():
        model = VehicleModel.KST if car.trailer_wheelbase else VehicleModel.KS
        fields = vehicle_of(car_named(name, model), model, discs=9)
        from shapely import Point, union_all

        covered = union_all([Point(x, 0.0).buffer(fields["radius"], quad_segs=256) for x in fields["discs"]])
        assert covered.buffer(1e-4).contains(translate(footprint(np.zeros(2), 0.0, name), fields["centre"], 0.0))


def test_a_gap_hardly_wider_than_the_car_is_driven_through(road_file: Path) -> None:
    text, gap = road_file.read_text(encoding="utf-8"), 1.75
    begin, end = text.index("<staticObstacle"), text.index("</staticObstacle>") + len("</staticObstacle>")
    width = PARKED["width"]
    places = [0.5 * (gap + width), -0.5 * (gap + width), 0.5 * gap + width + 1.2 + 0.5 * width]
    cars = [
        text[begin:end].replace('id="30"', f'id="{30 + k}"').replace(f"<y>{PARKED['y']}</y>", f"<y>{y}</y>")
        for k, y in enumerate(places)
    ]
    road_file.write_text(text[:begin] + "".join(cars) + text[end:], encoding="utf-8")
    made = plan_commonroad(road_file, model="KS")
    assert made.plan.certified
    first = load_commonroad(road_file, model="KS").vehicle
    assert CARS["BMW_320i"].width < 2.0 * made.scenario.vehicle.radius < gap < 2.0 * first.radius


def test_no_time_at_all_leaves_what_is_at_hand(road_file: Path) -> None:
    made = plan_commonroad(road_file, model="KS", time_limit=0.0)
    assert made.plan.travel_time > 0.0


def test_what_the_checker_would_not_find_is_planned_more_softly(tmp_path: Path) -> None:
    """A goal that is late: the plan brakes and speeds up, at once, and the file's steps are long."""
    file = tmp_path / "late.xml"
    late = goal(f"<position>{rectangle(GOAL, placed=True)}</position>").replace(
        "<intervalStart>1<", "<intervalStart>30<"
    )
    file.write_text(road(late).replace(f'timeStepSize="{STEP}"', 'timeStepSize="0.25"'), encoding="utf-8")
    made = plan_commonroad(file, model="KS")
    assert made.plan.certified
    export_commonroad_solution(made.plan, file, tmp_path / "late.sol.xml", model="KS")


def test_refusals(road_file: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="model: must be one of PM, KS, KST"):
        load_commonroad(road_file, model="ST")
    with pytest.raises(ValueError, match="model KS needs one of FORD_ESCORT, BMW_320i, VW_VANAGON, not 'TRUCK'"):
        load_commonroad(road_file, model="KS", car="TRUCK")
    plan = sp.plan(load_commonroad(road_file))
    with pytest.raises(ValueError, match="cost: must be one of JB1, SM1, WX1, not 'TR1'"):
        export_commonroad_solution(plan, road_file, tmp_path / "no.xml", cost="TR1")
    assert abs(math.remainder(plan.travel_time, STEP)) > 0.02 * STEP
    with pytest.raises(ValueError, match="must take a multiple of the file's step"):
        export_commonroad_solution(plan, road_file, tmp_path / "no.xml")
    assert not (tmp_path / "no.xml").exists()


@pytest.mark.parametrize(
    ("model", "exact", "other", "named"),
    [
        ("PM", "<orientation><exact>0.0", "<orientation><exact>-6.3", "initialState.orientation"),
        (
            "KS",
            "<velocity><exact>12.0</exact>",
            "<velocity><intervalStart>9.0</intervalStart><intervalEnd>11.0</intervalEnd>",
            "initialState.velocity: must be known exactly",
        ),
        ("KS", "<x>85.0</x>", "<x>2.0</x>", "goalState.position: nothing that drives forward"),
    ],
)
def test_problems_that_nobody_solves_are_refused_by_name(
    model: str, exact: str, other: str, named: str, road_file: Path
) -> None:
    text = road_file.read_text()
    before, problem = text.split("<planningProblem", 1)
    assert exact in problem
    road_file.write_text(before + "<planningProblem" + problem.replace(exact, other, 1))
    with pytest.raises(sp.ScenarioError, match=named):
        load_commonroad(road_file, model=model)


def test_borders_of_lanes_are_there_to_be_drawn(road_file: Path) -> None:
    """Three for two lanes beside each other, as far as the map around the way goes."""
    borders = [np.array(line) for line in load_commonroad(road_file).lanes]
    assert sorted(border[:, 1].mean() for border in borders) == pytest.approx([-0.5 * LANE, 0.5 * LANE, 1.5 * LANE])
    assert all(np.ptp(border[:, 1]) < 1e-6 and np.ptp(border[:, 0]) > GOAL["x"] - 8.0 for border in borders)


def test_command_writes_a_solution(road_file: Path, tmp_path: Path) -> None:
    target = tmp_path / "solution.xml"
    done = run("plan", road_file, "--commonroad-solution", target, "--commonroad-model", "KS", "--no-bound")
    assert done.exit_code == 0, done.output
    assert read(target).vehicle_id == "KS2"
    assert f"wrote {target}: a solution of {road_file}" in done.output
    refused = run("plan", "builtin:crossing", "--commonroad-solution", target)
    assert refused.exit_code == 2
    assert "needs a scenario of CommonRoad" in refused.output


def test_a_plan_for_a_model_passes_its_own_check(road_file: Path, tmp_path: Path) -> None:
    """Of two goals the sooner one, for a truck: all of it is in the plan file."""
    both = "".join(goal(f"<position>{rectangle({**GOAL, 'x': x}, placed=True)}</position>") for x in (85.0, 70.0))
    road_file.write_text(road(both), encoding="utf-8")
    file = tmp_path / "plan.json"
    options = ("--commonroad-solution", tmp_path / "s.xml", "--commonroad-model", "KST", "--no-bound")
    done = run("plan", road_file, *options, "-o", file)
    assert done.exit_code == 0, done.output
    assert run("check", road_file, file).exit_code == 0
    assert sp.Plan.load(file).commonroad == {
        **{"model": "KST", "car": "TRUCK", "problem": 7, "discs": 5},
        **{"state": 1, "timed_way": 1.0, "depth": 0.0, "turn": 0.9},
    }
    file.write_text(file.read_text().replace('"car": "TRUCK"', '"car": "VW_VANAGON"'))
    refused = run("check", road_file, file)
    assert refused.exit_code == 2 and "model KST needs one of TRUCK" in " ".join(refused.output.split())
    file.write_text(file.read_text().replace('"discs": 5', '"discs": "many"'))
    with pytest.raises(sp.PlanError, match=r"commonroad.discs = 'many': must be a whole number"):
        sp.Plan.load(file)


def test_scenario_load_names_the_function_that_reads_commonroad(road_file: Path) -> None:
    with pytest.raises(sp.ScenarioError, match=r"read by scp_planner.formats.commonroad.load_commonroad"):
        sp.Scenario.load(road_file)


def test_a_gap_between_lanes_that_are_not_side_by_side_is_not_driven_over(tmp_path: Path) -> None:
    """A gap of 0.1 mm, as the official checker has it: the lane beyond it cannot be reached."""
    place = {**GOAL, "y": LANE}
    text = road(goal(f"<position>{rectangle(place, placed=True)}</position>"))
    file = tmp_path / "gap.xml"
    file.write_text(text, encoding="utf-8")
    assert plan_commonroad(file, model="KS").plan.certified
    moved = text.replace(bound("rightBound", 0.5 * LANE), bound("rightBound", 0.5 * LANE + 1e-4))
    file.write_text(moved, encoding="utf-8")
    assert plan_commonroad(file, model="KS").plan.certified, "side by side, they are one"
    apart = re.sub("<adjacent[^>]*>", "", moved)
    file.write_text(apart, encoding="utf-8")
    assert not plan_commonroad(file, model="KS", time_limit=2.0).plan.certified
    assert sp.plan(load_commonroad(file)).certified, "no vehicle notices it"
