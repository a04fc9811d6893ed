"""Drive a robot of the simulator IR-SIM among moving obstacles: see them with noise, replan ten times a second.

`OnlineDriver` takes the place of a planner in any world of IR-SIM with a differential robot: it is asked for an action
before each step. Needs IR-SIM: pip install 'scp-planner[irsim]'. No window is opened.

    python examples/ir_sim_planner.py [-o ir_sim.png] [--seed N]
"""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
import tempfile
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import scp_planner as sp

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WORLD = """
world: {height: 14, width: 22, step_time: 0.1, collision_mode: stop}
robot:
  - {kinematics: {name: diff}, shape: {name: circle, radius: 0.3}, state: [1, 7, 0], goal: [21, 7, 0],
     vel_max: [2.0, 3.0], vel_min: [0.0, -3.0]}
obstacle:
  - {kinematics: {name: omni}, shape: {name: circle, radius: 0.5}, state: [7, 1, 0], goal: [8, 30, 0],
     vel_max: [1.2, 1.2], vel_min: [-1.2, -1.2], behavior: {name: dash}}
  - {kinematics: {name: omni}, shape: {name: circle, radius: 0.6}, state: [13, 13, 0], goal: [11, -30, 0],
     vel_max: [1.0, 1.0], vel_min: [-1.0, -1.0], behavior: {name: dash}}
  - {kinematics: {name: omni}, shape: {name: circle, radius: 0.4}, state: [20, 7.5, 0], goal: [-30, 6, 0],
     vel_max: [0.8, 0.8], vel_min: [-0.8, -0.8], behavior: {name: dash}}
  - {shape: {name: polygon, vertices: [[14.5, 3], [16, 3], [16, 6.5], [14.5, 6.5]]}, state: [0, 0, 0]}
"""
SHOWN = 5  # moments in the figure
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7")


class OnlineDriver:
    """Plans for the first robot of an environment, from what it sees of the others.

    Parameters
    ----------
    environment : irsim environment
        With a differential robot, and obstacles that are discs or stand.
    noise : float
        Standard deviation of seen coordinates, m.
    seed : int
        Of the noise.
    """

    def __init__(self, environment: Any, noise: float, seed: int) -> None:
        self.environment, self.noise = environment, noise
        self.random = np.random.default_rng(seed)
        robot = environment.robot
        x, y, heading = (float(value) for value in robot.state[:3, 0])
        self.moving = [obstacle for obstacle in environment.obstacle_list if not obstacle.static]
        standing = [obstacle for obstacle in environment.obstacle_list if obstacle.static]
        scenario = sp.Scenario(
            name="IR-SIM",
            vehicle=sp.Vehicle(
                radius=float(robot.radius),
                max_speed=float(robot.max_speed),
                max_acceleration=1.5,
                max_deceleration=2.0,
                max_lateral_acceleration=2.0,
                max_curvature=1.5,
            ),
            start=sp.Start(time=0.0, position=(x, y), heading=heading, speed=0.0),
            goal=sp.Goal(position=(float(robot.goal[0, 0]), float(robot.goal[1, 0])), radius=0.05),
            obstacles=[
                {"id": each.name, "shape": {"polygon": each.vertices.T.tolist()}, "motion": {"position": [0.0, 0.0]}}
                for each in standing
            ],
        )
        self.step = float(environment.step_time)
        # The robot moves along its old heading while it turns, so it is a little beside its plan.
        self.planner = sp.Planner(scenario, online=sp.OnlineSettings(period=self.step, tracking_error=0.05))
        covariance = [[noise**2, 0.0], [0.0, noise**2]]
        for each in self.moving:
            self.planner.add_obstacle(
                each.name, {"disc": float(each.radius)}, covariance=covariance, model={"order": 1}
            )
        self.speed = 0.0

    def act(self) -> list[float]:
        """Look, plan, and give speed, m/s, and turning rate, rad/s, up to the next step."""
        time = float(self.environment.time)
        x, y, heading = (float(value) for value in self.environment.robot.state[:3, 0])
        for each in self.moving:
            seen = each.state[:2, 0] + self.random.normal(0.0, self.noise, 2)
            self.planner.observe(each.name, time, seen)
        plan = self.planner.replan(time, (x, y), heading, self.speed)
        # Step along the heading, and turn it towards where the plan goes in the step after.
        target, after = plan.position([time + self.step, time + 2.0 * self.step])
        forward = (target - [x, y]) @ [math.cos(heading), math.sin(heading)]
        self.speed = float(np.clip(forward / self.step, 0.0, self.environment.robot.max_speed))
        reached = np.array([x, y]) + self.step * self.speed * np.array([math.cos(heading), math.sin(heading)])
        ahead = after - reached
        wanted = float(plan.heading(time + self.step)) if np.hypot(*ahead) < 0.02 else math.atan2(ahead[1], ahead[0])
        return [self.speed, math.remainder(wanted - heading, math.tau) / self.step]


