"""Eight people cross a hall in both directions and keep their courses."""

import numpy as np

from benchmarks.everyday.motions import constant_velocity
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at


def make(seed: int) -> Scene:
    rng = np.random.default_rng(40 + seed)
    people = []
    for k in range(8):
        up = k % 2 == 0
        speed = rng.uniform(0.9, 1.4)
        place = rng.uniform(2.5, 12.5), (-1.0 if up else 1.0) * rng.uniform(3.0, 9.0)
        people.append(person(f"p{k}", constant_velocity(place, (rng.uniform(-0.2, 0.2), speed if up else -speed))))
    return Scene(ROBOT, (0.0, 0.0, 0.0, 0.0), [stop_at(15.0, 0.0)], people, 50.0)
