"""Threat zones: where an obstacle may be, over time, with the level of confidence that was asked for.

A zone at time t is the obstacle's estimated centre + the ellipse {z : z' C(t)^-1 z <= 1} + its shape. C(t) is the
covariance of the estimate scaled by the quantile of the level (confidence.py), zero for a motion that is known.
Centres and covariances are piecewise polynomials in time.

:class:`ThreatZone` is one zone in world coordinates, to look at. :class:`ZoneBatch` holds all zones of a plan, in the
planning frame, for evaluation of many at once; inflated by the vehicle's radius its distances are those of the
vehicle's reference point.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from math import hypot
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from scp_planner.ellipse import ellipse_contact, support
from scp_planner.intervals import Interval
from scp_planner.polynomials import PiecewisePolynomials
from scp_planner.scenario import Disc, Ellipse, Motion, Obstacle, Rectangle, Scenario, Shape

if TYPE_CHECKING:
    from scp_planner.frames import PlanningFrame

Array = NDArray[np.float64]
Index = NDArray[np.intp]

HORIZON = 120.0  # s; longest trip that estimated zones are made for


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
    """

    id: str
    radius: float
    centers: PiecewisePolynomials
    covariances: PiecewisePolynomials | None = None

    def center(self, t: float | Array) -> Array:
        """Estimated centre at times ``t`` (...), s; returns (..., 2) m."""
        return self._at(self.centers, t)

    def covariance(self, t: float | Array) -> Array:
        """Scaled covariance C(t), (..., 2, 2) m^2: the uncertainty ellipse is {z : z' C^-1 z <= 1}."""
        packed = self._covariance(t)
        return packed[..., [0, 1, 1, 2]].reshape(*packed.shape[:-1], 2, 2)

    def support(self, t: float | Array, directions: Array) -> Array:
        """Support function of uncertainty and shape around the centre, without the vehicle.

        Parameters
        ----------
        t : float or (...) array
            Absolute time in s.
        directions : (..., 2) array
            Vectors in world coordinates; need not be unit vectors.

        Returns
        -------
        (...) array
            max over z in the zone of directions . (z - center), m.
        """
        directions = np.asarray(directions, dtype=float)
        return support(self._covariance(t), directions) + self.radius * np.hypot(directions[..., 0], directions[..., 1])

    def signed_distance(self, t: float | Array, points: Array) -> Array:
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
            m, negative inside.
        """
        points = np.asarray(points, dtype=float)
        offset = points - self.center(t)
        if self.covariances is None:
            return np.hypot(offset[..., 0], offset[..., 1]) - self.radius
        covariance = np.broadcast_to(self._covariance(t), (*offset.shape[:-1], 3))
        contact = ellipse_contact(offset.reshape(-1, 2), covariance.reshape(-1, 3))
        return contact.distance.reshape(offset.shape[:-1]) - self.radius

    def _covariance(self, t: float | Array) -> Array:
        if self.covariances is None:
            return np.zeros((*np.shape(t), 3))
        return self._at(self.covariances, t)

    @staticmethod
    def _at(polynomials: PiecewisePolynomials, t: float | Array) -> Array:
        times = np.atleast_1d(np.asarray(t, dtype=float))
        values = polynomials.grid(times.ravel())[:, 0]
        return values.reshape(*np.shape(t), values.shape[-1])


@dataclass(frozen=True)
class ZoneContacts:
    """Signed distances of points to chosen zones, and how they change.

    Attributes
    ----------
    distance : (n,) array
        m, negative inside.
    normal : (n, 2) array
        Unit normal nu of the supporting line, from the zone towards the point: the gradient of the distance.
    rate : (n,) array
        Time derivative of the distance at a fixed point, m/s: -(nu . centre velocity + growth of the support).
    """

    distance: Array
    normal: Array
    rate: Array


class ZoneBatch:
    """All zones of a plan, in the planning frame, for evaluation at many times at once.

    Parameters
    ----------
    zones : sequence of ThreatZone
    frame : PlanningFrame
        The planning frame (coordinates and clock).
    inflation : float
        Added to every radius, m: the vehicle's disc and the planner's own margin.
    """

    def __init__(self, zones: Sequence[ThreatZone], frame: PlanningFrame, inflation: float) -> None:
        self.ids = tuple(zone.id for zone in zones)
        self.size = len(zones)
        self.radius = np.array([zone.radius for zone in zones]) + inflation
        self.centers = frame.points_batch([zone.centers for zone in zones])
        self.velocities = self.centers.derivative
        uncertain = [index for index, zone in enumerate(zones) if zone.covariances is not None]
        self.uncertain: Index = np.array(uncertain, dtype=np.intp)
        self.slot = np.full(self.size, -1, dtype=np.intp)
        self.slot[self.uncertain] = np.arange(len(uncertain))
        self.covariances: PiecewisePolynomials | None = None
        if uncertain:
            self.covariances = frame.covariances_batch(
                [zone.covariances for zone in zones if zone.covariances is not None]
            )

    def subset(self, index: Index) -> ZoneBatch:
        """Return the batch of some of the zones."""
        batch = object.__new__(ZoneBatch)
        batch.ids = tuple(self.ids[i] for i in index)
        batch.size = len(index)
        batch.radius = self.radius[index]
        batch.centers = self.centers.take(index)
        batch.velocities = batch.centers.derivative
        slots = self.slot[index]
        batch.uncertain = np.flatnonzero(slots >= 0)
        batch.slot = np.full(batch.size, -1, dtype=np.intp)
        batch.slot[batch.uncertain] = np.arange(len(batch.uncertain))
        batch.covariances = None
        if self.covariances is not None and len(batch.uncertain):
            batch.covariances = self.covariances.take(slots[batch.uncertain])
        return batch

    def inflated(self, extra: Array) -> ZoneBatch:
        """Return the batch with every zone larger by ``extra``, (L,) m."""
        batch = copy(self)
        batch.radius = self.radius + extra
        return batch

    def distances(self, times: Array, points: Array, exact_below: float = np.inf) -> Array:
        """Signed distances of one moving point to all zones.

        Parameters
        ----------
        times : (n,) array
            Seconds on the planning clock.
        points : (n, 2) array
            Planning frame, m.
        exact_below : float
            Distances above this may be replaced by lower bounds that are still above it, or below their true value, m.

        Returns
        -------
        (n, L) array
            m, negative inside.
        """
        centers = self.centers.grid(times)
        dx = points[:, 0, None] - centers[:, :, 0]
        dy = points[:, 1, None] - centers[:, :, 1]
        squared = dx * dx
        squared += dy * dy
        distance = np.sqrt(squared)
        if self.covariances is not None:
            columns = self.uncertain
            covariance = self.covariances.grid(times)
            # The support in the direction of the centre gives a lower bound; exact only where that is close.
            offset = np.stack([dx[:, columns], dy[:, columns]], axis=-1)
            length = np.maximum(distance[:, columns], 1e-300)
            bound = length - support(covariance, offset / length[..., None])
            near = bound < exact_below + self.radius[columns]
            if near.any():
                bound[near] = ellipse_contact(offset[near], covariance[near]).distance
            distance[:, columns] = bound
        distance -= self.radius
        return distance

    def reach(self, times: Array) -> Array:
        """Radius of a disc around the centre that covers each zone at each time, (n, L) m."""
        radius = np.broadcast_to(self.radius, (len(times), self.size))
        if self.covariances is None:
            return radius
        covariance = self.covariances.grid(times)
        mean = 0.5 * (covariance[..., 0] + covariance[..., 2])
        spread = np.hypot(0.5 * (covariance[..., 0] - covariance[..., 2]), covariance[..., 1])
        radius = radius.copy()
        radius[:, self.uncertain] += np.sqrt(np.maximum(mean + spread, 0.0))
        return radius

    def contacts(self, index: Index, times: Array, points: Array) -> ZoneContacts:
        """Exact contacts of points with chosen zones.

        Parameters
        ----------
        index : (n,) array of int
            Which zone.
        times : (n,) array
            Planning clock, s.
        points : (n, 2) array
            Planning frame, m.
        """
        offset = points - self.centers.at(index, times)
        distance = np.sqrt(offset[:, 0] ** 2 + offset[:, 1] ** 2)
        normal = offset / np.maximum(distance, 1e-12)[:, None]
        rate = -np.einsum("ij,ij->i", normal, self.velocities.at(index, times))
        if self.covariances is not None:
            rows = np.flatnonzero(self.slot[index] >= 0)
            if len(rows):
                slot = self.slot[index[rows]]
                covariance = self.covariances.at(slot, times[rows])
                exact = ellipse_contact(offset[rows], covariance)
                growth = _support_rate(covariance, self.covariances.derivative.at(slot, times[rows]), exact.normal)
                velocity = self.velocities.at(index[rows], times[rows])
                normal[rows] = exact.normal
                distance[rows] = exact.distance
                rate[rows] = -np.einsum("ij,ij->i", exact.normal, velocity) - growth
        return ZoneContacts(distance - self.radius[index], normal, rate)

    def acceleration_bound(self, index: Index, times: Array, half: Array) -> Array:
        """Bound of |centre''| of chosen zones on intervals of time, (n,) m/s^2.

        Parameters
        ----------
        index : (n,) array of int
        times, half : (n,) arrays
            Middles and half widths of the intervals, s.
        """
        return _magnitude_bound(self.velocities.derivative, index, times, half)

    def growth_bend_bound(self, index: Index, times: Array, half: Array, normal: Array) -> Array:
        """Upper bound of the second time derivative of sqrt(nu' C nu) at fixed nu on intervals, (n,) m/s^2.

        With s = nu' C nu, (sqrt s)'' <= max(s'', 0) / (2 sqrt s), since the other term is negative.
        """
        bound = np.zeros(len(index))
        if self.covariances is None:
            return bound
        rows = np.flatnonzero(self.slot[index] >= 0)
        if len(rows):
            slot, x, y = self.slot[index[rows]], normal[rows, 0], normal[rows, 1]
            weights = np.stack([x * x, 2.0 * x * y, y * y], axis=1)
            rate = self.covariances.derivative
            value = _directed_range(self.covariances, slot, times[rows], half[rows], weights)
            second = _directed_range(rate.derivative, slot, times[rows], half[rows], weights)
            bound[rows] = np.where(
                value.lower > 0.0,
                np.maximum(second.upper, 0.0) / (2.0 * np.sqrt(np.maximum(value.lower, 1e-300))),
                np.where(second.upper > 0.0, np.inf, 0.0),
            )
        return bound


def _taylor(polynomials: PiecewisePolynomials, index: Index, times: Array) -> list[Array]:
    """Taylor coefficients, (n, d) each, of chosen polynomials about their times."""
    terms, factor = [], 1.0
    for order in range(polynomials.coefficients.shape[2]):
        terms.append(polynomials.at(index, times) / factor)
        polynomials = polynomials.derivative
        factor *= order + 1
    return terms


def _magnitude_bound(polynomials: PiecewisePolynomials, index: Index, times: Array, half: Array) -> Array:
    terms = _taylor(polynomials, index, times)
    bound = np.zeros(len(index))
    for order, term in enumerate(terms):
        bound += np.hypot(term[:, 0], term[:, 1]) * half**order
    return bound


def _directed_range(
    polynomials: PiecewisePolynomials, index: Index, times: Array, half: Array, weights: Array
) -> Interval:
    terms = [np.einsum("ij,ij->i", weights, term) for term in _taylor(polynomials, index, times)]
    radius = np.zeros(len(index))
    for order, term in enumerate(terms[1:], start=1):
        radius += np.abs(term) * half**order
    return Interval.around(terms[0], radius)


def _support_rate(covariance: Array, covariance_rate: Array, normal: Array) -> Array:
    """Time derivative of sqrt(nu' C nu) at a fixed nu."""
    x, y = normal[:, 0], normal[:, 1]
    quadratic_rate = covariance_rate[:, 0] * x * x + 2.0 * covariance_rate[:, 1] * x * y + covariance_rate[:, 2] * y * y
    return quadratic_rate / np.maximum(2.0 * support(covariance, normal), 1e-300)


def zones(scenario: Scenario) -> tuple[ThreatZone, ...]:
    """Return the threat zone of every obstacle of a scenario, in order.

    Parameters
    ----------
    scenario : Scenario
        Its ``confidence`` names the level that the zones of estimated obstacles hold from ``start.time`` on.

    Returns
    -------
    tuple of ThreatZone

    Raises
    ------
    ScenarioError
        If an obstacle's motion cannot be estimated, or its shape is not supported.
    """
    estimated = sum(obstacle.observations is not None for obstacle in scenario.obstacles)
    return tuple(_zone(obstacle, scenario, estimated) for obstacle in scenario.obstacles)


def _zone(obstacle: Obstacle, scenario: Scenario, estimated: int) -> ThreatZone:
    radius = covering_radius(obstacle.shape) + obstacle.margin
    if obstacle.motion is not None:
        return ThreatZone(obstacle.id, radius, motion_polynomials(obstacle.motion))
    from scp_planner.confidence import region_scale
    from scp_planner.estimation import estimate_obstacle

    estimate = estimate_obstacle(obstacle)
    start = scenario.start.time
    scale = region_scale(
        str(scenario.confidence.level),
        scenario.confidence.probability,
        estimate,
        obstacles=estimated,
        start=start,
        stop=start + HORIZON,
    )
    pieces = estimate.polynomials(start, start + HORIZON)
    return ThreatZone(
        obstacle.id,
        radius + pieces.center_error,
        PiecewisePolynomials(pieces.breakpoints[None], pieces.center[None]),
        PiecewisePolynomials(pieces.breakpoints[None], scale * pieces.covariance[None]),
    )


def motion_polynomials(motion: Motion) -> PiecewisePolynomials:
    """The centre of a motion that is known, of absolute time."""
    half = (0.5 * motion.acceleration[0], 0.5 * motion.acceleration[1])
    return PiecewisePolynomials.single(0.0, np.array([motion.position, motion.velocity, half]))


def covering_radius(shape: Shape) -> float:
    """Radius of the disc around an obstacle's centre that covers its shape, m."""
    if isinstance(shape, Disc):
        return shape.disc
    if isinstance(shape, Rectangle):
        return 0.5 * hypot(*shape.rectangle)
    if isinstance(shape, Ellipse):
        return max(shape.ellipse)
    return max(hypot(*vertex) for vertex in shape.polygon)
