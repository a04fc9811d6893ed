"""Closed loops among obstacles that do not do what is expected of them, and sensors that are worse than they say."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks import families
from scp_planner.estimation.tracks import Tracks
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.settings.online import OnlineSettings, Regions, Watch
from scp_planner.simulation.loop import FORGET_AFTER, simulate
from scp_planner.simulation.sensors import LEAST_NOISE, Observation, Sensor
from scp_planner.simulation.worlds import Course, motion_course, track_course

Array = np.ndarray

NOISE = 0.1  # m, as the sensor declares it
RATE = 10.0  # Hz
MANOEUVRE_TIME = 2.0  # s
WAVES = (0.1, 0.6)  # m
WAVE_PERIODS = (3.0, 6.0)  # s
OUTLIERS, OUTLIER_SIZE = 0.02, 20.0  # share; standard deviations of the noise
WANDERING = 0.1  # m2/s3, growth of the variance of a walker's velocity
WANDERING_STEP = 0.05  # s
LONGEST = 80.0  # s
RECORDED_NOISE = 0.1  # m, added to recorded positions
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
            size, period = rng.uniform(*WAVES), rng.uniform(*WAVE_PERIODS)
            base = weaving(base, direction, size, period, rng.uniform(0.0, 2.0 * math.pi))
        elif family == "walkers":
            base = walker(np.array(motion.position), velocity, rng)
        world[obstacle.id] = base
    return world


def _online_of(family: str) -> OnlineSettings:
    if family == BELIEVED:
        return OnlineSettings(forget_after=FORGET_AFTER, alarm_probability=0.0, manoeuvre=0.0)
    return OnlineSettings(forget_after=FORGET_AFTER)


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
    wall = 1e3 * run.wall_times[1:]
    return {
        "arrived": int(run.arrived),
        "contact": int(run.contact),
        "contact_standing": int(run.contact_standing),
        "travel_time": run.travel_time,
        "truth_time": truth,
        "least_clearance": run.least_clearance,
        "cycles": len(run.records),
        "improved": 0,
        "kept": 0,
        "repaired": 0,
        "braking": 0,
        **run.outcomes,
        "unsafe": sum(not record.safe for record in run.records),
        "median_ms": float(np.median(wall)),
        "longest_ms": float(wall.max()),
    }


# how often the truth is in its region, some time ahead

LEADS = (0.0, 1.0, 2.0, 4.0)  # s; 0: the next observation
DRIVEN = 20.0  # s of a run in which coverage is counted, after `BEFORE`


@dataclass
class Counted:
    """Predictions of one lead time: how many, how many held, and the sum of the areas of their regions over pi, m2."""

    number: int = 0
    held: int = 0
    area: float = 0.0


def coverage_of(
    courses: Mapping[str, Course],
    times: Array,
    seen: Mapping[str, Array],
    regions: Regions,
    order: int,
    since: float,
) -> list[Counted]:
    """Count how often truth is in the region that was given of it one observation, 1 s, 2 s and 4 s before.

    Parameters
    ----------
    courses : mapping of str to Course
        The truth.
    times : (n,) array
        Of the observations, s.
    seen : mapping of str to (n, 2) array
        Observed positions, m; NaN where there is none.
    regions : Regions
    order : int
        Of the motions.
    since : float
        Predictions before this time, s, only serve to learn.
    """
    tracks = ObstacleTracks(sp.Confidence(probability=0.95, level="per_time"), watch=Watch(regions=regions))
    model, counted = sp.Model(order=order), [Counted() for _ in LEADS]
    step = float(np.median(np.diff(times)))
    for number, time in enumerate(times):
        for name, positions in seen.items():
            place = positions[number]
            if np.isnan(place).any():
                continue
            if name not in tracks.tracks:
                tracks.add_unseen(name, sp.Disc(disc=0.3), model, 0.0, NOISE**2 * np.eye(2))
            tracks.observe(name, float(time), (float(place[0]), float(place[1])))
        for name in [name for name, track in tracks.tracks.items() if time - track.times[-1] > 2.5 * step]:
            tracks.remove(name)
        for zone in tracks.zones(float(time)):
            track = tracks.tracks[zone.id]
            if time < since or not track.settled:
                continue
            later = time + np.array([lead or step for lead in LEADS])
            truth, center, covariance = courses[zone.id](later), zone.center(later), zone.covariance(later)
            for lead, count in enumerate(counted):
                offset = truth[lead] - center[lead]
                if not np.isnan(offset).any():
                    count.number += 1
                    count.held += int(offset @ np.linalg.solve(covariance[lead], offset) <= 1.0)
                    count.area += math.sqrt(float(np.linalg.det(covariance[lead])))
    return counted


def synthetic_coverage(family: str, seed: int, regions: Regions) -> list[Counted]:
    """Coverage in one run of a family."""
    rng = np.random.default_rng([seed, 5])
    scenario = families.as_scenario(families.random_scenario("crossing10", rng, "coverage"))
    world = world_of(scenario, family, seed, 0.5 * DRIVEN)
    times = np.arange(-BEFORE + 2.0, DRIVEN, 1.0 / RATE)
    noise, sensor = np.random.default_rng([seed, 13]), sensor_of(family)
    seen = {}
    for name, course in world.items():
        size = np.where(noise.random(len(times)) < sensor.outliers, OUTLIER_SIZE, sensor.factor)[:, None]
        seen[name] = course(times) + NOISE * size * noise.standard_normal((len(times), 2))
    return coverage_of(world, times, seen, regions, 2, 0.0)


def recorded_coverage(tracks: Tracks, regions: Regions, longest: float = 200.0) -> list[Counted]:
    """Coverage of recorded motions, in the second half of what is looked at."""
    some = [track for track in tracks if len(track) > 4]
    step = float(np.median(np.concatenate([np.diff(track.times) for track in some])))
    begin = min(float(track.times[0]) for track in some)
    end = min(max(float(track.times[-1]) for track in some), begin + longest)
    times = np.arange(begin, end, max(step, 0.1))
    courses = {track.id: track_course(track) for track in some if track.times[0] < end}
    noise = np.random.default_rng(3)
    seen = {
        name: course(times) + RECORDED_NOISE * noise.standard_normal((len(times), 2))
        for name, course in courses.items()
    }
    return coverage_of(courses, times, seen, regions, 1, 0.5 * (begin + end))
