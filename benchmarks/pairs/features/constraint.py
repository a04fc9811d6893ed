"""User's convex constraint: how long the trip takes at least, or on which side of a line its path stays."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.hostile.features import Rng
from benchmarks.pairs.scene import Scene


def add(scene: Scene, rng: Rng) -> None:
    motion = scene.motion
    if rng.random() < 0.5:
        scene.least_time = float(rng.uniform(0.6, 1.0)) * motion.duration
        return
    angle = float(rng.uniform(-math.pi, math.pi))
    normal = np.array([math.cos(angle), math.sin(angle)])
    scene.bound = normal, float((motion.position(scene.times) @ normal).max()) + 0.5 * scene.vehicle["radius"]
