"""Families of motions, drawn from a seed: people, carts, accelerating discs, mixtures, sensors of other kinds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from benchmarks.prediction.motion import Array, Family, Motion, Sensor

STEP = 0.02  # s
LASTS = 60.0  # s
TOGETHER = 6
ROOM = np.array([[0.5, 0.5], [11.5, 7.5]])  # m

Draw = Callable[[np.random.Generator], Motion]


def _motion(velocities: Array, start: Array, changes: list[float], model: str | None) -> Motion:
    positions = start + np.concatenate([np.zeros((1, 2)), np.cumsum(velocities, axis=0) * STEP])
    return Motion(STEP * np.arange(len(positions)), positions, np.array(changes), model)


def _between_places(rng: np.random.Generator, stands: float) -> Motion:
    """Walk from one random place of a room to another; stand for a while at a share of them."""
    place, goal, velocity = rng.uniform(*ROOM), rng.uniform(*ROOM), np.zeros(2)
    speed, rest, changes, positions = rng.uniform(0.7, 1.3), 0.0, list[float](), [rng.uniform(*ROOM)]
    positions[0] = place
    for k in range(round(LASTS / STEP)):
        ahead = goal - place
        far = float(np.hypot(*ahead))
        if rest <= 0.0 and far < 0.3:
            goal = rng.uniform(*ROOM)
            changes.append(k * STEP)
            rest = rng.uniform(1.0, 4.0) if rng.random() < stands else 0.0
        elif 0.0 < rest <= STEP:
            changes.append(k * STEP)
        rest -= STEP
        wanted = speed * ahead / max(far, 1e-9) if rest <= 0.0 else np.zeros(2)
        velocity = velocity + (wanted - velocity) * (STEP / 0.4)
        place = place + STEP * velocity
        positions.append(place)
    return Motion(STEP * np.arange(len(positions)), np.array(positions), np.array(changes), "pedestrian")


def walkers(rng: np.random.Generator) -> Motion:
    return _between_places(rng, 0.0)


def walkers_who_pause(rng: np.random.Generator) -> Motion:
    return _between_places(rng, 0.25)


def steady_walkers(rng: np.random.Generator) -> Motion:
    """Keep a course, with a sideways speed that wanders by 5 cm/s."""
    heading, speed, aside, velocities = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.8, 1.4), 0.0, []
    ahead, left = _axes(heading)
    for _ in range(round(LASTS / STEP)):
        aside += -aside * STEP + 0.05 * math.sqrt(2.0 * STEP) * rng.standard_normal()
        velocities.append(speed * ahead + aside * left)
    return _motion(np.array(velocities), np.zeros(2), [], "pedestrian")


def people_who_stop(rng: np.random.Generator) -> Motion:
    """Walk for some seconds, stand for some, and set out in another direction."""
    heading, top = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.8, 1.4)
    speed, wanted, due, changes, velocities = top, top, rng.uniform(3.0, 12.0), list[float](), []
    for k in range(round(LASTS / STEP)):
        time = k * STEP
        if time >= due:
            changes.append(time)
            heading += 0.0 if wanted else rng.uniform(-0.8, 0.8)
            due = time + (rng.uniform(2.0, 6.0) if wanted else rng.uniform(4.0, 10.0))
            wanted = 0.0 if wanted else top
        speed += float(np.clip(wanted - speed, -2.5 * STEP, 2.5 * STEP))
        velocities.append(speed * _axes(heading)[0])
    return _motion(np.array(velocities), np.zeros(2), changes, "pedestrian")


def weaving(rng: np.random.Generator) -> Motion:
    """Swing from side to side by 0.3 to 0.6 m in 2.5 to 4 s."""
    ahead, left = _axes(rng.uniform(0.0, 2.0 * math.pi))
    speed, period, size, phase = (
        rng.uniform(0.8, 1.4),
        rng.uniform(2.5, 4.0),
        rng.uniform(0.3, 0.6),
        rng.uniform(0.0, 6.0),
    )
    times = STEP * np.arange(round(LASTS / STEP) + 1)
    swing = size * np.sin(2.0 * math.pi * times / period + phase)
    return Motion(times, speed * times[:, None] * ahead + swing[:, None] * left, np.array([]), "pedestrian")


def steady_carts(rng: np.random.Generator) -> Motion:
    ahead, _ = _axes(rng.uniform(0.0, 2.0 * math.pi))
    return _motion(np.tile(0.8 * ahead, (round(LASTS / STEP), 1)), np.zeros(2), [], "car")


def carts_that_turn(rng: np.random.Generator) -> Motion:
    """Drive at 0.8 m/s; every few seconds stop, set out, or turn by a right angle."""
    heading, turn, speed, wanted = rng.uniform(0.0, 2.0 * math.pi), 0.0, 0.8, 0.8
    due, changes, velocities = rng.uniform(3.0, 12.0), list[float](), []
    for k in range(round(LASTS / STEP)):
        if k * STEP >= due:
            changes.append(k * STEP)
            if wanted == 0.0:
                wanted = 0.8
            elif rng.random() < 0.5:
                wanted = 0.0
            else:
                turn = rng.choice([-0.5, 0.5]) * math.pi
            due = k * STEP + rng.exponential(6.0) + 2.0
        speed += float(np.clip(wanted - speed, -0.8 * STEP, 0.8 * STEP))
        step = math.copysign(min(abs(turn), speed / 1.2 * STEP), turn)
        heading, turn = heading + step, turn - step
        velocities.append(speed * _axes(heading)[0])
    return _motion(np.array(velocities), np.zeros(2), changes, "car")


def accelerations(size: float) -> Draw:
    """Accelerations of a normal law that are drawn anew every 4 s on average, against a friction."""

    def draw(rng: np.random.Generator) -> Motion:
        velocity, a, changes, velocities = rng.standard_normal(2), size * rng.standard_normal(2), list[float](), []
        for k in range(round(LASTS / STEP)):
            if rng.random() < STEP / 4.0:
                a = size * rng.standard_normal(2)
                changes.append(k * STEP)
            velocity = velocity + STEP * (a - 0.2 * velocity)
            velocities.append(velocity)
        return _motion(np.array(velocities), np.zeros(2), changes, "car")

    return draw


def standing(rng: np.random.Generator) -> Motion:
    """Stand, and set out once after 20 to 40 s."""
    out, top = rng.uniform(20.0, 40.0), rng.uniform(0.8, 1.4)
    times = STEP * np.arange(round(LASTS / STEP))
    speed = np.clip(2.0 * (times - out), 0.0, top)
    return _motion(speed[:, None] * _axes(rng.uniform(0.0, 6.0))[0], rng.uniform(*ROOM), [out], "pedestrian")


def joggers(rng: np.random.Generator) -> Motion:
    """Run at 2.5 to 3.5 m/s and turn by up to a right angle now and then."""
    heading, speed, turn, due = rng.uniform(0.0, 6.0), rng.uniform(2.5, 3.5), 0.0, rng.uniform(3.0, 8.0)
    changes, velocities = list[float](), []
    for k in range(round(LASTS / STEP)):
        if k * STEP >= due:
            turn, due = rng.uniform(-1.5, 1.5), k * STEP + rng.uniform(3.0, 8.0)
            changes.append(k * STEP)
        step = math.copysign(min(abs(turn), 2.0 * STEP), turn)
        heading, turn = heading + step, turn - step
        velocities.append(speed * _axes(heading)[0])
    return _motion(np.array(velocities), np.zeros(2), changes, "pedestrian")


def straight_trucks(rng: np.random.Generator) -> Motion:
    ahead, _ = _axes(rng.uniform(0.0, 6.0))
    return _motion(np.tile(rng.uniform(5.0, 15.0) * ahead, (round(LASTS / STEP), 1)), np.zeros(2), [], "car")


def _axes(heading: float) -> tuple[Array, Array]:
    cos, sin = math.cos(heading), math.sin(heading)
    return np.array([cos, sin]), np.array([-sin, cos])


def _scenes(name: str, draws: tuple[Draw, ...], count: int, seed: int, together: int = TOGETHER) -> list[list[Motion]]:
    """``count`` motions in scenes of several; the draws in turn."""
    rng = np.random.default_rng([seed, *name.encode()])
    every = [draws[k % len(draws)](rng) for k in range(count)]
    return [every[k : k + together] for k in range(0, count, together)]


DRAWS: Mapping[str, tuple[Draw, ...]] = {
    "walkers": (walkers,),
    "walkers who pause": (walkers_who_pause,),
    "steady walkers": (steady_walkers,),
    "people who stop": (people_who_stop,),
    "standing, set out": (standing,),
    "joggers": (joggers,),
    "weaving": (weaving,),
    "steady carts": (steady_carts,),
    "carts that turn": (carts_that_turn,),
    "straight trucks": (straight_trucks,),
    "accelerations 0.3": (accelerations(0.3),),
    "accelerations 0.8": (accelerations(0.8),),
    "unlike: walkers": (steady_walkers, walkers),
    "unlike: all": (steady_carts, walkers, standing, people_who_stop, accelerations(0.3), steady_walkers),
}
SENSORS: Mapping[str, tuple[str, Sensor]] = {
    "walkers, 2 Hz": ("walkers", Sensor(rate=2.0)),
    "walkers, 50 Hz": ("walkers", Sensor(rate=50.0)),
    "walkers, exact": ("walkers", Sensor(noise=0.0)),
    "walkers, outliers": ("walkers", Sensor(outliers=0.02)),
    "carts that turn, exact": ("carts that turn", Sensor(noise=0.0)),
    "carts that turn, 25 Hz": ("carts that turn", Sensor(rate=25.0)),
}
CROWDS: Mapping[str, int] = {"2 walkers": 2, "15 walkers": 15}
NAMES = (*DRAWS, *SENSORS, *CROWDS)


def make(name: str, count: int, seed: int) -> Family:
    """Return a family of at least ``count`` motions."""
    if name in CROWDS:
        together = CROWDS[name]
        return Family(name, _scenes(name, (walkers,), -(-count // together) * together, seed, together))
    kind, sensor = SENSORS.get(name, (name, Sensor()))
    return Family(name, _scenes(kind, DRAWS[kind], count, seed), sensor)


def unlabelled(family: Family) -> Family:
    """Return a family of obstacles without class models."""
    return replace(family, scenes=[[replace(each, model=None) for each in scene] for scene in family.scenes])
