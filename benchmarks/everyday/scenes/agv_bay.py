"""A cart comes along a narrow aisle with one bay, and does not react."""

from benchmarks.everyday.motions import constant_velocity
from benchmarks.everyday.scene import TRUCK, Scene, box, cart, stop_at


def make(seed: int) -> Scene:
    walls = [box(-3.0, 1.0, 6.0, 3.2), box(9.0, 1.0, 20.0, 3.2), box(-3.0, -1.6, 20.0, -1.0), box(6.0, 2.8, 9.0, 3.2)]
    other = cart("cart", constant_velocity((18.0 + 0.3 * seed, 0.0), (-0.8, 0.0)))
    return Scene(
        TRUCK,
        (0.0, 0.0, 0.0, 0.0),
        [stop_at(15.0, 0.0)],
        [other],
        60.0,
        walls=walls,
        bounds=((-2.9, -1.6), (20.0, 3.2)),
    )
