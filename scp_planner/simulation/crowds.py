"""Crowds that others measure their robots in."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.scenario.models import Confidence, Goal, Model, Scenario, Start, Steering, Vehicle
from scp_planner.scenario.process_model import ProcessModel, RandomWalkVelocity
from scp_planner.scenario.shapes import Disc, Shape
from scp_planner.settings.online import GiveWay, OnlineSettings, Regions
from scp_planner.simulation.people import Manner, OrcaPeople, Restlessness, RestlessPeople, on_circle
from scp_planner.simulation.sensors import Sensor
from scp_planner.simulation.setup import SimulationSettings


@dataclass(frozen=True)
class Protocol:
    """Sizes of the published crowds, and how the planner drives among them."""

    step: float = 0.25  # s
    robot_radius: float = 0.3  # m
    top_speed: float = 1.0  # m/s
    circle: float = 4.0  # m, radius
    square: float = 10.0  # m, side
    gap: float = 0.2  # m, at least between the places and goals of people at the start
    jitter: float = 1.0  # m, side of the square round a point of the circle in which somebody starts
    arena: float = 6.0  # m, half of its side
    arena_gap: float = 0.25  # m
    arena_trip: float = 8.0  # m, the shortest
    arena_padding: float = 0.16  # m
    arena_radii: tuple[float, float] = (0.3, 0.5)  # m
    arena_speeds: tuple[float, float] = (0.5, 1.5)  # m/s
    most_draws: int = 100_000  # Of places for a crowd, before the scene counts as full
    forget_steps: int = 6  # Steps after which somebody who is not seen has gone
    # At which people's zones hold them. Higher: wider arcs, more waiting; lower: more steps aside in the last moment.
    level: float = 0.7
    # Times in which the vehicle drives its own width, for which a stop stays clear: who stands can go away in time...
    stay_clear: float = 0.5
    # ...and no less than this share of the time to its top speed, since it has to get under way for that.
    starting: float = 2.0 / 3.0

    @property
    def acceleration(self) -> float:
        """m/s2. The protocols' robot may change its velocity at once; this one takes a step to its top speed."""
        return self.top_speed / self.step

    @property
    def arena_circle(self) -> float:
        """Radius of the circle round the arena, m."""
        return self.arena * math.sqrt(2.0)


CROWDS = Protocol()

WALKER = Model(
    order=1,
    process=ProcessModel(process=RandomWalkVelocity(diffusion=0.001), velocity_deviation=1.0, noise_deviation=0.001),
)
"""Motion model of people who avoid each other: nearly straight, with changes of velocity."""


@dataclass(frozen=True)
class Episode:
    """A robot's task among people."""

    scenario: Scenario  # Robot, start and goal; without obstacles
    people: OrcaPeople  # The world that it drives in
    shapes: dict[str, Shape]
    step: float  # From one look and decision to the next, s
    time_limit: float  # s
    view: float  # m

    @property
    def rate(self) -> float:
        """Looks and decisions per second, Hz."""
        return 1.0 / self.step

    def setup(self, online: OnlineSettings | None = None, model: Model = WALKER) -> SimulationSettings:
        """Settings of :func:`scp_planner.simulate`: exact measurements at every step within the robot's range."""
        return SimulationSettings(
            world=self.people,
            sensors=(Sensor(rate=self.rate, noise=0.0, range=self.view),),
            online=online or among_people(self.scenario.vehicle, self.step),
            history=0.0,
            time_limit=self.time_limit,
            shapes=self.shapes,
            model=model,
        )


def among_people(vehicle: Vehicle, step: float) -> OnlineSettings:
    """Settings of the planner among people who are seen well and turn at any moment."""
    return OnlineSettings(
        give_way=GiveWay.EARLY,
        stay_clear=max(
            CROWDS.stay_clear * 2.0 * vehicle.radius, CROWDS.starting * vehicle.max_speed**2 / vehicle.max_acceleration
        )
        / vehicle.max_speed,
        gate_probability=0.0,
        alarm_probability=0.0,
        forget_after=CROWDS.forget_steps * step,
        regions=Regions.MODEL,
    )


def circle_crossing(seed: int, people: int = 5, sees_vehicle: bool = False) -> Episode:
    """Everybody crosses a circle of 4 m radius to the opposite side, from a place jittered by up to 0.5 m."""
    rng = np.random.default_rng([seed, 0])

    def draw(_: int) -> tuple[Array, Array]:
        start = on_circle(rng, CROWDS.circle) + CROWDS.jitter * rng.uniform(-0.5, 0.5, 2)
        return start, -start

    return _crossing(f"circle-{people}-{seed}", draw, people, sees_vehicle)


