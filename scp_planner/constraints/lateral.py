"""Lateral acceleration v^2 k, k the curvature of the path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from scp_planner.arrays import Array, joined
from scp_planner.constraints.constraint import Constraint, LastTrip, TwoSidedLimit
from scp_planner.constraints.curvature import OPPOSITE, curvature_gradient
from scp_planner.constraints.rows import Rows
from scp_planner.constraints.setup import Setup
from scp_planner.trips.path import PathBend
from scp_planner.trips.space import TimeTable
from scp_planner.trips.trajectory import Trajectory, TripPoints

PEAK_REACH = 0.8  # of the limit; lower peaks of the lateral acceleration between stations are not looked at
PEAK_NEIGHBOURS = np.linspace(-0.6, 0.6, 7)  # stations: a peak moves when it is pressed down in one place
PARTS = 4  # of the way from station to station over a curved guide, at the ends of which peaks are looked for
QUIET = 0.8  # of the limit; if no station is above, nothing between stations is looked at
_NOWHERE: Array = np.zeros(0)


@dataclass(frozen=True)
class StationSites:
    """A trip at normalised stations, (n,): curvature, normalised time, m/s."""

    parameters: Array
    bend: PathBend
    sigma: Array
    speed: Array

    @property
    def lateral(self) -> Array:
        """Lateral acceleration, (n,) m/s^2, signed."""
        return self.speed * self.speed * self.bend.curvature


def station_sites(trip: Trajectory, parameters: Array) -> StationSites:
    """Return a trip at normalised stations, (n,)."""
    path = trip.path
    arrivals = trip.arrivals(path.arc_length_at(parameters))
    return StationSites(parameters, path.bend(path.points(parameters)), arrivals.sigma, arrivals.speed)


def fixed_sites(trip: Trajectory) -> StationSites:
    """Return a trip at its fixed stations, (M,)."""
    path = trip.path
    arrivals = trip.arrivals(path.station_arc_lengths)
    return StationSites(trip.space.tables.station_parameters, path.station_bend, arrivals.sigma, arrivals.speed)


@dataclass(frozen=True)
class _Basis:
    """Rows of the offset's basis (B, B', B'') and of dS/dtheta at stations, over all control points."""

    rows: Array
    slopes: Array
    bends: Array
    arc_length: Array

    @classmethod
    def at(cls, trip: Trajectory, parameters: Array) -> _Basis:
        space = trip.space
        span, local = space.path.locate(parameters)
        side_by_side = space.tables.bending.rows_at(span, local)
        rows, slopes, bends = (side_by_side[:, k * space.path_size : (k + 1) * space.path_size] for k in range(3))
        return cls(rows, slopes, bends, trip.path.arc_length_gradient(parameters))

    @classmethod
    def fixed(cls, trip: Trajectory) -> _Basis:
        tables = trip.space.tables
        return cls(tables.station_rows, tables.station_slopes, tables.station_bends, trip.path.station_gradients)


@dataclass(frozen=True)
class Look:
    stations: StationSites  # the fixed ones
    peaks: StationSites  # stations between them, around peaks
    jumps: TripPoints | None  # where the acceleration jumps: the speed peaks there
    jump_bend: PathBend  # curvature there
    worst: float  # largest lateral acceleration, m/s^2, also where it is not followed

    @property
    def jump_lateral(self) -> Array:
        """Lateral acceleration at the jumps, (n,) m/s^2, signed."""
        return _NOWHERE if self.jumps is None else self.jumps.speed * self.jumps.speed * self.jump_bend.curvature


@dataclass(frozen=True)
class LateralAcceleration(TwoSidedLimit):
    """Excess v^2 |k| / limit - 1 at stations, around peaks between them, at jumps of the acceleration."""

    name: ClassVar[str] = "lateral_acceleration"
    near: ClassVar[float] = 1.0 + OPPOSITE

    _last: LastTrip[Look] = field(default_factory=LastTrip, init=False, repr=False, compare=False)

    def smooth(self, times: TimeTable) -> Constraint:
        return SampledLateralAcceleration(self.setup, self.limit, times)

    def look(self, trip: Trajectory) -> Look:
        """Return the places of a trip."""
        return self._last.of(trip, self._look)

    def _look(self, trip: Trajectory) -> Look:
        stations = fixed_sites(trip)
        lateral = np.abs(stations.lateral)
        if lateral.max() < QUIET * self.limit:
            return Look(stations, _NO_STATIONS, None, _NO_BEND, float(lateral.max()))
        if not self.setup.space.guide.straight:
            lateral = _with_parts(trip, lateral)
        around = _peaks(lateral, PEAK_REACH * self.limit, len(stations.parameters))
        peaks = station_sites(trip, around) if len(around) else _NO_STATIONS
        jumps = self._jumps(trip, self.setup.samples)
        return Look(stations, peaks, jumps, trip.path.bend(jumps.path), float(lateral.max()))

    def _jumps(self, trip: Trajectory, times: TimeTable) -> TripPoints:
        return trip.kept_at(times).take(slice(self.setup.grid, len(self.setup.samples.sigma)))

    def use(self, trip: Trajectory) -> Array:
        look = self.look(trip)
        return np.concatenate([look.stations.lateral, look.peaks.lateral, look.jump_lateral]) / self.limit

    def worst(self, trip: Trajectory, excess: Array) -> Array:
        """Return the largest excess, (1,), also of places that are not followed."""
        return np.maximum(super().worst(trip, excess), self.look(trip).worst / self.limit - 1.0)

    def rows(self, trip: Trajectory, excess: Array) -> Rows:
        """Return the rows of both sides, with keys that do not depend on how many peaks there are."""
        look, rows = self.look(trip), super().rows(trip, excess)
        counts = (len(look.stations.parameters), len(look.peaks.parameters), len(look.jump_lateral))
        key = np.concatenate([3 * np.arange(count) + kind for kind, count in enumerate(counts)])
        lower, place = np.divmod(rows.key, len(key))
        return Rows(rows.matrix, rows.gap, rows.group, 2 * key[place] + lower)

    def slopes(self, trip: Trajectory) -> Array:
        look = self.look(trip)
        sites, basis = look.stations, _Basis.fixed(trip)
        if len(look.peaks.parameters):
            sites, basis = joined([sites, look.peaks]), joined([basis, _Basis.at(trip, look.peaks.parameters)])
        gradient = self._at_stations(trip, sites, basis)
        if look.jumps is not None and len(look.jumps.time):
            gradient = np.concatenate([gradient, gradient_at_times(self.setup, trip, look.jumps, look.jump_bend)])
        gradient /= self.limit
        return gradient

    def _at_stations(self, trip: Trajectory, sites: StationSites, basis: _Basis) -> Array:
        space, tau, v0 = self.setup.space, trip.travel_time, self.setup.space.start_speed
        table = space.time_table(sites.sigma)
        v, curvature = sites.speed, sites.bend.curvature
        a = table.acceleration @ trip.beta
        theta = (v * v)[:, None] * curvature_gradient(self.setup, sites.bend, basis.rows, basis.slopes, basis.bends)
        theta += (2.0 * curvature * a)[:, None] * basis.arc_length[:, self.setup.ends.free]
        beta = (2.0 * curvature * tau * v)[:, None] * table.speed
        beta -= (2.0 * curvature * tau * tau * a)[:, None] * table.distance
        rho = -2.0 * curvature * (v * (v - v0) + a * v0 * tau * table.sigma)
        return np.concatenate([theta, beta, rho[:, None]], axis=1)


@dataclass(frozen=True)
class SampledLateralAcceleration(LateralAcceleration):
    """Excess v^2 |k| / limit - 1 at stations and at all jumps of the acceleration."""

    times: TimeTable

    def _look(self, trip: Trajectory) -> Look:
        jumps = self._jumps(trip, self.times)
        return Look(fixed_sites(trip), _NO_STATIONS, jumps, trip.path.bend(jumps.path), 0.0)


def gradient_at_times(setup: Setup, trip: Trajectory, points: TripPoints, bend: PathBend) -> Array:
    """Gradient of v^2 k, (m, step), at fixed normalised times: points of a trip and their curvature."""
    tau, v0, path, v, table = trip.travel_time, setup.space.start_speed, points.path, points.speed, points.table
    basis = _Basis.at(trip, points.parameter)
    # per m driven, and per m/s
    driven = v * v * trip.path.curvature_rate(path) / path.speed
    faster = 2.0 * v * bend.curvature
    theta = (v * v)[:, None] * curvature_gradient(setup, bend, basis.rows, basis.slopes, basis.bends)
    theta -= driven[:, None] * basis.arc_length[:, setup.ends.free]
    beta = (tau * faster)[:, None] * table.speed
    beta += (tau * tau * driven)[:, None] * table.distance
    rho = driven * (v0 * tau) * table.sigma - faster * (v - v0)
    return np.concatenate([theta, beta, rho[:, None]], axis=1)


def _with_parts(trip: Trajectory, lateral: Array) -> Array:
    """Lateral accelerations at stations, (M,), and at parts of the ways between them, (PARTS (M - 1) + 1,) m/s^2."""
    cells = len(lateral) - 1
    shares = (np.arange(cells)[:, None] + np.arange(1, PARTS) / PARTS) / cells
    found = np.empty(PARTS * cells + 1)
    found[::PARTS] = lateral
    found[:-1].reshape(cells, PARTS)[:, 1:] = np.abs(station_sites(trip, shares.ravel()).lateral).reshape(cells, -1)
    return found


def _peaks(value: Array, above: float, stations: int) -> Array:
    """Normalised stations around peaks of values above a bound, (n,), by parabolas through the largest values."""
    here = value[1:-1]
    index = 1 + np.flatnonzero((here >= value[:-2]) & (here >= value[2:]) & (here > above))
    before, after = value[index - 1], value[index + 1]
    bend = before - 2.0 * value[index] + after
    shift = 0.5 * (before - after) / np.where(bend < 0.0, bend, -np.inf)
    peak = (index + shift) / (len(value) - 1)
    around = (peak[:, None] + PEAK_NEIGHBOURS / (stations - 1)).ravel()
    return np.minimum(np.maximum(around, 0.0), 1.0)


def lateral_acceleration(setup: Setup) -> Iterator[Constraint]:
    """Make the limit of a vehicle that may tip over or slide."""
    if np.isfinite(setup.limits.lateral_acceleration):
        yield LateralAcceleration(setup, setup.limits.lateral_acceleration)


_NO_BEND = PathBend(_NOWHERE, _NOWHERE, _NOWHERE, _NOWHERE)
_NO_STATIONS = StationSites(_NOWHERE, _NO_BEND, _NOWHERE, _NOWHERE)
