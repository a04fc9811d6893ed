"""Somebody who stands beside the way sets out across it when the robot is 2 m away."""

from benchmarks.everyday.motions import SetsOut
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at, within


def make(seed: int) -> Scene:
    side = 1.0 if seed % 2 == 0 else -1.0
    motion = SetsOut((6.0, 1.2 * side), (0.0, -1.2 * side), within(2.3 + 0.05 * seed))
    return Scene(ROBOT, (0.0, 0.0, 0.0, 0.0), [stop_at(12.0, 0.0)], [person("stander", motion)], 40.0)
