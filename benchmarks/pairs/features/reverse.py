"""Reverse gear: back out of where the vehicle stands, or back into the goal."""

from __future__ import annotations

import math

from benchmarks.hostile.features import Rng
from benchmarks.pairs.motion import USED, Drive
from benchmarks.pairs.scene import Scene, lead_in, lead_out


def add(scene: Scene, rng: Rng) -> None:
    vehicle = scene.vehicle
    vehicle["reverse"] = {"max_speed": float(rng.uniform(0.3, 0.8)) * vehicle["max_speed"]}
    length = float(rng.uniform(3.0, 8.0)) * vehicle["radius"]
    bend = float(rng.uniform(-1.0, 1.0)) * min(USED * vehicle["max_curvature"], 0.5 * math.pi / length)
    leg = Drive(((length, bend),), gear=-1.0)
    if rng.random() < 0.5:
        lead_in(scene, leg)
    else:
        lead_out(scene, leg)
        scene.heads = True
