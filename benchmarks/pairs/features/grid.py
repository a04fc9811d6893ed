"""Map of the ground: blocks of occupied cells beside the motion."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely

from benchmarks.hostile.features import Data, Rng
from benchmarks.pairs.motion import Array
from benchmarks.pairs.scene import Scene

CELL = (0.3, 0.8)
"""Radii of the vehicle that the edge of a cell may be."""


def add(scene: Scene, rng: Rng) -> None:
    scene.map = draw_map(scene, rng)


def draw_map(scene: Scene, rng: Rng) -> Data:
    """Draw a map round the motion, of which no occupied cell is near it."""
    low, high = np.array(shapely.bounds(scene.swept)).reshape(2, 2) + 6.0 * scene.clear * np.array([[-1.0], [1.0]])
    edge = float(rng.uniform(*CELL)) * scene.vehicle["radius"]
    yaw = float(rng.choice([0.0, rng.uniform(-0.5, 0.5)]))
    middle, size = 0.5 * (low + high), high - low
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    columns, rows = (math.ceil(each / edge) for each in np.abs(turn) @ size)
    origin = middle - turn @ (0.5 * edge * np.array([columns, rows]))
    cells = np.zeros((rows, columns), dtype=bool)
    for _ in range(int(rng.integers(5, 25))):
        height, width = (int(rng.integers(1, max(2, most // 4))) for most in (rows, columns))
        row, column = int(rng.integers(0, rows)), int(rng.integers(0, columns))
        cells[row : row + height, column : column + width] = True
    found = {"cells": cells.astype(int).tolist(), "resolution": edge, "origin": origin.tolist(), "yaw": yaw}
    return freed({**found, "beyond": bool(rng.random() < 0.5)}, scene.swept, scene.clear)


def freed(drawn: Data, kept: Any, clear: float) -> Data:
    """Return a map without the occupied cells that are nearer to a shapely geometry than a distance, m."""
    cells = np.array(drawn["cells"], dtype=bool)
    away = shapely.distance(shapely.points(_middles(drawn, cells)), kept)
    cells &= away > clear + drawn["resolution"]
    return {**drawn, "cells": cells.astype(int).tolist()}


def _middles(drawn: Data, cells: np.ndarray) -> Array:
    """Middles (rows, columns, 2) of the cells of a map, m."""
    rows, columns = (np.arange(size) + 0.5 for size in cells.shape)
    x, y = np.meshgrid(columns * drawn["resolution"], rows * drawn["resolution"])
    cos, sin = math.cos(drawn["yaw"]), math.sin(drawn["yaw"])
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1) + np.array(drawn["origin"])
