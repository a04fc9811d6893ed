"""How fast acceleration and curvature may change: optional limits of the vehicle.

Jerk. With b = tau^2 beta the control points of da/dt are R b / tau^3, R those of the derivative of a spline from those
of the spline. They bound the jerk at all times, by convexity.

Curvature rate. Along the path dk/dt = v (dk/ds) / |r'|. On a span of a cubic offset dk/ds is smooth, at breakpoints
it jumps: so it is looked at on both sides of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.splines import clamped_knots
from scp_planner.problem.limits.inputs import LimitInputs
from scp_planner.problem.limits.limit import OptionalLimit
from scp_planner.problem.limits.speed import squared_speed_gradient
from scp_planner.trips.path import Path, curvature_rate_from
from scp_planner.trips.space import CELLS_PER_SPAN, TripSpace
from scp_planner.trips.trajectory import Trajectory

IN_SPAN = np.array([1e-6, 0.2, 0.4, 0.6, 0.8, 1.0 - 1e-6])  # places in each span of the offset
IN_CELLS = ((np.arange(CELLS_PER_SPAN)[:, None] + np.array([5e-6, 1.0 - 5e-6])) / CELLS_PER_SPAN).ravel()
"""Over a curved guide, whose curvature has another second derivative in each cell: both sides of each border."""

SLOWEST = 1e-3  # units of speed; the derivative of a speed that is a root is taken no nearer to 0
DIFFERENCE = 1e-6  # of the guide, to either side
IMAGINARY = 1e-30  # step of the derivatives


@dataclass(frozen=True)
class JerkLimit(OptionalLimit):
    """Excess |da/dt| / limit - 1 at the control points of the jerk, on both sides.

    Attributes
    ----------
    space : TripSpace
        Its acceleration has a degree of at least 1.
    free_size : int
        Number of free control points of the offset.
    limit : float
        m/s^3.
    """

    name: ClassVar[str] = "jerk"
    near: ClassVar[float] = np.inf

    space: TripSpace
    free_size: int
    limit: float

    def excess(self, trajectory: Trajectory) -> Array:
        """Return |da/dt| / limit - 1, first for rising accelerations, then for falling ones."""
        use = self._use(trajectory)
        return np.concatenate([use - 1.0, -use - 1.0])

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradient of R b / tau^3."""
        use = self._use(trajectory)
        rows = jerk_matrix(self.space) / (self.limit * trajectory.travel_time)
        beta, rho = np.concatenate([rows, -rows])[index], np.concatenate([-3.0 * use, 3.0 * use])[index]
        return np.concatenate([np.zeros((len(index), self.free_size)), beta, rho[:, None]], axis=1)

    def _use(self, trajectory: Trajectory) -> Array:
        return (jerk_matrix(self.space) @ trajectory.beta) / (self.limit * trajectory.travel_time)


def jerk_matrix(space: TripSpace) -> Array:
    """Control points of the acceleration's derivative in normalised time from those of the acceleration."""
    degree = space.acceleration.coefficients.shape[1] - 1
    knots = clamped_knots(degree, space.acceleration.breakpoints)
    count = space.acceleration_size - 1
    weights = degree / (knots[degree + 1 : degree + 1 + count] - knots[1 : 1 + count])
    return weights[:, None] * (np.eye(count, count + 1, 1) - np.eye(count, count + 1))


