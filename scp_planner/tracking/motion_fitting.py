"""Fit a motion with process noise to recorded tracks."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index, joined, rows_of
from scp_planner.errors import EstimationError
from scp_planner.scenario.process_model import FittedTo, ProcessModel, Tails
from scp_planner.tracking.confidence import StudentErrors
from scp_planner.tracking.conformal import conformal_quantile
from scp_planner.tracking.dynamics import dynamics_of
from scp_planner.tracking.kalman import Scan, predict_state, run_filter, scans_of
from scp_planner.tracking.maximum_likelihood import CheckedObservations
from scp_planner.tracking.tracks import Track, Tracks


@dataclass(frozen=True)
class FitSettings:
    """Lead times, bounds and tails of a fit."""

    lead_times: tuple[float, ...] = (0.4, 1.2, 2.4, 4.8)  # s; as the forecasts of pedestrians are usually judged
    tail_share: float = 0.1  # The share of prediction errors, the largest, that the tails are fitted to
    longest_piece: int = 40  # positions; longer tracks are cut, so that the filter runs over many at once
    groups: int = 20  # of tracks, for the jackknife
    fewest_tracks: int = 10  # that reach a lead time, for its tail to be fitted
    bounds: tuple[float, float] = (1e-7, 1e4)  # of any parameter, in its unit, but
    time_constants: tuple[float, float] = (1e-2, 1e3)  # units of time
    least_noise: float = 1e-3  # of the usual distance between positions: less does not matter
    at_bound: float = 0.01  # relative: a parameter so near to its bound is at it
    lead_tolerance: float = 0.501  # of the usual time between positions: how near to a lead time one must be
    matched: int = 0  # which of them exactly, for each lead time
    most_spread: float = 0.7  # standard deviation of a log quantile that is believed
    degrees: tuple[float, float] = (1.0, 200.0)  # of freedom: bounds
    # m and s between two positions of people, in whose units parameters are near 1
    usual_step: float = 0.5
    usual_lag: float = 0.4
    usual_noise: float = 0.1  # of the usual distance between positions
    unit_bits: int = 8  # a unit is 1, or 2^8 as large or small, and so on: how often people were seen does not matter


FIT = FitSettings()
_logger = logging.getLogger(__name__)

_LEVELS = np.array([0.05, 0.02, 0.01, 0.005])  # tail probabilities that one Student distribution is matched to
_PARAMETERS = {
    "random_walk": ("diffusion",),
    "mean_reverting": ("diffusion", "time_constant"),
    # the deviation follows: what a short manoeuvre does to the velocity is told apart from how long it lasts
    "singer": ("diffusion", "time_constant"),
}


def fit_motion_model(
    tracks: Tracks,
    kind: str = "random_walk",
    *,
    window: int = 8,
    lead_times: Sequence[float] = FIT.lead_times,
    tails: bool = True,
    conformal: float | None = None,
    noise: float | None = None,
) -> ProcessModel:
    """Fit a motion with process noise to tracks.

    Parameters
    ----------
    tracks : Tracks
    kind : "random_walk", "mean_reverting" or "singer"
        See `scp_planner.scenario.process_model`.
    window : int
        How many positions a prediction is made from, as will be in use.
    lead_times : sequence of float, s
        Increasing; times after the last observation for which the tails are fitted.
    tails : bool
        Whether they are; else errors are taken for normal.
    conformal : float, optional
        A probability between 0 and 1, such as 0.95: the level at which regions for the lead times are split-conformal
        (`scp_planner.tracking.conformal`). Motion and tails are then fitted to every other track, and the sizes of
        the regions taken from the rest.
    noise : float, optional
        Standard deviation of an observed coordinate, m, to be taken as it is: smoothed tracks show none of their own.

    Returns
    -------
    ProcessModel

    Raises
    ------
    EstimationError
        If the tracks are too few or too short.
    """
    if kind not in _PARAMETERS:
        raise EstimationError(f"kind: {kind!r} is not one of {', '.join(_PARAMETERS)}")
    if window < 1:
        raise EstimationError(f"window: {window!r} is not a positive number")
    if conformal is not None and not 0.0 < conformal < 1.0:
        raise EstimationError(f"conformal: {conformal!r} is not between 0 and 1")
    if noise is not None and not 0.0 < noise < math.inf:
        raise EstimationError(f"noise: {noise!r} is not a positive number")
    fitted = tracks if conformal is None else tracks.halves()[0]
    model = _most_likely(fitted, kind, noise)
    if tails or conformal is not None:
        errors = prediction_errors(fitted, model, window=window, lead_times=lead_times)
        model = model.model_copy(update={"tails": fit_tails(errors)})
    if conformal is not None:
        errors = prediction_errors(tracks.halves()[1], model, window=window, lead_times=lead_times)
        model = model.model_copy(update={"tails": conformal_tails(errors, model.tails, 1.0 - conformal)})
    about = FittedTo(source=tracks.source, tracks=len(tracks), observations=tracks.observations, window=window)
    return model.model_copy(update={"fitted_to": about})


def log_likelihood(tracks: Tracks, model: ProcessModel) -> float:
    """Give the log likelihood of the tracks, each given its first position; long ones are cut in pieces."""
    return float(run_filter(model, _scans(tracks))[1].sum())


def _scans(tracks: Tracks) -> list[Scan]:
    """Positions of all tracks, one each at a time; those of the longest tracks first."""
    pieces: list[CheckedObservations] = []
    for track in tracks:
        parts = np.array_split(np.arange(len(track)), math.ceil(len(track) / FIT.longest_piece))
        pieces += [CheckedObservations(track.times[part], track.positions[part]) for part in parts if len(part) > 1]
    if not pieces:
        raise EstimationError("tracks: none has more than one position")
    return list(scans_of(sorted(pieces, key=lambda piece: len(piece.times), reverse=True)))


@dataclass(frozen=True)
class PredictionErrors:
    """Errors of predictions for one lead time."""

    lead_time: float
    squares: Array  # Squared errors, standardised by the covariance that the model gives without its tails
    deviations: Array  # Square root of the covariance's mean diagonal entry
    tracks: Index
    stretches: Index


@dataclass(frozen=True)
class Stretches:
    """Positions that predictions are made from."""

    times: Array
    positions: Array
    tracks: Index  # Place of the track that each is from


@dataclass(frozen=True)
class Targets:
    """Positions that are predicted for one lead time."""

    stretches: Index  # From which stretch each is predicted
    times: Array
    positions: Array


def stretches_of(tracks: Tracks, window: int, lead_times: Sequence[float]) -> tuple[Stretches, list[Targets]]:
    """Cut every track into all its stretches of ``window`` positions, each with what came at the lead times."""
    steps = np.concatenate([np.diff(track.times) for track in tracks])
    if not len(steps):
        raise EstimationError("tracks: none has more than one position")
    tolerance = FIT.lead_tolerance * float(np.median(steps))
    view = np.lib.stride_tricks.sliding_window_view
    found, long = [Stretches(np.zeros((0, window)), np.zeros((0, window, 2)), np.zeros(0, dtype=np.intp))], []
    for place, track in enumerate(tracks):
        if len(track) > window:
            times, positions = view(track.times[:-1], window), view(track.positions[:-1], window, axis=0)
            found.append(Stretches(times, positions.swapaxes(1, 2), np.full(len(times), place)))
            long.append(track)
    firsts = np.cumsum([len(part.tracks) for part in found])
    return joined(found), [_targets(long, firsts, window, lead, tolerance) for lead in lead_times]


def _targets(tracks: Sequence[Track], firsts: Index, window: int, lead_time: float, tolerance: float) -> Targets:
    """Find the position of each track that is nearest to each stretch's end plus the lead time, if it is near."""
    found = [Targets(np.zeros(0, dtype=np.intp), np.zeros(0), np.zeros((0, 2)))]
    for track, first in zip(tracks, firsts, strict=False):
        ends = np.arange(window - 1, len(track) - 1)
        wanted = track.times[ends] + lead_time
        after = np.clip(np.searchsorted(track.times, wanted), 1, len(track) - 1)
        nearer = wanted - track.times[after - 1] < track.times[after] - wanted
        nearest = after - nearer
        good = np.flatnonzero((nearest > ends) & (np.abs(track.times[nearest] - wanted) <= tolerance))
        found.append(Targets(first + good, track.times[nearest[good]], track.positions[nearest[good]]))
    return joined(found)


