"""Zones of a scenario, discs among them as numbers: many are put together at once."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.threat_zones.zone import ThreatZone


@dataclass(frozen=True)
class KnownDiscs:
    """Discs whose motion is one polynomial, as numbers."""

    index: Index  # (k,)
    ids: list[str]
    radius: Array  # (k,) m
    coefficients: Array  # (k, 3, 2)

    @property
    def centers(self) -> PiecewisePolynomials:
        """The motions."""
        breakpoints = np.broadcast_to([0.0, np.inf], (len(self.index), 2))
        return PiecewisePolynomials(breakpoints, self.coefficients[:, None])


class SortedZones(Sequence[ThreatZone]):
    """Zones of which those that are discs with one polynomial as their motion are there as numbers, too."""

    discs: KnownDiscs
    others: tuple[int, ...]


def told_of(zones: Sequence[ThreatZone], names: Container[str]) -> tuple[ThreatZone, ...]:
    """Return what there is to be told of zones: those of some obstacles, and all that are uncertain."""
    if isinstance(zones, SortedZones):
        discs = zones.discs
        named = [number for number, name in zip(discs.index.tolist(), discs.ids, strict=True) if name in names]
        made = [k for k in zones.others if zones[k].covariances is not None or zones[k].id in names]
        return tuple(zones[k] for k in sorted(named + made))
    return tuple(zone for zone in zones if zone.covariances is not None or zone.id in names)


def known_until(zones: Sequence[ThreatZone]) -> float:
    """Return the time, s, until which all of some zones hold: those of observed obstacles end."""
    others = zones.others if isinstance(zones, SortedZones) else range(len(zones))
    return min((zones[k].until for k in others), default=inf)
