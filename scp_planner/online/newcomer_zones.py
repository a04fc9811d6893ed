"""Zones of many newcomers at once: polynomial motions of one order that have not been seen for long."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index, kronecker
from scp_planner.mathematics.polynomials import shift_matrices
from scp_planner.online.many_zones import Future, Level, lengths_of_polynomials, made_zones
from scp_planner.online.track import ObstacleTrack
from scp_planner.threat_zones.of_scenario import HORIZON
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.tracking.maximum_likelihood import MotionPrior, prior_rows
from scp_planner.tracking.motion_estimate import POLYNOMIAL_TERMS
from scp_planner.tracking.recursive import SquareRoots


@dataclass(frozen=True)
class Primed:
    """K motions, estimated from observations and a prior, in powers of the time since their centres."""

    some: Index  # (K,)
    coefficients: Array  # (K, p, 2) Relative to their origins, m/s^k
    covariance: Array  # (K, p, 2, p, 2)

    @classmethod
    def of(cls, roots: SquareRoots, noise: Array, prior: MotionPrior) -> Primed:
        """Estimate motions of order 1 or 2."""
        count, p = roots.factor.shape[:2]
        whiten = np.linalg.inv(np.linalg.cholesky(noise))
        seen = kronecker(roots.factor, whiten)
        target = (roots.right @ whiten.transpose(0, 2, 1)).reshape(count, 2 * p)
        added, means = _at_last(prior, roots.last - roots.center, p)
        design = np.concatenate([seen, added], axis=1)
        q, r = np.linalg.qr(design)
        sizes = np.linalg.norm(design, axis=1)
        some = np.flatnonzero(_determined(r, sizes, design.shape[1]))
        inverse = np.linalg.inv(r[some])
        sides = np.concatenate([target, np.broadcast_to(means, (count, len(means)))], axis=1)[some, :, None]
        coefficients = inverse @ (q[some].transpose(0, 2, 1) @ sides)
        covariance = inverse @ inverse.transpose(0, 2, 1)
        return cls(some, coefficients.reshape(-1, p, 2), covariance.reshape(-1, p, 2, p, 2))


def _at_last(prior: MotionPrior, last: Array, p: int) -> tuple[Array, Array]:
    """The prior at times ``last`` (K,) as rows (K, q, 2 p) and what they come to, (q,): rows are linear in the time."""
    at_center, after = prior_rows(prior, 0.0, 1.0, p), prior_rows(prior, 1.0, 1.0, p)
    assert at_center is not None and after is not None, "it tells something"
    return at_center[0] + last[:, None, None] * (after[0] - at_center[0]), at_center[1]


def _determined(r: Array, sizes: Array, rows: int) -> Array:
    """True if designs of so many rows have full rank beyond doubt, as `numpy.linalg.matrix_rank` means it."""
    scaled = np.abs(np.diagonal(r, axis1=1, axis2=2)) / np.maximum(sizes, np.finfo(float).tiny)
    least = scaled.prod(axis=1) / math.sqrt(math.e)
    return np.asarray(least > np.sqrt(r.shape[-1]) * max(rows, r.shape[-1]) * np.finfo(float).eps)


def newcomers_together(
    tracks: Sequence[ObstacleTrack], roots: SquareRoots, prior: MotionPrior, start: float, level: Level
) -> dict[str, ThreatZone]:
    """Make the zones of newcomers of one order whose noise is known, all at once."""
    primed = Primed.of(roots, np.array([track.known_noise for track in tracks]), prior)
    some = primed.some
    if not len(some):
        return {}
    p = primed.coefficients.shape[1]
    shift = shift_matrices(p, start - roots.center[some])
    center = shift @ primed.coefficients
    center[:, 0] += roots.origin[some]
    pairs = primed.covariance.transpose(0, 2, 4, 1, 3)
    errors = shift[:, None, None] @ pairs @ shift.transpose(0, 2, 1)[:, None, None]
    blocks = _of_time(errors, 0, 0)
    covariance = np.stack([blocks[:, :, 0, 0], 0.5 * (blocks[:, :, 0, 1] + blocks[:, :, 1, 0]), blocks[:, :, 1, 1]], 2)

    def lengths() -> Array:
        return lengths_of_polynomials(blocks, _of_time(errors, 0, 1), _of_time(errors, 1, 1))

    rates = errors[:, :, :, 1, 1]
    future = Future(np.array([start, start + HORIZON]), center[:, None], covariance[:, None], rates)
    new = [tracks[k] for k in some.tolist()]
    zones = made_zones(new, future, level, level.scales(new, lengths))
    return {track.id: zone for track, zone in zip(new, zones, strict=True)}


def _of_time(errors: Array, first: int, second: int) -> Array:
    """Covariances of so manieth derivatives of errors, as polynomials of time, (K, POLYNOMIAL_TERMS, 2, 2)."""
    p = errors.shape[-1]
    found = np.zeros((len(errors), POLYNOMIAL_TERMS, 2, 2))
    for j in range(first, p):
        for k in range(second, p):
            factor = (j if first else 1) * (k if second else 1)
            found[:, j - first + k - second] += factor * errors[:, :, :, j, k]
    return found
