"""Improbability of the newest innovations, over windows of several lengths."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from scp_planner.arrays import Array, Reals


@dataclass(frozen=True)
class InnovationParameters:
    # Numbers of the newest innovations that are tested together
    windows: tuple[int, ...] = (2, 3, 4, 6, 8, 12, 16, 24, 32)
    # Standard deviations to which innovations are cut: an outlier alone makes no alarm of a probability of `RARE`
    wild: float = 4.0


INNOVATIONS = InnovationParameters()


@lru_cache(maxsize=2)
def _weights(kind: np.dtype[Any]) -> Array:
    """Weights of the trend in each window, (ring, windows), oldest first: squares 1, 4, 9 ..., of length 1."""
    weights = np.zeros((INNOVATIONS.windows[-1], len(INNOVATIONS.windows)))
    for column, window in enumerate(INNOVATIONS.windows):
        weights[INNOVATIONS.windows[-1] - window :, column] = np.arange(1, window + 1) ** 2
    return np.asarray(weights / np.linalg.norm(weights, axis=0), dtype=kind)


@lru_cache(maxsize=8)
def _members(kind: np.dtype[Any], probability: float) -> Array:
    """One over the quantile of chi-square for the size of each window, (windows, ring); 0 of what is not in it."""
    from scipy.special import gammainccinv

    limits = 2.0 * gammainccinv(np.array(INNOVATIONS.windows, dtype=float), probability)
    return np.asarray(((_weights(np.dtype(float)) > 0.0) / limits).T, dtype=kind)


def cut(innovations: Array) -> Array:
    """Give standardised innovations (2, ...) as windows look at them: cut at `wild`, and their squares, (3, ...)."""
    x, y = innovations
    found = np.empty((3, *x.shape))
    squares = x * x + y * y
    within = np.minimum(squares, INNOVATIONS.wild**2, out=found[2])
    share = np.sqrt(within / np.maximum(squares, INNOVATIONS.wild**2 * 1e-9))
    np.multiply(share, innovations, out=found[:2])
    return found


def larger_of(trends: Reals, squares: Reals, probability: float) -> Reals:
    """Test statistics of windows by their trends and sizes: an alarm, of a probability, above 1."""
    sizes: Reals = _members(squares.dtype, probability) @ squares
    return np.maximum(sizes, trends / (-2.0 * math.log(probability)), out=sizes)  # a float leaves 32 bits what they are


def trends_of(x: Reals, y: Reals) -> Reals:
    """Squared trends of the newest innovations, window by window: (..., windows, n), chi-square with 2 degrees."""
    weights = _weights(x.dtype).T
    trends, others = weights @ x, weights @ y
    trends *= trends
    others *= others
    trends += others
    return np.asarray(trends)
