"""A robot at 20 Hz: people that a tracker sees, three goals in turn, a door that shuts, a recording for Foxglove.

Run it by ``python examples/robot_loop.py --scene robot.mcap``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from time import process_time

import numpy as np

import scp_planner as sp
from scp_planner.export import save_scene

PERIOD = 0.05  # s
GOALS = [{"position": place, "radius": 0.2, "speed": 0.0} for place in ((5.0, 2.0), (5.0, -2.0), (0.0, 0.0))]
DOOR = [[2.5, -1.0], [2.8, -1.0], [2.8, 0.5], [2.5, 0.5]]
ROBOT = {
    "radius": 0.3,
    "max_speed": 1.5,
    "max_acceleration": 1.0,
    "max_deceleration": 1.5,
    "max_curvature": 2.0,
    "max_lateral_acceleration": 1.5,
}
START = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}
PEOPLE = {  # position, m, and velocity, m/s
    "ann": ([4.0, 1.5], [-0.6, 0.1]),
    "bob": ([2.0, -3.0], [0.1, 0.6]),
    "cem": ([6.0, 4.0], [0.1, -0.7]),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Drive, and report; the status is 0 after arrival at all goals, untouched."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("robot_loop.png"), help="the figure")
    parser.add_argument("--deadline", type=float, default=0.02, help="of a replan, s of wall time")
    parser.add_argument("--record", type=Path, default=Path("robot_loop.jsonl"), help="the recording")
    parser.add_argument("--scene", type=Path, help="the recording for Foxglove, such as robot.mcap")
    options = parser.parse_args(argv)
    rng, took, nearest = np.random.default_rng(0), list[float](), np.inf
    level = {"level": "per_time"}  # of each moment: among people that is what lets a robot get on
    planner = sp.Planner(sp.Scenario(name="robot", vehicle=ROBOT, start=START, goal=GOALS[0], confidence=level))
    for name in PEOPLE:
        planner.add_obstacle(name, {"disc": 0.3}, model="pedestrian", covariance=0.05**2 * np.eye(2))
    time, position, heading, speed, arrived = 0.0, np.zeros(2), 0.0, 0.0, 0
    with planner.record(options.record):
        while time < 60.0 and arrived < len(GOALS):
            for name, (begin, velocity) in PEOPLE.items():
                place = np.add(begin, np.multiply(velocity, time))
                nearest = min(nearest, float(np.hypot(*(place - position))) - 0.6)
                planner.observe(name, time, place + rng.normal(0.0, 0.05, 2))
            began = process_time()
            plan = planner.replan(time, position, heading, speed, deadline=options.deadline)
            took.append(1e3 * (process_time() - began))
            if plan.arrived:
                arrived += 1
                planner.set_goal(GOALS[min(arrived, len(GOALS) - 1)])
                planner.set_walls([DOOR])
            time += PERIOD  # the robot drives: here it does what it is told
            position, heading, speed = plan.position(time), float(plan.heading(time)), float(plan.speed(time))
    print(f"{arrived} goals in {time:.2f} s, at least {nearest:.2f} m from people")
    print(f"replans: median {np.median(took):.1f} ms of processor time, 99 % {np.quantile(took, 0.99):.1f} ms")
    run = sp.Run.load(options.record)
    if options.scene is not None:
        save_scene(run, options.scene)
    run.draw(options.output)
    print(f"wrote {options.output}")
    return 0 if arrived == len(GOALS) and nearest > 0.0 else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(f"{missing}: pip install 'scp-planner[plot]'") from None
