"""Scenarios: what is read is what was meant, and what is saved is what is read again."""

from __future__ import annotations

import json
import math
import pickle
import stat
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scp_planner import builtin, files
from scp_planner.errors import ScenarioError
from scp_planner.scenario.models import ConfidenceLevel, Goal, Observations, Obstacle, Scenario, Start, Vehicle
from scp_planner.scenario.motions import Motion
from scp_planner.scenario.shapes import Disc, Ellipse, PolygonShape, Rectangle

SUFFIXES = (".yaml", ".yml", ".json")


def said(data: Any, whole: Any) -> bool:
    """True if all that is in the data is in a whole: keys of mappings, entries of lists, and values."""
    if isinstance(data, dict):
        return all(said(value, whole[key]) for key, value in data.items())
    if isinstance(data, list | tuple):
        return len(data) == len(whole) and all(map(said, data, whole))
    return bool(data == whole)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_load_reads_every_field(suffix: str, scenario_data: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / f"scenario{suffix}"
    file.write_text(json.dumps(scenario_data) if suffix == ".json" else yaml.safe_dump(scenario_data))
    scenario = Scenario.load(file)
    assert said(scenario_data, scenario.model_dump(by_alias=True))
    crosser, seen = scenario.obstacles
    assert (crosser.shape, seen.shape) == (Disc(disc=0.5), Rectangle(rectangle=(1.2, 0.8)))
    assert isinstance(crosser.motion, Motion) and crosser.motion.time == 0.0
    assert (crosser.observations, seen.motion) == (None, None)


def test_what_may_be_left_out_has_defaults() -> None:
    scenario = Scenario(
        vehicle={"radius": 0.3, "max_speed": 3, "max_acceleration": 1.5, "max_deceleration": 2},
        start={"time": 0, "position": [0, 0], "speed": 0},
        goal={"position": [5, 0]},
        obstacles=[{"id": "a", "shape": {"disc": 1}, "motion": {"position": [3, 3]}}],
    )
    standing = {"time": 0.0, "velocity": (0.0, 0.0), "acceleration": (0.0, 0.0)}
    defaults = {
        "schema": 1,
        "vehicle": {"max_lateral_acceleration": None, "max_curvature": None},
        "start": {"heading": None, "acceleration": None},
        "goal": {"heading": None, "speed": None, "radius": 0.0},
        "guide": None,
        "bounds": None,
        "confidence": {"probability": 0.95, "level": "joint"},
        "obstacles": [{"motion": standing, "margin": 0.0, "model": {"order": 2}}],
    }
    assert said(defaults, scenario.model_dump(by_alias=True))


def test_numbers_are_stored_as_floats(scenario_data: dict[str, Any]) -> None:
    scenario_data["vehicle"]["radius"] = 1
    scenario_data["bounds"] = None
    radius = Scenario(**scenario_data).vehicle.radius
    assert type(radius) is float


@pytest.mark.parametrize(
    ("text", "expected"),
    [("1e-3", 0.001), ("+2", 2.0), (".5", 0.5), ("5.", 5.0), ("1E2", 100.0), ("010", 10.0), ("1.5e+1", 15.0)],
)
def test_yaml_numbers_are_read_as_yaml_1_2_has_them(text: str, expected: float, tmp_path: Path) -> None:
    file = tmp_path / "numbers.yaml"
    file.write_text(f"number: {text}\n")
    assert files.read(file) == ({"number": expected}, [])


@pytest.mark.parametrize("text", ["no", "on", "Yes", "y", "1:30", "2020-01-01", "0x1F", "1_000", "nan", "e5"])
def test_other_yaml_words_are_text(text: str, tmp_path: Path) -> None:
    file = tmp_path / "words.yaml"
    file.write_text(f"word: {text}\n")
    assert files.read(file) == ({"word": text}, [])


def test_numpy_arrays_are_taken_in_python() -> None:
    times = np.linspace(-1.0, 0.0, 5)
    observations = Observations(time=times, position=np.column_stack([times, 2 * times]), covariance=np.eye(2))
    assert observations.time == (-1.0, -0.75, -0.5, -0.25, 0.0)
    assert observations.position[0] == (-1.0, -2.0)
    assert observations.covariance == ((1.0, 0.0), (0.0, 1.0))
    assert Start(time=np.float64(0), position=np.zeros(2), speed=np.float32(1)).speed == 1.0


def test_enough_observations_are_enough(scenario_data: dict[str, Any]) -> None:
    seen = scenario_data["obstacles"][1]
    for order, covariance, least in [(0, True, 1), (1, True, 2), (2, True, 3), (0, False, 3), (2, False, 5)]:
        times = [-0.1 * k for k in range(least, 0, -1)]
        seen["model"]["order"] = order
        seen["observations"] = {
            "time": times,
            "position": [[7 + t, 3] for t in times],
            "covariance": [[0.01, 0], [0, 0.01]] if covariance else None,
        }
        assert Scenario(**scenario_data).obstacles[1].model.order == order
        seen["observations"]["time"] = times[1:]
        seen["observations"]["position"] = [[7, 3]] * (least - 1)
        with pytest.raises(ScenarioError, match=f"at least {least} observations, not {least - 1}"):
            Scenario(**scenario_data)


def test_models_and_dictionaries_mix(scenario_data: dict[str, Any]) -> None:
    whole = Scenario(**scenario_data)
    mixed = Scenario(**{**scenario_data, "vehicle": whole.vehicle, "obstacles": list(whole.obstacles)})
    assert mixed == whole
    inside = Obstacle(id="x", shape=Disc(disc=3.0), motion=Motion(position=(0.0, 0.0)))
    with pytest.raises(ScenarioError, match=r"from obstacles\[0\] \(x\); it is 0 m"):
        Scenario(**{**scenario_data, "obstacles": [inside]})


def test_a_scenario_survives_pickling(scenario_data: dict[str, Any]) -> None:
    scenario = Scenario(**scenario_data)
    assert pickle.loads(pickle.dumps(scenario)) == scenario


numbers = st.floats(-1e6, 1e6)
positive = st.floats(1e-6, 1e6)
points = st.tuples(numbers, numbers)
words = st.text(min_size=1, max_size=20).filter(lambda text: not any("\ud800" <= c <= "\udfff" for c in text))
shapes = st.one_of(
    st.builds(Disc, disc=st.floats(0.01, 2.0)),
    st.builds(Rectangle, rectangle=st.tuples(st.floats(0.01, 2.0), st.floats(0.01, 2.0))),
    st.builds(Ellipse, ellipse=st.tuples(st.floats(0.01, 2.0), st.floats(0.01, 2.0))),
    st.builds(
        lambda a, b, h: PolygonShape(polygon=((-a, 0.0), (b, 0.0), (0.0, h))),
        st.floats(0.1, 2.0),
        st.floats(0.1, 2.0),
        st.floats(0.1, 2.0),
    ),
)


@st.composite
def observations(draw: st.DrawFn) -> Observations:
    times = draw(st.lists(st.floats(-100.0, -5.0), min_size=5, max_size=9, unique=True))
    sigmas = draw(st.tuples(positive, positive, st.floats(-0.99, 0.99)))
    matrix = (
        (sigmas[0] ** 2, sigmas[2] * sigmas[0] * sigmas[1]),
        (sigmas[2] * sigmas[0] * sigmas[1], sigmas[1] ** 2),
    )
    return Observations(
        time=sorted(times),
        position=draw(st.lists(points, min_size=len(times), max_size=len(times))),
        covariance=draw(st.sampled_from([None, matrix, (matrix,) * len(times)])),
    )


@st.composite
def obstacles(draw: st.DrawFn) -> list[Obstacle]:
    names = draw(st.lists(words, max_size=4, unique=True))
    far = st.tuples(st.floats(100.0, 1e6), numbers)
    return [
        draw(
            st.builds(Obstacle, id=st.just(name), shape=shapes, observations=observations(), margin=st.just(0.25))
            | st.builds(Obstacle, id=st.just(name), shape=shapes, motion=st.builds(Motion, position=far))
        )
        for name in names
    ]


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    goal = draw(points.filter(lambda point: math.hypot(*point) > 1))
    speed = draw(positive)
    return Scenario(
        name=draw(words),
        vehicle=Vehicle(
            radius=draw(st.floats(0.01, 10.0)),
            max_speed=speed,
            max_acceleration=draw(positive),
            max_deceleration=draw(positive),
            max_lateral_acceleration=draw(st.none() | positive),
            max_curvature=draw(st.none() | positive),
        ),
        start=Start(time=0.0, position=(0.0, 0.0), heading=draw(st.none() | numbers), speed=draw(st.floats(0, speed))),
        goal=Goal(position=goal, heading=draw(st.none() | numbers)),
        guide=draw(st.sampled_from([None, ((0.0, 0.0), (goal[0] / 3, goal[1] / 7 + 0.1), goal)])),
        confidence={
            "probability": draw(st.floats(0.01, 0.99)),
            "level": draw(st.sampled_from(ConfidenceLevel)),
        },
        obstacles=draw(obstacles()),
    )


@given(scenario=scenarios(), suffix=st.sampled_from(SUFFIXES))
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
def test_load_gives_back_what_save_wrote(
    scenario: Scenario, suffix: str, tmp_path: Path, scenario_schema: jsonschema.Draft202012Validator
) -> None:
    file = tmp_path / f"scenario{suffix}"
    scenario.save(file)
    again = Scenario.load(file)
    assert again == scenario
    assert again.model_dump_json() == scenario.model_dump_json()  # to the last bit: -0.0 is not 0.0
    if suffix == ".json":
        scenario_schema.validate(json.loads(file.read_text()))


@given(text=st.text(min_size=1))
@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_text_survives_yaml(text: str, tmp_path: Path) -> None:
    file = tmp_path / "text.yaml"
    files.write(file, {"text": text})
    assert files.read(file) == ({"text": text}, [])
    assert yaml.safe_load(file.read_text(encoding="utf-8")) == {"text": text}  # for readers of YAML 1.1 too


def test_save_replaces_a_file_as_a_whole(scenario_data: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "scenario.yaml"
    file.write_text("before")
    file.chmod(0o640)
    Scenario(**scenario_data).save(file)
    assert Scenario.load(file).name == "two-crossers"
    assert stat.S_IMODE(file.stat().st_mode) == 0o640
    assert [entry.name for entry in tmp_path.iterdir()] == ["scenario.yaml"]


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "scenario.json"
    file.write_text("before")

    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OSError, match="disk full"):
        files.write(file, {"name": "after"})
    assert file.read_text() == "before"
    assert [entry.name for entry in tmp_path.iterdir()] == ["scenario.json"]


def test_save_refuses_other_suffixes(scenario_data: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"'scenario\.txt': must end in one of \.yaml, \.yml, \.json"):
        Scenario(**scenario_data).save(tmp_path / "scenario.txt")
    assert not list(tmp_path.iterdir())


def test_json_schema_is_a_schema_that_accepts_scenarios(scenario_data: dict[str, Any]) -> None:
    schema = Scenario.json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    validator.validate(scenario_data)
    for name in builtin.names():
        validator.validate(builtin.load(name).to_dict())


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("schema", 2),
        ("vehicle.radius", -1),
        ("vehicle.radius", "1"),
        ("vehicle.radus", 1),
        ("start.position", [1, 2, 3]),
        ("confidence.level", "all"),
        ("obstacles.0.shape", {"disc": 1, "rectangle": [1, 2]}),
        ("obstacles.0.shape", {}),
        ("obstacles.0.motion", None),
        ("obstacles.1.motion", {"position": [9, 9]}),
        ("obstacles.1.observations.covariance", [[1, 0]]),
        ("obstacles.1.model.order", 3),
    ],
)
def test_json_schema_refuses(
    path: str, value: Any, scenario_data: dict[str, Any], scenario_schema: jsonschema.Draft202012Validator
) -> None:
    *steps, last = path.split(".")
    place: Any = scenario_data
    for step in steps:
        place = place[int(step)] if isinstance(place, list) else place[step]
    place[last] = value
    assert not scenario_schema.is_valid(scenario_data)


def test_reference_scenarios_load_save_and_match_the_schema(
    reference_scenarios: Path, tmp_path: Path, scenario_schema: jsonschema.Draft202012Validator
) -> None:
    found = [file for file in sorted(reference_scenarios.glob("*.json")) if file.name != "best_known.json"]
    assert len(found) >= 50
    for place, file in enumerate(found[::3]):
        scenario_schema.validate(json.loads(file.read_text()))
        scenario = Scenario.load(file)
        for suffix in SUFFIXES if place % 7 == 0 else [".json"]:  # YAML takes its time
            scenario.save(tmp_path / f"copy{suffix}")
            assert Scenario.load(tmp_path / f"copy{suffix}") == scenario


def test_built_in_scenarios_load_by_name() -> None:
    assert set(builtin.names()) >= {"crossing", "headon", "overtaking", "radar"}
    for name in builtin.names():
        assert builtin.load(name).name == name
