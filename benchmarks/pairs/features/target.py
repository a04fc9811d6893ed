"""Moving target, of which the place is met, or the velocity, too."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.hostile.features import Rng
from benchmarks.pairs.scene import Scene


def add(scene: Scene, rng: Rng) -> None:
    """Let a target pass where the motion ends when it ends; with its velocity, if it ends moving."""
    motion, goal = scene.motion, scene.data["goal"]
    moves = scene.pieces[-1].profile.end > 0.0
    place, heading = np.array(goal.pop("position")), goal.pop("heading", None)
    goal["radius"] = float(rng.uniform(0.3, 1.0)) * scene.vehicle["radius"]
    if moves and rng.random() < 0.5:
        goal["match_velocity"] = True
        velocity = motion.velocity(motion.end)
    else:
        angle = float(rng.uniform(-math.pi, math.pi))
        speed = float(rng.uniform(0.1, 0.4)) * scene.vehicle["max_speed"]
        velocity = speed * np.array([math.cos(angle), math.sin(angle)])
        if heading is not None:
            seen, left, right = heading - angle, *rng.uniform(0.2, 0.8, 2)
            goal["approach"] = [float(seen - right), float(seen + left)]
    if rng.random() < 0.3:
        goal["offset"] = rng.normal(0.0, 0.5, 2).tolist()
    place = place - np.array(goal.get("offset") or (0.0, 0.0))
    if rng.random() < 0.7:
        first = (place - motion.duration * velocity).tolist()
        target = {"time": motion.start, "position": first, "velocity": velocity.tolist()}
    else:
        times = motion.start + motion.duration * np.array([0.0, 0.25, 0.5, 0.75, 1.0, 2.0, 4.0])
        target = {"time": times.tolist(), "position": (place + (times - motion.end)[:, None] * velocity).tolist()}
    goal["target"] = {"motion": target}
