"""Scenarios that several files of tests hand to commands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml


@pytest.fixture
def easy(scenario_data: dict[str, Any], tmp_path: Path) -> Path:
    """A scenario whose one obstacle stays out of the way."""
    scenario_data |= {
        "name": "easy",
        "guide": None,
        "bounds": None,
        "obstacles": [{"id": "far", "shape": {"disc": 1.0}, "motion": {"position": [10, 50]}}],
    }
    file = tmp_path / "easy.yaml"
    file.write_text(yaml.safe_dump(scenario_data))
    return file


@pytest.fixture
def hopeless(easy: Path, scenario_data: dict[str, Any], tmp_path: Path) -> Path:
    """A scenario whose goal lies under an obstacle that never moves."""
    scenario_data["name"] = "hopeless"
    scenario_data["obstacles"] = [{"id": "on-goal", "shape": {"disc": 2.0}, "motion": {"position": [20, 0.5]}}]
    file = tmp_path / "hopeless.yaml"
    file.write_text(yaml.safe_dump(scenario_data))
    return file