def drive(seed: int, noise: float = 0.05, longest: float = 60.0) -> tuple[Any, list[dict[str, np.ndarray]]]:
    """Drive until the robot arrives, touches something or runs out of time; return the end and all places, m."""
    with contextlib.redirect_stdout(sys.stderr):  # without a screen it tells of the windows that it cannot have
        import irsim

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "world.yaml"
        file.write_text(WORLD, encoding="utf-8")
        environment = irsim.make(str(file), headless=True, log_level="ERROR")
    driver = OnlineDriver(environment, noise, seed)
    log = []
    while environment.time < longest and not environment.done():
        everybody = [environment.robot, *driver.moving]
        log.append({each.name: each.state[:2, 0].copy() for each in everybody})
        environment.step(driver.act())
    return environment, log


def draw(environment: Any, log: list[dict[str, np.ndarray]]) -> Figure:
    """Draw the ways of all, and where they were at some moments, one colour a moment."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Polygon

    figure = Figure(figsize=(8.0, 5.4), dpi=110, layout="constrained")
    axes = figure.subplots()
    for each in environment.obstacle_list:
        if each.static:
            axes.add_patch(Polygon(each.vertices.T, facecolor="#BBBBBB", edgecolor="#777777"))
    for name in log[0]:
        ways = np.array([moment[name] for moment in log])
        robot = name == environment.robot.name
        axes.plot(*ways.T, color="#222222" if robot else "#AAAAAA", linewidth=1.8 if robot else 0.9)
        radius = next(each.radius for each in environment.objects if each.name == name)
        for index, colour in zip(np.linspace(0, len(log) - 1, SHOWN).astype(int), cycle(COLOURS), strict=False):
            style = {"facecolor": colour} if robot else {"facecolor": "none", "linewidth": 1.5}
            label = f"{index * environment.step_time:.1f} s" if robot else None
            axes.add_patch(Circle(ways[index], radius, edgecolor=colour, zorder=3, label=label, **style))
    goal = environment.robot.goal[:2, 0]
    axes.plot(*goal, marker="*", markersize=13, color="white", markeredgecolor="#222222", zorder=4)
    axes.set(aspect="equal", xlim=(0, 22), ylim=(0, 15), xlabel="x (m)", ylabel="y (m)")
    axes.set_title("A robot of IR-SIM that replans ten times a second", loc="left", fontweight="bold")
    figure.legend(loc="outside lower center", ncols=SHOWN, frameon=False)
    return figure


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("ir_sim.png"), help="figure to write")
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    options = parser.parse_args(argv)

    environment, log = drive(options.seed)
    robot = environment.robot
    end = "arrived" if robot.arrive else "touched an obstacle" if robot.collision else "did not arrive"
    own = np.array([moment[robot.name] for moment in log])
    gaps = [
        np.linalg.norm(own - [moment[each.name] for moment in log], axis=1).min() - each.radius - robot.radius
        for each in environment.obstacle_list
        if not each.static
    ]
    print(f"{end} after {environment.time:.1f} s; nearest to a moving obstacle: {min(gaps):.2f} m")
    draw(environment, log).savefig(options.output)
    print(f"wrote {options.output}")
    return 0 if robot.arrive and not robot.collision else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(f"{missing}: pip install 'scp-planner[irsim]'") from None
