"""The robot goes to and fro for a minute in a room where six people walk from one place to another."""

import numpy as np

from benchmarks.everyday.motions import RandomPlaces
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at


def make(seed: int) -> Scene:
    speeds = np.random.default_rng(seed).uniform(0.7, 1.3, 6)
    people = [
        person(f"p{k}", RandomPlaces(np.random.default_rng(100 * seed + k), (0.5, 0.5), (11.5, 7.5), float(speed)))
        for k, speed in enumerate(speeds)
    ]
    goals = [stop_at(10.5, 4.0), stop_at(1.5, 4.0)]
    return Scene(ROBOT, (1.5, 4.0, 0.0, 0.0), goals, people, 60.0, bounds=((0.0, 0.0), (12.0, 8.0)))
