"""The certificate against trips evaluated by scipy: it refuses what is wrong by little, between any samples."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import CROSSERS, disc, scene
from scipy.interpolate import BSpline
from scipy.optimize import brentq, minimize_scalar
from scipy.special import fresnel

import scp_planner as sp
from scp_planner.certificate.check import certify_trip
from scp_planner.certificate.checked_trip import CheckedTrip, Scope
from scp_planner.certificate.remembered import Motions
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.intervals import Interval
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.bounds import MovingPoint, ZoneBounds
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.guide import CurvedGuide, Guide, GuideFrame, StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics

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
    seed: int, path_degree: int = 3, acceleration_degree: int = 0, bow: float = 0.4, frame: PlanningFrame = FRAME
) -> Trip:
    """A trip that speeds up and slows down, and never stops."""
    rng = np.random.default_rng(seed)
    space = TripSpace(StraightGuide(20.0), 1.0, path_degree, 9, acceleration_degree, BREAKS)
    theta = bow * rng.normal(size=space.path_size)
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
    """Where a function of an array is least, and its value there."""
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
    return Passing({key: value.tolist() for key, value in motion.items()}, when, gap_there)


def verdict(scenario: sp.Scenario, trip: Trip, zones: tuple[ThreatZone, ...] | None = None) -> sp.Certificate:
    return certify_trip(scenario, trip, sp.zones(scenario) if zones is None else zones)


def broken(certificate: sp.Certificate) -> set[str]:
    assert certificate.holds == (not certificate.violations)
    return {violation.what for violation in certificate.violations}


@pytest.mark.parametrize("speed", [0.5, 3.0, 30.0])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_cut_of_a_millimetre_into_a_zone_is_refused_and_a_miss_of_one_is_not(seed: int, speed: float) -> None:
    trip = random_trip(seed, acceleration_degree=seed % 3)
    reference = Reference(trip)
    near = passing(reference, seed, speed)

    for depth in (1e-3, 1e-6):
        cut = verdict(the_scene(near.obstacle(depth)), trip)
        assert broken(cut) == {"clearance"}
        (violation,) = cut.violations
        assert violation.obstacle == "passing"
        assert -depth - 1e-8 <= violation.value < 0.0
        assert violation.time == pytest.approx(near.time + FRAME.time, abs=0.1)
        assert cut.clearance.minimum == violation.value

    for depth in (-1e-3, -1e-6):
        missed = verdict(the_scene(near.obstacle(depth)), trip)
        assert broken(missed) == set()
        assert 0.0 <= missed.clearance.minimum <= -depth + 1e-8
        assert missed.clearance.obstacle == "passing"


@pytest.mark.parametrize("seed", [1, 2, 4, 5])
def test_the_cut_lies_between_samples(seed: int) -> None:
    """The fast obstacles above are inside for so short a time that equidistant samples do not see them."""
    trip = random_trip(seed, acceleration_degree=seed % 3)
    reference = Reference(trip)
    obstacle = passing(reference, seed, 30.0).obstacle(1e-3)
    scenario = the_scene(obstacle)
    motion = scenario.obstacles[0].motion
    assert isinstance(motion, sp.Motion)
    for count in (80, 160, 192):
        times = np.linspace(0.0, reference.tau, count + 1)
        clock = times[:, None] + FRAME.time
        centers = (
            np.array(motion.position) + np.array(motion.velocity) * clock + np.array(motion.acceleration) * clock**2 / 2
        )
        gap = np.hypot(*(reference.position(times) - centers).T) - RADIUS - obstacle["shape"]["disc"]
        assert gap.min() > 0.0
    assert not verdict(scenario, trip).holds


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


@pytest.mark.parametrize("seed", SEEDS)
def test_a_cut_into_the_growing_ellipse_of_an_estimate_is_refused(seed: int) -> None:
    trip = random_trip(seed)
    reference = Reference(trip)
    zone, distance = elliptic_zone(reference, seed)
    assert distance > RADIUS
    scenario = the_scene()

    cut = verdict(scenario, trip, (replace(zone, radius=distance - RADIUS + 1e-3),))
    assert broken(cut) == {"clearance"}
    assert cut.violations[0].obstacle == "seen"
    assert -1e-3 - 1e-5 <= cut.violations[0].value < 0.0

    missed = verdict(scenario, trip, (replace(zone, radius=distance - RADIUS - 1e-3),))
    assert broken(missed) == set()
    assert 0.0 <= missed.clearance.minimum <= 1e-3 + 1e-5


@pytest.mark.parametrize("seed", SEEDS)
def test_a_zone_that_darts_in_and_out_between_samples_is_seen(seed: int) -> None:
    """Pieces of an obstacle's motion may begin and end anywhere, also within one interval of the certificate."""
    trip = random_trip(seed)
    reference = Reference(trip)
    rng = np.random.default_rng(seed)
    begin = FRAME.time + rng.uniform(0.3, 0.7) * reference.tau
    here = reference.position(np.array([begin - FRAME.time]))[0]
    # Stands 2 m aside, comes and goes at constant acceleration in four parts of a millisecond, stands again
    aside, step = here + np.array([2.0, 0.0]), 1e-3
    push = -1.9 / step**2 / 2.0 * np.array([1.0, 0.0])  # half the acceleration
    half_way = aside + push * step**2
    in_place = half_way + 2.0 * push * step**2 - push * step**2
    fast = 2.0 * push * step
    pieces = np.array(
        [
            [aside, [0, 0], [0, 0]],
            [aside, [0, 0], push],
            [half_way, fast, -push],
            [in_place, [0, 0], -push],
            [half_way, -fast, push],
            [aside, [0, 0], [0, 0]],
        ]
    )
    edges = np.concatenate([[FRAME.time], begin + step * np.arange(5), [np.inf]])
    zone = ThreatZone("darting", 0.5, PiecewisePolynomials(edges[None], pieces[None]))
    times = np.linspace(begin, begin + 4 * step, 401)
    assert zone.signed_distance(times, reference.position(times - FRAME.time)).min() < -0.3
    assert broken(verdict(the_scene(), trip, (zone,))) == {"clearance"}


