"""First trips: within the limits, along a way that the search found; and arcs where it found none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.constraints.jerk import jerk_matrix
from scp_planner.mathematics.splines import greville_sites
from scp_planner.problem.problem import Problem
from scp_planner.search.ways import Way
from scp_planner.solvers import QuadraticProgram, SolverStatus, solver_named
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory


@dataclass(frozen=True)
class FirstFit:
    """Weights of fitting a trip to a way."""

    smoothing: float = 1.0  # m^2: weight of bending against offsets, in fitting a path to a way
    close_smoothing: float = 0.1  # m^2; smooth paths start faster runs, close ones do not cut the corners of walls
    arrival_weight: float = 10.0  # of arriving in time, against being in time on the way
    drive_smoothing: float = 1e-2  # m^2 per (m/s^2)^2
    missed: float = 0.02  # of the path, by which a drive may miss its end
    slower: tuple[float, ...] = (1.1, 1.25, 1.4, 1.6, 1.8, 2.0, 2.5)  # times a way's times, one after the other
    crawling: float = 1e-3  # of the top speed: who is no faster at the start does not go on like that


FIT = FirstFit()
LEAST_DIVISOR = 1e-9  # s, m/s: against division by zero


def trip_along(problem: Problem, way: Way, smoothing: float = FIT.smoothing) -> Trajectory:
    """Fit a trip to a way: a smooth path, and a drive within the limits that keeps the way's times."""
    space, ends = problem.space, problem.ends
    theta = ends.theta.copy()
    rows = space.path.rows(way.stations / space.length)
    smooth = space.tables.station_bends * (smoothing / space.length**2)
    free = ends.free
    matrix = np.concatenate([rows[:, free], smooth[:, free]])
    target = np.concatenate([way.offsets - rows @ theta, -smooth @ theta])
    theta[free] = np.linalg.solve(matrix.T @ matrix, matrix.T @ target)
    np.clip(theta[free], ends.lower[free], ends.upper[free], out=theta[free])
    path = Path(space, theta)
    driven = path.arc_length_at(way.stations / space.length)
    times = way.times
    beta = _drive(problem, times, driven)
    if problem.scenario.vehicle.max_jerk is not None:
        # Ways know nothing of the jerk: they are driven as much slower as it takes
        for slower in FIT.slower:
            if _arrives(space, beta, float(times[-1]), float(path.arc_length)):
                break
            times = slower * way.times
            beta = _drive(problem, times, driven)
    fastest = _fastest_drive(problem, float(path.arc_length))
    trip = Trajectory.of(space, theta, beta, float(times[-1]))
    while not np.isfinite(trip.travel_time):  # the fit stops short of the goal
        beta = 0.5 * (beta + fastest)
        trip = Trajectory.of(space, theta, beta)
    return trip


def _arrives(space: TripSpace, beta: Array, time: float, length: float) -> bool:
    """True if accelerations drive about a length, m, in a time, s."""
    driven = space.start_speed * time + time * time * float(space.drive.final_distance @ beta)
    return abs(driven - length) < FIT.missed * length


def _fastest_drive(problem: Problem, length: float) -> Array:
    """Accelerations of a trip without obstacles and with a free goal speed, which always arrives."""
    space, limits = problem.space, problem.limits
    top = max(limits.speed, space.start_speed)
    rising = (top - space.start_speed) / limits.acceleration
    ramp = 0.5 * (top + space.start_speed) * rising
    if length < ramp:
        time = 2.0 * length / (space.start_speed + np.sqrt(space.start_speed**2 + 2.0 * limits.acceleration * length))
    else:
        time = rising + (length - ramp) / top
    sites = space.acceleration.breakpoints[:-1] * time
    beta = np.zeros(space.acceleration_size)
    beta[: len(sites)] = np.where(sites < rising, limits.acceleration, 0.0)
    return beta


def _drive(problem: Problem, times: Array, driven: Array) -> Array:
    """Accelerations within the limits that come closest to having driven given distances at given times."""
    space, limits = problem.space, problem.limits
    tau = float(times[-1])
    table = space.time_table(times / tau)
    matrix = tau * tau * table.distance
    matrix[-1] *= FIT.arrival_weight
    wanted = driven - space.start_speed * times
    wanted[-1] *= FIT.arrival_weight
    goal_speed = problem.ends.goal_speed
    if goal_speed is not None:
        matrix = np.vstack([matrix, FIT.arrival_weight * tau * space.drive.final_speed])
        wanted = np.append(wanted, FIT.arrival_weight * (goal_speed - space.start_speed))
    size = space.acceleration_size
    speeds = tau * space.drive.speed_control[1:]
    jerk, most = np.zeros((0, size)), problem.scenario.vehicle.max_jerk
    if most is not None:
        jerk = jerk_matrix(space) / tau
    program = QuadraticProgram(
        matrix.T @ matrix + FIT.drive_smoothing * np.eye(size),
        -matrix.T @ wanted,
        problem.lowest_accelerations,
        _highest(problem, times, driven),
        np.concatenate([speeds, -speeds, jerk, -jerk]),
        np.concatenate(
            [
                problem.highest_speeds(limits.speed, tau) - space.start_speed,
                np.full(len(speeds), space.start_speed),
                np.full(2 * len(jerk), most or 0.0),
            ]
        ),
        0,
    )
    solution = solver_named("daqp").solve(program)
    if solution.status is SolverStatus.OPTIMAL:
        return solution.x
    return np.clip(np.zeros(size), -limits.deceleration, limits.acceleration)


def _highest(problem: Problem, times: Array, driven: Array) -> Array:
    """Upper bounds of the accelerations: what the motor gives at about the speeds of a drive, (K2,)."""
    power, basis = problem.scenario.vehicle.max_power, problem.space.acceleration
    if power is None:
        return problem.highest_accelerations
    breakpoints = tuple(basis.breakpoints.tolist())
    sites = greville_sites(breakpoints, basis.coefficients.shape[1] - 1) * times[-1]
    passed = np.maximum(np.diff(times), LEAST_DIVISOR)
    speed = np.interp(sites, times[:-1] + 0.5 * passed, np.diff(driven) / passed)
    least = power / problem.limits.speed
    return np.minimum(problem.highest_accelerations, np.maximum(power / np.maximum(speed, LEAST_DIVISOR), least))


def arcs(problem: Problem) -> Iterator[Trajectory]:
    """Yield arcs to both sides, driven fast, then slowly: what to start from where the search finds no way."""
    space, ends = problem.space, problem.ends
    shape = np.sin(np.pi * np.linspace(0.0, 1.0, space.path_size))
    for speeding in (0.6, 0.0):
        for height in (0.0, 1.5, -1.5, 3.0, -3.0):
            theta = ends.around(np.clip(height * shape, ends.lower, ends.upper)[ends.free])
            beta = np.zeros(space.acceleration_size)
            beta[: max(1, space.acceleration_size // 5)] = speeding * problem.limits.acceleration
            if space.start_speed <= FIT.crawling * problem.limits.speed:
                beta[:] = np.maximum(beta, 0.05 * problem.limits.acceleration)
            yield Trajectory.of(space, theta, beta)
