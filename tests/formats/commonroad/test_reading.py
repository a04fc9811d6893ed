"""Scenarios of CommonRoad: what is read is what stands in the files, and can be planned with."""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from command import run
from shapely import Point, Polygon, box, union_all

import scp_planner as sp
from benchmarks.hostile.roads import ROAD
from scp_planner.scenario.motions import Course

pytest.importorskip("commonroad", reason="needs commonroad-io, which is not installed")

from scp_planner.formats.commonroad.goals import polygons_of
from scp_planner.formats.commonroad.reading import load_commonroad

NAMES = (
    "DEU_A9-1_1_T-1",
    "DEU_Ffb-1_1_T-1",
    "RUS_Bicycle-3_1_T-1",
    "USA_Peach-4_2_T-1",
    "USA_US101-1_1_T-1",
    "USA_US101-4_1_T-1",
    "ZAM_Merge-1_1_T-1",
    "ZAM_Tjunction-1_42_T-1",
)

BROKEN = "<?xml version='1.0'?><commonRoad commonRoadVersion='2020a'><location/></commonRoad>"


def file_of(data: Path, name: str) -> Path:
    return data / "commonroad" / f"{name}.xml"


@cache
def loaded(file: Path) -> sp.Scenario:
    """The scenario of a file, read once for all tests that look at it."""
    return load_commonroad(file)


@cache
def opened(file: Path) -> Any:
    """What the format's own reader makes of a file, its road and its planning problems, read once."""
    from commonroad.common.file_reader import CommonRoadFileReader

    return CommonRoadFileReader(str(file)).open()


def numbers(element: ElementTree.Element | None, *paths: str) -> list[float]:
    assert element is not None
    return [float(str(element.findtext(path))) for path in paths]


@pytest.mark.parametrize("name", NAMES)
def test_scenario_is_that_of_the_file(name: str, recorded_data: Path) -> None:
    """Against the file's elements, read by nothing that the package uses."""
    scenario = loaded(file_of(recorded_data, name))
    root = ElementTree.parse(file_of(recorded_data, name)).getroot()
    step = float(root.attrib["timeStepSize"])
    start = root.find("planningProblem/initialState")
    place = "position/point/x", "position/point/y"
    # The reader keeps as many digits as the format has.
    assert scenario.start.position == pytest.approx(tuple(numbers(start, *place)), abs=1e-6)
    assert [scenario.start.heading, scenario.start.speed] == pytest.approx(
        numbers(start, "orientation/exact", "velocity/exact"), abs=1e-6
    )
    (latest,) = numbers(root.find("planningProblem/goalState"), "time/intervalEnd")
    assert scenario.goal.latest_arrival == pytest.approx(step * latest)

    obstacles = [each for each in root if each.tag.endswith("bstacle") and each.find("shape") is not None]
    assert [obstacle.id for obstacle in scenario.obstacles] == [each.attrib["id"] for each in obstacles]
    zones = sp.zones(scenario)[: len(obstacles)]  # the walls of the road come after them
    for element, obstacle, zone in zip(obstacles, scenario.obstacles, zones, strict=True):
        assert isinstance(obstacle.shape, sp.Rectangle)
        sides = numbers(element.find("shape/rectangle"), "length", "width")
        assert obstacle.shape.rectangle == pytest.approx(sides, abs=1e-6)
        states = [element.find("initialState"), *element.iterfind("trajectory/state")]
        for state in states:
            (k,) = numbers(state, "time/exact")
            # Standing ones are where they begin, within the little that they move.
            slack = 1e-6 if isinstance(obstacle.motion, Course) else 0.2
            assert zone.center(step * k) == pytest.approx(numbers(state, *place), abs=slack)


@pytest.mark.parametrize("name", NAMES)
def test_goal_lies_in_its_region(name: str, recorded_data: Path) -> None:
    scenario = loaded(file_of(recorded_data, name))
    _, problems = opened(file_of(recorded_data, name))
    (problem,) = problems.planning_problem_dict.values()
    state = problem.goal.state_list[0]
    parts = polygons_of(state.position)
    assert scenario.goal.region is not None
    assert min(Polygon(scenario.goal.region).symmetric_difference(part).area for part in parts) < 1e-3
    assert Polygon(scenario.goal.region).contains(Point(scenario.goal.position))
    for given, interval in ((scenario.goal.speed_range, "velocity"), (scenario.goal.heading_range, "orientation")):
        wanted = getattr(state, interval, None)
        assert (given is None) == (wanted is None)
        if given is not None and wanted is not None:
            assert given == pytest.approx(
                (max(wanted.start, 0.0) if interval == "velocity" else wanted.start, wanted.end)
            )


@pytest.mark.parametrize("name", NAMES)
def test_guide_keeps_to_the_lanes(name: str, recorded_data: Path) -> None:
    scenario = loaded(file_of(recorded_data, name))
    world, _ = opened(file_of(recorded_data, name))
    assert scenario.guide is not None
    guide = np.array(scenario.guide)
    sides = np.linalg.norm(np.diff(guide, axis=0), axis=1)
    assert 1.0 < sides.min() and sides.max() < 3.1
    between = np.concatenate([guide, 0.5 * (guide[1:] + guide[:-1])])
    on_lanes = [bool(lanes) for lanes in world.lanelet_network.find_lanelet_by_position(list(between))]
    assert np.mean(on_lanes) > 0.95
    # It goes about as far as the crow flies, or round a corner.
    assert sides.sum() < 1.5 * math.dist(guide[0], guide[-1])
    assert load_commonroad(file_of(recorded_data, name), guide=False).guide is None


