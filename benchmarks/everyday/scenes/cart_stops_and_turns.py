"""A cart drives ahead in a warehouse aisle, stops twice, and turns into a side aisle."""

from benchmarks.everyday.motions import polyline
from benchmarks.everyday.scene import TRUCK, Scene, box, cart, stop_at


def make(seed: int) -> Scene:
    late = 0.5 * seed
    way = [(0, 3, 0), (4, 6, 0), (7 + late, 6, 0), (11 + late, 9.5, 0), (13 + late, 9.5, 0), (18 + late, 11, -3.5)]
    walls = [box(-2.0, 1.5, 20.0, 2.0), box(-2.0, -2.0, 9.8, -1.5), box(12.2, -2.0, 20.0, -1.5)]
    return Scene(TRUCK, (0.0, 0.0, 0.0, 0.0), [stop_at(17.0, 0.0)], [cart("cart", polyline(way))], 60.0, walls=walls)
