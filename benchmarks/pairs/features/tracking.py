"""Vehicle that is off its plan, by up to the tracking error."""

from __future__ import annotations

from benchmarks.hostile.features import Rng
from benchmarks.pairs.scene import Scene


def add(scene: Scene, rng: Rng) -> None:
    scene.margin = float(rng.uniform(0.05, 0.3)) * scene.vehicle["radius"]
    scene.settings["tracking_error"] = scene.margin
