"""Regions that follow what came of predictions, by obstacle and horizon: see `scp_planner.tracking.conformal`."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.online.many_zones import Sizing, times_linear
from scp_planner.online.track import ObstacleTrack, Seen, slots_of
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.tracking.confidence import NormalErrors
from scp_planner.tracking.conformal import AdaptiveScales, region_score
from scp_planner.tracking.noticing import Bank
from scp_planner.tracking.predictions import Prediction


@dataclass(frozen=True)
class RegionParameters:
    # Units of time ahead, at which predictions are compared with what came: the next observation, and later ones
    horizons: tuple[float, ...] = (0.0, 1.0, 2.0, 4.0)
    # An observation is compared with a prediction for it that is no older than that by this share of the longest
    lateness: float = 0.1
    # Number of obstacles that are compared every other time, over one horizon, all in turns, where more are seen
    # together
    most_compared: int = 64

    @property
    def latest(self) -> float:
        """Age of a prediction, beyond its horizon, up to which it is compared."""
        return self.lateness * self.horizons[-1]


REGIONS = RegionParameters()
BELIEVED, NOTICED, ALONE = 0, 1, 2
"""Kinds of predictions."""


class RegionSizes:
    def __init__(self, alpha: float) -> None:
        self.scales = AdaptiveScales(alpha, len(REGIONS.horizons), kinds=3)
        self._border = NormalErrors().pointwise_scale(alpha)
        self._turn = 0

    def learn(self, tracks: Sequence[ObstacleTrack], seen: Sequence[Seen]) -> None:
        """Learn from what is seen of some obstacles of one bank or of none, one observation of each."""
        alone = [number for number, track in enumerate(tracks) if track.predictions]
        if alone:
            self._learn_alone([tracks[k] for k in alone], [seen[k] for k in alone])
        first = tracks[0].estimator if len(tracks) else None
        if first is not None and first.bank is not None:
            every = range(len(REGIONS.horizons))
            if len(tracks) > REGIONS.most_compared:
                self._turn += 1
                if self._turn % 2:
                    return
                turn, number = divmod(self._turn // 2, len(REGIONS.horizons))
                every = range(number, number + 1)
                some = [(turn * REGIONS.most_compared + k) % len(tracks) for k in range(REGIONS.most_compared)]
                tracks, seen = [tracks[k] for k in some], [seen[k] for k in some]
            self._learn_in(first.bank, tracks, seen, every)

    def _learn_in(self, bank: Bank, tracks: Sequence[ObstacleTrack], seen: Sequence[Seen], horizons: range) -> None:
        slots = slots_of(tracks)
        times, positions = np.array([one.time for one in seen]), np.array([one.position for one in seen])
        declared = bank.noise_of(slots)[:, [0, 0, 1], [0, 1, 1]]
        for number in horizons:
            for found in bank.predictions.compared(slots, times, positions, REGIONS.horizons[number], REGIONS.latest):
                names = [tracks[k].id for k in found.which.tolist()]
                self._take_in(number, names, found.offset, found.covariance, declared[found.which], found.kinds)

    def _learn_alone(self, tracks: Sequence[ObstacleTrack], seen: Sequence[Seen]) -> None:
        for number, horizon in enumerate(REGIONS.horizons):
            told: list[Prediction] = []
            which: list[int] = []
            for k, (track, one) in enumerate(zip(tracks, seen, strict=True)):
                origins = [each.origin for each in track.predictions]
                before = bisect(origins, one.time - horizon) - 1
                if before >= 0 and one.time - origins[before] <= horizon + REGIONS.latest:
                    told.append(track.predictions[before])
                    which.append(k)
            if not told:
                continue
            declared = np.array([tracks[k].noise_of(seen[k].covariance) for k in which])
            offsets, covariances = _errors(told, np.array([(seen[k].time, *seen[k].position) for k in which]))
            noise = declared[:, [0, 0, 1], [0, 1, 1]]
            self._take_in(number, [tracks[k].id for k in which], offsets, covariances, noise, ALONE)

    def _take_in(
        self, horizon: int, names: Sequence[str], offset: Array, covariance: Array, noise: Array, kinds: Index | int
    ) -> None:
        xx, xy, yy = covariance.T
        sound = (xx * yy > xy * xy) & (xx > 0.0)  # far from its origin the polynomial is no covariance
        if not sound.all():
            names = [names[k] for k in np.flatnonzero(sound).tolist()]
            offset, covariance, noise = offset[sound], covariance[sound], noise[sound]
            kinds = kinds if isinstance(kinds, int) else kinds[sound]
        if len(names):
            self.scales.take_in(horizon, names, region_score(offset, covariance, noise, self._border), kinds)

    def of(self, tracks: Sequence[ObstacleTrack], kinds: Index) -> Sizing:
        """Sizes of the regions of some obstacles, whose predictions are of kinds (n,)."""
        leads = np.empty((len(tracks), len(REGIONS.horizons)))
        leads[:] = REGIONS.horizons
        # what is compared next is as far ahead as it was the last time
        last = [track.newest - track.history[-2:][0].time for track in tracks]
        leads[:, 0] = np.minimum(last, 0.5 * REGIONS.horizons[1])
        return Sizing(leads, kinds, self.scales.scales([track.id for track in tracks], kinds))

    def sized(self, tracks: Sequence[ObstacleTrack], zones: Sequence[ThreatZone]) -> list[ThreatZone]:
        """Zones that were made alone, of as many tracks, with their covariances sized; they may be the same."""
        sizing = self.of(tracks, np.full(len(tracks), ALONE))
        made, alike = list(zones), dict[tuple[bytes, bytes, tuple[int, ...]], list[int]]()
        for k in np.flatnonzero((sizing.sizes != 1.0).any(axis=1)).tolist():
            covariances = zones[k].covariances
            if covariances is not None:
                kind = covariances.breakpoints.tobytes(), sizing.leads[k].tobytes(), covariances.coefficients.shape
                alike.setdefault(kind, []).append(k)
        for some in alike.values():
            whole, sizes = _covariances([zones[k] for k in some]), sizing.sizes[some]
            told = np.array([_predicted(tracks[k]).covariance[0, 0] for k in some])
            added = (whole.coefficients[:, 0, 0, 0] / told)[:, None] * np.maximum(sizes - 1.0, 0.0)
            larger = times_linear(whole, sizing.leads[some[0]], np.minimum(sizes, 1.0), added)
            for k, edges, pieces in zip(some, larger.breakpoints, larger.coefficients, strict=True):
                made[k] = replace(zones[k], covariances=PiecewisePolynomials(edges[None], pieces[None]))
        return made

    def forget(self, name: str) -> None:
        """Forget an obstacle."""
        self.scales.forget(name)


def _covariances(zones: Sequence[ThreatZone]) -> PiecewisePolynomials:
    every = [zone.covariances for zone in zones if zone.covariances is not None]
    return PiecewisePolynomials(every[0].breakpoints, np.concatenate([one.coefficients for one in every]))


def _predicted(track: ObstacleTrack) -> Prediction:
    assert track.predicted is not None, "it has a zone"
    return track.predicted


def _errors(told: Sequence[Prediction], where: Array) -> tuple[Array, Array]:
    lag = where[:, 0] - np.array([each.origin for each in told])
    later = [each.later for each in told]
    values = []
    for parts in ([each.center for each in told], [each.covariance for each in told]):
        found = np.zeros((len(told), parts[0].shape[1]))
        terms = np.array([len(part) for part in parts])
        for count in np.unique(terms).tolist():
            some = np.flatnonzero(terms == count)
            powers = lag[some, None] ** np.arange(count)
            found[some] = (powers[:, None] @ np.array([parts[k] for k in some.tolist()]))[:, 0]
        values.append(found)
    pieced = [k for k, each in enumerate(later) if each is not None]
    for value, name in zip(values, ("centers", "covariances"), strict=True):
        pieces = PiecewisePolynomials.stack([getattr(later[k], name) for k in pieced], value.shape[1])
        value[pieced] = pieces.at(np.arange(len(pieced)), where[pieced, 0])
    return where[:, 1:] - values[0], values[1]
