"""What commands are given that cannot be: refused with what is allowed before anything is done, and nothing written."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
import yaml
from command import run
from scenes import observed

from scp_planner import builtin

CASES = {
    "plan easy.yaml": {
        "--view space-time": "needs --plot",
        "--view profiles --plot plan.html": "--plot must end in one of .pdf, .png, .svg",
        "--view globe --plot plan.png": "'globe' is not one of",
        "--solver gurobi": "--solver ... gurobi ... daqp, ",
        "--method magic": "--method ... magic ... scp ... penalty-descent",
        "--method penalty-descent --solver osqp": "--solver ... osqp ... solves no subproblems",
        "--time-limit 0": "--time-limit: 0 ... greater than 0",
        "--time-limit nan": "--time-limit: nan ... finite",
        "--time-limit soon": "Invalid value for ... --time-limit",
        "--seed -1": "--seed ... -1: must be at least 0",
        "--samples 1": "--samples ... 1: must be at least 2",
        "-o no/such/folder/plan.json": "--output: no/such/folder/plan.json ... must exist",
        "-o .": "--output: .: must not be a folder",
        "-o easy.yaml": "--output: easy.yaml: must not be the scenario file",
        "--plot plan.doc": "--plot: plan.doc ... .png",
        "--plot plan": "--plot ... .html",
        "--plot no/such/plan.png": "--plot: no/such/plan.png ... must exist",
        "--colour": "--colour",
        "-o out --set path_spam=2": "path_spam = '2': there is no such setting; did you mean 'path_span'?",
        "-o out --set path_span=0": "path_span = 0.0: must be a number, above 0, up to 1e+12 m",
        "-o out --set iterations=2": "there is no such setting; did you mean 'max_iterations'?",
        "-o out --set path_span": "path_span: must be NAME=VALUE",
        "--model pedestrian": "no obstacle whose motion is to be estimated",
    },
    "plan seen.yaml": {"--model pedestrain": "did you mean 'pedestrian'"},
    "plan builtin:crosing": {"": "'crosing' ... 'crossing'"},
    "check seen.yaml plan.json": {"--model pedestrain": "did you mean 'pedestrian'"},
    "check easy.yaml plan.json": {"--model pedestrian": "no obstacle whose motion is to be estimated"},
    "simulate seen.yaml": {"--model pedestrain": "did you mean 'pedestrian'"},
    "simulate easy.yaml": {
        "--model pedestrian": "no obstacle whose motion is to be estimated",
        "-o out --set period=1": "period: --rate gives the period",
        "-o out --set foresigt=2": "did you mean 'foresight'?",
        "-o out --set iterations=0": "iterations = 0: must be a whole number, 1 to 1000",
    },
    "compare easy.yaml": {
        "-o out --set path_spam=2": "did you mean 'path_span'?",
        "--starts 0": "--starts ... 0: must be at least 1",
        "--method magic": "--method ... magic ... l-bfgs",
        "--plot trials.html": "--plot: trials.html ... .svg",
        "-o no/such/trials.csv": "--output: no/such/trials.csv ... must exist",
        "none.yaml": "none.yaml: No such file or directory",
    },
    "study consistency": {
        "--repetitions 1": "1: must be at least 2",
        "--workers 0": "0: must be at least 1",
        "-o no/such/folder": "must exist",
    },
    "study coverage": {
        "--probability 1.5": "1.5",
        "--runs 0": "0: must be at least 1",
        "nothing.csv": "nothing.csv",
        "--model pedestrian": "TRACKS",
    },
    "batch scenarios": {
        "--workers 0": "0: must be at least 1",
        "--workers 2 --dask tcp://127.0.0.1:1": "not with --dask",
        "--pattern *.yml": "holds no scenario files like *.yml",
        **{f"--pattern {odd}": "must be of paths within" for odd in ("/", "/x/*", "**x", "../*", ".", "./")},
        "--set path_spam=2": "did you mean 'path_span'?",
        "--solver gurobi": "gurobi",
        "--dask nowhere": "Dask",
        "-o no/such/t.csv": "must exist",
        "--plans scenarios/headon.yaml": "must be a folder",
    },
    "batch nowhere": {"": "must be a folder"},
}
"""By command and options, what the message says, with dots for what is between."""


@pytest.fixture
def folder(easy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    seen = yaml.safe_load(easy.read_text()) | {"obstacles": [observed("seen", 0)]}
    (tmp_path / "seen.yaml").write_text(yaml.safe_dump(seen))
    (tmp_path / "scenarios").mkdir()
    builtin.load("headon").save(tmp_path / "scenarios" / "headon.yaml")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("command", "said"), [(f"{words} {options}", said) for words, of in CASES.items() for options, said in of.items()]
)
def test_what_cannot_be_is_refused_before_anything_is_done(command: str, said: str, folder: Path) -> None:
    before = {path: path.read_bytes() for path in folder.rglob("*.yaml")}
    result = run(*shlex.split(command))
    assert (result.exit_code, result.stdout) == (2, "")
    told = " ".join(result.stderr.split())
    for words in said.split(" ... "):
        assert words in told, told
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
