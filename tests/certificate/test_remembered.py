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
from scp_planner.certificate.checked_trip import Scope
from scp_planner.certificate.remembered import Motions
from scp_planner.mathematics.polynomials import PiecewisePolynomials
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