def test_a_trip_through_real_zones_holds_with_all_their_clearances() -> None:
    """The reported clearance is a lower bound, at most a millimetre below the true one."""
    trip = random_trip(3)
    reference = Reference(trip)
    obstacles = [passing(reference, seed, 2.0).obstacle(-0.05 * (1 + seed)) for seed in range(4)]
    scenario = the_scene(*({**obstacle, "id": f"o{k}"} for k, obstacle in enumerate(obstacles)))
    certificate = verdict(scenario, trip)
    assert broken(certificate) == set()
    assert certificate.clearance.obstacle == "o0"
    assert 0.05 - 1e-3 <= certificate.clearance.minimum <= 0.05 + 1e-8


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


@pytest.mark.parametrize(
    ("limit", "name"),
    [
        ("max_speed", "speed"),
        ("max_acceleration", "acceleration"),
        ("max_deceleration", "acceleration"),
        ("max_curvature", "curvature"),
        ("max_lateral_acceleration", "lateral_acceleration"),
    ],
)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_limit_broken_by_a_thousandth_is_refused(seed: int, limit: str, name: str) -> None:
    trip = random_trip(seed, path_degree=3 + seed % 3)
    worst = vehicle_limits(Reference(trip))[limit]
    assert worst > 0.0

    refused = verdict(the_scene(vehicle={limit: worst / 1.001}), trip)
    assert broken(refused) == {name}
    (violation,) = refused.violations
    assert abs(violation.value) == pytest.approx(worst, rel=1e-3)
    assert abs(violation.allowed) == pytest.approx(worst / 1.001)

    kept = verdict(the_scene(vehicle={limit: worst * (1.0 + 1e-6)}), trip)
    assert broken(kept) == set()
    assert abs(kept.limits[name].worst) == pytest.approx(worst, rel=2e-3)


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_a_peak_of_curvature_between_knots_is_found(seed: int) -> None:
    trip = random_trip(seed, path_degree=5, bow=1.2)
    reference = Reference(trip)
    where, value = least(lambda s: -np.abs(reference.curvature_at(s)), 0.0, 20.0, 200001)
    assert np.abs(reference.station_knots - where).min() > 0.05
    assert broken(verdict(the_scene(vehicle={"max_curvature": -value * (1.0 - 1e-6)}), trip)) == {"curvature"}
    assert broken(verdict(the_scene(vehicle={"max_curvature": -value * (1.0 + 1e-6)}), trip)) == set()


