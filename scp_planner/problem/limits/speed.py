"""Limits of the speed at places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.problem.limits.inputs import LimitInputs
from scp_planner.problem.limits.limit import OptionalLimit
from scp_planner.scenario.places import Stretch, limits_at
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory

BESIDE = 1e-7  # of the travel time; next to a border
ON_BORDER = 1e-6  # of a cell between stations
JUMP_STEPS, JUMP_PARTS = 4, 128  # to where the stations along the line jump over a border
CROSSING_STEPS = 3  # of a secant that the positions along the line hardly bend off


@dataclass(frozen=True)
class _SpeedSites:
    """Squared speeds in places, and how they depend on a step.

    Attributes
    ----------
    parameter, sigma, speed, acceleration : (n,) arrays
        Normalised station and time, m/s, m/s^2.
    limit : (n,) array
        m/s; inf where there is none.
    """

    parameter: Array
    sigma: Array
    speed: Array
    acceleration: Array
    limit: Array


@dataclass(frozen=True)
class _Looked:
    """A trip and its places."""

    trajectory: Trajectory
    sites: _SpeedSites


class SpeedLimits(OptionalLimit):
    """How fast stretches of a line may be driven: excess v^2 / limit^2 - 1.

    Looked at at the fixed stations, where the path crosses the borders of the stretches, and at the jumps of the
    acceleration, where the speed peaks.

    Parameters
    ----------
    space : TripSpace
    free : slice
        The free control points of the offset.
    stretches : tuple of Stretch
        In the planning frame, with the speeds to be kept to.
    """

    name: ClassVar[str] = "speed_limits"
    reach: ClassVar[float] = 0.6

    def __init__(self, space: TripSpace, free: slice, stretches: tuple[Stretch, ...]) -> None:
        self.space = space
        self.free = free
        self.stretches = stretches
        self._jumps = space.time_table(space.acceleration.breakpoints[1:-1])
        self._last: _Looked | None = None

    def tightened(self, more: float) -> SpeedLimits:
        """Return lower limits."""
        if more == 0.0:
            return self
        lower = tuple(replace(part, speed=part.speed * (1.0 - more)) for part in self.stretches)
        return SpeedLimits(self.space, self.free, lower)

    def excess(self, trajectory: Trajectory) -> Array:
        """Return v^2 / limit^2 - 1 in all places."""
        sites = self._sites(trajectory)
        return np.where(np.isfinite(sites.limit), (sites.speed / sites.limit) ** 2 - 1.0, -np.inf)

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradient at fixed stations, or at fixed normalised times for jumps."""
        sites = self._sites(trajectory)
        fixed_time = index >= len(sites.sigma) - len(self._jumps.sigma)
        gradient = squared_speed_gradient(
            trajectory,
            self.free,
            sites.parameter[index],
            sites.sigma[index],
            sites.speed[index],
            np.where(fixed_time, 0.0, sites.acceleration[index]),
        )
        first = len(self.space.tables.station_parameters)
        gates = np.flatnonzero((index >= first) & ~fixed_time)
        count = self.free.stop - self.free.start
        moved = self._gate_moves(trajectory.path, index[gates] - first, sites.parameter[index[gates]])
        gradient[gates, :count] += (2.0 * sites.acceleration[index[gates]])[:, None] * moved
        return gradient / (sites.limit[index] ** 2)[:, None]

    def _gate_moves(self, path: Path, gates: Index, parameter: Array) -> Array:
        """How far along the path a step of the offset moves its crossings of borders, (m, K1 free) m."""
        borders = np.array([(part.first, part.last) for part in self.stretches]).ravel()[gates]
        lines = [self.stretches[gate // 2].line for gate in gates.tolist()]
        points = path.points(parameter)
        places = zip(lines, points.position, borders, strict=True)
        tangent = np.array([line.across_border(place, at) for line, place, at in places]).reshape(-1, 2)
        sideways = np.einsum("ij,ij->i", tangent, np.broadcast_to(points.normal, tangent.shape))
        along = np.einsum("ij,ij->i", tangent, points.direction) / points.speed
        rows = self.space.path.rows_at(points.span, points.local)[:, self.free]
        moves: Array = -(sideways / along)[:, None] * rows
        return moves

    def _sites(self, trajectory: Trajectory) -> _SpeedSites:
        """The places of a trip: of the last one they are known, as its gradient is asked for after its excess."""
        last = self._last
        if last is None or last.trajectory is not trajectory:
            last = self._last = _Looked(trajectory, self._looked_for(trajectory))
        return last.sites

    def _looked_for(self, trajectory: Trajectory) -> _SpeedSites:
        space, path = self.space, trajectory.path
        stations = space.tables.station_parameters
        gates, sides, speeds = self._gates(path)
        driven = np.concatenate([path.station_arc_lengths, path.arc_length_at(np.maximum(gates, 0.0))])
        arrivals = trajectory.arrivals(driven)
        side = np.concatenate([np.zeros(len(stations)), sides])
        beside = np.clip(arrivals.sigma + BESIDE * side, 0.0, 1.0)
        jumps = trajectory.at(self._jumps)
        return _SpeedSites(
            np.concatenate([stations, np.maximum(gates, 0.0), jumps.parameter]),
            np.concatenate([arrivals.sigma, self._jumps.sigma]),
            np.concatenate([arrivals.speed, jumps.speed]),
            np.concatenate([space.time_table(beside).acceleration @ trajectory.beta, jumps.acceleration]),
            np.concatenate(
                [
                    limits_at(self.stretches, path.station_positions),
                    np.where(gates >= 0.0, speeds, np.inf),
                    limits_at(self.stretches, jumps.path.position),
                ]
            ),
        )

    def _gates(self, path: Path) -> tuple[Array, Array, Array]:
        """Normalised stations at which the path first crosses each border, -1 if it does not; side; limit.

        The side is that on which the acceleration counts: where the speed is a maximum of two pieces at a border
        that the acceleration jumps at, before entering and after leaving.
        """
        stations = self.space.tables.station_parameters
        gates: list[float] = []
        for part in self.stretches:
            along = part.line.nearest(path.station_positions)
            gates.extend(_crossing(path, part, stations, along, border) for border in (part.first, part.last))
        sides = np.tile([-1.0, 1.0], len(self.stretches))
        return np.array(gates), sides, np.repeat([part.speed for part in self.stretches], 2)


def squared_speed_gradient(
    trajectory: Trajectory, free: slice, parameter: Array, sigma: Array, v: Array, a: Array
) -> Array:
    """Gradient of the squared speed at fixed stations with respect to a step, (m, step).

    d(v^2) = 2 v (C1 db / tau - (v - v0) rho) + 2 a (dS - C2 db - v0 sigma tau rho), regular also at v = 0. At fixed
    normalised times the second part is left out: a = 0.

    Parameters
    ----------
    trajectory : Trajectory
    free : slice
        The free control points of the offset.
    parameter, sigma, v, a : (m,) arrays
        Normalised stations and times; speeds in m/s and accelerations in m/s^2 there.

    Returns
    -------
    (m, step) array
        m^2/s^2 for each unit of the step.
    """
    space, tau = trajectory.space, trajectory.travel_time
    table, v0 = space.time_table(sigma), space.start_speed
    theta = (2.0 * a)[:, None] * trajectory.path.arc_length_gradient(parameter)[:, free]
    beta = (2.0 * tau * v)[:, None] * table.speed - (2.0 * tau * tau * a)[:, None] * table.distance
    rho = -2.0 * (v * (v - v0) + a * v0 * tau * sigma)
    return np.concatenate([theta, beta, rho[:, None]], axis=1)


def _crossing(path: Path, part: Stretch, stations: Array, along: Array, border: float) -> float:
    """Normalised station at which a path first crosses a border of a stretch upwards; -1 if it does not."""
    for cell in np.flatnonzero((along[:-1] < border) & (along[1:] >= border)).tolist():
        gate = _crossing_in(path, part, stations[cell : cell + 2], along[cell : cell + 2], border)
        if gate >= 0.0:
            return gate
    return -1.0


def _crossing_in(path: Path, part: Stretch, cell: Array, along: Array, border: float) -> float:
    """The same within a cell; -1 where the stations jump over all of the stretch, and the path is never in it."""
    low, high = cell.tolist()
    slope = float(along[1] - along[0]) / (high - low)
    guess = low + (border - float(along[0])) / slope
    for _ in range(CROSSING_STEPS):
        here = part.line.nearest(path.points(np.array([guess])).position)[0]
        guess = min(max(guess + (border - here) / slope, low), high)
    here = part.line.nearest(path.points(np.array([guess])).position)[0]
    if abs(here - border) < ON_BORDER * float(along[1] - along[0]):
        return float(guess)
    # Inside of a bend of the line the stations jump over the border.
    for _ in range(JUMP_STEPS):
        trials = np.linspace(low, high, JUMP_PARTS + 1)
        beyond = part.line.nearest(path.points(trials[1:-1]).position) >= border
        first = int(np.argmax(np.append(beyond, True)))
        low, high = float(trials[first]), float(trials[first + 1])
    inside = part.line.nearest(path.points(np.array([high if border == part.first else low])).position)[0]
    return high if part.first <= inside <= part.last else -1.0


def speed_limits(inputs: LimitInputs) -> Iterator[OptionalLimit]:
    """Make the limits of stretches, if there are any."""
    if inputs.slow:
        yield SpeedLimits(inputs.space, inputs.free, inputs.slow)
