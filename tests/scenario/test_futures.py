"""Several futures of an obstacle in files: what is allowed, what is refused, and in which units."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from scenes import scene

import scp_planner as sp
from scp_planner.scenario.motions import Course, Future, Futures, Motion

FORK: dict[str, Any] = {
    "id": "fork",
    "shape": {"disc": 0.4},
    "motion": {
        "futures": [
            {"weight": 0.7, "motion": {"position": [9.0, -4.0], "velocity": [0.0, 1.0]}},
            {
                "weight": 0.3,
                "motion": {
                    "time": [0.0, 2.0, 6.0],
                    "position": [[9.0, -4.0], [10.0, -2.0], [13.0, 0.0]],
                    "covariance": [[0.04, 0.01], [0.01, 0.09]],
                },
            },
        ]
    },
}


def with_weights(*weights: Any) -> dict[str, Any]:
    """The obstacle with other weights."""
    fork = copy.deepcopy(FORK)
    for future, weight in zip(fork["motion"]["futures"], weights, strict=True):
        future["weight"] = weight
    return fork


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_futures_are_read_written_and_in_the_schema(
    suffix: str, tmp_path: Path, scenario_schema: jsonschema.Draft202012Validator
) -> None:
    scenario = scene(FORK)
    motion = scenario.obstacles[0].motion
    assert isinstance(motion, Futures)
    first, second = motion.futures
    assert isinstance(first.motion, Motion) and isinstance(second.motion, Course)
    path = tmp_path / f"fork{suffix}"
    scenario.save(path)
    assert sp.Scenario.load(path) == scenario
    scenario_schema.validate(json.loads(json.dumps(scenario.to_dict())))
    refused = scenario.to_dict()
    refused["obstacles"][0]["motion"]["futures"][0]["weight"] = -0.1
    with pytest.raises(jsonschema.ValidationError):
        scenario_schema.validate(refused)


def test_in_python_they_are_models() -> None:
    parts = [
        Future(weight=0.7, motion=Motion(position=(9.0, -4.0), velocity=(0.0, 1.0))),
        Future(weight=0.3, motion=Course(**FORK["motion"]["futures"][1]["motion"])),
    ]
    made = sp.Obstacle(id="fork", shape={"disc": 0.4}, motion=sp.Futures(futures=parts))
    assert scene().model_copy(update={"obstacles": (made,)}).obstacles == scene(FORK).obstacles


@pytest.mark.parametrize(
    ("weights", "path", "told"),
    [
        ((0.7, 0.2), "obstacles[0].motion.futures", "add up to 0.9"),
        ((0.7, 0.31), "obstacles[0].motion.futures", "add up to 1.01"),
        ((1.2, -0.2), "obstacles[0].motion.futures[1].weight", "-0.2"),
        ((0.7, float("nan")), "obstacles[0].motion.futures[1].weight", "nan"),
        ((0.7, "0.3"), "obstacles[0].motion.futures[1].weight", "0.3"),
        ((0.7, None), "obstacles[0].motion.futures[1].weight", "null"),
    ],
)
def test_weights_that_are_no_probabilities_are_refused_by_name(
    weights: tuple[float, float], path: str, told: str
) -> None:
    with pytest.raises(sp.ScenarioError) as caught:
        scene(with_weights(*weights))
    faults = [fault for fault in caught.value.faults if fault.path == path]
    assert faults, str(caught.value)
    assert told in str(caught.value)


def test_faults_of_their_motions_are_named() -> None:
    faulty = copy.deepcopy(FORK)
    faulty["motion"]["futures"][1]["motion"]["time"] = [0.0, 2.0, 1.0]
    faulty["motion"]["futures"][0]["probability"] = faulty["motion"]["futures"][0].pop("weight")
    with pytest.raises(sp.ScenarioError) as caught:
        scene(faulty)
    told = str(caught.value)
    assert "obstacles[0].motion.futures[1].motion.time" in told
    assert "obstacles[0].motion.futures[0]" in told
    assert "weight" in told
    with pytest.raises(sp.ScenarioError, match=r"motion\.futures"):
        scene({**FORK, "motion": {"futures": []}})


def test_rounding_of_weights_is_allowed() -> None:
    thirds = float(np.float32(1.0 / 3.0))
    futures = [{"weight": thirds, "motion": {"position": [9.0, k]}} for k in (3.0, 4.0, 5.0)]
    assert thirds * 3.0 != 1.0
    assert len(sp.zones(scene({**FORK, "motion": {"futures": futures}}))) == 3


def test_the_start_may_touch_what_is_only_possible() -> None:
    futures = [{"weight": weight, "motion": {"position": place}} for weight, place in ((0.5, [0, 0.5]), (0.5, [9, 9]))]
    assert len(scene({**FORK, "motion": {"futures": futures}}).obstacles) == 1
