"""Regions that keep their level without a model being right: conformal prediction, from errors actually made."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index
from scp_planner.errors import EstimationError


@dataclass(frozen=True)
class ConformalSettings:
    """Change and size of regions that follow the errors made."""

    # Change of the level after a miss, but for the factor 1 - alpha. Misses come in rows, as one wrong prediction is
    # followed by others; what is faster takes a row for a trend
    rate: float = 0.005
    # Misses at the level asked for, that there must have been room for before regions follow the errors
    enough: float = 10.0
    # The rate of all tracks together, over that of each: their errors are many, and depend on each other
    together: float = 0.01
    # Share of alpha by which the level of one track may be below that of all before it counts: levels of tracks that
    # are like all others go up and down by so much
    slack: float = 0.2
    # Share of a level within which a region is right as it is: quantiles of so few errors are not known better
    band: float = 0.1
    newest: int = 5_000  # Errors of all tracks that quantiles are of, for each horizon
    stale: float = 0.05  # Share of them that may be new before they are sorted anew
    # The least size of a region: what noise that is declared too large explains tells nothing of where things are
    least: float = 0.1
    # Share of its size in variance by which a region that is right is not worth to be changed: zones of one size take
    # less time to look at, and where misses go on the size soon leaves this share
    close: float = 0.01
    beyond: float = 2.0  # Multiple of the largest squared error that is the quantile for a level below nothing


CONFORMAL = ConformalSettings()


def conformal_quantile(scores: ArrayLike, alpha: float, groups: int | None = None) -> float:
    """Give the score that the next one exceeds with a probability of at most alpha."""
    if not 0.0 < alpha < 1.0:
        raise EstimationError(f"alpha: {alpha!r} is not between 0 and 1")
    ordered = np.sort(np.asarray(scores, dtype=float))
    if np.isnan(ordered).any():
        raise EstimationError("scores: one of them is not a number")
    count = len(ordered)
    independent = count if groups is None else groups
    if not independent:
        return math.inf
    place = math.ceil((1.0 - alpha) * count * (1.0 + 1.0 / independent) - 1e-9 * count)
    return float(ordered[max(place, 1) - 1]) if place <= count else math.inf


def factor_to_hold(offset: ArrayLike, covariance: ArrayLike, noise: ArrayLike, border: float) -> Array:
    """Give the least s >= 0 with z' (s C + R)^-1 z <= border: what regions of C need to hold z, seen with noise R."""
    # Where C and R are both diagonal, with a ratio l each, and w of the length of z against R alone, the border is at
    # w1^2 (s l2 + 1) + w2^2 (s l1 + 1) = border (s l1 + 1) (s l2 + 1). The sums over both are invariants of the two.
    (x, y), (cxx, cxy, cyy), (rxx, rxy, ryy) = np.transpose(offset), np.transpose(covariance), np.transpose(noise)
    unit = rxx * ryy - rxy * rxy
    product = (cxx * cyy - cxy * cxy) / unit
    total = (ryy * cxx - 2.0 * rxy * cxy + rxx * cyy) / unit
    length = (ryy * x * x - 2.0 * rxy * x * y + rxx * y * y) / unit
    across = (cyy * x * x - 2.0 * cxy * x * y + cxx * y * y) / unit
    linear, rest = border * total - across, border - length
    root = np.sqrt(np.maximum(linear * linear - 4.0 * border * product * rest, 0.0))
    # the larger root, and neither of two numbers that are nearly the same is taken from the other
    larger = np.where(linear > 0.0, -2.0 * rest / np.where(linear > 0.0, linear + root, 1.0), 0.0)
    other = (root - linear) / np.maximum(2.0 * border * product, np.finfo(float).tiny)
    return np.asarray(np.maximum(np.where(linear > 0.0, larger, other), 0.0))


def region_score(offset: ArrayLike, covariance: ArrayLike, noise: ArrayLike, border: float) -> Array:
    """Give what quantiles are of that regions of a covariance are sized by: above 1 outside, below 1 inside."""
    both = np.add(covariance, noise)
    inside = square_within(offset, both) <= border
    scores = np.empty(len(inside))
    z, whole, seen = (np.asarray(each, dtype=float) for each in (offset, covariance, noise))
    # of what is inside by rounding only, sizes may come out above 1
    scores[inside] = np.minimum(factor_to_hold(z[inside], whole[inside], seen[inside], border), 1.0)
    out = ~inside
    unit = np.broadcast_to([1.0, 0.0, 1.0], (int(out.sum()), 3))
    scores[out] = 1.0 + factor_to_hold(z[out], unit, both[out], border)
    return scores


def square_within(offset: ArrayLike, covariance: ArrayLike) -> Array:
    """Give z' C^-1 z of offsets (n, 2) and covariances (n, 3), elements xx, xy, yy."""
    (x, y), (xx, xy, yy) = np.transpose(offset), np.transpose(covariance)
    return np.asarray((yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy))


