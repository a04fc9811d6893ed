"""Random trips whose values are found by other means, and zones that they just pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scenes import scene
from scipy.interpolate import BSpline
from scipy.optimize import minimize_scalar

import scp_planner as sp
from scp_planner.certificate.check import certify_trip
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.guide import StraightGuide
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

Array = np.ndarray
RADIUS = 0.3  # m, of the vehicle
FRAME = PlanningFrame((3.0, -2.0), 0.7, 5.0)
GOAL = (3.0 + 20.0 * np.cos(0.7), -2.0 + 20.0 * np.sin(0.7))
BREAKS = (0.0, 0.11, 0.2, 0.37, 0.5, 0.68, 0.83, 1.0)
UNLIMITED = {
    "max_speed": 1e3,
    "max_acceleration": 1e3,
    "max_deceleration": 1e3,
    "max_lateral_acceleration": None,
    "max_curvature": None,
}
SEEDS = range(6)


def the_scene(*obstacles: dict[str, Any], **changes: Any) -> sp.Scenario:
    """A scene that asks for little, in the world of FRAME."""
    start = {"time": FRAME.time, "position": FRAME.origin, "heading": None, "speed": 1.0}
    vehicle = {**UNLIMITED, **changes.pop("vehicle", {})}
    return scene(
        *obstacles,
        start={**start, **changes.pop("start", {})},
        goal={"position": GOAL, **changes.pop("goal", {})},
        vehicle=vehicle,
        **changes,
    )


def random_trip(
    seed: int, path_degree: int = 3, acceleration_degree: int = 0, arc: float = 0.4, frame: PlanningFrame = FRAME
) -> Trip:
    """A trip that speeds up and slows down, and never stops."""
    rng = np.random.default_rng(seed)
    space = TripSpace(StraightGuide(20.0), 1.0, path_degree, 9, acceleration_degree, BREAKS)
    theta = arc * rng.normal(size=space.path_size)
    theta[0] = theta[-1] = 0.0
    beta = rng.uniform(-0.15, 0.6, space.acceleration_size)
    beta[0], beta[3] = 0.8, -0.2
    return Trip(frame, Trajectory.of(space, theta, beta).settled())


class Reference:
    """A trip evaluated with scipy's splines and a fine table of the arc length: nothing of the package."""

    def __init__(self, trip: Trip) -> None:
        trajectory = trip.trajectory
        self.tau = trajectory.travel_time
        self.start_speed = trajectory.space.start_speed
        self.offset = _spline(trajectory.space.path.breakpoints * 20.0, trajectory.theta)
        self.acceleration = _spline(trajectory.space.acceleration.breakpoints * self.tau, trajectory.beta)
        self._speed = self.acceleration.antiderivative()
        self._distance = self.acceleration.antiderivative(2)
        self.station_knots = trajectory.space.path.breakpoints[1:-1] * 20.0
        self._stations = np.union1d(np.linspace(0.0, 20.0, 4001), self.station_knots)
        nodes, weights = np.polynomial.legendre.leggauss(6)
        half = 0.5 * np.diff(self._stations)
        inside = self._stations[:-1, None] + half[:, None] * (1.0 + nodes)
        lengths = half * (np.hypot(1.0, self.offset(inside, nu=1)) @ weights)
        self._lengths = np.concatenate([[0.0], np.cumsum(lengths)])
        self.frame = trip.frame

    def speed(self, t: Array) -> Array:
        return self.start_speed + self._speed(t)

    def station(self, t: Array) -> Array:
        """Station after t seconds: a step of Newton's method after the table, twice."""
        distance = self.start_speed * t + self._distance(t)
        station = np.interp(distance, self._lengths, self._stations)
        nodes, weights = np.polynomial.legendre.leggauss(6)
        for _ in range(2):
            cell = np.clip(np.searchsorted(self._stations, station, "right") - 1, 0, len(self._stations) - 2)
            half = 0.5 * (station - self._stations[cell])
            inside = self._stations[cell][..., None] + half[..., None] * (1.0 + nodes)
            driven = self._lengths[cell] + half * (np.hypot(1.0, self.offset(inside, nu=1)) @ weights)
            station = np.clip(station - (driven - distance) / np.hypot(1.0, self.offset(station, nu=1)), 0.0, 20.0)
        return station

    def curvature_at(self, station: Array) -> Array:
        return self.offset(station, nu=2) / np.hypot(1.0, self.offset(station, nu=1)) ** 3

    def curvature(self, t: Array) -> Array:
        return self.curvature_at(self.station(t))

    def lateral(self, t: Array) -> Array:
        return self.speed(t) ** 2 * self.curvature(t)

    def position(self, t: Array) -> Array:
        """World coordinates t seconds after the start."""
        station = self.station(np.asarray(t, dtype=float))
        offset, cosine, sine = self.offset(station), np.cos(self.frame.heading), np.sin(self.frame.heading)
        return np.stack(
            [
                self.frame.origin[0] + cosine * station - sine * offset,
                self.frame.origin[1] + sine * station + cosine * offset,
            ],
            axis=-1,
        )


def _spline(breaks: Array, control: Array) -> BSpline:
    degree = len(control) - len(breaks) + 1
    return BSpline(np.concatenate([breaks[:1].repeat(degree), breaks, breaks[-1:].repeat(degree)]), control, degree)


