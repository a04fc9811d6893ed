"""The highest value of a piecewise polynomial, enclosed as closely as a limit asks for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import comb, isfinite, nan

import numpy as np

from scp_planner.arrays import Array

MOST_HALVINGS = 30  # of a piece: what is then still open lies within rounding of the limit


@dataclass(frozen=True)
class Highest:
    """The highest value that was found."""

    value: float  # Exceeds the limit only if a value does; else a bound of all values that does not
    piece: int
    local: float  # and at which share of the piece
    kept: bool


def highest(coefficients: Array, limit: float) -> Highest:
    """Find out whether a piecewise polynomial keeps an upper limit."""
    to_bernstein, left, right = _matrices(coefficients.shape[1])
    points = coefficients @ to_bernstein.T
    sites = _sites(points.shape[1])
    least, most = float(points.min()), float(points.max())
    if not (isfinite(least) and isfinite(most)):
        return Highest(nan, 0, 0.0, kept=False)
    if most <= limit:  # as of nearly all that is asked for while driving
        k, site = divmod(int(points.argmax()), points.shape[1])
        return Highest(most, k, float(sites[site]), kept=True)
    piece = np.arange(len(points))
    begin, width = np.zeros(len(points)), 1.0
    bound = -np.inf, 0, 0.0
    for _ in range(MOST_HALVINGS):
        ends = points[:, [0, -1]]
        k, end = divmod(int(np.argmax(ends)), 2)
        if ends[k, end] > limit:
            return Highest(float(ends[k, end]), int(piece[k]), float(begin[k] + end * width), kept=False)
        above = points.max(axis=1)
        done = above <= limit
        if done.any():
            best = int(np.argmax(np.where(done, above, -np.inf)))
            if above[best] > bound[0]:
                site = sites[int(np.argmax(points[best]))]
                bound = float(above[best]), int(piece[best]), float(begin[best] + site * width)
        if done.all():
            return Highest(*bound, kept=True)
        points, piece, begin = points[~done], piece[~done], begin[~done]
        width *= 0.5
        points = np.concatenate([points @ left.T, points @ right.T])
        piece, begin = np.tile(piece, 2), np.concatenate([begin, begin + width])
    k = int(np.argmax(points.max(axis=1)))
    return Highest(float(points[k].max()), int(piece[k]), float(begin[k]), kept=False)


@lru_cache(maxsize=16)
def _sites(size: int) -> Array:
    """Places of the maxima of Bernstein polynomials, (P,)."""
    return np.linspace(0.0, 1.0, size) if size > 1 else np.array([0.5])


@lru_cache(maxsize=16)
def _matrices(size: int) -> tuple[Array, Array, Array]:
    """From powers to Bernstein coefficients, and from those to the ones of the left and of the right half, (P, P)."""
    chosen = np.array([[comb(j, i) for i in range(size)] for j in range(size)], dtype=float)  # 0 for i > j
    left = chosen / 2.0 ** np.arange(size)[:, None]
    return chosen / chosen[-1], left, left[::-1, ::-1].copy()
