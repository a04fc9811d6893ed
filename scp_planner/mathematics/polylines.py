"""Polylines: how long they are, and points along them."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array


def lengths_along(line: Array) -> Array:
    """Lengths of a polyline, (k, 2) m, up to its points, (k,) m."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def points_at(wanted: Array | float, known: Array, line: Array, beyond: float | None = None) -> Array:
    """Points (..., 2) of a polyline (k, 2) at lengths or times (...), those of its points known, (k,).

    Beyond its ends they are the ends, or have the coordinates that are given.
    """
    return np.stack([np.interp(wanted, known, each, left=beyond, right=beyond) for each in line.T], axis=-1)


def rates(values: Array, times: Array) -> Array:
    """Derivatives of values (n, ...) by times (n,), some of which may be equal; 0 where all are."""
    later = np.concatenate([[True], np.diff(times) > 0.0])
    if later.sum() < 2:
        return np.zeros_like(values, dtype=float)
    found: Array = np.gradient(values[later], times[later], axis=0)[np.cumsum(later) - 1]
    return found
