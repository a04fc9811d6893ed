"""``Planner`` as a new user runs it, with default settings."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from time import process_time
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.everyday.loop import EXACT, Follower, Motion
from benchmarks.everyday.motions import Array, Robot
from benchmarks.everyday.scene import Agent, Scene, Walls

KEPT = 3.0  # s, for which answers are kept, to be judged by a contact


@dataclass(frozen=True)
class Configuration:
    """What the user of ``Planner`` says and gives."""

    labelled: bool = True  # obstacles have a class model
    exact: bool = False  # positions without noise, no covariance
    covariance: bool = True
    deadline: float | None = None  # s
    follower: Follower = EXACT


CONFIGURATIONS: Mapping[str, Configuration] = {
    "A": Configuration(),
    "B": Configuration(labelled=False),
    "C": Configuration(exact=True, covariance=False),
    "D": Configuration(labelled=False, exact=True, covariance=False),
    "E": Configuration(deadline=0.02),
    "F": Configuration(follower=Follower(lag=0.15)),
}


class Product:
    """The planner with default settings but for the period of the loop."""

    def __init__(self, scene: Scene, configuration: Configuration) -> None:
        self._configuration = configuration
        self._planner = sp.Planner(scene.scenario(), online=sp.OnlineSettings(period=scene.period))
        self._known: set[str] = set()
        self._answers: deque[tuple[float, sp.OnlinePlan, list[sp.ThreatZone]]] = deque()
        self._kept = int(KEPT / scene.period)
        self.unsafe, self.times = 0, list[float]()
        self.reason = ""
        self._arrived = False

    def set_goal(self, goal: Mapping[str, Any]) -> None:
        self._planner.set_goal(dict(goal))

    def set_walls(self, walls: Walls) -> None:
        self._planner.set_walls(walls)

    def observe(self, time: float, agent: Agent, position: Array, noise: float) -> None:
        if agent.id not in self._known:
            facts: dict[str, Any] = {}
            if self._configuration.labelled and agent.model:
                facts["model"] = agent.model
            if self._configuration.covariance and noise > 0.0:
                facts["covariance"] = noise**2 * np.eye(2)
            self._planner.add_obstacle(agent.id, dict(agent.shape), **facts)
            self._known.add(agent.id)
        self._planner.observe(agent.id, time, position)

    def step(self, time: float, robot: Robot) -> Motion:
        began = process_time()
        plan = self._planner.replan(
            time, robot.position, robot.heading, robot.speed, deadline=self._configuration.deadline
        )
        self.times.append(1e3 * (process_time() - began))
        self.unsafe += not plan.safe
        self.reason, self._arrived = f"{plan.code}: {plan.reason}", plan.arrived
        self._answers.append((time, plan, list(self._planner.zones)))
        if len(self._answers) > self._kept:
            self._answers.popleft()
        reverses = self._planner.backs_up

        def motion(at: float) -> tuple[Array, Array]:
            speed = float(plan.speed(at))
            back = reverses and bool(plan.backward(at))
            return np.asarray(plan.position(at)), np.array([float(plan.heading(at)), -speed if back else speed])

        return motion

    def has_arrived(self, robot: Robot) -> bool:
        return self._arrived

    def explains(self, time: float, agent: Agent, place: Array) -> str:
        """Verdict on the last answer up to a time: unsafe, or safe with the body inside or outside its region."""
        before = [each for each in self._answers if each[0] <= time + 1e-9]
        if not before:
            return "no answer"
        _, plan, zones = before[-1]
        if not plan.safe:
            return "not safe"
        zone = next((each for each in zones if each.id == agent.id), None)
        if zone is None:
            return "safe, not predicted"
        radius = agent.shape.get("disc") or 0.5 * min(agent.shape["rectangle"])
        angles = np.linspace(0.0, 2.0 * np.pi, 17)[:-1]
        body = place + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        inside = bool((np.asarray(zone.signed_distance(time + 1.0, body)) <= 1e-9).all())
        return "safe, inside its region" if inside else "safe, left its region"