LONGEST = ("DEU_A9-1_1_T-1", "USA_US101-4_1_T-1")


# On the road the default car is too slow for the lane change of ZAM_Merge.
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name in LONGEST else ())
        for name in NAMES
        if not name.startswith("ZAM_Merge")
    ],
)
def test_a_certified_plan_reaches_the_goal_in_time(name: str, recorded_data: Path) -> None:
    scenario = loaded(file_of(recorded_data, name))
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    goal = scenario.goal
    assert goal.latest_arrival is not None
    assert (goal.earliest_arrival or 0.0) - 1e-3 <= plan.arrival_time <= goal.latest_arrival + 1e-3
    assert Polygon(goal.region).distance(Point(plan.position(plan.arrival_time))) <= 1e-6


def test_default_vehicle_is_a_whole_car(recorded_data: Path) -> None:
    vehicle = load_commonroad(file_of(recorded_data, "DEU_Ffb-1_1_T-1")).vehicle
    car = box(-2.25, -0.9, 2.25, 0.9)
    covered = union_all([Point(offset, 0.0).buffer(vehicle.radius, quad_segs=256) for offset in vehicle.discs])
    assert car.difference(covered.buffer(1e-4)).is_empty
    assert covered.bounds[3] < 1.01  # and little more


def test_own_vehicle(recorded_data: Path) -> None:
    file = file_of(recorded_data, "DEU_Ffb-1_1_T-1")
    vehicle = sp.Vehicle(radius=0.5, max_speed=15.0, max_acceleration=2.0, max_deceleration=3.0)
    assert load_commonroad(file, vehicle).vehicle == vehicle
    assert load_commonroad(file).vehicle.max_speed > 14.0


def test_what_cannot_be_read_is_refused(tmp_path: Path, recorded_data: Path) -> None:
    (tmp_path / "broken.xml").write_text(BROKEN, encoding="utf-8")
    (tmp_path / "text.xml").write_text("no XML", encoding="utf-8")
    for name in ("broken.xml", "text.xml"):
        with pytest.raises(sp.ScenarioError, match=rf"{name}: 1 fault\n  \(the whole file\): not a CommonRoad file"):
            load_commonroad(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        load_commonroad(tmp_path / "nothing.xml")
    with pytest.raises(sp.ScenarioError, match=r"planningProblem = 7: must be one of \d+"):
        load_commonroad(file_of(recorded_data, "DEU_Ffb-1_1_T-1"), problem=7)


def test_command_plans_a_file(recorded_data: Path, tmp_path: Path) -> None:
    file = file_of(recorded_data, "DEU_Ffb-1_1_T-1")
    done = run("plan", file, "-o", tmp_path / "plan.json", "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["scenario"] == "DEU_Ffb-1_1_T-1"
    assert sp.Plan.load(tmp_path / "plan.json").stated_status == "certified"


@pytest.mark.parametrize(
    ("was", "put", "told"),
    [
        ("<y>2.0</y>", "<y>nan</y>", "lanelet[1].leftBound.point.y = 'nan': must be a number"),
        ("<exact>8.0</exact>", "<exact>1e400</exact>", "velocity.exact = '1e400': must be a number"),
        ("<length>4.0", "<length>x", "dynamicObstacle[2].shape.rectangle.length = 'x': must be a number"),
        ("<x>-20.0</x>", "<x>20.0</x>", "start.position = [0.0, 0.0]: must be at least"),
        ("</trajectory>", "", "not a CommonRoad file"),
        (
            "<time><exact>0</exact>",
            "<time><exact>0.5</exact>",
            "initialState.time.exact = '0.5': must be a whole number",
        ),
        ("<intervalStart>20", "<intervalStart>99", "goalState.time = ['99', '40']: must not end before it begins"),
        ("<intervalEnd>40</intervalEnd>", "", "goalState.time: must have one of exact, intervalStart and intervalEnd"),
        ("<center><x>24.0</x>", "<center>", "goalState.position.rectangle.center = ['y']: must have x and y"),
        ("<leftBound><point><x>-20.0</x><y>2.0</y></point>", "<leftBound>", "lanelet[1] = [3, 4]: must have as many"),
        ("<x>100.0</x>", "<x>100000000.0</x>", "a way along lanes"),
        ("<x>24.0</x>", "<x>24000000000.0</x>", "a way along lanes"),
        ("</point></position><velocity><exact>8.0", "</point></position><velocity><exact>8e6", "at its speed, must be"),
    ],
)
def test_faults_are_named_by_their_elements(was: str, put: str, told: str, tmp_path: Path) -> None:
    file = tmp_path / "road.xml"
    file.write_text(ROAD)
    load_commonroad(file)
    file.write_text(ROAD.replace(was, put))
    with pytest.raises(sp.ScenarioError) as caught:
        load_commonroad(file)
    assert told in str(caught.value) and str(file) in str(caught.value)


def test_a_lane_that_ends_before_the_vehicle_is_no_guide(tmp_path: Path) -> None:
    file = tmp_path / "road.xml"
    file.write_text(ROAD.replace("<rightBound><point><x>-20.0", "<rightBound><point><x>-20000000.0"))
    assert load_commonroad(file).guide is not None
