"""Observations of one obstacle, checked before anything is believed of them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index, Mask
from scp_planner.errors import EstimationError
from scp_planner.scenario.tolerances import DEFINITE, SYMMETRY
from scp_planner.settings.knobs import word_of


class Faulty(StrEnum):
    """Treatment of a row that is not a number, or that is there twice."""

    REFUSE = "refuse"
    DROP = "drop"


@dataclass(frozen=True)
class Screening:
    """Possible faults of observations, and their treatment."""

    missing: Faulty = Faulty.REFUSE  # Rows with a NaN or an infinity, as a sensor writes for a dropout
    repeated: Faulty = Faulty.REFUSE  # Rows equal to an earlier one in time and position

    def __post_init__(self) -> None:
        object.__setattr__(self, "missing", word_of(Faulty, self.missing, "missing"))
        object.__setattr__(self, "repeated", word_of(Faulty, self.repeated, "repeated"))


@dataclass(frozen=True)
class CheckedObservations:
    """Finite observations in order of time."""

    times: Array
    positions: Array
    covariance: Array | None
    rows: Index  # Place of each in the input
    rejected: tuple[int, ...]  # Places in the input of what was left out


def check_observations(
    times: ArrayLike, positions: ArrayLike, covariance: ArrayLike | None, screening: Screening
) -> CheckedObservations:
    """Check and sort observations."""
    t, z = _numbers(times, "time"), _numbers(positions, "position")
    if t.ndim != 1 or z.shape != (len(t), 2):
        raise EstimationError(f"observations: time has shape {t.shape}, position {z.shape}; must be (n,) and (n, 2)")
    sigma = None if covariance is None else check_covariance(covariance, len(t))
    order = np.argsort(t, kind="stable")  # NaN last
    kept = order[_present(t, z, screening)[order]]
    kept = kept[_first_of_its_kind(t[kept], z[kept], kept, screening)]
    rejected = () if len(kept) == len(t) else tuple(np.setdiff1d(np.arange(len(t)), kept).tolist())
    if sigma is not None and sigma.ndim == 3:
        sigma = sigma[kept]
    return CheckedObservations(t[kept], z[kept], sigma, kept, rejected)


def check_covariance(covariance: ArrayLike, count: int) -> Array:
    """Check a noise covariance: (2, 2), or (count, 2, 2), m^2."""
    sigma = _numbers(covariance, "covariance")
    if sigma.shape not in ((2, 2), (count, 2, 2)):
        raise EstimationError(f"observations.covariance: its shape is {sigma.shape}; must be (2, 2) or ({count}, 2, 2)")
    xx, xy, yx, yy = (sigma[..., a, b] for a in range(2) for b in range(2))
    size = np.sqrt(np.maximum(xx, 0.0)) * np.sqrt(np.maximum(yy, 0.0))
    with np.errstate(invalid="ignore", over="ignore"):
        faults = (
            ("finite", ~np.isfinite(sigma).all(axis=(-2, -1))),
            ("symmetric", np.abs(xy - yx) > SYMMETRY * size),
            ("positive definite", ~((size > 0.0) & (xy**2 < (1.0 - DEFINITE) * size**2))),
        )
    for what, bad in faults:
        if np.any(bad):
            i = int(np.argmax(bad))
            place, matrix = ("", sigma) if sigma.ndim == 2 else (f"[{i}]", sigma[i])
            raise EstimationError(f"observations.covariance{place}: {matrix.tolist()} is not {what}")
    return 0.5 * (sigma + np.swapaxes(sigma, -1, -2))


def usable(
    times: Array,
    positions: Array,
    seen: ArrayLike | None,
    last_times: Array,
    last_positions: Array,
    *,
    in_order: bool = False,
) -> Mask:
    """Tell which new observations of K obstacles, at most one of each, can be used."""
    finite = np.isfinite(times) & np.isfinite(positions).all(axis=1)
    wanted = np.ones(len(times), dtype=bool) if seen is None else np.asarray(seen, dtype=bool)
    used: Mask = wanted & finite
    if not np.array_equal(used, wanted):
        k = int(np.argmax(wanted & ~finite))
        raise EstimationError(
            f"obstacle {k}: time {float(times[k])!r} or position {positions[k].tolist()} is not finite"
        )
    again = used & (times == last_times)
    if again.any():
        again &= (positions == last_positions).all(axis=1)
        if again.any():
            k = int(np.argmax(again))
            raise EstimationError(f"obstacle {k}: the observation at time {float(times[k])!r} comes twice")
    if in_order:
        late = used & (times < last_times)
        if late.any():
            k = int(np.argmax(late))
            raise EstimationError(
                f"obstacle {k}: time {float(times[k])!r} is before {float(last_times[k])!r}, the last one;"
                " observations must come in order"
            )
    return used


def _numbers(values: ArrayLike, name: str) -> Array:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise EstimationError(f"observations.{name}: it is not an array of numbers ({error})") from None


def _present(t: Array, z: Array, screening: Screening) -> Mask:
    there = np.isfinite(t) & np.isfinite(z).all(axis=1)
    if screening.missing is Faulty.REFUSE and not there.all():
        i = int(np.argmin(there))
        name, value = ("position", z[i].tolist()) if np.isfinite(t[i]) else ("time", float(t[i]))
        raise EstimationError(f"observations.{name}[{i}]: {value} is not finite")
    return there


def _first_of_its_kind(t: Array, z: Array, rows: Index, screening: Screening) -> Mask:
    first = np.ones(len(t), dtype=bool)
    again = np.flatnonzero(t[1:] == t[:-1]) + 1
    for i, begin in zip(again, np.searchsorted(t, t[again]), strict=True):
        group = begin + np.flatnonzero(first[begin:i])
        same = group[(z[group] == z[i]).all(axis=1)]
        if len(same) and screening.repeated is Faulty.REFUSE:
            raise EstimationError(
                f"observations[{rows[i]}]: time {float(t[i])!r} with position {z[i].tolist()} is there twice,"
                f" first as observations[{rows[same[0]]}]"
            )
        first[i] = not len(same)
    return first
