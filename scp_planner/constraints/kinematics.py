"""Limits of the vehicle: linear rows that hold for all times; linearised rows of curvature and lateral acceleration.

In the variables (b, tau) with b = tau^2 beta, bounds on the control points of speed and acceleration are linear, except
that tau^2 in the acceleration's bounds is replaced by its tangent 2 tau_k tau - tau_k^2 <= tau^2: conservative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scp_planner.bundle import TripBundle, stacked
from scp_planner.constraints import Rows
from scp_planner.constraints.clearance import join_blocks
from scp_planner.problem import Problem
from scp_planner.trajectory import Array, Index, PathBend, Trajectory, TripPoints

PEAK_REACH = 0.8  # of the limit; lower peaks of the lateral acceleration between stations are not looked at
PEAK_NEIGHBOURS = np.linspace(-0.6, 0.6, 7)  # stations: a peak moves when it is pressed down in one place
OPPOSITE = 0.5  # of a limit; where more is used on one side, no step is expected to reach the other

QUIET = 0.8  # of the limit; if no station is above, nothing between stations is looked at
_NOWHERE: Array = np.zeros(0)


class KinematicRows:
    """Arrival, speed and acceleration rows: linear in (b, tau), made once and scaled at each iterate.

    Parameters
    ----------
    problem : Problem
    """

    def __init__(self, problem: Problem) -> None:
        space, limits = problem.space, problem.limits
        self.problem = problem
        self.theta_size = problem.ends.free.stop - problem.ends.free.start
        count = space.acceleration_size
        self.equalities = 1
        width = self.theta_size + count + 1
        speeds = space.tables.speed_control[1:]
        moves = np.flatnonzero(np.abs(speeds).sum(axis=1) > 0)
        self._speeds = speeds[moves]
        eye = np.eye(count)
        self._beta = slice(self.theta_size, self.theta_size + count)
        first = self.equalities
        self._upper = slice(first, first + len(moves))
        self._lower = slice(self._upper.stop, self._upper.stop + len(moves))
        self._up = slice(self._lower.stop, self._lower.stop + count)
        self._down = slice(self._up.stop, self._up.stop + count)
        self.matrix = np.zeros((self._down.stop, width))
        self.matrix[self._upper, -1] = space.start_speed - limits.speed
        self.matrix[self._lower, -1] = -space.start_speed
        self.matrix[self._up, self._beta] = eye
        self.matrix[self._up, -1] = -2.0 * problem.highest_accelerations
        self.matrix[self._down, self._beta] = -eye
        self.matrix[self._down, -1] = 2.0 * problem.lowest_accelerations
        self.bound = np.zeros(self._down.stop)

    def at(self, trajectory: Trajectory) -> tuple[Array, Array]:
        """Rows and bounds of the step from a trip: the first ``equalities`` rows with equality.

        Parameters
        ----------
        trajectory : Trajectory

        Returns
        -------
        (matrix, bound)
            Reused at the next call.
        """
        problem, matrix, bound = self.problem, self.matrix, self.bound
        tables, limits, v0 = problem.space.tables, problem.limits, problem.space.start_speed
        tau, beta, path = trajectory.travel_time, trajectory.beta, trajectory.path
        # Arrival: v0 tau + C2(1) b = L(theta)
        matrix[0, : self.theta_size] = -path.final_gradient[problem.ends.free]
        matrix[0, self._beta] = tau * tau * tables.final_distance
        matrix[0, -1] = v0 * tau
        bound[0] = path.arc_length - v0 * tau - tau * tau * float(tables.final_distance @ beta)
        np.multiply(self._speeds, tau, out=matrix[self._upper, self._beta])
        np.multiply(self._speeds, -tau, out=matrix[self._lower, self._beta])
        speeds = v0 + tau * (self._speeds @ beta)
        bound[self._upper] = limits.speed - speeds
        bound[self._lower] = speeds
        bound[self._up] = problem.highest_accelerations - beta
        bound[self._down] = beta - problem.lowest_accelerations
        return matrix, bound

    def excess(self, trajectory: Trajectory) -> float:
        """Largest excess over the bounds of speed (m/s) and acceleration (m/s^2), 0 where there is none."""
        return max(0.0, -float(self.at(trajectory)[1][self.equalities :].min()))

    def timing_curvature(self, prices: Array) -> float:
        """Second derivative of the bounds b_k <= a tau^2 with respect to rho, times the multipliers of all rows."""
        problem = self.problem
        up, down = prices[self._up], prices[self._down]
        return float(2.0 * (down @ problem.lowest_accelerations - up @ problem.highest_accelerations))


@dataclass(frozen=True)
class BendSites:
    """Where curvature and lateral acceleration of a trip are limited: fixed stations, and peaks between them.

    Attributes
    ----------
    stations : StationSites
        The M fixed stations.
    peaks : StationSites
        P stations between the fixed ones, around peaks of the lateral acceleration.
    jumps : JumpSites or None
        Where the vehicle is when its acceleration jumps: the speed peaks there.
    worst_lateral : float
        Largest lateral acceleration at all sites, m/s^2.
    worst_curvature : float
        Largest curvature at the fixed stations, 1/m.
    """

    stations: StationSites
    peaks: StationSites
    jumps: JumpSites | None
    worst_lateral: float
    worst_curvature: float

    @property
    def curvature(self) -> Array:
        """Curvature at the fixed stations, (M,) 1/m: it peaks at breakpoints of a cubic offset or close to them."""
        return self.stations.bend.curvature


@dataclass(frozen=True)
class StationSites:
    """A trip at given stations.

    Attributes
    ----------
    parameters : (n,) array
        Normalised stations.
    bend : PathBend
        Curvature there.
    sigma : (n,) array
        When the vehicle is there, normalised.
    speed : (n,) array
        m/s.
    """

    parameters: Array
    bend: PathBend
    sigma: Array
    speed: Array

    @cached_property
    def lateral(self) -> Array:
        """Lateral acceleration, (n,) m/s^2, signed."""
        return self.speed * self.speed * self.bend.curvature

    def take(self, index: Index | slice) -> StationSites:
        """Return some of the stations."""
        return StationSites(self.parameters[index], self.bend.take(index), self.sigma[index], self.speed[index])

    @classmethod
    def joined(cls, parts: Sequence[StationSites]) -> StationSites:
        """Return several sets of stations as one."""
        return (
            parts[0]
            if len(parts) == 1
            else cls(
                np.concatenate([part.parameters for part in parts]),
                PathBend.joined([part.bend for part in parts]),
                np.concatenate([part.sigma for part in parts]),
                np.concatenate([part.speed for part in parts]),
            )
        )


@dataclass(frozen=True)
class JumpSites:
    """A trip at those of the problem's samples that are breakpoints of the acceleration.

    Attributes
    ----------
    bend : PathBend
        Curvature there.
    lateral : (n,) array
        Lateral acceleration, m/s^2, signed.
    """

    bend: PathBend
    lateral: Array


def bend_sites(problem: Problem, bundle: TripBundle, points: TripPoints) -> list[BendSites]:
    """Return curvature and lateral acceleration of trips where they are limited.

    Parameters
    ----------
    problem : Problem
    bundle : TripBundle
    points : TripPoints
        The trips at the problem's samples, one after the other. Jumps, and peaks between stations, are only looked at
        when some station comes near to the limit.

    Returns
    -------
    list of BendSites
        One for each trip.
    """
    parameters, bend = problem.space.tables.station_parameters, bundle.station_bend
    arrivals = bundle.arrivals_each(bundle.station_arc_lengths)
    sigma = arrivals.sigma.reshape(bend.curvature.shape)
    speed = arrivals.speed.reshape(bend.curvature.shape)
    stations = [StationSites(parameters, bend.take(k), sigma[k], speed[k]) for k in range(bundle.count)]
    lateral = np.abs(speed * speed * bend.curvature)
    worst, sharpest = lateral.max(axis=1), np.abs(bend.curvature).max(axis=1).tolist()
    loud = worst >= QUIET * problem.limits.lateral_acceleration
    if not loud.any():
        quiet = zip(stations, worst.tolist(), sharpest, strict=True)
        return [BendSites(station, _NO_STATIONS, None, most, most_bent) for station, most, most_bent in quiet]
    owner, around = _lateral_peaks(problem, lateral, loud)
    peaks = station_sites(bundle, owner, around)
    np.maximum.at(worst, owner, np.abs(peaks.lateral))
    jump_bend, jump_lateral = _at_jumps(problem, bundle, points)
    np.maximum(worst, np.abs(jump_lateral).max(axis=1, initial=0.0), out=worst, where=loud)
    bounds = bundle.bounds(owner)
    sites = []
    for k, (first, last) in enumerate(pairwise(bounds)):
        if loud[k]:
            jumps = JumpSites(jump_bend.take(slice(*_part(problem, k))), jump_lateral[k])
            sites.append(BendSites(stations[k], peaks.take(slice(first, last)), jumps, float(worst[k]), sharpest[k]))
        else:
            sites.append(BendSites(stations[k], _NO_STATIONS, None, float(worst[k]), sharpest[k]))
    return sites


def _part(problem: Problem, k: int) -> tuple[int, int]:
    count = len(problem.jumps.sigma)
    return k * count, (k + 1) * count


def _at_jumps(problem: Problem, bundle: TripBundle, points: TripPoints) -> tuple[PathBend, Array]:
    """Curvature at the jumps of the acceleration, (K J,), and lateral acceleration, (K, J)."""
    path, index = points.path, _jump_samples(problem, bundle.count)
    jumps = path.take(index)
    bend = bundle.bend(bundle.owners(len(problem.jumps.sigma)), jumps)
    speed = points.speed[index]
    lateral = speed * speed * bend.curvature
    return bend, lateral.reshape(bundle.count, -1)


def _jump_samples(problem: Problem, count: int) -> Index | slice:
    """Where the jumps are among the samples of several trips."""
    each = len(problem.samples.sigma)
    if count == 1:
        return slice(problem.grid, None)
    return (each * np.arange(count)[:, None] + np.arange(problem.grid, each)).ravel()


def _lateral_peaks(problem: Problem, value: Array, loud: NDArray[np.bool_]) -> tuple[Index, Array]:
    """Normalised stations around peaks of the lateral acceleration, (K, M), by parabolas through its largest values."""
    here = value[:, 1:-1]
    high = (here >= value[:, :-2]) & (here >= value[:, 2:])
    high &= here > PEAK_REACH * problem.limits.lateral_acceleration
    high &= loud[:, None]
    owner, index = np.nonzero(high)
    index += 1
    before, after = value[owner, index - 1], value[owner, index + 1]
    bend = before - 2.0 * value[owner, index] + after
    shift = 0.5 * (before - after) / np.where(bend < 0.0, bend, -np.inf)
    around = ((index + shift)[:, None] + PEAK_NEIGHBOURS).ravel() / (value.shape[1] - 1)
    return owner.repeat(len(PEAK_NEIGHBOURS)), np.minimum(np.maximum(around, 0.0), 1.0)


def station_sites(bundle: TripBundle, owner: Index, parameters: Array) -> StationSites:
    """Return trips at normalised stations, (n,)."""
    if len(parameters) == 0:
        return _NO_STATIONS
    arrivals = bundle.arrivals(owner, bundle.arc_length_at(owner, parameters))
    points = bundle.points(owner, parameters)
    return StationSites(parameters, bundle.bend(owner, points), arrivals.sigma, arrivals.speed)


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


def curvature_rows(problem: Problem, sites: Sequence[BendSites], within: float, group: int) -> Rows:
    """Return the rows of -limit <= curvature <= limit at fixed stations, relative to the limit.

    Both sides are rows: the curvature may change its sign in one step.

    Parameters
    ----------
    problem : Problem
    sites : sequence of BendSites
        Of K trips.
    within : float
        Stations with less than this of the limit are no rows.
    group : int
        Index of the violation in the merit.

    Returns
    -------
    Rows
    """
    limit = problem.limits.curvature
    if max(site.worst_curvature for site in sites) <= within * limit:
        return Rows.none(problem.step_size)
    curvature = stacked([site.curvature for site in sites])
    owner, station = np.nonzero(np.abs(curvature) > within * limit)
    tables = problem.space.tables
    rows, slopes, bends = tables.station_rows[station], tables.station_slopes[station], tables.station_bends[station]
    bend = _bends_at(sites, owner, station, straight=problem.space.guide.straight)
    theta = _bend_gradient(problem, bend, rows, slopes, bends) / limit
    zeros = np.zeros((len(owner), problem.space.acceleration_size + 1))
    return _both_sides(np.concatenate([theta, zeros], axis=1), bend.curvature / limit, group, station, owner)


def lateral_rows(
    problem: Problem, bundle: TripBundle, points: TripPoints, sites: Sequence[BendSites], within: float, group: int
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
    within, group
        As in :func:`curvature_rows`; all peaks and jumps are rows.

    Returns
    -------
    Rows
    """
    limit, tables = problem.limits.lateral_acceleration, problem.space.tables
    lateral = stacked([site.stations.lateral for site in sites])
    owner, station = np.nonzero(np.abs(lateral) > within * limit)
    if len(owner) == 0:
        return Rows.none(problem.step_size)
    fixed = StationSites(
        tables.station_parameters[station],
        _bends_at(sites, owner, station, straight=problem.space.guide.straight),
        stacked([site.stations.sigma for site in sites])[owner, station],
        stacked([site.stations.speed for site in sites])[owner, station],
    )
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


