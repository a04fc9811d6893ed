"""A sliding door opens after 6 s; the way round is long."""

from benchmarks.everyday.motions import Robot, constant_velocity
from benchmarks.everyday.scene import ROBOT, Scene, Walls, box, person, stop_at


def make(seed: int) -> Scene:
    frame = [box(5.0, 0.6, 5.2, 5.0), box(5.0, -5.0, 5.2, -0.6)]
    door = [*frame, box(5.0, -0.6, 5.2, 0.6)]

    def walls_at(time: float, robot: Robot) -> Walls:
        return frame if time >= 6.0 + 0.3 * seed else door

    walker = person("walker", constant_velocity((9.0, 3.0), (0.0, -0.4)))
    return Scene(
        ROBOT,
        (0.0, 0.0, 0.0, 0.0),
        [stop_at(10.0, 0.0)],
        [walker],
        50.0,
        walls=door,
        bounds=((-2.0, -5.0), (12.0, 5.0)),
        walls_at=walls_at,
    )