@pytest.mark.parametrize("degree", [1, 2])
def test_speed_and_acceleration_of_smooth_profiles_are_bounded(degree: int) -> None:
    """By control points, which a smooth profile stays below: what is refused may hold, what is accepted does."""
    trip = random_trip(2, acceleration_degree=degree)
    worst = vehicle_limits(Reference(trip))
    for limit, name in (
        ("max_speed", "speed"),
        ("max_acceleration", "acceleration"),
        ("max_deceleration", "acceleration"),
    ):
        assert broken(verdict(the_scene(vehicle={limit: worst[limit] / 1.001}), trip)) == {name}
        assert broken(verdict(the_scene(vehicle={limit: worst[limit] * 1.5 + 0.2}), trip)) == set()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("seed", SEEDS)
def test_limits_are_told_apart_to_a_millionth(seed: int, degree: int) -> None:
    """Control points of smooth profiles lie farther beyond them than that."""
    trip = random_trip(seed, acceleration_degree=degree)
    reference = Reference(trip)
    times = np.linspace(0.0, reference.tau, 200_001)
    speed, acceleration = float(reference.speed(times).max()), reference.acceleration(times)
    room = 1.0 + 1e-6
    limits = {
        "max_speed": speed * room,
        "max_acceleration": float(acceleration.max()) * room,
        "max_deceleration": max(-float(acceleration.min()) * room, 1e-3),
    }
    assert broken(verdict(the_scene(vehicle=limits), trip)) == set()
    for name, what in (("max_speed", "speed"), ("max_acceleration", "acceleration")):
        less = {**limits, name: limits[name] / room**2}
        assert broken(verdict(the_scene(vehicle=less), trip)) == {what}


def test_driving_backwards_is_refused() -> None:
    space = TripSpace(StraightGuide(20.0), 1.0, 3, 9, 0, (0.0, 0.3, 0.6, 1.0))
    beta = np.array([-0.5, 0.5, 0.6])
    trip = Trip(FRAME, Trajectory.of(space, np.zeros(space.path_size), beta))
    assert Reference(trip).speed(np.array([0.3 * trip.trajectory.travel_time]))[0] < 0.0
    assert broken(verdict(the_scene(), trip)) == {"speed"}


def test_ends_that_differ_from_the_scenario_are_refused() -> None:
    trip = random_trip(1)
    reference = Reference(trip)
    final = float(reference.speed(np.array([reference.tau]))[0])
    headings = [FRAME.heading + float(np.arctan(reference.offset(s, nu=1))) for s in (0.0, 20.0)]
    frame, tiny = trip.frame, 1e-3

    right = the_scene(start={"heading": headings[0]}, goal={"heading": headings[1], "speed": final})
    assert broken(verdict(right, trip)) == set()
    turned = the_scene(start={"heading": headings[0] + 2.0 * np.pi}, goal={"heading": headings[1] - 2.0 * np.pi})
    assert broken(verdict(turned, trip)) == set()

    for scenario, what in (
        (the_scene(start={"heading": headings[0] + tiny}), "start heading"),
        (the_scene(goal={"heading": headings[1] - tiny}), "goal heading"),
        (the_scene(start={"heading": headings[0] + np.pi}), "start heading"),
        (the_scene(start={"speed": 1.0 + tiny}), "start speed"),
        (the_scene(goal={"speed": final + 2.0 * tiny}), "goal speed error"),
        (the_scene(start={"time": FRAME.time + tiny}), "start time"),
        (the_scene(start={"position": [3.0 + tiny, -2.0]}), "distance from the start"),
        (the_scene(goal={"position": [GOAL[0], GOAL[1] - tiny]}), "distance from the goal"),
        (the_scene(goal={"position": [GOAL[0], GOAL[1] - 0.2], "radius": 0.199}), "distance from the goal"),
    ):
        assert broken(verdict(scenario, trip)) == {what}
    inside = the_scene(goal={"position": [GOAL[0], GOAL[1] - 0.2], "radius": 0.201})
    assert broken(verdict(inside, trip)) == set()

    moved = replace(frame, origin=(frame.origin[0], frame.origin[1] + tiny))
    assert broken(verdict(the_scene(), Trip(moved, trip.trajectory))) == {
        "distance from the start",
        "distance from the goal",
    }


