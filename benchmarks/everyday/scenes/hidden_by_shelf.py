"""A person comes out between two shelves and is not seen before."""

from benchmarks.everyday.motions import Array, Robot, constant_velocity
from benchmarks.everyday.scene import ROBOT, Scene, box, person, stop_at


def _in_view(time: float, robot: Robot, place: Array) -> bool:
    return bool(place[1] < 1.0 or abs(robot.position[0] - place[0]) < 0.4)


def make(seed: int) -> Scene:
    walls = [box(0.0, 0.9, 5.4, 1.9), box(6.6, 0.9, 12.0, 1.9)]
    motion = constant_velocity((6.0, 5.0 + 0.1 * seed), (0.0, -1.0))
    walker = person("walker", motion, seen=_in_view)
    return Scene(
        ROBOT,
        (0.0, 0.0, 0.0, 0.0),
        [stop_at(12.0, 0.0)],
        [walker],
        40.0,
        walls=walls,
        bounds=((-2.0, -1.2), (14.0, 8.0)),
    )
