"""Shared by all tests: recorded data from outside the project, and a scenario to change."""

from __future__ import annotations

import copy
import functools
import gc
import logging
import os
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import hypothesis
import jsonschema
import pytest
import typer.main

import scp_planner as sp

DATA_VARIABLE = "SCP_PLANNER_DATA"

# The same examples every time: a test that fails for one developer fails for all. No deadline, as shared
# cores make single examples slow now and then.
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")

# What is compiled is kept, also where an environment forbids it: the tests start many programs.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# pyproject.toml makes warnings errors; this, numbers that overflow or are none in the programs that tests start, too.
os.environ.setdefault("PYTHONWARNINGS", "error::RuntimeWarning")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let a second run of the tests be a sample of them."""
    parser.addoption("--one-in", type=int, default=1, metavar="N", help="run the first of every N tests of each file")


@pytest.hookimpl(trylast=True)  # of those that the marks leave
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep the first of every N tests of each file: so each file is in the sample."""
    one_in, seen = config.getoption("one_in"), Counter[Path]()
    kept: list[pytest.Item] = []
    left_out: list[pytest.Item] = []
    for item in items:
        (left_out if seen[item.path] % one_in else kept).append(item)
        seen[item.path] += 1
    items[:] = kept
    config.hook.pytest_deselected(items=left_out)


def pytest_collection_finish() -> None:
    """Spare the garbage collector all that is loaded by now."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def command_line_made_once() -> Iterator[None]:
    """Typer makes all commands and options anew at each call, which takes longer than most calls."""
    with mock.patch("typer.testing._get_command", functools.cache(typer.main.get_command), create=True):
        yield


@pytest.fixture(autouse=True)
def log_level() -> Iterator[None]:
    """Restore the level of logging: commands that run in the tests' own process set it."""
    logger = logging.getLogger("scp_planner")
    level = logger.level
    yield
    logger.setLevel(level)


@pytest.fixture(scope="session")
def recorded_data() -> Path:
    """Folder of recorded motions; skips where there is none, but fails in CI."""
    folder = os.environ.get(DATA_VARIABLE)
    if folder:
        assert Path(folder).is_dir(), f"{DATA_VARIABLE} = {folder}: must be a folder"
        return Path(folder)
    if os.environ.get("CI") == "true":
        pytest.fail(f"{DATA_VARIABLE} must name the folder of recorded data in CI")
    pytest.skip(f"needs the recorded data: {DATA_VARIABLE} is not set")


@pytest.fixture(scope="session")
def reference_scenarios(recorded_data: Path) -> Path:
    """Folder of the reference scenarios, beside the recorded motions."""
    folder = recorded_data.parent / "scenarios"
    assert folder.is_dir()
    return folder


_SCENARIO: dict[str, Any] = {
    "schema": 1,
    "name": "two-crossers",
    "vehicle": {
        "radius": 0.3,
        "max_speed": 3.0,
        "max_acceleration": 1.5,
        "max_deceleration": 2.0,
        "max_lateral_acceleration": 2.0,
        "max_curvature": 1.0,
    },
    "start": {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0},
    "goal": {"position": [20.0, 0.0], "heading": None, "speed": None},
    "guide": [[0.0, 0.0], [10.0, 1.0], [20.0, 0.0]],
    "bounds": {"min": [-1.0, -9.0], "max": [21.0, 9.0]},
    "confidence": {"probability": 0.95, "level": "joint"},
    "obstacles": [
        {
            "id": "crosser",
            "shape": {"disc": 0.5},
            "motion": {"position": [10, -4], "velocity": [0, 1.2], "acceleration": [0, -0.1]},
        },
        {
            "id": "seen",
            "shape": {"rectangle": [1.2, 0.8]},
            "observations": {
                "time": [-0.5, -0.4, -0.3, -0.2, -0.1],
                "position": [[7.1, 3.0], [7.0, 2.9], [7.0, 2.8], [6.9, 2.7], [6.9, 2.6]],
                "covariance": [[0.01, 0.0], [0.0, 0.01]],
            },
            "model": {"order": 2, "prior": None},
        },
    ],
}


@pytest.fixture
def scenario_data() -> dict[str, Any]:
    """Contents of a valid scenario file, for a test to change."""
    return copy.deepcopy(_SCENARIO)


@pytest.fixture(scope="session")
def scenario_schema() -> jsonschema.Draft202012Validator:
    """The schema of scenarios, made once: that it is one is asked in a test of its own."""
    return jsonschema.Draft202012Validator(sp.Scenario.json_schema())
