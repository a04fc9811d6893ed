"""Closed loops among obstacles that do not do what is expected of them, and sensors that are worse than they say."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.facts import facts_of
from scp_planner.settings.online import OnlineSettings
from scp_planner.simulation.loop import DEFAULTS, simulate
from scp_planner.simulation.sensors import LEAST_NOISE, Observation, Sensor
from scp_planner.simulation.worlds import Course, motion_course

Array = np.ndarray

NOISE = 0.1  # m, as the sensor declares it
RATE = 10.0  # Hz
MANOEUVRE_TIME = 2.0  # s
OSCILLATORS = (0.1, 0.6)  # m
WAVE_PERIODS = (3.0, 6.0)  # s
OUTLIERS, OUTLIER_SIZE = 0.02, 20.0  # share; standard deviations of the noise
WANDERING = 0.1  # m2/s3, growth of the variance of a walker's velocity
WANDERING_STEP = 0.05  # s
LONGEST = 80.0  # s
BEFORE = 12.0  # s before the start for which a course is known

FAMILIES = ("nominal", "change0.3", "change0.8", "weaving", "noise2", "noise3", "outliers", "walkers")
BELIEVED = "believed"
"""Nominal motion, and a planner that believes it: what noticing costs is measured against this."""


@dataclass(frozen=True)
class BadSensor(Sensor):
    """A sensor whose noise is not what it declares.

    Attributes
    ----------
    factor : float
        True standard deviation over the declared one.
    outliers : float
        Share of observations that are far off.
    """

    factor: float = 1.0
    outliers: float = 0.0

    def look(
        self,
        time: float,
        position: Array,  # noqa: ARG002 - it sees all that there is
        heading: float,  # noqa: ARG002
        targets: Mapping[str, Array],
        rng: np.random.Generator,
        least_noise: float = LEAST_NOISE,
    ) -> list[Observation]:
        """What it sees at a time."""
        seen = []
        for name, target in targets.items():
            error, wild = rng.standard_normal(2), rng.random() < self.outliers
            size = self.noise * (OUTLIER_SIZE if wild else self.factor)
            place = target + size * error
            seen.append(Observation(name, time, time, (float(place[0]), float(place[1])), max(self.noise, least_noise)))
        return seen


def sensor_of(family: str) -> BadSensor:
    """The sensor of a family of runs."""
    factor = float(family.removeprefix("noise")) if family.startswith("noise") else 1.0
    return BadSensor(rate=RATE, noise=NOISE, factor=factor, outliers=OUTLIERS if family == "outliers" else 0.0)


def manoeuvre(base: Course, begin: float, change: Array) -> Course:
    """A course with another acceleration for `MANOEUVRE_TIME` from a time on."""

    def course(times: Array) -> Array:
        since = np.maximum(np.asarray(times, dtype=float) - begin, 0.0)
        during = np.minimum(since, MANOEUVRE_TIME)
        shift = 0.5 * during**2 + during * (since - during)
        return base(times) + shift[:, None] * change

    return course


def weaving(base: Course, direction: Array, size: float, period: float, phase: float) -> Course:
    """A course that swings to and fro across its direction."""
    across = np.array([-direction[1], direction[0]])

    def course(times: Array) -> Array:
        wave = size * np.sin(2.0 * math.pi * np.asarray(times, dtype=float) / period + phase)
        return base(times) + wave[:, None] * across

    return course


def walker(position: Array, velocity: Array, rng: np.random.Generator) -> Course:
    """Somebody whose velocity is a random walk from the start on, and constant before by what the walk was there."""
    steps = round((LONGEST + BEFORE) / WANDERING_STEP)
    now = round(BEFORE / WANDERING_STEP)
    changes = math.sqrt(WANDERING * WANDERING_STEP) * rng.standard_normal((steps, 2))
    velocities = np.cumsum(changes, axis=0)
    velocities += velocity - velocities[now]
    places = np.concatenate([np.zeros((1, 2)), np.cumsum(velocities * WANDERING_STEP, axis=0)])
    places += position - places[now]
    clock = WANDERING_STEP * np.arange(-now, steps - now + 1)
    return lambda times: np.stack([np.interp(times, clock, places[:, axis]) for axis in (0, 1)], axis=-1)


def world_of(scenario: sp.Scenario, family: str, seed: int, trip: float) -> dict[str, Course]:
    """What the obstacles of a scene really do in a run of a family whose trip takes about so many seconds."""
    rng = np.random.default_rng([seed, 11])
    world: dict[str, Course] = {}
    for obstacle in scenario.obstacles:
        motion = obstacle.motion
        assert isinstance(motion, sp.Motion)
        base = motion_course(motion)
        velocity = np.array(motion.velocity)
        if family.startswith("change"):
            change = float(family.removeprefix("change")) * rng.standard_normal(2)
            base = manoeuvre(base, rng.uniform(0.0, trip), change)
        elif family == "weaving":
            direction = velocity / max(float(np.hypot(*velocity)), 1e-9)
            size, period = rng.uniform(*OSCILLATORS), rng.uniform(*WAVE_PERIODS)
            base = weaving(base, direction, size, period, rng.uniform(0.0, 2.0 * math.pi))
        elif family == "walkers":
            base = walker(np.array(motion.position), velocity, rng)
        world[obstacle.id] = base
    return world


def _online_of(family: str) -> OnlineSettings:
    if family == BELIEVED:
        return OnlineSettings(forget_after=DEFAULTS.forget_after, alarm_probability=0.0, manoeuvre=0.0)
    return OnlineSettings(forget_after=DEFAULTS.forget_after)


def drive(
    row: Mapping[str, Any],
    scene: Callable[[int], tuple[sp.Scenario, float]],
    online: OnlineSettings | None = None,
    level: float = 0.95,
) -> dict[str, Any]:
    """One closed loop of a family."""
    family, seed = str(row["family"]), int(row["seed"])
    scenario, truth = scene(seed)
    confidence = sp.Confidence(probability=level, level="joint")
    run = simulate(
        scenario.model_copy(update={"confidence": confidence}),
        NOISE,
        RATE,
        seed,
        world=world_of(scenario, family, seed, truth),
        sensors=(sensor_of(family),),
        online=online or _online_of(family),
    )
    return {"truth_time": truth, **facts_of(run)}
