"""Somebody stands in a door for 10 s and then walks off."""

from benchmarks.everyday.motions import polyline
from benchmarks.everyday.scene import ROBOT, Scene, box, person, stop_at


def make(seed: int) -> Scene:
    leaves = 10.0 + 0.5 * seed
    way = [(0, 5.1, 0), (leaves, 5.1, 0), (leaves + 2, 7, 0.3), (leaves + 6, 8, 3.5)]
    walls = [box(5.0, 0.5, 5.2, 4.0), box(5.0, -4.0, 5.2, -0.5)]
    return Scene(
        ROBOT,
        (0.0, 0.0, 0.0, 0.0),
        [stop_at(10.0, 0.0)],
        [person("stander", polyline(way))],
        45.0,
        walls=walls,
        bounds=((-2.0, -4.0), (12.0, 4.0)),
    )
