"""Limits of the vehicle: linear rows that hold for all times; linearised rows of curvature and lateral acceleration.

In the variables (b, tau) with b = tau^2 beta, bounds on the control points of speed and acceleration are linear, except
that tau^2 in the acceleration's bounds is replaced by its tangent 2 tau_k tau - tau_k^2 <= tau^2: conservative.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scp_planner.constraints import Rows
from scp_planner.constraints.clearance import join_blocks
from scp_planner.problem import Problem
from scp_planner.trajectory import Array, Index, PathBend, Trajectory, TripPoints

PEAK_REACH = 0.8  # of the limit; lower peaks of the lateral acceleration between stations are not looked at
PEAK_NEIGHBOURS = np.linspace(-0.6, 0.6, 7)  # stations: a peak moves when it is pressed down in one place

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
    """

    stations: StationSites
    peaks: StationSites
    jumps: JumpSites | None

    @property
    def curvature(self) -> Array:
        """Curvature at the fixed stations, (M,) 1/m: it peaks at breakpoints of a cubic offset or close to them."""
        return self.stations.bend.curvature

    @property
    def worst_lateral(self) -> float:
        """Largest lateral acceleration at all sites, m/s^2."""
        worst = float(np.abs(self.stations.lateral).max())
        if self.jumps is not None:
            worst = max(worst, float(np.abs(self.jumps.lateral).max(initial=0.0)))
        return max(worst, float(np.abs(self.peaks.lateral).max())) if len(self.peaks.parameters) else worst


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


@dataclass(frozen=True)
class JumpSites:
    """A trip at fixed normalised times.

    Attributes
    ----------
    points : TripPoints
        Where the vehicle is then.
    bend : PathBend
        Curvature there.
    """

    points: TripPoints
    bend: PathBend

    @classmethod
    def of(cls, problem: Problem, trajectory: Trajectory, points: TripPoints) -> JumpSites:
        """Return the sites of the jumps of the acceleration, given the trip at the problem's samples."""
        jumps = points.take(slice(problem.grid, None))
        return cls(jumps, trajectory.path.bend(jumps.path))

    @cached_property
    def lateral(self) -> Array:
        """Lateral acceleration, (n,) m/s^2, signed."""
        return self.points.speed * self.points.speed * self.bend.curvature


def bend_sites(problem: Problem, trajectory: Trajectory, points: TripPoints) -> BendSites:
    """Return curvature and lateral acceleration of a trip where they are limited.

    Parameters
    ----------
    problem, trajectory : Problem, Trajectory
    points : TripPoints
        The trip at the problem's samples. Their jumps, and peaks between stations, are only looked at when some station
        comes near to the limit.
    """
    path, tables = trajectory.path, problem.space.tables
    arrivals = trajectory.arrivals(path.station_arc_lengths)
    stations = StationSites(tables.station_parameters, path.station_bend, arrivals.sigma, arrivals.speed)
    if np.abs(stations.lateral).max() < QUIET * problem.limits.lateral_acceleration:
        return BendSites(stations, _NO_STATIONS, None)
    peaks = station_sites(trajectory, _lateral_peaks(problem, stations))
    return BendSites(stations, peaks, JumpSites.of(problem, trajectory, points))


def _lateral_peaks(problem: Problem, stations: StationSites) -> Array:
    """Normalised stations around peaks of the lateral acceleration, by parabolas through its largest values."""
    value = np.abs(stations.lateral)
    here = value[1:-1]
    high = (here >= value[:-2]) & (here >= value[2:]) & (here > PEAK_REACH * problem.limits.lateral_acceleration)
    index = np.flatnonzero(high) + 1
    before, after = value[index - 1], value[index + 1]
    bend = before - 2.0 * value[index] + after
    shift = 0.5 * (before - after) / np.where(bend < 0.0, bend, -np.inf)
    around = ((index + shift)[:, None] + PEAK_NEIGHBOURS).ravel() / (len(value) - 1)
    return np.minimum(np.maximum(around, 0.0), 1.0)