def square_crossing(seed: int, people: int = 5, sees_vehicle: bool = False) -> Episode:
    """People cross a square of 10 m side, each from anywhere in its left or right half to anywhere in the other."""
    rng = np.random.default_rng([seed, 1])

    def draw(_: int) -> tuple[Array, Array]:
        side = -1.0 if rng.random() < 0.5 else 1.0
        (x0, y0), (x1, y1) = rng.uniform([0.0, -0.5], [0.5, 0.5], (2, 2)) * CROWDS.square
        return np.array([side * x0, y0]), np.array([-side * x1, y1])

    return _crossing(f"square-{people}-{seed}", draw, people, sees_vehicle)


def restless_arena(seed: int, people: int = 20, sees_vehicle: bool = False) -> Episode:
    """Restless people in an arena of 12 m, and a robot that sees 5 m far and drives at least 8 m."""
    rng = np.random.default_rng([seed, 2])
    while True:
        start, goal = rng.uniform(-CROWDS.arena, CROWDS.arena, (2, 2))
        if np.hypot(*(goal - start)) >= CROWDS.arena_trip:
            break
    radii, speeds = rng.uniform(*CROWDS.arena_radii, people), rng.uniform(*CROWDS.arena_speeds, people)

    def draw(k: int) -> tuple[Array, Array]:
        place = on_circle(rng, CROWDS.arena_circle) + speeds[k] * rng.uniform(-0.5, 0.5, 2)
        return place, -place

    places, goals = _placed(draw, radii, (start, goal), CROWDS.arena_gap)
    crowd = RestlessPeople(
        places,
        goals,
        speeds,
        radii,
        Manner(CROWDS.step, neighbours=people, padding=CROWDS.arena_padding),
        sees_vehicle,
        restlessness=Restlessness(CROWDS.arena_circle),
        seed=seed,
    )
    scenario = _task(f"arena-{people}-{seed}", start, goal)
    return Episode(scenario, crowd, _shapes(crowd), CROWDS.step, time_limit=50.0, view=5.0)


def _crossing(name: str, draw: Callable[[int], tuple[Array, Array]], people: int, sees_vehicle: bool) -> Episode:
    start, goal = np.array([0.0, -CROWDS.circle]), np.array([0.0, CROWDS.circle])
    radii = np.full(people, 0.3)
    places, goals = _placed(draw, radii, (start, goal), CROWDS.gap)
    crowd = OrcaPeople(places, goals, CROWDS.top_speed, radii, Manner(CROWDS.step), sees_vehicle)
    return Episode(_task(name, start, goal), crowd, _shapes(crowd), CROWDS.step, time_limit=25.0, view=math.inf)


def _placed(
    draw: Callable[[int], tuple[Array, Array]], radii: Array, robot: tuple[Array, Array], gap: float
) -> tuple[Array, Array]:
    """Draw starts and goals, each (K, 2) m, that are apart from those drawn before and from the robot's."""
    starts, goals, sizes = [robot[0]], [robot[1]], [CROWDS.robot_radius]
    draws = 0
    while len(starts) <= len(radii):
        k = len(starts) - 1
        start, goal = draw(k)
        apart = radii[k] + np.array(sizes) + gap
        near_start = np.linalg.norm(np.array(starts) - start, axis=1) < apart
        near_goal = np.linalg.norm(np.array(goals) - goal, axis=1) < apart
        if not (near_start.any() or near_goal.any()):
            starts.append(start)
            goals.append(goal)
            sizes.append(float(radii[k]))
        draws += 1
        if draws > CROWDS.most_draws:
            raise ValueError(f"people: there is no room for {len(radii)}")
    return np.array(starts[1:]).reshape(-1, 2), np.array(goals[1:]).reshape(-1, 2)


def _task(name: str, start: Array, goal: Array) -> Scenario:
    return Scenario(
        name=name,
        vehicle=Vehicle(
            radius=CROWDS.robot_radius,
            max_speed=CROWDS.top_speed,
            max_acceleration=CROWDS.acceleration,
            max_deceleration=CROWDS.acceleration,
            steering=Steering.ANY,
        ),
        start=Start(time=0.0, position=(float(start[0]), float(start[1])), speed=0.0),
        goal=Goal(position=(float(goal[0]), float(goal[1])), radius=CROWDS.robot_radius),
        confidence=Confidence(probability=CROWDS.level, level="per_time"),
    )


def _shapes(crowd: OrcaPeople) -> dict[str, Shape]:
    return {name: Disc(disc=float(radius)) for name, radius in zip(crowd.names, crowd.radii, strict=True)}
