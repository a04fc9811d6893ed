from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array
from scp_planner.constraints.ends import EndConditions
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.tolerances import to_digits
from scp_planner.scenario.limits import Box, Limits
from scp_planner.scenario.models import Scenario, Vehicle
from scp_planner.scenario.places import Stretch, limits_at, stretches
from scp_planner.settings.planning import SceneSettings
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.space import TimeTable, TripSpace

OPTIONAL_MARGIN = 2.5e-4  # relative, of limits that only some vehicles have, besides the margin of all limits
LEAST_LEFT = 0.1  # of a limit that is broken at the start: so fast the vehicle still is, after braking, at least
SAME_SPEED = 1e-9  # relative: a start that is faster than the limit by rounding is not
USUAL_ACCELERATION = 2.0  # units of acceleration: a stop from top speed on a ninth of the trip


HARDEST = 1.0 - 5e-7  # of the strongest braking: as hard as an excess has to fall, and within the limit, to rounding


def begins_beyond(scenario: Scenario) -> bool:
    """True if a trip begins faster than the vehicle may be, by a limit of its own or of a place."""
    start, limit = scenario.start, scenario.vehicle.max_speed
    if scenario.speed_limits:
        about = np.array([start.position])
        limit = min(limit, float(limits_at(stretches(scenario), about)[0]))
    return start.speed > limit * (1.0 + SAME_SPEED)


def hardest_deceleration(vehicle: Vehicle) -> float:
    """Braking of a start beyond a limit, m/s^2, without margin: no trip is slower at any time."""
    return HARDEST * min(vehicle.max_deceleration, vehicle.max_total_acceleration or np.inf)


def kept_of_limits(settings: SceneSettings) -> float:
    return 1.0 - settings.limit_margin - OPTIONAL_MARGIN


@dataclass(frozen=True)
class Setup:
    """A scenario's splines, limits, zones and end conditions in the planning frame."""

    scenario: Scenario
    settings: SceneSettings
    frame: PlanningFrame
    space: TripSpace
    ends: EndConditions
    limits: Limits  # With the planner's margin
    zones: ZoneBatch  # Inflated by the vehicle's radius and the planner's margin
    box: Box
    samples: TimeTable  # Times at which zones are looked at: equidistant ones, then the breakpoints of the acceleration
    grid: int
    slow: tuple[Stretch, ...]  # The speed limits by place, less the margins

    @property
    def vehicle(self) -> Vehicle:
        """The scenario's vehicle."""
        return self.scenario.vehicle

    @property
    def kept(self) -> float:
        return kept_of_limits(self.settings)

    @property
    def free_size(self) -> int:
        """Number of free control points of the offset."""
        return self.ends.free.stop - self.ends.free.start

    def highest_speeds(self, limit: float, tau: float) -> Array:
        """Highest control points of the speed after the first, m/s: a limit, and above it what brakes can reach.

        From a start above the vehicle's limit it brakes until one is within that, without the margin: from one to the
        next speeds are straight.
        """
        rows, first = self.space.drive.speed_control[1:], self.space.start_speed
        if first <= limit:
            return np.full(len(rows), limit)
        braking = first + tau * (rows @ self.lowest_accelerations)
        if first <= self.vehicle.max_speed * (1.0 + SAME_SPEED):
            return np.maximum(braking, limit)
        brakes = np.append(first, braking[:-1]) > self.vehicle.max_speed
        return np.where(brakes, np.maximum(braking, LEAST_LEFT * limit), limit)

    @property
    def step_size(self) -> int:
        """Number of variables of a step: free offsets, accelerations, and rho."""
        return self.free_size + self.space.acceleration_size + 1

    @property
    def equidistant(self) -> Array:
        """Equidistant normalised times, (n,)."""
        return self.samples.sigma[: self.grid]

    @cached_property
    def highest_accelerations(self) -> Array:
        """Upper bounds of the accelerations, (K2,) m/s^2; a given one at the start is its own."""
        return self._bounds(self.limits.acceleration)

    @cached_property
    def lowest_accelerations(self) -> Array:
        """Lower bounds of the accelerations, (K2,) m/s^2."""
        return self._bounds(-self.limits.deceleration)

    def _bounds(self, limit: float) -> Array:
        bounds = np.full(self.space.acceleration_size, limit)
        if self.ends.start_acceleration is not None:
            bounds[0] = self.ends.start_acceleration
        return bounds

    @cached_property
    def agility(self) -> float:
        """The largest limit of the acceleration, relative to a usual one: steps of accelerations are measured by it."""
        vehicle = self.vehicle
        return to_digits(max(vehicle.max_acceleration, vehicle.max_deceleration) / USUAL_ACCELERATION)

    def of_path(self, theta: Array) -> Array:
        """Gradients with respect to a step, (m, step), from those by the free offsets alone, (m, free)."""
        return np.concatenate([theta, np.zeros((len(theta), self.space.acceleration_size + 1))], axis=1)

    def of_drive(self, beta: Array, rho: Array) -> Array:
        """Gradients with respect to a step, (m, step), from those by d beta, (m, K2), and rho, (m,)."""
        return np.concatenate([np.zeros((len(beta), self.free_size)), beta, rho[:, None]], axis=1)

    def of_all(self, theta: Array, beta: Array, rho: Array) -> Array:
        """Gradients with respect to a step, (m, step), from those by all offsets, (m, K1), d beta and rho."""
        return np.concatenate([theta[:, self.ends.free], beta, rho[:, None]], axis=1)