@pytest.mark.parametrize("factor", [0.999, 1.001])
def test_a_travel_time_that_does_not_fit_path_and_speed_is_refused(factor: float) -> None:
    """Longer, and the vehicle would stand still at the goal while its speed says that it moves."""
    whole = random_trip(1).trajectory
    trip = Trip(FRAME, Trajectory(whole.path, whole.beta, factor * whole.travel_time))
    assert not verdict(the_scene(), trip).holds


def test_what_is_not_a_number_is_refused() -> None:
    whole = random_trip(1).trajectory
    for theta_spoilt, beta_spoilt in ((4, None), (None, 3)):
        theta, beta = whole.theta.copy(), whole.beta.copy()
        if theta_spoilt is not None:
            theta[theta_spoilt] = np.nan
        if beta_spoilt is not None:
            beta[beta_spoilt] = np.nan
        with np.errstate(invalid="ignore"):
            trip = Trip(FRAME, Trajectory(Path(whole.space, theta), beta, whole.travel_time))
            assert not verdict(the_scene(), trip).holds


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["low", "high"])
@pytest.mark.parametrize("axis", [0, 1], ids=["x", "y"])
def test_leaving_the_workspace_between_samples_is_refused(axis: int, sign: float) -> None:
    frame = PlanningFrame((3.0, -2.0), (0.5 * np.pi, 0.0)[axis], 5.0)
    trip = random_trip(4, frame=frame)
    reference = Reference(trip)
    goal = {"position": frame.to_world(np.array([20.0, 0.0])).tolist()}
    where, extreme = least(lambda t: sign * reference.position(t)[:, axis], 0.0, reference.tau)
    assert 0.5 < where < reference.tau - 0.5
    for slip, expected in ((1e-5, {"workspace bounds"}), (-1e-5, set())):
        walls = {"min": [-50.0, -50.0], "max": [50.0, 50.0]}
        walls["min" if sign > 0.0 else "max"][axis] = sign * (extreme - RADIUS + slip)
        assert broken(verdict(the_scene(bounds=walls, goal=goal), trip)) == expected


def test_a_gap_exactly_as_wide_as_the_vehicle_is_refused_at_once() -> None:
    walls = [
        {
            "id": name,
            "shape": {"rectangle": [6.0, 3.0], "heading": 0.0},
            "motion": {"position": [10.0, side * (1.8 - 1e-11)]},
        }
        for name, side in (("upper", 1.0), ("lower", -1.0))
    ]
    # Halving the intervals along the walls, where the distance is nothing but rounding, would take all memory.
    certificate = sp.certify(scene(*walls), sp.plan(scene()))
    (violation,) = certificate.violations
    assert (violation.what, violation.obstacle in ("upper", "lower")) == ("clearance", True)
    assert abs(violation.value) < 1e-9


def test_all_that_is_wrong_is_named_at_once() -> None:
    trip = random_trip(1)
    reference = Reference(trip)
    worst = vehicle_limits(reference)
    scenario = the_scene(
        passing(reference, 1, 3.0).obstacle(0.2),
        vehicle={name: 0.9 * value for name, value in worst.items()},
        start={"speed": 1.1},
    )
    certificate = verdict(scenario, trip)
    assert broken(certificate) == {
        "start speed",
        "speed",
        "acceleration",
        "curvature",
        "lateral_acceleration",
        "clearance",
    }
    assert "clearance to passing -0." in str(certificate.violations[-1])


# Enclosures: every value on an interval lies in what is said of the interval.

SLACK = 1e-9


