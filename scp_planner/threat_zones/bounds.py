"""Bounds on intervals of time: of distances to zones, and of motions and their sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index, Mask, rows_of
from scp_planner.mathematics.ellipse import ellipse_contact, support
from scp_planner.mathematics.intervals import Interval
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.pauses import GoOn
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.tolerances import NO_DIRECTION

AT_ONCE, FEWEST = 2**15, 16  # distances that are bounded at once, and of how many intervals at least
_NONE: Index = np.zeros(0, dtype=np.intp)


@dataclass(frozen=True)
class MovingPoint:
    """A point on intervals of time."""

    time: Array  # (n,) Middles on the planning clock and half widths of the intervals, s
    half: Array  # (n,) Middles on the planning clock and half widths of the intervals, s
    position: Array  # (n, 2) In the middles, planning frame, m and m/s
    velocity: Array  # (n, 2) In the middles, planning frame, m and m/s
    acceleration: Array  # (n,) Bounds of the size of the second derivative on the intervals, m/s^2


@dataclass(frozen=True)
class DistanceBounds:
    """Distances in the middles of intervals of time and lower bounds on whole intervals, (n,) m each."""

    value: Array
    lower: Array


@dataclass(frozen=True)
class _Remainders:
    """Bounds of second derivatives on all pieces of the zones' centres, and of their covariances, (L, S) each."""

    motion: Array
    growth: Array | None


