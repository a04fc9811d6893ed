"""What is predicted of a motion with process noise, with the interface of every motion estimate.

From the last observation on it is a Gaussian process, smooth enough that its velocity exists, so regions that hold
over a span of time are found as for polynomial motions (`scp_planner.estimation.confidence`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Mask
from scp_planner.errors import EstimationError
from scp_planner.estimation.dynamics import Dynamics, RandomWalk, WhiteJerk
from scp_planner.estimation.error_laws import ErrorLaw, NormalErrors, StudentErrors
from scp_planner.estimation.kalman import FilterState, predict_state
from scp_planner.estimation.motion_estimate import (
    POLYNOMIAL_TERMS,
    MotionEstimate,
    MotionPolynomials,
    check_span,
    integrate,
    standardised_speed,
)
from scp_planner.scenario.process_model import Tails

CENTER_TOLERANCE = 1e-3
"""m; how far piecewise polynomials may lie from a predicted centre that is not polynomial."""

COVARIANCE_TOLERANCE = 1e-3
"""Relative; how much piecewise polynomials may exceed a covariance that is not polynomial."""

_PAST = 1e-9  # units of time; times this little before the last observation are taken for it
_MOST_HALVINGS = 12
_HALVED = 7  # pieces of a motion that is not polynomial that are tried first, each twice as long as the one before
_CHECKS = 21  # points of a piece at which its error is measured
_EXPONENTS = np.arange(POLYNOMIAL_TERMS)
_NODES = 0.5 - 0.5 * np.cos(np.pi * _EXPONENTS / (POLYNOMIAL_TERMS - 1))  # Chebyshev-Lobatto: neighbours meet
_BETWEEN = np.linspace(0.0, 1.0, _CHECKS)
_POWERS = _BETWEEN[:, None] ** _EXPONENTS
_SOLVE = np.linalg.inv(_NODES[:, None] ** _EXPONENTS)


@dataclass(frozen=True)
class ProcessEstimate(MotionEstimate):
    """A motion with process noise, predicted from the last observation on.

    Attributes
    ----------
    dynamics : Dynamics
    mean : (d, 2)
        Expected state at the reference time.
    state_covariance : (2 d, 2 d)
        Of the state, in the order position x, position y, velocity x, ...
    tails : Tails or None
    rejected : tuple of int
        Observations, by their place in the input, that were left out.
    """

    reference_time: float
    observations: int
    noise_covariance: Array
    dynamics: Dynamics
    mean: Array
    state_covariance: Array
    tails: Tails | None = None
    rejected: tuple[int, ...] = ()
    _known: dict[tuple[float, float], MotionPolynomials] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    regressors = None

    @property
    def order(self) -> int:  # type: ignore[override]
        """What the prediction keeps up: 1 the velocity, 2 the acceleration."""
        return self.dynamics.order

    @property
    def errors(self) -> ErrorLaw:  # type: ignore[override]
        """Normal, or Student with heavy tails."""
        return NormalErrors() if self.tails is None else StudentErrors(self.tails.degrees_of_freedom)

    @property
    def earliest(self) -> float:
        """The time of the last observation, s."""
        return self.reference_time

    @property
    def velocity(self) -> Array:
        """Estimated velocity at the reference time: (2,) m/s."""
        return self.mean[1]

    @property
    def acceleration(self) -> Array:
        """Expected acceleration at the reference time: (2,) m/s^2."""
        return self.dynamics.acceleration(self.mean)

    def position(self, t: ArrayLike) -> Array:
        """Predicted centre at times t (...), s, not before the reference time: (..., 2) m."""
        return self._center(self._lead(t))

    def covariance(self, t: ArrayLike) -> Array:
        """Covariance of the error of the predicted centre at times t (...), s: (..., 2, 2) m^2."""
        return self._covariance(self._lead(t))

    def polynomials(self, start: float, stop: float) -> MotionPolynomials:
        """Centre and covariance over [start, stop], s: exact for a random walk, else within tolerances."""
        check_span(start, stop)
        if (start, stop) not in self._known:  # zones and what compares predictions ask for the same
            self._known[start, stop] = self._pieces(float(self._lead(start)), float(self._lead(stop)))
        return self._known[start, stop]

    def _pieces(self, first: float, last: float) -> MotionPolynomials:
        """Centre and covariance over lead times, s."""
        bends = () if self.tails is None else self.tails.lead_time
        leads = np.array([first, *(lead for lead in bends if first < lead < last), last])
        if isinstance(self.dynamics, WhiteJerk):
            return self._expanded(leads, self.dynamics.diffusion)
        if not isinstance(self.dynamics, RandomWalk):  # hard to follow at first, easy later
            halved = first + (last - first) * 0.5 ** np.arange(_HALVED, 0, -1)
            leads = np.unique(np.concatenate([leads, halved]))
        fitted, missed = self._interpolated(leads)
        for _ in range(_MOST_HALVINGS):
            if not np.any(missed):
                break
            leads = np.sort(np.concatenate([leads, 0.5 * (leads[1:] + leads[:-1])[missed]]))
            fitted, missed = self._interpolated(leads)
        return fitted

    def standardised_length(self, start: float, stop: float) -> float:
        """How much the standardised error moves over [start, stop], which must be finite."""
        if not start <= stop:
            raise EstimationError(f"span of time: its start {start!r} is after its stop {stop!r}")
        if not math.isfinite(stop):
            raise EstimationError(f"span of time: its stop {stop!r} must be finite for a motion with process noise")
        first, last = float(self._lead(start)), float(self._lead(stop))
        if first == last:
            return 0.0
        # errors turn on the scale of the time that the velocity needs to blur the position; then ever more
        # slowly
        p = self.state_covariance
        scale = math.sqrt((p[0, 0] + p[1, 1]) / (p[2, 2] + p[3, 3]))
        return integrate(
            lambda u: scale * np.exp(u) * standardised_speed(*self._rates(scale * np.expm1(u))),
            math.log1p(first / scale),
            math.log1p(last / scale),
        )

    def _lead(self, t: ArrayLike) -> Array:
        lead = np.asarray(t, dtype=float) - self.reference_time
        if np.any(lead < -_PAST):
            worst = float(np.min(lead))
            raise EstimationError(
                f"time: {-worst:g} s before the last observation, from which process noise is predicted on"
            )
        return np.maximum(lead, 0.0)

    def _center(self, lead: Array) -> Array:
        return self.dynamics.transition(lead)[..., 0, :] @ self.mean

    def _covariance(self, lead: Array) -> Array:
        return self._inflation(lead)[..., None, None] * self._rates(lead)[0]

    def _inflation(self, lead: Array) -> Array:
        if self.tails is None:
            return np.ones_like(lead)
        return np.asarray(np.interp(lead, self.tails.lead_time, self.tails.inflation))

    def _rates(self, lead: Array) -> tuple[Array, Array, Array]:
        """Covariances of the error, of it with its rate, of its rate, before inflation: (..., 2, 2) each."""
        f, q = self.dynamics.transition(lead), self.dynamics.process_noise(lead)
        d = self.dynamics.states
        p = self.state_covariance.reshape(d, 2, d, 2)
        # one product after the other: all three at once are ten times the work
        halfway = (f[..., :2, :] @ p.reshape(d, 4 * d)).reshape(*f.shape[:-2], 2, 2, d, 2)
        blocks = np.einsum("...iakb,...lk->...ilab", halfway, f[..., :2, :])
        blocks = blocks + q[..., :2, :2, None, None] * np.eye(2)
        return blocks[..., 0, 0, :, :], blocks[..., 0, 1, :, :], blocks[..., 1, 1, :, :]

    def _expanded(self, leads: Array, diffusion: float) -> MotionPolynomials:
        """Expand a constant acceleration with white jerk between leads (S + 1,), s: exact, of degree 6 at most."""
        state = FilterState(
            np.full(len(leads) - 1, self.reference_time),
            np.repeat(self.mean[None], len(leads) - 1, axis=0),
            np.repeat(self.state_covariance[None], len(leads) - 1, axis=0),
        )
        predict_state(self.dynamics, state, self.reference_time + leads[:-1])
        center = state.mean / np.array([1.0, 1.0, 2.0])[:, None]
        covariance = np.zeros((len(leads) - 1, 7, 3))
        blocks = state.covariance.reshape(-1, 3, 2, 3, 2)
        for i in range(3):
            for j in range(3):
                block = blocks[:, i, :, j] / (math.factorial(i) * math.factorial(j))
                covariance[:, i + j] += 0.5 * (block + np.swapaxes(block, 1, 2))[:, [0, 0, 1], [0, 1, 1]]
        covariance[:, 5] += diffusion / 20.0 * np.array([1.0, 0.0, 1.0])
        inflation = self._inflation(leads)
        slopes = np.diff(inflation) / np.diff(leads)
        grown = inflation[:-1, None, None] * covariance
        grown[:, 1:] += slopes[:, None, None] * covariance[:, :-1]
        return MotionPolynomials(self.reference_time + leads, center, grown[:, : 6 if self.tails is None else 7])

    def _interpolated(self, leads: Array) -> tuple[MotionPolynomials, Mask]:
        """Interpolate between leads (S + 1,), s, and tell which pieces (S,) are off by more than the tolerances."""
        widths = np.diff(leads)
        center, covariance = self._positions(leads)
        center_error, covariance_error = np.zeros(len(widths)), np.zeros(len(widths))
        true_center, true = center[:, len(_NODES) :], covariance[:, len(_NODES) :]
        center, covariance = _SOLVE @ center[:, : len(_NODES)], _SOLVE @ covariance[:, : len(_NODES)]
        if not isinstance(self.dynamics, RandomWalk):  # degree 3, times an inflation of degree 1
            center_error = np.max(np.linalg.norm(_POWERS @ center - true_center, axis=-1), axis=1)
            missed = np.abs(_POWERS @ covariance - true)
            # no direction's variance is off by more than the sum of what the entries are off by
            least = 0.5 * (true[..., 0] + true[..., 2]) - np.hypot(0.5 * (true[..., 0] - true[..., 2]), true[..., 1])
            covariance_error = np.max((np.maximum(missed[..., 0], missed[..., 2]) + missed[..., 1]) / least, axis=1)
            covariance *= 1.0 + np.max(covariance_error)
        scales = widths[:, None, None] ** _EXPONENTS[:, None]
        fitted = MotionPolynomials(
            self.reference_time + leads,
            center / scales,
            covariance / scales,
            float(np.max(center_error)),
            2.0 * float(np.max(covariance_error)),
        )
        return fitted, (center_error > CENTER_TOLERANCE) | (covariance_error > COVARIANCE_TOLERANCE)

    def _positions(self, leads: Array) -> tuple[Array, Array]:
        """Centres (S, K, 2) and entries xx, xy, yy of covariances (S, K, 3) at nodes of pieces and between them."""
        response, noise, lead = _position_responses(self.dynamics, leads.tobytes())
        d = self.dynamics.states
        halfway = (response @ self.state_covariance.reshape(d, 4 * d)).reshape(*lead.shape, 2, d, 2)
        blocks = np.sum(halfway * response[..., None, :, None], axis=-2)[..., [0, 0, 1], [0, 1, 1]]
        blocks[..., [0, 2]] += noise[..., None]
        return response @ self.mean, self._inflation(lead)[..., None] * blocks


@lru_cache(maxsize=64)
def _position_responses(dynamics: Dynamics, leads: bytes) -> tuple[Array, Array, Array]:
    """How states become positions, (S, K, d), their noise (S, K), and lead times, s; the same for many obstacles."""
    ends = np.frombuffer(leads)
    lead = ends[:-1, None] + np.diff(ends)[:, None] * np.concatenate([_NODES, _BETWEEN])
    return dynamics.transition(lead)[..., 0, :], dynamics.process_noise(lead)[..., 0, 0], lead
