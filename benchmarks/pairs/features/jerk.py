"""Limit of the jerk."""

from __future__ import annotations

from benchmarks.hostile.features import Rng
from benchmarks.pairs.scene import Scene


def add(scene: Scene, rng: Rng) -> None:
    scene.vehicle["max_jerk"] = float(rng.uniform(1.0, 5.0)) * scene.vehicle["max_acceleration"]
