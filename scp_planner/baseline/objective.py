"""The penalised objective that all methods minimise, with a hinge that may be smooth, and its exact gradient.

Over omega = (theta, beta), the free control points of the offset and those of the acceleration,

    Q(omega) = tau(omega) + sum_l mu_l S_w(-c_l(omega)) + sum_k mu_k S_w(e_k(omega)),

with tau the travel time in closed form, c_l(t) the signed distance to zone l and e_k the excess over limit k wherever
it is looked at. S_w makes one violation of the excesses g_i of one kind, with shares p_i that add up to 1:

    S_w(g) = w log(1 + sum_i p_i exp(g_i / w)),        S_0(g) = max(0, max_i g_i).

For zones the p_i are the weights of the trapezoidal rule over normalised time, so that S_w is w log(1 + integral of
exp(-c / w)). S_w is convex and increasing in each g_i, smooth for w > 0, and tends to S_0 as w does to 0. S_0 is the
violation in the merit of sequential convex programming (evaluation.py): one objective, and the width of the hinge is
all that differs.

Q is finite on D0(v0), the trips that arrive: v0^2 + 4 A(beta) L(theta) >= 0, and infinite elsewhere. The gradient is
exact: d tau from v0 tau + A tau^2 = L, and at a normalised time the vehicle moves along the guide by
ds = (dD - dS) / |r'|. It exists off the kinks: for w = 0 those of the maxima and the hinge; for every w the centres
of zones, and trips that pass a fixed station just when the acceleration jumps.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.problem.limits.limit import OptionalLimit
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import box_gaps, local_minima, refine_minima
from scp_planner.scp.merit import LIMIT_NAMES, Limit, Penalties
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.path import PathBend
from scp_planner.trips.space import TimeTable
from scp_planner.trips.trajectory import Trajectory, TripPoints

OBJECTIVE_LIMITS = (*LIMIT_NAMES, "reverse", "acceleration", "offset")
"""What the penalties of limits are for; the last three SCP keeps by linear rows, so that they are 0 on its iterates."""

LATERAL, CURVATURE, SPEED = Limit.LATERAL_ACCELERATION, Limit.CURVATURE, Limit.SPEED
BOX, GOAL_SPEED = Limit.WORKSPACE_BOUNDS, Limit.GOAL_SPEED
REVERSE, ACCELERATION, OFFSET = range(len(Limit), len(OBJECTIVE_LIMITS))
OPTIONAL = len(OBJECTIVE_LIMITS)  # where the problem's optional limits begin
NEGLIGIBLE = 37.0  # exp(-37) is below the rounding of 1
CLUSTER = np.linspace(-1.0, 1.0, 9)  # samples about a minimum of clearance, in steps of the grid


@dataclass(frozen=True)
class Weights:
    """Prices mu of the violations.

    Attributes
    ----------
    zones : (L,) array
        s per m of entry.
    limits : (8 + E,) array
        s per unit of excess, see OBJECTIVE_LIMITS: relative, but m for box and offsets, and m/s for the goal speed;
        then of the problem's optional limits.
    """

    zones: Array
    limits: Array

    @classmethod
    def uniform(cls, problem: Problem, zones: float, limits: float | None = None) -> Weights:
        """Return one price for all zones and one (default: the same) for all limits."""
        price = zones if limits is None else limits
        return cls(np.full(problem.zones.size, zones), np.full(_count(problem), price))

    @classmethod
    def of(cls, penalties: Penalties) -> Weights:
        """Return the prices of a run of SCP; what its rows keep exactly costs as much as its dearest limit."""
        hard = np.full(len(OBJECTIVE_LIMITS) - len(LIMIT_NAMES), float(np.max(penalties.limits)))
        own, optional = np.split(penalties.limits, [len(LIMIT_NAMES)])
        return cls(penalties.zones.copy(), np.concatenate([own, hard, optional]))


@dataclass(frozen=True)
class Hinge:
    """Widths w of the smooth hinge; 0 is the exact one.

    Attributes
    ----------
    zones : float
        m.
    limits : float
        In the units of the excesses over limits.
    """

    zones: float = 0.0
    limits: float = 0.0


@dataclass(frozen=True)
class Margins:
    """What is added to every excess: distances to be kept, or given away where negative.

    Attributes
    ----------
    zones : (L,) array
        m.
    limits : (8 + E,) array
        See OBJECTIVE_LIMITS.
    """

    zones: Array
    limits: Array

    @classmethod
    def none(cls, problem: Problem) -> Margins:
        """Return no margins."""
        return cls(np.zeros(problem.zones.size), np.zeros(_count(problem)))


def _count(problem: Problem) -> int:
    return len(OBJECTIVE_LIMITS) + len(problem.optional)


@dataclass(frozen=True)
class SampleTimes:
    """When clearances are looked at.

    Attributes
    ----------
    table : TimeTable
        The problem's samples, and more where a zone is near.
    shares : (n,) array
        Weights of the trapezoidal rule on [0, 1].
    jumps : (J,) array of int
        Those times at which the acceleration jumps.
    """

    table: TimeTable
    shares: Array
    jumps: Index

    @classmethod
    def of(cls, problem: Problem, extra: Array | None = None) -> SampleTimes:
        """Return the problem's samples, and further normalised times."""
        own = problem.samples.sigma
        sigma = own if extra is None else np.concatenate([own, extra])
        order = np.argsort(sigma, kind="stable")
        half = 0.5 * np.diff(sigma[order])
        shares = np.zeros(len(sigma))
        shares[order[:-1]] += half
        shares[order[1:]] += half
        table = problem.samples if extra is None else problem.space.time_table(sigma)
        return cls(table, shares, np.arange(problem.grid, len(own)))

    @classmethod
    def refined(cls, problem: Problem, trajectory: Trajectory, near: float) -> SampleTimes:
        """Return the problem's samples, and more about the minima of clearance below ``near`` (m) of a trip."""
        grid = problem.samples.sigma[: problem.grid]
        points = trajectory.at(problem.samples.take(np.arange(problem.grid)))
        clearance = problem.zones.distances(points.time, points.path.position, near)
        _, row, zone = local_minima(clearance[None], near)
        minima = refine_minima(grid, clearance[None], np.zeros_like(row), row, zone)
        about = (minima[:, None] + CLUSTER * (grid[1] - grid[0])).ravel()
        return cls.of(problem, np.unique(np.clip(about, 0.0, 1.0)))


