"""A car turns from a side road into a road with five cars that do not react."""

import math

from benchmarks.everyday.motions import constant_velocity
from benchmarks.everyday.scene import CAR, Scene, car, pass_by


def make(seed: int) -> Scene:
    first = -70.0 - 4.0 * (seed % 5)
    cars = [car(f"c{k}", constant_velocity((first + 28.0 * k, 0.0), (8.0, 0.0))) for k in range(5)]
    corridor = [
        [[-3.0, -40.0], [3.0, -40.0], [3.0, 0.0], [-3.0, 0.0]],
        [[-3.0, -12.0], [3.0, -12.0], [14.0, -2.5], [14.0, 2.5], [2.0, 2.5]],
        [[2.0, -2.5], [120.0, -2.5], [120.0, 2.5], [2.0, 2.5]],
    ]
    return Scene(
        {**CAR, "max_speed": 10.0},
        (0.0, -35.0, 0.5 * math.pi, 6.0),
        [pass_by(90.0, 0.0)],
        cars,
        60.0,
        corridor=corridor,
        guide=[[0.0, -35.0], [0.0, -10.0], [3.0, -3.0], [10.0, 0.0], [90.0, 0.0]],
        noise=0.05,
    )
