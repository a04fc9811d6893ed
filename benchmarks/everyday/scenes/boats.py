"""A boat crosses a fairway among three ships that are reported every 3 s."""

from benchmarks.everyday.motions import constant_velocity
from benchmarks.everyday.scene import BOAT, Agent, Scene, pass_by


def make(seed: int) -> Scene:
    ships = [
        Agent("a", {"disc": 12.0}, "ship", constant_velocity((250.0, -300.0 - 15.0 * seed), (0.0, 4.0))),
        Agent("b", {"disc": 12.0}, "ship", constant_velocity((400.0, 380.0 + 15.0 * seed), (-0.5, -4.0))),
        Agent("c", {"disc": 10.0}, "ship", constant_velocity((620.0, 20.0), (-2.5, 0.0))),
    ]
    return Scene(
        BOAT,
        (0.0, 0.0, 0.0, 3.0),
        [pass_by(600.0, 0.0, 15.0)],
        ships,
        400.0,
        period=1.0,
        rate=1.0 / 3.0,
        noise=3.0,
    )
