"""Obstacles on courses, and obstacles of which the future is uncertain, that cross the motion in time."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from benchmarks.hostile.features import Data, Rng
from benchmarks.pairs.motion import Array
from benchmarks.pairs.scene import FARTHER, Scene

DEVIATIONS = 7.0
"""Standard deviations about the expected place of an uncertain obstacle that stay clear of the motion."""
KNOTS = 8


def add_courses(scene: Scene, rng: Rng) -> None:
    """Add discs and rectangles on courses that bend."""
    for number in range(int(rng.integers(1, 4))):
        size = float(rng.uniform(0.2, 0.8))
        place = cross(scene, size, lambda since: np.zeros_like(since), rng)
        shape: Data = {"disc": size}
        if rng.random() < 0.3:
            shape = {"rectangle": (2.0 * size * np.array([0.8, 0.6])).tolist()}
        scene.data["obstacles"].append({"id": f"course{number}", "shape": shape, "motion": course(scene, place)})


def add_uncertain(scene: Scene, rng: Rng) -> None:
    """Add discs that are predicted with a covariance, or reported by a tracker with one."""
    for number in range(int(rng.integers(1, 3))):
        size, first, growth = float(rng.uniform(0.2, 0.6)), *(float(rng.uniform(0.01, 0.03)) for _ in range(2))
        made: Data = {"id": f"uncertain{number}", "shape": {"disc": size}}

        def spread(since: Array, first: float = first, growth: float = growth) -> Array:
            return np.hypot(first, growth * since)

        place = cross(scene, size, spread, rng, bent=False)
        if rng.random() < 0.5:
            motion = course(scene, place)
            deviations = spread(np.array(motion["time"]) - scene.motion.start)
            made["motion"] = {**motion, "covariance": [(each**2 * np.eye(2)).tolist() for each in deviations]}
        else:
            here, later = place(scene.motion.start + np.array([0.0, 1.0]))
            covariance = np.diag(np.array([first, first, growth, growth]) ** 2).tolist()
            state = {"time": scene.motion.start, "position": here.tolist(), "velocity": (later - here).tolist()}
            made.update(estimate={**state, "covariance": covariance}, model={"order": 1})
        scene.data["obstacles"].append(made)


def course(scene: Scene, place: Callable[[Array], Array]) -> Data:
    """Sample a motion from the start on, for twice as long as the motion of the vehicle takes."""
    times = scene.motion.start + np.linspace(0.0, 2.0, KNOTS) * scene.motion.duration
    return {"time": times.tolist(), "position": place(times).tolist()}


def cross(
    scene: Scene, size: float, spread: Callable[[Array], Array], rng: Rng, *, bent: bool = True
) -> Callable[[Array], Array]:
    """Draw a motion that crosses the vehicle's, before or after it; moved away until it is clear of it.

    Parameters
    ----------
    scene : Scene
    size : float
        Of the obstacle, m.
    spread : callable
        Times since the start, (n,) s, to standard deviations (n,), m.
    rng : Generator
    bent : bool
        False: at a constant velocity.

    Returns
    -------
    callable
        Times (n,), s, to places (n, 2), m.
    """
    motion = scene.motion
    share, aside = float(rng.uniform(0.2, 1.0)), float(rng.choice([-1.0, 1.0])) * scene.clear
    when = motion.start + share * motion.duration
    angle, speed = float(rng.uniform(-math.pi, math.pi)), float(rng.uniform(0.1, 0.6)) * scene.vehicle["max_speed"]
    velocity = speed * np.array([math.cos(angle), math.sin(angle)])
    bow = bent * rng.normal(0.0, 0.1, 2) * speed / motion.duration
    wide = size + scene.clear + DEVIATIONS * spread(scene.times - motion.start)

    while True:
        met = scene.beside(share, aside)

        def place(times: Array, met: Array = met) -> Array:
            since = (np.asarray(times) - when)[:, None]
            return np.asarray(met + since * velocity + since**2 * bow)

        if (np.linalg.norm(scene.centres - place(scene.times), axis=2) > wide).all():
            return place
        aside *= FARTHER
