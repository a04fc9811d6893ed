"""Tracks sorted by how their zones are made, and zones of many at once, from polynomials of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array, Mask
from scp_planner.mathematics.polynomials import PiecewisePolynomials, shift_matrices
from scp_planner.prediction.track import TRACKS, ObstacleTrack
from scp_planner.scenario.models import Confidence, ConfidenceLevel
from scp_planner.threat_zones.reach import VELOCITY_SHARE, Reach, within_reach
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.tracking.confidence import NormalErrors, alpha_of_one, uniform_scale
from scp_planner.tracking.futures import Future, PolynomialMotions, Sizing, lengths_of_polynomials, sized_pieces
from scp_planner.tracking.maximum_likelihood import MotionPrior
from scp_planner.tracking.motion_estimate import HORIZON, POLYNOMIAL_TERMS
from scp_planner.tracking.predictions import Later, Prediction, PredictionKind
from scp_planner.tracking.recursive import Primed, SquareRoots

_NORMAL = NormalErrors()


class TrackKind(Enum):
    SETTLED = "polynomials from what was seen alone"
    ALARMED = "mixtures of filters"
    NEW = "polynomials from a prior, too"


def track_kind(track: ObstacleTrack, headings: bool) -> TrackKind | None:
    if track.fixed is not None or track.estimator is None or not track.simple:
        return None
    if track.alarmed:
        return TrackKind.ALARMED
    if headings and track.body.turning is not None:
        return None  # its heading is estimated, too
    if track.settled:
        return TrackKind.SETTLED
    return TrackKind.NEW if track.model.order > 0 else None  # of order 0 no prior tells anything


@dataclass(frozen=True)
class SortedTracks:
    """Tracks that have been seen."""

    every: Sequence[ObstacleTrack]
    level: Level
    headings: bool
    kinds: Mapping[TrackKind, Mapping[int, Sequence[ObstacleTrack]]]

    @classmethod
    def of(cls, tracks: Iterable[ObstacleTrack], confidence: Confidence) -> SortedTracks:
        every = [track for track in tracks if track.seen]
        turning = sum(track.fixed is None and track.body.turning is not None for track in every)
        headings = turning <= TRACKS.most_turning
        groups: dict[TrackKind, dict[int, list[ObstacleTrack]]] = {kind: {} for kind in TrackKind}
        for track in every:
            kind = track_kind(track, headings)
            if kind is not None:
                groups[kind].setdefault(track.model.order, []).append(track)
        kinds = {kind: dict(sorted(some.items())) for kind, some in groups.items()}
        return cls(every, Level(confidence, sum(track.uncertain for track in every)), headings, kinds)


def learns(track: ObstacleTrack) -> bool:
    """Return whether more is learnt of the polynomial motion of a track with each observation."""
    observed = bool(track.history) and track.fixed is None and track.given is None
    return observed and track.model.process is None and not (track.alarmed or track.suspected)


@dataclass(frozen=True)
class Level:
    confidence: Confidence
    estimated: int

    @cached_property
    def alpha(self) -> float:
        """The probability that one obstacle may be outside with, at one time or at any by the level."""
        return alpha_of_one(str(self.confidence.level), self.confidence.probability, self.estimated)

    def scales(self, tracks: Sequence[ObstacleTrack], lengths: Callable[[], Array], terms: int | None = None) -> Array:
        """Give q for motions of known noise, (n,)."""
        # who has been seen together for as long has the same
        per_time = self.confidence.level is ConfidenceLevel.PER_TIME
        left = [self.alpha * (1.0 - VELOCITY_SHARE) if track.bounded else self.alpha for track in tracks]
        every = list(zip(left, len(tracks) * [0.0] if per_time else lengths().tolist(), strict=True))
        found = {one: uniform_scale(*one, _NORMAL, terms) for one in set(every)}
        return np.array([found[one] for one in every])


def made_zones(
    tracks: Sequence[ObstacleTrack],
    future: Future,
    level: Level,
    scales: Array,
    sizing: Sizing | None = None,
    soon: Future | None = None,
) -> list[ThreatZone]:
    """Zones of covariances that are so many times those of a future, and what is seen next is expected by it."""
    start = float(future.breaks[0])
    near = soon or future
    scaled = scales[:, None, None, None] * future.covariances
    breaks = future.breaks[None]
    sized: dict[int, PiecewisePolynomials] = {}
    if sizing is not None and len(sizing.others):
        others = sizing.others
        edges, pieces = sized_pieces(future, others, sizing)
        pieces *= scales[others, None, None, None]
        sized = {k: PiecewisePolynomials(edges[n, None], pieces[n, None]) for n, k in enumerate(others.tolist())}
    zones = []
    for k, (track, path, spread) in enumerate(zip(tracks, future.centers[:, None], scaled[:, None], strict=True)):
        centers = PiecewisePolynomials(breaks, path)
        later = None if soon is None else Later(future.breaks, future.centers[k], future.covariances[k])
        kind = PredictionKind.BELIEVED if sizing is None else int(sizing.kinds[k])
        track.predicted = Prediction(start, near.centers[k, 0], near.covariances[k, 0], _NORMAL, kind, later)
        if sizing is not None:
            track.keep_prediction()
        zone = ThreatZone(
            track.id,
            track.body.radius + track.margin,
            centers,
            sized[k] if k in sized else PiecewisePolynomials(breaks, spread),
            track.body.outlines,
            until=start + HORIZON,
        )
        if track.bounded:
            track.zone = zone = within_reach(zone, _reach(zone, future.rates[k], level, track.model.bounds))
        zones.append(zone)
    return zones


def _reach(zone: ThreatZone, rate: Array, level: Level, bounds: tuple[float, float]) -> Reach:
    """Reach from the beginning of a zone, by the covariance of the velocity there."""
    (position, *more), start = zone.centers.coefficients[0, 0], float(zone.centers.breakpoints[0, 0])
    velocity = more[0] if more else np.zeros(2)
    error = math.sqrt(_NORMAL.pointwise_scale(VELOCITY_SHARE * level.alpha) * np.linalg.eigvalsh(rate)[-1])
    assert zone.covariances is not None, "its motion is estimated"
    return Reach(start, position, velocity, zone.covariances.coefficients[0, 0, 0], error, *bounds)


@dataclass(frozen=True)
class InitialisedTracks:
    tracks: Sequence[ObstacleTrack]
    motions: PolynomialMotions
    suspected: Mask  # (K,) True where a change of acceleration is likely, but not sure
    sizing: Sizing | None

    def zones(self, start: float, level: Level) -> list[ThreatZone]:
        """Their zones from a time on, s, in order."""
        motions, otherwise = self.motions, self.suspected.copy()
        scales = level.scales(self.tracks, lambda: motions.lengths(start), motions.terms)
        zones = made_zones(self.tracks, motions.future(start), level, scales, self.sizing)
        if self.sizing is not None:
            otherwise[self.sizing.others] = True
        for k, (track, zone) in enumerate(zip(self.tracks, zones, strict=True)):
            track.suspected = bool(self.suspected[k])
            track.zone = zone if otherwise[k] or track.bounded else None
        return zones


def newcomers_together(
    tracks: Sequence[ObstacleTrack], roots: SquareRoots, prior: MotionPrior, start: float, level: Level
) -> dict[str, ThreatZone]:
    """Make the zones of newcomers of one order whose noise is known, all at once."""
    primed = Primed.of(roots, np.array([track.known_noise for track in tracks]), prior)
    some = primed.some
    if not len(some):
        return {}
    p = primed.coefficients.shape[1]
    shift = shift_matrices(p, start - roots.center[some])
    center = shift @ primed.coefficients
    center[:, 0] += roots.origin[some]
    pairs = primed.covariance.transpose(0, 2, 4, 1, 3)
    errors = shift[:, None, None] @ pairs @ shift.transpose(0, 2, 1)[:, None, None]
    blocks = _of_time(errors, 0, 0)
    covariance = np.stack([blocks[:, :, 0, 0], 0.5 * (blocks[:, :, 0, 1] + blocks[:, :, 1, 0]), blocks[:, :, 1, 1]], 2)

    def lengths() -> Array:
        return lengths_of_polynomials(blocks, _of_time(errors, 0, 1), _of_time(errors, 1, 1))

    rates = errors[:, :, :, 1, 1]
    future = Future(np.array([start, start + HORIZON]), center[:, None], covariance[:, None], rates)
    new = [tracks[k] for k in some.tolist()]
    zones = made_zones(new, future, level, level.scales(new, lengths))
    return {track.id: zone for track, zone in zip(new, zones, strict=True)}


def _of_time(errors: Array, first: int, second: int) -> Array:
    """Covariances of so manieth derivatives of errors, as polynomials of time, (K, POLYNOMIAL_TERMS, 2, 2)."""
    p = errors.shape[-1]
    found = np.zeros((len(errors), POLYNOMIAL_TERMS, 2, 2))
    for j in range(first, p):
        for k in range(second, p):
            factor = (j if first else 1) * (k if second else 1)
            found[:, j - first + k - second] += factor * errors[:, :, :, j, k]
    return found