def prediction_errors(
    tracks: Tracks, model: ProcessModel, *, window: int = 8, lead_times: Sequence[float] = FIT.lead_times
) -> list[PredictionErrors]:
    """Predict from every stretch of ``window`` positions of every track, and compare with what came."""
    stretches, targets = stretches_of(tracks, window, lead_times)
    if not len(stretches.times):
        raise EstimationError(
            f"tracks: none has more than {window} positions, which a prediction is made from (window)"
        )
    scans = [Scan(stretches.times[:, i], stretches.positions[:, i]) for i in range(window)]
    (state, _), errors = run_filter(model, scans), []
    for lead_time, target in zip(lead_times, targets, strict=True):
        rows = target.stretches
        later = rows_of(state, rows)
        predict_state(dynamics_of(model), later, target.times)
        offsets, covariance = target.positions - later.mean[:, 0], later.covariance[:, :2, :2]
        squares = np.einsum("na,na->n", offsets, np.linalg.solve(covariance, offsets[..., None])[..., 0])
        deviations = np.sqrt(0.5 * np.trace(covariance, axis1=1, axis2=2))
        errors.append(PredictionErrors(float(lead_time), squares, deviations, stretches.tracks[rows], rows))
    return errors


def fit_tails(errors: Sequence[PredictionErrors]) -> Tails:
    """Fit Student tails to prediction errors; lead times that too few tracks reach are left out."""
    usable = [e for e in errors if len(np.unique(e.tracks)) >= FIT.fewest_tracks]
    if not usable:
        raise EstimationError(
            f"tracks: fewer than {FIT.fewest_tracks} reach any of the lead times, too few to fit the tails to: how "
            "often errors are large; without them, tails=False or --no-tails, regions hold less than they say"
        )
    for e in errors:
        if e not in usable:
            _logger.warning("lead time %g s: fewer than %d tracks reach it; left out", e.lead_time, FIT.fewest_tracks)
    quantiles = np.array([_tail_quantiles(e) for e in usable])
    degrees = _common_degrees(quantiles)
    inflations = quantiles[:, FIT.matched] / _student_quantiles(degrees)[FIT.matched]
    return Tails(
        degrees_of_freedom=degrees, lead_time=tuple(e.lead_time for e in usable), inflation=tuple(inflations.tolist())
    )


