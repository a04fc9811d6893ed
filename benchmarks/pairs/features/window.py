"""Window of the arrival."""

from __future__ import annotations

from benchmarks.hostile.features import Rng
from benchmarks.pairs.scene import Scene


def add(scene: Scene, rng: Rng) -> None:
    motion, goal = scene.motion, scene.data["goal"]
    which = int(rng.integers(3))
    if which != 0:
        goal["earliest_arrival"] = motion.end - float(rng.uniform(0.0, 0.15)) * motion.duration
    if which != 1:
        goal["latest_arrival"] = motion.end + float(rng.uniform(0.0, 0.3)) * motion.duration
