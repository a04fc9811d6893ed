"""A person comes along a corridor of 2.2 m."""

from benchmarks.everyday.motions import constant_velocity
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at


def make(seed: int) -> Scene:
    walker = person("walker", constant_velocity((14.0, 0.02 * seed), (-1.2, 0.0)))
    return Scene(ROBOT, (0.0, 0.0, 0.0, 0.0), [stop_at(15.0, 0.0)], [walker], 35.0, bounds=((-2.0, -1.1), (17.0, 1.1)))
