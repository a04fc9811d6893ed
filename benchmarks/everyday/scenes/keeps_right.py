"""A person comes along a corridor of 3 m and keeps to the right."""

from benchmarks.everyday.motions import polyline
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at


def make(seed: int) -> Scene:
    swerves = 3.0 + 0.3 * seed
    x = 14.0 - 1.2 * swerves
    way = [(0, 14, 0), (swerves, x, 0), (swerves + 1.5, x - 1.8, 0.7), (swerves + 20.0, x - 24.0, 0.7)]
    walker = person("walker", polyline(way))
    return Scene(ROBOT, (0.0, 0.0, 0.0, 0.0), [stop_at(15.0, 0.0)], [walker], 40.0, bounds=((-2.0, -1.5), (17.0, 1.5)))