@dataclass(frozen=True)
class ObjectiveValue:
    """The objective at one trip.

    Attributes
    ----------
    value : float
        Q, s.
    travel_time : float
        tau, s; inf outside D0(v0).
    zones : (L,) array
        Violations of zones, m.
    limits : (8 + E,) array
        Violations of limits, see OBJECTIVE_LIMITS.
    zone_use, limit_use : (L,), (8 + E,) arrays
        Derivatives of the violations with respect to a common margin, in [0, 1]: times the price, the multiplier.
    gradient : (K,) array
        dQ / d omega; empty if it was not asked for.
    """

    value: float
    travel_time: float
    zones: Array
    limits: Array
    zone_use: Array
    limit_use: Array
    gradient: Array = field(default_factory=lambda: np.zeros(0))


def soft_excess(excess: Array, shares: Array, width: float) -> tuple[Array, Array]:
    """Make one violation of many excesses: S_w, and its derivative with respect to each of them.

    Parameters
    ----------
    excess : (..., n) array
        g; -inf for what does not count.
    shares : (n,) array
        p, adding up to 1.
    width : float
        w, in the unit of the excess; 0: the exact hinge.

    Returns
    -------
    (violation, derivative) : (...), (..., n) arrays
    """
    top = np.maximum(excess.max(axis=-1, initial=0.0), 0.0)
    if width == 0.0:
        derivative = np.zeros_like(excess)
        if excess.shape[-1]:
            where = excess.argmax(axis=-1)[..., None]
            np.put_along_axis(derivative, where, (top > 0.0)[..., None].astype(float), axis=-1)
        return top, derivative
    scaled = shares * np.exp((excess - top[..., None]) / width)
    beyond_one = scaled.sum(axis=-1) + np.expm1(-top / width)
    return top + width * np.log1p(beyond_one), scaled / (1.0 + beyond_one)[..., None]


