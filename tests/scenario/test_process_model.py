"""Files of motion models, and scenarios that hold or name one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import ClassVar

import pytest

from scp_planner.errors import MotionModelError, ScenarioError
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.process_model import ProcessModel, Tails

TAILS = Tails(degrees_of_freedom=4.0, lead_time=(0.4, 1.2, 2.4, 4.8), inflation=(0.8, 0.6, 0.5, 0.4))
KINDS = {
    "random_walk": {"diffusion": 0.2},
    "mean_reverting": {"diffusion": 0.2, "time_constant": 1.5},
    "singer": {"deviation": 0.6, "time_constant": 0.8},
    "random_walk_acceleration": {"diffusion": 0.2, "acceleration_deviation": 0.4},
}
KIND = pytest.mark.parametrize("kind", list(KINDS))


def model(kind: str = "random_walk", tails: Tails | None = None) -> ProcessModel:
    process = {"kind": kind, **KINDS[kind]}
    return ProcessModel(process=process, velocity_deviation=1.3, noise_deviation=0.1, tails=tails)


class TestFile:
    @KIND
    @pytest.mark.parametrize("suffix", ["yaml", "json"])
    @pytest.mark.parametrize("tails", [None, TAILS])
    def test_keeps_every_bit(self, tmp_path: Path, kind: str, suffix: str, tails: Tails | None) -> None:
        path = tmp_path / f"walkers.{suffix}"
        original = ProcessModel(
            process={"kind": kind, **{k: v / 3 for k, v in KINDS[kind].items()}},
            velocity_deviation=1 / 3,
            noise_deviation=0.1,
            tails=tails,
        )
        original.save(path)
        assert ProcessModel.load(path) == original

    @pytest.mark.parametrize(
        ("text", "messages"),
        [
            ("schema: 2\n", ["schema = 2: must be 1", "process: missing", "velocity_deviation: missing"]),
            ("process: {kind: brownian, diffusion: 1}\n", ["one of random_walk, mean_reverting, singer"]),
            ("process: {kind: singer, deviation: 1}\n", ["process.time_constant: missing"]),
            ("process: {kind: random_walk, diffusion: -1}\n", ["process.diffusion = -1: must be greater than 0"]),
            ("process: {kind: random_walk, difusion: 1}\n", ["process.difusion = 1: unknown key"]),
            (
                "tails: {degrees_of_freedom: .nan, lead_time: [1, 1], inflation: [1]}\n",
                ["tails.degrees_of_freedom = nan", "tails.lead_time[1] = 1.0: must be", "tails.inflation"],
            ),
            ("tails: {degrees_of_freedom: 4, lead_time: [], inflation: []}\n", ["tails.lead_time"]),
            ("- 1\n", ["must be a mapping"]),
        ],
    )
    def test_names_every_fault(self, tmp_path: Path, text: str, messages: list[str]) -> None:
        path = tmp_path / "walkers.yaml"
        path.write_text(text)
        with pytest.raises(MotionModelError) as caught:
            ProcessModel.load(path)
        for message in messages:
            assert message in str(caught.value)
        assert str(path) in str(caught.value)


class TestScenario:
    data: ClassVar = {
        "vehicle": {"radius": 0.3, "max_speed": 2.0, "max_acceleration": 1.0, "max_deceleration": 1.0},
        "start": {"time": 3.0, "position": [0, 0], "heading": 0.0, "speed": 1.0},
        "goal": {"position": [20, 0]},
    }

    def write(self, folder: Path, model: str) -> Path:
        obstacle = {
            "id": "a",
            "shape": {"disc": 0.3},
            "observations": {"time": [0.0, 1.0], "position": [[10, 1], [10, 1.5]]},
        }
        text = json.dumps({**self.data, "obstacles": [obstacle]})
        path = folder / "crowd.json"
        path.write_text(text.replace('"id": "a"', f'"id": "a", "model": {model}'))
        return path

    def test_names_a_file_beside_it(self, tmp_path: Path) -> None:
        (tmp_path / "models").mkdir()
        model("singer", TAILS).save(tmp_path / "models" / "walkers.yaml")
        scenario = Scenario.load(self.write(tmp_path, '{"process": "models/walkers.yaml"}'))
        assert scenario.obstacles[0].model.process == model("singer", TAILS)
        scenario.save(tmp_path / "copy.yaml")  # which holds the model itself
        assert Scenario.load(tmp_path / "copy.yaml") == scenario

    def test_holds_the_model_itself(self, tmp_path: Path) -> None:
        text = model("mean_reverting").model_dump_json(by_alias=True)
        scenario = Scenario.load(self.write(tmp_path, f'{{"process": {text}}}'))
        assert scenario.obstacles[0].model.process == model("mean_reverting")

    @pytest.mark.parametrize(
        ("given", "message"),
        [
            ('{"process": "nobody.yaml"}', "obstacles[0].model.process = 'nobody.yaml': must be the name of a file"),
            ('{"process": "bad.yaml"}', "obstacles[0].model.process (bad.yaml).noise_deviation: missing"),
            ('{"process": 3}', "obstacles[0].model.process = 3"),
            ('{"process": "good.yaml", "prior": {"velocity_deviation": 1}}', "obstacles[0].model.prior"),
            ('{"order": 1, "prior": {}}', "obstacles[0].model.prior: must give velocity_deviation"),
        ],
    )
    def test_faults_are_named(self, tmp_path: Path, given: str, message: str) -> None:
        model().save(tmp_path / "good.yaml")
        (tmp_path / "bad.yaml").write_text("process: {kind: random_walk, diffusion: 1}\nvelocity_deviation: 1\n")
        with pytest.raises(ScenarioError) as caught:
            Scenario.load(self.write(tmp_path, given))
        assert message in str(caught.value)
