"""Faults of scenarios that are found together, in files and in Python."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scenes import scene

import scp_planner as sp
from scp_planner.errors import MISSING, ScenarioError
from scp_planner.scenario.models import Observations, Obstacle, Scenario, Vehicle
from scp_planner.scenario.shapes import Disc


def paths_of(error: ScenarioError) -> list[str]:
    return [fault.path for fault in error.faults]


def test_all_faults_of_a_file_are_in_one_message(scenario_data: dict[str, Any], tmp_path: Path) -> None:
    scenario_data["vehicle"] |= {"radius": -1, "max_speed": "3", "width": 2}
    scenario_data["start"]["speed"] = True
    del scenario_data["goal"]["position"]
    scenario_data["confidence"]["level"] = "all"
    scenario_data["obstacles"][0] |= {"id": "seen", "shape": {"disc": 0}}
    scenario_data["obstacles"][1]["observations"]["time"][4] = 3.0
    scenario_data["obstacles"][1]["observations"]["covariance"] = [[1, 2], [2, 1]]
    scenario_data["obstacles"][1]["colour"] = "red"
    file = tmp_path / "many.yaml"
    file.write_text(yaml.safe_dump(scenario_data) + "name: again\n")
    with pytest.raises(ScenarioError) as caught:
        Scenario.load(file)
    assert set(paths_of(caught.value)) == {
        "name",
        "vehicle.radius",
        "vehicle.max_speed",
        "vehicle.width",
        "start.speed",
        "goal.position",
        "confidence.level",
        "obstacles[0].shape.disc",
        "obstacles[1].id",
        "obstacles[1].observations.time[4]",
        "obstacles[1].observations.covariance",
        "obstacles[1].colour",
    }
    message = str(caught.value)
    assert message.startswith(f"{file}: 12 faults\n")
    assert message.count("\n") == 12


def test_checks_across_parts_run_beside_faults_of_other_parts(scenario_data: dict[str, Any]) -> None:
    """A faulty deceleration hides neither the excessive speed nor the start inside an obstacle."""
    scenario_data["vehicle"]["max_deceleration"] = -2
    scenario_data["start"]["speed"] = 7
    scenario_data["obstacles"][0] = {
        "id": "on top",
        "shape": {"disc": 1},
        "motion": {"position": [0, 0]},
        "model": {"order": 9},
    }
    with pytest.raises(ScenarioError) as caught:
        Scenario(**scenario_data)
    assert set(paths_of(caught.value)) == {
        "vehicle.max_deceleration",
        "start.speed",
        "start.position",
        "obstacles[0].model.order",
    }


def test_a_missing_value_is_told_from_null(scenario_data: dict[str, Any]) -> None:
    del scenario_data["start"]["speed"]
    scenario_data["start"]["time"] = None
    with pytest.raises(ScenarioError) as caught:
        Scenario(**scenario_data)
    assert {fault.path: fault.value for fault in caught.value.faults} == {
        "start.speed": MISSING,
        "start.time": None,
    }


def test_parts_raise_the_same_error() -> None:
    with pytest.raises(ScenarioError, match=r"Vehicle: 1 fault\n  radius = -1: must be greater than 0"):
        Vehicle(radius=-1, max_speed=3, max_acceleration=1, max_deceleration=1)
    with pytest.raises(ScenarioError, match="either motion or observations"):
        Obstacle(id="a", shape=Disc(disc=1.0))


def test_values_are_shortened_in_messages() -> None:
    with pytest.raises(ScenarioError) as caught:
        Observations(time=range(100_000), position=[[0.0, 0.0]] * 9999)
    assert max(map(len, str(caught.value).splitlines())) < 200


def test_the_error_survives_pickling(scenario_data: dict[str, Any]) -> None:
    scenario_data["vehicle"]["radius"] = -1
    with pytest.raises(ScenarioError) as caught:
        Scenario(**scenario_data)
    again = pickle.loads(pickle.dumps(caught.value))
    assert isinstance(again, ScenarioError)
    assert str(again) == str(caught.value)
    assert again.faults == caught.value.faults
    assert caught.value.__context__ is None  # some ways of pickling take it along, and cannot read it again


def test_the_start_may_touch_what_is_gone_by_then(scenario_data: dict[str, Any]) -> None:
    """Where an obstacle is at the start counts, not where it was at t = 0."""
    scenario_data["obstacles"] = [
        {"id": "a", "shape": {"disc": 0.5}, "motion": {"time": 0.0, "position": [0, 0], "velocity": [0, 1]}}
    ]
    scenario_data["start"]["time"] = 3.0
    assert Scenario(**scenario_data).start.time == 3.0
    scenario_data["start"]["time"] = 0.5
    with pytest.raises(ScenarioError, match=r"from obstacles\[0\]"):
        Scenario(**scenario_data)


MODELS_SEEN: tuple[dict[str, Any], ...] = (
    {},
    {"order": 1},
    {
        "process": {
            "process": {"kind": "random_walk", "diffusion": 0.1},
            "velocity_deviation": 1.0,
            "noise_deviation": 0.1,
        }
    },
)


@pytest.mark.parametrize("model", MODELS_SEEN, ids=["acceleration", "velocity", "process"])
@pytest.mark.parametrize(("start", "step"), [(0.0, 0.1), (0.0, 1e-3), (1.6e9, 0.1), (-3.0, 0.1), (0.0, 50.0)])
def test_observations_up_to_the_start_but_for_rounding_are_taken(
    model: dict[str, Any], start: float, step: float
) -> None:
    """The last time of a range is the start but for rounding, or some digits of a clock after it."""
    times = np.arange(start - 20 * step, start + 0.5 * step, step)
    times[-1] = start + max(1e-14 * step, np.spacing(start))
    assert times[-1] > start
    positions = [[12.0 - 0.5 * (t - start), 6.0 + 0.2 * ((7 * k) % 5)] for k, t in enumerate(times)]
    seen: dict[str, Any] = {
        "id": "seen",
        "shape": {"disc": 0.4},
        "observations": {"time": times.tolist(), "position": positions, "covariance": [[0.01, 0.0], [0.0, 0.01]]},
        "model": model,
    }
    scenario = scene(seen, start={"time": start})
    zone = sp.zones(scenario)[0]
    assert np.isfinite(zone.center(np.array([start, start + 1.0]))).all()
    late = [*times[:-1].tolist(), start + 1e-3 * step] if start < 1e9 else [*times[:-1].tolist(), start + 1e-3]
    seen["observations"] = {**seen["observations"], "time": late}
    with pytest.raises(sp.ScenarioError, match=r"time\[20\] = .* must not be later than start"):
        scene(seen, start={"time": start})


# What sessions give in place of what is meant: arrays and tables, typing errors, values of other kinds


def test_arrays_and_tables_are_taken_wherever_lists_are() -> None:
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"t": [-1.0, -0.5, 0.0], "x": [9.0, 9.0, 9.0], "y": [9.0, 8.0, 7.0]})
    rows = [np.array([9.0, y]) for y in (9.0, 8.0, 7.0)]
    plain = sp.Observations(time=[-1.0, -0.5, 0.0], position=[[9.0, 9.0], [9.0, 8.0], [9.0, 7.0]])
    assert sp.Observations(time=table.t, position=table[["x", "y"]]) == plain
    assert sp.Observations(time=table.t.to_numpy(), position=rows) == plain


def test_a_part_is_changed_by_copying_it() -> None:
    vehicle = scene().vehicle
    with pytest.raises(ValueError, match=r"Vehicle.max_speed is frozen; model_copy\(update="):
        vehicle.max_speed = 2.0  # type: ignore[misc]
    with pytest.raises(sp.ScenarioError, match=r"max_sped = 2.0: unknown key; did you mean 'max_speed'"):
        vehicle.model_copy(update={"max_sped": 2.0})
    with pytest.raises(sp.ScenarioError, match=r"goal.position\[0\] = 'far': must be a number"):
        scene().model_copy(update={"goal": {"position": ["far", 0.0]}})
    assert scene().model_copy(update={"goal": {"position": [15.0, 1.0]}}).goal == sp.Goal(position=(15.0, 1.0))


@pytest.mark.parametrize("call", [sp.plan, sp.zones, sp.simulate, sp.Planner, lambda it: sp.certify(it, it)])
def test_what_is_no_scenario_is_refused_by_name(call: Callable[[Any], object]) -> None:
    for given in (dict[str, object](), "warehouse.yaml"):
        with pytest.raises(TypeError, match=r"scenario: must be a Scenario, not (dict|str); "):
            call(given)
    with pytest.raises(TypeError, match="plan: must be a Plan or a SampledTrajectory, not dict"):
        sp.certify(scene(), {})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="time_limit: -1"):
        sp.plan(scene(), time_limit=-1)


def test_headings_of_shapes_in_degrees_are_told_of(caplog: pytest.LogCaptureFixture) -> None:
    sp.Rectangle(rectangle=(4.0, 2.0), heading=45.0)
    assert "almost certainly degrees; 45 degrees are 0.7854 rad" in caplog.text


def test_a_planner_refuses_an_obstacle_in_the_same_words() -> None:
    with pytest.raises(sp.ScenarioError, match=r"shape.disk = 0.3: unknown key; did you mean 'disc'"):
        sp.Planner(scene()).add_obstacle("bob", {"disk": 0.3})
