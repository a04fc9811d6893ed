"""Deadline of each replan."""

from __future__ import annotations

from benchmarks.hostile.features import Rng
from benchmarks.pairs.scene import Scene


def add(scene: Scene, rng: Rng) -> None:
    scene.deadline = float(rng.choice([0.02, 0.05, 0.1]))
