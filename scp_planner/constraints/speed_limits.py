"""Limits of the speed at places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.constraints.constraint import Constraint, LastTrip
from scp_planner.constraints.setup import Setup
from scp_planner.scenario.places import Line, Stretch, followed, limits_at
from scp_planner.trips.path import Path
from scp_planner.trips.space import TimeTable
from scp_planner.trips.trajectory import Trajectory

BESIDE = 1e-7  # of the travel time; next to a border
ON_BORDER = 1e-6  # of a cell between stations
JUMP_STEPS, JUMP_PARTS = 4, 128  # to where the stations along the line jump over a border
SAME_PIECE = 1e-6  # of the largest acceleration: pieces that differ by less are one, as rounding tells which is larger
CROSSING_STEPS = 3  # of a secant that the positions along the line hardly bend off


@dataclass(frozen=True)
class _SpeedSites:
    """Speeds in places."""

    parameter: Array  # (n,): normalised stations
    sigma: Array  # (n,): normalised times
    speed: Array  # (n,), m/s
    acceleration: Array  # (n,), m/s^2
    limit: Array  # (n,): m/s; inf where there is none
    pieces: _OtherPieces  # of them, those that stand for other pieces of the acceleration


@dataclass(frozen=True)
class SpeedLimits(Constraint):
    name: ClassVar[str] = "speed_limits"
    near: ClassVar[float] = 0.6

    stretches: tuple[Stretch, ...]
    _last: LastTrip[_SpeedSites] = field(default_factory=LastTrip, init=False, repr=False, compare=False)

    @cached_property
    def _borders(self) -> _Borders:
        stretches = tuple(part for part in self.stretches for _ in range(2))
        return _Borders(stretches, np.array([at for part in self.stretches for at in (part.first, part.last)]))

    @cached_property
    def _jumps(self) -> TimeTable:
        return self.setup.space.time_table(self.setup.space.acceleration.breakpoints[1:-1])

    @cached_property
    def _about(self) -> About:
        """Stations of each line along the guide."""
        space = self.setup.space
        stations = space.tables.station_parameters
        driven = followed(self.stretches, space.guide.frame(stations * space.length).position)
        return About({line: one for line, one in driven.items() if one is not None}, stations)

    def tightened(self, more: float) -> SpeedLimits:
        if more == 0.0:
            return self
        return replace(self, stretches=tuple(replace(part, speed=part.speed * (1.0 - more)) for part in self.stretches))

    def excess(self, trajectory: Trajectory) -> Array:
        sites = self._sites(trajectory)
        return np.where(np.isfinite(sites.limit), (sites.speed / sites.limit) ** 2 - 1.0, -np.inf)

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        sites = self._sites(trajectory)
        fixed_time = index >= len(sites.sigma) - len(self._jumps.sigma)
        gradient = squared_speed_gradient(
            self.setup,
            trajectory,
            sites.parameter[index],
            sites.sigma[index],
            sites.speed[index],
            np.where(fixed_time, 0.0, sites.acceleration[index]),
        )
        first = len(self.setup.space.tables.station_parameters)
        gates = np.flatnonzero((index >= first) & ~fixed_time)
        count = self.setup.free_size
        border = (index[gates] - first) % len(self._borders.at)
        moved = self._gate_moves(trajectory.path, border, sites.parameter[index[gates]])
        gradient[gates, :count] += (2.0 * sites.acceleration[index[gates]])[:, None] * moved
        rows = gates[index[gates] >= first + len(self._borders.at)]
        pieces, each = sites.pieces, index[rows] - first - len(self._borders.at)
        further = 2.0 * trajectory.travel_time * pieces.speed[each] * pieces.since[each]
        gradient[rows, count + pieces.other[each]] += further
        gradient[rows, count + pieces.own[each]] -= further
        return gradient / (sites.limit[index] ** 2)[:, None]

    def _gate_moves(self, path: Path, gates: Index, parameter: Array) -> Array:
        points, borders = path.points(parameter), self._borders.of(gates)
        places = zip(borders.stretches, points.position, borders.at, strict=True)
        tangent = np.array([part.line.across_border(place, at) for part, place, at in places]).reshape(-1, 2)
        sideways = np.einsum("ij,ij->i", tangent, np.broadcast_to(points.normal, tangent.shape))
        along = np.einsum("ij,ij->i", tangent, points.direction) / points.speed
        rows = self.setup.space.path.rows_at(points.span, points.local)[:, self.setup.ends.free]
        moves: Array = -(sideways / along)[:, None] * rows
        return moves

    def _sites(self, trajectory: Trajectory) -> _SpeedSites:
        return self._last.of(trajectory, self._looked_for)

    def _looked_for(self, trajectory: Trajectory) -> _SpeedSites:
        space, path = self.setup.space, trajectory.path
        stations = space.tables.station_parameters
        gates, sides, speeds = self._gates(path)
        limits, count = np.where(gates >= 0.0, speeds, np.inf), len(stations)
        driven = np.concatenate([path.station_arc_lengths, path.arc_length_at(np.maximum(gates, 0.0))])
        arrivals = trajectory.arrivals(driven)
        side = np.concatenate([np.zeros(len(stations)), sides])
        beside = np.clip(arrivals.sigma + BESIDE * side, 0.0, 1.0)
        jumps = trajectory.at(self._jumps)
        at_gates, speed = arrivals.sigma[count:], arrivals.speed[count:]
        pieces = _OtherPieces.beside(trajectory, at_gates, speed, beside[count:], limits)
        own = space.time_table(beside).acceleration @ trajectory.beta
        fixed = limits_at(self.stretches, path.station_positions, self._about.at(stations))
        beyond, fixed[0] = space.start_speed > fixed[0], np.inf  # the speed at the start is given
        moving = limits_at(self.stretches, jumps.path.position, self._about.at(jumps.parameter))
        allowed = np.concatenate([fixed, limits, pieces.limit, moving])
        if beyond:
            # As fast as brakes allow, after the same way; rows leave out that this moves with the path
            ways = np.concatenate([driven, driven[count:], driven[count:], jumps.distance])
            stop = np.sqrt(np.maximum(space.start_speed**2 - 2.0 * self.setup.limits.deceleration * ways, 0.0))
            allowed = np.maximum(allowed, stop)
        return _SpeedSites(
            np.concatenate([stations, *[np.maximum(gates, 0.0)] * 3, jumps.parameter]),
            np.concatenate([arrivals.sigma, at_gates, at_gates, self._jumps.sigma]),
            np.concatenate([arrivals.speed, pieces.speed, jumps.speed]),
            np.concatenate([own, pieces.acceleration, jumps.acceleration]),
            allowed,
            pieces,
        )

    def _gates(self, path: Path) -> tuple[Array, Array, Array]:
        """Normalised stations at which the path first crosses each border, -1 if it does not; side; limit."""
        along = self._borders.lines_at(path.station_positions, self._about)
        cells = (along[:, :-1] < self._borders.at[:, None]) & (along[:, 1:] >= self._borders.at[:, None])
        gates, stations = np.full(len(cells), -1.0), self.setup.space.tables.station_parameters
        # Borders whose first cell with a crossing turns out to have none are looked for in the next one.
        while (some := np.flatnonzero(cells.any(axis=1) & (gates < 0.0))).size:
            cell = np.argmax(cells[some], axis=1)
            ends = np.stack([cell, cell + 1])
            gates[some] = _crossings(path, self._borders.of(some), stations[ends], along[some, ends], self._about)
            cells[some, cell] = False
        sides = np.tile([-1.0, 1.0], len(self.stretches))
        return gates, sides, np.repeat([part.speed for part in self.stretches], 2)


@dataclass(frozen=True)
class About:
    """Stations along lines that cross themselves of a vehicle on the guide, (n,) m, at normalised stations of that."""

    stations: dict[Line, Array]
    parameters: Array

    def at(self, parameters: Array) -> dict[Line, Array | None]:
        """Return those at other normalised stations, (m,)."""
        return {line: np.interp(parameters, self.parameters, one) for line, one in self.stations.items()}


@dataclass(frozen=True)
class _OtherPieces:
    """Other pieces of the acceleration than that at gates, gone on with: (n,) arrays."""

    # As in _SpeedSites; the acceleration is what counts for each m that the gate moves at the speed driven
    speed: Array
    acceleration: Array
    limit: Array
    own: Index  # number of the piece at the gate
    other: Index  # number of the piece that is gone on with
    since: Array  # normalised time since the jump between them; negative before it

    @classmethod
    def beside(cls, trajectory: Trajectory, sigma: Array, speed: Array, counted: Array, limit: Array) -> _OtherPieces:
        """Return the piece before that at each gate, and the one after it."""
        basis, beta = trajectory.space.acceleration, trajectory.beta
        sigma, speed, limit = np.tile(sigma, 2), np.tile(speed, 2), np.tile(limit, 2)
        own = np.tile(basis.locate(counted)[0], 2)
        side = np.repeat([-1, 1], len(counted))
        other = np.minimum(np.maximum(own + side, 0), len(basis.widths) - 1)
        since = sigma - basis.breakpoints[np.maximum(own, other)]
        if basis.coefficients.shape[1] > 1:  # it does not jump
            return cls(speed, np.zeros_like(speed), np.full_like(speed, np.inf), own, own, since)
        rise = beta[other] - beta[own]
        extended = speed + rise * since * trajectory.travel_time
        known = (side * rise > SAME_PIECE * np.abs(beta).max()) & (extended > 0.0)
        share = np.where(known, extended, 0.0) / np.where(known, speed, 1.0)
        limit = np.where(known, limit, np.inf)
        return cls(np.where(known, extended, speed), beta[other] * share, limit, own, other, since)


def squared_speed_gradient(
    setup: Setup, trajectory: Trajectory, parameter: Array, sigma: Array, v: Array, a: Array
) -> Array:
    """Gradient of the squared speed, (m, step) m^2/s^2, at normalised stations and times, (m,), given v and a there."""
    space, tau = trajectory.space, trajectory.travel_time
    table, v0 = space.time_table(sigma), space.start_speed
    theta = (2.0 * a)[:, None] * trajectory.path.arc_length_gradient(parameter)
    beta = (2.0 * tau * v)[:, None] * table.speed - (2.0 * tau * tau * a)[:, None] * table.distance
    return setup.of_all(theta, beta, -2.0 * (v * (v - v0) + a * v0 * tau * sigma))


@dataclass(frozen=True)
class _Borders:
    """Borders of stretches: of each its stretch, and m along its line."""

    stretches: tuple[Stretch, ...]
    at: Array

    def of(self, index: Index) -> _Borders:
        """Return some of them."""
        return _Borders(tuple(self.stretches[k] for k in index.tolist()), self.at[index])

    def lines_at(self, positions: Array, about: About) -> Array:
        """Stations along the line of each of the points of it nearest to positions (k, 2) m, (n, k) m."""
        near = about.at(about.parameters)
        known = {line: line.nearest(positions, near.get(line)) for line in {part.line: None for part in self.stretches}}
        return np.array([known[part.line] for part in self.stretches])

    def each_at(self, path: Path, parameters: Array, about: About) -> Array:
        """Stations along its line of the path at normalised stations, for each its own, (n, k)."""
        shape = parameters.shape
        positions = path.points(parameters.ravel()).position.reshape(*shape, 2)
        found = np.empty(shape)
        for line in {part.line: None for part in self.stretches}:
            mine = [k for k, part in enumerate(self.stretches) if part.line is line]
            near = about.at(parameters[mine].ravel()).get(line)
            found[mine] = line.nearest(positions[mine].reshape(-1, 2), near).reshape(len(mine), -1)
        return found


def _crossings(path: Path, borders: _Borders, cells: Array, along: Array, about: About) -> Array:
    """Normalised stations at which a path first crosses borders, (n,), each upwards in a cell."""
    (low, high), (first, last) = cells, along
    slope = (last - first) / (high - low)
    guess = low + (borders.at - first) / slope
    for _ in range(CROSSING_STEPS):
        here = borders.each_at(path, guess[:, None], about)[:, 0]
        guess = np.minimum(np.maximum(guess + (borders.at - here) / slope, low), high)
    here = borders.each_at(path, guess[:, None], about)[:, 0]
    bent = np.flatnonzero(np.abs(here - borders.at) >= ON_BORDER * (last - first))
    if bent.size:
        guess[bent] = _jumps(path, borders.of(bent), low[bent], high[bent], about)
    return guess


def _jumps(path: Path, borders: _Borders, low: Array, high: Array, about: About) -> Array:
    every = np.arange(len(low))
    for _ in range(JUMP_STEPS):
        trials = np.linspace(low, high, JUMP_PARTS + 1, axis=1)
        beyond = borders.each_at(path, trials[:, 1:-1], about) >= borders.at[:, None]
        jump = np.where(beyond.any(axis=1), np.argmax(beyond, axis=1), JUMP_PARTS - 1)
        low, high = trials[every, jump], trials[every, jump + 1]
    entered = np.array([at == part.first for part, at in zip(borders.stretches, borders.at, strict=True)])
    inside = borders.each_at(path, np.where(entered, high, low)[:, None], about)[:, 0]
    within = [part.first <= at <= part.last for part, at in zip(borders.stretches, inside.tolist(), strict=True)]
    return np.where(within, high, -1.0)


def speed_limits(setup: Setup) -> Iterator[Constraint]:
    """Make the limits of stretches, if there are any."""
    if setup.slow:
        yield SpeedLimits(setup, setup.slow)
