"""Regions that follow what came of predictions, by obstacle and horizon: see `scp_planner.estimation.conformal`."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scp_planner.arrays import Array
from scp_planner.estimation.conformal import AdaptiveScales, region_score
from scp_planner.estimation.error_laws import NormalErrors
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.online.foretold import Prediction
from scp_planner.online.many_zones import times_linear
from scp_planner.online.track import ObstacleTrack, Seen
from scp_planner.settings.online import SceneNewcomers
from scp_planner.threat_zones.zone import ThreatZone

HORIZONS = np.array([0.0, 1.0, 2.0, 4.0])
"""Units of time ahead, at which predictions are compared with what came: the next observation, and later ones."""
LATENESS = 0.1
"""An observation is compared with a prediction for it that is no older than that by this share of the longest."""
_HORIZONS = HORIZONS.tolist()
_LATE = LATENESS * max(_HORIZONS)


def learn(
    scales: AdaptiveScales, tracks: Sequence[ObstacleTrack], seen: Sequence[Seen], newcomers: SceneNewcomers
) -> None:
    """Learn from what is seen of some obstacles, one observation of each, how large regions have to be."""
    told: list[Prediction] = []
    whom: list[tuple[int, str]] = []  # horizons and names
    where: list[tuple[float, float, float]] = []
    noise: list[Array] = []
    for track, one in zip(tracks, seen, strict=True):
        declared = track.noise_of(one.covariance, newcomers)
        origins = [each.origin for each in track.foretold]
        for number, horizon in enumerate(_HORIZONS):
            before = bisect(origins, one.time - horizon) - 1
            if before >= 0 and one.time - origins[before] <= horizon + _LATE:
                told.append(track.foretold[before])
                whom.append((number, track.id))
                where.append((one.time, *one.position))
                noise.append(declared)
    if not told:
        return
    offsets, covariances = _errors(told, np.array(where))
    xx, xy, yy = covariances.T
    sound = (xx * yy > xy * xy) & (xx > 0.0)  # far from its origin the polynomial is no covariance
    declared = np.array(noise)[:, [0, 0, 1], [0, 1, 1]]
    border = NormalErrors().pointwise_scale(scales.alpha)
    scores = region_score(offsets[sound], covariances[sound], declared[sound], border)
    for k, score in zip(np.flatnonzero(sound).tolist(), scores.tolist(), strict=True):
        scales.take_in(*whom[k], score)


def _errors(told: Sequence[Prediction], where: Array) -> tuple[Array, Array]:
    """What is seen, rows of time and position (n, 3), less what is foretold, (n, 2), and its covariances, (n, 3)."""
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


def scaled(scales: AdaptiveScales, track: ObstacleTrack, zone: ThreatZone) -> ThreatZone:
    """A zone whose covariances are sized by what has come of predictions, linearly between the horizons."""
    covariances = zone.covariances
    if covariances is None or track.predicted is None:
        return zone
    level = float(covariances.coefficients[0, 0, 0, 0]) / float(track.predicted.covariance[0, 0])
    leads = HORIZONS.copy()
    if len(track.times) > 1:  # what is compared next is as far ahead as it was the last time
        leads[0] = min(track.times[-1] - track.times[-2], 0.5 * leads[1])
    sizes = scales.scales(track.id)
    added = level * np.maximum(sizes - 1.0, 0.0)
    return replace(zone, covariances=times_linear(covariances, leads, np.minimum(sizes, 1.0), added))
