"""A car drives through a car park; a pedestrian walks along it, and a parked car sets out."""

from benchmarks.everyday.motions import SetsOut, constant_velocity, standing
from benchmarks.everyday.scene import CAR, Scene, car, pass_by, person, within


def make(seed: int) -> Scene:
    parked = [car(f"p{k}", standing((10.0 + 3.0 * k, 5.5)), heading=1.5708) for k in (0, 1, 3, 4)]
    leaves = car("leaves", SetsOut((16.0, 5.5), (0.0, -1.5), within(14.0 + 0.3 * seed), 1.5, 1.0), heading=-1.5708)
    walker = person("walker", constant_velocity((34.0, -1.8), (-1.2, 0.0)))
    return Scene(
        {**CAR, "max_speed": 6.0},
        (-4.0, 0.0, 0.0, 3.0),
        [pass_by(45.0, 0.0, 1.5)],
        [*parked, leaves, walker],
        50.0,
        bounds=((-12.0, -3.2), (55.0, 9.0)),
    )
