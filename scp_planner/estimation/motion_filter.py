"""Motions with process noise: a Kalman filter, and a predictor with the interface of every motion estimate.

Each component of the position is the first state of a linear system driven by white noise (`Dynamics`); the
two components are independent but for the observation noise. The filter begins at the first observation, with
a normal prior of the velocity, and is exact for any spacing of the times. What it predicts from the last
observation on is a Gaussian process, smooth enough that its velocity exists, so regions that hold over a span
of time are found as for polynomial motions (`scp_planner.estimation.confidence`).
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index, Mask
from scp_planner.errors import EstimationError
from scp_planner.estimation.dynamics import Dynamics, RandomWalk, WhiteJerk, dynamics_of
from scp_planner.estimation.error_laws import ErrorLaw, NormalErrors, StudentErrors
from scp_planner.estimation.motion_estimate import (
    POLYNOMIAL_TERMS,
    MotionEstimate,
    MotionPolynomials,
    check_span,
    integrate,
    standardised_speed,
)
from scp_planner.estimation.observations import (
    Faulty,
    Outliers,
    Screening,
    check_covariance,
    check_observations,
    usable,
)
from scp_planner.scenario.process_model import ProcessModel, Tails
from scp_planner.settings.knobs import word_of

CENTER_TOLERANCE = 1e-3
"""m; how far piecewise polynomials may lie from a predicted centre that is not polynomial."""

COVARIANCE_TOLERANCE = 1e-3
"""Relative; how much piecewise polynomials may exceed a covariance that is not polynomial."""

_PAST = 1e-9  # units of time; times this little before the last observation are taken for it
_MOST_HALVINGS = 12
_CHECKS = 21  # points of a piece at which its error is measured


@dataclass
class FilterState:
    """What a Kalman filter knows of N obstacles.

    Attributes
    ----------
    times : (N,) s
        Of the last observation of each.
    mean : (N, d, 2)
        Expected states; the last axis is x and y.
    covariance : (N, 2 d, 2 d)
        Of the states in the order position x, position y, velocity x, ...
    """

    times: Array
    mean: Array
    covariance: Array


def first_state(
    dynamics: Dynamics, velocity_variance: float, times: Array, positions: Array, noise: Array
) -> FilterState:
    """Begin at first observations: (N,) s, (N, 2) m and their covariances (N, 2, 2) m^2."""
    count, d = len(times), dynamics.states
    mean = np.zeros((count, d, 2))
    mean[:, 0] = positions
    covariance = np.zeros((count, 2 * d, 2 * d))
    covariance[:] = np.kron(dynamics.prior(velocity_variance), np.eye(2))
    covariance[:, :2, :2] = noise
    return FilterState(np.array(times, dtype=float), mean, covariance)


def update_state(dynamics: Dynamics, state: FilterState, times: Array, positions: Array, noise: Array) -> Array:
    """Take in the next observation of each obstacle; give the log likelihood of each: (N,)."""
    predict_state(dynamics, state, times)
    mean, p = state.mean, state.covariance
    innovation = positions - mean[:, 0]
    xx, xy, yy = (p[:, a, b] + noise[:, a, b] for a, b in ((0, 0), (0, 1), (1, 1)))
    determinant = xx * yy - xy**2
    inverse = np.empty_like(noise)
    inverse[:, 0, 0], inverse[:, 1, 1] = yy / determinant, xx / determinant
    inverse[:, 0, 1] = inverse[:, 1, 0] = -xy / determinant
    gain = p[:, :, :2] @ inverse
    weighted = (inverse @ innovation[:, :, None])[:, :, 0]
    mean += (gain @ innovation[:, :, None]).reshape(mean.shape)
    p -= gain @ p[:, :2, :]
    p += np.swapaxes(p, 1, 2).copy()  # rounding would make it lopsided
    p *= 0.5
    squares = np.einsum("na,na->n", weighted, innovation)
    return -0.5 * (squares + np.log(determinant)) - math.log(2.0 * math.pi)


def predict_state(dynamics: Dynamics, state: FilterState, times: Array) -> None:
    """Move the state of each obstacle on to a later time: (N,) s."""
    lag = times - state.times
    f, q = dynamics.transition(lag), dynamics.process_noise(lag)
    state.mean = f @ state.mean
    count, d = len(lag), dynamics.states
    # the same transition for x and y: (N, d, 2, d, 2)
    p = state.covariance.reshape(count, d, 4 * d)
    p = (f @ p).reshape(count, d, 2, d, 2)
    p = np.swapaxes(p, 1, 3).reshape(count, d, 4 * d)
    p = (f @ p).reshape(count, d, 2, d, 2)
    p = np.swapaxes(p, 1, 3)
    p[:, :, 0, :, 0] += q
    p[:, :, 1, :, 1] += q
    state.covariance = p.reshape(count, 2 * d, 2 * d)
    state.times = np.array(times, dtype=float)


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
        first, last = float(self._lead(start)), float(self._lead(stop))
        bends = () if self.tails is None else self.tails.lead_time
        leads = np.array([first, *(lead for lead in bends if first < lead < last), last])
        if isinstance(self.dynamics, WhiteJerk):
            return self._expanded(leads, self.dynamics.diffusion)
        fitted = self._interpolated(leads)
        for _ in range(_MOST_HALVINGS):
            if fitted.center_error <= CENTER_TOLERANCE and fitted.covariance_error <= COVARIANCE_TOLERANCE:
                break
            leads = np.sort(np.concatenate([leads, 0.5 * (leads[1:] + leads[:-1])]))
            fitted = self._interpolated(leads)
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
        blocks = np.einsum("...ij,jakb,...lk->...ilab", f[..., :2, :], p, f[..., :2, :])
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

    def _interpolated(self, leads: Array) -> MotionPolynomials:
        """Interpolate between leads (S + 1,), s, at each piece's Chebyshev-Lobatto nodes: neighbours meet."""
        nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(POLYNOMIAL_TERMS) / (POLYNOMIAL_TERMS - 1))
        exponents = np.arange(POLYNOMIAL_TERMS)
        solve = np.linalg.inv(nodes[:, None] ** exponents)
        between = np.linspace(0.0, 1.0, _CHECKS)
        powers = between[:, None] ** exponents
        widths = np.diff(leads)
        at_nodes = leads[:-1, None] + widths[:, None] * nodes
        at_between = leads[:-1, None] + widths[:, None] * between
        center = solve @ self._center(at_nodes)
        covariance = solve @ self._covariance(at_nodes)[..., [0, 0, 1], [0, 1, 1]]
        if isinstance(self.dynamics, RandomWalk):  # degree 3, times an inflation of degree 1
            center_error = covariance_error = 0.0
        else:
            true = self._covariance(at_between)
            center_error = float(np.max(np.linalg.norm(powers @ center - self._center(at_between), axis=-1)))
            missed = np.abs(powers @ covariance - true[..., [0, 0, 1], [0, 1, 1]])
            # no direction's variance is off by more than the sum of what the entries are off by
            least = np.linalg.eigvalsh(true)[..., 0]
            covariance_error = float(np.max((np.maximum(missed[..., 0], missed[..., 2]) + missed[..., 1]) / least))
            covariance *= 1.0 + covariance_error
        scales = widths[:, None, None] ** exponents[:, None]
        return MotionPolynomials(
            self.reference_time + leads,
            center / scales,
            covariance / scales,
            center_error,
            2.0 * covariance_error,
        )