def inside_intervals(middle: Array, half: Array, count: int = 9) -> Array:
    """Points inside each interval, both ends included: (n, count)."""
    return middle[:, None] + half[:, None] * np.linspace(-1.0, 1.0, count)


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("seed", SEEDS)
def test_bounds_on_pieces_of_time_contain_dense_samples(seed: int, degree: int) -> None:
    trip = random_trip(seed, path_degree=3 + seed % 3, acceleration_degree=degree, bow=0.8)
    reference = Reference(trip)
    zone, distance = elliptic_zone(reference, seed)
    scenario = the_scene(passing(reference, seed, 3.0).obstacle(0.1), disc("still", (8.0, 1.0)), *CROSSERS)
    zones = (*sp.zones(scenario), replace(zone, radius=distance - RADIUS))
    check = CheckedTrip.of(scenario, trip, ZoneBatch.of(zones, trip.frame, RADIUS))
    pieces = check.first_pieces()
    edges = np.sort(np.concatenate([pieces.middle - pieces.half, pieces.middle + pieces.half]))
    assert edges[0] == pytest.approx(0.0, abs=1e-12)
    assert edges[-1] == pytest.approx(1.0, abs=1e-12)
    assert np.abs(edges[2:-1:2] - edges[1:-2:2]).max() < 1e-12
    for _ in range(2):
        enclosure = check.enclosed(pieces)
        times = reference.tau * inside_intervals(pieces.middle, pieces.half)
        # Values on jumps belong to both sides; so stay inside.
        inner = reference.tau * inside_intervals(pieces.middle, 0.999999 * pieces.half)
        flat = times.ravel()
        for bound, values in (
            (enclosure.curvature_bound, reference.curvature(flat).reshape(times.shape)),
            (enclosure.lateral_bound, reference.lateral(flat).reshape(times.shape)),
            (enclosure.acceleration_bound, reference.acceleration(inner)),
        ):
            assert np.all(np.abs(values) <= bound[:, None] + 1e-7)
        count = len(zones)
        interval, index = np.divmod(np.arange(len(times) * count), count)
        moving = enclosure.disc(0.0)
        bounds = ZoneBounds(check.batch).fine(index, interval, moving)
        exact = check.batch.contacts(index, moving.time[interval], moving.position[interval]).distance
        np.testing.assert_allclose(bounds.value, exact, rtol=0.0, atol=1e-11)
        lower, crude = bounds.lower.reshape(-1, count), ZoneBounds(check.batch).crude(moving)
        positions = reference.position(flat)
        for column, threat in enumerate(zones):
            gap = threat.signed_distance(flat + FRAME.time, positions).reshape(times.shape) - RADIUS
            assert np.all(gap >= lower[:, column, None] - 1e-7)
            assert np.all(gap >= crude[:, column, None] - 1e-7)
        pieces = pieces.halves(np.arange(len(pieces.middle)) % 3 == 0)


class ClothoidGuide:
    """A guide whose curvature grows in proportion to the station: Fresnel's integrals."""

    straight = False

    def __init__(self, length: float, rate: float) -> None:
        self.length = length
        self.rate = rate

    def frame(self, stations: Array) -> GuideFrame:
        scale = np.sqrt(np.pi / self.rate)
        sine, cosine = fresnel(stations / scale)
        angle = 0.5 * self.rate * stations**2
        return GuideFrame(
            scale * np.stack([cosine, sine], axis=-1),
            np.stack([np.cos(angle), np.sin(angle)], axis=-1),
            np.stack([-np.sin(angle), np.cos(angle)], axis=-1),
            self.rate * stations,
            np.full_like(stations, self.rate),
            np.zeros_like(stations),
        )

    def curvature_ranges(self, stations: Array, width: Array) -> tuple[Interval, Interval, Interval]:
        rate = np.full_like(stations, self.rate)
        zero = np.zeros_like(stations)
        return Interval.around(self.rate * stations, self.rate * width), Interval(rate, rate), Interval(zero, zero)

    def to_dict(self) -> dict[str, Any]:
        return {"kind": "clothoid"}


