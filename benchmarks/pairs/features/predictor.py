"""Predictor that the planner asks for the courses of obstacles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from benchmarks.hostile.features import Data, Rng
from benchmarks.pairs.features.obstacles import KNOTS, course, cross
from benchmarks.pairs.motion import Array
from benchmarks.pairs.scene import Scene


class Knowing:
    """A predictor that knows where obstacles will be."""

    def __init__(self, places: Mapping[str, Callable[[Array], Array]]) -> None:
        self.places = places

    def predict(self, now: float, horizon: float) -> Mapping[str, Any]:
        times = now + np.linspace(0.0, horizon, KNOTS)
        return {
            name: {"time": times.tolist(), "position": place(times).tolist()} for name, place in self.places.items()
        }


def add(scene: Scene, rng: Rng) -> None:
    """Add obstacles on courses, of which the planner knows only where they are at first but for the predictor."""
    places: dict[str, Callable[[Array], Array]] = {}
    for number in range(int(rng.integers(1, 3))):
        name, size = f"predicted{number}", float(rng.uniform(0.2, 0.6))
        places[name] = cross(scene, size, lambda since: np.zeros_like(since), rng)
        truth: Data = {"id": name, "shape": {"disc": size}, "motion": course(scene, places[name])}
        scene.data["obstacles"].append(truth)
        scene.known[name] = {**truth, "motion": {"position": truth["motion"]["position"][0], "velocity": [0.0, 0.0]}}
    scene.predictor = Knowing(places)
