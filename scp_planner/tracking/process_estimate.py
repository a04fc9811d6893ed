"""Predicted motions with process noise, of one obstacle or of many that follow one model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index, Mask
from scp_planner.errors import EstimationError
from scp_planner.scenario.process_model import Tails
from scp_planner.tracking.confidence import ErrorLaw, NormalErrors, StudentErrors
from scp_planner.tracking.dynamics import Dynamics, Integrator
from scp_planner.tracking.motion_estimate import (
    POLYNOMIAL_TERMS,
    MotionEstimate,
    MotionPolynomials,
    check_span,
    error_blocks,
    errors_of,
    integrate,
    row_products,
    standardised_speed,
)
from scp_planner.tracking.tolerances import TIME_TOLERANCE


@dataclass(frozen=True)
class PieceSettings:
    """Precision of piecewise polynomials of a prediction that is none."""

    center_tolerance: float = 1e-3  # m, of the predicted centre
    covariance_tolerance: float = 1e-3  # relative, by which a covariance may be exceeded
    most_halvings: int = 12
    halved: int = 7  # pieces that are tried first, each twice as long as the one before
    checks: int = 21  # points of a piece at which its error is measured


PIECES = PieceSettings()
_EXPONENTS = np.arange(POLYNOMIAL_TERMS)
_NODES = 0.5 - 0.5 * np.cos(np.pi * _EXPONENTS / (POLYNOMIAL_TERMS - 1))  # Chebyshev-Lobatto: neighbours meet
_BETWEEN = np.linspace(0.0, 1.0, PIECES.checks)
_POWERS = _BETWEEN[:, None] ** _EXPONENTS
_SOLVE = np.linalg.inv(_NODES[:, None] ** _EXPONENTS)


@dataclass(frozen=True, eq=False)
class Predictions:
    """Motions of n obstacles that follow one model, after lead times since their last observations."""

    dynamics: Dynamics
    tails: Tails | None
    mean: Array  # (n, d, 2) expected states at lead time 0
    covariance: Array  # (n, 2 d, 2 d)
    _kept: dict[tuple[float, float], list[MotionPolynomials]] = field(default_factory=dict, init=False)
    _lengths: dict[tuple[float, float], Array] = field(default_factory=dict, init=False)

    def _of(self, some: Index) -> Predictions:
        return Predictions(self.dynamics, self.tails, self.mean[some], self.covariance[some])

    def centers(self, lead: Array) -> Array:
        """Predicted centres after lead times (...), s: (n, ..., 2) m."""
        rows = self.dynamics.transition(lead.ravel())[:, 0]
        return (rows @ self.mean).reshape(-1, *lead.shape, 2)

    def covariances(self, lead: Array) -> Array:
        """Covariances of their errors after lead times (...), s: (n, ..., 2, 2) m^2."""
        flat, d = lead.ravel(), self.dynamics.states
        rows = self.dynamics.transition(flat)[:, 0]
        products = (rows[:, :, None] * rows[:, None]).reshape(len(flat), -1)
        errors = errors_of(products, self.covariance.reshape(-1, d, 2, d, 2))
        errors[..., [0, 1], [0, 1]] += self.dynamics.noise(flat)[:, 0, 0, None]
        return self._inflation(lead)[..., None, None] * errors.reshape(-1, *lead.shape, 2, 2)

    def lengths(self, first: float, last: float) -> Array:
        """Path length of each standardised error between two lead times, s: (n,)."""
        if (first, last) not in self._lengths:
            # errors turn on the scale of the time that the velocity needs to blur the position; then ever more slowly
            found, p = np.zeros(len(self.mean)), self.covariance
            scales = np.sqrt((p[:, 0, 0] + p[:, 1, 1]) / (p[:, 2, 2] + p[:, 3, 3]))
            scales = np.exp2(np.round(np.log2(scales)))  # so that many share one
            for scale in np.unique(scales).tolist() if first < last else ():
                alike = np.flatnonzero(scales == scale)
                found[alike] = self._of(alike).integrals(first, last, scale)
            self._lengths[first, last] = found
        return self._lengths[first, last]

    def pieces(self, first: float, last: float) -> list[MotionPolynomials]:
        """Centres and covariances over lead times, s: exact for integrated noise, else within tolerances."""
        if (first, last) not in self._kept:
            bends = () if self.tails is None else self.tails.lead_time
            leads = np.array([first, *(lead for lead in bends if first < lead < last), last])
            if isinstance(self.dynamics, Integrator):
                self._kept[first, last] = self._expanded(leads, self.dynamics)
            else:  # hard to follow at first, easy later
                halved = first + (last - first) * 0.5 ** np.arange(PIECES.halved, 0, -1)
                self._kept[first, last] = self._refined(np.unique(np.concatenate([leads, halved])))
        return self._kept[first, last]

    def _inflation(self, lead: Array) -> Array:
        if self.tails is None:
            return np.ones_like(lead)
        return np.asarray(np.interp(lead, self.tails.lead_time, self.tails.inflation))

    def rates(self, lead: Array) -> tuple[Array, Array, Array]:
        """Covariances of the errors, of them with their rates, and of these, all before inflation."""
        d, f, q = self.dynamics.states, self.dynamics.transition(lead), self.dynamics.noise(lead)
        blocks = error_blocks(row_products(f[:, 0], f[:, 1]), self.covariance.reshape(-1, d, 2, d, 2))
        for block, more in zip(blocks, (q[:, 0, 0], q[:, 0, 1], q[:, 1, 1]), strict=True):
            block[..., [0, 1], [0, 1]] += more[:, None]
        return blocks

    def integrals(self, first: float, last: float, scale: float) -> Array:
        """Lengths by an integral over the logarithm of the time in units of a scale, s."""

        def speeds(u: Array) -> Array:
            return scale * np.exp(u) * standardised_speed(*self.rates(scale * np.expm1(u)))

        return integrate(speeds, math.log1p(first / scale), math.log1p(last / scale))

    def _expanded(self, leads: Array, dynamics: Integrator) -> list[MotionPolynomials]:
        """Taylor's expansion between leads (S + 1,), s."""
        d, n, begins = dynamics.states, len(self.mean), leads[:-1]
        f, factorials = dynamics.transition(begins), np.array([math.factorial(k) for k in range(d)])
        center = (f @ self.mean[:, None]) / factorials[:, None]
        states = self.covariance.reshape(n, d, 2, d, 2)
        grown = np.einsum("sij,njakb,slk->nsilab", f, states, f, optimize=True)
        grown += dynamics.noise(begins)[..., None, None] * np.eye(2)
        grown /= np.outer(factorials, factorials)[..., None, None]
        covariance = np.zeros((n, len(begins), 2 * d + 1, 3))
        for i in range(d):
            for j in range(d):
                block = grown[:, :, i, j]
                covariance[:, :, i + j] += 0.5 * (block + np.swapaxes(block, 2, 3))[..., [0, 0, 1], [0, 1, 1]]
        covariance[:, :, 2 * d - 1, [0, 2]] += dynamics.noise(np.array(1.0))[0, 0]
        inflation = self._inflation(leads)
        product = inflation[:-1, None, None] * covariance
        product[:, :, 1:] += (np.diff(inflation) / np.diff(leads))[:, None, None] * covariance[:, :, :-1]
        product = product[:, :, : 2 * d if self.tails is None else None]
        return [MotionPolynomials(leads, *each) for each in zip(center, product, strict=True)]

    def _refined(self, leads: Array) -> list[MotionPolynomials]:
        """Interpolate between leads (S + 1,), s; halve pieces that are off by too much, each motion by itself."""
        fitted, missed = self.interpolated(leads)
        for number in np.flatnonzero(missed.any(axis=1)):
            single, own, off = self._of(np.array([number])), leads, missed[number]
            for _ in range(PIECES.most_halvings):
                own = np.sort(np.concatenate([own, 0.5 * (own[1:] + own[:-1])[off]]))
                (fitted[number],), still = single.interpolated(own)
                off = still[0]
                if not off.any():
                    break
        return fitted

    def interpolated(self, leads: Array) -> tuple[list[MotionPolynomials], Mask]:
        """Interpolate between leads (S + 1,), s, and tell which pieces (n, S) are off by more than the tolerances."""
        widths, k = np.diff(leads), len(_NODES)
        lead = leads[:-1, None] + widths[:, None] * np.concatenate([_NODES, _BETWEEN])
        centers, covariances = self.centers(lead), self.covariances(lead)[..., [0, 0, 1], [0, 1, 1]]
        center, covariance = _SOLVE @ centers[:, :, :k], _SOLVE @ covariances[:, :, :k]
        off = _POWERS @ center - centers[:, :, k:]
        center_error = np.hypot(off[..., 0], off[..., 1]).max(axis=2)
        xx, xy, yy = np.moveaxis(covariances[:, :, k:], -1, 0)
        missed = np.abs(_POWERS @ covariance - covariances[:, :, k:])
        # no direction's variance is off by more than the sum of what the entries are off by
        missing = np.maximum(missed[..., 0], missed[..., 2]) + missed[..., 1]
        covariance_error = (missing / (0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy))).max(axis=2)
        covariance = covariance * (1.0 + covariance_error.max(axis=1))[:, None, None, None]
        scales = widths[:, None, None] ** _EXPONENTS[:, None]
        each = zip(center / scales, covariance / scales, center_error.max(axis=1).tolist(), strict=True)
        too_far = (center_error > PIECES.center_tolerance) | (covariance_error > PIECES.covariance_tolerance)
        return [MotionPolynomials(leads, *one) for one in each], too_far


