"""Foreseen zones: those that will be looked at when the vehicle gets there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.polynomials import PiecewisePolynomials, expanded
from scp_planner.threat_zones.batch import ZoneBatch

LONGER = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0])
"""Units of time of further observation after which foreseen zones are computed; in between, they are interpolated."""


@dataclass(frozen=True)
class Learning:
    order: int
    count: int  # Observations
    span: float  # From the first to the last of them, s
    change: float = 0.0


@lru_cache(maxsize=4096)
def least_noise(covariance: bytes) -> float:
    """Smaller eigenvalue of the covariance (2, 2) of an observation, m^2, given as its bytes: it seldom changes."""
    return float(np.linalg.eigvalsh(np.frombuffer(covariance).reshape(2, 2))[0])


def _variances(learning: Sequence[Learning], lead: float) -> Array:
    """Relative variances of K predictions so far ahead, s, after observing for so much longer as `LONGER`, (K, n)."""
    each = np.array([(one.order, one.count, one.span, one.change) for one in learning])
    orders, count, now, change = each.T[:, :, None]
    span = now + LONGER
    s = 1.0 + 2.0 * lead / span
    squared = s * s
    growth = 1.0 + 3.0 * squared * (orders >= 1) + 1.25 * (3.0 * squared - 1.0) ** 2 * (orders >= 2)
    return growth * now / span + 0.25 * change * count * lead**4


def foreseen(batch: ZoneBatch, foresight: float, learning: Mapping[str, Learning], now: float = 0.0) -> ZoneBatch:
    """Zones that do not grow beyond the foresight, but shrink with what will be learnt; see the head of this module."""
    if batch.covariances is None:
        return batch
    covariances = batch.covariances
    pieces, powers, width = covariances.coefficients.shape[1:]
    count = covariances.size
    learnt = []
    if learning:
        known = [(k, learning.get(batch.ids[index])) for k, index in enumerate(batch.uncertain)]
        learnt = [(k, one) for k, one in known if one is not None and one.span > 0.0]
    longer = LONGER if learnt else LONGER[:1]  # what nothing is learnt of stays as it is then, in one piece
    factors = np.ones((count, len(longer)))
    if learnt:
        variance = _variances([one for _, one in learnt], foresight)
        factors[[k for k, _ in learnt]] = variance / variance[:, :1]
    every = np.arange(count)
    size = covariances.at(every, np.full(count, now + foresight))
    # Pieces that begin after the foresight are empty, and those that follow them are taken first.
    begins = np.minimum(covariances.breakpoints[:, :-1], now + foresight)
    coefficients = np.zeros((count, pieces + len(longer), max(powers, 2), width))
    coefficients[:, :pieces, :powers] = covariances.coefficients
    coefficients[:, pieces:, 0] = factors[:, :, None] * size[:, None]
    if learnt:
        slopes = (factors[:, 1:] - factors[:, :-1]) / np.diff(LONGER)
        coefficients[:, pieces:-1, 1] = slopes[:, :, None] * size[:, None]
    later = np.broadcast_to(now + foresight + longer, (count, len(longer)))
    end = np.full((count, 1), np.inf)
    seen = PiecewisePolynomials(np.concatenate([begins, later, end], axis=1), coefficients)
    if batch.expected is None:
        return replace(batch, covariances=seen)
    return replace(batch, covariances=seen, centers=_beside(batch.centers, batch.expected, now + foresight))


def _beside(centers: PiecewisePolynomials, expected: PiecewisePolynomials, until: float) -> PiecewisePolynomials:
    """Centres that from a time on stay where they are then beside others."""
    count, every = centers.size, np.arange(centers.size)
    instant = np.full(count, until)
    offset = centers.at(every, instant) - expected.at(every, instant)
    begins = [np.minimum(centers.breakpoints[:, :-1], until), np.maximum(expected.breakpoints[:, :-1], until)]
    (_, had, terms, width), (_, more, others, _) = centers.coefficients.shape, expected.coefficients.shape
    late = np.maximum(until - expected.breakpoints[:, :-1], 0.0)
    moved = expanded(expected.coefficients.reshape(-1, others, width), late.ravel()).reshape(count, more, others, width)
    coefficients = np.zeros((count, had + more, max(terms, others), width))
    coefficients[:, :had, :terms], coefficients[:, had:, :others] = centers.coefficients, moved
    coefficients[:, had:, 0] += offset[:, None]
    return PiecewisePolynomials(np.concatenate([*begins, np.full((count, 1), np.inf)], axis=1), coefficients)


def smaller(batch: ZoneBatch, share: float) -> ZoneBatch:
    """Zones whose ellipses are so many times as large."""
    if batch.covariances is None or share == 1.0:
        return batch
    breaks, whole = batch.covariances.breakpoints, batch.covariances.coefficients
    return replace(batch, covariances=PiecewisePolynomials(breaks, share**2 * whole))
