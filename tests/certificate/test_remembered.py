"""Trips that are remembered to keep all limits."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from reference_trips import (
    FRAME,
    SEEDS,
    Reference,
    broken,
    passing,
    random_trip,
    the_scene,
)

import scp_planner as sp
from scp_planner.certificate.check import certify_trip
from scp_planner.certificate.checked_trip import CheckedTrip, Scope
from scp_planner.certificate.remembered import Motions
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.path import Path
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics


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


def changing(zones: tuple[ThreatZone, ...], knots: np.ndarray, reaches: np.ndarray) -> tuple[ThreatZone, ...]:
    """Zones that reach farther than their discs by so much, (K + 1,) m, between times (K,), s."""
    spread = np.zeros((1, len(reaches), 1, 3))
    spread[0, :, 0, 0] = spread[0, :, 0, 2] = reaches**2
    made = []
    for zone in zones:
        ends = zone.centers.breakpoints[0, [0, -1]]
        breaks = np.concatenate([ends[:1], knots, ends[1:]])[None]
        made.append(replace(zone, covariances=PiecewisePolynomials(breaks, spread)))
    return tuple(made)


@pytest.mark.parametrize("seed", SEEDS[:2])
def test_zones_that_change_while_it_is_driven_change_no_verdict(seed: int) -> None:
    """Zones that grow and shrink at once, at random times: what is remembered is cut there, and judged as if new."""
    trip, rng = random_trip(seed), np.random.default_rng(seed)
    reference, free, motions = Reference(trip), the_scene(), Motions()
    assert certify_trip(free, trip, (), motions=motions).holds
    lasts, verdicts = trip.trajectory.travel_time, []
    for _ in range(30):
        near = the_scene(passing(reference, int(rng.integers(1 << 30)), 3.0).obstacle(rng.uniform(-0.25, 0.05)))
        scenario = free.model_copy(update={"obstacles": near.obstacles})
        knots = np.sort(FRAME.time + rng.uniform(0.0, lasts, 6))
        zones = changing(sp.zones(near), knots, rng.choice([1e-3, 0.1, 0.2], 7))
        since = FRAME.time + rng.uniform(0.0, 0.6) * lasts
        known, new = (
            certify_trip(scenario, trip, zones, Scope(since, precision=np.inf), motions=some)
            for some in (motions, None)
        )
        assert known.holds == new.holds
        verdicts.append(known.holds)
    assert 3 < sum(verdicts) < 27


@pytest.mark.parametrize("offsets", [(0.0,), (-0.2, 0.3)])
def test_pieces_that_are_cut_cover_the_same_and_have_no_knot_inside(offsets: tuple[float, ...]) -> None:
    trip, rng = random_trip(0), np.random.default_rng(0)
    free, motions, lasts = the_scene(), Motions(), trip.trajectory.travel_time
    free = free.model_copy(update={"vehicle": free.vehicle.model_copy(update={"discs": offsets})})
    assert certify_trip(free, trip, (), motions=motions).holds
    motion = motions.of(trip)
    near = the_scene(passing(Reference(trip), 1, 3.0).obstacle(0.1))
    for _ in range(20):
        knots = np.sort(FRAME.time + rng.uniform(0.0, lasts, 6))
        zones = changing(sp.zones(near), knots, np.full(7, 0.1))
        batch = ZoneBatch.of(zones, trip.frame, free.vehicle.radius)
        checked = CheckedTrip.of(free, trip, batch, Scope(FRAME.time + rng.uniform(0.0, 0.6) * lasts))
        assert motion is not None
        part = motion.part(checked)
        assert part is not None
        order = np.argsort(part.pieces.middle)
        middle, half = part.pieces.middle[order], part.pieces.half[order]
        ends = middle[0] - half[0], middle[-1] + half[-1]
        assert ends == pytest.approx((checked.first, checked.last))
        assert (middle - half)[1:] == pytest.approx((middle + half)[:-1], abs=1e-12)
        inside = np.abs((knots - FRAME.time)[:, None] / lasts - middle) < half - 1e-12
        assert not inside.any()
        for disc, offset in zip(part.discs, free.vehicle.discs, strict=True):
            center = disc.center
            assert center.time == pytest.approx(lasts * part.pieces.middle)
            assert center.half == pytest.approx(lasts * part.pieces.half)
            assert len(disc.off) == len(middle) and not disc.most_off.any()
            for share in np.linspace(-0.99, 0.99, 9):
                since, step = share * center.half, 0.01 * center.half
                times = FRAME.time + center.time + since
                place, before, after = (place_of_disc(trip, times + moved, offset) for moved in (0.0, -step, step))
                off = np.linalg.norm(place - center.position - since[:, None] * center.velocity, axis=1)
                assert (off <= 0.5 * center.acceleration * center.half**2 + 1e-7).all()
                velocity = (after - before) / (2.0 * step)[:, None]
                slower = np.linalg.norm(velocity - center.velocity, axis=1)
                assert (slower <= center.acceleration * center.half + 1e-3).all()
                if abs(share) < 1e-9:
                    assert (off <= 1e-7 - disc.off).all() and (disc.off < 0.0).any()


def place_of_disc(trip: Trip, times: np.ndarray, offset: float) -> np.ndarray:
    """Where a disc that is so far ahead is at times (n,), s: (n, 2) m."""
    points, _ = trip.at(times)
    heading = points.path.direction / np.linalg.norm(points.path.direction, axis=1, keepdims=True)
    return np.asarray(points.path.position + offset * heading)


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
