"""The zone of one obstacle."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.mathematics.ellipse import ellipse_contact, support
from scp_planner.mathematics.frames import covariance_turned_back, directions_of, turned_back
from scp_planner.mathematics.outlines import Outline, Outlines
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.scenario.units import NaturalUnits


def by_obstacle(zones: Iterable[ThreatZone]) -> dict[str, list[ThreatZone]]:
    """Return zones by the ids of their obstacles, in order: several of an obstacle of several futures."""
    several: dict[str, list[ThreatZone]] = {}
    for zone in zones:
        several.setdefault(zone.id, []).append(zone)
    return several


@dataclass(frozen=True)
class ThreatZone:
    """The zone of one obstacle, in world coordinates and absolute time.

    Attributes
    ----------
    id : str
        The obstacle's id.
    radius : float
        Radius of the obstacle's disc plus its extra margin, m.
    centers : PiecewisePolynomials
        Estimated centre, m, of absolute time in s.
    covariances : PiecewisePolynomials or None
        (xx, xy, yy) of the scaled covariance C(t), m^2; None where the motion is known.
    outlines : tuple of Outline
        Convex pieces of the shape about the centre, in world directions unless they turn; none for a disc.
    pointing : PiecewisePolynomials or None
        What moves in the direction that turning outlines head in, at about 1 m/s in whatever units, of absolute time;
        None: as the centre does.
    expected : PiecewisePolynomials or None
        Predicted mean, m, where the zone is cut to what the obstacle can reach; None: the centres.
    until : float
        Absolute time up to which the zone is known to hold the obstacle, s; inf where that is for ever.
    """

    id: str
    radius: float
    centers: PiecewisePolynomials
    covariances: PiecewisePolynomials | None = None
    outlines: tuple[Outline, ...] = ()
    pointing: PiecewisePolynomials | None = None
    until: float = inf
    expected: PiecewisePolynomials | None = None

    @cached_property
    def part_centers(self) -> tuple[PiecewisePolynomials, ...]:
        """Centres of the outlines, m."""
        return tuple(self.centers.plus(outline.middle) for outline in self.outlines)

    def __repr__(self) -> str:
        shape = f"disc of {self.radius:.4g} m" if not self.outlines else f"{len(self.outlines)} convex outlines"
        grows = "known motion" if self.covariances is None else "uncertain motion"
        return f"ThreatZone({self.id!r}, {shape}, {grows})"

    def inside(self, units: NaturalUnits) -> ThreatZone:
        """Return the zone in the units of its scene."""
        if units.are_those_of_the_user:
            return self
        x, y = units.origin
        local = replace(
            self,
            centers=self.centers.shifted(units.clock).plus((-x, -y)),
            covariances=None if self.covariances is None else self.covariances.shifted(units.clock),
            pointing=None if self.pointing is None else self.pointing.shifted(units.clock),
            expected=None if self.expected is None else self.expected.shifted(units.clock).plus((-x, -y)),
        )
        return replace(_in_units(local, 1.0 / units.length, 1.0 / units.time), until=units.instant(self.until))

    def outside(self, units: NaturalUnits) -> ThreatZone:
        """Return a zone in the units of its scene in SI units."""
        if units.are_those_of_the_user:
            return self
        local = _in_units(self, units.length, units.time)
        return replace(
            local,
            centers=local.centers.plus(units.origin).shifted(-units.clock),
            covariances=None if local.covariances is None else local.covariances.shifted(-units.clock),
            pointing=None if local.pointing is None else local.pointing.shifted(-units.clock),
            expected=None if local.expected is None else local.expected.plus(units.origin).shifted(-units.clock),
            until=units.absolute(self.until),
        )

    def center(self, t: float | Array) -> Array:
        """Estimated centre at times ``t`` (...), s; returns (..., 2) m."""
        return self._at(self.centers, t)

    def covariance(self, t: float | Array) -> Array:
        """Scaled covariance C(t), (..., 2, 2) m^2: the uncertainty ellipse is {z : z' C^-1 z <= 1}."""
        packed = self._covariance(t)
        return packed[..., [0, 1, 1, 2]].reshape(*packed.shape[:-1], 2, 2)

    def heading_vector(self, t: float | Array) -> Array:
        """Unit vector that turning outlines head along at times ``t`` (...), s; returns (..., 2)."""
        return directions_of(self._at((self.pointing or self.centers).derivative, t))

    def support(self, t: float | Array, directions: ArrayLike) -> Array:
        """Support function of uncertainty and shape around the centre, without the vehicle.

        Parameters
        ----------
        t : float or (...) array
            Absolute time in s.
        directions : (..., 2) array
            Vectors in world coordinates, without a unit; need not be of length 1.

        Returns
        -------
        (...) array
            max over z in the zone of directions . (z - center), m.
        """
        directions = np.asarray(directions, dtype=float)
        value = support(self._covariance(t), directions) + self.radius * np.hypot(
            directions[..., 0], directions[..., 1]
        )
        if not self.outlines:
            return value
        if self.outlines[0].turning:
            directions = turned_back(directions, self.heading_vector(t))
        supports: Array = value + np.max([outline.support(directions) for outline in self.outlines], axis=0)
        return supports

    def signed_distance(self, t: float | Array, points: ArrayLike) -> Array:
        """Signed distance of points to the zone (uncertainty + shape, without the vehicle).

        Parameters
        ----------
        t : float or (...) array
            Absolute time in s.
        points : (..., 2) array
            World coordinates in m.

        Returns
        -------
        (...) array
            m, negative inside; there, of a concave polygon, to the border of its deepest convex piece.
        """
        points = np.asarray(points, dtype=float)
        if self.outlines:
            return self._outline_distance(t, points)
        offset = points - self.center(t)
        if self.covariances is None:
            return np.hypot(offset[..., 0], offset[..., 1]) - self.radius
        covariance = np.broadcast_to(self._covariance(t), (*offset.shape[:-1], 3))
        contact = ellipse_contact(offset.reshape(-1, 2), covariance.reshape(-1, 3))
        return contact.distance.reshape(offset.shape[:-1]) - self.radius

    def _outline_distance(self, t: float | Array, points: Array) -> Array:
        times = np.broadcast_to(np.asarray(t, dtype=float), points.shape[:-1])
        if times.size == 0:
            return np.zeros(points.shape[:-1])
        offset = (points - self.center(times)).reshape(-1, 2)
        covariance = None if self.covariances is None else self._covariance(times).reshape(-1, 3)
        if self.outlines[0].turning:
            headings = self.heading_vector(times).reshape(-1, 2)
            offset = turned_back(offset, headings)
            covariance = None if covariance is None else covariance_turned_back(covariance, headings)
        pieces = Outlines(self.outlines)
        distances = [
            pieces.contacts(np.full(len(offset), piece), offset, covariance).distance for piece in range(pieces.size)
        ]
        nearest: Array = np.min(distances, axis=0) - self.radius
        return nearest.reshape(points.shape[:-1])

    def _covariance(self, t: float | Array) -> Array:
        if self.covariances is None:
            return np.zeros((*np.shape(t), 3))
        return self._at(self.covariances, t)

    @staticmethod
    def _at(polynomials: PiecewisePolynomials, t: float | Array) -> Array:
        times = np.atleast_1d(np.asarray(t, dtype=float))
        values = polynomials.grid(times.ravel())[:, 0]
        return values.reshape(*np.shape(t), values.shape[-1])


def _in_units(zone: ThreatZone, length: float, time: float) -> ThreatZone:
    """The zone where lengths are so many times as large, and times too."""
    return ThreatZone(
        zone.id,
        zone.radius * length,
        zone.centers.in_units(length, time),
        None if zone.covariances is None else zone.covariances.in_units(length * length, time),
        tuple(outline.in_units(length) for outline in zone.outlines),
        None if zone.pointing is None else zone.pointing.in_units(time, time),
        expected=None if zone.expected is None else zone.expected.in_units(length, time),
    )
