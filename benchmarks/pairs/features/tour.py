"""Goals in turn: each is set when the vehicle arrives at the one before."""

from __future__ import annotations

from benchmarks.hostile.features import Rng
from benchmarks.pairs.scene import Scene


def add(scene: Scene, rng: Rng) -> None:
    """Begin with a goal on the way, and set that of the scene on arrival there."""
    scene.begin_with_goal_at(float(rng.uniform(0.3, 0.7)), None)
