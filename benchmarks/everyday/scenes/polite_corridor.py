"""Three people come along a corridor of 2.4 m and slow down in front of the robot."""

from benchmarks.everyday.motions import Polite
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at


def make(seed: int) -> Scene:
    people = [
        person(f"p{k}", Polite((11.0 + 2.5 * k, (-1) ** k * 0.45), (-6.0, (-1) ** k * 0.55), 1.0 + 0.03 * seed))
        for k in range(3)
    ]
    return Scene(ROBOT, (0.0, 0.0, 0.0, 0.0), [stop_at(15.0, 0.0)], people, 50.0, bounds=((-2.0, -1.4), (17.0, 1.4)))
