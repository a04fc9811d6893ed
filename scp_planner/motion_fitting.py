"""Fit a motion with process noise to recorded tracks.

First the parameters by maximum likelihood: the filter's innovations are independent and normal with
covariances that the parameters give, so their densities multiply to the likelihood.

Then the tails: real obstacles are mostly calm, and sometimes turn or stop. From every stretch of ``window``
positions of every track the filter predicts, and the squared standardised errors at each lead time are fitted
by a Student distribution. Only the outer fifth of them counts, by a likelihood that is censored below: what a
region needs is the tail, and the calm majority says nothing about it.

A fit to few tracks is uncertain, and a region that ignores this covers too little of the next tracks. So each
fitted distribution is averaged over the uncertainty of its parameters (a jackknife over groups of tracks, as
errors within a track are not independent). The model keeps one number of degrees of freedom for all lead
times, so that its error is one Student process in time, and an inflation of the covariance for each lead time
that is right at the 95 % level.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scp_planner.dynamics import dynamics_of
from scp_planner.errors import EstimationError
from scp_planner.motion_estimate import Array
from scp_planner.motion_models import FilterState, first_state, predict_state, update_state
from scp_planner.process_model import FittedTo, ProcessModel, Tails
from scp_planner.tracks import Track, Tracks

LEAD_TIMES = (0.4, 1.2, 2.4, 4.8)
"""s; as the forecasts of pedestrians are usually judged."""

TAIL_SHARE = 0.2
"""The share of prediction errors, the largest, that the tails are fitted to."""

_logger = logging.getLogger(__name__)

_LONGEST_PIECE = 40  # positions; longer tracks are cut, so that the filter runs over many at once
_GROUPS = 20  # of tracks, for the jackknife
_FEWEST_TRACKS = 10  # that reach a lead time, for its tail to be fitted
_BOUNDS = (1e-7, 1e4)  # of any parameter, in its unit
_LEAD_TOLERANCE = 0.25  # of the usual time between positions: how near to a lead time a position must be
_LEVELS = np.array([0.1, 0.05, 0.02, 0.01])  # tail probabilities that one Student distribution is matched to
_MATCHED = 1  # which of them exactly, for each lead time
_BISECTIONS = 60
_DEGREES = (1.0, 200.0)  # of freedom: bounds

_STARTS: dict[str, dict[str, float]] = {
    "random_walk": {"diffusion": 0.1},
    "mean_reverting": {"diffusion": 0.1, "time_constant": 5.0},
    "singer": {"deviation": 0.5, "time_constant": 1.0},
}


def fit_motion_model(
    tracks: Tracks,
    kind: str = "random_walk",
    *,
    window: int = 8,
    lead_times: Sequence[float] = LEAD_TIMES,
    tails: bool = True,
) -> ProcessModel:
    """Fit a motion with process noise to tracks.

    Parameters
    ----------
    tracks : Tracks
    kind : "random_walk", "mean_reverting" or "singer"
        See `scp_planner.process_model`.
    window : int
        How many positions a prediction is made from, as will be in use.
    lead_times : sequence of float, s
        Increasing; times after the last observation for which the tails are fitted.
    tails : bool
        Whether they are; else errors are taken for normal.

    Returns
    -------
    ProcessModel

    Raises
    ------
    EstimationError
        If the tracks are too few or too short.
    """
    if kind not in _STARTS:
        raise EstimationError(f"kind: {kind!r} is not one of {', '.join(_STARTS)}")
    if window < 1:
        raise EstimationError(f"window: {window!r} is not a positive number")
    model = _most_likely(tracks, kind)
    if tails:
        errors = prediction_errors(tracks, model, window=window, lead_times=lead_times)
        model = model.model_copy(update={"tails": fit_tails(errors)})
    about = FittedTo(
        source=tracks.source, tracks=len(tracks), observations=tracks.observations, window=window
    )
    return model.model_copy(update={"fitted_to": about})


def log_likelihood(tracks: Tracks, model: ProcessModel) -> float:
    """Give the log likelihood of the tracks, each given its first position; long ones are cut in pieces."""
    return _log_likelihood(_batches(tracks), model)


@dataclass(frozen=True)
class PredictionErrors:
    """Errors of predictions for one lead time.

    Attributes
    ----------
    lead_time : float, s
    squares : (m,)
        Squared errors, standardised by the covariance that the model gives without its tails.
    distances : (m,) m
        Their lengths.
    deviations : (m,) m
        Square root of the covariance's mean diagonal entry: the radius of a region is about this times
        sqrt(q).
    tracks : (m,) int
        Place of the track that each is from.
    """

    lead_time: float
    squares: Array
    distances: Array
    deviations: Array
    tracks: NDArray[np.intp]


def prediction_errors(
    tracks: Tracks, model: ProcessModel, *, window: int = 8, lead_times: Sequence[float] = LEAD_TIMES
) -> list[PredictionErrors]:
    """Predict from every stretch of ``window`` positions of every track, and compare with what came.

    A lead time counts where the track has a position within a quarter of the usual time step of it; the
    prediction is for the time of that position.
    """
    windows, targets = _windows(tracks, window, lead_times)
    if not len(windows.times):
        raise EstimationError(f"tracks: none has more than {window} positions")
    state = _run_filter(model, windows.times, windows.positions)
    dynamics = dynamics_of(model)
    errors = []
    for lead_time, target in zip(lead_times, targets, strict=True):
        rows = target.window
        later = FilterState(state.times[rows], state.mean[rows], state.covariance[rows])
        predict_state(dynamics, later, target.times)
        offsets, covariance = target.positions - later.mean[:, 0], later.covariance[:, :2, :2]
        squares = np.einsum("na,na->n", offsets, np.linalg.solve(covariance, offsets[..., None])[..., 0])
        deviations = np.sqrt(0.5 * np.trace(covariance, axis1=1, axis2=2))
        errors.append(
            PredictionErrors(
                float(lead_time), squares, np.linalg.norm(offsets, axis=1), deviations, windows.tracks[rows]
            )
        )
    return errors


def fit_tails(errors: Sequence[PredictionErrors]) -> Tails:
    """Fit Student tails to prediction errors; lead times that too few tracks reach are left out."""
    usable = [e for e in errors if len(np.unique(e.tracks)) >= _FEWEST_TRACKS]
    for e in errors:
        if e not in usable:
            _logger.warning(
                "lead time %g s: fewer than %d tracks reach it; left out", e.lead_time, _FEWEST_TRACKS
            )
    if not usable:
        raise EstimationError(
            f"tracks: fewer than {_FEWEST_TRACKS} reach any of the lead times, too few to fit the tails to"
        )
    quantiles = np.array([_tail_quantiles(e) for e in usable])
    degrees = _common_degrees(quantiles)
    inflations = quantiles[:, _MATCHED] / _student_quantiles(degrees)[_MATCHED]
    return Tails(
        degrees_of_freedom=degrees,
        lead_time=tuple(e.lead_time for e in usable),
        inflation=tuple(inflations.tolist()),
    )


@dataclass(frozen=True)
class _Batch:
    """Pieces of tracks of one length: (N, n) s, (N, n, 2) m."""

    times: Array
    positions: Array


def _batches(tracks: Tracks) -> list[_Batch]:
    pieces: dict[int, list[Track]] = {}
    for track in tracks:
        count = math.ceil(len(track) / _LONGEST_PIECE)
        for part in np.array_split(np.arange(len(track)), count):
            if len(part) > 1:
                piece = Track(track.id, track.times[part], track.positions[part])
                pieces.setdefault(len(part), []).append(piece)
    if not pieces:
        raise EstimationError("tracks: none has more than one position")
    return [
        _Batch(np.array([p.times for p in own]), np.array([p.positions for p in own]))
        for _, own in sorted(pieces.items())
    ]


def _log_likelihood(batches: Sequence[_Batch], model: ProcessModel) -> float:
    return float(sum(_filtered(model, batch.times, batch.positions)[1].sum() for batch in batches))


def _run_filter(model: ProcessModel, times: Array, positions: Array) -> FilterState:
    return _filtered(model, times, positions)[0]


def _filtered(model: ProcessModel, times: Array, positions: Array) -> tuple[FilterState, Array]:
    """Run the filter over sequences of one length; give the last states and the log likelihoods."""
    dynamics, count = dynamics_of(model), len(times)
    noise = np.broadcast_to(model.noise_deviation**2 * np.eye(2), (count, 2, 2))
    state = first_state(dynamics, model.velocity_deviation**2, times[:, 0], positions[:, 0], noise)
    likelihood = np.zeros(count)
    for i in range(1, times.shape[1]):
        likelihood += update_state(dynamics, state, times[:, i], positions[:, i], noise)
    return state, likelihood


def _most_likely(tracks: Tracks, kind: str) -> ProcessModel:
    """Maximise the likelihood over the logarithms of the parameters."""
    from scipy.optimize import minimize

    batches = _batches(tracks)
    count = sum(batch.times.size - len(batch.times) for batch in batches)
    names = [*_STARTS[kind], "velocity_deviation", "noise_deviation"]
    start = np.log([*_STARTS[kind].values(), 1.0, 0.05])

    def model_at(logs: Array) -> ProcessModel:
        values = dict(zip(names, np.exp(logs).tolist(), strict=True))
        velocity, noise = values.pop("velocity_deviation"), values.pop("noise_deviation")
        return ProcessModel(
            process={"kind": kind, **values}, velocity_deviation=velocity, noise_deviation=noise
        )

    result = minimize(
        lambda logs: -_log_likelihood(batches, model_at(logs)) / count,
        start,
        method="L-BFGS-B",
        bounds=[tuple(np.log(_BOUNDS))] * len(names),
    )
    _logger.info(
        "log likelihood %.6g per position after %d iterations: %s", -result.fun, result.nit, result.message
    )
    return model_at(result.x)


@dataclass(frozen=True)
class _Windows:
    times: Array  # (N, window) s
    positions: Array  # (N, window, 2) m
    tracks: NDArray[np.intp]  # (N,)


@dataclass(frozen=True)
class _Targets:
    window: NDArray[np.intp]  # (M,)
    times: Array  # (M,) s
    positions: Array  # (M, 2) m


def _windows(tracks: Tracks, window: int, lead_times: Sequence[float]) -> tuple[_Windows, list[_Targets]]:
    steps = np.concatenate([np.diff(track.times) for track in tracks])
    if not len(steps):
        raise EstimationError("tracks: none has more than one position")
    tolerance = _LEAD_TOLERANCE * float(np.median(steps))
    times: list[Array] = []
    positions: list[Array] = []
    owners: list[int] = []
    targets: list[list[tuple[int, float, Array]]] = [[] for _ in lead_times]
    for owner, track in enumerate(tracks):
        for first in range(len(track) - window):
            last = first + window - 1
            index = len(times)
            times.append(track.times[first : last + 1])
            positions.append(track.positions[first : last + 1])
            owners.append(owner)
            for lead_time, found in zip(lead_times, targets, strict=True):
                wanted = track.times[last] + lead_time
                near = int(np.argmin(np.abs(track.times[last:] - wanted))) + last
                if near > last and abs(track.times[near] - wanted) <= tolerance:
                    found.append((index, float(track.times[near]), track.positions[near]))
    windows = _Windows(np.array(times), np.array(positions), np.array(owners, dtype=np.intp))
    return windows, [
        _Targets(
            np.array([row[0] for row in found], dtype=np.intp),
            np.array([row[1] for row in found]),
            np.array([row[2] for row in found]).reshape(-1, 2),
        )
        for found in targets
    ]


def _tail_quantiles(errors: PredictionErrors) -> Array:
    """Give the squares exceeded with each of `_LEVELS`, averaged over what the tracks leave open."""
    best = _censored_fit(errors.squares, np.log([1.0, 6.0]))
    places = np.unique(errors.tracks, return_inverse=True)[1]
    groups = places * _GROUPS // (places.max() + 1)
    left_out = np.array([_censored_fit(errors.squares[groups != g], best) for g in np.unique(groups)])
    # jackknife replicates, spread so that their mean square is the variance of the estimate
    replicates = np.exp(best + math.sqrt(len(left_out) - 1.0) * (left_out - left_out.mean(axis=0)))
    inflation, degrees = replicates[:, :1], np.clip(replicates[:, 1:], *_DEGREES)
    low, high = np.zeros(len(_LEVELS)), np.ones(len(_LEVELS))

    def above(squares: Array) -> NDArray[np.bool_]:
        chances = (1.0 + squares / (degrees * inflation)) ** (-0.5 * degrees)
        return chances.mean(axis=0) > _LEVELS

    while np.any(above(high)):
        high *= 2.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        is_above = above(middle)
        low, high = np.where(is_above, middle, low), np.where(is_above, high, middle)
    # a Student distribution is not quite the right shape: take it where it matters most from the errors themselves
    fitted = np.exp(best[0]) * _student_quantiles(math.exp(best[1]))[_MATCHED]
    anchor = float(np.quantile(errors.squares, 1.0 - _LEVELS[_MATCHED])) / fitted
    return anchor * 0.5 * (low + high)


def _censored_fit(squares: Array, start: Array) -> Array:
    """Fit a Student distribution to the outer `TAIL_SHARE` of the squared errors: log inflation, log degrees.

    Of the others only their number counts. The squared length of a Student vector in the plane exceeds s with
    probability (1 + s / (nu a))^(-nu / 2), a the inflation.
    """
    from scipy.optimize import minimize

    threshold = float(np.quantile(squares, 1.0 - TAIL_SHARE))
    outer = squares[squares > threshold]
    share = len(outer) / len(squares)

    def cost(logs: Array) -> float:
        a, nu = np.exp(logs)
        inside = -math.expm1(-0.5 * nu * math.log1p(threshold / (nu * a)))
        density = -math.log(2.0 * a) - (0.5 * nu + 1.0) * float(np.mean(np.log1p(outer / (nu * a))))
        return -(1.0 - share) * math.log(inside) - share * density

    bounds = [tuple(np.log(_BOUNDS)), tuple(np.log(_DEGREES))]
    return np.asarray(minimize(cost, start, method="L-BFGS-B", bounds=bounds).x)


def _student_quantiles(degrees: float) -> Array:
    """Give the squares that a Student vector's exceeds with each of `_LEVELS`."""
    return degrees * np.expm1(-2.0 * np.log(_LEVELS) / degrees)


def _common_degrees(quantiles: Array) -> float:
    """Find the degrees of freedom whose quantiles fit those of all lead times, each matched at one level."""
    from scipy.optimize import minimize_scalar

    def miss(log_degrees: float) -> float:
        shape = _student_quantiles(math.exp(log_degrees))
        return float(np.sum(np.log(quantiles / quantiles[:, [_MATCHED]] * shape[_MATCHED] / shape) ** 2))

    return math.exp(float(minimize_scalar(miss, bounds=tuple(np.log(_DEGREES)), method="bounded").x))
