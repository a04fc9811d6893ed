"""Walls beside the motion, and a corridor round it."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import shapely

from benchmarks.hostile.features import Rng
from benchmarks.pairs.motion import Array
from benchmarks.pairs.scene import Scene


def add(scene: Scene, rng: Rng) -> None:
    which = int(rng.integers(3))
    if which != 0:
        scene.data["walls"] = draw_walls(scene, rng)
    if which != 1:
        scene.data["corridor"] = draw_corridor(scene, rng)


def draw_walls(scene: Scene, rng: Rng) -> list[Any]:
    """Draw convex polygons beside the motion."""
    return [corners(_wall(scene, rng)) for _ in range(int(rng.integers(1, 5)))]


def _wall(scene: Scene, rng: Rng) -> Any:
    size = float(np.exp(rng.uniform(0.0, np.log(8.0)))) * scene.vehicle["radius"]
    angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, int(rng.integers(3, 7))))
    ring = shapely.convex_hull(shapely.multipoints(size * np.stack([np.cos(angles), np.sin(angles)], axis=1)))

    def at(place: Array) -> Any:
        return shapely.affinity.translate(ring, *place)

    return scene.put_beside(at, rng)


def draw_corridor(scene: Scene, rng: Rng) -> list[Any]:
    """Cover the motion by rectangles that overlap, each round a part of it."""
    count = int(rng.integers(3, 8))
    ends = np.linspace(0, scene.centres.shape[1] - 1, count + 1).round().astype(int)
    room = scene.clear * float(rng.uniform(1.0, 2.5))
    found = []
    for first, last in itertools.pairwise(ends):
        part = shapely.multipoints(scene.centres[:, first : last + 1].reshape(-1, 2))
        box = shapely.oriented_envelope(part)
        found.append(corners(shapely.buffer(box, room, cap_style="square", join_style="mitre")))
    return found


def corners(polygon: Any) -> Any:
    """Give the corners of a shapely polygon, as a scenario has them."""
    ring = shapely.get_exterior_ring(shapely.normalize(polygon))
    return shapely.get_coordinates(ring)[:-1].tolist()
