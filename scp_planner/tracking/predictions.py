"""Predicted observations of obstacles: polynomials of the time since a moment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.polynomials import horner
from scp_planner.tracking.confidence import ErrorLaw
from scp_planner.tracking.conformal import square_within
from scp_planner.tracking.motion_estimate import POLYNOMIAL_TERMS

KEPT = 64
"""Predictions of a track that are kept, to see what comes of them."""
_Polynomials = tuple[float, Array, Array]  # From a time on, s: of the center (P, 2) and its covariance (Q, 3)


class PredictionKind(IntEnum):
    """Errors of predictions of one kind are compared with each other."""

    BELIEVED = 0
    NOTICED = 1
    ALONE = 2


@dataclass(frozen=True)
class Later:
    """A prediction for times that are not near."""

    breaks: Array  # (S + 1,) s
    centers: Array  # (S, P, 2) m
    covariances: Array  # (S, Q, 3) m^2

    def at(self, time: float) -> _Polynomials:
        piece = int(np.clip(np.searchsorted(self.breaks, time, "right") - 1, 0, len(self.breaks) - 2))
        return float(self.breaks[piece]), self.centers[piece], self.covariances[piece]


@dataclass(frozen=True)
class Prediction:
    """An estimate as one polynomial each of time since an origin, to gate observations with."""

    origin: float  # s
    center: Array  # (P, 2)
    covariance: Array  # (Q, 3) Not scaled
    errors: ErrorLaw
    kind: int
    later: Later | None = None

    @property
    def near(self) -> _Polynomials:
        return self.origin, self.center, self.covariance

    def exceedance(self, time: float, position: tuple[float, float], noise: Array) -> float:
        """Probability to see something as far away as a position, or farther, at a time, with noise (2, 2), m^2."""
        (square,) = misfits([self], np.array([time]), np.array([position]), noise[None])
        return self.errors.exceedance(float(square))


def misfits(told: Sequence[Prediction | None], times: Array, positions: Array, noise: Array) -> Array:
    """Squared standardised errors (n,) of what is seen with noise (n, 2, 2), m^2; 0 where nothing was predicted."""
    which = [k for k, one in enumerate(told) if one is not None]
    squares = np.zeros(len(told))
    if which:
        centers, covariances = _values([one.near for one in told if one is not None], times[which])
        covariances = covariances + noise[which][:, [0, 0, 1], [0, 1, 1]]
        # far from its origin, as for what comes very late, the polynomial is no covariance
        xx, xy, yy = covariances.T
        sound = (xx * yy > xy * xy) & (xx > 0.0)
        offsets = positions[which] - centers
        squares[np.array(which)[sound]] = square_within(offsets[sound], covariances[sound])
    return squares


def predicted(told: Sequence[Prediction], times: Array) -> tuple[Array, Array]:
    """Centers (n, 2), m, and covariances (n, 3), m^2, at times (n,)."""
    values = _values([one.near for one in told], times)
    far = [(k, one.later) for k, one in enumerate(told) if one.later is not None]
    if far:
        which = [k for k, _ in far]
        pieces = [later.at(float(times[k])) for k, later in far]
        for value, found in zip(values, _values(pieces, times[which]), strict=True):
            value[which] = found
    return values


def _values(polynomials: Sequence[_Polynomials], times: Array) -> tuple[Array, Array]:
    lag = times - np.array([begin for begin, _, _ in polynomials])
    centers, covariances = [one[1] for one in polynomials], [one[2] for one in polynomials]
    # random walks have one more term of the covariance
    return _at(_stacked(centers, POLYNOMIAL_TERMS), lag).T, _at(_stacked(covariances, POLYNOMIAL_TERMS + 1), lag).T


def _stacked(parts: Sequence[Array], terms: int) -> Array:
    """Coefficients of as many powers each, (terms, sides, n)."""
    stacked = np.zeros((max(terms, *(len(part) for part in parts)), parts[0].shape[1], len(parts)))
    for k, part in enumerate(parts):
        stacked[: len(part), :, k] = part
    return stacked


def _at(coefficients: Array, lag: Array) -> Array:
    """Values of polynomials (terms, sides, n) at times (n,), (sides, n)."""
    terms = len(coefficients)
    if len(lag) and (lag == lag[0]).all():  # as in a frame: one product of matrices then does it
        powers = lag[0] ** np.arange(terms)
        return np.asarray((powers @ coefficients.reshape(terms, -1)).reshape(coefficients.shape[1:]))
    return horner(coefficients, lag)
