"""One closed loop: truth every 10 ms, measurements, replans, contacts, stands."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from benchmarks.everyday.bodies import Pose, ground_gap, least_gap
from benchmarks.everyday.motions import Array, Robot
from benchmarks.everyday.scene import Agent, Scene, Walls

STEP = 0.01  # s, of the truth
STILL = 0.03  # m/s, below which the vehicle counts as standing
LONG = 5.0  # s, of a stand that is looked into
BEFORE = 1.0  # s, before a contact, of the answer that is judged by it


@dataclass(frozen=True)
class Follower:
    """How the vehicle follows what is asked: not at all late by default."""

    lag: float = 0.0  # s, of first order
    dead_time: float = 0.0  # s
    scale: float = 1.0  # of the speed that is driven over the one that is asked
    noise: float = 0.0  # m, of the position that is reported

    @property
    def exact(self) -> bool:
        return self == EXACT


EXACT = Follower()

Motion = Callable[[float], tuple[Array, Array]]
"""What a controller asks for at a time, s: position (2,) m, and (heading rad, signed speed m/s)."""


class Controller(Protocol):
    """A planner, or a baseline, as the loop drives it."""

    unsafe: int  # replans whose answer was not safe
    times: list[float]  # ms of processor time of each replan

    def set_goal(self, goal: Mapping[str, Any]) -> None: ...
    def set_walls(self, walls: Walls) -> None: ...
    def observe(self, time: float, agent: Agent, position: Array, noise: float) -> None: ...
    def step(self, time: float, robot: Robot) -> Motion: ...
    def has_arrived(self, robot: Robot) -> bool: ...
    def explains(self, time: float, agent: Agent, place: Array) -> str: ...


@dataclass
class Contact:
    """A contact with one obstacle, from its first moment on."""

    agent: str
    time: float  # s
    driving: bool  # towards it; else the vehicle stands or drives away
    closing: float  # m/s
    depth: float  # m
    before: str  # verdict on the last answer at least a second before


@dataclass
class Drive:
    """Course of a closed loop. Lengths in m, times in s."""

    arrived: bool
    time: float
    goals: int
    gap: float  # least distance to an obstacle
    ground: float  # least distance to walls and borders
    contacts: list[Contact]
    stands: list[tuple[float, float]]
    path: list[tuple[float, Robot]]
    tracks: Mapping[str, list[tuple[float, Array]]]
    unsafe: int
    replans: int
    times: list[float] = field(default_factory=list)  # ms
    excess: float = 0.0  # of the worst limit of the vehicle, as a share of the limit
    reason: str = ""  # of the last answer


class World:
    """Obstacles at their true places, with headings along their motion."""

    def __init__(self, agents: Sequence[Agent]) -> None:
        self._agents, self._headings = agents, {each.id: each.heading for each in agents}
        self.tracks: dict[str, list[tuple[float, Array]]] = {each.id: [] for each in agents}
        self.poses: dict[str, Pose] = {}

    def advance(self, time: float, robot: Robot) -> None:
        for agent in self._agents:
            place = np.asarray(agent.motion(time, robot), dtype=float)
            before = self.poses.get(agent.id)
            step = place - before[0] if before is not None else _first_step(agent, time, place)
            if np.hypot(*step) > 1e-4:
                self._headings[agent.id] = math.atan2(step[1], step[0])
            self.poses[agent.id] = place, self._headings[agent.id]
            self.tracks[agent.id].append((time, place))


def _first_step(agent: Agent, time: float, place: Array) -> Array:
    return np.asarray(agent.motion(time + 1e-2, None) - place) if agent.has_known_future else np.zeros(2)


def drive(
    scene: Scene, controller: Controller, seed: int = 0, exact: bool = False, follower: Follower = EXACT
) -> Drive:
    """Drive a controller through a scene up to its goal, or to the scene's time limit."""
    loop = _Loop(scene, controller, np.random.default_rng(1000 + seed), exact, follower)
    while loop.time < scene.time_limit - 1e-9 and not loop.drive.arrived:
        loop.run_period()
    return loop.finish()


