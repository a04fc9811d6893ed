"""Limits of the vehicle: linear rows that hold for all times; linearised rows of curvature and lateral acceleration.

In the variables (b, tau) with b = tau^2 beta, bounds on the control points of speed and acceleration are linear, except
that tau^2 in the acceleration's bounds is replaced by its tangent 2 tau_k tau - tau_k^2 <= tau^2: conservative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.problem.problem import Problem
from scp_planner.scp.bend_sites import BendSites, StationSites
from scp_planner.scp.rows.base import Rows, join_blocks
from scp_planner.trips.bundle import TripBundle
from scp_planner.trips.path import PathBend
from scp_planner.trips.trajectory import TripPoints

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
    def at(cls, bundle: TripBundle, owner: Index, parameters: Array) -> _StationBasis:
        space = bundle.space
        span, local = space.path.locate(parameters)
        side_by_side = space.tables.bending.rows_at(span, local)
        rows, slopes, bends = (side_by_side[:, k * space.path_size : (k + 1) * space.path_size] for k in range(3))
        return cls(rows, slopes, bends, bundle.arc_length_gradient(owner, parameters))

    def take(self, index: slice) -> _StationBasis:
        return _StationBasis(self.rows[index], self.slopes[index], self.bends[index], self.arc_length[index])

    def joined(self, other: _StationBasis) -> _StationBasis:
        return _StationBasis(
            np.concatenate([self.rows, other.rows]),
            np.concatenate([self.slopes, other.slopes]),
            np.concatenate([self.bends, other.bends]),
            np.concatenate([self.arc_length, other.arc_length]),
        )


def curvature_rows(problem: Problem, sites: Sequence[BendSites], group: int) -> Rows:
    """Return the rows of -limit <= curvature <= limit at fixed stations, relative to the limit.

    All stations are rows, and both sides of each: in one step a straight path may become too curved, or a curvature
    change its sign.

    Parameters
    ----------
    problem : Problem
    sites : sequence of BendSites
        Of K trips.
    group : int
        Index of the violation in the merit.

    Returns
    -------
    Rows
    """
    limit, tables = problem.limits.curvature, problem.space.tables
    if not np.isfinite(limit):
        return Rows.none(problem.step_size)
    owner, station = np.divmod(np.arange(len(sites) * len(tables.station_parameters)), len(tables.station_parameters))
    rows, slopes, bends = tables.station_rows[station], tables.station_slopes[station], tables.station_bends[station]
    bend = PathBend.joined([site.stations.bend for site in sites])
    theta = _bend_gradient(problem, bend, rows, slopes, bends) / limit
    zeros = np.zeros((len(owner), problem.space.acceleration_size + 1))
    return _both_sides(np.concatenate([theta, zeros], axis=1), bend.curvature / limit, group, station, owner)


def lateral_rows(
    problem: Problem, bundle: TripBundle, points: TripPoints, sites: Sequence[BendSites], group: int
) -> Rows:
    """Return the rows of -limit <= v^2 curvature <= limit, relative to the limit: stations, peaks, then jumps.

    At a fixed station D(sigma) = S(theta) moves sigma, and with it the speed:
    d(v^2) = 2 v (C1 db / tau - (v - v0) dtau / tau) + 2 a (dS - C2 db - v0 sigma dtau), regular also at v = 0.
    Where the acceleration jumps, v^2 has a peak that moves along the path. It is followed at its sigma:
    d(v^2 curvature) = 2 v curvature dv + v^2 (d curvature + curvature' ds), |r'| ds = dD - dS.

    Parameters
    ----------
    problem : Problem
    bundle : TripBundle
        K trips.
    points : TripPoints
        These trips at the problem's samples, one after the other.
    sites : sequence of BendSites
        Of these trips.
    group : int
        Index of the violation in the merit.

    Returns
    -------
    Rows
    """
    limit, tables = problem.limits.lateral_acceleration, problem.space.tables
    if not np.isfinite(limit):
        return Rows.none(problem.step_size)
    owner, station = np.divmod(np.arange(len(sites) * len(tables.station_parameters)), len(tables.station_parameters))
    fixed = StationSites.joined([site.stations for site in sites])
    basis = _StationBasis(
        tables.station_rows[station],
        tables.station_slopes[station],
        tables.station_bends[station],
        bundle.station_gradients(owner, station),
    )
    keys = 3 * station
    peaks = StationSites.joined([site.peaks for site in sites])
    loud = [(k, site.jumps) for k, site in enumerate(sites) if site.jumps is not None and len(site.jumps.lateral)]
    jumps = _JumpPlaces.of(problem, points, [k for k, _ in loud])
    moving = np.concatenate([peaks.parameters, jumps.parameters])
    if len(moving):
        counts = [len(site.peaks.parameters) for site in sites]
        peak_owner = np.arange(len(sites)).repeat(counts)
        between = _StationBasis.at(bundle, np.concatenate([peak_owner, jumps.owner]), moving)
        at_peaks, at_jumps = between.take(slice(len(peak_owner))), between.take(slice(len(peak_owner), None))
        basis, fixed = basis.joined(at_peaks), StationSites.joined([fixed, peaks])
        number = np.concatenate([np.arange(count) for count in counts])
        keys, owner = np.concatenate([keys, 3 * number + 1]), np.concatenate([owner, peak_owner])
    gradient, value = _lateral_gradient(problem, bundle, owner, fixed, basis), fixed.lateral
    if loud:
        bend = PathBend.joined([jump.bend for _, jump in loud])
        gradient = np.concatenate([gradient, _jump_gradient(problem, bundle, points, jumps, bend, at_jumps)])
        value = np.concatenate([value, *[jump.lateral for _, jump in loud]])
        keys = np.concatenate([keys, 3 * jumps.number + 2])
        owner = np.concatenate([owner, jumps.owner])
    gradient /= limit
    return _both_sides(gradient, value / limit, group, keys, owner)


def _lateral_gradient(
    problem: Problem, bundle: TripBundle, owner: Index, sites: StationSites, basis: _StationBasis
) -> Array:
    space, free = problem.space, problem.ends.free
    tau, v0 = bundle.of(bundle.travel_times, owner), space.start_speed
    table = space.time_table(sites.sigma)
    v, curvature = sites.speed, sites.bend.curvature
    a = bundle.accelerations(owner, table)
    theta = (v * v)[:, None] * _bend_gradient(problem, sites.bend, basis.rows, basis.slopes, basis.bends)
    theta += (2.0 * curvature * a)[:, None] * basis.arc_length[:, free]
    beta = (2.0 * curvature * tau * v)[:, None] * table.speed
    beta -= (2.0 * curvature * tau * tau * a)[:, None] * table.distance
    rho = -2.0 * curvature * (v * (v - v0) + a * v0 * tau * table.sigma)
    return join_blocks(theta, beta, rho)


@dataclass(frozen=True)
class _JumpPlaces:
    """Jumps of the acceleration of some trips: whose, which of its jumps, which of all samples, and where."""

    owner: Index
    number: Index
    sample: Index
    parameters: Array

    @classmethod
    def of(cls, problem: Problem, points: TripPoints, trips: Sequence[int]) -> _JumpPlaces:
        count, each = len(problem.jumps.sigma), len(problem.samples.sigma)
        owner = np.array(trips, dtype=np.intp).repeat(count)
        number = np.tile(np.arange(count), len(trips))
        sample = problem.grid + number + each * owner
        return cls(owner, number, sample, points.parameter[sample])


def _jump_gradient(
    problem: Problem,
    bundle: TripBundle,
    points: TripPoints,
    jumps: _JumpPlaces,
    bend: PathBend,
    basis: _StationBasis,
) -> Array:
    """Derivative of the lateral acceleration at the jumps of the acceleration of some trips, (n, step)."""
    space, free, table = problem.space, problem.ends.free, problem.jumps
    owner, index, again = jumps.owner, jumps.sample, jumps.number
    tau, v0 = bundle.of(bundle.travel_times, owner), space.start_speed
    path, v = points.path.take(index), points.speed[index]
    # per m driven, and per m/s
    driven = v * v * bundle.curvature_rate(owner, path) / path.speed
    faster = 2.0 * v * bend.curvature
    theta = (v * v)[:, None] * _bend_gradient(problem, bend, basis.rows, basis.slopes, basis.bends)
    theta -= driven[:, None] * basis.arc_length[:, free]
    beta = (tau * faster)[:, None] * table.speed[again]
    beta += (tau * tau * driven)[:, None] * table.distance[again]
    return join_blocks(theta, beta, driven * (v0 * tau) * table.sigma[again] - faster * (v - v0))


def _bend_gradient(problem: Problem, bend: PathBend, rows: Array, slopes: Array, bends: Array) -> Array:
    """Derivative of the curvature at fixed stations with respect to the free offsets, (m, K1 free)."""
    length, free = problem.space.length, problem.ends.free
    gradient = (bend.slope / length)[:, None] * slopes[:, free]
    gradient += (bend.bend / length**2)[:, None] * bends[:, free]
    if not problem.space.guide.straight:
        gradient += bend.value[:, None] * rows[:, free]
    return gradient


def _both_sides(gradient: Array, value: Array, group: int, key: Index, owner: Index) -> Rows:
    """Rows of -1 <= value + gradient z <= 1, but of the far side only where the value is not near to one side."""
    (upper,), (lower,) = (value > -OPPOSITE).nonzero(), (value < OPPOSITE).nonzero()
    both = np.concatenate([upper, lower])
    far = slice(len(upper), None)
    matrix, gap, twice = gradient[both], value[both], 2 * key[both]
    np.negative(matrix[far], out=matrix[far])
    np.negative(gap[: len(upper)], out=gap[: len(upper)])
    gap += 1.0
    twice[far] += 1
    return Rows(matrix, gap, np.full(len(both), group, dtype=np.intp), twice, owner[both])
