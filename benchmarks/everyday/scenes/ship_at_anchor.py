"""A boat passes between a ship at anchor, reported every 3 min, and one under way, reported every 10 s."""

from benchmarks.everyday.motions import Array, Robot, constant_velocity, standing
from benchmarks.everyday.scene import BOAT, Agent, Scene, pass_by


def _seldom(time: float, robot: Robot, place: Array) -> bool:
    return time % 180.0 < 1e-6


def make(seed: int) -> Scene:
    anchored = Agent("anchored", {"disc": 15.0}, "ship", standing((500.0, 15.0 + 2.0 * seed)), seen=_seldom)
    moving = Agent("moving", {"disc": 12.0}, "ship", constant_velocity((900.0, -300.0), (-2.0, 1.0)))
    return Scene(
        BOAT,
        (0.0, 0.0, 0.0, 3.0),
        [pass_by(900.0, 0.0, 20.0)],
        [anchored, moving],
        500.0,
        period=1.0,
        rate=0.1,
        noise=3.0,
    )
