"""The rest of a trip as a trip of its own: the warm start of a replan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.constraints.passing import in_order
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.ramps import Ramps
from scp_planner.online.tolerances import LENGTH, OFF, RELATIVE
from scp_planner.problem.problem import Problem
from scp_planner.scenario.models import Bounds, Vehicle
from scp_planner.trips.guide import Guide
from scp_planner.trips.trajectory import Trajectory, arriving
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class TripSamples:
    """Samples of a trip: times on its clock, (n,) s, and positions in its frame, (n, 2) m."""

    time: Array
    position: Array

    @classmethod
    def of(cls, trip: Trip, sigma: Array) -> TripSamples:
        trajectory = trip.trajectory
        parameters = trajectory.path.parameter_at(trajectory.drive_at(sigma).distance)
        return cls(trajectory.travel_time * sigma, trajectory.path.points(parameters).position)


def _guide_from(guide: Sequence[tuple[float, float]], position: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    points = np.array(guide)
    legs = np.diff(points, axis=0)
    squared = np.maximum((legs * legs).sum(axis=1), 1e-300)
    share = np.clip(((np.array(position) - points[:-1]) * legs).sum(axis=1) / squared, 0.0, 1.0)
    away = np.hypot(*(points[:-1] + share[:, None] * legs - np.array(position)).T)
    leg = int(np.argmin(away))
    # The next vertex is left out if the vehicle is about to pass it: a guide does not turn back.
    ahead = [tuple(point) for point in points[leg + 1 :].tolist()]
    while len(ahead) > 1 and math.dist(ahead[0], position) < 2.0 * away[leg] + OFF:
        ahead.pop(0)
    return (position, *ahead)


@dataclass(frozen=True)
class RemainingParameters:
    path_samples: int = 49  # Samples of the old path that the new one is fitted to
    # Square units of length. Weight of bending against offsets in the fit: only what the samples leave open
    bending: float = 1e-4
    way_back: float = 2.0  # Units of length of path on which the vehicle is led back to the old path
    way_back_times: float = 8.0  # Its distances from the old path on which it is led back, if that is more
    catching_up: float = 0.3  # Share of the limits of acceleration that is used to get back to the planned speed
    # Units of length, between the points of a curved guide that nearest ones are looked for among
    guide_step: float = 0.25
    most_stations: int = 100_000  # Points of a guide, however far away the vehicle says that it is


REMAINING = RemainingParameters()


@dataclass(frozen=True)
class State:
    time: float  # Absolute, s
    position: tuple[float, float]  # m, world coordinates
    heading: float | None  # rad; None: free, as for a vehicle that stands and can turn on the spot
    speed: float  # m/s
    acceleration: float | None = None  # Along the path, m/s^2; None: it may jump
    front: float | None = None

    @classmethod
    def at_end(cls, trip: Trip) -> State:
        """Return the state in which a trip arrives."""
        time = trip.frame.time + trip.trajectory.travel_time
        points, _ = trip.at(time)
        ((x, y),) = trip.frame.to_world(points.path.position).tolist()
        ((ahead, aside),) = trip.frame.vectors_to_world(points.path.direction).tolist()
        return cls(time, (x, y), math.atan2(aside, ahead), float(points.speed[0]), float(points.acceleration[0]))

    @property
    def backwards(self) -> bool:
        """True if it drives with its front behind."""
        return self.heading is not None and self.front is not None and math.cos(self.heading - self.front) < 0.0


def bounds_round(bounds: Bounds, vehicle: Vehicle, state: State) -> Bounds:
    """Return bounds that are larger on the sides on which the vehicle is outside: it may go no farther out."""
    ahead = 0.0 if state.heading is None else state.heading
    discs = np.outer(vehicle.discs, (math.cos(ahead), math.sin(ahead))) + state.position
    low, high = discs.min(axis=0) - vehicle.radius, discs.max(axis=0) + vehicle.radius
    wider = np.where(low < bounds.min, low - OFF, bounds.min), np.where(high > bounds.max, high + OFF, bounds.max)
    if np.array_equal(wider, (bounds.min, bounds.max)):
        return bounds
    return bounds.model_copy(update={"min": tuple(wider[0].tolist()), "max": tuple(wider[1].tolist())})


def driven_at(trip: Trip, time: float) -> float:
    """Normalised time of a trip at an absolute time, s."""
    return min(max((time - trip.frame.time) / trip.trajectory.travel_time, 0.0), 1.0)


def remaining_trip(problem: Problem, old: Trip, state: State, *, led: bool = False) -> Trajectory:
    """Fit what is left of a trip at a state, in the space of a problem that begins there.

    A trip that is led goes to the problem's goal, which has moved: its path is bent evenly.
    """
    trajectory, first = old.trajectory, driven_at(old, state.time)
    theta = _path(problem, old, first, led)
    if state.acceleration is not None:
        return _ramped(problem, theta, trajectory, first, state)
    beta = _drive(problem, trajectory, first, state.speed)
    return arriving(problem.space, theta, beta, problem.limits.acceleration)


def path_ahead(old: Trip, first: float, frame: PlanningFrame, goal: tuple[float, float] | None) -> Array:
    """Points, (n, 2) m in a frame, of a trip from a normalised time on, bent evenly to a goal if that is given."""
    trajectory = old.trajectory
    now = trajectory.at(trajectory.space.time_table(np.array([first])))
    parameters = np.linspace(float(now.parameter[0]), 1.0, REMAINING.path_samples)
    ahead: Array = frame.to_frame(old.frame.to_world(trajectory.path.points(parameters).position))
    if goal is not None:
        ahead += np.linspace(0.0, 1.0, len(ahead))[:, None] ** 2 * (frame.to_frame(np.array(goal)) - ahead[-1])
    return ahead


def _path(problem: Problem, old: Trip, first: float, led: bool) -> Array:
    space, ends = problem.space, problem.ends
    ahead = path_ahead(old, first, problem.frame, problem.scenario.goal.position if led else None)
    x, y = _over(space.guide, ahead)
    off = float(y[0])
    back = min(max(REMAINING.way_back, REMAINING.way_back_times * abs(off)), space.length)
    left = np.minimum(np.maximum(x / back, 0.0), 1.0)
    y = y - off * (1.0 - left) ** 2 * (1.0 + 2.0 * left)
    # A path over the guide goes forward; what does not (an arc driven backwards along the new guide) is left out.
    forward = np.maximum.accumulate(x) <= x + LENGTH
    forward &= (x >= 0.0) & (x <= space.length)
    x, y = x[forward], y[forward]
    theta = ends.theta.copy()
    free = ends.free
    rows = space.path.rows(x / space.length)
    smooth = space.tables.station_bends * (REMAINING.bending / space.length**2)
    target = y - rows @ theta
    bend = -smooth @ theta
    rows, smooth = rows[:, free], smooth[:, free]
    matrix = rows.T @ rows + smooth.T @ smooth
    matrix.flat[:: len(matrix) + 1] += 1e-12
    theta[free] = np.linalg.solve(matrix, rows.T @ target + smooth.T @ bend)
    return theta


def _over(guide: Guide, points: Array) -> tuple[Array, Array]:
    """Stations and offsets of points (n, 2) m over a guide, (n,) m each."""
    if guide.straight:
        return points[:, 0], points[:, 1]
    steps = min(max(2, round(guide.length / REMAINING.guide_step)), REMAINING.most_stations)
    stations = np.linspace(0.0, guide.length, steps + 1)
    away = points[:, None] - guide.frame(stations).position
    nearest = stations[in_order((away * away).sum(axis=2))]  # one after the other, where it comes by a place twice
    for _ in range(2):
        frame = guide.frame(nearest)
        relative = points - frame.position
        along = (relative * frame.tangent).sum(axis=1)
        across = (relative * frame.normal).sum(axis=1)
        nearest = np.clip(nearest + along / np.maximum(1.0 - frame.curvature * across, 0.1), 0.0, guide.length)
    frame = guide.frame(nearest)
    return nearest, ((points - frame.position) * frame.normal).sum(axis=1)


def _drive(problem: Problem, old: Trajectory, first: float, speed: float) -> Array:
    """Accelerations, piecewise constant, that keep the planned speeds; or those at the middles of their spans."""
    space, limits = problem.space, problem.limits
    breaks = space.acceleration.breakpoints
    left = max((1.0 - first) * old.travel_time, 1e-3)
    planned = old.speed_at(first + (1.0 - first) * breaks)
    ahead = speed - float(planned[0])
    rate = REMAINING.catching_up * (limits.deceleration if ahead > 0.0 else limits.acceleration)
    wanted = planned + np.sign(ahead) * np.maximum(abs(ahead) - rate * left * breaks, 0.0)
    wanted = np.minimum(np.maximum(wanted, 0.0), max(limits.speed, speed))
    mean = np.diff(wanted) / (np.diff(breaks) * left)
    mean = np.minimum(np.maximum(mean, -limits.deceleration), limits.acceleration)
    if space.acceleration_size == len(mean):
        return mean
    sites = np.linspace(0.0, 1.0, space.acceleration_size)
    return np.interp(sites, 0.5 * (breaks[1:] + breaks[:-1]), mean)


def _ramped(problem: Problem, theta: Array, old: Trajectory, first: float, state: State) -> Trajectory:
    """The planned accelerations, from the present one on; as fast as may be where with these it does not arrive."""
    space, limits = problem.space, problem.limits
    breaks = space.acceleration.breakpoints
    left = max((1.0 - first) * old.travel_time, 1e-3)
    planned = old.drive_at(first + (1.0 - first) * breaks)
    ahead = state.speed - float(planned.speed[0])
    rate = REMAINING.catching_up * (limits.deceleration if ahead > 0.0 else limits.acceleration)
    wanted = planned.acceleration - np.sign(ahead) * rate * (breaks * left < abs(ahead) / rate)
    wanted = np.clip(wanted, -limits.deceleration, limits.acceleration)
    trip = Trajectory.of(space, theta, _from(state.acceleration, wanted, _most_change(problem, left)))
    if np.isfinite(trip.travel_time):
        return trip
    fastest = _fastest(problem, float(trip.path.arc_length), state)
    return arriving(space, theta, fastest, limits.acceleration)


def _fastest(problem: Problem, length: float, state: State) -> Array:
    """Accelerations at breakpoints of a drive that speeds up along ramps from the present acceleration on."""
    limits = problem.limits
    speed, acceleration = np.array([state.speed]), np.array([state.acceleration])
    top = np.array([max(limits.speed, state.speed)])
    ramps = Ramps.between(speed, acceleration, top, limits.acceleration, limits.deceleration, _jerk(problem))
    time = float(ramps.duration[0] + max(length - ramps.way[0], 0.0) / top[0])
    return np.interp(problem.space.acceleration.breakpoints * time, ramps.knots[0], ramps.acceleration[0])


def _most_change(problem: Problem, duration: float) -> Array:
    """By how much the jerk lets accelerations change from breakpoint to breakpoint of a trip, s, m/s^2."""
    return _jerk(problem) * duration * np.diff(problem.space.acceleration.breakpoints)


def _jerk(problem: Problem) -> float:
    jerk = problem.scenario.vehicle.max_jerk
    assert jerk is not None, "the acceleration may not jump"
    return jerk


def _from(first: float | None, wanted: Array, change: Array) -> Array:
    """Accelerations at breakpoints that begin with a given one, and follow wanted ones as soon as they may."""
    values = wanted.copy()
    values[0] = first
    for number, most in enumerate(change.tolist()):
        before = values[number]
        values[number + 1] = min(max(values[number + 1], before - most), before + most)
    return values


def eased(problem: Problem, ahead: Trajectory, share: float) -> Array:
    """Accelerations of a trip that eases off at first, and then goes on."""
    beta = ahead.beta.copy()
    least = share * max(beta[0], 0.0) - (1.0 - share) * problem.limits.deceleration
    if problem.ends.start_acceleration is None:
        beta[0] = least
        return beta
    breaks = problem.space.acceleration.breakpoints
    beta[breaks <= breaks[-1] - breaks[-2] + RELATIVE] = least
    return _from(problem.ends.start_acceleration, beta, _most_change(problem, ahead.travel_time))