@pytest.mark.parametrize("curved", [False, True], ids=["straight", "clothoid"])
@pytest.mark.parametrize("degree", [3, 4, 5])
@pytest.mark.parametrize("seed", SEEDS)
def test_enclosures_of_the_bend_contain_dense_samples(seed: int, degree: int, curved: bool) -> None:
    rng = np.random.default_rng(seed)
    guide: Guide = ClothoidGuide(20.0, 0.012) if curved else StraightGuide(20.0)  # type: ignore[assignment]
    space = TripSpace(guide, 1.0, degree, 9, 0, BREAKS)
    path = Path(space, 0.6 * rng.normal(size=space.path_size))
    span = rng.integers(0, 9, 200)
    low, high = np.sort(rng.uniform(0.0, 1.0, (2, 200)), axis=0)
    middle, half = (span + 0.5 * (low + high)) / 9.0, 0.5 * (high - low) / 9.0 * rng.choice([1.0, 0.1, 1e-3], 200)
    enclosure = path.bend_enclosure(path.points(middle), half * 20.0)

    parameters = inside_intervals(middle, half)
    points = path.points(parameters.ravel())
    speed = points.speed.reshape(parameters.shape)
    assert np.all(speed >= enclosure.speed.lower[:, None] - SLACK)
    assert np.all(speed <= enclosure.speed.upper[:, None] + SLACK)

    # By the mean value theorem a difference quotient of the curvature is a value of its derivative.
    curvature = path.bend(points).curvature.reshape(parameters.shape)
    rate = (curvature[:, 1:] - curvature[:, :-1]) / (20.0 * np.diff(parameters, axis=1))
    noise = 1e-13 * np.abs(curvature).max() / (20.0 * half[:, None]) + SLACK
    assert np.all(rate >= enclosure.curvature_rate.lower[:, None] - noise)
    assert np.all(rate <= enclosure.curvature_rate.upper[:, None] + noise)
    # On short intervals the enclosure is tight: it encloses, but not everything.
    short = half * 20.0 < 1e-3
    width = (enclosure.curvature_rate.upper - enclosure.curvature_rate.lower)[short]
    assert np.all(width < 0.1 * (1.0 + np.abs(rate[short]).max()))

    # The curvature itself, from positions alone: turn of the direction over the way
    step = 1e-4
    before, here, after = (path.points(middle + k * step / 20.0).position for k in (-1, 0, 1))
    (x0, y0), (x1, y1) = (here - before).T, (after - here).T
    turn = (x0 * y1 - y0 * x1) / (np.hypot(x0, y0) * np.hypot(x1, y1))
    lengths = 0.5 * (np.hypot(x0, y0) + np.hypot(x1, y1))
    away = np.abs(middle * 9.0 - np.round(middle * 9.0)) > 1e-3
    exact = path.bend(path.points(middle)).curvature
    np.testing.assert_allclose((np.arcsin(turn) / lengths)[away], exact[away], atol=2e-4)


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("seed", SEEDS)
def test_sigma_at_inverts_the_distance_driven(seed: int, degree: int) -> None:
    trajectory = random_trip(seed, acceleration_degree=degree).trajectory
    reference = Reference(Trip(FRAME, trajectory))
    rng = np.random.default_rng(seed)
    distance = np.concatenate([[0.0, trajectory.path.arc_length], rng.uniform(0.0, trajectory.path.arc_length, 200)])
    sigma = trajectory.arrivals(distance).sigma
    assert np.all((sigma >= 0.0) & (sigma <= 1.0))
    t = sigma * reference.tau
    driven = reference.start_speed * t + reference._distance(t)
    np.testing.assert_allclose(driven, distance, atol=1e-10)
    # and against root finding
    for wanted, found in zip(distance[2:7], t[2:7], strict=True):
        root = brentq(
            lambda x, wanted=wanted: float(reference.start_speed * x + reference._distance(x)) - wanted,
            0.0,
            reference.tau,
            xtol=1e-13,
        )
        assert found == pytest.approx(root, abs=1e-9)


def test_sigma_at_where_the_vehicle_stops_and_waits() -> None:
    space = TripSpace(StraightGuide(20.0), 2.0, 3, 9, 0, (0.0, 0.2, 0.5, 1.0))
    # Brakes to a stop in the first part, waits in the second, drives on in the third: v0 = 0.2 tau a
    tau = brentq(lambda t: 2.0 * 0.2 * t / 2.0 + 0.5 * 1.2 * (0.5 * t) ** 2 - 20.0, 1.0, 60.0)
    trajectory = Trajectory.of(space, np.zeros(space.path_size), np.array([-2.0 / (0.2 * tau), 0.0, 1.2]))
    assert trajectory.travel_time == pytest.approx(tau)
    stop = 0.2 * tau
    sigma = trajectory.arrivals(np.array([stop - 1e-6, stop, stop + 1e-6])).sigma
    assert sigma[0] < 0.2
    assert 0.2 - 1e-6 <= sigma[1] <= 0.5 + 1e-6
    assert sigma[2] > 0.5
    assert broken(verdict(the_scene(start={"speed": 2.0}), Trip(FRAME, trajectory))) == set()


