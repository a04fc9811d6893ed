"""A drone crosses the courses of five others at one height, one of which circles."""

import numpy as np

from benchmarks.everyday.motions import circle, constant_velocity
from benchmarks.everyday.scene import DRONE, Agent, Scene, stop_at


def make(seed: int) -> Scene:
    rng = np.random.default_rng(80 + seed)
    shape = {"disc": 0.4}
    others = [Agent("circles", shape, None, circle((20.0, 0.0), 4.0, 3.0, float(rng.uniform(0.0, 6.0))))]
    for k in range(4):
        sign = 1.0 if k % 2 else -1.0
        place = rng.uniform(8.0, 36.0), sign * rng.uniform(8.0, 16.0)
        others.append(Agent(f"d{k}", shape, None, constant_velocity(place, (rng.uniform(-1.0, 1.0), -3.5 * sign))))
    return Scene(DRONE, (0.0, 0.0, 0.0, 0.0), [stop_at(42.0, 0.0)], others, 40.0, period=0.05, rate=20.0)
