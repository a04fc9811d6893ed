"""Places to pass on the way, in turn or in any order."""

from __future__ import annotations

import numpy as np

from benchmarks.hostile.features import Rng
from benchmarks.pairs.scene import Scene


def add(scene: Scene, rng: Rng) -> None:
    motion, radius = scene.motion, scene.vehicle["radius"]
    count = int(rng.integers(1, 4))
    for share in np.linspace(0.15, 0.85, count + 2)[1:-1] + rng.uniform(-0.05, 0.05, count):
        here = motion.poses(motion.start + share * motion.duration)[0]
        within = float(rng.uniform(0.5, 2.0)) * radius
        off = float(rng.uniform(0.0, 0.7)) * within
        angle = float(rng.uniform(-np.pi, np.pi))
        place = {"position": (here[:2] + off * np.array([np.cos(angle), np.sin(angle)])).tolist(), "radius": within}
        if rng.random() < 0.2:
            left, right = rng.uniform(0.3, 1.0, 2)
            place["heading_range"] = [float(here[2] - right), float(here[2] + left)]
        scene.data["goals"].append(place)
        scene.passed.append(motion.start + share * motion.duration)
    scene.data["goals_order"] = str(rng.choice(["given", "fastest"]))
