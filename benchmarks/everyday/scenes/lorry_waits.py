"""A lorry stands on the right half of a road while two cars come the other way."""

from benchmarks.everyday.motions import constant_velocity, standing
from benchmarks.everyday.scene import CAR, Agent, Scene, car, pass_by


def make(seed: int) -> Scene:
    lorry = Agent("lorry", {"rectangle": [8.0, 2.4]}, "car", standing((35.0, -1.75)))
    cars = [
        car(f"c{k}", constant_velocity((70.0 + 30.0 * k + 3.0 * seed, 1.75), (-8.0, 0.0)), heading=3.14159)
        for k in (0, 1)
    ]
    return Scene(
        {**CAR, "max_speed": 10.0},
        (0.0, -1.75, 0.0, 8.0),
        [pass_by(80.0, -1.75, 1.5)],
        [lorry, *cars],
        60.0,
        bounds=((-10.0, -3.5), (160.0, 3.5)),
        noise=0.05,
    )
