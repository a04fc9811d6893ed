"""Regions that keep their level without a model being right: conformal prediction, from errors actually made.

Two tools, each with its guarantee, what it assumes, and its price.

**Split conformal**, beforehand (`conformal_quantile`). With errors of n predictions that nothing was fitted to, the
region that holds the ceil((n + 1) (1 - alpha))-th smallest of them holds the next error with a probability of at least
1 - alpha, and at most 1 / (n + 1) more, whatever their distribution. It assumes that the next error could have stood at
any place among them (exchangeable): other tracks from the same place, one error of each. Several errors of one track
depend on each other; then the level holds nearly, and tracks are counted instead of errors. Its price: errors that are
not used for fitting, and regions that are as large for the calm as for the restless.

**Adaptive**, on the way (`AdaptiveScales`). The region is a quantile of the newest errors of all tracks, whose level
follows what has come of the regions. After a miss it is raised by rate * (1 - alpha), after a hit lowered by
rate * alpha: slowly for all tracks together, and faster for each track alone, whose level is never below that of all.
So a restless track has larger regions than others; a calm one has not smaller ones, which its first manoeuvre would
leave. After T steps the share of misses of a track is no more than (1 + rate) / (rate T) above alpha, whatever moves
and however, as long as no error is larger than `BEYOND` times the largest that is remembered, which is what a level of
1 stands for. Its price: it is a promise in the long run and not for any one moment, what it learns of a horizon it
learns that much later, and of those that are restless now and then fewer errors are outside than alpha.

What is seen has an error of its own, of which a region of where things *are* must not be made up for. So an error is
not compared with the region, but counts as the size that the region would have needed for the observation to be inside
together with its noise (`region_score`).

Regions that are too small do not become so many times as large, but larger by the same in every direction: what nobody
foretold, such as a change of acceleration, adds to an error, however well the motion was known. A factor that is right
for the calm would make the regions of those who are known to be restless, which are large already, fill the world.

References
----------
V. Vovk, A. Gammerman, G. Shafer, *Algorithmic Learning in a Random World*, Springer (2005);
I. Gibbs, E. Candes, *Adaptive conformal inference under distribution shift*, NeurIPS 34 (2021);
A. Angelopoulos, E. Candes, R. Tibshirani, *Conformal PID control for time series prediction*, NeurIPS 36 (2023).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError

RATE = 0.005
"""Change of the level after a miss, but for the factor 1 - alpha. Misses come in rows, as one wrong prediction is
followed by others; what is faster takes a row for a trend."""
ENOUGH = 10.0
"""Misses at the level asked for, that there must have been room for before regions follow the errors."""
TOGETHER = 0.01
"""The rate of all tracks together, over that of each: their errors are many, and depend on each other."""
NEWEST = 20_000
"""Errors of all tracks that quantiles are of, for each horizon."""
STALE = 0.02
"""Share of them that may be new before they are sorted anew."""
BEYOND = 2.0
"""Multiple of the largest squared error that is the quantile for a level of 1."""


def conformal_quantile(scores: ArrayLike, alpha: float, groups: int | None = None) -> float:
    """Give the score that the next one exceeds with a probability of at most alpha.

    Parameters
    ----------
    scores : (n,)
        Of predictions that nothing was fitted to, such as squared standardised errors.
    alpha : float
        Between 0 and 1.
    groups : int, optional
        How many independent tracks they are from; None: each is from its own.

    Returns
    -------
    float
        Infinite if they are too few for that alpha: the region has to be everything.

    Raises
    ------
    EstimationError
        If alpha is not between 0 and 1 or a score is not a number.
    """
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
    """Give the least s >= 0 with z' (s C + R)^-1 z <= border: what regions of C need to hold z, seen with noise R.

    Parameters
    ----------
    offset : (n, 2)
        z, m.
    covariance, noise : (n, 3)
        Elements xx, xy, yy of C and R, m^2.
    border : float

    Returns
    -------
    (n,)
    """
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
    """Give what quantiles are of that regions of a covariance are sized by: above 1 outside, below 1 inside.

    The region of size s is that of s C for s <= 1, and of C + (s - 1) I beyond, see the head of this module. Outside it
    is the size that holds what is seen. Inside, where that is 0 as soon as the noise alone explains what is seen, it is
    the squared error over that on the border, of region and noise together: so regions that were too large shrink, and
    those that are much smaller than the noise, of which nothing can be learnt, stay.

    Parameters
    ----------
    offset, covariance, noise, border
        As there; lengths are in the unit that I is in.

    Returns
    -------
    (n,)
    """
    both = np.add(covariance, noise)
    (x, y), (xx, xy, yy) = np.transpose(offset), np.transpose(both)
    square = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)
    unit = np.broadcast_to([1.0, 0.0, 1.0], both.shape)
    return np.where(square <= border, square / border, 1.0 + factor_to_hold(offset, unit, both, border))


def sized(covariance: ArrayLike, sizes: ArrayLike) -> Array:
    """Give the covariances (n, 3) of regions of sizes (n,), see `region_score`."""
    size = np.asarray(sizes, dtype=float)[:, None]
    return np.asarray(np.minimum(size, 1.0) * covariance + np.maximum(size - 1.0, 0.0) * [1.0, 0.0, 1.0])


class AdaptiveScales:
    """Scales of regions by track and horizon, which follow the misses of each.

    Parameters
    ----------
    alpha : float
        The share of misses that is aimed at, between 0 and 1.
    horizons : int
        H, how many horizons there are.
    rate : float
        See RATE. Larger: faster, and scales that are never at rest.

    Raises
    ------
    EstimationError
        If alpha is not between 0 and 1, or the rate is not a positive number.
    """

    def __init__(self, alpha: float, horizons: int, rate: float = RATE) -> None:
        if not 0.0 < alpha < 1.0:
            raise EstimationError(f"alpha: {alpha!r} is not between 0 and 1")
        if not 0.0 < rate < math.inf:
            raise EstimationError(f"rate: {rate!r} is not a positive number")
        self.alpha, self.rate, self.horizons = alpha, rate, horizons
        self._all = [_Newest(alpha, math.ceil(ENOUGH / alpha)) for _ in range(horizons)]
        self._own: dict[tuple[str, int], float] = {}
        self.seen = np.zeros(horizons, dtype=np.intp)
        """Errors of each horizon so far, (H,)."""
        self.missed = np.zeros(horizons, dtype=np.intp)
        """How many of them were outside, (H,)."""

    def scales(self, name: str) -> Array:
        """Give the factors of the variances of a track's regions, (H,)."""
        return np.array([self._scale(name, horizon) for horizon in range(self.horizons)])

    def _scale(self, name: str, horizon: int) -> float:
        every = self._all[horizon]
        return every.quantile(self._own.get((name, horizon), every.alpha))

    def take_in(self, horizon: int, name: str, score: float) -> None:
        """Learn from the error of a track over a horizon.

        Parameters
        ----------
        horizon : int
        name : str
            Of the track.
        score : float
            Of the region before it is scaled, as `region_score` gives it: 1 is on its border.
        """
        every, key = self._all[horizon], (name, horizon)
        missed = score > self._scale(name, horizon)
        missed_by_all = score > every.quantile(every.alpha)
        own = self._own.get(key, every.alpha) + self.rate * (self.alpha - missed)
        every.alpha = min(max(every.alpha + TOGETHER * self.rate * (self.alpha - missed_by_all), 0.0), 1.0)
        self._own[key] = min(own, every.alpha)
        every.add(score)
        self.seen[horizon] += 1
        self.missed[horizon] += missed

    def forget(self, name: str) -> None:
        """Forget a track."""
        for horizon in range(self.horizons):
            self._own.pop((name, horizon), None)


class _Newest:
    """The newest errors of all tracks over a horizon, and the level of their regions."""

    def __init__(self, alpha: float, enough: int) -> None:
        self.alpha = alpha
        self._enough = enough
        self._errors = np.zeros(0)  # a ring
        self._count = 0
        self._sorted = np.zeros(0)
        self._fresh = 0

    def add(self, error: float) -> None:
        """Add one; the oldest goes if there are too many."""
        place = self._count % NEWEST
        if place == len(self._errors):
            self._errors = np.concatenate([self._errors, np.zeros(min(max(place, 256), NEWEST - place))])
        self._errors[place] = error
        self._count += 1
        self._fresh += 1

    def quantile(self, alpha: float) -> float:
        """What the next error exceeds with a probability of alpha; 1 as long as there are too few."""
        count = min(self._count, NEWEST)
        if count < self._enough:
            return 1.0
        if not len(self._sorted) or self._fresh > STALE * count:
            self._sorted, self._fresh = np.sort(self._errors[:count]), 0
        count = len(self._sorted)
        place = math.ceil((1.0 - alpha) * (count + 1) - 1e-9 * count)
        return float(self._sorted[max(place, 1) - 1] if place <= count else BEYOND * self._sorted[-1])
