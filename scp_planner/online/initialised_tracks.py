"""Tracks sorted by how their zones are made, and the zones of those that are taken to move as predicted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

import numpy as np

from scp_planner.arrays import Array, Mask
from scp_planner.mathematics.polynomials import shift_matrices
from scp_planner.online.many_zones import Future, Level, Sizing, length_rule, made_zones
from scp_planner.online.track import TRACKS, ObstacleTrack
from scp_planner.threat_zones.of_scenario import HORIZON
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.tracking.change_hypotheses import ChangeHypotheses
from scp_planner.tracking.motion_estimate import POLYNOMIAL_TERMS, least_variances
from scp_planner.tracking.recursive import SquareRoots


class TrackKind(Enum):
    SETTLED = "polynomials from what was seen alone"
    ALARMED = "mixtures of filters"
    NEW = "polynomials from a prior, too"


def track_kind(track: ObstacleTrack, headings: bool) -> TrackKind | None:
    """Return how the zone of a track is made together with others."""
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
    uncertain: int
    headings: bool
    kinds: Mapping[TrackKind, Mapping[int, Sequence[ObstacleTrack]]]

    @classmethod
    def of(cls, tracks: Iterable[ObstacleTrack]) -> SortedTracks:
        """Sort tracks; those that have not been seen are left out."""
        every = [track for track in tracks if track.seen]
        turning = sum(track.fixed is None and track.body.turning is not None for track in every)
        headings = turning <= TRACKS.most_turning
        groups: dict[TrackKind, dict[int, list[ObstacleTrack]]] = {kind: {} for kind in TrackKind}
        for track in every:
            kind = track_kind(track, headings)
            if kind is not None:
                groups[kind].setdefault(track.model.order, []).append(track)
        kinds = {kind: dict(sorted(some.items())) for kind, some in groups.items()}
        return cls(every, sum(track.uncertain for track in every), headings, kinds)


def learns(track: ObstacleTrack) -> bool:
    """Return whether more is learnt of the polynomial motion of a track with each observation."""
    observed = bool(track.history) and track.fixed is None and track.given is None
    return observed and track.model.process is None and not (track.alarmed or track.suspected)


@dataclass(frozen=True)
class PolynomialMotions:
    """K motions as they are estimated, in powers of the time since the middle of what was seen of each."""

    coefficients: Array  # (K, p, 2) Relative to their origins, m/s^k
    spread: Array  # (K, p, p) Covariance of each component of them, over that of the noise
    noise: Array  # (K, 3) Elements xx, xy, yy of the covariance of every observation, m^2
    origin: Array  # (K, 2) m
    first: Array  # (K,) s
    last: Array  # (K,) s
    middle: Array  # (K,) s

    @classmethod
    def of(
        cls,
        tracks: Sequence[ObstacleTrack],
        roots: SquareRoots,
        manoeuvre: float = 0.0,
        change_hypotheses: ChangeHypotheses | None = None,
    ) -> PolynomialMotions:
        """Return motions of one order, as they are estimated."""
        middle = roots.center
        first = np.array([track.oldest for track in tracks])
        last = np.array([track.newest for track in tracks])
        inverse = np.linalg.inv(roots.factor)
        spread, coefficients = inverse @ inverse.transpose(0, 2, 1), inverse @ roots.right
        sigma = np.array([track.known_noise for track in tracks])
        if manoeuvre > 0.0:
            change = manoeuvre**2 / least_variances(sigma)
            spread, coefficients = _with_manoeuvre(spread, coefficients, last - middle, change)
        if change_hypotheses is not None and change_hypotheses.probability.any():
            spread = _padded(spread, 3) + change_hypotheses.spread
            coefficients = _padded(coefficients, 2) + change_hypotheses.shift
        return cls(coefficients, spread, sigma[:, [0, 0, 1], [0, 1, 1]], roots.origin, first, last, middle)

    @property
    def terms(self) -> int:
        """Number p of coefficients."""
        return int(self.coefficients.shape[1])

    def zones(
        self, tracks: Sequence[ObstacleTrack], start: float, level: Level, sizing: Sizing | None = None
    ) -> list[ThreatZone]:
        """Make their zones."""
        count, terms = len(tracks), self.terms
        shift = shift_matrices(terms, start - self.middle)
        center = shift @ self.coefficients
        center[:, 0] += self.origin
        local = shift @ self.spread @ shift.transpose(0, 2, 1)
        growth = local.reshape(count, -1) @ _products(terms)
        covariance = growth[:, :, None] * self.noise[:, None]
        rates = self.noise[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
        rates = local[:, 1:, 1:][:, :1, :1] * rates if terms > 1 else np.zeros((count, 2, 2))
        future = Future(np.array([start, start + HORIZON]), center[:, None], covariance[:, None], rates)
        return made_zones(tracks, future, level, level.scales(tracks, lambda: self._lengths(start), terms), sizing)

    def _lengths(self, start: float) -> Array:
        """Standardised lengths over `HORIZON` from a time on, s: (K,)."""
        clocks = np.stack([self.first, self.last, self.middle])
        # if all were seen at the same times
        alike = bool((clocks == clocks[:, :1]).all() and (self.spread == self.spread[0]).all())
        some = slice(1 if alike else None)
        (first, last, middle), spread = clocks[:, some], self.spread[some]
        half, about = np.where(last > first, 0.5 * (last - first), 1.0), 0.5 * (first + last)
        shift = _shift(self.terms - 1, about - middle, half)
        local = shift @ spread @ shift.transpose(0, 2, 1)
        found = _lengths(local, (start - about) / half, (start + HORIZON - about) / half)
        return np.repeat(found, len(self.first)) if alike else found


def _with_manoeuvre(spread: Array, coefficients: Array, last: Array, change: Array) -> tuple[Array, Array]:
    """Allow for changes of acceleration at times ``last``; see `PolynomialEstimate.with_manoeuvre`."""
    shift = np.empty((len(last), 3))
    shift[:, 0], shift[:, 1], shift[:, 2] = 0.5 * (last * last), -last, 0.5
    return _padded(spread, 3) + change[:, None, None] * shift[:, :, None] * shift[:, None], _padded(coefficients, 2)


def _padded(values: Array, width: int) -> Array:
    """Values (K, p, ...) of motions of any order as those of order 2, (K, 3, width)."""
    count, terms, given = values.shape
    if terms == 3:
        return values
    padded = np.zeros((count, 3, width))
    padded[:, :terms, :given] = values
    return padded


def _shift(order: int, shift: Array, scale: Array) -> Array:
    """Matrices from coefficients of powers of u to those of s, where u = shift + scale s, (K, p, p)."""
    matrix = shift_matrices(order + 1, shift)
    matrix *= scale[:, None, None] ** np.arange(order + 1)[:, None]
    return matrix


@lru_cache(maxsize=8)
def _products(terms: int) -> Array:
    """Matrix from the products of coefficients k and m, in rows, to the coefficient k + m."""
    matrix = np.zeros((terms, terms, POLYNOMIAL_TERMS))
    for k in range(terms):
        for m in range(terms):
            matrix[k, m, k + m] = 1.0
    return matrix.reshape(-1, POLYNOMIAL_TERMS)


def _lengths(spread: Array, start: Array, stop: Array) -> Array:
    """Standardised lengths of K polynomial motions over spans of normalised time, (K,)."""
    order = spread.shape[1] - 1
    if order == 0:
        return np.zeros(len(spread))
    nodes, weights = length_rule()
    low, high = np.arctan(start), np.arctan(stop)
    angles = low[:, None] + (high - low)[:, None] * nodes
    sine, cosine = np.sin(angles), np.cos(angles)
    x, y = np.empty((2, *angles.shape, order + 1))
    if order == 1:
        x[..., 0], x[..., 1] = cosine, sine
        y[..., 0], y[..., 1] = -sine, cosine
    else:
        both, squares = sine * cosine, (cosine * cosine, sine * sine)
        x[..., 0], x[..., 1], x[..., 2] = squares[0], both, squares[1]
        y[..., 0], y[..., 1], y[..., 2] = -2.0 * both, squares[0] - squares[1], 2.0 * both
    weighted = x @ spread
    error, cross, rate = _summed(weighted * x), _summed(weighted * y), _summed((y @ spread) * y)
    speed = np.sqrt(np.maximum(rate * error - cross * cross, 0.0)) / error
    return (high - low) * (speed @ weights)


def _summed(terms: Array) -> Array:
    """Sums over the last axis of two or three: a sum of numpy over so short an axis takes several times as long."""
    total: Array = terms[..., 0] + terms[..., 1]
    for term in range(2, terms.shape[-1]):
        total += terms[..., term]
    return total


@dataclass(frozen=True)
class InitialisedTracks:
    tracks: Sequence[ObstacleTrack]
    motions: PolynomialMotions
    suspected: Mask  # (K,) True where a change of acceleration is likely, but not sure
    sizing: Sizing | None

    def zones(self, start: float, level: Level) -> list[ThreatZone]:
        """Their zones from a time on, s, in order."""
        zones, otherwise = self.motions.zones(self.tracks, start, level, self.sizing), self.suspected.copy()
        if self.sizing is not None:
            otherwise[self.sizing.others] = True
        for k, (track, zone) in enumerate(zip(self.tracks, zones, strict=True)):
            track.suspected = bool(self.suspected[k])
            track.zone = zone if otherwise[k] or track.bounded else None
        return zones


@dataclass(frozen=True)
class Learnt:
    tracks: SortedTracks
    level: Level
    settled: Sequence[InitialisedTracks]
