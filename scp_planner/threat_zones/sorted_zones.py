"""Zones of a scenario, discs among them as numbers: many are put together at once."""

from __future__ import annotations

from collections.abc import Sequence
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
