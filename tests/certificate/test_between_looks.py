"""What comes between the looks of the certificate: shapes that turn quickly, and cells beside the border of a block."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from reference_trips import broken
from scenes import VEHICLE

import scp_planner as sp
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.threat_zones.zone import ThreatZone

LENGTH, SPEED = 12.0, 2.0


def straight(angle: float = 0.0, **more: Any) -> tuple[sp.Scenario, sp.SampledTrajectory]:
    """A straight trip at an even speed from the origin, and its scene."""
    ahead = np.array([math.cos(angle), math.sin(angle)])
    times = np.linspace(0.0, LENGTH / SPEED, 7)
    places = SPEED * times[:, None] * ahead
    scenario = sp.Scenario(
        vehicle=VEHICLE,
        start={"time": 0.0, "position": [0.0, 0.0], "heading": angle, "speed": SPEED},
        goal={"position": places[-1].tolist(), "heading": angle, "speed": SPEED},
        **more,
    )
    return scenario, sp.SampledTrajectory(times, places, np.full(7, angle), np.full(7, SPEED))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("when", np.linspace(2.01, 3.03, 5))
def test_a_bar_that_turns_quickly_is_seen(when: float, side: float) -> None:
    """It lies 6 m beside, and heads along its velocity, which turns by half a turn within some milliseconds."""
    motion = {"time": when, "position": [SPEED * when, 6.1 * side], "velocity": [0.0, -1e-3 * side]}
    bar = {"id": "bar", "shape": {"rectangle": [12.0, 0.1]}, "motion": {**motion, "acceleration": [1.0, 0.0]}}
    scenario, trip = straight(obstacles=[bar])
    assert broken(sp.certify(scenario, trip)) == {"clearance"}


@pytest.mark.parametrize("speed", [20.0, 300.0])
def test_what_moves_straight_is_seen_between_looks(speed: float) -> None:
    """Its motion has two coefficients, and no third one."""
    scenario, trip = straight()
    for when in np.linspace(0.3, 5.7, 20):
        centre = np.array([[SPEED * when, -speed * when], [0.0, speed]])
        zone = ThreatZone("quick", 0.2, PiecewisePolynomials.single(0.0, centre))
        assert broken(sp.certify(scenario, trip, [zone])) == {"clearance"}


@pytest.mark.parametrize("angle", [0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_no_cell_is_missed_wherever_the_map_begins(angle: float, side: float) -> None:
    edge, radius = 0.25, float(VEHICLE["radius"])
    middle = 6.0 * np.array([math.cos(angle), math.sin(angle)])
    for shift in range(0, 24, 2):
        for gap in (radius - 0.01, radius + 0.01):
            centre = middle + side * (gap + 0.5 * edge) * np.array([-math.sin(angle), math.cos(angle)])
            cells = np.zeros((130, 130), dtype=bool)
            cells[64 + shift, 40 + shift] = True
            origin = centre - edge * np.array([40.5 + shift, 64.5 + shift])
            ground = sp.Ground(map=sp.OccupancyMap(cells, resolution=edge, origin=tuple(origin), beyond=False))
            scenario, trip = straight(angle, ground=ground)
            assert sp.certify(scenario, trip).holds == (gap > radius)