class CurvatureRateLimit(OptionalLimit):
    """Excess |dk/dt| / limit - 1, on both sides, in places of each span and at the jumps of the acceleration.

    Parameters
    ----------
    space : TripSpace
    free : slice
        The free control points of the offset.
    limit : float
        1/(m s).
    """

    name: ClassVar[str] = "curvature_rate"
    near: ClassVar[float] = np.inf  # a straight path is steered too fast after one step

    def __init__(self, space: TripSpace, free: slice, limit: float) -> None:
        self.space = space
        self.free = free
        self.limit = limit
        spans = len(space.path.widths)
        places = IN_SPAN if space.guide.straight else IN_CELLS
        self._parameters = ((np.arange(spans)[:, None] + places) / spans).ravel()
        jumps = space.acceleration.breakpoints[1:-1] if space.tables.constant else np.zeros(0)
        self._jumps = space.time_table(jumps)

    def tightened(self, more: float) -> CurvatureRateLimit:
        """Return a lower limit."""
        return CurvatureRateLimit(self.space, self.free, self.limit * (1.0 - more)) if more else self

    def excess(self, trajectory: Trajectory) -> Array:
        """Return |dk/dt| / limit - 1: to the left, then to the right."""
        sites = self._sites(trajectory)
        use = sites.speed * sites.rate / self.limit
        return np.concatenate([use - 1.0, -use - 1.0])

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradient: at fixed stations, and at jumps of the acceleration, which move by dD - dS."""
        count = len(self._parameters) + len(self._jumps.sigma)
        places, which = np.unique(index % count, return_inverse=True)  # both sides of a place have one gradient
        sign = np.where(index < count, 1.0, -1.0) / self.limit
        return self._rates_gradient(trajectory, places)[which] * sign[:, None]

    def _rates_gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Gradient of dk/dt in some of the sites, (m, step) 1/(m s)."""
        sites, basis, length = self._sites(trajectory), self.space.path, self.space.length
        parameter, sigma, speed = sites.parameter[index], sites.sigma[index], sites.speed[index]
        fixed_time = index >= len(self._parameters)
        table = self.space.time_table(sigma)
        acceleration = np.where(fixed_time, 0.0, table.acceleration @ trajectory.beta)
        gradient = squared_speed_gradient(trajectory, self.free, parameter, sigma, speed, acceleration)
        gradient *= (sites.rate[index] / (2.0 * np.maximum(speed, SLOWEST)))[:, None]
        span, local = basis.locate(parameter)
        scale = 1.0
        for partial in rate_partials(trajectory.path, parameter):
            rows = basis.rows_at(span, local)[:, self.free]
            gradient[:, : rows.shape[1]] += (scale * speed * partial)[:, None] * rows
            basis, scale = basis.derivative, scale / length
        if fixed_time.any():
            moving = speed * np.where(fixed_time, self._rate_along(trajectory.path, parameter), 0.0)
            count = self.free.stop - self.free.start
            gradient[:, :count] -= moving[:, None] * trajectory.path.arc_length_gradient(parameter)[:, self.free]
            gradient[:, count:-1] += (trajectory.travel_time**2 * moving)[:, None] * table.distance
            gradient[:, -1] += self.space.start_speed * trajectory.travel_time * moving * sigma
        return gradient

    def _rate_along(self, path: Path, parameter: Array) -> Array:
        """Derivative of dk/ds by the arc length at normalised stations, (n,) 1/m^3."""
        before, after = (path.points(np.clip(parameter + sign * DIFFERENCE, 0.0, 1.0)) for sign in (-1.0, 1.0))
        change = path.curvature_rate(after) / after.speed - path.curvature_rate(before) / before.speed
        middle = 0.5 * (before.speed + after.speed)
        slope: Array = change / (middle * np.maximum(after.station - before.station, 1e-300))
        return slope

    def _sites(self, trajectory: Trajectory) -> _RateSites:
        path = trajectory.path
        arrivals = trajectory.arrivals(path.arc_length_at(self._parameters))
        jumps = trajectory.at(self._jumps)
        parameter = np.concatenate([self._parameters, jumps.parameter])
        points = path.points(parameter)
        return _RateSites(
            parameter,
            np.concatenate([arrivals.sigma, self._jumps.sigma]),
            np.concatenate([arrivals.speed, jumps.speed]),
            path.curvature_rate(points) / points.speed,
        )


@dataclass(frozen=True)
class _RateSites:
    """Normalised stations and times, speeds in m/s, and dk/ds along the path in 1/m^2, (n,)."""

    parameter: Array
    sigma: Array
    speed: Array
    rate: Array


def rate_partials(path: Path, parameters: Array) -> list[Array]:
    """Partial derivatives of dk/ds along the path by f, f', f'' and f''' at normalised stations, (n,) each.

    By complex steps: exact to rounding.
    """
    points = path.points(parameters)
    basis, scale, values = path.space.path, 1.0, []
    for _ in range(4):
        values.append((basis.rows_at(points.span, points.local) @ path.theta) * scale)
        basis, scale = basis.derivative, scale / path.space.length
    curvature = None if path.space.frame is None else points.turning[:, 0]
    found = []
    for which in range(4):
        nudged: list[Any] = [value + (IMAGINARY * 1j if which == place else 0.0j) for place, value in enumerate(values)]
        f, q, bend, third = nudged
        stretch: Any = np.ones(len(f)) if curvature is None else 1.0 - curvature * f
        speed = np.sqrt(stretch * stretch + q * q)
        there = replace(points, offset=f, slope=q, stretch=stretch, speed=speed)
        found.append((curvature_rate_from(path.space, there, bend, third) / speed).imag / IMAGINARY)
    return found


def jerk_limit(inputs: LimitInputs) -> Iterator[OptionalLimit]:
    """Make the limit of a vehicle's jerk."""
    limit = inputs.vehicle.max_jerk
    if limit is not None:
        yield JerkLimit(inputs.space, inputs.free_size, limit * inputs.kept)


def curvature_rate_limit(inputs: LimitInputs) -> Iterator[OptionalLimit]:
    """Make the limit of how fast a vehicle steers."""
    limit = inputs.vehicle.max_curvature_rate
    if limit is not None:
        yield CurvatureRateLimit(inputs.space, inputs.free, limit * inputs.kept)
