"""Zones of obstacles that are taken to move as foretold, of one order: what is learnt, and what that comes to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.estimation.recursive import SquareRoots
from scp_planner.online.many_zones import Level
from scp_planner.online.polynomial_motions import PolynomialMotions
from scp_planner.online.regions import ALONE, BELIEVED, NOTICED, RegionSizes
from scp_planner.online.sorted_tracks import SortedTracks
from scp_planner.online.suspicions import Suspicions
from scp_planner.online.track import ObstacleTrack
from scp_planner.threat_zones.zone import ThreatZone


class SettledTracks:
    def __init__(
        self,
        tracks: Sequence[ObstacleTrack],
        roots: SquareRoots,
        suspicions: Suspicions | None,
        banked: bool,
        sizes: RegionSizes | None,
    ) -> None:
        self.tracks, self._roots, self._banked = tracks, roots, banked
        self._suspicions, self._sizing = suspicions, None
        suspected = np.zeros(len(tracks), dtype=bool) if suspicions is None else suspicions.probability > 0.0
        otherwise = suspected.copy()
        if sizes is not None:
            believed = BELIEVED if banked else ALONE
            self._sizing = sizes.of(tracks, np.where(suspected, NOTICED, believed))
            otherwise[self._sizing.others] = True
        self._marks: list[tuple[bool, bool]] = list(zip(suspected.tolist(), otherwise.tolist(), strict=True))
        self._motions: tuple[float, PolynomialMotions] | None = None

    def motions(self, manoeuvre: float) -> PolynomialMotions:
        if self._motions is None or self._motions[0] != manoeuvre:
            found = PolynomialMotions.of(self.tracks, self._roots, manoeuvre, self._suspicions)
            self._motions = manoeuvre, found
        return self._motions[1]

    def zones(self, start: float, level: Level, manoeuvre: float) -> list[ThreatZone]:
        """Their zones from a time on, s, in order."""
        zones = self.motions(manoeuvre).zones(self.tracks, start, level, self._sizing)
        for track, zone, (suspect, other) in zip(self.tracks, zones, self._marks, strict=True):
            track.suspected, track.zone = suspect, zone if other else None
            track.foretold.clear() if self._banked else track.keep_foretold()
        return zones


@dataclass(frozen=True)
class Learnt:
    tracks: SortedTracks
    level: Level
    settled: Sequence[SettledTracks]