def least(function: Callable[[Array], Array], low: float, high: float, count: int = 20001) -> tuple[float, float]:
    """Place of the least value of a function of an array, and that value."""
    grid = np.linspace(low, high, count)
    values = function(grid)
    best = int(np.argmin(values))
    bracket = (grid[max(best - 1, 0)], grid[min(best + 1, count - 1)])
    found = minimize_scalar(
        lambda x: float(function(np.array([x]))[0]), bounds=bracket, method="bounded", options={"xatol": 1e-10}
    )
    return min((float(values[best]), float(grid[best])), (float(found.fun), float(found.x)))[::-1]


@dataclass(frozen=True)
class Passing:
    """An obstacle's motion past a trip, and where its centre is nearest."""

    motion: dict[str, Any]
    time: float
    distance: float

    def obstacle(self, depth: float) -> dict[str, Any]:
        """A disc with this motion that the vehicle's disc cuts into by ``depth``, m."""
        return {
            "id": "passing",
            "shape": {"disc": self.distance - RADIUS + depth},
            "motion": self.motion,
        }


def passing(reference: Reference, seed: int, speed: float, distance: float = 0.9) -> Passing:
    """An obstacle that passes a trip at some time, at about this distance and relative speed."""
    rng = np.random.default_rng(seed + 1000)
    t = rng.uniform(0.2, 0.8) * reference.tau
    here, later = reference.position(np.array([t, t + 1e-4]))
    angle = rng.uniform(0.0, 2.0 * np.pi)
    along = np.array([np.cos(angle), np.sin(angle)])
    acceleration = rng.uniform(-0.5, 0.5, 2)
    clock = t + FRAME.time
    velocity = (later - here) / 1e-4 + speed * along - acceleration * clock
    position = here + distance * np.array([-along[1], along[0]]) - velocity * clock - acceleration * clock**2 / 2

    def gap(times: Array) -> Array:
        clocks = times[:, None] + FRAME.time
        centers = position + velocity * clocks + acceleration * clocks**2 / 2
        return np.hypot(*(reference.position(times) - centers).T)

    when, gap_there = least(gap, 0.0, reference.tau)
    motion = {"position": position, "velocity": velocity, "acceleration": acceleration}
    return Passing({"time": 0.0} | {key: value.tolist() for key, value in motion.items()}, when, gap_there)


def verdict(scenario: sp.Scenario, trip: Trip, zones: tuple[ThreatZone, ...] | None = None) -> sp.Certificate:
    return certify_trip(scenario, trip, sp.zones(scenario) if zones is None else zones)


def broken(certificate: sp.Certificate) -> set[str]:
    assert certificate.holds == (not certificate.violations)
    return {violation.what for violation in certificate.violations}


def elliptic_zone(reference: Reference, seed: int) -> tuple[ThreatZone, float]:
    """A zone whose ellipse grows and turns as those of estimates do, without radius, and its distance from the trip."""
    rng = np.random.default_rng(seed)
    motion = passing(reference, seed, 4.0, distance=3.5).motion
    centers = PiecewisePolynomials.single(
        0.0, np.array([motion["position"], motion["velocity"], 0.5 * np.array(motion["acceleration"])])
    )
    # Covariance of e0 + e1 u + e2 u^2, u the time since the last observation, with e0, e1 and e2 correlated
    root = rng.normal(size=(6, 6)) * np.repeat([0.2, 0.1, 0.02], 2)[:, None]
    errors = (root @ root.T).reshape(3, 2, 3, 2)
    covariance = np.zeros((5, 3))
    for i in range(3):
        for j in range(3):
            block = errors[i, :, j]
            covariance[i + j] += (block[0, 0], 0.5 * (block[0, 1] + block[1, 0]), block[1, 1])
    zone = ThreatZone("seen", 0.0, centers, PiecewisePolynomials.single(FRAME.time - 0.3, covariance))
    angle = np.linspace(0.0, 2.0 * np.pi, 2881)
    directions = np.stack([np.cos(angle), np.sin(angle)])

    def gap(times: Array) -> Array:
        """Largest separation over directions, from a parabola through the best and its neighbours."""
        u = times[:, None] + 0.3
        clock = times[:, None] + FRAME.time
        powers = np.array(motion["position"]) + np.array(motion["velocity"]) * clock
        offset = reference.position(times) - powers - np.array(motion["acceleration"]) * clock**2 / 2
        xx, xy, yy = (np.polynomial.polynomial.polyval(u, covariance[:, k]) for k in range(3))
        x, y = directions
        separation = offset @ directions - np.sqrt(xx * x * x + 2.0 * xy * x * y + yy * y * y)
        best = np.argmax(separation[:, 1:-1], axis=1) + 1
        rows = np.arange(len(times))
        low, mid, high = (separation[rows, best + k] for k in (-1, 0, 1))
        return mid - 0.125 * (high - low) ** 2 / np.minimum(low - 2.0 * mid + high, -1e-300)

    return zone, least(gap, 0.0, reference.tau, 2001)[1]


def vehicle_limits(reference: Reference) -> dict[str, float]:
    """The worst values of a trip, by dense samples."""
    times = np.linspace(0.0, reference.tau, 40001)
    inner = reference.acceleration(np.linspace(1e-9, 1.0 - 1e-9, 40001) * reference.tau)
    return {
        "max_speed": float(reference.speed(np.union1d(times, reference.acceleration.t[1:-1])).max()),
        "max_acceleration": float(inner.max()),
        "max_deceleration": float(-inner.min()),
        "max_curvature": -least(lambda s: -np.abs(reference.curvature_at(s)), 0.0, 20.0, 40001)[1],
        "max_lateral_acceleration": -least(lambda t: -np.abs(reference.lateral(t)), 0.0, reference.tau, 40001)[1],
    }