class PenalisedObjective:
    """Q at a fixed problem.

    Parameters
    ----------
    problem : Problem
    weights : Weights
    hinge : Hinge
    times : SampleTimes, optional
        Default: the problem's samples.
    margins : Margins, optional
    """

    def __init__(
        self,
        problem: Problem,
        weights: Weights,
        hinge: Hinge,
        times: SampleTimes | None = None,
        margins: Margins | None = None,
    ) -> None:
        self.problem = problem
        self.weights = weights
        self.hinge = hinge
        self.times = times or SampleTimes.of(problem)
        self.margins = margins or Margins.none(problem)
        free = problem.ends.free
        self.path_size = free.stop - free.start
        self.size = self.path_size + problem.space.acceleration_size

    def omega(self, trajectory: Trajectory) -> Array:
        """Return the variables (theta, beta) of a trip, (K,)."""
        return np.concatenate([trajectory.theta[self.problem.ends.free], trajectory.beta])

    def trajectory(self, omega: Array) -> Trajectory:
        """Return the trip with given variables; its travel time is infinite outside D0(v0)."""
        theta = self.problem.ends.theta.copy()
        theta[self.problem.ends.free] = omega[: self.path_size]
        return Trajectory.of(self.problem.space, theta, omega[self.path_size :])

    def value(self, omega: Array) -> float:
        """Return Q(omega), s."""
        return self.evaluate(omega, gradient=False).value

    def gradient(self, omega: Array) -> Array:
        """Return dQ / d omega, (K,)."""
        return self.evaluate(omega).gradient

    def evaluate(self, omega: Array, *, gradient: bool = True) -> ObjectiveValue:
        """Return Q and its parts at omega, (K,), and its gradient."""
        trajectory = self.trajectory(omega)
        if not np.isfinite(trajectory.travel_time):
            return self._outside()
        points = trajectory.at(self.times.table)
        terms = _Terms(self, trajectory, points, gradient)
        zones, zone_use = terms.zones()
        limits, limit_use = terms.limits()
        value = trajectory.travel_time + float(self.weights.zones @ zones) + float(self.weights.limits @ limits)
        total = terms.total_gradient() if gradient else np.zeros(0)
        return ObjectiveValue(value, trajectory.travel_time, zones, limits, zone_use, limit_use, total)

    def _outside(self) -> ObjectiveValue:
        zones, limits = np.zeros(self.problem.zones.size), np.zeros(_count(self.problem))
        return ObjectiveValue(np.inf, np.inf, zones, limits, zones, limits, np.full(self.size, np.nan))


def zone_excess(
    zones: ZoneBatch, times: Array, positions: Array, margins: Array, width: float
) -> tuple[Array, Index, Index, Array, Array]:
    """Entries into zones along a trip, and where they count.

    Parameters
    ----------
    zones : ZoneBatch
    times : (n,) array
        Planning clock, s.
    positions : (n, 2) array
        Planning frame, m.
    margins : (L,) array
        m.
    width : float
        Of the hinge, m.

    Returns
    -------
    (excess, zone, sample, normal, rate)
        (L, n) m, -inf where it is negligible; zone and sample of the m entries that are not, their normals (m, 2), and
        rates of the distance (m,) m/s.
    """
    # Lower bounds are enough to tell what is negligible.
    bound = zones.distances(times, positions, -np.inf)
    sample, zone = np.nonzero(bound < NEGLIGIBLE * width + margins)
    contacts = zones.contacts(zone, times[sample], positions[sample])
    excess = np.full((zones.size, len(times)), -np.inf)
    excess[zone, sample] = margins[zone] - contacts.distance
    return excess, zone, sample, contacts.normal, contacts.rate


