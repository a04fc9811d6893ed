"""Tracks sorted by how their zones are made, and the zones of those that are taken to move as predicted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from scp_planner.arrays import Mask
from scp_planner.online.many_zones import Level, made_zones
from scp_planner.online.track import TRACKS, ObstacleTrack
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.tracking.futures import PolynomialMotions, Sizing


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
class InitialisedTracks:
    tracks: Sequence[ObstacleTrack]
    motions: PolynomialMotions
    suspected: Mask  # (K,) True where a change of acceleration is likely, but not sure
    sizing: Sizing | None

    def zones(self, start: float, level: Level) -> list[ThreatZone]:
        """Their zones from a time on, s, in order."""
        zones, otherwise = self._zones(start, level), self.suspected.copy()
        if self.sizing is not None:
            otherwise[self.sizing.others] = True
        for k, (track, zone) in enumerate(zip(self.tracks, zones, strict=True)):
            track.suspected = bool(self.suspected[k])
            track.zone = zone if otherwise[k] or track.bounded else None
        return zones

    def _zones(self, start: float, level: Level) -> list[ThreatZone]:
        motions = self.motions
        scales = level.scales(self.tracks, lambda: motions.lengths(start), motions.terms)
        return made_zones(self.tracks, motions.future(start), level, scales, self.sizing)


@dataclass(frozen=True)
class Learnt:
    tracks: SortedTracks
    level: Level
    settled: Sequence[InitialisedTracks]