class AdaptiveScales:
    """Scales of regions by track and horizon, which follow the misses of each."""

    def __init__(self, alpha: float, horizons: int, kinds: int = 1, rate: float = CONFORMAL.rate) -> None:
        if not 0.0 < alpha < 1.0:
            raise EstimationError(f"alpha: {alpha!r} is not between 0 and 1")
        if not 0.0 < rate < math.inf:
            raise EstimationError(f"rate: {rate!r} is not a positive number")
        self.alpha, self.rate, self.horizons, self.kinds = alpha, rate, horizons, kinds
        self._errors = [[_Newest() for _ in range(horizons)] for _ in range(kinds + (kinds > 1))]  # the last: of all
        self._enough = math.ceil(CONFORMAL.enough / alpha)
        self._every = np.full((kinds, horizons), alpha)
        self._own: dict[str, Array] = {}
        self.seen = np.zeros(horizons, dtype=np.intp)
        """Errors of each horizon so far, (H,)."""
        self.missed = np.zeros(horizons, dtype=np.intp)
        """Errors of each horizon so far that were outside, (H,)."""

    def scales(self, names: Sequence[str], kinds: Index | int = 0) -> Array:
        """Give the sizes of tracks' regions."""
        every, kind = range(self.horizons), np.broadcast_to(kinds, len(names))
        sizes = np.ones((len(names), self.horizons))
        which = sorted(set(kind.tolist()))
        if any(self._known(k, horizon) is not None for k in which for horizon in every):
            own = self._levels(names)
            for k in which:
                some = kind == k
                sizes[some] = self._sizes(own[some, k], k, every)
        return sizes

    def _levels(self, names: Sequence[str]) -> Array:
        """Levels of tracks by kind and horizon, (n, kinds, H): a new one begins with what others have taught."""
        return np.array([self._own.setdefault(name, self._every.copy()) for name in names])

    def _known(self, kind: int, horizon: int) -> _Newest | None:
        """The errors that quantiles of a kind are of; None if there are too few."""
        own, every = self._errors[kind][horizon], self._errors[-1][horizon]
        if own.count >= self._enough:
            return own
        return every if every.count >= self._enough else None

    def _sizes(self, own: Array, kind: int, horizons: range) -> Array:
        """Sizes of n tracks with levels (n, H) over some horizons, (n, h)."""
        level = np.minimum(self._every[kind], own + CONFORMAL.slack * self.alpha)
        level = level[:, horizons.start : horizons.stop]
        bands = np.array([1.0 + CONFORMAL.band, 1.0 - CONFORMAL.band])
        levels = level * bands[:, None, None]
        known = [self._known(kind, horizon) for horizon in horizons]
        least, most = _quantiles(known, levels.reshape(-1, len(horizons))).reshape(levels.shape)
        found = np.minimum(np.maximum(least, 1.0), most)
        close = np.abs(found - 1.0) <= CONFORMAL.close
        np.maximum(found, CONFORMAL.least, out=found)
        found[close] = 1.0
        return np.asarray(found)

    def take_in(self, horizon: int, names: Sequence[str], scores: ArrayLike, kinds: Index | int = 0) -> None:
        """Learn from errors of tracks over a horizon."""
        found, kind = np.asarray(scores, dtype=float), np.broadcast_to(kinds, len(names))
        levels = self._levels(names)
        for k in sorted(set(kind.tolist())):
            some = kind == k
            own, score = levels[some, k], found[some]
            missed = score > self._sizes(own, k, range(horizon, horizon + 1))[:, 0]
            errors, every = self._known(k, horizon), self._every[k, horizon]
            of_all = score > _quantiles([errors], np.array([[every]]))[0]
            moved = own[:, horizon] + self.rate * (self.alpha - missed)
            every += CONFORMAL.together * self.rate * float((self.alpha - of_all).sum())
            self._every[k, horizon] = every = min(max(every, 0.0), 1.0)
            for number, level in zip(np.flatnonzero(some).tolist(), np.minimum(moved, every), strict=True):
                self._own[names[number]][k, horizon] = level
            self.missed[horizon] += int(missed.sum())
            self._errors[k][horizon].add(score)
        if self.kinds > 1:
            self._errors[-1][horizon].add(found)
        self.seen[horizon] += len(found)

    def forget(self, name: str) -> None:
        self._own.pop(name, None)


class _Newest:
    """The newest errors of all tracks over a horizon."""

    def __init__(self) -> None:
        self._errors = np.zeros(0)
        self._sorted = np.zeros(0)
        self._fresh = 0

    @property
    def count(self) -> int:
        return len(self._errors)

    def add(self, errors: Array) -> None:
        self._errors = np.concatenate([self._errors, errors])[-CONFORMAL.newest :]
        self._fresh += len(errors)

    @property
    def ranked(self) -> Array:
        """They in order, but for a few of the newest."""
        if not len(self._sorted) or self._fresh > CONFORMAL.stale * self.count:
            self._sorted, self._fresh = np.sort(self._errors), 0
        return self._sorted


def _quantiles(errors: Sequence[_Newest | None], alpha: Array) -> Array:
    """Quantiles of the next error at probabilities 1 - alpha (n, h): (n, h); 1 where unknown."""
    known = [None if each is None else each.ranked for each in errors]
    counts = np.array([0 if each is None else len(each) for each in known])
    place = np.ceil((1.0 - alpha) * (counts + 1) - 1e-9 * counts)
    outside = place > counts
    rank = np.minimum(np.maximum(place, 1.0), counts).astype(np.intp)
    rank -= 1
    found = np.ones(rank.shape)
    for column, each in enumerate(known):
        if each is not None:
            found[:, column] = each[rank[:, column]]
            found[outside[:, column], column] = _beyond(float(each[-1]))
    return found


def _beyond(largest: float) -> float:
    """Size beyond the largest error, as a :func:`region_score`: its part above 1 is a variance that is added."""
    return 1.0 + CONFORMAL.beyond * (largest - 1.0) if largest > 1.0 else min(CONFORMAL.beyond * largest, 1.0)