class _Terms:
    """The violations of one trip, and the partial derivatives of Q with respect to theta, beta and tau."""

    def __init__(
        self, objective: PenalisedObjective, trajectory: Trajectory, points: TripPoints, gradient: bool
    ) -> None:
        self.objective = objective
        self.problem = objective.problem
        self.trajectory = trajectory
        self.points = points
        self.wanted = gradient
        self.theta = np.zeros(self.problem.space.path_size)
        self.beta = np.zeros(self.problem.space.acceleration_size)
        self.tau = 1.0

    def total_gradient(self) -> Array:
        """Eliminate tau: from v0 tau + A tau^2 = L, (v0 + 2 A tau) dtau = dL - tau^2 dA."""
        space, tau = self.problem.space, self.trajectory.travel_time
        gain = float(space.tables.final_distance @ self.trajectory.beta)
        rate = self.tau / sqrt(max(space.start_speed**2 + 4.0 * gain * self.trajectory.path.arc_length, 1e-300))
        theta = self.theta + rate * self.trajectory.path.final_gradient
        beta = self.beta - (rate * tau * tau) * space.tables.final_distance
        return np.concatenate([theta[self.problem.ends.free], beta])

    def zones(self) -> tuple[Array, Array]:
        """Violations of the zones and their use."""
        objective, points = self.objective, self.points
        excess, zone, sample, normal, rate = zone_excess(
            self.problem.zones, points.time, points.path.position, objective.margins.zones, objective.hinge.zones
        )
        violation, share = soft_excess(excess, objective.times.shares, objective.hinge.zones)
        if self.wanted and len(zone):
            # dQ = -sum price share dc over all entries: first the sums of one sample.
            price = -(objective.weights.zones[:, None] * share)[zone, sample]
            count = len(points.time)
            push, pull = np.zeros((count, 2)), np.zeros(count)
            np.add.at(push, sample, price[:, None] * normal)
            np.add.at(pull, sample, price * rate)
            self._add_positions(push, pull)
        return violation, share.sum(axis=1)

    def _add_positions(self, push: Array, rate: Array) -> None:
        """Add the derivatives of sum_i push_i . r(t_i) + rate_i t_i, over (n, 2) and (n,) arrays."""
        index = np.flatnonzero((push != 0.0).any(axis=1) | (rate != 0.0))
        if len(index) == 0:
            return
        push, rate, points = push[index], rate[index], self.points.take(index)
        path = points.path
        sideways = (push * path.normal).sum(axis=1)
        self.theta += sideways @ self.problem.space.path.rows_at(path.span, path.local)
        self._add_stations((push * path.direction).sum(axis=1), points)
        self.tau += float(rate @ points.table.sigma)

    def _add_stations(self, along: Array, points: TripPoints) -> None:
        """Add the derivatives of sum_i along_i s(t_i), s the station at fixed normalised times, (n,)."""
        trajectory, table, tau = self.trajectory, points.table, self.trajectory.travel_time
        along = along / points.path.speed
        # The vehicle waits at the start where it would have driven backwards.
        along[(points.distance < 0.0) | (points.distance > trajectory.path.arc_length)] = 0.0
        self.theta -= along @ trajectory.path.arc_length_gradient(points.parameter)
        self.beta += (tau * tau) * (along @ table.distance)
        self.tau += float(along @ self._distance_rate(points.distance, table.sigma))

    def _distance_rate(self, distance: Array, sigma: Array) -> Array:
        """Derivative of D = v0 tau sigma + tau^2 C2 beta with respect to tau."""
        return 2.0 * distance / self.trajectory.travel_time - self.problem.space.start_speed * sigma

    def limits(self) -> tuple[Array, Array]:
        """Violations of the limits and their use."""
        violation, use = np.zeros(_count(self.problem)), np.zeros(_count(self.problem))
        for limit, found in (
            (LATERAL, self._lateral()),
            (CURVATURE, self._curvature()),
            (SPEED, self._speed(self.problem.limits.speed, 1.0)),
            (BOX, self._box()),
            (REVERSE, self._speed(self.problem.limits.speed, -1.0)),
            (ACCELERATION, self._acceleration()),
            (GOAL_SPEED, self._goal_speed()),
            (OFFSET, self._offset()),
        ):
            violation[limit], use[limit] = found
        for place, optional in enumerate(self.problem.optional, start=OPTIONAL):
            violation[place], use[place] = self._optional(place, optional)
        return violation, use

    def _optional(self, place: int, limit: OptionalLimit) -> tuple[float, float]:
        """One of the problem's optional limits, whose rows are for steps of (theta, b = tau^2 beta, tau)."""
        trajectory, tau = self.trajectory, self.trajectory.travel_time
        violation, share = self._violation(place, limit.excess(trajectory))
        counted = np.flatnonzero(share)
        if self.wanted and len(counted):
            price = self.objective.weights.limits[place] * share[counted]
            theta, beta, (rho,) = np.split(price @ limit.gradient(trajectory, counted), [-1 - len(self.beta), -1])
            self.theta[self.problem.ends.free] += theta
            self.beta += beta
            # at fixed beta: b moves with tau
            self.tau += (float(rho) + 2.0 * float(beta @ trajectory.beta)) / tau
        return violation, float(share.sum())

    def _violation(self, limit: int, excess: Array) -> tuple[float, Array]:
        """Give the violation of excesses (n,), and the derivatives with respect to each."""
        objective = self.objective
        shares = np.full(len(excess), 1.0 / max(len(excess), 1))
        violation, derivative = soft_excess(excess + objective.margins.limits[limit], shares, objective.hinge.limits)
        return float(violation), derivative

    def _both_sides(self, limit: int, value: Array) -> tuple[float, float, Array]:
        """Give violation and use of |value| <= 1, and the price times the derivative with respect to value."""
        violation, share = self._violation(limit, np.concatenate([value - 1.0, -value - 1.0]))
        count = len(value)
        return violation, float(share.sum()), self.objective.weights.limits[limit] * (share[:count] - share[count:])

    def _lateral(self) -> tuple[float, float]:
        """Lateral acceleration at the fixed stations, and at the jumps of the acceleration, where the speed peaks."""
        limit = self.problem.limits.lateral_acceleration
        if not np.isfinite(limit):
            return 0.0, 0.0
        trajectory, path = self.trajectory, self.trajectory.path
        arrivals, bend = trajectory.arrivals(path.station_arc_lengths), path.station_bend
        sigma, speed = arrivals.sigma, arrivals.speed
        jumps = self.points.take(self.objective.times.jumps)
        jump_bend = path.bend(jumps.path)
        value = np.concatenate([speed**2 * bend.curvature, jumps.speed**2 * jump_bend.curvature]) / limit
        violation, use, price = self._both_sides(LATERAL, value)
        if self.wanted:
            price = price / limit
            self._add_lateral_at_stations(price[: len(sigma)], sigma, speed)
            self._add_lateral_at_jumps(price[len(sigma) :], jumps, jump_bend)
        return violation, use

    def _add_lateral_at_stations(self, price: Array, sigma: Array, speed: Array) -> None:
        """Add price d(v^2 k): D(sigma) = S(theta) moves sigma, d(v^2) = 2 v dv + 2 a (dS - dD), regular at v = 0."""
        index = np.flatnonzero(price)
        if len(index) == 0:
            return
        trajectory, path, tau = self.trajectory, self.trajectory.path, self.trajectory.travel_time
        table = self.problem.space.time_table(sigma[index])
        price, speed, bend = price[index], speed[index], path.station_bend
        squared = 2.0 * price * bend.curvature[index]
        by_speed, by_distance = squared * speed, squared * (table.acceleration @ trajectory.beta)
        self.beta += tau * (by_speed @ table.speed) - tau * tau * (by_distance @ table.distance)
        rate = self._distance_rate(path.station_arc_lengths[index], table.sigma)
        self.tau += float(by_speed @ (speed - self.problem.space.start_speed)) / tau - float(by_distance @ rate)
        self.theta += by_distance @ path.station_gradients[index]
        every = np.zeros_like(sigma)
        every[index] = price * speed**2
        self._add_station_bend(every)

    def _add_lateral_at_jumps(self, price: Array, jumps: TripPoints, bend: PathBend) -> None:
        """Add price d(v^2 k) at fixed normalised times, where the station moves."""
        index = np.flatnonzero(price)
        if len(index) == 0:
            return
        space, path = self.problem.space, self.trajectory.path
        rate = path.curvature_rate(jumps.path)[index]
        price, curvature, jumps = price[index], bend.curvature[index], jumps.take(index)
        squared, by_speed = price * jumps.speed**2, 2.0 * price * jumps.speed * curvature
        tau = self.trajectory.travel_time
        self.beta += tau * (by_speed @ jumps.table.speed)
        self.tau += float(by_speed @ (jumps.speed - space.start_speed)) / tau
        self._add_stations(squared * rate, jumps)
        span, local, basis = jumps.path.span, jumps.path.local, space.path
        self.theta += (squared * bend.bend[index] / space.length**2) @ basis.derivative.derivative.rows_at(span, local)
        self.theta += (squared * bend.slope[index] / space.length) @ basis.derivative.rows_at(span, local)
        if not space.guide.straight:
            self.theta += (squared * bend.value[index]) @ basis.rows_at(span, local)

    def _curvature(self) -> tuple[float, float]:
        limit = self.problem.limits.curvature
        if not np.isfinite(limit):
            return 0.0, 0.0
        violation, use, price = self._both_sides(CURVATURE, self.trajectory.path.station_bend.curvature / limit)
        if self.wanted and price.any():
            self._add_station_bend(price / limit)
        return violation, use

    def _add_station_bend(self, price: Array) -> None:
        """Add price d curvature at the fixed stations, (M,)."""
        space, bend = self.problem.space, self.trajectory.path.station_bend
        tables = space.tables
        self.theta += (price * bend.bend / space.length**2) @ tables.station_bends
        self.theta += (price * bend.slope / space.length) @ tables.station_slopes
        if not space.guide.straight:
            self.theta += (price * bend.value) @ tables.station_rows

    def _speed(self, limit: float, sign: float) -> tuple[float, float]:
        """Excess of the speed's control points over the limit (sign 1), or below zero (-1), relative to the limit."""
        speeds = self.trajectory.speed_control_points()[1:]
        which = SPEED if sign > 0 else REVERSE
        violation, share = self._violation(which, speeds / limit - 1.0 if sign > 0 else -speeds / limit)
        if self.wanted:
            price = self.objective.weights.limits[which] * sign / limit * share
            by_speed = price @ self.problem.space.tables.speed_control[1:]
            self.beta += self.trajectory.travel_time * by_speed
            self.tau += float(by_speed @ self.trajectory.beta)
        return violation, float(share.sum())

    def _acceleration(self) -> tuple[float, float]:
        limits, beta = self.problem.limits, self.trajectory.beta
        excess = np.concatenate([beta / limits.acceleration, -beta / limits.deceleration]) - 1.0
        violation, share = self._violation(ACCELERATION, excess)
        price = self.objective.weights.limits[ACCELERATION] * share
        self.beta += price[: len(beta)] / limits.acceleration - price[len(beta) :] / limits.deceleration
        return violation, float(share.sum())

    def _offset(self) -> tuple[float, float]:
        """Control points of the offset beyond their bounds, m: over a bent guide they keep the path from folding."""
        ends, free = self.problem.ends, self.problem.ends.free
        theta = self.trajectory.theta[free]
        excess = np.concatenate([theta - ends.upper[free], ends.lower[free] - theta])
        violation, share = self._violation(OFFSET, excess)
        price = self.objective.weights.limits[OFFSET] * share
        self.theta[free] += price[: len(theta)] - price[len(theta) :]
        return violation, float(share.sum())

    def _goal_speed(self) -> tuple[float, float]:
        wanted, tau = self.problem.ends.goal_speed, self.trajectory.travel_time
        if wanted is None:
            return 0.0, 0.0
        row = self.problem.space.tables.final_speed
        gap = self.problem.space.start_speed + tau * float(row @ self.trajectory.beta) - wanted
        violation, share = self._violation(GOAL_SPEED, np.array([gap, -gap]))
        price = self.objective.weights.limits[GOAL_SPEED] * float(share[0] - share[1])
        self.beta += price * tau * row
        self.tau += price * float(row @ self.trajectory.beta)
        return violation, float(share.sum())

    def _box(self) -> tuple[float, float]:
        gaps = box_gaps(self.problem, self.trajectory.path)
        if gaps.size == 0:
            return 0.0, 0.0
        violation, share = self._violation(BOX, -gaps.ravel())
        if self.wanted:
            price = (self.objective.weights.limits[BOX] * share).reshape(gaps.shape)
            tables, frame = self.problem.space.tables, self.problem.space.station_frame
            push = price @ self.problem.box.normals
            sideways = push[:, 1] if frame is None else (push * frame.normal).sum(axis=1)
            self.theta += sideways @ tables.station_rows
        return violation, float(share.sum())