@dataclass(frozen=True)
class ZoneBounds:
    """Bounds on whole intervals of time of the distances to zones, and of what these are made of."""

    batch: ZoneBatch  # The zones

    def approach(self, first: float, last: float, half: Array, speed: Array) -> Array:
        """Bound of how much nearer zones come to a moving point within half an interval, crudely."""
        batch = self.batch
        every = np.arange(batch.size)
        middle = np.full(batch.size, 0.5 * (first + last))
        radius = np.full(batch.size, 0.5 * (last - first))
        moved = _magnitude_bound(batch.velocities, every, middle, radius)
        moved[batch.turning | _broken(batch.centers, first, last)] = np.inf
        bound = half[:, None] * (moved + speed[:, None])
        if batch.covariances is not None:
            slots, count = batch.uncertain, len(batch.uncertain)
            growth = np.zeros(count)
            for order, term in enumerate(_taylor(batch.covariances.derivative, np.arange(count), middle[:count])):
                spread = np.maximum(np.abs(term[:, 0]), np.abs(term[:, 2])) + np.abs(term[:, 1])
                growth += spread * radius[0] ** order
            growth[_broken(batch.covariances, first, last)] = np.inf
            bound[:, slots] += np.sqrt(half[:, None] * growth)
        return bound

    def crude(self, moving: MovingPoint, go_on: GoOn | None = None) -> Array:
        """Lower bounds of the distance of a moving point to all zones on whole intervals of time."""
        batch, count = self.batch, len(moving.time)
        first, last = float((moving.time - moving.half).min()), float((moving.time + moving.half).max())
        remainders = _Remainders(
            batch.velocities.derivative.size_bounds(first, last),
            None if batch.covariances is None else batch.covariances.derivative.derivative.size_bounds(first, last),
        )
        edges = 0 if batch.ground is None else len(batch.ground.across)
        at_once = max(FEWEST, AT_ONCE // max(batch.size, edges, 1))
        if count <= at_once:
            return self._crude(moving, remainders)
        bound = np.empty((count, batch.size))
        for begin in range(0, count, at_once):
            if go_on is not None:
                go_on()
            some = slice(begin, begin + at_once)
            bound[some] = self._crude(rows_of(moving, some), remainders)
        return bound

    def _crude(self, moving: MovingPoint, remainders: _Remainders) -> Array:
        """Bounds from those of second derivatives at hand."""
        batch = self.batch
        times, half = moving.time, moving.half[:, None]
        centers, rates = batch.centers.grid_with_rate(times)
        dx = moving.position[:, 0, None] - centers[:, :, 0]
        dy = moving.position[:, 1, None] - centers[:, :, 1]
        squared = dx * dx
        squared += dy * dy
        everywhere, nearest = squared, float(squared.min(initial=np.inf))
        distance = np.sqrt(squared)
        slope = dx * (moving.velocity[:, 0, None] - rates[:, :, 0])
        slope += dy * (moving.velocity[:, 1, None] - rates[:, :, 1])
        np.abs(slope, out=slope)
        slope /= np.maximum(distance, 1e-150)
        bend = batch.velocities.derivative.of_pieces(remainders.motion, times) + moving.acceleration[:, None]
        bend *= 0.5 * half
        bend += slope
        bend *= half
        bound = distance - bend
        bound -= batch.radius + batch.extent
        if batch.covariances is not None and remainders.growth is not None:
            if len(batch.uncertain) < batch.size:
                dx, dy, squared = dx[:, batch.uncertain], dy[:, batch.uncertain], squared[:, batch.uncertain]
            covariance, change = batch.covariances.grid_with_rate(times)
            xx, xy, yy = dx * dx, 2.0 * dx * dy, dy * dy
            grown = np.abs(change[:, :, 0] * xx + change[:, :, 1] * xy + change[:, :, 2] * yy)
            grown *= half
            grown += covariance[:, :, 0] * xx + covariance[:, :, 1] * xy + covariance[:, :, 2] * yy
            grown /= np.maximum(squared, 1e-300)
            bent = batch.covariances.derivative.derivative.of_pieces(remainders.growth, times)
            grown += bent * (0.5 * half * half)
            np.sqrt(np.maximum(grown, 0.0, out=grown), out=grown)
            bound[:, batch.uncertain] -= grown
        if not nearest > NO_DIRECTION:
            bound[~(everywhere > NO_DIRECTION)] = -np.inf
        if batch.ground is not None:
            # Of polygons that stand the lines of their edges tell more than the discs that cover them.
            ground = batch.ground
            if len(times) * len(ground.across) > AT_ONCE:
                # What is farther than the nearest centre is far enough.
                nearest = float((distance - batch.radius).min(initial=np.inf))
                ground = ground.only(np.any(bound[:, ground.zones] < nearest, axis=0))
            some = ground.zones
            heights = ground.least_heights(moving.position, half * moving.velocity)
            heights -= 0.5 * half * half * moving.acceleration[:, None]
            bound[:, some] = np.maximum(bound[:, some], heights - batch.radius[some])
        return bound

    def fine(self, index: Index, interval: Index, moving: MovingPoint) -> DistanceBounds:
        """Distances of a moving point to chosen zones in the middles of intervals, and lower bounds on all of them."""
        batch = self.batch
        times, half = moving.time[interval], moving.half[interval]
        position, velocity = moving.position[interval], moving.velocity[interval]
        own = moving.acceleration[interval]
        if batch.outlines is None:
            return self._of_ellipses(index, times, half, position, velocity, own)
        contacts = batch.contacts(index, times, position)
        slope = np.einsum("ij,ij->i", contacts.normal, velocity) + contacts.rate
        bend = self.second_bound(index, times, half, contacts.normal, position, velocity, own)
        return DistanceBounds(contacts.distance, contacts.distance - np.abs(slope) * half - 0.5 * bend * half * half)

    def _of_ellipses(
        self, index: Index, times: Array, half: Array, position: Array, velocity: Array, acceleration: Array
    ) -> DistanceBounds:
        batch = self.batch
        center = batch.centers.taylor(index, times)
        offset, relative = position - center[:, 0], velocity - center[:, 1] if center.shape[1] > 1 else velocity
        bend = acceleration + _second_bound(np.sqrt(np.einsum("ikd,ikd->ik", center, center)), half)
        distance = np.sqrt(np.einsum("id,id->i", offset, offset))
        normal = offset / np.maximum(distance, 1e-12)[:, None]
        growth = np.zeros_like(distance)
        if batch.covariances is not None:
            rows = batch.uncertain_among(index)
            covariance = batch.covariances.taylor(batch.slot[index[rows]], times[rows])
            contact = ellipse_contact(offset[rows], covariance[:, 0])
            distance[rows], normal[rows] = contact.distance, contact.normal
            x, y = contact.normal[:, 0], contact.normal[:, 1]
            weights = np.stack([x * x, 2.0 * x * y, y * y], axis=1)
            terms = np.matmul(covariance, weights[:, :, None])[:, :, 0]
            rate, bent = _root_bounds(terms, half[rows])
            growth[rows] = rate
            bend[rows] += bent
        slope = np.abs(np.einsum("id,id->i", normal, relative) - growth)
        distance -= batch.radius[index]
        return DistanceBounds(distance, distance - (slope + 0.5 * bend * half) * half)

    def acceleration(self, index: Index, times: Array, half: Array) -> Array:
        """Bound of |centre''| of chosen zones on intervals of time, (n,) m/s^2."""
        batch = self.batch
        return _magnitude_bound(batch.velocities.derivative, index, times, half)

    def second_bound(
        self,
        index: Index,
        times: Array,
        half: Array,
        normal: Array,
        points: Array,
        velocity: Array,
        acceleration: Array,
    ) -> Array:
        """Bound of the second time derivative of nu ."""
        batch = self.batch
        bound = acceleration + self.acceleration(index, times, half)
        growth = self.growth_second_bound(index, times, half, normal)
        rows = np.flatnonzero(batch.turning[index]) if batch.any_turning else _NONE
        if len(rows) == 0:
            return bound + growth
        zone, t, h, relative = index[rows], times[rows], half[rows], bound[rows]
        spin, spin_rate = self._spin(zone, t, h)
        speed = np.hypot(*(velocity[rows] - batch.velocities.at(zone, t)).T) + relative * h
        gap = np.hypot(*(points[rows] - batch.centers.at(zone, t)).T) + speed * h
        bound[rows] += 2.0 * spin * speed + (spin * spin + spin_rate) * gap
        blurred = np.flatnonzero(batch.slot[zone] >= 0)
        if batch.covariances is not None and len(blurred):
            growth[rows[blurred]] = self._turning_growth_second_bound(
                batch.slot[zone[blurred]],
                t[blurred],
                h[blurred],
                normal[rows[blurred]],
                spin[blurred],
                spin_rate[blurred],
            )
        return bound + growth

    def _spin(self, index: Index, times: Array, half: Array) -> tuple[Array, Array]:
        """Bounds of |phi'| in 1/s and |phi''| in 1/s^2 on intervals, phi the heading of the zone."""
        batch = self.batch
        v, a, j = (
            _ranges(part, index, times, half)
            for part in (batch.directions, batch.directions.derivative, batch.directions.derivative.derivative)
        )
        least = v[0].squared().lower + v[1].squared().lower
        turn = (v[0] * a[1] - v[1] * a[0]).magnitude()
        change = (v[0] * j[1] - v[1] * j[0]).magnitude()
        gain = (v[0] * a[0] + v[1] * a[1]).magnitude()
        with np.errstate(divide="ignore", invalid="ignore"):
            spin = np.where(least > 0.0, turn / least, np.inf)
            spin_rate = np.where(least > 0.0, change / least + 2.0 * turn * gain / least**2, np.inf)
        return spin, spin_rate

    def _turning_growth_second_bound(
        self, slot: Index, times: Array, half: Array, normal: Array, spin: Array, spin_rate: Array
    ) -> Array:
        """As :meth:`growth_second_bound`, for nu that turns: with B the covariance seen from the zone, s = nu' B nu."""
        batch = self.batch
        assert batch.covariances is not None
        rate = batch.covariances.derivative
        size, speed, bend = (
            _size_bound(part, slot, times, half) for part in (batch.covariances, rate, rate.derivative)
        )
        value = support(batch.covariances.at(slot, times), normal) ** 2
        least = value - (speed + 2.0 * spin * size) * half
        second = bend + 4.0 * spin * speed + (4.0 * spin * spin + 2.0 * spin_rate) * size
        with np.errstate(invalid="ignore"):
            return np.where(least > 0.0, second / (2.0 * np.sqrt(np.maximum(least, 1e-300))), np.inf)

    def growth_second_bound(self, index: Index, times: Array, half: Array, normal: Array) -> Array:
        """Upper bound of the second time derivative of sqrt(nu' C nu) at fixed nu on intervals, (n,) m/s^2."""
        batch = self.batch
        bound = np.zeros(len(index))
        if batch.covariances is None:
            return bound
        rows = np.flatnonzero(batch.slot[index] >= 0)
        if len(rows):
            slot, x, y = batch.slot[index[rows]], normal[rows, 0], normal[rows, 1]
            weights = np.stack([x * x, 2.0 * x * y, y * y], axis=1)
            rate = batch.covariances.derivative
            value = _directed_range(batch.covariances, slot, times[rows], half[rows], weights)
            second = _directed_range(rate.derivative, slot, times[rows], half[rows], weights)
            bound[rows] = np.where(
                value.lower > 0.0,
                np.maximum(second.upper, 0.0) / (2.0 * np.sqrt(np.maximum(value.lower, 1e-300))),
                np.where(second.upper > 0.0, np.inf, 0.0),
            )
        return bound


def _ranges(polynomials: PiecewisePolynomials, index: Index, times: Array, half: Array) -> tuple[Interval, Interval]:
    """Ranges of both components of chosen polynomials on intervals."""
    terms = _taylor(polynomials, index, times)
    radius = np.zeros((len(index), 2))
    for order, term in enumerate(terms[1:], start=1):
        radius += np.abs(term) * (half**order)[:, None]
    lower, upper = terms[0] - radius, terms[0] + radius
    return Interval(lower[:, 0], upper[:, 0]), Interval(lower[:, 1], upper[:, 1])


def _size_bound(polynomials: PiecewisePolynomials, index: Index, times: Array, half: Array) -> Array:
    """Bound of the norm of packed symmetric matrices on intervals."""
    bound = np.zeros(len(index))
    for order, term in enumerate(_taylor(polynomials, index, times)):
        bound += np.sqrt(term[:, 0] ** 2 + 2.0 * term[:, 1] ** 2 + term[:, 2] ** 2) * half**order
    return bound


def _taylor(polynomials: PiecewisePolynomials, index: Index, times: Array) -> Array:
    """Taylor coefficients of chosen polynomials about their times, by their orders, (P, n, d)."""
    return polynomials.taylor(index, times).transpose(1, 0, 2)


def _broken(polynomials: PiecewisePolynomials, first: float, last: float) -> Mask:
    """True if each has a breakpoint between two times, (L,)."""
    inner = polynomials.breakpoints[:, 1:-1]
    broken: Mask = np.any((inner > first) & (inner < last), axis=1)
    return broken


def _magnitude_bound(polynomials: PiecewisePolynomials, index: Index, times: Array, half: Array) -> Array:
    bound = np.zeros(len(index))
    for order, term in enumerate(_taylor(polynomials, index, times)):
        bound += np.hypot(term[:, 0], term[:, 1]) * half**order
    return bound


def _second_bound(sizes: Array, half: Array) -> Array:
    """Bound of a second derivative on intervals by the sizes of Taylor's coefficients in the middles, (n, P)."""
    bound = np.zeros(len(half))
    for order in range(sizes.shape[1] - 1, 1, -1):
        bound *= half
        bound += (order * (order - 1)) * sizes[:, order]
    return bound


def _root_bounds(terms: Array, half: Array) -> tuple[Array, Array]:
    """The derivative of sqrt(s) in the middles of intervals, and upper bounds of the second one on all of them."""
    sizes = np.abs(terms)
    spread = np.zeros(len(half))
    for order in range(terms.shape[1] - 1, 0, -1):
        spread += sizes[:, order]
        spread *= half
    least = terms[:, 0] - spread
    upper = np.zeros(len(half))
    if terms.shape[1] > 2:
        sizes[:, 2] = 0.0
        upper = np.maximum(2.0 * terms[:, 2] + _second_bound(sizes, half), 0.0)
    bend = upper / (2.0 * np.sqrt(np.maximum(least, 1e-300)))
    bend[~(least > 0.0)] = np.inf
    bend[(upper == 0.0)] = 0.0
    rate = np.zeros(len(half))
    if terms.shape[1] > 1:
        rate = terms[:, 1] / np.maximum(2.0 * np.sqrt(np.maximum(terms[:, 0], 0.0)), 1e-300)
    return rate, bend


def _directed_range(
    polynomials: PiecewisePolynomials, index: Index, times: Array, half: Array, weights: Array
) -> Interval:
    terms = [np.einsum("ij,ij->i", weights, term) for term in _taylor(polynomials, index, times)]
    radius = np.zeros(len(index))
    for order, term in enumerate(terms[1:], start=1):
        radius += np.abs(term) * half**order
    return Interval.around(terms[0], radius)
