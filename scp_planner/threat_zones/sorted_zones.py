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
    """Discs whose motion is one polynomial, as numbers.

    Attributes
    ----------
    index : (k,) array of int
        Which of all zones they are, increasing.
    ids : list of str
    radius : (k,) array
        m.
    coefficients : (k, 3, 2) array
        Of the centres, m: ascending powers of absolute time in s.
    """

    index: Index
    ids: list[str]
    radius: Array
    coefficients: Array

    @property
    def centers(self) -> PiecewisePolynomials:
        """The motions."""
        breakpoints = np.broadcast_to([0.0, np.inf], (len(self.index), 2))
        return PiecewisePolynomials(breakpoints, self.coefficients[:, None])


class SortedZones(Sequence[ThreatZone]):
    """Zones of which those that are discs with one polynomial as their motion are there as numbers, too.

    Attributes
    ----------
    discs : KnownDiscs
        Those discs.
    others : tuple of int
        Which zones are none of them, increasing.
    """

    discs: KnownDiscs
    others: tuple[int, ...]


def told_of(zones: Sequence[ThreatZone], names: Container[str]) -> tuple[ThreatZone, ...]:
    """Return what there is to be told of zones: those of some obstacles, and all that are uncertain.

    Parameters
    ----------
    zones : sequence of ThreatZone
        Discs among :class:`SortedZones` that are none of these are not made for this.
    names : container of str
        Ids of the obstacles.

    Returns
    -------
    tuple of ThreatZone
        In their order.
    """
    if isinstance(zones, SortedZones):
        discs = zones.discs
        named = [number for number, name in zip(discs.index.tolist(), discs.ids, strict=True) if name in names]
        made = [k for k in zones.others if zones[k].covariances is not None or zones[k].id in names]
        return tuple(zones[k] for k in sorted(named + made))
    return tuple(zone for zone in zones if zone.covariances is not None or zone.id in names)


def known_until(zones: Sequence[ThreatZone]) -> float:
    """Return the time, s, until which all of some zones hold: those of observed obstacles end.

    Parameters
    ----------
    zones : sequence of ThreatZone

    Returns
    -------
    float
        inf if none ends. Discs among :class:`SortedZones` never do, and need not be made for this.
    """
    others = zones.others if isinstance(zones, SortedZones) else range(len(zones))
    return min((zones[k].until for k in others), default=inf)
