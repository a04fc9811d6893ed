"""Ratio of a sensor's noise to its declared noise, from differences of neighbouring observations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.tracking.tolerances import LEAST_DEVIATION


@dataclass(frozen=True)
class NoiseParameters:
    newest: int = 512  # Newest third differences that the noise is estimated from
    # Standard errors by which the noise must exceed what is declared, to be believed; from then on one is enough
    sure: float = 4.0
    fewest: int = 12  # Fewest measurements of one obstacle from which a change of its motion is found
    most: int = 64  # Newest measurements that are looked at for that
    exact: float = 10.0  # Least standard deviations that are used, up to which residuals are no sign of another motion
    median: float = 1.3862943611198906  # Of chi-square with 2 degrees of freedom
    median_error: float = 2.28  # Relative standard error of the median of n overlapping differences, times sqrt(n)


# With noise twice as declared trips take 1.96 +- 0.11 times as long where it is not noticed, with three times as much
# 2.13 +- 0.14 times (`benchmarks.online noticing`, noise2 and noise3, seeds 500 to 509).
NOISE = NoiseParameters()
NEIGHBOURS = 4
"""Observations that a third difference is of."""
_SELF = np.eye(NEIGHBOURS)[..., None]


def third_differences(times: Array, positions: Array, whiten: Array) -> Array:
    """Squared third divided differences, standardised so that for white noise they are chi-square with 2 degrees."""
    if times.shape[1] and (times == times[:, :1]).all():
        times = times[:, :1]  # as in a frame
    between = times[:, None] - times[None] + _SELF
    weights = 1.0 / between.prod(axis=1)
    weights /= np.sqrt((weights * weights).sum(axis=0))
    x, y = weights[:, 0] @ positions if weights.shape[1] == 1 else (weights * positions).sum(axis=1)
    first, second = whiten[:, 0, 0] * x, whiten[:, 1, 0] * x + whiten[:, 1, 1] * y
    return np.asarray(first * first + second * second)


def neighbour_differences(times: Array, positions: Array, whiten: Array) -> Array:
    """`third_differences` of all neighbours in (n,) s and (n, 2) m; whiten as there, (2, 2)."""
    if len(times) < NEIGHBOURS:
        return np.zeros(0)
    view = np.lib.stride_tricks.sliding_window_view
    clock, places = view(times, NEIGHBOURS).T, view(positions, NEIGHBOURS, axis=0).transpose(1, 2, 0)
    apart = np.diff(clock, axis=0).min(axis=0) > 0.0
    return third_differences(clock[:, apart], places[..., apart], whiten[None])


def is_misfit(times: Sequence[float], positions: Sequence[tuple[float, float]], noise: Array) -> bool:
    """True if residuals are larger than neighbouring observations explain, (n,) s and (n, 2) m."""
    if len(times) < NOISE.fewest or np.trace(noise) < NOISE.exact**2 * LEAST_DEVIATION**2:
        return False
    newest, places = np.array(times[-NOISE.most :]), np.array(positions[-NOISE.most :])
    differences = neighbour_differences(newest, places, np.linalg.inv(np.linalg.cholesky(noise)))
    if len(differences) < NOISE.fewest - NEIGHBOURS:
        return False
    doubt = NOISE.sure * NOISE.median_error / math.sqrt(len(differences))
    return float(np.median(differences)) / NOISE.median < 1.0 / (1.0 + doubt)


class NoiseWatch:
    def __init__(self) -> None:
        self._newest = np.zeros(0)
        self.factor = 1.0
        """Its variance as a multiple of what is declared, never below 1."""

    def take_in(self, differences: Array) -> bool:
        """Take in standardised squared third differences, (n,); return whether the noise is another now."""
        self._newest = np.concatenate([self._newest, differences])[-NOISE.newest :]
        if not len(self._newest):
            return False
        doubt = (NOISE.sure if self.factor == 1.0 else 1.0) * NOISE.median_error / math.sqrt(len(self._newest))
        ratio = float(np.median(self._newest)) / NOISE.median / self.factor
        if 1.0 / (1.0 + doubt) <= ratio <= 1.0 + doubt:
            return False
        before, self.factor = self.factor, max(self.factor * ratio, 1.0)
        return self.factor != before
