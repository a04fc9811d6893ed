"""Estimates that are updated with each observation, in time that does not grow with their number."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index, Mask
from scp_planner.errors import EstimationError
from scp_planner.estimation.error_laws import ErrorLaw, NormalErrors
from scp_planner.estimation.estimate import HIGHEST_ORDER
from scp_planner.estimation.least_squares import Extent, Moments, MotionPrior, Noise, estimated_noise, prior_rows
from scp_planner.estimation.motion_estimate import PolynomialEstimate, shift_powers
from scp_planner.estimation.observations import Faulty, check_covariance, usable
from scp_planner.settings.knobs import word_of

_MEMORIES = 2.0
"""Times are counted from a new origin after this many memories, each of 1 / (1 - forgetting) observations."""


@dataclass(frozen=True)
class SquareRoots:
    """Square roots of the information about K motions: R c = d for the coefficients c of powers of t - center."""

    factor: Array  # R, triangular
    right: Array  # d, m; relative to the origins
    center: Array
    origin: Array
    first: Array  # Times of the first and the last observation
    last: Array  # Times of the first and the last observation

    def of(self, some: Index) -> SquareRoots:
        """Select some of the motions."""
        # Contiguous: so an estimate has the same bits beside others as alone.
        return SquareRoots(**{name: np.ascontiguousarray(value[some]) for name, value in vars(self).items()})

    @classmethod
    def together(cls, parts: Sequence[SquareRoots]) -> SquareRoots:
        """Concatenate."""
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


@dataclass(frozen=True)
class Innovations:
    """Differences of new observations of K obstacles from their predictions."""

    scaled: Array  # The difference times ``share``; with the covariance of an observation
    share: Array  # Deviation of an observation over that of the difference, which the estimate adds to


class RecursiveEstimator:
    """Polynomial motions of K obstacles, each updated in O(1) by each of its observations."""

    least_deviation: float = 0.0  # Of a noise that is estimated, besides those of `estimated_noise`, m

    def __init__(
        self,
        obstacles: int = 1,
        order: int = 2,
        covariance: ArrayLike | None = None,
        *,
        varying: bool = False,
        forgetting: float = 1.0,
        gate_probability: float | None = None,
        missing: Faulty | str = Faulty.REFUSE,
    ) -> None:
        if order not in range(HIGHEST_ORDER + 1):
            raise EstimationError(f"order: {order!r} is not 0, 1 or 2")
        if not 0.0 < forgetting <= 1.0:
            raise EstimationError(f"forgetting: {forgetting!r} is not in (0, 1]")
        if gate_probability is not None and not 0.0 < gate_probability < 1.0:
            raise EstimationError(f"gate_probability: {gate_probability!r} is not between 0 and 1")
        if varying and covariance is not None:
            raise EstimationError("covariance: one that varies comes with each observation, not before")
        self.order = order
        self.forgetting = forgetting
        self.gate_probability = gate_probability
        self.missing = word_of(Faulty, missing, "missing")
        self._varying = varying
        sigma = None if covariance is None else check_covariance(covariance, obstacles)
        self._sigma = None if sigma is None else np.broadcast_to(sigma, (obstacles, 2, 2))
        p = order + 1
        # p unknowns with two right-hand sides, x and y; or 2 p unknowns that varying covariances tie together
        m, sides = (2 * p, 1) if varying else (p, 2)
        self._unknowns = m
        self._factor = np.zeros((m, m + sides, obstacles))  # [R d]
        self._scatter = np.zeros((sides, sides, obstacles))  # of the residuals
        self._moments = np.zeros((2, m, m, obstacles))  # X' W^2 X and X' W^3 X, if anything is forgotten
        self._weights = np.zeros((2, obstacles))  # sums of w and of w^2
        self._noise_sum = np.zeros((obstacles, 2, 2))
        self._center, self._origin = np.zeros(obstacles), np.zeros((obstacles, 2))
        self._first, self._last = np.full(obstacles, math.inf), np.full(obstacles, -math.inf)
        self._left, self._shrunk = np.zeros((sides, obstacles)), np.ones(obstacles)
        self._newest = np.full((obstacles, 2), math.nan)  # position of what came last in time
        self._count = np.zeros(obstacles, dtype=np.intp)
        self._since_centred = np.zeros(obstacles, dtype=np.intp)
        self._rejected = np.zeros(obstacles, dtype=np.intp)

    @property
    def observations(self) -> Index:
        """Number of observations of each estimate, (K,)."""
        return self._count.copy()

    @property
    def rejected_in_a_row(self) -> Index:
        """Number of the newest observations of each obstacle that the gate left out, (K,)."""
        return self._rejected.copy()

    @property
    def roots(self) -> SquareRoots:
        """Square roots from which many estimates are made at once."""
        m = self._unknowns
        return SquareRoots(
            self._factor[:, :m].transpose(2, 0, 1),
            self._factor[:, m:].transpose(2, 0, 1),
            self._center,
            self._origin,
            self._first,
            self._last,
        )

    @property
    def innovations(self) -> Innovations:
        """Innovations of the last update; none for covariances that vary."""
        return Innovations(self._left, self._shrunk)

    def grow(self, obstacles: int) -> None:
        """Make room for more obstacles, so many in all, of which nothing has been seen."""
        given = None if self._sigma is None else np.eye(2)
        fresh = RecursiveEstimator(obstacles, self.order, given, varying=self._varying, forgetting=self.forgetting)
        old = len(self._count)
        for name, value in vars(fresh).items():
            if isinstance(value, np.ndarray):
                value = value.copy() if name == "_sigma" else value  # it is one for all
                last = name in ("_factor", "_scatter", "_moments", "_weights", "_left", "_shrunk")
                (value[..., :old] if last else value[:old])[...] = getattr(self, name)
                setattr(self, name, value)

    def set_covariance(self, obstacle: int, covariance: Array) -> None:
        """Change the known covariance (2, 2), m^2, of the observations of an obstacle."""
        if self._sigma is None:
            raise EstimationError("covariance: it is not known here")
        if not self._sigma.flags.writeable:
            self._sigma = self._sigma.copy()
        self._sigma[obstacle] = covariance

    def reset(self, obstacle: int = 0) -> None:
        """Forget all that was seen of an obstacle."""
        for array in (self._factor, self._scatter, self._moments, self._weights):
            array[..., obstacle] = 0.0
        for counter in (self._count, self._since_centred, self._rejected):
            counter[obstacle] = 0
        self._noise_sum[obstacle] = 0.0
        self._first[obstacle], self._last[obstacle] = math.inf, -math.inf
        self._newest[obstacle] = math.nan

    def update(
        self,
        times: ArrayLike,
        positions: ArrayLike,
        covariance: ArrayLike | None = None,
        seen: ArrayLike | None = None,
    ) -> Mask:
        """Take in at most one observation of each obstacle."""
        count = len(self._count)
        t = np.broadcast_to(np.asarray(times, dtype=float), (count,))
        z = np.asarray(positions, dtype=float)
        if z.shape != (count, 2):
            raise EstimationError(f"positions: their shape is {z.shape}; must be ({count}, 2)")
        in_order = self.forgetting < 1.0
        used = usable(t, z, seen, self.missing, self._last, self._newest, in_order=in_order)
        if self._varying is (covariance is None):
            raise EstimationError(f"covariance: it {'must' if self._varying else 'must not'} come with an observation")
        sigma = None if covariance is None else np.broadcast_to(check_covariance(covariance, count), (count, 2, 2))
        if self.gate_probability is not None:
            inside = self._gate(t, z, sigma, used)
            self._rejected += used & ~inside
            used = inside
            self._rejected[used] = 0
        everything = bool(used.all())
        if not everything:
            t, z = np.where(used, t, self._center), np.where(used[:, None], z, self._origin)
        new = used & (self._count == 0)
        if new.any():
            self._center[new], self._origin[new] = t[new], z[new]
        rows = self._rows(t, z, sigma)
        if not everything:
            rows *= used
        if self.forgetting < 1.0:
            self._forget(rows, used)
        self._absorb(rows)
        self._weights += used
        self._count += used
        if sigma is not None:
            self._noise_sum[used] += sigma[used]
        np.copyto(self._newest, z, where=(used & (t >= self._last))[:, None])
        np.minimum(self._first, t, out=self._first, where=used)
        np.maximum(self._last, t, out=self._last, where=used)
        if self.forgetting < 1.0:
            self._since_centred += used
            self._recentre()
        return used

    def update_row(self, some: slice, times: Array, positions: Array) -> None:
        """Take in the newest observation each of obstacles in a row, which nothing is wrong with."""
        new = self._count[some] == 0
        if new.any():
            np.copyto(self._center[some], times, where=new)
            np.copyto(self._first[some], times, where=new)
            np.copyto(self._origin[some], positions, where=new[:, None])
        self._absorb(self._rows(times, positions, None, some), some)
        self._weights[:, some] += 1.0
        self._count[some] += 1
        self._newest[some], self._last[some] = positions, times

    def positions(self, times: ArrayLike) -> Array:
        """Estimate the centres of all obstacles, each at its time: float or (K,) s to (K, 2) m."""
        powers = self._powers(np.broadcast_to(np.asarray(times, dtype=float), self._count.shape))
        return np.einsum("jk,kjb->kb", powers, self._coefficients()) + self._origin

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
        errors: ErrorLaw = NormalErrors()
        regressors: int | None = p
        if self._varying or prior is not None:
            sigma = self._noise_sum[k] / n if self._varying else self._noise(k)[0]
            errors = NormalErrors() if known else self._noise(k)[1]
            coefficients, covariance = self._general(k, None if self._varying else sigma, prior)
            regressors = None
        else:
            sigma, errors = self._noise(k)
            inverse = np.asarray(np.linalg.inv(r), dtype=float)
            coefficients = inverse @ d
            covariance = np.einsum("jk,ab->jakb", self._spread(k, inverse), sigma)
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

    def _powers(self, t: Array, some: slice = slice(None)) -> Array:
        u = t - self._center[some]
        rows = np.empty((self.order + 1, len(u)))
        rows[0] = 1.0
        for j in range(1, self.order + 1):
            np.multiply(rows[j - 1], u, out=rows[j])
        return rows

    def _rows(self, t: Array, z: Array, sigma: Array | None, some: slice = slice(None)) -> Array:
        """Give the new rows [x' z'] of [X Z]: (rows, m + sides, K)."""
        powers, offset = self._powers(t, some), (z - self._origin[some]).T
        if sigma is None:
            return np.concatenate([powers, offset])[None]
        whiten = np.linalg.inv(np.linalg.cholesky(sigma))
        design = np.einsum("jk,kab->ajbk", powers, whiten).reshape(2, self._unknowns, len(t))
        return np.concatenate([design, np.einsum("kab,bk->ak", whiten, offset)[:, None]], axis=1)

    def _absorb(self, rows: Array, some: slice = slice(None)) -> None:
        """Rotate new rows into the factor; what is left of them is a residual."""
        m, factor, shrunk = self._unknowns, self._factor[..., some], self._shrunk[some]
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
            self._left[:, some] = rest
            self._scatter[..., some] += rest[:, None] * rest[None]

    def _forget(self, rows: Array, used: Mask) -> None:
        rate = np.where(used, self.forgetting, 1.0)
        self._factor *= np.sqrt(rate)
        self._scatter *= rate
        design = rows[:, : self._unknowns]
        outer = (design[:, :, None] * design[:, None]).sum(axis=0)
        for i, power in enumerate((2, 3)):
            self._moments[i] *= rate**power
            self._moments[i] += outer
        self._weights *= np.stack([rate, rate**2])

    def _recentre(self) -> None:
        """Count time from the last observation where all that is remembered is long after the old origin."""
        due = np.flatnonzero(self._since_centred * (1.0 - self.forgetting) >= _MEMORIES)
        for k in due:
            back = shift_powers(self.order + 1, self._center[k] - self._last[k], 1.0)
            if self._varying:
                back = _each_with_all(back, np.eye(2))
            m = self._unknowns
            self._factor[:, :m, k] = self._factor[:, :m, k] @ back  # triangular again
            self._moments[..., k] = back.T @ self._moments[..., k] @ back
            self._center[k] = self._last[k]
        self._since_centred[due] = 0

    def _noise(self, k: int) -> tuple[Array, ErrorLaw]:
        if self._sigma is not None:
            return self._sigma[k], NormalErrors()
        inverse = np.asarray(np.linalg.inv(self._factor[:, : self._unknowns, k]), dtype=float)
        n = float(self._count[k])
        degrees = n - self._unknowns
        moments = Moments(degrees, degrees)
        if self.forgetting < 1.0:
            second, third = (inverse.T @ moment @ inverse for moment in self._moments[..., k])
            expected = float(self._weights[0, k] - np.trace(second))
            square = float(self._weights[1, k] - 2.0 * np.trace(third) + np.sum(second * second))
            moments = Moments(expected, expected**2 / square)
        told = self._factor[:, self._unknowns :, k]
        square = float(np.sum(told * told) + np.trace(self._scatter[..., k]))
        extent = Extent(square, self._origin[k], self.least_deviation)
        return estimated_noise(self._scatter[..., k], moments, Noise.GENERAL, extent)

    def _spread(self, k: int, inverse: Array) -> Array:
        if self.forgetting == 1.0:
            return inverse @ inverse.T
        return inverse @ (inverse.T @ self._moments[0, ..., k] @ inverse) @ inverse.T

    def _general(self, k: int, sigma: Array | None, prior: MotionPrior | None) -> tuple[Array, Array]:
        """Solve for all 2 p coefficients together: with varying covariances, with a prior, or both."""
        m, p = self._unknowns, self.order + 1
        design, target = self._factor[:, :m, k], self._factor[:, m:, k]
        middle = self._moments[0, ..., k] if self.forgetting < 1.0 else design.T @ design
        if sigma is not None:
            whiten = np.linalg.inv(np.linalg.cholesky(sigma))
            target = (target @ whiten.T).reshape(2 * p)
            design = _each_with_all(design, whiten)
            middle = _each_with_all(middle, whiten.T @ whiten)
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

    def _coefficients(self) -> Array:
        """Solve R c = d for all obstacles: (K, p, 2) m, of powers of t - center, relative to the origins."""
        m = self._unknowns
        factor = np.moveaxis(self._factor, -1, 0)
        solved = np.linalg.solve(factor[..., :m], factor[..., m:])
        return np.asarray(solved.reshape(len(factor), self.order + 1, 2), dtype=float)

    def _gate(self, t: Array, z: Array, sigma: Array | None, used: Mask) -> Mask:
        """Tell which observations the estimates so far do not call improbable."""
        inside = used.copy()
        least = self.order + 1 + (0 if self._varying or self._sigma is not None else 2)
        for k in np.flatnonzero(used & (self._count >= least)):
            estimate = self.estimate(int(k))
            noise = estimate.noise_covariance if sigma is None else sigma[k]
            offset = z[k] - estimate.position(t[k])
            distance = float(offset @ np.linalg.solve(estimate.covariance(t[k]) + noise, offset))
            inside[k] = estimate.errors.exceedance(distance) >= (self.gate_probability or 0.0)
        return inside


def _each_with_all(first: Array, second: Array) -> Array:
    """Kronecker product of two matrices; `numpy.kron` takes ten times as long."""
    product: Array = first[:, None, :, None] * second[:, None, :]
    return product.reshape(len(first) * len(second), -1)