def station_sites(trajectory: Trajectory, parameters: Array) -> StationSites:
    """Return a trip at normalised stations."""
    if len(parameters) == 0:
        return _NO_STATIONS
    path = trajectory.path
    arrivals = trajectory.arrivals(path.arc_length_at(parameters))
    return StationSites(parameters, path.bend(path.points(parameters)), arrivals.sigma, arrivals.speed)


@dataclass(frozen=True)
class _StationBasis:
    """Rows of the offset's basis (B, B', B'') and of dS/dtheta at stations, over all control points."""

    rows: Array
    slopes: Array
    bends: Array
    arc_length: Array


def curvature_rows(problem: Problem, trajectory: Trajectory, sites: BendSites, index: Index, group: int) -> Rows:
    """Return the rows of -limit <= curvature <= limit at fixed stations, relative to the limit.

    Both sides are rows: the curvature may change its sign in one step.

    Parameters
    ----------
    problem, trajectory : Problem, Trajectory
    sites : BendSites
    index : (m,) array of int
        Which stations.
    group : int
        Index of the violation in the merit.
    """
    if len(index) == 0:
        return Rows.none(problem.step_size)
    basis = _fixed_basis(problem, trajectory, index)
    theta = _bend_gradient(problem, sites.stations.bend, index, basis) / problem.limits.curvature
    zeros = np.zeros((len(index), problem.space.acceleration_size + 1))
    value = sites.curvature[index] / problem.limits.curvature
    return _both_sides(np.concatenate([theta, zeros], axis=1), value, group, index)


def lateral_rows(problem: Problem, trajectory: Trajectory, sites: BendSites, stations: Index, group: int) -> Rows:
    """Return the rows of -limit <= v^2 curvature <= limit, relative to the limit: stations, peaks, then jumps.

    At a fixed station D(sigma) = S(theta) moves sigma, and with it the speed:
    d(v^2) = 2 v (C1 db / tau - (v - v0) dtau / tau) + 2 a (dS - C2 db - v0 sigma dtau), regular also at v = 0.
    Where the acceleration jumps, v^2 has a peak that moves along the path. It is followed at its sigma:
    d(v^2 curvature) = 2 v curvature dv + v^2 (d curvature + curvature' ds), |r'| ds = dD - dS.

    Parameters
    ----------
    problem, trajectory, sites, group
        As in :func:`curvature_rows`.
    stations : (m,) array of int
        Which of the fixed stations; all peaks and jumps are rows.
    """
    limit, peaks = problem.limits.lateral_acceleration, sites.peaks
    basis = _fixed_basis(problem, trajectory, stations)
    gradient = _lateral_gradient(problem, trajectory, sites.stations, stations, basis)
    value, keys = sites.stations.lateral[stations], 3 * stations
    if len(peaks.parameters):
        every = np.arange(len(peaks.parameters))
        basis = _moving_basis(trajectory, peaks.parameters)
        gradient = np.concatenate([gradient, _lateral_gradient(problem, trajectory, peaks, every, basis)])
        value, keys = np.concatenate([value, peaks.lateral]), np.concatenate([keys, 3 * every + 1])
    if sites.jumps is not None and len(sites.jumps.lateral):
        every = np.arange(len(sites.jumps.lateral))
        gradient = np.concatenate([gradient, _jump_gradient(problem, trajectory, sites.jumps)])
        value, keys = np.concatenate([value, sites.jumps.lateral]), np.concatenate([keys, 3 * every + 2])
    return _both_sides(gradient / limit, value / limit, group, keys)


def _fixed_basis(problem: Problem, trajectory: Trajectory, index: Index) -> _StationBasis:
    tables = problem.space.tables
    return _StationBasis(
        tables.station_rows[index],
        tables.station_slopes[index],
        tables.station_bends[index],
        trajectory.path.station_gradients[index],
    )


def _moving_basis(trajectory: Trajectory, parameters: Array) -> _StationBasis:
    basis = trajectory.space.path
    span, local = basis.locate(parameters)
    return _StationBasis(
        basis.rows_at(span, local),
        basis.derivative.rows_at(span, local),
        basis.derivative.derivative.rows_at(span, local),
        trajectory.path.arc_length_gradient(parameters),
    )


