"""Three people stand together and chat in the middle of the way."""

import math

from benchmarks.everyday.motions import standing
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at


def make(seed: int) -> Scene:
    people = []
    for k in range(3):
        angle = 2.1 * k + 0.3 + 0.2 * seed
        place = 7.0 + 0.55 * math.cos(angle), 0.55 * math.sin(angle)
        people.append(person(f"p{k}", standing(place, 0.03, k)))
    return Scene(ROBOT, (0.0, 0.0, 0.0, 0.0), [stop_at(14.0, 0.0)], people, 50.0, bounds=((-2.0, -3.0), (16.0, 3.0)))