@dataclass(frozen=True)
class ProcessEstimate(MotionEstimate):
    """A motion with process noise, predicted from the last observation on."""

    reference_time: float
    observations: int
    noise_covariance: Array
    dynamics: Dynamics
    mean: Array  # (d, 2) Expected state at the reference time
    state_covariance: Array  # (2 d, 2 d)
    tails: Tails | None = None
    shared: Predictions | None = field(default=None, repr=False, compare=False)  # with others
    place: int = field(default=0, repr=False, compare=False)  # among those

    regressors = None

    @property
    def order(self) -> int:  # type: ignore[override]
        return self.dynamics.order

    @property
    def errors(self) -> ErrorLaw:  # type: ignore[override]
        return NormalErrors() if self.tails is None else StudentErrors(self.tails.degrees_of_freedom)

    @property
    def earliest(self) -> float:
        return self.reference_time

    @property
    def velocity(self) -> Array:
        return self.mean[1]

    @property
    def acceleration(self) -> Array:
        return self.dynamics.acceleration(self.mean)

    @cached_property
    def _own(self) -> Predictions:
        return Predictions(self.dynamics, self.tails, self.mean[None], self.state_covariance[None])

    def position(self, t: ArrayLike) -> Array:
        return self._own.centers(self._lead(t))[0]

    def covariance(self, t: ArrayLike) -> Array:
        return self._own.covariances(self._lead(t))[0]

    def rate(self, t: float) -> tuple[Array, Array]:
        found, lead = self._own, self._lead(np.array([t]))
        velocity = (self.dynamics.transition(lead)[0] @ self.mean)[1]
        inflation = 1.0 if self.tails is None else max(self.tails.inflation)
        return velocity, inflation * found.rates(lead)[2][0, 0]

    def polynomials(self, start: float, stop: float) -> MotionPolynomials:
        check_span(start, stop)
        several, span = self.shared or self._own, (float(self._lead(start)), float(self._lead(stop)))
        found = several.pieces(*span)[self.place]
        breakpoints = self.reference_time + found.breakpoints
        return MotionPolynomials(breakpoints, found.center, found.covariance, found.center_error)

    def standardised_length(self, start: float, stop: float) -> float:
        if not start <= stop:
            raise EstimationError(f"span of time: its start {start!r} is after its stop {stop!r}")
        if not math.isfinite(stop):
            raise EstimationError(f"span of time: its stop {stop!r} must be finite for a motion with process noise")
        several = self.shared or self._own
        return float(several.lengths(float(self._lead(start)), float(self._lead(stop)))[self.place])

    def _lead(self, t: ArrayLike) -> Array:
        """Times since the reference time, s."""
        lead = np.asarray(t, dtype=float) - self.reference_time
        if np.any(lead < -TIME_TOLERANCE):
            worst = float(np.min(lead))
            raise EstimationError(
                f"time: {-worst:g} s before the last observation, from which process noise is predicted on"
            )
        return np.maximum(lead, 0.0)


def predicted_together(estimates: Sequence[MotionEstimate]) -> list[MotionEstimate]:
    """Let motions of one model that were observed last at one time share what is computed for their zones."""
    found, alike = list(estimates), dict[tuple[Dynamics, Tails | None, float], dict[int, ProcessEstimate]]()
    for place, one in enumerate(estimates):
        if isinstance(one, ProcessEstimate):
            alike.setdefault((one.dynamics, one.tails, one.reference_time), {})[place] = one
    for (dynamics, tails, _), some in alike.items():
        mean = np.stack([one.mean for one in some.values()])
        shared = Predictions(dynamics, tails, mean, np.stack([one.state_covariance for one in some.values()]))
        for k, (place, one) in enumerate(some.items()):
            found[place] = replace(one, shared=shared, place=k)
    return found
