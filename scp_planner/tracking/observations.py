"""Observations of one obstacle, checked before anything is believed of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.scenario.tolerances import DEFINITE, SYMMETRY


@dataclass(frozen=True)
class CheckedObservations:
    """Finite observations in order of time, none of them twice."""

    times: Array  # (n,) s
    positions: Array  # (n, 2) m
    covariance: Array | None  # (2, 2) or (n, 2, 2) m^2


def check_observations(
    times: ArrayLike, positions: ArrayLike, covariance: ArrayLike | None = None
) -> CheckedObservations:
    t, z = _numbers(times, "time"), _numbers(positions, "position")
    if t.ndim != 1 or z.shape != (len(t), 2):
        raise EstimationError(f"observations: time has shape {t.shape}, position {z.shape}; must be (n,) and (n, 2)")
    sigma = None if covariance is None else check_covariance(covariance, len(t))
    for name, values, finite in (("time", t, np.isfinite(t)), ("position", z, np.isfinite(z).all(axis=1))):
        if not finite.all():
            i = int(np.argmin(finite))
            raise EstimationError(f"observations.{name}[{i}]: {values[i].tolist()} is not finite")
    rows = np.lexsort((z[:, 1], z[:, 0], t))
    same = (t[rows[1:]] == t[rows[:-1]]) & (z[rows[1:]] == z[rows[:-1]]).all(axis=1)
    if same.any():
        first, again = rows[int(np.argmax(same)) :][:2].tolist()
        raise EstimationError(
            f"observations[{again}]: time {float(t[again])!r} with position {z[again].tolist()} is there twice,"
            f" first as observations[{first}]"
        )
    order = np.argsort(t, kind="stable")
    return CheckedObservations(t[order], z[order], sigma if sigma is None or sigma.ndim == 2 else sigma[order])


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


def _numbers(values: ArrayLike, name: str) -> Array:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise EstimationError(f"observations.{name}: it is not an array of numbers ({error})") from None
