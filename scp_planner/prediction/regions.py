"""Regions that follow what came of predictions, by obstacle and horizon: see `scp_planner.tracking.conformal`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scp_planner.arrays import Index
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.prediction.track import ObstacleTrack, Seen
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.tracking.confidence import NormalErrors
from scp_planner.tracking.conformal import AdaptiveScales, region_score
from scp_planner.tracking.futures import Sizing, sized_covariances
from scp_planner.tracking.predictions import Prediction, PredictionKind, predicted


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


class RegionSizes:
    def __init__(self, alpha: float) -> None:
        self.scales = AdaptiveScales(alpha, len(REGIONS.horizons), kinds=len(PredictionKind))
        self._border = NormalErrors().pointwise_scale(alpha)
        self._turn = 0

    def learn(self, tracks: Sequence[ObstacleTrack], seen: Sequence[Seen]) -> None:
        """Learn from what is seen of some obstacles, one observation of each."""
        horizons = range(len(REGIONS.horizons))
        if len(tracks) > REGIONS.most_compared:
            self._turn += 1
            if self._turn % 2:
                return
            turn, number = divmod(self._turn // 2, len(REGIONS.horizons))
            horizons = range(number, number + 1)
            some = [(turn * REGIONS.most_compared + k) % len(tracks) for k in range(REGIONS.most_compared)]
            tracks, seen = [tracks[k] for k in some], [seen[k] for k in some]
        for number in horizons:
            self._learn_over(number, tracks, seen)

    def _learn_over(self, number: int, tracks: Sequence[ObstacleTrack], seen: Sequence[Seen]) -> None:
        """Compare what is seen with the newest predictions that are older than a horizon, but not by too much."""
        horizon = REGIONS.horizons[number]
        before = [track.prediction_before(one.time - horizon) for track, one in zip(tracks, seen, strict=True)]
        told = [
            (track, one, prediction)
            for track, one, prediction in zip(tracks, seen, before, strict=True)
            if prediction is not None and one.time - prediction.origin <= horizon + REGIONS.latest
        ]
        if not told:
            return
        centers, covariances = predicted([one for _, _, one in told], np.array([one.time for _, one, _ in told]))
        xx, xy, yy = covariances.T
        sound = (xx * yy > xy * xy) & (xx > 0.0)  # far from its origin the polynomial is no covariance
        if not sound.any():
            return
        noise = np.array([track.noise_of(one.covariance) for track, one, _ in told])[:, [0, 0, 1], [0, 1, 1]]
        offsets = np.array([one.position for _, one, _ in told]) - centers
        scores = region_score(offsets[sound], covariances[sound], noise[sound], self._border)
        names = [told[k][0].id for k in np.flatnonzero(sound).tolist()]
        self.scales.take_in(number, names, scores, np.array([one.kind for _, _, one in told])[sound])

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
        sizing = self.of(tracks, np.full(len(tracks), PredictionKind.ALONE))
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
            larger = sized_covariances(whole, sizing.leads[some[0]], np.minimum(sizes, 1.0), added)
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
