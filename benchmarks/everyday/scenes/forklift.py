"""A forklift crosses, stops now and then, and drives on."""

import math

from benchmarks.everyday.motions import polyline
from benchmarks.everyday.scene import TRUCK, Scene, cart, stop_at


def make(seed: int) -> Scene:
    time, y = 0.0, -6.0 - 0.5 * seed
    points = [(time, 8.0, y)]
    for _ in range(4):
        points += [(time + 2.5, 8.0, y + 3.0), (time + 5.5, 8.0, y + 3.0)]
        time, y = time + 5.5, y + 3.0
    points.append((time + 10.0, 8.0, y + 14.0))
    truck = cart("forklift", polyline(points), 2.4, 1.2, heading=0.5 * math.pi)
    return Scene(TRUCK, (0.0, 0.0, 0.0, 0.0), [stop_at(16.0, 0.0)], [truck], 60.0)
