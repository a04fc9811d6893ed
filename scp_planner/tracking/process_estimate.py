"""Prediction of a motion with process noise, with the interface of every motion estimate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.scenario.process_model import Tails
from scp_planner.tracking.dynamics import Dynamics, WhiteJerk
from scp_planner.tracking.error_laws import ErrorLaw, NormalErrors, StudentErrors
from scp_planner.tracking.kalman import FilterState, predict_state
from scp_planner.tracking.motion_estimate import MotionEstimate, MotionPolynomials, check_span
from scp_planner.tracking.process_spans import ProcessSpans
from scp_planner.tracking.tolerances import TIME_TOLERANCE


@dataclass(frozen=True)
class ProcessEstimate(MotionEstimate):
    """A motion with process noise, predicted from the last observation on."""

    reference_time: float
    observations: int
    noise_covariance: Array
    dynamics: Dynamics
    mean: Array  # Expected state at the reference time
    state_covariance: Array
    tails: Tails | None = None
    rejected: tuple[int, ...] = ()  # Observations, by their place in the input, that were left out
    _known: dict[tuple[float, float], MotionPolynomials] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _lengths: dict[tuple[float, float], float] = field(default_factory=dict, init=False, repr=False, compare=False)

    regressors = None

    @property
    def order(self) -> int:  # type: ignore[override]
        """Order of the predicted motion: 1 keeps the velocity, 2 the acceleration."""
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
        return self._center(self.lead(t))

    def covariance(self, t: ArrayLike) -> Array:
        """Covariance of the error of the predicted centre at times t (...), s: (..., 2, 2) m^2."""
        return self._covariance(self.lead(t))

    def polynomials(self, start: float, stop: float) -> MotionPolynomials:
        """Centre and covariance over [start, stop], s: exact for a random walk, else within tolerances."""
        check_span(start, stop)
        if (start, stop) not in self._known:  # zones and what compares predictions ask for the same
            self._known[start, stop] = self._pieces(float(self.lead(start)), float(self.lead(stop)))
        return self._known[start, stop]

    def _pieces(self, first: float, last: float) -> MotionPolynomials:
        """Centre and covariance over lead times, s."""
        if isinstance(self.dynamics, WhiteJerk):
            bends = () if self.tails is None else self.tails.lead_time
            leads = np.array([first, *(lead for lead in bends if first < lead < last), last])
            return self._expanded(leads, self.dynamics.diffusion)
        return self._spans.pieces(first, last)[0]

    def standardised_length(self, start: float, stop: float) -> float:
        """Path length of the standardised error over [start, stop], which must be finite."""
        if not start <= stop:
            raise EstimationError(f"span of time: its start {start!r} is after its stop {stop!r}")
        if not math.isfinite(stop):
            raise EstimationError(f"span of time: its stop {stop!r} must be finite for a motion with process noise")
        if (start, stop) not in self._lengths:
            self._lengths[start, stop] = float(self._spans.lengths(float(self.lead(start)), float(self.lead(stop)))[0])
        return self._lengths[start, stop]

    @property
    def _spans(self) -> ProcessSpans:
        return spans_of([self])

    def keep(self, asked: tuple[float, float], found: float | MotionPolynomials) -> None:
        """Keep the standardised length over a span of time from start to stop, s, or the polynomials."""
        if isinstance(found, MotionPolynomials):
            self._known[asked] = found
        else:
            self._lengths[asked] = found

    def lead(self, t: ArrayLike) -> Array:
        """Times since the reference time, s: (...), of times t (...), s, which must not be before it."""
        lead = np.asarray(t, dtype=float) - self.reference_time
        if np.any(lead < -TIME_TOLERANCE):
            worst = float(np.min(lead))
            raise EstimationError(
                f"time: {-worst:g} s before the last observation, from which process noise is predicted on"
            )
        return np.maximum(lead, 0.0)

    def _center(self, lead: Array) -> Array:
        return self.dynamics.transition(lead)[..., 0, :] @ self.mean

    def _covariance(self, lead: Array) -> Array:
        spans = self._spans
        errors = spans.rates(lead.ravel())[0].reshape(*lead.shape, 2, 2)
        return spans.inflation(lead)[..., None, None] * errors

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
        inflation = self._spans.inflation(leads)
        slopes = np.diff(inflation) / np.diff(leads)
        grown = inflation[:-1, None, None] * covariance
        grown[:, 1:] += slopes[:, None, None] * covariance[:, :-1]
        return MotionPolynomials(self.reference_time + leads, center, grown[:, : 6 if self.tails is None else 7])


def spans_of(estimates: Sequence[ProcessEstimate]) -> ProcessSpans:
    """Take motions of the same model, from the same reference time on, together."""
    first = estimates[0]
    mean = np.stack([one.mean for one in estimates])
    covariance = np.stack([one.state_covariance for one in estimates])
    return ProcessSpans(first.dynamics, first.tails, first.reference_time, mean, covariance)