class MotionFilter:
    """Kalman filters of K obstacles that follow one model, used like a `RecursiveEstimator`.

    Parameters
    ----------
    model : ProcessModel
    obstacles : int
        K.
    covariance : (2, 2) or (K, 2, 2) m^2, or None
        Of one observation; None: it comes with each observation, or is the model's own.
    gate_probability : float, optional
        An observation is left out if, by what was seen before, the probability to see something as far away
        or farther is less.
    missing : Faulty
        What to do with a position that is not finite: refuse it, or take it for not seen.
    """

    def __init__(
        self,
        model: ProcessModel,
        obstacles: int = 1,
        covariance: ArrayLike | None = None,
        *,
        gate_probability: float | None = None,
        missing: Faulty | str = Faulty.REFUSE,
    ) -> None:
        if gate_probability is not None and not 0.0 < gate_probability < 1.0:
            raise EstimationError(f"gate_probability: {gate_probability!r} is not between 0 and 1")
        self.model = model
        self.gate_probability = gate_probability
        self.missing = word_of(Faulty, missing, "missing")
        self._dynamics = dynamics_of(model)
        own = model.noise_deviation**2 * np.eye(2)
        self._noise = np.broadcast_to(
            check_covariance(own if covariance is None else covariance, obstacles), (obstacles, 2, 2)
        )
        d = self._dynamics.states
        self._state = FilterState(
            np.full(obstacles, -math.inf), np.zeros((obstacles, d, 2)), np.zeros((obstacles, 2 * d, 2 * d))
        )
        self._newest = np.full((obstacles, 2), math.nan)
        self._count = np.zeros(obstacles, dtype=np.intp)
        self._noise_sum = np.zeros((obstacles, 2, 2))
        self._rejected = np.zeros(obstacles, dtype=np.intp)
        self.log_likelihood = np.zeros(obstacles)
        """Of all observations of each obstacle but the first: (K,)."""

    @property
    def observations(self) -> Index:
        """How many observations each estimate is made from: (K,)."""
        return self._count.copy()

    @property
    def rejected_in_a_row(self) -> Index:
        """How many of the newest observations of each obstacle the gate left out: (K,)."""
        return self._rejected.copy()

    def copy(self) -> MotionFilter:
        """Give a filter that has seen the same, and goes on by itself."""
        other = copy(self)
        state = self._state
        other._state = FilterState(state.times.copy(), state.mean.copy(), state.covariance.copy())
        for name in ("_newest", "_count", "_noise_sum", "_rejected", "log_likelihood"):
            setattr(other, name, getattr(self, name).copy())
        return other

    def reset(self, obstacle: int = 0) -> None:
        """Forget all that was seen of an obstacle."""
        self._state.times[obstacle] = -math.inf
        self._count[obstacle] = self._rejected[obstacle] = 0
        self._noise_sum[obstacle] = self.log_likelihood[obstacle] = 0.0

    def update(
        self,
        times: ArrayLike,
        positions: ArrayLike,
        covariance: ArrayLike | None = None,
        seen: ArrayLike | None = None,
    ) -> Mask:
        """Take in at most one observation of each obstacle, none of them before its last one.

        Parameters
        ----------
        times : float or (K,) s
        positions : (K, 2) m
        covariance : (2, 2) or (K, 2, 2) m^2, optional
            Of these observations.
        seen : (K,) bool, optional
            Which obstacles were seen. Times and positions of the others are not looked at.

        Returns
        -------
        (K,) bool
            Which observations were used.

        Raises
        ------
        EstimationError
            Naming the obstacle and what is wrong; then nothing has been changed.
        """
        count = len(self._count)
        t = np.broadcast_to(np.asarray(times, dtype=float), (count,))
        z = np.asarray(positions, dtype=float)
        if z.shape != (count, 2):
            raise EstimationError(f"positions: their shape is {z.shape}; must be ({count}, 2)")
        noise = self._noise
        if covariance is not None:
            noise = np.broadcast_to(check_covariance(covariance, count), (count, 2, 2))
        used = usable(t, z, seen, self.missing, self._state.times, self._newest, in_order=True)
        if self.gate_probability is not None:
            inside = self._gate(t, z, noise, used)
            self._rejected += used & ~inside
            used = inside
            self._rejected[used] = 0
        self._begin(t, z, noise, np.flatnonzero(used & (self._count == 0)))
        self._go_on(t, z, noise, np.flatnonzero(used & (self._count > 0)))
        self._newest[used] = z[used]
        self._noise_sum[used] += noise[used]
        self._count += used
        return used

    def estimate(self, obstacle: int = 0) -> ProcessEstimate:
        """Give the estimate of one obstacle as of its last observation."""
        k = obstacle
        if not self._count[k]:
            raise EstimationError(f"obstacle {k}: it has not been seen")
        return ProcessEstimate(
            reference_time=float(self._state.times[k]),
            observations=int(self._count[k]),
            noise_covariance=self._noise_sum[k] / self._count[k],
            dynamics=self._dynamics,
            mean=self._state.mean[k].copy(),
            state_covariance=self._state.covariance[k].copy(),
            tails=self.model.tails,
        )

    def _begin(self, t: Array, z: Array, noise: Array, new: Index) -> None:
        if len(new):
            variance = self.model.velocity_deviation**2
            self._put(new, first_state(self._dynamics, variance, t[new], z[new], noise[new]))

    def _go_on(self, t: Array, z: Array, noise: Array, old: Index) -> None:
        if len(old):
            state = self._take(old)
            self.log_likelihood[old] += update_state(self._dynamics, state, t[old], z[old], noise[old])
            self._put(old, state)

    def _take(self, which: Index) -> FilterState:
        state = self._state
        return FilterState(state.times[which], state.mean[which], state.covariance[which])

    def _put(self, which: Index, part: FilterState) -> None:
        state = self._state
        state.times[which], state.mean[which], state.covariance[which] = (
            part.times,
            part.mean,
            part.covariance,
        )

    def _gate(self, t: Array, z: Array, noise: Array, used: Mask) -> Mask:
        """Tell which observations are not improbable after what was seen before."""
        inside = used.copy()
        for k in np.flatnonzero(used & (self._count > 0)):
            estimate = self.estimate(int(k))
            offset = z[k] - estimate.position(t[k])
            distance = float(offset @ np.linalg.solve(estimate.covariance(t[k]) + noise[k], offset))
            inside[k] = estimate.errors.exceedance(distance) >= (self.gate_probability or 0.0)
        return inside


