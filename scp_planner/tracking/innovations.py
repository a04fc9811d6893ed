"""Improbability of the newest innovations, over windows of several lengths."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from scp_planner.arrays import Array, Single


@dataclass(frozen=True)
class InnovationParameters:
    # Numbers of the newest innovations that are tested together
    windows: tuple[int, ...] = (2, 3, 4, 6, 8, 12, 16, 24, 32)
    # Standard deviations to which innovations are cut: an outlier alone makes no alarm of a probability of `RARE`
    wild: float = 4.0


INNOVATIONS = InnovationParameters()


@cache
def _weights() -> Single:
    """Weights of the trend in each window, (ring, windows), oldest first: squares 1, 4, 9 ..., of length 1."""
    weights = np.zeros((INNOVATIONS.windows[-1], len(INNOVATIONS.windows)))
    for column, window in enumerate(INNOVATIONS.windows):
        weights[INNOVATIONS.windows[-1] - window :, column] = np.arange(1, window + 1) ** 2
    return np.asarray(weights / np.linalg.norm(weights, axis=0), dtype=np.float32)


@lru_cache(maxsize=8)
def _members(probability: float) -> Single:
    """One over the quantile of chi-square for the size of each window, (windows, ring); 0 of what is not in it."""
    from scipy.special import gammainccinv

    limits = 2.0 * gammainccinv(np.array(INNOVATIONS.windows, dtype=float), probability)
    return np.asarray(((_weights() > 0.0) / limits).T, dtype=np.float32)


def cut(innovations: Array) -> Single:
    """Give standardised innovations (2, ...) as windows look at them: cut at `wild`, and their squares, (3, ...).

    They have 32 bits, which take half of the time of 64 to test: an alarm is no matter of the eighth digit.
    """
    x, y = innovations
    squares = x * x + y * y
    within = np.minimum(squares, INNOVATIONS.wild**2)
    share = np.sqrt(within / np.maximum(squares, INNOVATIONS.wild**2 * 1e-9))
    return np.stack([share * x, share * y, within]).astype(np.float32)


def tested(innovations: Single, probability: float) -> tuple[Single, Single]:
    """Squared trends and test statistics of the windows over the newest innovations, cut, (3, ..., ring, n), in order.

    Both are (..., windows, n): trends are chi-square with 2 degrees of freedom, and an alarm, of a probability, is a
    statistic above 1.
    """
    x, y, squares = innovations
    weights = _weights().T
    trends = (weights @ x) ** 2 + (weights @ y) ** 2
    return trends, np.maximum(_members(probability) @ squares, trends / (-2.0 * math.log(probability)))
