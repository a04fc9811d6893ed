"""Bad scenario files: refused with exit code 2, nothing written, and a message with file, key and value."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from command import run

from scp_planner import files
from scp_planner.errors import ScenarioError
from scp_planner.scenario.models import MOST_OBSTACLES, Scenario

DELETE = object()


def observed(**changes: Any) -> dict[str, Any]:
    return {f"obstacles.1.observations.{key}": value for key, value in changes.items()}


CASES: list[tuple[dict[str, Any], str]] = [
    # numbers
    ({"vehicle.radius": -0.3}, "vehicle.radius ... -0.3 ... greater than 0"),
    ({"vehicle.max_speed": 0}, "vehicle.max_speed ... 0 ... greater than 0"),
    ({"vehicle.discs": [1, 2]}, "vehicle.discs ... [1.0, 2.0] ... one entry that is 0"),
    ({"vehicle.discs": [0, 1, 1]}, "vehicle.discs[2] ... 1.0 ... must differ"),
    ({"vehicle.discs": []}, "vehicle.discs ... [] ... at least 1"),
    ({"vehicle.max_jerk": 0}, "vehicle.max_jerk ... 0 ... greater than 0"),
    ({"vehicle.max_curvature_rate": -1}, "vehicle.max_curvature_rate ... -1 ... greater than 0"),
    ({"vehicle.max_acceleration": float("nan")}, "vehicle.max_acceleration ... nan ... finite"),
    ({"goal.position": [float("inf"), 0]}, "goal.position[0] ... inf ... finite"),
    ({"start.heading": True}, "start.heading ... true ... number"),
    ({"vehicle.max_deceleration": "2"}, "vehicle.max_deceleration ... '2' ... number"),
    ({"start.speed": None}, "start.speed ... null ... number"),
    ({"start.time": {"s": 0}}, "start.time ... {'s': 0} ... number"),
    ({"goal.position": [10000000000000.0, 0]}, "goal.position[0] ... 10000000000000.0 ... at most"),
    ({"start.speed": -1.0}, "start.speed ... -1.0 ... at least 0"),
    ({"obstacles.0.margin": -0.1}, "obstacles[0].margin ... -0.1 ... at least 0"),
    ({"confidence.probability": 1}, "confidence.probability ... 1 ... less than 1"),
    ({"confidence.probability": 0.0}, "confidence.probability ... 0.0 ... greater than 0"),
    ({"obstacles.1.model.order": 3}, "obstacles[1].model.order ... 3 ... at most 2"),
    ({"obstacles.1.model.order": 1.5}, "obstacles[1].model.order ... 1.5 ... whole number"),
    ({"obstacles.1.model.order": True}, "obstacles[1].model.order ... true ... whole number"),
    # keys and structure
    ({"vehicle.radus": 0.3}, "vehicle.radus ... 0.3 ... did you mean 'radius'?"),
    ({"obstacle": []}, "obstacle ... [] ... did you mean 'obstacles'?"),
    ({"goal.xyz": 1}, "goal.xyz ... 1 ... position, heading, speed, radius"),
    ({"vehicle.radius": DELETE}, "vehicle.radius ... missing ... required"),
    ({"goal": DELETE}, "goal ... missing ... required"),
    ({"vehicle": 3}, "vehicle ... 3 ... mapping"),
    ({"start": [0, 0]}, "start ... [0, 0] ... mapping"),
    ({"obstacles": {"a": 1}}, "obstacles ... {'a': 1} ... list"),
    ({"goal.position": [1, 2, 3]}, "goal.position ... [1, 2, 3] ... at most 2"),
    ({"start.position": [1]}, "start.position ... [1] ... at least 2"),
    ({"start.position": []}, "start.position ... [] ... at least 2"),
    ({"confidence.level": "total"}, "confidence.level ... 'total' ... 'joint'"),
    ({"schema": 2}, "schema ... 2 ... must be 1"),
    ({"name": 7}, "name ... 7 ... text"),
    ({"obstacles.0.id": ""}, "obstacles[0].id ... '' ... not be empty"),
    ({"obstacles.1.model.prior": 0.3}, "obstacles[1].model.prior ... 0.3 ... mapping"),
    # the trip
    ({"goal.position": [0, 0], "guide": None}, "goal.position ... [0.0, 0.0] ... start's position"),
    ({"goal.radius": 25}, "goal.radius ... 25.0 ... less than 20"),
    ({"start.speed": 4}, "start.speed ... 4.0 ... at most vehicle.max_speed, 3 m/s"),
    ({"goal.speed": 3.5}, "goal.speed ... 3.5 ... at most vehicle.max_speed, 3 m/s"),
    ({"goal.latest_arrival": -1}, "goal.latest_arrival ... -1.0 ... later than start.time"),
    ({"goal.earliest_arrival": 0}, "goal.earliest_arrival ... 0.0 ... later than start.time"),
    (
        {"goal.earliest_arrival": 9, "goal.latest_arrival": 8.5},
        "goal.latest_arrival ... 8.5 ... must not be before earliest_arrival, 9 s",
    ),
    ({"start.acceleration": -3}, "start.acceleration ... -3.0 ... [-2, 1.5]"),
    ({"bounds.min": [-0.2, -9]}, "start.position ... [0.0, 0.0] ... [0.1, 20.7]"),
    ({"bounds.max": [20.2, 9]}, "goal.position ... [20.0, 0.0] ... [-0.7, 19.9]"),
    ({"bounds.max": [21, -10]}, "bounds.max[1] ... -10.0 ... greater than min"),
    ({"guide": [[1, 0], [20, 0]]}, "guide[0] ... [1.0, 0.0] ... start.position"),
    ({"guide": [[0, 0], [9, 0]]}, "guide[1] ... [9.0, 0.0] ... goal.position"),
    ({"guide": [[0, 0], [5, 0], [5, 0], [20, 0]]}, "guide[2] ... [5.0, 0.0] ... before it"),
    ({"guide": [[0, 0]]}, "guide ... [[0, 0]] ... at least 2"),
    ({"corridor": [[[-1, -1], [21, -1], [10, 0], [21, 1], [-1, 1]]]}, "corridor[0] ... [10.0, 0.0] ... must be convex"),
    (
        {"corridor": [[[-1, -1], [21, -1], [21, 1], [-1, 1]], [[0, 0], [1, 0], [2, 0]]]},
        "corridor[1] ... [2.0, 0.0] ... area",
    ),
    ({"corridor": []}, "corridor ... [] ... at least 1"),
    (
        {"corridor": [[[-1, -1], [9, -1], [9, 1], [-1, 1]], [[10, -1], [21, -1], [21, 1], [10, 1]]]},
        "corridor ... [10.0, -1.0] ... overlap",
    ),
    ({"corridor": [[[1, -1], [21, -1], [21, 1], [1, 1]]]}, "start.position ... [0.0, 0.0] ... in the corridor"),
    (
        {"corridor": [[[-1, -0.2], [5, -0.2], [5, 1], [-1, 1]], [[4, -1], [21, -1], [21, 1], [4, 1]]]},
        "start.position ... [0.0, 0.0] ... at least 0.3 m from the border of the corridor; it is 0.2 m",
    ),
    (
        {"corridor": [[[-1, -1], [21, -1], [21, 1], [-1, 1]]], "obstacles.0.id": "corridor"},
        "obstacles[0].id ... 'corridor' ... must not be",
    ),
    ({"speed_limits": [{"from": 5, "to": 4, "speed": 1}]}, "speed_limits[0].to ... 4.0 ... greater than from, 5"),
    ({"speed_limits": [{"from": 50, "speed": 1}]}, "speed_limits[0].from ... 50.0 ... the length of its line"),
    ({"speed_limits": [{"from": 5}]}, "speed_limits[0].speed ... missing ... required"),
    ({"speed_limits": [{"from": 5, "speed": 0}]}, "speed_limits[0].speed ... 0 ... greater"),
    ({"speed_limits": [{"from": 0, "speed": 0.5}]}, "start.speed ... 1.0 ... at most 0.5"),
    (
        {"goal.speed": 2, "speed_limits": [{"from": 15, "speed": 1.5}]},
        "goal.speed ... 2.0 ... the limit of speed_limits[0] there",
    ),
    (
        {"speed_limits": [{"from": 0, "to": 1, "speed": 1, "line": [[0, 5], [0, 5], [1, 5]]}]},
        "speed_limits[0].line[1] ... [0.0, 5.0] ... before it",
    ),
    # obstacles
    ({"obstacles.1.id": "crosser"}, "obstacles[1].id ... 'crosser' ... obstacles[0]"),
    (
        {"obstacles.0.motion": {"position": [0.7, 0]}},
        "start.position ... [0.0, 0.0] ... from obstacles[0] (crosser); it is 0.2 m",
    ),
    (
        {"obstacles.0.motion": {"time": [-1, 1], "position": [[0.5, -2], [0.9, 2]]}},
        "start.position ... [0.0, 0.0] ... from obstacles[0] (crosser); it is 0.2 m",
    ),
    (
        {"obstacles.0.motion": {"time": [0, 1], "position": [[9, 9], [9, 8]], "covariance": [[[1, 0], [0, 1]]]}},
        "obstacles[0].motion.covariance ... [[1.0, 0.0], [0.0, 1.0]] ... as many as time has entries, 2, not 1",
    ),
    (
        {"obstacles.0.motion": {"time": [0, 1], "position": [[9, 9], [9, 8]], "covariance": [[1, 2], [2, 1]]}},
        "obstacles[0].motion.covariance ... [[1.0, 2.0], [2.0, 1.0]] ... positive definite",
    ),
    ({"obstacles.0.motion": DELETE}, "obstacles[0].motion ... missing ... observations"),
    (
        {"obstacles.1.motion": {"position": [9, 9]}},
        "obstacles[1].observations ... -0.5 ... left out where motion is given",
    ),
    ({"obstacles.0.shape": {"disk": 1}}, "obstacles[0].shape.disk ... 1 ... 'disc'"),
    ({"obstacles.0.shape": {}}, "obstacles[0].shape ... {} ... exactly one of"),
    ({"obstacles.0.shape": {"cube": 1}}, "obstacles[0].shape ... 'cube' ... disc, rect"),
    (
        {"obstacles.0.shape": {"disc": 1, "rectangle": [1, 2]}},
        "obstacles[0].shape ... 'rectangle': [1, 2] ... exactly one of",
    ),
    ({"obstacles.0.shape": {"rectangle": [1, 0]}}, "obstacles[0].shape.rectangle[1] ... 0 ... greater than 0"),
    ({"obstacles.0.shape": {"ellipse": [-1, 2]}}, "obstacles[0].shape.ellipse[0] ... -1 ... greater than 0"),
    (
        {"obstacles.0.shape": {"polygon": [[0, 0], [1, 1]]}},
        "obstacles[0].shape.polygon ... [[0, 0], [1, 1]] ... at least 3",
    ),
    (
        {"obstacles.0.shape": {"polygon": [[0, 0], [1, 1], [2, 2]]}},
        "obstacles[0].shape.polygon ... [2.0, 2.0] ... area",
    ),
    (
        {"obstacles.0.shape": {"polygon": [[0, 0], [2, 2], [2, 0], [0, 1]]}},
        "obstacles[0].shape.polygon ... [0.0, 1.0] ... cross",
    ),
    (
        {"obstacles.0.shape": {"polygon": [[0, 0], [1, 0], [1, 0], [0, 1]]}},
        "obstacles[0].shape.polygon[2] ... [1.0, 0.0] ... differ",
    ),
    # observations
    (
        observed(time=[-0.5, -0.4, -0.45, -0.2, -0.1]),
        "obstacles[1].observations.time[2] ... -0.45 ... later than the time before it, -0.4 s",
    ),
    (
        observed(time=[-0.5, -0.4, -0.4, -0.2, -0.1]),
        "obstacles[1].observations.time[2] ... -0.4 ... later than the time before it",
    ),
    (
        {"obstacles.1.observations.position.3": [float("nan"), 1]},
        "obstacles[1].observations.position[3][0] ... nan ... finite",
    ),
    (
        observed(time=[-0.5, -0.4, -0.3, -0.2, 0.1]),
        "obstacles[1].observations.time[4] ... 0.1 ... later than start.time",
    ),
    (
        observed(time=[-0.5, -0.4, -0.3, -0.2, 1e-06]),
        "obstacles[1].observations.time[4] ... 1e-06 ... later than start.time",
    ),
    (
        observed(time=[-0.2, -0.1], position=[[7, 3], [7, 2.9]]),
        "obstacles[1].observations.time ... [-0.2, -0.1] ... at least 3 observations, not 2",
    ),
    (
        {
            "obstacles.1.observations": {
                "time": [-0.4, -0.3, -0.2, -0.1],
                "position": [[7.0, 2.9], [7.0, 2.8], [6.9, 2.7], [6.9, 2.6]],
            }
        },
        "obstacles[1].observations.time ... [-0.4, -0.3, -0.2, -0.1] ... at least 5 observations, not 4",
    ),
    (observed(time=[], position=[]), "obstacles[1].observations.time ... [] ... at least 3 observations, not 0"),
    (
        observed(position=[[7.0, 2.9], [7.0, 2.8], [6.9, 2.7]]),
        "obstacles[1].observations.position ... [6.9, 2.7] ... as many entries as time, 5, not 3",
    ),
    (
        observed(covariance=[[0.01, 0.001], [0.002, 0.01]]),
        "obstacles[1].observations.covariance ... [[0.01, 0.001], [0.002, 0.01]] ... symmetric",
    ),
    (
        observed(covariance=[[0.01, 0.02], [0.02, 0.01]]),
        "obstacles[1].observations.covariance ... [[0.01, 0.02], [0.02, 0.01]] ... positive definite",
    ),
    (
        observed(covariance=[[0.01, 0.01], [0.01, 0.01]]),
        "obstacles[1].observations.covariance ... [[0.01, 0.01], [0.01, 0.01]] ... positive definite",
    ),
    (
        observed(covariance=[[0, 0], [0, 0]]),
        "obstacles[1].observations.covariance ... [[0.0, 0.0], [0.0, 0.0]] ... positive definite",
    ),
    (
        observed(covariance=[[[0.01, 0], [0, 0.01]]] * 4 + [[[0.01, 0], [0, -0.01]]]),
        "obstacles[1].observations.covariance[4] ... [[0.01, 0.0], [0.0, -0.01]] ... positive definite",
    ),
    (
        observed(covariance=[[[0.01, 0], [0, 0.01]]] * 4),
        "obstacles[1].observations.covariance ... [[0.01, 0.0], [0.0, 0.01]] ... as many as time has entries, 5, not 4",
    ),
    (observed(covariance=[[0.01, 0]]), "obstacles[1].observations.covariance ... [[0.01, 0]] ... at least 2"),
]
"""What is changed in a valid file, and what the message must then say: path ... value ... what is allowed."""


def changed(data: dict[str, Any], change: dict[str, Any]) -> dict[str, Any]:
    for path, value in change.items():
        *steps, last = path.split(".")
        place: Any = data
        for step in steps:
            place = place[int(step)] if isinstance(place, list) else place[step]
        if value is DELETE:
            del place[last]
        elif isinstance(place, list):
            place[int(last)] = value
        else:
            place[last] = value
    return data


TEXTS = {
    "YAML syntax": (
        "bad.yaml",
        "schema: 1\nvehicle: [1, 2\nstart: 3\n",
        "line 3",
        "start: 3",
        "must be YAML",
    ),
    "YAML tabs": ("bad.yaml", "vehicle:\n\tradius: 1\n", "line 2", "radius: 1", "must be YAML"),
    "YAML tag": ("bad.yaml", "name: !!python/object:os.system x\n", "line 1", "os.system", "must be YAML"),
    "YAML repeated key": ("bad.yaml", "obstacles:\n- id: a\n  id: b\n", "obstacles[0].id", "'b'", "line 3"),
    "YAML number as a key": ("bad.yaml", "goal: {3: 4}\n", "goal[3]", "3", "keys must be text"),
    "YAML of two documents": ("bad.yaml", "name: a\n---\nname: b\n", "line 2", "---", "must be YAML"),
    "YAML without end": ("bad.yaml", "guide: &a [*a]\n", "guide", "[[[...", "at least 2"),
    "YAML of many aliases": (
        "bad.yaml",
        "a: &a [1, 2, 3, 4, 5, 6, 7, 8, 9]\n"
        + "".join(f"{b}: &{b} [{', '.join(9 * [f'*{a}'])}]\n" for a, b in pairwise("abcdefghi")),
        "line 6",
        "*e",
        "100,000 values by its aliases",
    ),
    "YAML nested deeply": ("bad.yaml", "name: " + "[" * 99999 + "]" * 99999, "line 1", "[[[[", "nested"),
    "empty": ("bad.yaml", "", "(the whole file)", "null", "mapping"),
    "list": ("bad.yaml", "- 1\n- 2\n", "(the whole file)", "[1, 2]", "mapping"),
    "JSON syntax": ("bad.json", '{"schema": 1,\n "name": }', "line 2", '"name": }', "must be JSON"),
    "JSON repeated key": ("bad.json", '{"start": {"time": 1, "time": 2}}', "start.time", "2", "only once"),
    "JSON NaN": ("bad.json", '{"vehicle": {"radius": NaN}}', "vehicle.radius", "nan", "finite"),
    "JSON number too long": (
        "bad.json",
        '{"schema": ' + "1" * 5000 + "}",
        "(the whole file)",
        "1111",
        "must be JSON",
    ),
    "JSON nested deeply": ("bad.json", "[" * 99999, "(the whole file)", "[[[[", "nested"),
    "unknown suffix": ("bad.toml", "schema = 1\n", "file name", "'bad.toml'", ".yaml, .yml, .json"),
}


def assert_refused(file: Path, path: str, value: str, allowed: str) -> None:
    """Plan the file on the command line with all that could be written, and read the message."""
    folder = file.parent / "written"
    folder.mkdir()
    options = ["-o", str(folder / "plan.json"), "--plot", str(folder / "plan.png"), "--json"]
    result = run("plan", file, *options)
    assert result.exit_code == 2, result.output
    assert not list(folder.iterdir())
    assert result.stdout == ""
    first, *lines = result.stderr.splitlines()
    assert str(file) in first
    line = next(line for line in lines if line.strip().startswith((f"{path} =", f"{path}:")))
    assert value in line
    assert allowed in line


@pytest.mark.parametrize(("change", "said"), CASES, ids=[said for _, said in CASES])
def test_one_fault_is_named_with_file_key_and_value(
    change: dict[str, Any], said: str, scenario_data: dict[str, Any], tmp_path: Path
) -> None:
    """On the command line and in Python; a fault of one key makes no check of another one complain."""
    data = changed(scenario_data, change)
    file = tmp_path / "bad.yaml"
    file.write_text(yaml.safe_dump(data))
    path, value, allowed = said.split(" ... ")
    assert_refused(file, path, value, allowed)
    with pytest.raises(ScenarioError) as caught:
        Scenario(**data)
    (fault,) = caught.value.faults
    assert fault.path == path and value in str(fault) and allowed in str(fault)


@pytest.mark.parametrize("name", TEXTS)
def test_text_that_is_no_scenario_is_refused(name: str, tmp_path: Path) -> None:
    file_name, text, path, value, allowed = TEXTS[name]
    file = tmp_path / file_name
    file.write_text(text)
    assert_refused(file, path, value, allowed)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "bad.yaml"
    file.write_bytes(b"name: caf\xe9\n")
    assert_refused(file, "(the whole file)", "b'\\xe9'", "UTF-8 text; byte 9 is not")


def test_a_file_that_is_missing_is_refused_by_name(tmp_path: Path) -> None:
    result = run("plan", tmp_path / "none.yaml", "-o", tmp_path / "plan.json")
    assert result.exit_code == 2
    assert f"{tmp_path / 'none.yaml'}: No such file or directory" in result.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
def test_a_file_of_too_many_obstacles_is_refused_before_it_is_parsed(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "read", None)
    one = '{"id": "o", "shape": {"disc": 1.0}, "motion": {"position": [0.0, 9.0]}}'
    file = tmp_path / f"many{suffix}"
    file.write_text('{"schema": 1, "obstacles": [\n' + ",\n".join([one] * (MOST_OBSTACLES + 1)) + "]}")
    with pytest.raises(ScenarioError, match=rf"obstacles: too many: about {MOST_OBSTACLES + 1}; .* {MOST_OBSTACLES}"):
        Scenario.load(file)


@pytest.mark.parametrize("place", ["start", "goal"])
@pytest.mark.parametrize(("heading", "told"), [(90.0, True), (-45.0, True), (3.2, False), (-7.0, False)])
def test_a_heading_that_is_almost_certainly_degrees_is_told_of(
    place: str, heading: float, told: bool, scenario_data: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    scenario_data[place]["heading"] = heading
    Scenario(**scenario_data)
    assert ("almost certainly degrees" in caplog.text) == told
