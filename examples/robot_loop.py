"""A robot at 20 Hz: people that a tracker sees, three goals in turn, a door that shuts, a recording for Foxglove.

Run it by ``python examples/robot_loop.py -o robot.mcap``.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

import numpy as np

import scp_planner as sp
from scp_planner.export import save_scene

PERIOD, DEADLINE = 0.05, 0.02  # s
GOALS = [{"position": place, "radius": 0.2, "speed": 0.0} for place in ((5.0, 2.0), (5.0, -2.0), (0.0, 0.0))]
DOOR = [[2.5, -1.0], [2.8, -1.0], [2.8, 0.5], [2.5, 0.5]]
ROBOT = {"radius": 0.3, "max_speed": 1.5, "max_acceleration": 1.0, "max_deceleration": 1.5, "max_curvature": 2.0}
START = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}
PEOPLE = {  # position, m, and velocity, m/s
    "ann": ([4.0, 1.5], [-0.6, 0.1]),
    "bob": ([2.0, -3.0], [0.1, 0.6]),
    "cem": ([6.0, 4.0], [0.1, -0.7]),
}


def main() -> int:
    """Drive, and report; the status is 0 after arrival at all goals."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("robot.mcap"), help="the recording")
    output = parser.parse_args().output
    goals, rng, took, nearest = iter(GOALS), np.random.default_rng(0), [], np.inf
    planner = sp.Planner(sp.Scenario(vehicle=ROBOT, start=START, goal=next(goals)))
    for name in PEOPLE:
        planner.add_obstacle(name, {"disc": 0.3}, model="pedestrian", covariance=0.05**2 * np.eye(2))
    time, position, heading, speed, arrived = 0.0, np.zeros(2), 0.0, 0.0, 0
    with planner.record(output.with_suffix(".jsonl")):
        while time < 60.0 and arrived < len(GOALS):
            for name, (begin, velocity) in PEOPLE.items():
                place = np.add(begin, np.multiply(velocity, time))
                nearest = min(nearest, float(np.hypot(*(place - position))) - 0.6)
                planner.observe(name, time, place + rng.normal(0.0, 0.05, 2))
            began = perf_counter()
            plan = planner.replan(time, position, heading, speed, deadline=DEADLINE)
            took.append(1e3 * (perf_counter() - began))
            if plan.arrived:
                arrived += 1
                planner.set_goal(GOALS[min(arrived, len(GOALS) - 1)])
                planner.set_walls([DOOR])
            time += PERIOD
            position, heading, speed = plan.position(time), float(plan.heading(time)), float(plan.speed(time))
    print(f"{arrived} goals in {time:.2f} s, at least {nearest:.2f} m from people")
    print(f"replans: median {np.median(took):.1f} ms, 99 % {np.quantile(took, 0.99):.1f} ms")
    save_scene(sp.Run.load(output.with_suffix(".jsonl")), output)
    print(f"wrote {output}")
    return 0 if arrived == len(GOALS) else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(str(missing)) from None
