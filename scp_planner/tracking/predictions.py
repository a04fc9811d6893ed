"""Predicted observations of obstacles: polynomials of the time since a moment."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.tracking.confidence import ErrorLaw
from scp_planner.tracking.conformal import square_within
from scp_planner.tracking.motion_estimate import POLYNOMIAL_TERMS

KEPT = 64
"""Predictions of a track that are kept, to see what comes of them."""
UNJUDGED = -1
"""Kind of predictions of which nobody asks what comes of them."""
_CENTER_TERMS, _COVARIANCE_TERMS = POLYNOMIAL_TERMS, POLYNOMIAL_TERMS + 1  # random walks have one more


@dataclass(frozen=True)
class Later:
    centers: PiecewisePolynomials
    covariances: PiecewisePolynomials


@dataclass(frozen=True)
class Prediction:
    """An estimate as one polynomial each of time since an origin, to gate observations with."""

    origin: float  # s
    center: Array  # (P, 2)
    covariance: Array  # (P, 3) Not scaled
    errors: ErrorLaw
    later: Later | None = None  # For predictions of times far ahead

    def exceedance(self, time: float, position: tuple[float, float], noise: Array) -> float:
        """Probability to see something as far away as a position, or farther, at a time, with noise (2, 2), m^2."""
        powers = (time - self.origin) ** np.arange(max(len(self.center), len(self.covariance)))
        offset = np.asarray(position) - powers[: len(self.center)] @ self.center
        covariance = powers[: len(self.covariance)] @ self.covariance + noise[[0, 0, 1], [0, 1, 1]]
        xx, xy, yy = covariance
        if xx * yy <= xy * xy or xx <= 0.0:
            return 1.0  # far from its origin, as for what comes very late, the polynomial is no covariance
        return self.errors.exceedance(float(square_within(offset[None], covariance[None])[0]))


@dataclass(frozen=True)
class Pieces:
    """Predictions of n obstacles for times that are not near, of absolute time."""

    slots: Index
    breaks: Array  # (S + 1,) s
    centers: Array  # (n, S, P, 2) m
    covariances: Array  # (n, S, Q, 3) m^2

    def at(self, which: Index, times: Array) -> tuple[Array, Array]:
        """Centers (2, n) m and covariances (3, n) m^2 of some of them at times (n,)."""
        piece = np.clip(np.searchsorted(self.breaks, times, "right") - 1, 0, len(self.breaks) - 2)
        lag = times - self.breaks[piece]
        center, covariance = (
            _at(part[which, piece].transpose(1, 2, 0), lag) for part in (self.centers, self.covariances)
        )
        return center, covariance


@dataclass(frozen=True)
class _Frame:
    """Predictions that were made together."""

    start: float  # s
    kinds: Index  # (K,)
    origin: Array  # (K,) s
    center: Array  # (P, 2, K)
    covariance: Array  # (Q, 3, K)
    later: tuple[Pieces, ...]

    def of(self, slots: Index) -> Index:
        """Kinds of predictions of some obstacles, (n,)."""
        room = len(self.kinds)
        return np.where(slots < room, self.kinds[np.minimum(slots, room - 1)], UNJUDGED)

    def at(self, slots: Index, times: Array) -> tuple[Array, Array]:
        lag = times - self.origin[slots]
        center, covariance = _at(self.center[..., slots], lag), _at(self.covariance[..., slots], lag)
        for pieces in self.later:
            where = np.full(len(self.kinds), -1)
            where[pieces.slots] = np.arange(len(pieces.slots))
            which = where[slots]
            some = np.flatnonzero(which >= 0)
            if len(some):
                center[:, some], covariance[:, some] = pieces.at(which[some], times[some])
        return center.T, covariance.T


@dataclass(frozen=True)
class Compared:
    which: Index
    kinds: Index
    offset: Array  # (n, 2) m
    covariance: Array  # (n, 3) m^2


class Predictions:
    """Predictions of K obstacles, each in a slot of its own."""

    def __init__(self) -> None:
        self.known = np.zeros(0, dtype=bool)
        self.kinds = np.zeros(0, dtype=np.intp)
        self._origin = np.zeros(0)
        self._center = np.zeros((_CENTER_TERMS, 2, 0))
        self._covariance = np.zeros((_COVARIANCE_TERMS, 3, 0))
        self._later: list[Pieces] = []
        self._kept: deque[_Frame] = deque(maxlen=KEPT)

    def clear(self, slot: int) -> None:
        """Forget all that was predicted of the obstacle in a slot."""
        self.known[slot], self.kinds[slot] = False, UNJUDGED
        for frame in self._kept:
            if slot < len(frame.kinds):
                frame.kinds[slot] = UNJUDGED

    def put(self, slots: Index, origin: float, center: Array, covariance: Array) -> None:
        """Take in predictions, which are not compared unless they are of a kind."""
        self.known[slots], self._origin[slots], self.kinds[slots] = True, origin, UNJUDGED
        for held, given in ((self._center, center), (self._covariance, covariance)):
            held[..., slots] = 0.0
            held[: given.shape[1], :, slots] = given.transpose(1, 2, 0)

    def put_later(self, pieces: Pieces) -> None:
        """Take in predictions of times that are not near."""
        self._later.append(pieces)

    def keep(self, start: float) -> None:
        """Keep what is predicted now, at a time, s, to see what comes of it."""
        while self._kept and self._kept[-1].start >= start:
            self._kept.pop()
        center, covariance = self._center.copy(), self._covariance.copy()
        told = _Frame(start, self.kinds.copy(), self._origin.copy(), center, covariance, tuple(self._later))
        self._kept.append(told)
        self._later.clear()
        self.kinds[:] = UNJUDGED

    def compared(self, slots: Index, times: Array, positions: Array, lead: float, late: float) -> list[Compared]:
        """Compare what is seen with the newest predictions that are older than a lead, but not by too much."""
        starts = np.array([frame.start for frame in self._kept])
        frames = np.searchsorted(starts, times - lead, "right") - 1
        found = []
        for number in sorted(set(frames.tolist()) - {-1}):
            frame = self._kept[number]
            kinds = frame.of(slots)
            which = np.flatnonzero((frames == number) & (kinds != UNJUDGED) & (times - frame.start <= lead + late))
            if len(which):
                center, covariance = frame.at(slots[which], times[which])
                found.append(Compared(which, kinds[which], positions[which] - center, covariance))
        return found

    def squares(self, slots: Index, times: Array, positions: Array, noise: Array) -> Array:
        """Squared standardised errors of what is seen, (n,)."""
        lag = times - self._origin[slots]
        offset = positions.T - _at(self._center[..., slots], lag)
        xx, xy, yy = covariance = _at(self._covariance[..., slots], lag) + noise[:, [0, 0, 1], [0, 1, 1]].T
        sound = self.known[slots] & (xx * yy > xy * xy) & (xx > 0.0)
        squares = np.zeros(len(slots))
        squares[sound] = square_within(offset[:, sound].T, covariance[:, sound].T)
        return squares


def lengthen(holder: object, size: int) -> None:
    """Make room for so many in all along the last axis of the arrays that something holds, with zeros."""
    for name, array in vars(holder).items():
        if isinstance(array, np.ndarray):
            longer = np.zeros((*array.shape[:-1], size), dtype=array.dtype)
            longer[..., : array.shape[-1]] = array
            setattr(holder, name, longer)


def _at(coefficients: Array, lag: Array) -> Array:
    """Values of polynomials (terms, sides, n) at times (n,), (sides, n)."""
    terms = len(coefficients)
    if len(lag) and (lag == lag[0]).all():  # as in a frame: one product of matrices then does it
        powers = lag[0] ** np.arange(terms)
        return np.asarray((powers @ coefficients.reshape(terms, -1)).reshape(coefficients.shape[1:]))
    values = coefficients[-1].copy()
    for part in coefficients[-2::-1]:
        values *= lag
        values += part
    return values
