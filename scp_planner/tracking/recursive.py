"""Estimates that are updated with each observation, in time that does not grow with their number."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index, Mask, grown, kronecker, run_of
from scp_planner.errors import EstimationError
from scp_planner.tracking.confidence import ErrorLaw, NormalErrors
from scp_planner.tracking.maximum_likelihood import (
    HIGHEST_ORDER,
    Extent,
    MotionPrior,
    Noise,
    check_covariance,
    estimated_noise,
    prior_rows,
)
from scp_planner.tracking.motion_estimate import PolynomialEstimate, shift_powers


@dataclass(frozen=True)
class SquareRoots:
    """Square roots of the information about K motions: R c = d for the coefficients c of powers of t - center."""

    factor: Array  # R, triangular
    right: Array  # d, m; relative to the origins
    center: Array
    origin: Array
    first: Array  # Times of the first and the last observation
    last: Array  # Times of the first and the last observation


class RecursiveEstimator:
    """Polynomial motions of K obstacles, each updated in O(1) by each of its observations."""

    least_deviation: float = 0.0  # Of a noise that is estimated, besides those of `estimated_noise`, m

    def __init__(
        self, obstacles: int = 1, order: int = 2, covariance: ArrayLike | None = None, *, varying: bool = False
    ) -> None:
        if order not in range(HIGHEST_ORDER + 1):
            raise EstimationError(f"order: {order!r} is not 0, 1 or 2")
        if varying and covariance is not None:
            raise EstimationError("covariance: one that varies comes with each observation, not before")
        self.order = order
        self._varying = varying
        sigma = None if covariance is None else check_covariance(covariance, obstacles)
        self._sigma = None if sigma is None else np.broadcast_to(sigma, (obstacles, 2, 2)).copy()
        p = order + 1
        # p unknowns with two right-hand sides, x and y; or 2 p unknowns that varying covariances tie together
        m, sides = (2 * p, 1) if varying else (p, 2)
        self._unknowns = m
        self._factor = np.zeros((m, m + sides, obstacles))  # [R d]
        self._scatter = np.zeros((sides, sides, obstacles))  # of the residuals
        self._noise_sum = np.zeros((obstacles, 2, 2))
        self._center, self._origin = np.zeros(obstacles), np.zeros((obstacles, 2))
        self._first, self._last = np.full(obstacles, math.inf), np.full(obstacles, -math.inf)
        self._left, self._shrunk = np.zeros((sides, obstacles)), np.ones(obstacles)
        self._newest = np.full((obstacles, 2), math.nan)  # position of what came last in time
        self._count = np.zeros(obstacles, dtype=np.intp)

    @property
    def observations(self) -> Index:
        return self._count.copy()

    @property
    def roots(self) -> SquareRoots:
        """Square roots from which many estimates are made at once."""
        factor, m = self._factor.transpose(2, 0, 1), self._unknowns
        return SquareRoots(factor[..., :m], factor[..., m:], self._center, self._origin, self._first, self._last)

    @property
    def innovations(self) -> tuple[Array, Array]:
        """Innovations (2, K) of the last update, shrunk to the noise of an observation, and by which factors, (K,)."""
        return self._left, self._shrunk

    def grow(self, obstacles: int) -> None:
        """Make room for more obstacles, so many in all, of which nothing has been seen."""
        old = len(self._count)
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                axis = -1 if name in ("_factor", "_scatter", "_left", "_shrunk") else 0
                setattr(self, name, grown(value, obstacles, axis))
        self.reset(slice(old, None))

    def set_covariance(self, obstacle: int, covariance: Array) -> None:
        """Change the known covariance (2, 2), m^2, of the observations of an obstacle."""
        if self._sigma is None:
            raise EstimationError("covariance: it is not known here")
        self._sigma[obstacle] = covariance

    def reset(self, obstacle: int | slice = 0) -> None:
        self._factor[..., obstacle] = self._scatter[..., obstacle] = 0.0
        self._count[obstacle] = 0
        self._noise_sum[obstacle] = 0.0
        self._first[obstacle], self._last[obstacle] = math.inf, -math.inf
        self._newest[obstacle] = math.nan

    def update(
        self, times: ArrayLike, positions: ArrayLike, covariance: ArrayLike | None = None, seen: ArrayLike | None = None
    ) -> None:
        """Take in at most one observation of each obstacle."""
        count = len(self._count)
        t = np.broadcast_to(np.asarray(times, dtype=float), (count,))
        z = np.asarray(positions, dtype=float)
        if z.shape != (count, 2):
            raise EstimationError(f"positions: their shape is {z.shape}; must be ({count}, 2)")
        used = np.ones(count, dtype=bool) if seen is None else np.asarray(seen, dtype=bool)
        self._refuse_odd(t, z, used)
        if self._varying is (covariance is None):
            raise EstimationError(f"covariance: it {'must' if self._varying else 'must not'} come with an observation")
        sigma = None if covariance is None else np.broadcast_to(check_covariance(covariance, count), (count, 2, 2))
        some = np.flatnonzero(used)
        self.take_in(some, t[some], z[some], None if sigma is None else sigma[some])

    def _refuse_odd(self, times: Array, positions: Array, wanted: Mask) -> None:
        """Refuse wanted observations that are not finite or came before."""
        odd = wanted & ~(np.isfinite(times) & np.isfinite(positions).all(axis=1))
        if odd.any():
            k = int(np.argmax(odd))
            where = f"time {float(times[k])!r} or position {positions[k].tolist()}"
            raise EstimationError(f"obstacle {k}: {where} is not finite")
        again = wanted & (times == self._last) & (positions == self._newest).all(axis=1)
        if again.any():
            k = int(np.argmax(again))
            raise EstimationError(f"obstacle {k}: the observation at time {float(times[k])!r} comes twice")

    def take_in(self, some: Index, times: Array, positions: Array, sigma: Array | None = None) -> None:
        """Take in one observation each of some obstacles, which nothing is wrong with."""
        new = self._count[some] == 0
        self._center[some[new]], self._origin[some[new]] = times[new], positions[new]
        self._absorb(self._rows(times, positions, sigma, some), some)
        self._count[some] += 1
        if sigma is not None:
            self._noise_sum[some] += sigma
        newest = times >= self._last[some]
        self._newest[some[newest]] = positions[newest]
        self._first[some] = np.minimum(self._first[some], times)
        self._last[some] = np.maximum(self._last[some], times)

    def estimate(self, obstacle: int = 0, prior: MotionPrior | None = None) -> PolynomialEstimate:
        """Give the estimate of one obstacle, the same as `estimate_motion` makes of its observations."""
        n, p, k = int(self._count[obstacle]), self.order + 1, obstacle
        known = self._varying or self._sigma is not None
        if prior_rows(prior, 0.0, 1.0, p) is None:
            prior = None  # it says nothing about a motion of this order
        distinct = p if prior is None else 0
        least = p + 2 if not known else max(distinct, 1)
        if n < least:
            raise EstimationError(f"obstacle {k}: {n} observations are too few for order {self.order}; need {least}")
        m = self._unknowns
        r, d = self._factor[:, :m, k], self._factor[:, m:, k]
        if distinct and not np.all(np.abs(np.diag(r)) > 0.0):
            raise EstimationError(f"obstacle {k}: its observations are at too few times for order {self.order}")
        (sigma, errors), regressors = self._noise(k), None if self._varying or prior is not None else p
        if regressors is None:
            coefficients, covariance = self._general(k, None if self._varying else sigma, prior)
        else:
            inverse = np.asarray(np.linalg.inv(r), dtype=float)
            coefficients = inverse @ d
            covariance = np.einsum("jk,ab->jakb", inverse @ inverse.T, sigma)
        last = float(self._last[k])
        middle, scale = self._where_the_weight_is(k)
        # s = (t - middle) / scale in place of u = t - center
        shift = shift_powers(p, middle - self._center[k], 1.0 / scale)
        coefficients = shift @ coefficients
        coefficients[0] += self._origin[k]
        covariance = np.einsum("ij,jakb,lk->ialb", shift, covariance, shift)
        return PolynomialEstimate(
            last, self.order, n, sigma, errors, regressors, middle, scale, coefficients, covariance
        )

    def _where_the_weight_is(self, k: int) -> tuple[float, float]:
        """Give the weighted mean and deviation of the times seen, s, from X'WX = R'R."""
        center, step = float(self._center[k]), self._unknowns // (self.order + 1)
        if self.order == 0:
            return center, 1.0
        r = self._factor[:, : self._unknowns : step, k]
        weight, first, second = (float(r[:, 0] @ r[:, 0]), float(r[:, 0] @ r[:, 1]), float(r[:, 1] @ r[:, 1]))
        variance = second / weight - (first / weight) ** 2
        return center + first / weight, math.sqrt(max(variance, 0.0)) or 1.0

    def _rows(self, t: Array, z: Array, sigma: Array | None, some: Index) -> Array:
        """Give the new rows [x' z'] of [X Z]: (rows, m + sides, K)."""
        u, offset = t - self._center[some], (z - self._origin[some]).T
        powers = np.ones((self.order + 1, len(u)))
        for j in range(1, self.order + 1):
            np.multiply(powers[j - 1], u, out=powers[j])
        if sigma is None:
            return np.concatenate([powers, offset])[None]
        whiten = np.linalg.inv(np.linalg.cholesky(sigma))
        design = np.einsum("jk,kab->ajbk", powers, whiten).reshape(2, self._unknowns, len(t))
        return np.concatenate([design, np.einsum("kab,bk->ak", whiten, offset)[:, None]], axis=1)

    def _absorb(self, rows: Array, some: Index) -> None:
        """Rotate new rows into the factor; what is left of them is a residual."""
        m, run = self._unknowns, run_of(some)
        factor, shrunk = self._factor[..., run], self._shrunk[run]
        for row in rows:
            shrunk.fill(1.0)
            for j in range(m):
                pivot, entry = factor[j, j], row[j]
                length = np.hypot(pivot, entry)
                if not length.all():
                    pivot = np.where(length == 0.0, 1.0, pivot)
                    length = np.where(length == 0.0, 1.0, length)
                cosine, sine = pivot / length, entry / length
                upper, lower = factor[j, j:], row[j:]
                rotated = cosine * upper + sine * lower
                lower *= cosine
                lower -= sine * upper
                factor[j, j:] = rotated
                shrunk *= cosine
            rest = row[m:]
            self._left[:, run] = rest
            self._scatter[..., run] += rest[:, None] * rest[None]
        self._factor[..., run], self._shrunk[run] = factor, shrunk

    def _noise(self, k: int) -> tuple[Array, ErrorLaw]:
        if self._varying:
            return self._noise_sum[k] / self._count[k], NormalErrors()
        if self._sigma is not None:
            return self._sigma[k], NormalErrors()
        degrees = float(self._count[k]) - self._unknowns
        told = self._factor[:, self._unknowns :, k]
        square = float(np.sum(told * told) + np.trace(self._scatter[..., k]))
        extent = Extent(square, self._origin[k], self.least_deviation)
        return estimated_noise(self._scatter[..., k], degrees, Noise.GENERAL, extent)

    def _general(self, k: int, sigma: Array | None, prior: MotionPrior | None) -> tuple[Array, Array]:
        """Solve for all 2 p coefficients together: with varying covariances, with a prior, or both."""
        m, p = self._unknowns, self.order + 1
        design, target = self._factor[:, :m, k], self._factor[:, m:, k]
        middle = design.T @ design
        if sigma is not None:
            whiten = np.linalg.inv(np.linalg.cholesky(sigma))
            target = (target @ whiten.T).reshape(2 * p)
            design = kronecker(design, whiten)
            middle = kronecker(middle, whiten.T @ whiten)
        target = target.reshape(2 * p)
        rows = prior_rows(prior, float(self._last[k] - self._center[k]), 1.0, p)
        if rows is not None:
            design, target = np.vstack([design, rows[0]]), np.concatenate([target, rows[1]])
            middle = middle + rows[0].T @ rows[0]
        if np.linalg.matrix_rank(design / np.maximum(np.linalg.norm(design, axis=0), np.finfo(float).tiny)) < 2 * p:
            raise EstimationError(f"obstacle {k}: what was seen does not determine a motion of order {self.order}")
        q, r = np.linalg.qr(design)
        inverse = np.linalg.inv(r)
        covariance = inverse @ (inverse.T @ middle @ inverse) @ inverse.T
        return (inverse @ (q.T @ target)).reshape(p, 2), covariance.reshape(p, 2, p, 2)


@dataclass(frozen=True)
class Primed:
    """K motions, estimated from observations and a prior, in powers of the time since their centres."""

    some: Index  # (K,)
    coefficients: Array  # (K, p, 2) Relative to their origins, m/s^k
    covariance: Array  # (K, p, 2, p, 2)

    @classmethod
    def of(cls, roots: SquareRoots, noise: Array, prior: MotionPrior) -> Primed:
        count, p = roots.factor.shape[:2]
        whiten = np.linalg.inv(np.linalg.cholesky(noise))
        seen = kronecker(roots.factor, whiten)
        target = (roots.right @ whiten.transpose(0, 2, 1)).reshape(count, 2 * p)
        at_center, after = prior_rows(prior, 0.0, 1.0, p), prior_rows(prior, 1.0, 1.0, p)
        assert at_center is not None and after is not None, "it tells something"
        # as observations when each was seen last: rows are linear in that time
        added = at_center[0] + (roots.last - roots.center)[:, None, None] * (after[0] - at_center[0])
        means = at_center[1]
        design = np.concatenate([seen, added], axis=1)
        q, r = np.linalg.qr(design)
        sizes = np.linalg.norm(design, axis=1)
        some = np.flatnonzero(_determined(r, sizes, design.shape[1]))
        inverse = np.linalg.inv(r[some])
        sides = np.concatenate([target, np.broadcast_to(means, (count, len(means)))], axis=1)[some, :, None]
        coefficients = inverse @ (q[some].transpose(0, 2, 1) @ sides)
        covariance = inverse @ inverse.transpose(0, 2, 1)
        return cls(some, coefficients.reshape(-1, p, 2), covariance.reshape(-1, p, 2, p, 2))


def _determined(r: Array, sizes: Array, rows: int) -> Array:
    """True if designs of so many rows have full rank beyond doubt, as `numpy.linalg.matrix_rank` means it."""
    scaled = np.abs(np.diagonal(r, axis1=1, axis2=2)) / np.maximum(sizes, np.finfo(float).tiny)
    least = scaled.prod(axis=1) / math.sqrt(math.e)
    return np.asarray(least > np.sqrt(r.shape[-1]) * max(rows, r.shape[-1]) * np.finfo(float).eps)
