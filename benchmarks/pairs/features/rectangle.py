"""Vehicle that is a rectangle, covered by three discs."""

from __future__ import annotations

from benchmarks.hostile.features import Rng
from benchmarks.pairs.scene import Scene


def add(scene: Scene, rng: Rng) -> None:
    apart = float(rng.uniform(0.6, 1.2)) * scene.vehicle["radius"]
    first = float(rng.choice([0.0, -1.0]))  # the reference point is at the rear, or in the middle
    scene.vehicle["discs"] = [first * apart, (first + 1.0) * apart, (first + 2.0) * apart]
