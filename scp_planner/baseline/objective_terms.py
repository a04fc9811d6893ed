"""The violations of one trip, and the partial derivatives of the penalised objective."""

from __future__ import annotations

from math import sqrt

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.baseline.objective_parts import (
    ACCELERATION,
    BOX,
    CURVATURE,
    GOAL_SPEED,
    LATERAL,
    OFFSET,
    OPTIONAL,
    REVERSE,
    SPEED,
    Pricing,
    limit_count,
    soft_excess,
)
from scp_planner.problem.limits.limit import OptionalLimit
from scp_planner.scp.evaluation import box_gaps
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.path import PathBend
from scp_planner.trips.trajectory import Trajectory, TripPoints

NEGLIGIBLE = 37.0  # exp(-37) is below the rounding of 1


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


class Terms:
    """The violations of one trip, and the partial derivatives of Q with respect to theta, beta and tau."""

    def __init__(self, pricing: Pricing, trajectory: Trajectory, points: TripPoints, gradient: bool) -> None:
        self.pricing = pricing
        self.problem = pricing.problem
        self.trajectory = trajectory
        self.points = points
        self.wanted = gradient
        self.theta = np.zeros(self.problem.space.path_size)
        self.beta = np.zeros(self.problem.space.acceleration_size)
        self.tau = 1.0

    def total_gradient(self) -> Array:
        """Return dQ / d omega, with tau eliminated: from v0 tau + A tau^2 = L, (v0 + 2 A tau) dtau = dL - tau^2 dA."""
        space, tau = self.problem.space, self.trajectory.travel_time
        gain = float(space.tables.final_distance @ self.trajectory.beta)
        rate = self.tau / sqrt(max(space.start_speed**2 + 4.0 * gain * self.trajectory.path.arc_length, 1e-300))
        theta = self.theta + rate * self.trajectory.path.final_gradient
        beta = self.beta - (rate * tau * tau) * space.tables.final_distance
        return np.concatenate([theta[self.problem.ends.free], beta])

    def zones(self) -> tuple[Array, Array]:
        """Return the violations of the zones and their use."""
        pricing, points = self.pricing, self.points
        excess, zone, sample, normal, rate = zone_excess(
            self.problem.zones, points.time, points.path.position, pricing.margins.zones, pricing.hinge.zones
        )
        violation, share = soft_excess(excess, pricing.times.shares, pricing.hinge.zones)
        if self.wanted and len(zone):
            # dQ = -sum price share dc over all entries: first the sums of one sample.
            price = -(pricing.weights.zones[:, None] * share)[zone, sample]
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
        """Return the violations of the limits and their use."""
        violation, use = np.zeros(limit_count(self.problem)), np.zeros(limit_count(self.problem))
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
            price = self.pricing.weights.limits[place] * share[counted]
            theta, beta, (rho,) = np.split(price @ limit.gradient(trajectory, counted), [-1 - len(self.beta), -1])
            self.theta[self.problem.ends.free] += theta
            self.beta += beta
            # at fixed beta: b moves with tau
            self.tau += (float(rho) + 2.0 * float(beta @ trajectory.beta)) / tau
        return violation, float(share.sum())

    def _violation(self, limit: int, excess: Array) -> tuple[float, Array]:
        """Give the violation of excesses (n,), and the derivatives with respect to each."""
        pricing = self.pricing
        shares = np.full(len(excess), 1.0 / max(len(excess), 1))
        violation, derivative = soft_excess(excess + pricing.margins.limits[limit], shares, pricing.hinge.limits)
        return float(violation), derivative

    def _both_sides(self, limit: int, value: Array) -> tuple[float, float, Array]:
        """Give violation and use of |value| <= 1, and the price times the derivative with respect to value."""
        violation, share = self._violation(limit, np.concatenate([value - 1.0, -value - 1.0]))
        count = len(value)
        return violation, float(share.sum()), self.pricing.weights.limits[limit] * (share[:count] - share[count:])

    def _lateral(self) -> tuple[float, float]:
        """Lateral acceleration at the fixed stations, and at the jumps of the acceleration, where the speed peaks."""
        limit = self.problem.limits.lateral_acceleration
        if not np.isfinite(limit):
            return 0.0, 0.0
        trajectory, path = self.trajectory, self.trajectory.path
        arrivals, bend = trajectory.arrivals(path.station_arc_lengths), path.station_bend
        sigma, speed = arrivals.sigma, arrivals.speed
        jumps = self.points.take(self.pricing.times.jumps)
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
            price = self.pricing.weights.limits[which] * sign / limit * share
            by_speed = price @ self.problem.space.tables.speed_control[1:]
            self.beta += self.trajectory.travel_time * by_speed
            self.tau += float(by_speed @ self.trajectory.beta)
        return violation, float(share.sum())

    def _acceleration(self) -> tuple[float, float]:
        limits, beta = self.problem.limits, self.trajectory.beta
        excess = np.concatenate([beta / limits.acceleration, -beta / limits.deceleration]) - 1.0
        violation, share = self._violation(ACCELERATION, excess)
        price = self.pricing.weights.limits[ACCELERATION] * share
        self.beta += price[: len(beta)] / limits.acceleration - price[len(beta) :] / limits.deceleration
        return violation, float(share.sum())

    def _offset(self) -> tuple[float, float]:
        """Control points of the offset beyond their bounds, m: over a bent guide they keep the path from folding."""
        ends, free = self.problem.ends, self.problem.ends.free
        theta = self.trajectory.theta[free]
        excess = np.concatenate([theta - ends.upper[free], ends.lower[free] - theta])
        violation, share = self._violation(OFFSET, excess)
        price = self.pricing.weights.limits[OFFSET] * share
        self.theta[free] += price[: len(theta)] - price[len(theta) :]
        return violation, float(share.sum())

    def _goal_speed(self) -> tuple[float, float]:
        wanted, tau = self.problem.ends.goal_speed, self.trajectory.travel_time
        if wanted is None:
            return 0.0, 0.0
        row = self.problem.space.tables.final_speed
        gap = self.problem.space.start_speed + tau * float(row @ self.trajectory.beta) - wanted
        violation, share = self._violation(GOAL_SPEED, np.array([gap, -gap]))
        price = self.pricing.weights.limits[GOAL_SPEED] * float(share[0] - share[1])
        self.beta += price * tau * row
        self.tau += price * float(row @ self.trajectory.beta)
        return violation, float(share.sum())

    def _box(self) -> tuple[float, float]:
        gaps = box_gaps(self.problem, self.trajectory.path)
        if gaps.size == 0:
            return 0.0, 0.0
        violation, share = self._violation(BOX, -gaps.ravel())
        if self.wanted:
            price = (self.pricing.weights.limits[BOX] * share).reshape(gaps.shape)
            tables, frame = self.problem.space.tables, self.problem.space.station_frame
            push = price @ self.problem.box.normals
            sideways = push[:, 1] if frame is None else (push * frame.normal).sum(axis=1)
            self.theta += sideways @ tables.station_rows
        return violation, float(share.sum())
