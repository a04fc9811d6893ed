"""A car drives ahead at 0.5 m/s on a road of 10.5 m with one car that comes the other way."""

from benchmarks.everyday.motions import constant_velocity
from benchmarks.everyday.scene import CAR, Scene, car, pass_by


def make(seed: int) -> Scene:
    slow = car("slow", constant_velocity((25.0, -2.0), (0.5, 0.0)))
    other = car("other", constant_velocity((120.0 + 4.0 * seed, 3.2), (-9.0, 0.0)), heading=3.14159)
    return Scene(
        {**CAR, "max_speed": 12.0},
        (0.0, -2.0, 0.0, 6.0),
        [pass_by(90.0, -2.0, 2.0)],
        [slow, other],
        60.0,
        bounds=((-10.0, -5.25), (130.0, 5.25)),
        noise=0.05,
    )