@pytest.mark.parametrize("seed", SEEDS)
def test_bounds_of_zones_contain_dense_samples(seed: int) -> None:
    reference = Reference(random_trip(seed))
    rng = np.random.default_rng(seed)
    curved = rng.normal(size=(5, 2)) * [[1.0], [1.0], [0.3], [0.05], [0.01]]
    known = ThreatZone("known", 0.5, PiecewisePolynomials.single(FRAME.time + 1.0, curved))
    seen, _ = elliptic_zone(reference, seed)
    batch = ZoneBatch.of((known, seen), FRAME, RADIUS)
    count = 200
    index = rng.integers(0, 2, count)
    middle, half = rng.uniform(0.0, 9.0, count), rng.choice([0.5, 0.05, 0.005], count)
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    acceleration = ZoneBounds(batch).acceleration(index, middle, half)
    growth = ZoneBounds(batch).growth_second_bound(index, middle, half, normal)
    assert np.all(growth[index == 0] == 0.0)
    step = 1e-3
    for row in range(count):
        zone = (known, seen)[index[row]]
        times = FRAME.time + inside_intervals(middle[row : row + 1], half[row : row + 1])[0]
        center = [zone.center(times + k * step) for k in (-1, 0, 1)]
        second = (center[0] - 2.0 * center[1] + center[2]) / step**2
        assert np.hypot(*second.T).max() <= acceleration[row] + 1e-5
        world = FRAME.vectors_to_world(normal[row])
        support = [zone.support(times + k * step, world) for k in (-1, 0, 1)]
        bend = (support[0] - 2.0 * support[1] + support[2]) / step**2
        assert bend.max() <= growth[row] + 1e-5


def test_a_point_on_a_centre_is_not_taken_to_be_clear() -> None:
    """There the direction from the centre says nothing, whatever the size of the zone."""
    still = PiecewisePolynomials.single(0.0, np.array([[2.0, 1.0]]))
    flat = PiecewisePolynomials.single(0.0, np.array([[0.5, 0.0, 0.1]]))
    frame = PlanningFrame((0.0, 0.0), 0.0, 0.0)
    batch = ZoneBatch.of((ThreatZone("seen", 0.0, still, flat), ThreatZone("known", 0.0, still)), frame, 0.0)
    here = MovingPoint(np.ones(1), np.full(1, 0.1), np.array([[2.0, 1.0]]), np.zeros((1, 2)), np.zeros(1))
    assert not np.any(ZoneBounds(batch).crude(here) >= 0.0)
    assert ZoneBounds(batch).fine(np.zeros(1, dtype=int), np.zeros(1, dtype=int), here).value[0] < -0.3


@pytest.mark.parametrize("seed", [seed if seed < 2 else pytest.param(seed, marks=pytest.mark.slow) for seed in SEEDS])
def test_what_is_known_of_a_trip_changes_no_verdict(seed: int) -> None:
    """From any time on, a trip that is driven on is judged as if it had never been seen."""
    trip = random_trip(seed)
    reference = Reference(trip)
    free = the_scene()
    motions = Motions()
    assert certify_trip(free, trip, (), motions=motions).holds
    rng = np.random.default_rng(seed)
    verdicts = []
    for _ in range(14):
        scenario = the_scene(passing(reference, int(rng.integers(1 << 30)), 3.0).obstacle(rng.uniform(-0.03, 0.06)))
        same = free.model_copy(update={"obstacles": scenario.obstacles})
        zones = sp.zones(scenario)
        since = FRAME.time + rng.uniform(0.0, 0.6) * trip.trajectory.travel_time
        for precision in (np.inf, 1e-3):
            known, new = (
                certify_trip(same, trip, zones, Scope(since, precision=precision), motions=some)
                for some in (motions, None)
            )
            assert known.holds == new.holds
            if not known.holds:
                assert broken(known) == {"clearance"} and known.violations[0].time >= since
            elif np.isfinite(precision):
                assert known.clearance.minimum <= new.clearance.minimum + precision
        verdicts.append(known.holds)
    assert 1 < sum(verdicts) < 13


