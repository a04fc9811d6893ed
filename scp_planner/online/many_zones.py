"""Estimated motions of many obstacles at once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from scp_planner.arrays import Array
from scp_planner.estimation.error_laws import NormalErrors
from scp_planner.estimation.motion_estimate import POLYNOMIAL_TERMS
from scp_planner.mathematics.polynomials import shift_matrices

PANELS, NODES = 4, 12  # of the quadrature of standardised lengths


_NORMAL = NormalErrors()


_ONE = np.ones(1)


def _shift(order: int, shift: Array, scale: Array) -> Array:
    """Matrices from coefficients of powers of u to those of s, where u = shift + scale s, (K, p, p)."""
    matrix = shift_matrices(order + 1, shift)
    matrix *= scale[:, None, None] ** np.arange(order + 1)[:, None]
    return matrix


@lru_cache(maxsize=8)
def _products(terms: int) -> Array:
    """Matrix from the products of coefficients k and m, in rows, to the coefficient k + m."""
    matrix = np.zeros((terms, terms, POLYNOMIAL_TERMS))
    for k in range(terms):
        for m in range(terms):
            matrix[k, m, k + m] = 1.0
    return matrix.reshape(-1, POLYNOMIAL_TERMS)


def _lengths(spread: Array, start: Array, stop: Array) -> Array:
    """Standardised lengths of K polynomial motions over spans of normalised time, (K,).

    See `scp_planner.estimation.motion_estimate`: s = tan(angle), and the rows (1, s, s^2) become (cos^2, sin cos,
    sin^2).
    """
    order = spread.shape[1] - 1
    if order == 0:
        return np.zeros(len(spread))
    nodes, weights = _quadrature()
    low, high = np.arctan(start), np.arctan(stop)
    angles = low[:, None] + (high - low)[:, None] * nodes
    sine, cosine = np.sin(angles), np.cos(angles)
    if order == 1:
        rows, slopes = [cosine, sine], [-sine, cosine]
    else:
        both = sine * cosine
        rows = [cosine * cosine, both, sine * sine]
        slopes = [-2.0 * both, cosine * cosine - sine * sine, 2.0 * both]
    x, y = np.stack(rows, axis=-1), np.stack(slopes, axis=-1)
    weighted = x @ spread
    error, cross = (weighted * x).sum(axis=-1), (weighted * y).sum(axis=-1)
    rate = ((y @ spread) * y).sum(axis=-1)
    speed = np.sqrt(np.maximum(rate * error - cross * cross, 0.0)) / error
    return (high - low) * (speed @ weights)


def _quadrature() -> tuple[Array, Array]:
    global _RULE
    if _RULE is None:
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        edges = np.arange(PANELS) / PANELS
        points = (edges[:, None] + (0.5 + 0.5 * nodes) / PANELS).ravel()
        _RULE = points, np.tile(0.5 * weights / PANELS, PANELS)
    return _RULE


_RULE: tuple[Array, Array] | None = None