def conformal_tails(errors: Sequence[PredictionErrors], tails: Tails | None, alpha: float) -> Tails:
    """Inflate covariances so that a region of one level is split-conformal at each lead time."""
    degrees = FIT.degrees[1] if tails is None else tails.degrees_of_freedom
    scale = StudentErrors(degrees).pointwise_scale(alpha)
    found = [(e.lead_time, conformal_quantile(e.squares, alpha, len(np.unique(e.tracks)))) for e in errors]
    usable = [(lead, quantile / scale) for lead, quantile in found if 0.0 < quantile < math.inf]
    if not usable:
        raise EstimationError(f"tracks: too few are left to find regions of level {1.0 - alpha:g} from")
    return Tails(
        degrees_of_freedom=degrees,
        lead_time=tuple(lead for lead, _ in usable),
        inflation=tuple(inflation for _, inflation in usable),
    )


@dataclass(frozen=True)
class _Range:
    """Values of a parameter that are tried, in SI."""

    unit: float  # in which it is near 1
    least: float
    most: float
    usual: float


def _ranges(tracks: Tracks) -> dict[str, _Range]:
    """Ranges of all parameters: robots on a table top, and ships, are fitted like people."""
    lags = np.concatenate([np.zeros(0), *(np.diff(track.times) for track in tracks)])
    steps = np.concatenate([np.zeros(0), *(np.hypot(*np.diff(track.positions, axis=0).T) for track in tracks)])
    length, time = _coarse(steps, FIT.usual_step), _coarse(lags, FIT.usual_lag)
    speed = math.sqrt(float((steps**2).sum() / (2.0 * (lags**2).sum())))  # along one axis
    durations = [np.ptp(track.times) for track in tracks if len(track) > 1]
    lasting = math.sqrt(float(np.median(lags)) * float(np.median(durations)))
    step = float(steps.mean())
    units = {
        "diffusion": (length**2 / time**3, 2.0 * speed**2 / lasting),
        "time_constant": (time, lasting),
        "velocity_deviation": (length / time, speed),
        "noise_deviation": (length, FIT.usual_noise * step),
    }
    found = {}
    for name, (unit, usual) in units.items():
        least, most = (unit * bound for bound in (FIT.time_constants if name == "time_constant" else FIT.bounds))
        if name == "noise_deviation":
            least = max(least, FIT.least_noise * step)
        found[name] = _Range(unit, least, most, min(max(usual, least), most))
    return found


def _coarse(values: Array, usual: float) -> float:
    """Power of 2^8 that is nearest to the mean of values, in relation to usual ones."""
    mean = float(values.mean()) if len(values) else 0.0
    return 2.0 ** (FIT.unit_bits * round(math.log2(mean / usual) / FIT.unit_bits)) if mean > 0.0 else 1.0


def bounds_met(tracks: Tracks, model: ProcessModel) -> list[str]:
    """Say which parameters of a fit to tracks ended at their bounds, so that the tracks say nothing more of them."""
    process = model.process.model_dump(exclude={"kind", "deviation"})
    if model.process.kind == "singer":
        process["diffusion"] = 2.0 * model.process.deviation**2 * model.process.time_constant
    values = {**process, "velocity_deviation": model.velocity_deviation, "noise_deviation": model.noise_deviation}
    bounds = {name: (one.least, one.most) for name, one in _ranges(tracks).items()}
    if model.tails is not None:
        values["degrees_of_freedom"], bounds["degrees_of_freedom"] = model.tails.degrees_of_freedom, FIT.degrees
    return [
        f"{name} ended at its {which} bound, {bound:.3g}: the tracks do not tell how much {word} it is"
        for name, value in values.items()
        for bound, which, word in zip(bounds[name], ("lower", "upper"), ("less", "more"), strict=True)
        if abs(math.log(value / bound)) < FIT.at_bound
    ]


