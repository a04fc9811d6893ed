"""A queue of four people shuffles forward across the way."""

import math

import numpy as np

from benchmarks.everyday.motions import Array, Motion, Robot
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at


def _shuffles(y: float, period: float) -> Motion:
    def at(time: float, robot: Robot | None) -> Array:
        whole, part = divmod(time, period)
        return np.array([6.0, y + 0.4 * (whole + 0.5 * (1.0 - math.cos(math.pi * min(part, 1.0))))])

    return at


def make(seed: int) -> Scene:
    people = [person(f"p{k}", _shuffles(-2.0 + 1.0 * k, 3.0 + 0.2 * seed)) for k in range(4)]
    return Scene(ROBOT, (0.0, 0.0, 0.0, 0.0), [stop_at(12.0, 0.0)], people, 50.0, bounds=((-2.0, -6.0), (14.0, 6.0)))
