"""Ten people walk along a walkway of 5 m in both directions, in lanes that are not straight."""

import math

import numpy as np

from benchmarks.everyday.motions import Array, Motion, Robot
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at


def _weaves(x: float, y: float, speed: float, width: float, phase: float) -> Motion:
    def at(time: float, robot: Robot | None) -> Array:
        return np.array([x + speed * time, y + width * math.sin(0.5 * time + phase)])

    return at


def make(seed: int) -> Scene:
    rng = np.random.default_rng(60 + seed)
    people = []
    for k in range(10):
        back = k % 2 == 0
        x = rng.uniform(8.0, 30.0) if back else rng.uniform(-12.0, 6.0)
        y, speed = (rng.uniform(0.2, 1.9) if back else rng.uniform(-1.9, -0.8)), rng.uniform(0.8, 1.4)
        people.append(person(f"p{k}", _weaves(x, y, -speed if back else speed, 0.15, rng.uniform(0.0, 2.0 * math.pi))))
    return Scene(ROBOT, (0.0, -0.6, 0.0, 0.0), [stop_at(20.0, -0.6)], people, 60.0, bounds=((-3.0, -2.5), (23.0, 2.5)))
