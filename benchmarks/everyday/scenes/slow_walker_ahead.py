"""A person walks ahead slowly in a corridor of 3.2 m."""

from benchmarks.everyday.motions import constant_velocity
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at


def make(seed: int) -> Scene:
    walker = person("walker", constant_velocity((2.5, 0.1 * (seed % 5) - 0.2), (0.5, 0.0)))
    return Scene(ROBOT, (0.0, 0.0, 0.0, 0.0), [stop_at(14.0, 0.0)], [walker], 45.0, bounds=((-2.0, -1.6), (16.0, 1.6)))
