"""scipy's SLSQP on two splines and the travel time: what a user of scipy would write, with exact gradients.

The path is an offset f(x) from the straight line, a clamped B-spline; the acceleration is a B-spline
of degree one in normalised time; the travel time is the last variable. The arrival condition is an
equality; speed, curvature, lateral acceleration and clearance are sampled inequalities. Clearance rows are
those of the obstacles that come near the present trip: solve, look, add rows, solve again (at most
``ROUNDS`` times), which is many times faster than all rows at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, CubicSpline
from scipy.optimize import minimize

from benchmarks.peers.base import TIME_LIMIT, Attempt, Scenario, disc_arrays, require_plain
from benchmarks.peers.starts import Start, first_guess
from scp_planner.arrays import Array

PATH_DEGREE = 4  # the curvature has no kinks, so that samples of it can be trusted
PATH_SPAN = 1.5  # m, of the offset's B-spline
ACCELERATION_SPANS = 20
LIMIT_SHARE = 0.99  # of curvature and lateral limits, for what happens between the samples
SAMPLES_PER_SECOND = 14.0
GRID_STEP = 0.05  # m, of the table of arc lengths
MARGIN = 1.2e-2  # m, for what happens between the samples
NEAR = 1.5  # m of clearance: obstacles that come nearer get rows
ROUNDS = 4
SLACK_WEIGHT = 2.0  # s/m
SLACK_ALLOWED = 1e-3  # m, of an answer that counts as a success
MAX_ITERATIONS = 100
PRECISION = 1e-6  # s


@dataclass(frozen=True)
class _Tables:
    """What is shared by all trips of one length: bases on fixed grids."""

    length: float
    path_knots: Array
    rate_knots: Array
    free: slice
    size: int
    grid: Array
    grid_slopes: Array
    middle_slopes: Array
    bend_slopes: Array
    bends: Array
    shares: Array
    rates: Array
    knot_gains: Array
    gains: Array
    distances: Array


class Slsqp:
    """Sequential quadratic programming with dense rows."""

    name = "scipy-slsqp"
    own_starts = False

    def __init__(self) -> None:
        self._tables: dict[float, _Tables] = {}

    def build(self, scenarios: Sequence[Scenario]) -> None:
        """Tabulate the bases for each length of trip."""
        for scenario in scenarios:
            require_plain(scenario)
            length = _length(scenario)
            if length not in self._tables:
                self._tables[length] = _tabulate(length, float(scenario["vehicle"]["max_speed"]), _rate_knots(scenario))

    def solve(self, scenario: Scenario, start: Start) -> Attempt:
        """Solve from the bow and speed of the start."""
        model = _Model(scenario, self._tables[_length(scenario)])
        z = model.first(start)
        iterations, success, message = 0, False, ""
        rows = np.zeros((model.tables.shares.size, model.discs.shape[0]), dtype=bool)
        for _ in range(ROUNDS):
            wanted = model.near_rows(z)
            if success and not (wanted & ~rows).any():
                break
            rows |= wanted
            answer = minimize(
                model.objective,
                z,
                jac=True,
                method="SLSQP",
                bounds=model.bounds(),
                constraints=[
                    {"type": "eq", "fun": model.arrival, "jac": model.arrival_gradient},
                    {"type": "ineq", "fun": model.values, "jac": model.gradients, "args": (rows,)},
                ],
                options={"maxiter": MAX_ITERATIONS, "ftol": PRECISION},
                callback=model.watch_clock,
            )
            z, success, message = answer.x, bool(answer.success), str(answer.message)
            iterations += int(answer.nit)
            if not success:
                break
        trip = model.trip(z)
        begin = float(scenario["start"].get("time", 0.0))
        slack = float(z[model.tau + 1 :].max(initial=0.0))
        kept = success and slack <= SLACK_ALLOWED
        return Attempt(kept, trip, begin, begin + float(z[model.tau]), iterations, f"{message}, slack {slack:.1e} m")


def _length(scenario: Scenario) -> float:
    return float(np.linalg.norm(np.subtract(scenario["goal"]["position"], scenario["start"]["position"])))


def _rate_knots(scenario: Scenario) -> Array:
    """Equal spans of normalised time, and the share at which the unhindered trip is at its top speed."""
    vehicle = scenario["vehicle"]
    speed, top = float(scenario["start"]["speed"]), float(vehicle["max_speed"])
    ramp = (top - speed) / float(vehicle["max_acceleration"])
    total = ramp + (_length(scenario) - (speed + top) / 2.0 * ramp) / top
    knots = np.linspace(0.0, 1.0, ACCELERATION_SPANS + 1)
    knots[np.abs(knots[1:-1] - ramp / total).argmin() + 1] = ramp / total
    return knots


def _clamped(low: float, high: float, spans: int, degree: int) -> Array:
    inner = np.linspace(low, high, spans + 1)
    return np.concatenate([np.full(degree, low), inner, np.full(degree, high)])


def _matrix(spline: BSpline, points: Array) -> Array:
    """Values (m, n) of the n functions of a spline with identity coefficients."""
    return np.asarray(spline(points), dtype=float)


def _tabulate(length: float, max_speed: float, rate_knots: Array) -> _Tables:
    spans = max(6, round(length / PATH_SPAN))
    knots = _clamped(0.0, length, spans, PATH_DEGREE)
    basis = BSpline(knots, np.eye(spans + PATH_DEGREE), PATH_DEGREE)
    cells = round(length / GRID_STEP)
    grid = np.linspace(0.0, length, cells + 1)
    slope = basis.derivative()
    rate = BSpline(rate_knots, np.eye(rate_knots.size - 1), 0)
    shares = np.linspace(0.0, 1.0, round(SAMPLES_PER_SECOND * length / max_speed) + 1)
    bends = np.linspace(0.0, length, 4 * spans + 1)
    return _Tables(
        length=length,
        path_knots=knots,
        rate_knots=rate_knots,
        free=slice(2, spans + PATH_DEGREE - 1),  # start position and heading, and the goal, fix the others
        size=spans + PATH_DEGREE,
        grid=grid,
        grid_slopes=_matrix(slope, grid),
        middle_slopes=_matrix(slope, (grid[1:] + grid[:-1]) / 2.0),
        bend_slopes=_matrix(slope, bends),
        bends=_matrix(slope.derivative(), bends),
        shares=shares,
        rates=_matrix(rate, shares),
        knot_gains=_matrix(rate.antiderivative(), rate_knots[1:]),
        gains=_matrix(rate.antiderivative(), shares),
        distances=_matrix(rate.antiderivative(2), shares),
    )


@dataclass(frozen=True)
class _State:
    """Everything that values and gradients need at one point."""

    total: float
    total_gradient: Array
    distance: Array
    distance_gradient: Array
    speed: Array
    speed_gradient: Array
    station: Array
    station_gradient: Array
    point_basis: tuple[Array, Array, Array]
    offset: tuple[Array, Array, Array, Array]


class _Model:
    """The nonlinear programme of one scenario.

    Variables z (n,): free offsets m, accelerations m/s2, travel time s, slack of each obstacle m.
    """

    def __init__(self, scenario: Scenario, tables: _Tables) -> None:
        vehicle, start = scenario["vehicle"], scenario["start"]
        self.tables = tables
        self.scenario = scenario
        self.origin = np.asarray(start["position"], dtype=float)
        along = (np.asarray(scenario["goal"]["position"], dtype=float) - self.origin) / tables.length
        self.axes = np.array([along, [-along[1], along[0]]])
        self.begin = float(start.get("time", 0.0))
        self.start_speed = float(start["speed"])
        self.vehicle = vehicle
        self.discs = disc_arrays(scenario)
        heading = start.get("heading")
        slope = 0.0 if heading is None else np.tan(float(heading) - np.arctan2(along[1], along[0]))
        self.fixed = np.zeros(tables.size)
        # Slope of a clamped spline at its end: degree * (c1 - c0) / (first span).
        self.fixed[1] = slope * tables.path_knots[PATH_DEGREE + 1] / PATH_DEGREE
        self.paths = tables.free.stop - tables.free.start
        self.rates = slice(self.paths, self.paths + tables.rates.shape[1])
        self.tau = self.rates.stop
        self.size = self.tau + 1 + self.discs.shape[0]
        self._last: tuple[bytes, _State] | None = None
        self._clock = _Clock(TIME_LIMIT)

    def watch_clock(self, _: Array) -> None:
        """Stop the solver when the time is over."""
        self._clock.check()

    def first(self, start: Start) -> Array:
        """Variables that fit the start's path and speed."""
        tables = self.tables
        guess = first_guess(self.scenario, start)
        local = (guess.states[:, :2] - self.origin) @ self.axes.T
        basis = _matrix(BSpline(tables.path_knots, np.eye(tables.size), PATH_DEGREE), local[:, 0])
        residual = local[:, 1] - basis @ self.fixed
        offsets = np.linalg.lstsq(basis[:, tables.free], residual, rcond=None)[0]
        shares = (guess.times - guess.times[0]) / guess.duration
        middles = (tables.rate_knots[1:] + tables.rate_knots[:-1]) / 2.0
        rates = np.interp(middles, shares, guess.accelerations)
        return np.concatenate([offsets, rates, [guess.duration], np.zeros(self.discs.shape[0])])

    def bounds(self) -> list[tuple[float, float]]:
        """Box of the variables."""
        rate = (-float(self.vehicle["max_deceleration"]), float(self.vehicle["max_acceleration"]))
        box = [(-8.0, 8.0)] * self.paths + [rate] * (self.tau - self.paths) + [(0.5, 100.0)]
        return box + [(0.0, 10.0)] * self.discs.shape[0]

    def objective(self, z: Array) -> tuple[float, Array]:
        """Travel time and penalty, and their gradient."""
        gradient = np.zeros(self.size)
        gradient[self.tau] = 1.0
        gradient[self.tau + 1 :] = SLACK_WEIGHT
        return float(gradient @ z), gradient

    def arrival(self, z: Array) -> Array:
        """Distance driven less the path's length, m."""
        state = self.state(z)
        return np.array([state.distance[-1] - state.total])

    def arrival_gradient(self, z: Array) -> Array:
        """Gradient (1, n)."""
        state = self.state(z)
        return (state.distance_gradient[-1] - state.total_gradient)[None]

    def near_rows(self, z: Array) -> NDArray[np.bool_]:
        """Pairs (times, obstacles) nearer than ``NEAR``, and those around each obstacle's least clearance."""
        clearance = self.clearances(self.state(z), z)[0]
        chosen = clearance < NEAR
        if clearance.size:
            least = clearance.argmin(axis=0)
            for shift in (-1, 0, 1):
                times = np.clip(least + shift, 0, clearance.shape[0] - 1)
                chosen[times, np.arange(clearance.shape[1])] |= clearance.min(axis=0) < 3.0 * NEAR
        return chosen

    def clearances(self, state: _State, z: Array) -> tuple[Array, Array, Array]:
        """Clearance (m, obstacles), the directions (m, obstacles, 2) away, and centre velocities."""
        times = self.begin + z[self.tau] * self.tables.shares[:, None, None]
        discs = self.discs
        centres = discs[None, :, 0:2] + discs[None, :, 2:4] * times + discs[None, :, 4:6] * times**2 / 2.0
        velocities = discs[None, :, 2:4] + discs[None, :, 4:6] * times
        local = np.column_stack([state.station, state.offset[0]])
        away = (self.origin + local @ self.axes)[:, None, :] - centres
        reach = np.sqrt((away**2).sum(axis=2) + 1e-12)
        return reach - discs[None, :, 6] - MARGIN, away / reach[..., None], velocities

    def values(self, z: Array, rows: NDArray[np.bool_]) -> Array:
        """All inequalities, each non-negative where it holds."""
        state = self.state(z)
        # Piecewise linear: the speed keeps its limits if it does so at the breakpoints.
        speed = self.start_speed + z[self.tau] * (self.tables.knot_gains @ z[self.rates])
        parts = [speed, float(self.vehicle["max_speed"]) - speed]
        if self.vehicle.get("max_curvature") is not None:
            bend, _ = self._curvature(z)
            limit = LIMIT_SHARE * float(self.vehicle["max_curvature"])
            parts += [limit - bend, limit + bend]
        if self.vehicle.get("max_lateral_acceleration") is not None:
            lateral, _ = self._lateral(state)
            limit = LIMIT_SHARE * float(self.vehicle["max_lateral_acceleration"])
            parts += [limit - lateral, limit + lateral]
        clearance = self.clearances(state, z)[0] + z[self.tau + 1 :]
        parts.append(clearance[rows])
        return np.concatenate(parts)

    def gradients(self, z: Array, rows: NDArray[np.bool_]) -> Array:
        """Gradients (rows, n) of :meth:`values`."""
        state = self.state(z)
        gains = self.tables.knot_gains
        speed = np.zeros((gains.shape[0], self.size))
        speed[:, self.rates] = z[self.tau] * gains
        speed[:, self.tau] = gains @ z[self.rates]
        parts = [speed, -speed]
        if self.vehicle.get("max_curvature") is not None:
            _, gradient = self._curvature(z)
            parts += [-gradient, gradient]
        if self.vehicle.get("max_lateral_acceleration") is not None:
            _, gradient = self._lateral(state)
            parts += [-gradient, gradient]
        _, away, velocities = self.clearances(state, z)
        time, disc = np.nonzero(rows)
        local = away[time, disc] @ self.axes.T
        gradient = (local[:, 0] + local[:, 1] * state.offset[1][time])[:, None] * state.station_gradient[time]
        gradient[:, : self.paths] += local[:, 1:2] * state.point_basis[0][time][:, self.tables.free]
        drift = (away[time, disc] * velocities[time, disc]).sum(axis=1)
        gradient[:, self.tau] -= self.tables.shares[time] * drift
        gradient[np.arange(disc.size), self.tau + 1 + disc] = 1.0
        parts.append(gradient)
        return np.concatenate(parts)

    def _coefficients(self, z: Array) -> Array:
        coefficients = self.fixed.copy()
        coefficients[self.tables.free] = z[: self.paths]
        return coefficients

    def _curvature(self, z: Array) -> tuple[Array, Array]:
        tables = self.tables
        coefficients = self._coefficients(z)
        slope, second = tables.bend_slopes @ coefficients, tables.bends @ coefficients
        stretch = 1.0 + slope**2
        gradient = np.zeros((slope.size, self.size))
        free = tables.free
        gradient[:, : self.paths] = (
            tables.bends[:, free] / stretch[:, None] ** 1.5
            - (3.0 * second * slope / stretch**2.5)[:, None] * tables.bend_slopes[:, free]
        )
        return second / stretch**1.5, gradient

    def _lateral(self, state: _State) -> tuple[Array, Array]:
        _, slope, second, third = state.offset
        _, first_basis, second_basis = state.point_basis
        stretch = 1.0 + slope**2
        curvature = second / stretch**1.5
        along = third / stretch**1.5 - 3.0 * slope * second**2 / stretch**2.5
        bend = along[:, None] * state.station_gradient
        free = self.tables.free
        bend[:, : self.paths] += (
            second_basis[:, free] / stretch[:, None] ** 1.5
            - (3.0 * second * slope / stretch**2.5)[:, None] * first_basis[:, free]
        )
        lateral = state.speed**2 * curvature
        gradient = (2.0 * state.speed * curvature)[:, None] * state.speed_gradient
        return lateral, gradient + (state.speed**2)[:, None] * bend

    def state(self, z: Array) -> _State:
        """Evaluate once a point; SLSQP asks for values and gradients of the same point in turn."""
        key = z.tobytes()
        if self._last is not None and self._last[0] == key:
            return self._last[1]
        state = self._evaluate(z)
        self._last = (key, state)
        return state

    def _evaluate(self, z: Array) -> _State:
        tables = self.tables
        free = tables.free
        rates, tau = z[self.rates], float(z[self.tau])
        coefficients = self._coefficients(z)

        slope, middle = tables.grid_slopes @ coefficients, tables.middle_slopes @ coefficients
        root, middle_root = np.sqrt(1.0 + slope**2), np.sqrt(1.0 + middle**2)
        width = tables.grid[1] - tables.grid[0]
        arc = np.concatenate([[0.0], np.cumsum(width * (root[:-1] + 4.0 * middle_root + root[1:]) / 6.0)])
        lean = (slope / root)[:, None] * tables.grid_slopes[:, free]
        middle_lean = (middle / middle_root)[:, None] * tables.middle_slopes[:, free]
        arc_gradient = np.zeros((arc.size, self.paths))
        np.cumsum(width * (lean[:-1] + 4.0 * middle_lean + lean[1:]) / 6.0, axis=0, out=arc_gradient[1:])

        gains, distances = tables.gains @ rates, tables.distances @ rates
        speed = self.start_speed + tau * gains
        speed_gradient = np.zeros((speed.size, self.size))
        speed_gradient[:, self.rates] = tau * tables.gains
        speed_gradient[:, self.tau] = gains
        distance = self.start_speed * tau * tables.shares + tau**2 * distances
        distance_gradient = np.zeros((speed.size, self.size))
        distance_gradient[:, self.rates] = tau**2 * tables.distances
        distance_gradient[:, self.tau] = self.start_speed * tables.shares + 2.0 * tau * distances

        # Where along the line is the vehicle? The table's inverse, then one Newton step on a cubic of it.
        station = np.interp(distance, arc, tables.grid)
        table = CubicSpline(tables.grid, arc, bc_type="natural")
        station = np.clip(station - (table(station) - distance) / table(station, 1), 0.0, tables.length)
        splines = BSpline(tables.path_knots, np.eye(tables.size), PATH_DEGREE)
        bases = tuple(_matrix(splines.derivative(k) if k else splines, station) for k in range(4))
        offsets = tuple(basis @ coefficients for basis in bases)
        cell = np.clip((station / width).astype(int), 0, arc.size - 2)
        share = (station / width - cell)[:, None]
        passed = (1.0 - share) * arc_gradient[cell] + share * arc_gradient[cell + 1]
        station_gradient = distance_gradient.copy()
        station_gradient[:, : self.paths] -= passed
        station_gradient /= np.sqrt(1.0 + offsets[1] ** 2)[:, None]
        total_gradient = np.zeros(self.size)
        total_gradient[: self.paths] = arc_gradient[-1]
        return _State(
            total=float(arc[-1]),
            total_gradient=total_gradient,
            distance=distance,
            distance_gradient=distance_gradient,
            speed=speed,
            speed_gradient=speed_gradient,
            station=station,
            station_gradient=station_gradient,
            point_basis=(bases[0], bases[1], bases[2]),
            offset=(offsets[0], offsets[1], offsets[2], offsets[3]),
        )

    def trip(self, z: Array) -> Any:
        """Position as a function of time, with the arc length inverted to rounding."""
        tables = self.tables
        tau = float(z[self.tau])
        path = BSpline(tables.path_knots, self._coefficients(z), PATH_DEGREE)
        slope = path.derivative()
        driven = BSpline(tables.rate_knots, z[self.rates], 0).antiderivative(2)
        fine = np.linspace(0.0, tables.length, 4001)
        half = (fine[1] - fine[0]) / 2.0
        root, middle = np.hypot(1.0, slope(fine)), np.hypot(1.0, slope(fine[1:] - half))
        arc = np.concatenate([[0.0], np.cumsum(half * (root[:-1] + 4.0 * middle + root[1:]) / 3.0)])
        table = CubicSpline(fine, arc)

        def position(times: Array) -> Array:
            share = (np.asarray(times, dtype=float) - self.begin) / tau
            distance = self.start_speed * tau * share + tau**2 * driven(share)
            station = np.interp(distance, arc, fine)
            for _ in range(3):
                station = np.clip(station - (table(station) - distance) / table(station, 1), 0.0, tables.length)
            return self.origin + np.column_stack([station, path(station)]) @ self.axes

        return position


class _Clock:
    """Raises StopIteration, which scipy takes as a request to stop, when the time is over."""

    def __init__(self, seconds: float) -> None:
        from time import monotonic

        self._now = monotonic
        self._end = monotonic() + seconds

    def check(self) -> None:
        if self._now() > self._end:
            raise StopIteration