class _Loop:
    def __init__(
        self, scene: Scene, controller: Controller, rng: np.random.Generator, exact: bool, follower: Follower
    ) -> None:
        x, y, heading, speed = scene.start
        self.scene, self.controller, self._rng, self._exact, self._follower = scene, controller, rng, exact, follower
        self.robot = Robot(np.array([x, y]), heading, speed)
        self.world = World(scene.agents)
        self.world.advance(0.0, self.robot)
        self.time, self._goal = 0.0, 0
        self._measured = {each.id: -math.inf for each in scene.agents}
        self._walls: Walls = scene.walls
        self._velocity = speed * np.array([math.cos(heading), math.sin(heading)])
        self._asked: deque[tuple[float, Motion]] = deque()
        self._touched: dict[str, Contact] = {}
        self.drive = Drive(
            False, 0.0, 0, math.inf, math.inf, [], [], [(0.0, _copy(self.robot))], self.world.tracks, 0, 0
        )

    def run_period(self) -> None:
        scene, controller = self.scene, self.controller
        if scene.walls_at is not None:
            walls = scene.walls_at(self.time, self.robot)
            if walls != self._walls:
                self._walls = walls
                controller.set_walls(walls)
        self._observe()
        seen = _copy(self.robot)
        seen.position = seen.position + self._rng.normal(0.0, 1.0, 2) * self._follower.noise
        motion = controller.step(self.time, seen)
        self._asked.append((self.time, motion))
        while len(self._asked) > 1 and self._asked[1][0] <= self.time - self._follower.dead_time + 1e-9:
            self._asked.popleft()
        if controller.has_arrived(self.robot):
            self._arrive()
            if self.drive.arrived:
                return
        began = self.time
        for k in range(1, round(scene.period / STEP) + 1):
            self._advance(began + k * STEP)
        self.time = began + scene.period
        self.drive.replans += 1

    def _observe(self) -> None:
        scene = self.scene
        for agent in scene.agents:
            place, _ = self.world.poses[agent.id]
            due = self.time - self._measured[agent.id] >= 1.0 / scene.rate - 1e-6
            if due and agent.seen(self.time, self.robot, place):
                noise = 0.0 if self._exact else scene.noise
                self.controller.observe(self.time, agent, place + self._rng.normal(0.0, 1.0, 2) * noise, noise)
                self._measured[agent.id] = self.time

    def _arrive(self) -> None:
        scene = self.scene
        if not scene.is_patrol:
            self.drive.arrived = True
            return
        self._goal += 1
        self.drive.goals += 1
        self.controller.set_goal(scene.goals[self._goal % len(scene.goals)])

    def _advance(self, time: float) -> None:
        before, poses = _copy(self.robot), dict(self.world.poses)
        self._follow(time)
        self.world.advance(time, self.robot)
        own = (before.position, before.heading), (self.robot.position, self.robot.heading)
        for agent in self.scene.agents:
            self._touch(time, agent, own, (poses[agent.id], self.world.poses[agent.id]))
        near = ground_gap(self._walls, self.scene.bounds, self.scene.vehicle, *own[1])
        self.drive.ground = min(self.drive.ground, near)
        self.drive.path.append((time, _copy(self.robot)))

    def _follow(self, time: float) -> None:
        motion, follower = self._asked[0][1], self._follower
        shown = time - follower.dead_time
        place, (heading, speed) = motion(shown)
        robot = self.robot
        if follower.exact:
            robot.position, robot.heading, robot.speed = place, heading, speed
            return
        wanted = (motion(shown + 1e-3)[0] - place) / 1e-3 + 2.0 * (place - robot.position)
        rate = STEP / follower.lag if follower.lag > STEP else 1.0
        self._velocity = self._velocity + (follower.scale * wanted - self._velocity) * rate
        robot.position = robot.position + STEP * self._velocity
        robot.speed = float(np.hypot(*self._velocity))
        if robot.speed > 0.05:
            robot.heading = math.atan2(self._velocity[1], self._velocity[0])
        if speed < 0.0:
            robot.speed, robot.heading = -robot.speed, heading

    def _touch(self, time: float, agent: Agent, own: tuple[Pose, Pose], other: tuple[Pose, Pose]) -> None:
        apart = least_gap(self.scene.vehicle, agent.shape, own, other)
        self.drive.gap = min(self.drive.gap, apart)
        contact = self._touched.get(agent.id)
        if apart >= 0.0:
            self._touched.pop(agent.id, None)
            return
        if contact is None:
            line = other[1][0] - own[1][0]
            step = (own[1][0] - own[0][0]) / STEP
            closing = float(step @ line) / max(float(np.hypot(*line)), 1e-9)
            moves = bool(abs(self.robot.speed) >= 0.05 and closing > 0.05)
            before = self.controller.explains(time - BEFORE, agent, other[1][0])
            contact = self._touched[agent.id] = Contact(agent.id, time, moves, closing, 0.0, before)
            self.drive.contacts.append(contact)
        contact.depth = max(contact.depth, -apart)

    def finish(self) -> Drive:
        found = self.drive
        found.time, found.unsafe, found.times = self.time, self.controller.unsafe, self.controller.times
        found.stands = _stands(found.path)
        found.excess = limit_excess(self.scene.vehicle, found.path)
        return found


def _copy(robot: Robot) -> Robot:
    return Robot(robot.position.copy(), robot.heading, robot.speed)


def _stands(path: Sequence[tuple[float, Robot]]) -> list[tuple[float, float]]:
    """Stands of more than ``LONG``, s: begin and end."""
    stands, began = [], None
    for time, robot in path:
        if abs(robot.speed) < STILL:
            began = time if began is None else began
        elif began is not None:
            stands.append((began, time))
            began = None
    if began is not None:
        stands.append((began, path[-1][0]))
    return [each for each in stands if each[1] - each[0] > LONG]


def limit_excess(vehicle: Mapping[str, Any], path: Sequence[tuple[float, Robot]], over: float = 0.1) -> float:
    """Largest excess over a limit of the vehicle, as a share of the limit, in means over 0.1 s."""
    every = round(over / STEP)
    coarse = path[::every]
    if len(coarse) < 3:
        return 0.0
    times = np.array([time for time, _ in coarse])
    speeds = np.array([robot.speed for _, robot in coarse])
    headings = np.unwrap([robot.heading for _, robot in coarse])
    acceleration = np.diff(speeds) / np.diff(times)
    middle = np.abs(0.5 * (speeds[1:] + speeds[:-1]))
    turning = np.abs(np.diff(headings)) / np.diff(times)
    shares = [
        speeds.max() / vehicle["max_speed"],
        acceleration.max() / vehicle["max_acceleration"],
        -acceleration.min() / vehicle["max_deceleration"],
        (turning * middle).max() / (vehicle.get("max_lateral_acceleration") or math.inf),
    ]
    moving = middle > 0.2 * vehicle["max_speed"]
    if moving.any():
        shares.append((turning / np.maximum(middle, 1e-9))[moving].max() / (vehicle.get("max_curvature") or math.inf))
    return max(float(max(shares)) - 1.0, 0.0)
