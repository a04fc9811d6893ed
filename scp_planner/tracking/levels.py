"""One level for the whole lead: tails of predictions at which past truths were, and their quantiles by track.

The score of a prediction is the least tail of its mixture at the truth over the leads in use. The region that holds the
whole tube with a level is, at each lead, where the tail is at least the quantile of scores. Conformal prediction: no
model need be right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index, grown
from scp_planner.tracking.bank import FilterBank, Snapshot


@dataclass(frozen=True)
class LevelParameters:
    horizon: float = 2.5  # Units of time; the longest lead in use
    pending: int = 8  # Predictions of a track that wait for truths
    looks: int = 6  # Times at which each is compared
    fade: float = 40.0  # Units of time in which a track's own scores fade
    others: float = 10.0  # Weight of the scores of tracks that move alike, in scores of a track's own
    first: float = 70.0  # Scores by the model's own law, among those of tracks that move alike
    tube: float = 0.6  # Scores by the model's own law are uniform up to this: the least over a tube
    most: float = 700.0  # Scores of tracks that move alike, after which older ones fade
    bins: int = 160
    widest: float = 40.0  # Largest negative logarithm of a score


LEVELS = LevelParameters()
_EDGES = np.linspace(0.0, LEVELS.widest, LEVELS.bins + 1)
_LAW = np.minimum(np.exp(-_EDGES) / LEVELS.tube, 1.0)
"""Probability of scores by the model's own law beyond each edge."""
_KINDS = 24  # of motion, by the logarithm of the diffusion that a track has shown


