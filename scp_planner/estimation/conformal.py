"""Regions that keep their level without a model being right: conformal prediction, from errors actually made.

Two tools, each with its guarantee, what it assumes, and its price.

**Split conformal**, beforehand (`conformal_quantile`). With errors of n predictions that nothing was fitted to, the
region that holds the ceil((n + 1) (1 - alpha))-th smallest of them holds the next error with a probability of at least
1 - alpha, and at most 1 / (n + 1) more, whatever their distribution. It assumes that the next error could have stood at
any place among them (exchangeable): other tracks from the same place, one error of each. Several errors of one track
depend on each other; then the level holds nearly, and tracks are counted instead of errors. Its price: errors that are
not used for fitting, and regions that are as large for the calm as for the restless.

**Adaptive**, on the way (`AdaptiveScales`). The region is that quantile of the newest errors whose level follows what
has come of the regions: after a miss it is raised by rate * (1 - alpha), after a hit lowered by rate * alpha. After T
steps the share of misses is within (1 + rate) / (rate T) of alpha, whatever moves and however, as long as no error is
larger than `BEYOND` times the largest that is remembered, which is what a level of 1 stands for. Its price: it is a
promise in the long run and not for any one moment, so it says nothing about the first manoeuvre of something that has
been calm so far; and what it learns of a horizon it learns that much later.

References
----------
V. Vovk, A. Gammerman, G. Shafer, *Algorithmic Learning in a Random World*, Springer (2005);
I. Gibbs, E. Candes, *Adaptive conformal inference under distribution shift*, NeurIPS 34 (2021);
A. Angelopoulos, E. Candes, R. Tibshirani, *Conformal PID control for time series prediction*, NeurIPS 36 (2023).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError

RATE = 0.02
"""Change of the level after a miss, but for the factor 1 - alpha."""
NEWEST = 100
"""Errors of a track that quantiles are of, for each horizon; of all tracks, so many times `POOLED`."""
POOLED = 5
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


class AdaptiveScales:
    """Scales of regions by track and horizon, which follow the misses of each.

    Until a track has errors enough of its own, its scales are quantiles of those of all tracks.

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
        self.enough = math.ceil(1.0 / alpha)
        self._all: list[deque[float]] = [deque(maxlen=NEWEST * POOLED) for _ in range(horizons)]
        self._own: dict[tuple[str, int], _Own] = {}
        self.seen = np.zeros(horizons, dtype=np.intp)
        """Errors of each horizon so far, (H,)."""
        self.missed = np.zeros(horizons, dtype=np.intp)
        """How many of them were outside, (H,)."""

    def scales(self, name: str) -> Array:
        """Give the factors of the variances of a track's regions, (H,)."""
        return np.array([self._scale(name, horizon) for horizon in range(self.horizons)])

    def _scale(self, name: str, horizon: int) -> float:
        own = self._own.setdefault((name, horizon), _Own(self.alpha))
        errors = own.errors if len(own.errors) >= self.enough else self._all[horizon]
        if len(errors) < self.enough:
            return 1.0
        found = conformal_quantile(list(errors), own.alpha) if 0.0 < own.alpha < 1.0 else math.inf
        if own.alpha >= 1.0:
            return min(errors)
        return found if math.isfinite(found) else BEYOND * max(errors)

    def take_in(self, horizon: int, name: str, square: float) -> None:
        """Learn from the error of a track over a horizon.

        Parameters
        ----------
        horizon : int
        name : str
            Of the track.
        square : float
            Squared error over the squared size of the region before it is scaled: 1 is on its border.
        """
        missed = square > self._scale(name, horizon)
        own = self._own[name, horizon]
        own.alpha += self.rate * (self.alpha - missed)
        own.errors.append(square)
        self._all[horizon].append(square)
        self.seen[horizon] += 1
        self.missed[horizon] += missed

    def forget(self, name: str) -> None:
        """Forget a track."""
        for horizon in range(self.horizons):
            self._own.pop((name, horizon), None)


@dataclass
class _Own:
    """The level of a track's regions over a horizon, and its newest errors."""

    alpha: float
    errors: deque[float] = field(default_factory=lambda: deque(maxlen=NEWEST))
