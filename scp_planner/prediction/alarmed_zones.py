"""Zones of obstacles that are noticed to move otherwise than predicted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array, Index, rows_of
from scp_planner.prediction.many_zones import Level, made_zones
from scp_planner.prediction.track import ObstacleTrack, slots_of
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.tracking.change_hypotheses import CHANGE_HYPOTHESES, Changes, changed_motions, changes_of
from scp_planner.tracking.filters import Mixture, even
from scp_planner.tracking.futures import Future, Sizing, future_of, lengths_of
from scp_planner.tracking.motion_estimate import HORIZON, standardised_speed
from scp_planner.tracking.noticing import Bank


@dataclass(frozen=True)
class WeavingParameters:
    knots: int = 8  # Spans between times at which zones of those that weave are put down, until they have converged
    span: float = 0.4  # Periods of the fastest oscillator model, that a span is long
    # Spans; times within the first ones besides the ends of all, since zones grow fast at first
    early: tuple[float, ...] = (0.0, 0.05, 0.15, 0.3, 0.6)


WEAVING = WeavingParameters()


class Alarmed:
    def __init__(self, tracks: Sequence[ObstacleTrack], bank: Bank, deviation: float) -> None:
        self.tracks, self.bank, self.deviation = tracks, bank, deviation
        self.slots = slots_of(tracks)

    def zones(self, start: float, level: Level, sizing: Sizing | None = None) -> list[ThreatZone]:
        weave = self.bank.weave(self.slots)
        if not weave.any():
            mixtures = self._mixture(self.bank.mixed(self.slots, self._at(start)), start)
            scales = level.scales(self.tracks, lambda: lengths_of(mixtures))
            return made_zones(self.tracks, future_of(mixtures, start), level, scales, sizing)
        made: dict[str, ThreatZone] = {}
        for each, swing in ((~weave, False), (weave, True)):
            index = np.flatnonzero(each)
            some = Alarmed([self.tracks[k] for k in index.tolist()], self.bank, self.deviation)
            if some.tracks:
                own = None if sizing is None else rows_of(sizing, index)
                zones = some._weaving(start, level, own) if swing else some.zones(start, level, own)
                made.update(zip((track.id for track in some.tracks), zones, strict=True))
        return [made[track.id] for track in self.tracks]

    def _at(self, time: float) -> Array:
        return np.full(len(self.slots), time)

    @cached_property
    def _single(self) -> Index:
        if self.deviation <= 0.0:
            return np.zeros(0, dtype=np.intp)
        known = [track.settled for track in self.tracks]
        return np.flatnonzero(known & (self.bank.count[self.slots] > CHANGE_HYPOTHESES.onsets[0]))

    @cached_property
    def _changes(self) -> Changes:
        return changes_among(self.bank, self.slots[self._single], self.deviation)

    def _mixture(self, filters: Mixture, start: float, leads: Array | None = None) -> Mixture:
        """The filters, and a single change: at a time, s, or after each of some leads (T,) from there, lead by lead."""
        some = self._single
        if not len(some):
            return filters
        slots = self.slots[some]
        roots, noise = rows_of(self.bank.polynomials.roots, slots), self.bank.noise_of(slots)
        changed = changed_motions(roots, self._changes.sure(), noise, start)
        odds = np.clip(
            self.bank.gain[slots] - self._changes.total,
            -CHANGE_HYPOTHESES.most_evidence,
            CHANGE_HYPOTHESES.most_evidence,
        )
        share = 1.0 / (1.0 + np.exp(odds))
        if leads is None:
            return filters.blended(some, changed, share)
        many = len(leads)
        where = (some + len(self.slots) * np.arange(many)[:, None]).ravel()
        return filters.blended(where, changed.after(leads), np.tile(share, many))

    def _weaving(self, start: float, level: Level, sizing: Sizing | None) -> list[ThreatZone]:
        bank, count = self.bank, len(self.tracks)
        span = WEAVING.span * 2.0 * np.pi / float(bank.widening.swings.rates.max())
        leads = span * np.concatenate([WEAVING.early, np.arange(1.0, WEAVING.knots)])
        many = len(leads)
        times = np.repeat(start + leads, count)
        near = self._mixture(bank.mixed(np.tile(self.slots, many), times), start, leads)
        end = span * WEAVING.knots
        settled = self._mixture(bank.settled(self.slots, self._at(start + end)), start + end)
        later = future_of(settled, start + end)
        error, cross, rate, force = (
            near.covariance[:, i, :, j].reshape(many, count, 2, 2) for i, j in ((0, 0), (0, 1), (1, 1), (0, 2))
        )

        def lengths() -> Array:
            speed = standardised_speed(error, cross, rate)
            summed = lengths_of(settled) + (end - leads[-1]) * speed[-1]
            return np.asarray(summed + (0.5 * np.diff(leads)[:, None] * (speed[1:] + speed[:-1])).sum(axis=0))

        centers = near.mean.reshape(many, count, 3, 2)
        moments = np.stack([error, 2.0 * even(cross), 2.0 * (rate + even(force))], axis=2)
        moments = moments[..., [0, 0, 1], [0, 1, 1]]
        breaks = start + np.concatenate([leads, [end, HORIZON]])
        widths = np.diff(breaks)[:-1]
        future = Future(
            breaks,
            _pieces(centers, later.centers[:, -1], widths),
            _pieces(moments, later.covariances[:, -1], widths),
            rate[0],
        )
        soon = future_of(rows_of(near, slice(count)), start)
        return made_zones(self.tracks, future, level, level.scales(self.tracks, lengths), sizing, soon)


def changes_among(bank: Bank, slots: Index, deviation: float) -> Changes:
    return changes_of(rows_of(bank.polynomials.roots, slots), bank.looks(slots), bank.noise_of(slots), deviation)


def _pieces(values: Array, last: Array, widths: Array) -> Array:
    """Coefficients (K, S + 1, P, d) of polynomials of degree 5 between moments, and what follows them."""
    count, terms = len(last), max(6, last.shape[1])
    end = last[:, :3] * np.array([1.0, 1.0, 2.0])[:, None]
    right = np.concatenate([values[1:], end[None]])
    h = widths[:, None, None]
    p, v, a = (values[:, :, k] for k in range(3))
    gap = right[:, :, 0] - p - h * v - 0.5 * h * h * a
    slope = h * (right[:, :, 1] - v - h * a)
    bend = h * h * (right[:, :, 2] - a)
    pieces = np.zeros((count, len(values) + 1, terms, last.shape[2]))
    rows = (
        p,
        v,
        0.5 * a,
        (10.0 * gap - 4.0 * slope + 0.5 * bend) / h**3,
        (-15.0 * gap + 7.0 * slope - bend) / h**4,
        (6.0 * gap - 3.0 * slope + 0.5 * bend) / h**5,
    )
    for power, row in enumerate(rows):
        pieces[:, :-1, power] = row.swapaxes(0, 1)
    pieces[:, -1, : last.shape[1]] = last
    return pieces