def _bends_at(sites: Sequence[BendSites], owner: Index, station: Index, *, straight: bool) -> PathBend:
    """Curvature of trips at some of their fixed stations."""
    bends = [site.stations.bend for site in sites]
    return PathBend(
        stacked([bend.curvature for bend in bends])[owner, station],
        bends[0].value if straight else stacked([bend.value for bend in bends])[owner, station],
        stacked([bend.slope for bend in bends])[owner, station],
        stacked([bend.bend for bend in bends])[owner, station],
    )


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


def goal_speed_rows(problem: Problem, bundle: TripBundle, group: int) -> Rows:
    """Return the rows of v(1) = goal speed: linear in (b, tau), v0 tau + C1(1) b = v_goal tau.

    Parameters
    ----------
    problem : Problem
    bundle : TripBundle
    group : int
        Index of the violation in the merit, in m/s.

    Returns
    -------
    Rows
    """
    space, goal = problem.space, problem.ends.goal_speed
    if goal is None:
        return Rows.none(problem.step_size)
    gradient = np.zeros((bundle.count, problem.step_size))
    gradient[:, -1 - space.acceleration_size : -1] = bundle.travel_times[:, None] * space.tables.final_speed
    gradient[:, -1] = space.start_speed - goal
    excess = np.array([trip.final_speed - goal for trip in bundle.trips])
    side, owner = np.arange(2).repeat(bundle.count), np.tile(np.arange(bundle.count), 2)
    both = np.concatenate([gradient, -gradient])
    return Rows(both, np.concatenate([-excess, excess]), np.full(len(owner), group, dtype=np.intp), side, owner)


def _both_sides(gradient: Array, value: Array, group: int, key: Index, owner: Index) -> Rows:
    """Rows of -1 <= value + gradient z <= 1, but of the far side only where the value is not near to one side."""
    upper, lower = np.flatnonzero(value > -OPPOSITE), np.flatnonzero(value < OPPOSITE)
    return Rows(
        np.concatenate([gradient[upper], -gradient[lower]]),
        np.concatenate([1.0 - value[upper], 1.0 + value[lower]]),
        np.full(len(upper) + len(lower), group, dtype=np.intp),
        np.concatenate([2 * key[upper], 2 * key[lower] + 1]),
        np.concatenate([owner[upper], owner[lower]]),
    )


_NO_BEND = PathBend(_NOWHERE, _NOWHERE, _NOWHERE, _NOWHERE)
_NO_STATIONS = StationSites(_NOWHERE, _NO_BEND, _NOWHERE, _NOWHERE)
