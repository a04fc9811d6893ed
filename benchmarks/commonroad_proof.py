"""That no car of CommonRoad solves ZAM_Merge-1_1 as KS: by how much its middle misses the goal, at least.

Velocities (of the rear axle, over a step h) and the middle's place are those of a convex problem that every trip
satisfies, whatever borders, traffic and steering allow:

- the velocity changes by at most A h, where A bounds the acceleration (friction circle);
- by the power P its square is at most 10^2 + 2 P t (what accelerates by A below the switching speed has no more power);
- the mean of a step is off that of its ends by at most A h / 4;
- at the end the heading, and with it the velocity, forwards or backwards, is within 0.17453 rad of the x-axis; the
  middle is the rear axle's distance ahead.

So the least distance from the goal's rectangle is a bound, at each time at which the goal may be reached::

    python -m benchmarks.commonroad_proof
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.formats.commonroad.cars import CARS

cp: Any = import_module("cvxpy")  # its types leave out most of what is used here

CAR = CARS["BMW_320i"]
SPEED, HEADING = 10.0, -0.979
STEP, LAST = 0.1, 23
FINENESS = 5
"""Steps of the bound in one of the file."""


@dataclass(frozen=True)
class Goal:
    """A rectangle that the middle of the car has to be in, and how far its heading may be off the x-axis."""

    middle: tuple[float, float] = (21.0, -26.5)
    length: float = 8.1405
    width: float = 2.7135
    turn: float = -0.28186
    allowed: float = 0.17453

    @property
    def axes(self) -> Array:
        """The directions of the sides, (2, 2)."""
        along, across = np.cos(self.turn), np.sin(self.turn)
        return np.array([[along, across], [-across, along]])


GOAL = Goal()


def least_miss(time: float, steps: int, ahead: float = 1.0, goal: Goal = GOAL) -> float:
    """Bound how far from the goal's rectangle the middle of the car is at a time, m.

    Parameters
    ----------
    time : float
        s.
    steps : int
    ahead : float
        1 if it drives forwards at the end, -1 if backwards.
    goal : Goal

    Returns
    -------
    float
    """
    h, most = time / steps, CAR.acceleration
    velocity, mean, heading, miss = cp.Variable((steps + 1, 2)), cp.Variable((steps, 2)), cp.Variable(2), cp.Variable()
    first = np.array([np.cos(HEADING), np.sin(HEADING)])
    energy = SPEED**2 + 2.0 * most * CAR.switching_speed * h * np.arange(steps + 1)
    ends = 0.5 * (velocity[1:] + velocity[:-1])
    place = h * cp.sum(mean, axis=0) + CAR.rear_axle * (heading - first)
    beyond = goal.axes @ (place - np.array(goal.middle))
    over = cp.hstack([cp.pos(cp.abs(beyond[0]) - 0.5 * goal.length), cp.pos(cp.abs(beyond[1]) - 0.5 * goal.width)])
    kept = [
        velocity[0] == SPEED * first,
        cp.norm(velocity[1:] - velocity[:-1], 2, axis=1) <= most * h,
        cp.norm(velocity, 2, axis=1) <= np.sqrt(energy),
        cp.norm(mean - ends, 2, axis=1) <= 0.25 * most * h,
        cp.abs(velocity[-1, 1]) <= np.tan(goal.allowed) * ahead * velocity[-1, 0],
        cp.abs(heading[1]) <= np.sin(goal.allowed),
        heading[0] >= np.cos(goal.allowed),
        heading[0] <= 1.0,
        cp.norm(over, 2) <= miss,
    ]
    return float(cp.Problem(cp.Minimize(miss), kept).solve(solver="CLARABEL"))


def main() -> None:
    """Print the bounds."""
    for ahead, word in ((1.0, "forwards"), (-1.0, "backwards")):
        misses = [least_miss(k * STEP, FINENESS * k, ahead) for k in range(1, LAST + 1)]
        print(f"driving {word} at the end: {min(misses):.3f} m, after {STEP * (int(np.argmin(misses)) + 1):.1f} s")


if __name__ == "__main__":
    main()
