"""The goal is 0.75 m beside a person who stands."""

from benchmarks.everyday.motions import standing
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at


def make(seed: int) -> Scene:
    side = 1.0 if seed % 2 == 0 else -1.0
    return Scene(
        ROBOT, (0.0, 0.0, 0.0, 0.0), [stop_at(8.0, 0.0)], [person("stander", standing((8.0, 0.75 * side)))], 40.0
    )
