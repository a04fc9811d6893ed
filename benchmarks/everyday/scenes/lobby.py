"""Eight people stand in two staggered rows across a lobby."""

import numpy as np

from benchmarks.everyday.motions import standing
from benchmarks.everyday.scene import ROBOT, Scene, person, stop_at


def make(seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    places = [(5.0, y) for y in (-2.25, -0.75, 0.75, 2.25)] + [(7.2, y) for y in (-3.0, -1.5, 0.0, 1.5)]
    sway = 0.0 if seed == 0 else 0.02
    people = [person(f"p{k}", standing((x + rng.uniform(-0.05, 0.05), y), sway, k)) for k, (x, y) in enumerate(places)]
    return Scene(ROBOT, (0.0, 0.0, 0.0, 0.0), [stop_at(11.0, 0.0)], people, 35.0, bounds=((-2.0, -3.4), (13.0, 3.1)))
