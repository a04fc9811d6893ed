"""People of a simulation who walk to their goals and give way to each other by `scp_planner.simulation.orca`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index, Mask
from scp_planner.simulation.orca import Bodies, HalfPlanes, half_planes, nearest_velocities
from scp_planner.simulation.tolerances import ROUNDING
from scp_planner.simulation.worlds import VehicleState


@dataclass(frozen=True)
class Manner:
    step: float = 0.25  # From one decision to the next, s; in between velocities are kept
    horizon: float = 5.0  # For which they look ahead, s
    view: float = 10.0  # Within which they heed others, centre to centre, m
    neighbours: int = 10  # So many of them at most, the nearest
    padding: float = 0.01  # By which they take everybody's radius to be larger, m

    def __post_init__(self) -> None:
        for name, value, fits, allowed in (
            ("step", self.step, 0.0 < self.step < math.inf, "finite and greater than 0"),
            ("horizon", self.horizon, 0.0 < self.horizon < math.inf, "finite and greater than 0"),
            ("view", self.view, self.view >= 0.0, "at least 0"),
            ("neighbours", self.neighbours, self.neighbours >= 0, "at least 0"),
            ("padding", self.padding, 0.0 <= self.padding < math.inf, "finite and at least 0"),
        ):
            if not fits:
                raise ValueError(f"manner: {name} {value!r} must be {allowed}")


class OrcaPeople:
    """People who walk to their goals and stay there, by optimal reciprocal collision avoidance."""

    def __init__(
        self,
        positions: ArrayLike,
        goals: ArrayLike,
        speeds: ArrayLike = 1.0,
        radii: ArrayLike = 0.3,
        manner: Manner | None = None,
        sees_vehicle: bool = True,
    ) -> None:
        self.positions = np.array(positions, dtype=float).reshape(-1, 2)
        count = len(self.positions)
        self.goals = np.array(goals, dtype=float).reshape(-1, 2)
        self.speeds = np.broadcast_to(np.asarray(speeds, dtype=float), (count,)).copy()
        self.radii = np.broadcast_to(np.asarray(radii, dtype=float), (count,)).copy()
        if self.goals.shape != self.positions.shape:
            raise ValueError(f"goals: there are {len(self.goals)} of them for {count} people")
        for name, values in (("speeds", self.speeds), ("radii", self.radii)):
            if not (np.isfinite(values).all() and (values > 0.0).all()):
                raise ValueError(f"{name}: {values.tolist()} must be finite and greater than 0")
        self.manner = manner or Manner()
        self.sees_vehicle = sees_vehicle
        self.velocities = np.zeros((count, 2))
        self.names = tuple(f"p{k}" for k in range(count))
        self._left = 0.0  # s until the next decision

    def step(self, dt: float, vehicle: VehicleState) -> Mapping[str, ArrayLike]:
        """Move on by dt, s, with the vehicle as it is at the beginning; return centres (2,) m by id."""
        while dt > 0.0:
            if self._left <= ROUNDING * self.manner.step:
                self.decide(vehicle)
                self._left = self.manner.step
            part = dt if dt < self._left + ROUNDING * self.manner.step else self._left
            self.positions = self.positions + part * self.velocities
            self._left -= part
            dt -= part
        return dict(zip(self.names, self.positions, strict=True))

    def decide(self, vehicle: VehicleState) -> None:
        """Choose velocities for the next step."""
        if len(self.positions):
            self.velocities = nearest_velocities(self._rows(vehicle), self._wanted(), self.speeds)

    def _wanted(self) -> Array:
        """Straight to the goals, (K, 2) m/s."""
        towards = self.goals - self.positions
        distance = np.hypot(towards[:, 0], towards[:, 1])
        pace = np.minimum(self.speeds, distance)  # slower from 1 s before a goal on
        return np.asarray(towards * (pace / np.where(distance > 0.0, distance, 1.0))[:, None])

    def _rows(self, vehicle: VehicleState) -> HalfPlanes:
        places, velocities, radii = self.positions, self.velocities, self.radii
        if self.sees_vehicle:
            places = np.vstack([places, vehicle.position])
            velocities = np.vstack([velocities, vehicle.velocity])
            radii = np.append(radii, vehicle.radius)
        heeded, chosen = self._heeded(places)
        own = Bodies(self.positions[:, None], self.velocities[:, None], (self.radii + self.manner.padding)[:, None])
        other = Bodies(places[chosen], velocities[chosen], radii[chosen] + self.manner.padding)
        rows = half_planes(own, other, self.manner.horizon, self.manner.step)
        return HalfPlanes(rows.normal, np.where(heeded, rows.offset, -np.inf))

    def _heeded(self, places: Array) -> tuple[Mask, Index]:
        """Others that each person heeds, of all at (L, 2) m, and whether: (K, M) both."""
        between = places[None] - self.positions[:, None]
        apart = np.hypot(between[..., 0], between[..., 1])
        np.fill_diagonal(apart, np.inf)
        many = min(self.manner.neighbours, len(places) - 1)
        chosen = np.argsort(apart, axis=1, kind="stable")[:, :many]
        return np.take_along_axis(apart, chosen, axis=1) <= self.manner.view, chosen


@dataclass(frozen=True)
class Restlessness:
    """Choice of new goals by people: about a circle round the origin."""

    circle: float  # Its radius, m
    every: float = 5.0  # From one time at which goals change at random to the next, s
    chance: float = 0.5
    spread: float = 1.0  # Side of the square about a point of the circle that a goal is in


class RestlessPeople(OrcaPeople):
    """People who change their goals at random, and take a new one when they have arrived."""

    def __init__(
        self,
        positions: ArrayLike,
        goals: ArrayLike,
        speeds: ArrayLike = 1.0,
        radii: ArrayLike = 0.3,
        manner: Manner | None = None,
        sees_vehicle: bool = True,
        *,
        restlessness: Restlessness,
        seed: int = 0,
    ) -> None:
        super().__init__(positions, goals, speeds, radii, manner, sees_vehicle)
        self.restlessness, self.rng = restlessness, np.random.default_rng(seed)
        self._decisions = 0

    def decide(self, vehicle: VehicleState) -> None:
        """Choose goals, and velocities for the next step."""
        offset = self.goals - self.positions
        change = np.hypot(offset[:, 0], offset[:, 1]) < self.radii
        every = round(self.restlessness.every / self.manner.step)
        if self._decisions % every == 0 and self._decisions:
            change |= self.rng.random(len(change)) <= self.restlessness.chance
        for k in np.flatnonzero(change):
            self.goals[k] = self._goal(float(self.speeds[k]))
        self._decisions += 1
        super().decide(vehicle)

    def _goal(self, speed: float) -> Array:
        goal = on_circle(self.rng, self.restlessness.circle)
        return goal + self.rng.uniform(-0.5, 0.5, 2) * self.restlessness.spread * speed


def on_circle(rng: np.random.Generator, radius: float) -> Array:
    """Draw a point of a circle round the origin, (2,) m."""
    angle = rng.uniform(0.0, 2.0 * math.pi)
    return radius * np.array([math.cos(angle), math.sin(angle)])
