"""Folders of scenarios that several files of tests plan."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from batches import STRANGE_NAMES

from scp_planner import builtin


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Four scenarios, one of them no good."""
    target = tmp_path / "scenarios"
    target.mkdir()
    for name in ("crossing", "headon"):
        builtin.load(name).save(target / f"{name}.yaml")
    builtin.load("overtaking").save(target / "overtaking.json")
    (target / "broken.yaml").write_text("schema: 1\nspeed: 3\n")
    (target / "notes.txt").write_text("no scenario")
    return target


@pytest.fixture
def strange(folder: Path) -> Path:
    """A folder of scenarios whose files have names that few would give."""
    text = (folder / "crossing.yaml").read_bytes()
    shutil.rmtree(folder)
    folder.mkdir()
    try:
        for name in STRANGE_NAMES:
            (folder / os.fsdecode(name)).write_bytes(text)
    except OSError:
        pytest.skip("a file system that takes no such names")
    return folder
