"""Rate of the curvature: along the path dk/dt = v (dk/ds) / |r'|."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from scp_planner.arrays import Array
from scp_planner.constraints.constraint import Constraint, TwoSidedLimit
from scp_planner.constraints.setup import Setup
from scp_planner.constraints.speed_limits import squared_speed_gradient
from scp_planner.trips.path import Path, curvature_rate_from
from scp_planner.trips.space import CELLS_PER_SPAN, TimeTable
from scp_planner.trips.trajectory import Trajectory

IN_SPAN = np.array([1e-6, 0.2, 0.4, 0.6, 0.8, 1.0 - 1e-6])  # places in each span of the offset
IN_CELLS = ((np.arange(CELLS_PER_SPAN)[:, None] + np.array([5e-6, 1.0 - 5e-6])) / CELLS_PER_SPAN).ravel()
"""Over a curved guide, whose curvature has another second derivative in each cell: both sides of each border."""

SLOWEST_TURN = 1e-3  # units of speed; the derivative of a speed that is a root is taken no nearer to 0
DIFFERENCE = 1e-6  # of the guide, to either side
IMAGINARY = 1e-30  # step of the derivatives


class CurvatureRate(TwoSidedLimit):
    """Excess |dk/dt| / limit - 1 in places of each span and at the jumps of the acceleration."""

    name: ClassVar[str] = "curvature_rate"
    near: ClassVar[float] = np.inf  # a straight path is steered too fast after one step

    @cached_property
    def _parameters(self) -> Array:
        space = self.setup.space
        spans, places = len(space.path.widths), IN_SPAN if space.guide.straight else IN_CELLS
        return ((np.arange(spans)[:, None] + places) / spans).ravel()

    @cached_property
    def _jumps(self) -> TimeTable:
        space = self.setup.space
        return space.time_table(space.acceleration.breakpoints[1:-1] if space.drive.constant else np.zeros(0))

    def use(self, trip: Trajectory) -> Array:
        sites = self._sites(trip)
        return sites.speed * sites.rate / self.limit

    def slopes(self, trip: Trajectory) -> Array:
        # At fixed stations, and at jumps of the acceleration, which move by dD - dS
        setup, sites, basis = self.setup, self._sites(trip), self.setup.space.path
        free, moves = setup.ends.free, len(self._parameters)
        table = setup.space.time_table(sites.sigma)
        acceleration = table.acceleration @ trip.beta
        acceleration[moves:] = 0.0
        gradient = squared_speed_gradient(setup, trip, sites.parameter, sites.sigma, sites.speed, acceleration)
        gradient *= (sites.rate / (2.0 * np.maximum(sites.speed, SLOWEST_TURN)))[:, None]
        span, local = basis.locate(sites.parameter)
        scale = 1.0
        for partial in rate_partials(trip.path, sites.parameter):
            rows = basis.rows_at(span, local)[:, free]
            gradient[:, : rows.shape[1]] += (scale * sites.speed * partial)[:, None] * rows
            basis, scale = basis.derivative, scale / setup.space.length
        there, tau, count = sites.parameter[moves:], trip.travel_time, setup.free_size
        driven = sites.speed[moves:] * self._rate_along(trip.path, there)
        gradient[moves:, :count] -= driven[:, None] * trip.path.arc_length_gradient(there)[:, free]
        gradient[moves:, count:-1] += (tau**2 * driven)[:, None] * table.distance[moves:]
        gradient[moves:, -1] += setup.space.start_speed * tau * driven * sites.sigma[moves:]
        return gradient / self.limit

    def _rate_along(self, path: Path, parameter: Array) -> Array:
        """Derivative of dk/ds by the arc length at normalised stations, (n,) 1/m^3."""
        before, after = (path.points(np.clip(parameter + sign * DIFFERENCE, 0.0, 1.0)) for sign in (-1.0, 1.0))
        change = path.curvature_rate(after) / after.speed - path.curvature_rate(before) / before.speed
        middle = 0.5 * (before.speed + after.speed)
        slope: Array = change / (middle * np.maximum(after.station - before.station, 1e-300))
        return slope

    def _sites(self, trip: Trajectory) -> _RateSites:
        path = trip.path
        arrivals = trip.arrivals(path.arc_length_at(self._parameters))
        jumps = trip.at(self._jumps)
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
    """Partial derivatives of dk/ds along the path by f, f', f'' and f''' at normalised stations, (n,) each."""
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


def curvature_rate(setup: Setup) -> Iterator[Constraint]:
    """Make the limit of how fast a vehicle steers."""
    if setup.vehicle.max_curvature_rate is not None:
        yield CurvatureRate(setup, setup.vehicle.max_curvature_rate * setup.kept)
