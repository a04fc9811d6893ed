"""Dodges: the trips that they stand for, and their distances to zones."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import disc, scene

from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.dodge_courses import GRADUAL, PROMPT, Bend, Profiles
from scp_planner.online.dodges import Dodges
from scp_planner.online.ramped_profiles import RampedProfiles
from scp_planner.online.remaining import State
from scp_planner.scenario.limits import Box, Limits
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import ZonesOf

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
