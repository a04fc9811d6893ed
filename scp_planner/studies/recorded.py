"""Coverage of a fitted motion model's regions on recorded people and vehicles."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.scenario.process_model import ProcessModel, Tails
from scp_planner.tracking.confidence import HotellingErrors, NormalErrors, StudentErrors, uniform_scale
from scp_planner.tracking.kalman import estimate_process
from scp_planner.tracking.motion_fitting import FIT, fit_motion_model, prediction_errors, stretches_of
from scp_planner.tracking.tracks import Tracks

KINDS = ("random_walk", "mean_reverting")

_POLYNOMIALS = {"linear": 1, "quadratic": 2}
_NORMAL_TAILS = Tails(degrees_of_freedom=1.0, lead_time=(1.0,), inflation=(1.0,))  # whose degrees are not looked at


@dataclass(frozen=True)
class RecordedParameters:
    window: int = 8
    both: int = 2  # Folds
    span_steps: int = 12  # Lead times at which "at all times" is judged
    least_determinant: float = 1e-24  # m^4, of a noise covariance: below it people stand as still as numbers can


RECORDED = RecordedParameters()


@dataclass(frozen=True)
class RecordedCoverage:
    """One measured coverage of recorded positions."""

    data: str
    model: str
    level: str  # "per_time", or "per_obstacle": at all lead times up to this one
    fold: int
    lead_time: float
    nominal: float
    coverage: float
    error: float  # Standard error of the coverage, from the spread between tracks
    radius: float
    predictions: int
    tracks: int


def measure_recorded_coverage(
    tracks: Tracks,
    *,
    data: str = "",
    kinds: Sequence[str] = KINDS,
    window: int = RECORDED.window,
    lead_times: Sequence[float] = FIT.lead_times,
    probability: float = 0.95,
) -> list[RecordedCoverage]:
    """Fit motion models to half of the tracks and test them on the other half, both ways."""
    halves = tracks.halves()
    samples: list[_Sample] = []
    for fold, tested in enumerate(halves):
        fitted = halves[1 - fold]
        for kind in kinds:
            model = fit_motion_model(fitted, kind, window=window, lead_times=lead_times)
            samples += _of_model(fold, kind, model, tested, window, lead_times, probability)
        shares = {
            s.lead_time: float(s.inside.mean())
            for s in samples
            if (s.fold, s.model, s.level) == (fold, kinds[0], "per_time")
        }
        for name, order in _POLYNOMIALS.items():
            samples += _of_polynomial(fold, name, order, tested, window, shares, probability)
    cases = dict.fromkeys((s.model, s.level, s.lead_time) for s in samples)
    results = []
    for case in cases:
        own = [s for s in samples if (s.model, s.level, s.lead_time) == case]
        results += [_measured(data, probability, s.fold, [s]) for s in own]
        results.append(_measured(data, probability, RECORDED.both, own))
    return results


def measure_model(
    tracks: Tracks,
    model: ProcessModel,
    *,
    data: str = "",
    name: str = "",
    lead_times: Sequence[float] = (1.0, 2.0, 4.0),
    probability: float = 0.95,
) -> list[RecordedCoverage]:
    """Test a model that has been fitted on the half of the tracks that `Tracks.halves` keeps for it."""
    window = model.fitted_to.window if model.fitted_to is not None and model.fitted_to.window else RECORDED.window
    samples = _of_model(1, name, model, tracks.halves()[1], window, lead_times, probability)
    return [_measured(data, probability, 1, [sample]) for sample in samples]


@dataclass(frozen=True)
class _Sample:
    """Predictions of one fold inside their regions, and sizes of these."""

    fold: int
    model: str
    level: str
    lead_time: float
    inside: Array  # (m,) 0 or 1
    areas: Array  # (m,) m^2 / pi
    tracks: Index  # (m,)


def _of_model(
    fold: int,
    kind: str,
    model: ProcessModel,
    tested: Tracks,
    window: int,
    lead_times: Sequence[float],
    probability: float,
) -> Iterator[_Sample]:
    tails = model.tails or _NORMAL_TAILS
    law = NormalErrors() if model.tails is None else StudentErrors(tails.degrees_of_freedom)
    scale = law.pointwise_scale(1.0 - probability)
    for errors in prediction_errors(tested, model, window=window, lead_times=lead_times):
        if not len(errors.squares):
            continue
        limit = scale * np.interp(errors.lead_time, tails.lead_time, tails.inflation)
        yield _Sample(
            fold,
            kind,
            "per_time",
            errors.lead_time,
            (errors.squares <= limit).astype(float),
            limit * errors.deviations**2,
            errors.tracks,
        )
    # at all times up to the last lead time at once
    leads = np.linspace(lead_times[-1] / RECORDED.span_steps, lead_times[-1], RECORDED.span_steps)
    some = next(track for track in tested if len(track) >= window)
    pattern = estimate_process(some.times[:window], some.positions[:window], model)
    length = pattern.standardised_length(pattern.reference_time, pattern.reference_time + float(leads[-1]))
    scale = uniform_scale(1.0 - probability, length, law)
    each = prediction_errors(tested, model, window=window, lead_times=leads.tolist())
    whole = each[-1]
    if not len(whole.squares):
        return
    inside = np.ones(len(whole.squares))
    for errors in each:
        limit = scale * np.interp(errors.lead_time, tails.lead_time, tails.inflation)
        outside = errors.stretches[errors.squares > limit]
        inside[np.isin(whole.stretches, outside)] = 0.0
    yield _Sample(fold, kind, "per_obstacle", whole.lead_time, inside, limit * whole.deviations**2, whole.tracks)


def _of_polynomial(
    fold: int, name: str, order: int, tested: Tracks, window: int, shares: Mapping[float, float], probability: float
) -> Iterator[_Sample]:
    """Predict by polynomials: with regions that believe them, and with discs that cover given shares."""
    stretches, targets = stretches_of(tested, window, list(shares))
    ends, powers = stretches.times[:, -1:], np.arange(order + 1)
    rows = (stretches.times - ends)[..., None] ** powers
    solve = np.linalg.pinv(rows)
    coefficients = solve @ stretches.positions
    residuals = stretches.positions - rows @ coefficients
    degrees = window - order - 1
    noise = np.swapaxes(residuals, 1, 2) @ residuals / degrees
    spread = solve @ np.swapaxes(solve, 1, 2)
    scale = HotellingErrors(degrees).pointwise_scale(1.0 - probability)
    for (lead_time, share), target in zip(shares.items(), targets, strict=True):
        which = target.stretches
        at = (target.times - ends[which, 0])[:, None] ** powers
        offsets = target.positions - np.einsum("mj,mja->ma", at, coefficients[which])
        owners = stretches.tracks[which]
        reach = float(np.quantile(np.linalg.norm(offsets, axis=1), share))
        inside = np.linalg.norm(offsets, axis=1) <= reach
        yield _Sample(
            fold,
            f"{name}, inflated",
            "per_time",
            lead_time,
            inside.astype(float),
            np.full(len(which), reach**2),
            owners,
        )
        determinant = np.linalg.det(noise[which])
        sure = determinant > RECORDED.least_determinant
        growth = np.einsum("mj,mjk,mk->m", at, spread[which], at)[sure]
        squares = np.einsum(
            "ma,ma->m", offsets[sure], np.linalg.solve(noise[which][sure], offsets[sure][..., None])[..., 0]
        )
        yield _Sample(
            fold,
            name,
            "per_time",
            lead_time,
            (squares <= scale * growth).astype(float),
            scale * growth * np.sqrt(determinant[sure]),
            owners[sure],
        )


def _measured(data: str, probability: float, fold: int, samples: Sequence[_Sample]) -> RecordedCoverage:
    inside = np.concatenate([s.inside for s in samples])
    areas = np.concatenate([s.areas for s in samples])
    owners = np.concatenate([s.tracks + 1j * s.fold for s in samples])  # halves number their tracks alike
    coverage = float(inside.mean())
    _, owner = np.unique(owners, return_inverse=True)
    of_track = np.bincount(owner, inside - coverage)
    return RecordedCoverage(
        data=data,
        model=samples[0].model,
        level=samples[0].level,
        fold=fold,
        lead_time=samples[0].lead_time,
        nominal=probability,
        coverage=coverage,
        error=float(np.sqrt(np.sum(of_track**2))) / len(inside),
        radius=math.sqrt(float(areas.mean())),
        predictions=len(inside),
        tracks=len(of_track),
    )


def summary(results: Sequence[RecordedCoverage]) -> str:
    """Tabulate coverage in % with its standard error, and radius in m, for each lead time; of both halves if tested."""
    leads = sorted({r.lead_time for r in results if r.level == "per_time"})
    wide = max([8, *(len(r.data) + 2 for r in results)])
    lines = [f"{'data':<{wide}}{'model':<22}{'level':<14}" + "".join(f"{f'{lead:g} s':^24}" for lead in leads)]
    for data, model, level in dict.fromkeys((r.data, r.model, r.level) for r in results):
        cells = []
        for lead in leads:
            own = {r.fold: r for r in results if (r.data, r.model, r.level, r.lead_time) == (data, model, level, lead)}
            both = own.get(RECORDED.both, own.get(1))
            cells.append(
                "" if both is None else f"{100 * both.coverage:.1f} +- {100 * both.error:.1f} %, {both.radius:.2f} m"
            )
        lines.append(f"{data:<{wide}}{model:<22}{level:<14}" + "".join(f"{cell:^24}" for cell in cells))
    return "\n".join(lines)
