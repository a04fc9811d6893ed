"""Dodges: the trips that they stand for, and their distances to zones."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import disc, scene

from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.online.dodge_courses import GRADUAL, LIMIT_SHARE, PROMPT, Bend, Profiles
from scp_planner.online.dodge_worth import GROWING, a_moment
from scp_planner.online.dodges import WHOLE, Dodges, Size
from scp_planner.online.evasion import HURRIED, Evasion
from scp_planner.online.planner import Planner
from scp_planner.online.ramped_profiles import RampedProfiles
from scp_planner.online.remaining import State
from scp_planner.scenario.limits import Box, Limits
from scp_planner.settings.online import OnlineSettings
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.zone import ThreatZone

LIMITS = Limits(1.5, 1.0, 1.5, 1.5, 2.0)


def dodges_of(heading: float | None, speed: float, ahead: float, radius: float, bend: Bend = GRADUAL) -> Dodges:
    return Dodges.of(heading, Profiles.of(speed, LIMITS, 2.0 * radius, 1.0), ahead, LIMITS, radius, 1.0, bend=bend)


@pytest.mark.parametrize(
    ("first", "heading", "speed", "bend"),
    [
        (0, None, 0.0, GRADUAL),
        (1, None, 1.2, GRADUAL),
        (0, 0.7, 0.0, GRADUAL),
        (1, 0.7, 1.2, GRADUAL),
        (0, 0.7, 1.2, PROMPT),
    ],
)
def test_dodges_are_the_trips_that_they_stand_for(first: int, heading: float | None, speed: float, bend: Bend) -> None:
    """Every other of them: even numbers and odd ones."""
    dodges = dodges_of(heading, speed, 0.2, 0.3, bend)
    frame = PlanningFrame((3.0, -2.0), 0.4, 5.0)
    for number in range(first, len(dodges.position), 2):
        trip = dodges.trip(number, frame)
        points, _ = trip.at(5.0 + dodges.times)
        place = frame.to_frame(trip.frame.to_world(points.path.position))
        assert np.abs(place - dodges.position[number]).max() < 0.02
        assert np.all(points.speed <= max(LIMITS.speed, speed) + 1e-9)
        assert points.acceleration.max() <= LIMITS.acceleration and points.acceleration.min() >= -LIMITS.deceleration
        curvature = np.abs(trip.trajectory.path.bend(points.path).curvature)
        assert curvature.max() <= LIMITS.curvature
        assert (curvature * points.speed**2).max() <= LIMITS.lateral_acceleration
        over = dodges.times > dodges.until[number] - dodges.wait
        assert np.all(points.speed[over] <= 1e-9)


@pytest.mark.parametrize("bend", [GRADUAL, PROMPT])
def test_a_bend_turns_by_all_of_its_angle_and_no_faster_than_it_says(bend: Bend) -> None:
    shares = np.linspace(0.0, 1.2, 1201)
    turned = bend.turned(shares)
    slope = np.diff(turned) / np.diff(shares)
    assert turned[0] == 0.0 and turned[shares >= 1.0] == pytest.approx(1.0)
    assert slope.min() > -1e-9 and 0.98 * bend.peak < slope.max() <= bend.peak
    assert abs(slope[999]) < 0.02, "then it goes straight on"
    assert (slope[0] > 0.9 * bend.peak) == (bend is PROMPT)


@pytest.mark.parametrize(("heading", "speed", "acceleration"), [(None, 1.2, 0.9), (0.7, 0.0, 0.0), (0.7, 1.2, -1.3)])
def test_dodges_without_jumps_are_the_trips_that_they_stand_for(
    heading: float | None, speed: float, acceleration: float
) -> None:
    state, jerk = State(0.0, (0.0, 0.0), heading, speed, acceleration), 3.0
    profiles = RampedProfiles.of(state, LIMITS, jerk, 0.6, 1.0)
    dodges = Dodges.of(heading, profiles, 0.2, LIMITS, 0.3, 1.0)
    frame = PlanningFrame((3.0, -2.0), 0.4, 5.0)
    for number in range(0, len(dodges.position), 3):
        trip = dodges.trip(number, frame)
        drive = trip.trajectory
        points, _ = trip.at(5.0 + dodges.times)
        place = frame.to_frame(trip.frame.to_world(points.path.position))
        assert np.abs(place - dodges.position[number]).max() < 0.02
        assert drive.beta[0] == acceleration and drive.beta[-1] == 0.0
        slopes = np.diff(drive.beta) / (np.diff(drive.space.acceleration.breakpoints) * drive.travel_time)
        assert np.abs(slopes).max() <= jerk
        assert drive.beta.max() <= LIMITS.acceleration and drive.beta.min() >= -LIMITS.deceleration
        fine = drive.speed_at(np.linspace(0.0, 1.0, 400))
        assert fine.min() >= -1e-9
        assert fine.max() <= profiles.fastest.max() + 1e-9
        bend = np.abs(drive.path.bend(points.path).curvature)
        assert (bend * points.speed**2).max() <= LIMITS.lateral_acceleration
        over = dodges.times > dodges.until[number] - dodges.wait
        assert np.all(points.speed[over] <= 1e-9)


def test_distances_of_dodges_are_those_to_the_nearest_zone() -> None:
    """Discs exactly; an ellipse in the direction of its centre, which is never more; outlines where they are near."""
    wall = {"id": "wall", "shape": {"polygon": [[-0.2, -4.0], [0.2, -4.0], [0.2, 4.0], [-0.2, 4.0]]}}
    scenario = scene(
        disc("a", (2.0, 1.0), (-0.5, 0.1)),
        disc("b", (-1.0, -2.0), (0.2, 0.5)),
        {**wall, "motion": {"position": [2.5, 0.0]}},
    )
    zones, vehicle = tuple(ZonesOf(scenario)), scenario.vehicle
    frame = PlanningFrame((0.0, 0.0), 0.3, 0.0)
    dodges = dodges_of(0.1, 0.5, 0.0, vehicle.radius)
    batch = ZoneBatch.of(zones, frame, vehicle.radius)
    room = dodges.room(batch, Box.of(scenario, frame, 0.0), vehicle)
    exact = np.array(
        [[zone.signed_distance(dodges.times, frame.to_world(place)) for zone in zones] for place in dodges.position]
    )
    nearest = exact.min(axis=1) - vehicle.radius
    near = nearest < 0.1
    assert near.sum() > 100
    assert room.least[near] == pytest.approx(nearest[near], abs=1e-9)
    assert np.all(room.least <= nearest + 1e-9)
    whose = np.array([room.nearest(*at) for at in np.argwhere(near).tolist()])
    assert np.all(whose == exact.argmin(axis=1)[near])


@pytest.mark.parametrize("unseen", [0.0, 0.8])
def test_zones_grow_until_the_vehicle_stands_and_has_looked_again(unseen: float) -> None:
    """Of one whose velocity is not known: the region of two normal errors at 95 %, by hand."""
    scenario = scene(confidence={"probability": 0.95, "level": "per_time"})
    planner = Planner(scenario, online=OnlineSettings(manoeuvre=0.0))
    planner.add_obstacle("a", {"disc": 0.3})
    planner.update_obstacle("a", 0.0, (1.5, 0.0), (0.0, 0.0), covariance=np.diag([0.01, 0.01, 0.04, 0.04]))
    zones = planner._means.moment(State(0.0, (0.0, 0.0), None, 0.0)).zones
    frame, vehicle = PlanningFrame((0.0, 0.0), 0.0, 0.0), scenario.vehicle
    dodges = dodges_of(None, 0.0, 0.0, vehicle.radius)
    batch = ZoneBatch.of(zones, frame, vehicle.radius)
    box, sizes = Box.of(scenario, frame, 0.0), (WHOLE, Size(0.25), Size(latest=0.6), Size(0.25, 0.6))
    rooms = dodges.rooms(batch, box, vehicle, unseen, dodges.within_reach(batch, vehicle), sizes)
    assert np.array_equal(dodges.room(batch, box, vehicle, unseen).least, rooms[0].least)
    times = np.minimum(dodges.times, np.maximum((dodges.until - dodges.wait)[:, None], unseen))
    away = np.linalg.norm(dodges.position - [1.5, 0.0], axis=-1)
    for size, room in zip(sizes, rooms, strict=True):
        deviation = np.sqrt(0.01 + 0.04 * np.minimum(times, size.latest) ** 2)
        expected = away - 0.3 - vehicle.radius - size.share * math.sqrt(-2.0 * math.log(0.05)) * deviation
        assert room.least == pytest.approx(expected, abs=1e-9)


def test_what_dodges_are_worth_does_not_depend_on_how_zones_grow_later() -> None:
    """Whether they are clear does: of two obstacles that are known alike for a moment, one is lost sight of then."""
    seen = []
    for growth in (0.0, 0.3):
        planner = Planner(scene(confidence={"probability": 0.95, "level": "per_time"}))
        evasion = Evasion(planner._means)
        moment = planner._means.moment(State(0.0, (0.0, 0.0), None, 0.0))
        later = GROWING * a_moment(planner.given.vehicle)
        spread = PiecewisePolynomials(
            np.array([[0.0, later, np.inf]]),
            np.array([[[[0.04, 0.0, 0.04], [0.0, 0.0, 0.0]], [[0.04, 0.0, 0.04], [growth, 0.0, growth]]]]),
        )
        centers = PiecewisePolynomials(np.array([[0.0, np.inf]]), np.array([[[[2.0, 0.0], [-0.5, 0.0]]]]))
        moment = replace(moment, zones=(ThreatZone("a", 0.3, centers, spread),))
        seen.append(evasion.outlooks.of(moment, evasion._dodges(moment)))
    known, unknown = seen
    assert np.array_equal(known.worth, unknown.worth) and np.isinf(unknown.clear).sum() < np.isinf(known.clear).sum()


@pytest.mark.parametrize("speed", [0.0, 0.4, 1.2])
def test_dodges_speed_up_as_promptly_as_they_may(speed: float) -> None:
    """However long they last: at the next replan another may be needed, and who is slow is hit."""
    profiles = Profiles.of(speed, LIMITS, 0.6, 1.0)
    for number in np.flatnonzero(profiles.fastest > speed).tolist():
        drive = profiles.drive(number)
        needed = (profiles.fastest[number] - speed) / (LIMIT_SHARE * LIMITS.acceleration)
        assert drive.beta.max() == pytest.approx(LIMIT_SHARE * LIMITS.acceleration) or needed < profiles.span[number]
        assert drive.beta[0] == pytest.approx(drive.beta.max())


def crowd(count: int) -> list[dict[str, Any]]:
    places = np.random.default_rng(0).uniform(-6.0, 6.0, (count, 2)).tolist()
    return [disc(f"d{number}", (x, y), (0.1, -0.2)) for number, (x, y) in enumerate(places)]


def test_distances_to_many_zones_are_computed_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = scene(*crowd(40), start={"position": [-9.0, 0.0]})
    frame, vehicle = PlanningFrame((0.0, 0.0), 0.3, 0.0), scenario.vehicle
    dodges = dodges_of(None, 0.5, 0.0, vehicle.radius)
    batch = ZoneBatch.of(tuple(ZonesOf(scenario)), frame, vehicle.radius)
    whole = dodges.room(batch, Box.of(scenario, frame, 0.0), vehicle)
    monkeypatch.setattr("scp_planner.online.dodges.TOGETHER", 7 * dodges.heading.size)
    counts: list[int] = []
    put = Dodges._put_distances

    def counted(self: Dodges, batch: ZoneBatch, *more: Any) -> None:
        counts.append(batch.size)
        put(self, batch, *more)

    monkeypatch.setattr(Dodges, "_put_distances", counted)
    parts = dodges.room(batch, Box.of(scenario, frame, 0.0), vehicle)
    assert len(counts) > 1 and max(counts) <= 7 and sum(counts) == len(whole.zones)
    assert np.array_equal(parts.each, whole.each)


@pytest.mark.parametrize("heading", [None, 0.7])
def test_who_is_late_looks_at_few_dodges_among_many_zones(heading: float | None) -> None:
    dodges = dodges_of(heading, 1.2, 0.2, 0.3)
    assert dodges.few(3, HURRIED) is dodges, "among few zones all of them take no time"
    before = len(dodges.position)
    for zones in (500, 2000, 10**6):
        fewer = dodges.few(zones, HURRIED)
        speeds = sum(len(family.profiles.stands) for family in fewer.families)
        most = max(HURRIED // (zones * len(dodges.times)), 1)
        assert len(fewer.position) <= min(most + speeds, before) and len(fewer.position) < len(dodges.position)
        before = len(fewer.position)
        assert len(fewer.until) == len(fewer.position) == len(fewer.heading)
        first = fewer.trip(0, PlanningFrame((0.0, 0.0), 0.0, 0.0))
        assert (
            first.trajectory.travel_time == dodges.trip(0, PlanningFrame((0.0, 0.0), 0.0, 0.0)).trajectory.travel_time
        )
        assert fewer.position[0] == pytest.approx(dodges.position[0], abs=1e-12)