def estimate_process(
    times: ArrayLike,
    positions: ArrayLike,
    model: ProcessModel,
    covariance: ArrayLike | None = None,
    screening: Screening | None = None,
) -> ProcessEstimate:
    """Estimate a motion with process noise from observations, in any order of time.

    Parameters
    ----------
    times : (n,) s
    positions : (n, 2) m
    model : ProcessModel
    covariance : (2, 2) or (n, 2, 2) m^2, or None
        Of one observation, common or for each; None: the model's own.
    screening : Screening, optional
        As in `scp_planner.estimation.estimate.estimate_motion`; outliers can be kept or gated, each by what was seen
        before it.

    Returns
    -------
    ProcessEstimate

    Raises
    ------
    EstimationError
        Naming what is wrong with the observations.
    """
    screening = screening or Screening()
    if screening.outliers is Outliers.HUBER:
        raise EstimationError("outliers: a motion with process noise can keep or gate them, not weigh them")
    seen = check_observations(times, positions, covariance, screening)
    if not len(seen.times):
        raise EstimationError("observations: there are none")
    gate = screening.gate_probability / len(seen.times) if screening.outliers is Outliers.GATE else None
    tracker = MotionFilter(model, gate_probability=gate)
    sigma = model.noise_deviation**2 * np.eye(2) if seen.covariance is None else seen.covariance
    rejected = list(seen.rejected)
    for i, each in enumerate(np.broadcast_to(sigma, (len(seen.times), 2, 2))):
        if not tracker.update(seen.times[i], seen.positions[i : i + 1], each).all():
            rejected.append(int(seen.rows[i]))
    return replace(tracker.estimate(), rejected=tuple(sorted(rejected)))
