"""Enclosures: every value on an interval lies in what is said of the interval."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from reference_trips import (
    BREAKS,
    FRAME,
    RADIUS,
    SEEDS,
    Array,
    Reference,
    broken,
    elliptic_zone,
    passing,
    random_trip,
    the_scene,
    verdict,
)
from scenes import CROSSERS, disc
from scipy.optimize import brentq
from scipy.special import fresnel

import scp_planner as sp
from scp_planner.certificate.checked_trip import CheckedTrip
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.intervals import Interval
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.bounds import MovingPoint, ZoneBounds
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.guide import Guide, GuideFrame, StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics


SLACK = 1e-9


def inside_intervals(middle: Array, half: Array, count: int = 9) -> Array:
    """Points inside each interval, both ends included: (n, count)."""
    return middle[:, None] + half[:, None] * np.linspace(-1.0, 1.0, count)


@pytest.mark.parametrize(
    ("seed", "degree"),
    [
        pytest.param(seed, degree, marks=() if degree == (seed + seed // 3) % 3 else pytest.mark.slow)
        for seed in SEEDS
        for degree in (0, 1, 2)
    ],
)
def test_bounds_on_pieces_of_time_contain_dense_samples(seed: int, degree: int) -> None:
    trip = random_trip(seed, path_degree=3 + seed % 3, acceleration_degree=degree, arc=0.8)
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
        pieces = pieces.cut(np.arange(len(pieces.middle)) % 3 == 0, 2)


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
