from __future__ import annotations

from pathlib import Path

import jsonschema
import numpy as np
import pytest

import scp_planner as sp
from scp_planner import files
from scp_planner.scenario import ready_made
from scp_planner.scenario.process_model import ProcessModel, SingerAcceleration
from scp_planner.tracking.confidence import StudentErrors
from scp_planner.tracking.kalman import estimate_process

TIMES = np.linspace(-1.9, 0.0, 20)


def pavement(model: object = None, people: int = 12) -> sp.Scenario:
    """A pavement with people on it, tracked for two seconds."""
    rng = np.random.default_rng(3)
    obstacles = []
    for k in range(people):
        velocity = rng.choice([-1, 1]) * rng.uniform(0.9, 1.5)
        position = [8.0 + 4.0 * k, rng.uniform(-1.6, 1.6)]
        seen = position + np.outer(TIMES, [velocity, 0.0]) + rng.normal(0.0, 0.06, (len(TIMES), 2))
        obstacle = {
            "id": f"person{k}",
            "shape": {"disc": 0.3},
            "observations": {"time": TIMES, "position": seen, "covariance": [[0.0036, 0.0], [0.0, 0.0036]]},
        }
        obstacles.append(obstacle if model is None else {**obstacle, "model": model})
    return sp.Scenario(
        vehicle={"radius": 0.4, "max_speed": 1.8, "max_acceleration": 0.8, "max_deceleration": 1.5},
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0},
        goal={"position": [58.0, 0.0]},
        obstacles=obstacles,
    )


@pytest.mark.parametrize("name", ready_made.NAMES)
def test_a_word_is_a_model_in_a_file_and_in_python(
    name: str, tmp_path: Path, scenario_schema: jsonschema.Draft202012Validator
) -> None:
    scenario = pavement(name, people=1)
    model = scenario.obstacles[0].model
    assert model == sp.Model.named(name) == sp.Model(process=name)
    assert model.process is not None and model.process.fitted_to is not None
    assert len(model.process.fitted_to.source) > 40
    scenario.save(tmp_path / "whole.yaml")
    assert sp.Scenario.load(tmp_path / "whole.yaml") == scenario
    for written in (name, {"process": name}):
        contents = scenario.to_dict()
        contents["obstacles"][0]["model"] = written
        scenario_schema.validate(contents)
        files.write(tmp_path / "short.yaml", contents)
        assert sp.Scenario.load(tmp_path / "short.yaml") == scenario


def test_figures_of_the_drone_and_bounds_of_the_ship_follow_from_what_is_cited() -> None:
    knots, length = 15 * 1852 / 3600, 10.0  # m/s; s to a length
    turn = knots**2 / (2.5 * length * knots)  # on half a tactical diameter of 5 lengths
    assert ready_made.ready_made("ship").max_acceleration == pytest.approx(turn, abs=0.005)
    assert ready_made.ready_made("ship").max_speed == pytest.approx(20 * 1852 / 3600, abs=0.05)
    top, tilted = 19.0, 9.81 * np.tan(np.pi / 6)
    process = ready_made.ready_made("drone").process
    assert isinstance(process, SingerAcceleration)
    assert process.deviation == pytest.approx(tilted / np.sqrt(3.0), abs=0.005)  # uniform up to the most
    assert process.time_constant == pytest.approx(top / tilted, abs=0.05)


def test_every_model_of_the_folder_has_its_word() -> None:
    folder = Path(ready_made.__file__).parent / "motion_models"
    assert {path.stem for path in folder.iterdir()} == set(ready_made.NAMES)


@pytest.mark.parametrize("written", ["pedestrain", {"process": "pedestrain"}])
def test_a_word_that_is_none_is_refused_with_the_nearest(written: object) -> None:
    with pytest.raises(sp.ScenarioError, match=r"pedestrian, cyclist, car, ship, drone; did you mean 'pedestrian'"):
        pavement(written, people=1)
    with pytest.raises(ValueError, match="did you mean 'ship'"):
        sp.Model.named("shipp")


def test_models_fit_what_they_are_named_for() -> None:
    """Each spreads about as far as its kind can get in 4 s, and no farther: half the width of the region at 95 %."""
    spread = {name: float(pointwise_radius(sp.Model.named(name).process, lead=4.0)) for name in ready_made.NAMES}
    assert 1.0 < spread["pedestrian"] < 4.0  # people walk 1.3 m/s
    assert spread["pedestrian"] < spread["cyclist"] < spread["car"]
    assert spread["car"] < 0.5 * 7.0 * 4.0**2  # all the grip of a road, for all the time
    assert spread["drone"] < 0.5 * 3.0 * 5.66 * 4.0**2


def pointwise_radius(process: ProcessModel | None, lead: float) -> float:
    """Of the region at 95 %, m, after 8 observations 0.4 s apart."""
    assert process is not None
    estimate = estimate_process(0.4 * np.arange(8), np.zeros((8, 2)), process)
    alpha = 0.05
    law = estimate.errors
    scale = law.pointwise_scale(alpha)
    assert isinstance(law, StudentErrors) == (process.tails is not None)
    return float(np.sqrt(scale * estimate.covariance(estimate.reference_time + lead)[0, 0]))


def test_late_people_by_name_take_far_less_room_than_by_default() -> None:
    """An acceleration that is believed grows with the square of the time, people do not."""
    default, named = (
        float(sp.zones(pavement(model))[0].support(34.0, np.array([0.0, 1.0]))) for model in (None, "pedestrian")
    )
    assert named < 0.5 * default


def test_the_same_fault_in_many_obstacles_is_told_once() -> None:
    with pytest.raises(sp.ScenarioError) as caught:
        pavement({"order": 3})
    assert len(caught.value.faults) == 12
    lines = str(caught.value).splitlines()
    assert len(lines) == 2
    assert lines[1].startswith("  obstacles[0].model.order = 3: must be at most 2")
    assert lines[1].endswith("(and so in 11 more: obstacles[1], obstacles[2], obstacles[3], ...)")
