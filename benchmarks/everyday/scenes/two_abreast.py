"""Two people come side by side."""

from benchmarks.everyday.motions import constant_velocity
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at


def make(seed: int) -> Scene:
    shift = 0.05 * seed
    people = [person(name, constant_velocity((14.0, y + shift), (-1.2, 0.0))) for name, y in (("a", 0.4), ("b", -0.4))]
    return Scene(ROBOT, (0.0, 0.0, 0.0, 0.0), [stop_at(15.0, 0.0)], people, 50.0, bounds=((-2.0, -1.8), (17.0, 1.8)))
