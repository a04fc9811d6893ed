"""Limits of the vehicle: linear rows that hold for all times; linearised rows of curvature and lateral acceleration.

In the variables (b, tau) with b = tau^2 beta, bounds on the control points of speed and acceleration are linear, except
that tau^2 in the acceleration's bounds is replaced by its tangent 2 tau_k tau - tau_k^2 <= tau^2: conservative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.problem.problem import Problem
from scp_planner.scp.bend_sites import BendSites, StationSites
from scp_planner.scp.rows.base import Rows, join_blocks
from scp_planner.trips.path import PathBend
from scp_planner.trips.trajectory import Trajectory, TripPoints

STILL = 2e-6  # m/s, less than a stop at the goal: who waits moves on so slowly, lest rounding lead to speeds below 0
OPPOSITE = 0.5  # of a limit; where more is used on one side, no step is expected to reach the other


@dataclass(frozen=True)
class _StationBasis:
    """Rows of the offset's basis (B, B', B'') and of dS/dtheta at stations, over all control points."""

    rows: Array
    slopes: Array
    bends: Array
    arc_length: Array

    @classmethod
    def at(cls, trip: Trajectory, parameters: Array) -> _StationBasis:
        space = trip.space
        span, local = space.path.locate(parameters)
        side_by_side = space.tables.bending.rows_at(span, local)
        rows, slopes, bends = (side_by_side[:, k * space.path_size : (k + 1) * space.path_size] for k in range(3))
        return cls(rows, slopes, bends, trip.path.arc_length_gradient(parameters))

    def joined(self, other: _StationBasis) -> _StationBasis:
        return _StationBasis(
            np.concatenate([self.rows, other.rows]),
            np.concatenate([self.slopes, other.slopes]),
            np.concatenate([self.bends, other.bends]),
            np.concatenate([self.arc_length, other.arc_length]),
        )


def curvature_rows(problem: Problem, sites: BendSites, group: int) -> Rows:
    """Return the rows of -limit <= curvature <= limit at fixed stations, relative to the limit.

    All stations are rows, and both sides of each: in one step a straight path may become too curved, or a curvature
    change its sign.
    """
    limit, tables, bend = problem.limits.curvature, problem.space.tables, sites.stations.bend
    if not np.isfinite(limit):
        return Rows.none(problem.step_size)
    theta = _bend_gradient(problem, bend, tables.station_rows, tables.station_slopes, tables.station_bends) / limit
    zeros = np.zeros((len(theta), problem.space.acceleration_size + 1))
    return _both_sides(np.concatenate([theta, zeros], axis=1), bend.curvature / limit, group, np.arange(len(theta)))


def lateral_rows(problem: Problem, trip: Trajectory, points: TripPoints, sites: BendSites, group: int) -> Rows:
    """Return the rows of -limit <= v^2 curvature <= limit, relative to the limit: stations, peaks, then jumps.

    At a fixed station D(sigma) = S(theta) moves sigma, and with it the speed:
    d(v^2) = 2 v (C1 db / tau - (v - v0) dtau / tau) + 2 a (dS - C2 db - v0 sigma dtau), regular also at v = 0.
    Where the acceleration jumps, v^2 has a peak that moves along the path. It is followed at its sigma:
    d(v^2 curvature) = 2 v curvature dv + v^2 (d curvature + curvature' ds), |r'| ds = dD - dS.
    The points are the trip's at the problem's samples.
    """
    limit, tables = problem.limits.lateral_acceleration, problem.space.tables
    if not np.isfinite(limit):
        return Rows.none(problem.step_size)
    fixed = sites.stations
    basis = _StationBasis(tables.station_rows, tables.station_slopes, tables.station_bends, trip.path.station_gradients)
    keys = 3 * np.arange(len(fixed.parameters))
    if len(sites.peaks.parameters):
        fixed = fixed.joined(sites.peaks)
        basis = basis.joined(_StationBasis.at(trip, sites.peaks.parameters))
        keys = np.concatenate([keys, 3 * np.arange(len(sites.peaks.parameters)) + 1])
    gradient, value = _lateral_gradient(problem, trip, fixed, basis), fixed.lateral
    if sites.jumps is not None and len(sites.jumps.lateral):
        gradient = np.concatenate([gradient, _jump_gradient(problem, trip, points, sites.jumps.bend)])
        value = np.concatenate([value, sites.jumps.lateral])
        keys = np.concatenate([keys, 3 * np.arange(len(sites.jumps.lateral)) + 2])
    gradient /= limit
    return _both_sides(gradient, value / limit, group, keys)


def _lateral_gradient(problem: Problem, trip: Trajectory, sites: StationSites, basis: _StationBasis) -> Array:
    space, free = problem.space, problem.ends.free
    tau, v0 = trip.travel_time, space.start_speed
    table = space.time_table(sites.sigma)
    v, curvature = sites.speed, sites.bend.curvature
    a = table.acceleration @ trip.beta
    theta = (v * v)[:, None] * _bend_gradient(problem, sites.bend, basis.rows, basis.slopes, basis.bends)
    theta += (2.0 * curvature * a)[:, None] * basis.arc_length[:, free]
    beta = (2.0 * curvature * tau * v)[:, None] * table.speed
    beta -= (2.0 * curvature * tau * tau * a)[:, None] * table.distance
    rho = -2.0 * curvature * (v * (v - v0) + a * v0 * tau * table.sigma)
    return join_blocks(theta, beta, rho)


def _jump_gradient(problem: Problem, trip: Trajectory, points: TripPoints, bend: PathBend) -> Array:
    """Derivative of the lateral acceleration at the jumps of the acceleration, (n, step)."""
    space, free, table = problem.space, problem.ends.free, problem.jumps
    there = slice(problem.grid, None)
    basis = _StationBasis.at(trip, points.parameter[there])
    tau, v0 = trip.travel_time, space.start_speed
    path, v = points.path.take(there), points.speed[there]
    # per m driven, and per m/s
    driven = v * v * trip.path.curvature_rate(path) / path.speed
    faster = 2.0 * v * bend.curvature
    theta = (v * v)[:, None] * _bend_gradient(problem, bend, basis.rows, basis.slopes, basis.bends)
    theta -= driven[:, None] * basis.arc_length[:, free]
    beta = (tau * faster)[:, None] * table.speed
    beta += (tau * tau * driven)[:, None] * table.distance
    return join_blocks(theta, beta, driven * (v0 * tau) * table.sigma - faster * (v - v0))


def _bend_gradient(problem: Problem, bend: PathBend, rows: Array, slopes: Array, bends: Array) -> Array:
    """Derivative of the curvature at fixed stations with respect to the free offsets, (m, K1 free)."""
    length, free = problem.space.length, problem.ends.free
    gradient = (bend.slope / length)[:, None] * slopes[:, free]
    gradient += (bend.bend / length**2)[:, None] * bends[:, free]
    if not problem.space.guide.straight:
        gradient += bend.value[:, None] * rows[:, free]
    return gradient


def _both_sides(gradient: Array, value: Array, group: int, key: Index) -> Rows:
    """Rows of -1 <= value + gradient z <= 1, but of the far side only where the value is not near to one side."""
    (upper,), (lower,) = (value > -OPPOSITE).nonzero(), (value < OPPOSITE).nonzero()
    return Rows(
        np.concatenate([gradient[upper], -gradient[lower]]),
        np.concatenate([1.0 - value[upper], 1.0 + value[lower]]),
        np.full(len(upper) + len(lower), group, dtype=np.intp),
        np.concatenate([2 * key[upper], 2 * key[lower] + 1]),
    )
