"""A drone waits until another one has left the pad that it is to land on."""

from benchmarks.everyday.motions import polyline
from benchmarks.everyday.scene import DRONE, Agent, Scene, stop_at


def make(seed: int) -> Scene:
    leaves = 6.0 + 0.4 * seed
    way = [(0, 20, 0), (leaves, 20, 0), (leaves + 1, 20.5, 1), (leaves + 6, 26, 16)]
    other = Agent("other", {"disc": 0.4}, None, polyline(way))
    return Scene(DRONE, (0.0, 0.0, 0.0, 2.0), [stop_at(20.0, 0.0)], [other], 40.0, period=0.05, rate=20.0)