class TrackLevels:
    """Scores of the predictions of K tracks, each in a slot of a bank."""

    def __init__(self, bank: FilterBank, unit: float, horizon: float = LEVELS.horizon) -> None:
        self.bank, self.horizon = bank, horizon
        self._unit = unit  # m^2/s^3, that kinds of motion are counted from
        self._own = np.zeros((2, LEVELS.bins, 0))  # of whole tubes, and at single leads
        self._pool = np.zeros((2, LEVELS.bins, _KINDS))
        self._at = np.zeros((LEVELS.pending, 0))  # Times of predictions; nan: none
        self._least = np.zeros((LEVELS.pending, 0))
        self._next = np.zeros((LEVELS.pending, 0))
        self._scored = np.zeros(0)
        self._kept: Snapshot | None = None  # (..., P K)

    def grow(self, size: int) -> None:
        old = self._own.shape[-1]
        for name in ("_own", "_at", "_least", "_next", "_scored"):
            setattr(self, name, grown(getattr(self, name), size))
        self._at[:, old:] = np.nan
        empty = self.bank.snapshot(np.zeros(size * LEVELS.pending, dtype=np.intp))
        if self._kept is not None:
            where = (np.arange(LEVELS.pending)[:, None] * size + np.arange(old)).ravel()
            _put(empty, where, self._kept)
        self._kept = empty

    def begin(self, slots: Index) -> None:
        self._own[..., slots], self._at[:, slots], self._scored[slots] = 0.0, np.nan, 0.0

    def compare(self, slots: Index, times: Array, positions: Array, noise: Array) -> None:
        """Compare predictions that are due with positions (2, n), m, seen with variances (2, n), m^2."""
        lead = times - self._at[:, slots]
        with np.errstate(invalid="ignore"):
            due = lead >= self._next[:, slots]
        row, column = np.nonzero(due)
        if not len(row):
            return
        where = slots[column]
        assert self._kept is not None
        some = self._kept.taken(row * self._at.shape[1] + where)
        leads = lead[row, column]
        mixture = some.predicted(leads)
        tail = mixture.tail(positions[:, column] - mixture.center, noise[:, column])
        first = self._next[row, where] == 0.0
        counts = first | (leads <= self.horizon * (1.0 + 0.5 / LEVELS.looks))
        least = np.where(counts, np.minimum(self._least[row, where], tail), self._least[row, where])
        self._least[row, where] = least
        self._next[row, where] = (np.floor(leads / self.horizon * LEVELS.looks * (1 + 1e-9)) + 1.0) * (
            self.horizon / LEVELS.looks
        )
        self._learn(1, where[counts], tail[counts], times[column][counts])
        done = self._next[row, where] > self.horizon * (1.0 + 1e-9)
        if done.any():
            self._learn(0, where[done], least[done], times[column][done])
            self._at[row[done], where[done]] = np.nan

    def _learn(self, kind: int, slots: Index, scores: Array, times: Array) -> None:
        """Count scores of tubes (0) or of single leads (1)."""
        size = -np.log(np.maximum(scores, np.finfo(float).tiny))
        place = np.minimum((size / LEVELS.widest * LEVELS.bins).astype(np.intp), LEVELS.bins - 1)
        self._own[..., slots] *= np.exp(-(times - self._scored[slots]) / LEVELS.fade)
        self._scored[slots] = times
        weight = 1.0 / LEVELS.looks if kind else 1.0
        np.add.at(self._own[kind], (place, slots), weight)
        low, share = self._kinds(slots)
        pool = self._pool[kind]
        np.add.at(pool, (place, low), weight * (1.0 - share))
        np.add.at(pool, (place, low + 1), weight * share)
        pool *= np.minimum(LEVELS.most / np.maximum(pool.sum(axis=0), LEVELS.most), 1.0)

    def _kinds(self, slots: Index) -> tuple[Index, Array]:
        """Kind of motion below that of each track, and the share of the next one."""
        shown = np.maximum(self.bank.restless[slots], np.finfo(float).tiny)
        kind = np.clip(2.0 * np.log10(shown / self._unit) + 0.6 * _KINDS, 0.0, _KINDS - 1.001)
        low = kind.astype(np.intp)
        return low, kind - low

    def keep(self, slots: Index, times: Array) -> None:
        """Keep what is predicted now, where the last prediction that was kept is old enough."""
        at = self._at[:, slots]
        age = times - np.where(np.isnan(at), -np.inf, at)
        wanted = age.min(axis=0) >= self.horizon / LEVELS.pending * (1.0 - 1e-9)
        some = slots[wanted]
        if not len(some):
            return
        row = age[:, wanted].argmax(axis=0)
        assert self._kept is not None
        _put(self._kept, row * self._at.shape[1] + some, self.bank.snapshot(some))
        self._at[row, some], self._least[row, some], self._next[row, some] = times[wanted], 1.0, 0.0

    def alphas(self, slots: Index, alpha: Array, whole: bool = True) -> Array:
        """Tail at which regions hold with probabilities 1 - alpha, (n,): whole tubes, or each lead by itself."""
        low, share = self._kinds(slots)
        kind = 0 if whole else 1
        pool = self._pool[kind][:, low] * (1.0 - share) + self._pool[kind][:, low + 1] * share
        beyond = _beyond(pool) + LEVELS.first * (_LAW if whole else np.exp(-_EDGES))[:, None]
        beyond *= LEVELS.others / beyond[0]
        beyond += _beyond(self._own[kind][:, slots])
        chance = beyond / beyond[0]
        # linear in the logarithm of the chance between edges
        place = np.minimum((chance > alpha).sum(axis=0), LEVELS.bins)
        column = np.arange(len(slots))
        high, less = np.log(chance[place - 1, column]), np.log(chance[place, column])
        part = np.clip((high - np.log(alpha)) / np.maximum(high - less, 1e-12), 0.0, 1.0)
        return np.asarray(np.exp(-(_EDGES[place - 1] + part * (_EDGES[1] - _EDGES[0]))))


def _beyond(counts: Array) -> Array:
    """Counts (B, n) beyond each edge, (B + 1, n)."""
    return np.concatenate([np.cumsum(counts[::-1], axis=0)[::-1], np.zeros((1, counts.shape[1]))])


def _put(whole: Snapshot, where: Index, part: Snapshot) -> None:
    whole.walks.put(where, part.walks)
    whole.swings.put(where, part.swings)
    for name in ("weight", "stood", "acceleration", "time"):
        getattr(whole, name)[..., where] = getattr(part, name)