def _lateral_gradient(
    problem: Problem,
    trajectory: Trajectory,
    sites: StationSites,
    index: Index,
    basis: _StationBasis,
) -> Array:
    space, free = problem.space, problem.ends.free
    tau, v0 = trajectory.travel_time, space.start_speed
    table = space.time_table(sites.sigma[index])
    v, a = sites.speed[index], table.acceleration @ trajectory.beta
    curvature = sites.bend.curvature[index]
    theta = (v * v)[:, None] * _bend_gradient(problem, sites.bend, index, basis)
    theta += (2.0 * curvature * a)[:, None] * basis.arc_length[:, free]
    beta = (2.0 * curvature * tau * v)[:, None] * table.speed
    beta -= (2.0 * curvature * tau * tau * a)[:, None] * table.distance
    rho = -2.0 * curvature * (v * (v - v0) + a * v0 * tau * table.sigma)
    return join_blocks(theta, beta, rho)


def _jump_gradient(problem: Problem, trajectory: Trajectory, sites: JumpSites) -> Array:
    """Derivative of the lateral acceleration at fixed normalised times, (n, step)."""
    space, free = problem.space, problem.ends.free
    tau, v0 = trajectory.travel_time, space.start_speed
    points, curvature = sites.points, sites.bend.curvature
    v, table = points.speed, points.table
    basis = _moving_basis(trajectory, points.parameter)
    # per m driven, and per m/s
    driven = v * v * trajectory.path.curvature_rate(points.path) / points.path.speed
    faster = 2.0 * v * curvature
    theta = (v * v)[:, None] * _bend_gradient(problem, sites.bend, slice(None), basis)
    theta -= driven[:, None] * basis.arc_length[:, free]
    beta = (tau * faster)[:, None] * table.speed
    beta += (tau * tau * driven)[:, None] * table.distance
    return join_blocks(theta, beta, driven * (v0 * tau) * table.sigma - faster * (v - v0))


def _bend_gradient(problem: Problem, bend: PathBend, index: Index | slice, basis: _StationBasis) -> Array:
    """Derivative of the curvature at fixed stations with respect to the free offsets, (m, K1 free)."""
    length, free = problem.space.length, problem.ends.free
    gradient = (bend.slope[index] / length)[:, None] * basis.slopes[:, free]
    gradient += (bend.bend[index] / length**2)[:, None] * basis.bends[:, free]
    if not problem.space.guide.straight:
        gradient += bend.value[index][:, None] * basis.rows[:, free]
    return gradient


def goal_speed_rows(problem: Problem, trajectory: Trajectory, group: int) -> Rows:
    """Return the rows of v(1) = goal speed: linear in (b, tau), v0 tau + C1(1) b = v_goal tau.

    Parameters
    ----------
    problem, trajectory : Problem, Trajectory
    group : int
        Index of the violation in the merit, in m/s.
    """
    space, goal = problem.space, problem.ends.goal_speed
    if goal is None:
        return Rows.none(problem.step_size)
    gradient = np.zeros(problem.step_size)
    gradient[-1 - space.acceleration_size : -1] = trajectory.travel_time * space.tables.final_speed
    gradient[-1] = space.start_speed - goal
    excess = trajectory.final_speed - goal
    both = np.stack([gradient, -gradient])
    return Rows(both, np.array([-excess, excess]), np.full(2, group, dtype=np.intp), np.arange(2))


def both_gaps(value: Array) -> Array:
    """What is left of -1 <= value <= 1 on both sides."""
    return np.concatenate([1.0 - value, 1.0 + value])


def _both_sides(gradient: Array, value: Array, group: int, key: Index) -> Rows:
    """Rows of -1 <= value + gradient z <= 1."""
    return Rows(
        np.concatenate([gradient, -gradient]),
        both_gaps(value),
        np.full(2 * len(value), group, dtype=np.intp),
        np.concatenate([2 * key, 2 * key + 1]),
    )


_NO_BEND = PathBend(_NOWHERE, _NOWHERE, _NOWHERE, _NOWHERE)
_NO_STATIONS = StationSites(_NOWHERE, _NO_BEND, _NOWHERE, _NOWHERE)
