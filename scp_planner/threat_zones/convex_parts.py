"""The convex parts of zones: one each, but of concave polygons several."""

from __future__ import annotations

from typing import NamedTuple

from scp_planner.mathematics.outlines import Outline
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.threat_zones.zone import ThreatZone


class ConvexPart(NamedTuple):
    """One convex part of a zone, in world coordinates, about a centre of its own."""

    id: str
    radius: float
    centers: PiecewisePolynomials
    covariances: PiecewisePolynomials | None
    outline: Outline | None
    pointing: PiecewisePolynomials | None = None
    expected: PiecewisePolynomials | None = None

    @classmethod
    def all_of(cls, zone: ThreatZone) -> list[ConvexPart]:
        """Return all parts; an ellipse that neither turns nor is uncertain is one that is known to be so uncertain."""
        if not zone.outlines:
            return [cls(zone.id, zone.radius, zone.centers, zone.covariances, None, None, zone.expected)]
        found = []
        for outline, centers in zip(zone.outlines, zone.part_centers, strict=True):
            if outline.matrix is not None and not outline.turning and zone.covariances is None:
                constant = PiecewisePolynomials.single(float(zone.centers.breakpoints[0, 0]), outline.matrix[None])
                found.append(cls(zone.id, zone.radius, zone.centers, constant, None))
            else:
                expected = None if zone.expected is None else zone.expected.plus(outline.middle)
                found.append(
                    cls(zone.id, zone.radius, centers, zone.covariances, outline.centred, zone.pointing, expected)
                )
        return found
