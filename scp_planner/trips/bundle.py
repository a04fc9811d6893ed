"""Several trips of one space at once.

The arrays of a trip are so small that a call of numpy costs more than its arithmetic. So trips that are looked at
together, such as those of several starts, share the calls: their points lie in one long list, with the number of the
trip that each belongs to, its *owner*. Owners are sorted.
"""

# NUMPY-CALLS: shaped by the cost of numpy calls alone

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.splines import evaluate
from scp_planner.trips.path import (
    PathBend,
    PathPoints,
    bend_from,
    curvature_rate_from,
    inverted,
    points_from,
    station_bend,
)
from scp_planner.trips.space import TimeTable, TripSpace
from scp_planner.trips.trajectory import STILL, Arrivals, Trajectory, TripPoints


def stacked(arrays: Sequence[Array]) -> Array:
    """Arrays of one shape, (...), as one, (K, ...)."""
    return arrays[0][None] if len(arrays) == 1 else np.array(arrays)


class TripBundle:
    """Trips of one space.

    Parameters
    ----------
    trips : sequence of Trajectory
        At least one.
    """

    def __init__(self, trips: Sequence[Trajectory]) -> None:
        self.trips = trips
        self.count = len(trips)
        self.space: TripSpace = trips[0].space
        self.single = self.count == 1
        paths = [trip.path for trip in trips]
        self.paths = paths
        if self.single:
            self.betas, self.thetas = trips[0].beta[None], paths[0].theta[None]
            self.travel_times = np.array([trips[0].travel_time])
        else:
            self.betas = np.array([trip.beta for trip in trips])
            self.thetas = np.array([path.theta for path in paths])
            self.travel_times = np.array([trip.travel_time for trip in trips])
            self._arc_lengths = np.array([path.arc_length for path in paths])
            self._until = np.array([path.until for path in paths])
            self._cells = np.concatenate([path.cells for path in paths])
            # Arc lengths of one trip after the other, on one axis
            self._lift = 1.0 + 2.0 * float(self._arc_lengths.max())
            self._ends = (self._until[:, 1:-1] + self._lift * np.arange(self.count)[:, None]).ravel()

    def of(self, values: Array, owner: Index) -> Array | float:
        """Values of the trips, (K,), for points with owners: a number if there is one trip."""
        return float(values[0]) if self.single else values[owner]

    def owners(self, each: int) -> Index:
        """Owners of the points if there are equally many of each trip."""
        return np.arange(self.count).repeat(each)

    def bounds(self, owner: Index) -> list[int]:
        """Where the points of each trip begin, and where the last ones end."""
        return [0, len(owner)] if self.single else owner.searchsorted(np.arange(self.count + 1)).tolist()

    @property
    def top_speeds(self) -> Array:
        """Bounds of the speeds after the start, (K,) m/s: their largest control points."""
        later = self.space.tables.speed_control[1:]
        return self.space.start_speed + self.travel_times * (self.betas @ later.T).max(axis=1)

    def _place(self, index: Index, owner: Index, stride: int) -> Index:
        return index if self.single else index + stride * owner

    def at_each(self, table: TimeTable) -> TripPoints:
        """Return all trips at the times of a table; the table of the points is that of one trip."""
        tau, v0 = self.travel_times[:, None], self.space.start_speed
        distance = self.betas @ table.distance.T
        distance *= tau * tau
        distance += (v0 * tau) * table.sigma
        speed = self.betas @ table.speed.T
        speed *= tau
        speed += v0
        owner = self.owners(len(table.sigma))
        distance = distance.ravel()
        parameter = self.parameter_at(owner, distance)
        return TripPoints(
            table,
            (tau * table.sigma).ravel(),
            distance,
            speed.ravel(),
            (self.betas @ table.acceleration.T).ravel(),
            parameter,
            self.points(owner, parameter),
        )

    def at(self, owner: Index, sigma: Array) -> TripPoints:
        """Return trips at normalised times, (n,)."""
        if self.single:
            return self.trips[0].at(self.space.time_table(sigma))
        table, v0 = self.space.time_table(sigma), self.space.start_speed
        tau, beta = self.travel_times[owner], self.betas[owner]
        distance = np.einsum("ij,ij->i", table.distance, beta)
        distance *= tau * tau
        distance += (v0 * tau) * sigma
        speed = np.einsum("ij,ij->i", table.speed, beta)
        speed *= tau
        speed += v0
        parameter = self.parameter_at(owner, distance)
        return TripPoints(
            table,
            tau * sigma,
            distance,
            speed,
            np.einsum("ij,ij->i", table.acceleration, beta),
            parameter,
            self.points(owner, parameter),
        )

    def accelerations(self, owner: Index, table: TimeTable) -> Array:
        """Accelerations of trips at the times of a table, (n,) m/s^2."""
        if self.single:
            return table.acceleration @ self.trips[0].beta
        return np.einsum("ij,ij->i", table.acceleration, self.betas[owner])

    def parameter_at(self, owner: Index, distance: Array) -> Array:
        """Normalised stations where the arc lengths equal distances, (n,) m; clamped at the ends."""
        if self.single:
            return self.paths[0].parameter_at(distance)
        distance = np.minimum(np.maximum(distance, 0.0), self._arc_lengths[owner])
        cells = self.space.tables.cells
        place = self._ends.searchsorted(distance + self._lift * owner, "right")  # cells - 1 ends a trip
        # Rounding on the common axis must not lead to a neighbour's cells.
        cell = np.minimum(np.maximum(place - (cells - 1) * owner, 0), cells - 1)
        x = inverted(self._cells.T[:, cell + cells * owner], distance - self._until.ravel()[cell + (cells + 1) * owner])
        return (cell + x) / cells

    def arc_length_at(self, owner: Index, parameters: Array) -> Array:
        """Arc length up to normalised stations, (n,) m."""
        if self.single:
            return self.paths[0].arc_length_at(parameters)
        cells = self.space.tables.cells
        scaled = np.clip(parameters, 0.0, 1.0) * cells
        cell = np.minimum(scaled.astype(np.intp), cells - 1)
        x = scaled - cell
        until = self._until.ravel()[cell + (cells + 1) * owner]
        return until + x * evaluate(self._cells, cell + cells * owner, x)

    @cached_property
    def _offsets(self) -> Array:
        return np.concatenate([path.offset_coefficients for path in self.paths])

    def points(self, owner: Index, parameters: Array) -> PathPoints:
        """Return the paths at normalised stations, (n,)."""
        span, x = self.space.path.locate(parameters)
        place = self._place(span, owner, len(self.space.path.widths))
        return points_from(self.space, parameters, span, x, self._offsets.T[:, place])

    @cached_property
    def _bends(self) -> Array:
        return np.concatenate([path.bend_coefficients for path in self.paths])

    def bend(self, owner: Index, points: PathPoints) -> PathBend:
        """Return the curvature at points, with its derivatives."""
        place = self._place(points.span, owner, len(self.space.path.widths))
        return bend_from(self.space, points, evaluate(self._bends, place, points.local))

    def curvature_rate(self, owner: Index, points: PathPoints) -> Array:
        """Rate of the curvature along the station, (n,) 1/m^2."""
        place = self._place(points.span, owner, len(self.space.path.widths))
        third = np.concatenate([path.third_coefficients for path in self.paths])
        return curvature_rate_from(
            self.space,
            points,
            evaluate(self._bends, place, points.local),
            evaluate(third, place, points.local),
        )

    @cached_property
    def station_bend(self) -> PathBend:
        """Curvature at the fixed stations, with its derivatives; all (K, M) but those that are 0."""
        if self.single:
            bend = self.paths[0].station_bend
            return PathBend(*(getattr(bend, name)[None] for name in ("curvature", "value", "slope", "bend")))
        return station_bend(self.space, self.thetas)

    def arrivals_each(self, distances: Array) -> Arrivals:
        """When, and how fast, each vehicle has driven its distances, (K, n) m; results are flat."""
        return self.arrivals(self.owners(distances.shape[1]), distances.ravel())

    def arrivals(self, owner: Index, distance: Array) -> Arrivals:
        """When, and how fast, the vehicles have driven distances, (n,) m."""
        if self.single:
            return self.trips[0].arrivals(distance)
        tables, v0 = self.space.tables, self.space.start_speed
        if not tables.constant:
            return self._trip_by_trip(owner, distance)
        breaks, tau = tables.breaks, self.travel_times[:, None]
        driven = (v0 * tau) * breaks.sigma + (tau * tau) * (self.betas @ breaks.distance.T)
        speeds = np.maximum(v0 + tau * (self.betas @ breaks.speed.T), 0.0)
        spans = len(breaks.sigma) - 1
        lift = 1.0 + 2.0 * float(np.abs(driven).max())
        ends = (driven[:, 1:-1] + lift * np.arange(self.count)[:, None]).ravel()
        limited = np.minimum(np.maximum(distance, 0.0), 0.5 * lift)
        place = ends.searchsorted(limited + lift * owner, "right")
        span = np.minimum(np.maximum(place - (spans - 1) * owner, 0), spans - 1)
        row = span + (spans + 1) * owner
        start, target = speeds.ravel()[row], np.maximum(distance - driven.ravel()[row], 0.0)
        # D = v t + a t^2 / 2 from the span's start, in the form that loses no digits
        acceleration = self.betas.ravel()[span + spans * owner]
        speed = np.sqrt(np.maximum(start * start + 2.0 * acceleration * target, 0.0))
        elapsed = 2.0 * target / np.maximum(start + speed, STILL)
        sigma = breaks.sigma[span] + elapsed / self.travel_times[owner]
        return Arrivals(np.minimum(sigma, breaks.sigma[span + 1]), speed)

    def _trip_by_trip(self, owner: Index, distance: Array) -> Arrivals:
        bounds = self.bounds(owner)
        parts = [
            trip.arrivals(distance[first:last])
            for trip, (first, last) in zip(self.trips, pairwise(bounds), strict=True)
        ]
        return Arrivals(np.concatenate([part.sigma for part in parts]), np.concatenate([part.speed for part in parts]))

    @cached_property
    def station_arc_lengths(self) -> Array:
        """Arc lengths up to the fixed stations, (K, M) m."""
        return self.paths[0].until[None] if self.single else self._until

    def station_gradients(self, owner: Index, stations: Index) -> Array:
        """Derivatives of the arc length up to some fixed stations with respect to theta, (n, K1)."""
        until = self._gradients[0]
        return until[self._place(stations, owner, self.space.tables.cells + 1)]

    def arc_length_gradient(self, owner: Index, parameters: Array) -> Array:
        """Derivatives of the arc length up to normalised stations with respect to theta, (n, K1)."""
        tables = self.space.tables
        cell, weights = tables.located(parameters)
        until, nodes = self._gradients
        partial = np.matmul(weights[:, None, :], nodes[self._place(cell, owner, tables.cells)])[:, 0, :]
        return until[self._place(cell, owner, tables.cells + 1)] + partial

    @cached_property
    def _gradients(self) -> tuple[Array, Array]:
        """See :class:`Path`, of all paths one after the other."""
        if self.single:
            return self.paths[0].gradients
        parts = [path.gradients for path in self.paths]
        return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])

    def split(self, points: TripPoints, owner: Index) -> list[TripPoints]:
        """Return the points of each trip."""
        if self.single:
            return [points]
        bounds = self.bounds(owner)
        return [points.take(slice(first, last)) for first, last in pairwise(bounds)]

    def split_each(self, points: TripPoints) -> list[TripPoints]:
        """Return the points of each trip, those of :meth:`at_each`."""
        if self.single:
            return [points]
        each = len(points.table.sigma)
        return [points.part(slice(k * each, (k + 1) * each), points.table) for k in range(self.count)]
