"""The robot backs out of a dead end while somebody walks by."""

from benchmarks.everyday.motions import polyline
from benchmarks.everyday.scene import ROBOT, Scene, box, person, stop_at


def make(seed: int) -> Scene:
    late = 0.7 * seed
    way = [
        (late, -3.0, 0.0),
        (4 + late, 2.2, 0.0),
        (12 + late, 2.2, 0.0),
        (16 + late, -2.5, -2.0),
        (20 + late, -6.0, -4.0),
    ]
    walls = [box(0.0, 0.8, 6.0, 1.0), box(0.0, -1.0, 6.0, -0.8), box(6.0, -1.0, 6.2, 1.0)]
    vehicle = {**ROBOT, "max_curvature": 1.2, "reverse": {"max_speed": 0.8, "max_acceleration": 0.8}}
    walker = person("walker", polyline(way))
    return Scene(vehicle, (5.0, 0.0, 0.0, 0.0), [stop_at(-3.0, 3.0)], [walker], 45.0, walls=walls)