def test_a_trip_is_known_by_all_that_it_depends_on() -> None:
    trip, scenario = random_trip(1), the_scene()
    trajectory = trip.trajectory
    motions = Motions()
    assert certify_trip(scenario, trip, (), motions=motions).holds
    since = FRAME.time + 1.0
    beta = trajectory.beta.copy()
    beta[2] += 1e-9
    bent = trajectory.theta.copy()
    bent[4] = np.nextafter(bent[4], 9.0)
    others = (
        Trip(FRAME, Trajectory(trajectory.path, beta, trajectory.travel_time)),
        Trip(FRAME, Trajectory(Path(trajectory.space, bent), trajectory.beta, trajectory.travel_time)),
        Trip(FRAME, Trajectory(trajectory.path, trajectory.beta, trajectory.travel_time + 1e-9)),
        Trip(replace(FRAME, time=FRAME.time + 1.0), trajectory),
    )
    assert motions.of(trip) is not None and motions.of(Trip(FRAME, copy(trajectory))) is not None
    assert all(motions.of(other) is None for other in others)
    # what is known holds for the limits that it was found with only
    slower = scenario.model_copy(update={"vehicle": scenario.vehicle.model_copy(update={"max_speed": 1.0})})
    assert broken(certify_trip(slower, trip, (), Scope(since), motions=motions)) == {"speed"}
    narrow = scenario.model_copy(update={"bounds": sp.Bounds(min=(0.0, 0.0), max=(1.0, 1.0))})
    assert broken(certify_trip(narrow, trip, (), Scope(since), motions=motions)) == {"workspace bounds"}
    elsewhere = scenario.model_copy(update={"goal": sp.Goal(position=(0.0, 0.0))})
    assert broken(certify_trip(elsewhere, trip, (), Scope(since), motions=motions)) == {"distance from the goal"}


def test_a_trip_that_breaks_a_limit_is_not_remembered_as_one_that_keeps_it() -> None:
    trip = random_trip(1)
    scenario = the_scene(vehicle={"max_speed": 1.2})
    motions = Motions()
    for _ in range(2):
        certificate = certify_trip(scenario, trip, (), Scope(FRAME.time + 1.0), motions=motions)
        assert broken(certificate) == {"speed"}
    assert motions.of(trip) is None


@st.composite
def intervals(draw: st.DrawFn) -> tuple[Interval, Array]:
    """Intervals and points in them, both ends among them."""
    number = st.floats(-1e3, 1e3, allow_nan=False, width=32)
    ends = np.sort(np.array(draw(st.lists(st.tuples(number, number), min_size=3, max_size=3))), axis=1)
    share = np.array([0.0, 1.0, *draw(st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3))])
    inside = ends[:, :1] + share * (ends[:, 1:] - ends[:, :1])
    return Interval(ends[:, 0], ends[:, 1]), np.clip(inside, ends[:, :1], ends[:, 1:])


def encloses(interval: Interval, values: Array) -> bool:
    room = 1e-12 * (1.0 + np.abs(values))
    return bool(np.all(values >= interval.lower[:, None] - room) and np.all(values <= interval.upper[:, None] + room))


@given(intervals(), intervals(), st.floats(-100.0, 100.0))
def test_interval_arithmetic_encloses(
    first: tuple[Interval, Array], second: tuple[Interval, Array], factor: float
) -> None:
    (a, x), (b, y) = first, second
    for k in range(x.shape[1]):
        other = np.roll(y, k, axis=1)
        assert encloses(a + b, x + other)
        assert encloses(a - b, x - other)
        assert encloses(a * b, x * other)
    assert encloses(-a, -x)
    assert encloses(a.scaled(factor), factor * x)
    assert encloses(a.squared(), x * x)
    assert np.all(a.squared().lower >= 0.0)
    assert encloses(Interval(np.zeros(3), a.magnitude()), np.abs(x))
    around = Interval.around(0.5 * (a.lower + a.upper), 0.5 * (a.upper - a.lower))
    assert encloses(around, x)
    positive, z = Interval(np.abs(a.lower) + 0.1, np.abs(a.lower) + 0.1 + (a.upper - a.lower)), x - a.lower[:, None]
    for exponent in (-1.0, -3.0, -5.0):
        assert encloses(positive.power(exponent), (positive.lower[:, None] + z) ** exponent)


def test_a_clearance_that_is_no_number_is_none() -> None:
    trip = random_trip(0)
    zone, _ = elliptic_zone(Reference(trip), 0)
    certificate = verdict(the_scene(), trip, (replace(zone, radius=np.nan),))
    assert broken(certificate) == {"clearance"}


def test_a_path_with_a_cusp_is_refused() -> None:
    bend = CurvedGuide(20.0, np.linspace(0.0, 4.0, 21))  # a radius of 5 m, round which a path at 5 m turns on the spot
    space = TripSpace(bend, 1.0, 3, 4, 0, BREAKS)
    theta = np.full(space.path_size, 0.0)
    theta[2:5] = 5.0
    trip = Trip(FRAME, Trajectory.of(space, theta, np.zeros(space.acceleration_size)))
    found = verdict(the_scene(), trip)
    assert not found.holds
    assert [violation.what for violation in found.violations] == ["error of the positions"]
