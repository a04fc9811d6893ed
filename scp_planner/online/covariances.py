"""Covariances as sensors and trackers give them, made such that estimates can be computed from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.online.tolerances import EIGENVALUE, LEAST_DEVIATION, MOST_DEVIATION
from scp_planner.scenario.obstacle_checks import SYMMETRY


def square_matrix(value: ArrayLike, size: int) -> Array:
    """Covariance as an array (size, size) of finite numbers; a `ValueError` names what is wrong."""
    try:
        matrix = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"covariance: it is not an array of numbers ({error})") from None
    if matrix.shape != (size, size):
        raise ValueError(f"covariance: its shape is {matrix.shape}; it must have {size} rows of {size} numbers")
    if not np.isfinite(matrix).all():
        raise ValueError(f"covariance: {matrix.tolist()} is not finite")
    return matrix


def repaired(matrix: Array, units: ArrayLike) -> Array:
    """Covariance that is symmetric and positive definite."""
    kinds = np.repeat(np.asarray(units, dtype=float), 2)
    least, most = LEAST_DEVIATION * kinds, MOST_DEVIATION * kinds
    scale = np.maximum(_largest_of_kind(matrix), least)
    unlike = np.abs(matrix - matrix.T) / np.outer(scale, scale)
    if (unlike > SYMMETRY).any():
        i, j = np.unravel_index(int(np.argmax(unlike)), unlike.shape)
        pair = f"its entries [{i}][{j}] = {float(matrix[i, j])!r} and [{j}][{i}] = {float(matrix[j, i])!r}"
        raise ValueError(f"covariance: {matrix.tolist()} is not symmetric: {pair} must be the same")
    found = _definite(0.5 * (matrix + matrix.T), scale, least)
    shrunk = np.minimum(1.0, most / np.sqrt(np.diag(found)))
    return found * np.outer(shrunk, shrunk)


def _largest_of_kind(matrix: Array) -> Array:
    """Square roots of the largest entries of each kind of quantity, (n,): the size that rounding is relative to."""
    kinds = len(matrix) // 2
    blocks = np.abs(matrix.reshape(kinds, 2, kinds, 2)[range(kinds), :, range(kinds)])
    return np.repeat(np.sqrt(blocks.reshape(kinds, 4).max(axis=1)), 2)


def _definite(matrix: Array, scale: Array, least: Array) -> Array:
    """Symmetric matrix with no eigenvalue of its correlations below the least; refused if that is no rounding."""
    own = np.diag(matrix)
    if (own >= least**2).all():
        correlations = matrix / np.sqrt(np.outer(own, own))
        if np.linalg.eigvalsh(correlations)[0] > EIGENVALUE:
            return matrix
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    if values[0] < -SYMMETRY * max(float(values[-1]), 1.0):
        raise ValueError(f"covariance: {matrix.tolist()} is not positive definite")
    raised = np.maximum(values, max(2.0 * EIGENVALUE, -float(values[0])))
    found: Array = (vectors * raised) @ vectors.T * np.outer(scale, scale)
    found = 0.5 * (found + found.T)
    return found + np.diag(np.maximum(least**2 - np.diag(found), 0.0))