def _most_likely(tracks: Tracks, kind: str, noise: float | None) -> ProcessModel:
    """Maximise the likelihood over the logarithms of the parameters; the noise may be given, m."""
    from scipy.optimize import minimize

    scans = _scans(tracks)
    count = sum(len(scan.times) for scan in scans[1:])
    names = (*_PARAMETERS[kind], "velocity_deviation", *(("noise_deviation",) if noise is None else ()))
    ranges = [_ranges(tracks)[name] for name in names]
    units = np.array([one.unit for one in ranges])

    def model_at(logs: Array) -> ProcessModel:
        values = dict(zip(names, (units * np.exp(logs)).tolist(), strict=True))
        velocity, own = values.pop("velocity_deviation"), values.pop("noise_deviation", noise)
        if kind == "singer":
            values["deviation"] = math.sqrt(0.5 * values.pop("diffusion") / values["time_constant"])
        return ProcessModel(process={"kind": kind, **values}, velocity_deviation=velocity, noise_deviation=own)

    result = minimize(
        lambda logs: -run_filter(model_at(logs), scans)[1].sum() / count,
        np.log([one.usual / one.unit for one in ranges]),
        method="L-BFGS-B",
        bounds=np.log([(one.least / one.unit, one.most / one.unit) for one in ranges]),
    )
    _logger.info("log likelihood %.6g per position after %d iterations: %s", -result.fun, result.nit, result.message)
    return model_at(result.x)


def _tail_quantiles(errors: PredictionErrors) -> Array:
    """Give the squares that the next tracks' errors exceed with each of `_LEVELS`, the fit's own error counted in."""
    best = _censored_fit(errors.squares, np.log([1.0, 6.0]))
    places = np.unique(errors.tracks, return_inverse=True)[1]
    groups = places * FIT.groups // (places.max() + 1)  # of neighbours: people who walk together are in one
    numbers = np.unique(groups)
    left_out = np.array([_censored_fit(errors.squares[groups != g], best) for g in numbers])
    logs = np.array([each[0] + np.log(_student_quantiles(math.exp(each[1]))) for each in left_out])
    spread = np.minimum((len(numbers) - 1.0) * np.var(logs, axis=0), FIT.most_spread**2)
    inflation, degrees = np.exp(best)
    steepness = 0.5 * degrees * (1.0 - _LEVELS ** (2.0 / degrees))
    quantiles = inflation * _student_quantiles(degrees, _LEVELS * np.exp(-0.5 * steepness**2 * spread))
    # a Student distribution is not quite the right shape: take it where it matters most from the errors themselves
    fitted = inflation * _student_quantiles(degrees)[FIT.matched]
    anchor = float(np.quantile(errors.squares, 1.0 - _LEVELS[FIT.matched])) / fitted
    return anchor * quantiles


def _censored_fit(squares: Array, start: Array) -> Array:
    """Fit a Student distribution to the outer `TAIL_SHARE` of the squared errors: log inflation, log degrees."""
    from scipy.optimize import minimize

    threshold = float(np.quantile(squares, 1.0 - FIT.tail_share))
    outer = squares[squares > threshold]
    share = len(outer) / len(squares)

    def cost(logs: Array) -> float:
        a, nu = np.exp(logs)
        inside = -math.expm1(-0.5 * nu * math.log1p(threshold / (nu * a)))
        density = -math.log(2.0 * a) - (0.5 * nu + 1.0) * float(np.mean(np.log1p(outer / (nu * a))))
        return -(1.0 - share) * math.log(inside) - share * density

    bounds = [tuple(np.log(FIT.bounds)), tuple(np.log(FIT.degrees))]
    return np.asarray(minimize(cost, start, method="L-BFGS-B", bounds=bounds).x)


def _student_quantiles(degrees: float, chances: Array = _LEVELS) -> Array:
    """Give the squares that a Student vector's exceeds with each chance."""
    return degrees * np.expm1(-2.0 * np.log(chances) / degrees)


def _common_degrees(quantiles: Array) -> float:
    """Find the degrees of freedom whose quantiles fit those of all lead times, each matched at one level."""
    from scipy.optimize import minimize_scalar

    def miss(log_degrees: float) -> float:
        shape = _student_quantiles(math.exp(log_degrees))
        return float(np.sum(np.log(quantiles / quantiles[:, [FIT.matched]] * shape[FIT.matched] / shape) ** 2))

    return math.exp(float(minimize_scalar(miss, bounds=tuple(np.log(FIT.degrees)), method="bounded").x))
