"""Guides on CommonRoad's maps: a car that is steered along a line, and where it comes into a goal."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("shapely", reason="comes with commonroad-io, which is not installed")

from shapely import LineString, Point, box

from scp_planner.formats.commonroad.lines import SteeredCar, arrival, driven, led_through, turned_too_far

CAR = SteeredCar(length=4.5, ahead=1.4, bend=0.2, sight=5.4)
STRAIGHT = np.array([[0.0, 0.0], [100.0, 0.0]])


def test_a_car_follows_a_bend_from_its_own_heading() -> None:
    radius, turn = 25.0, np.linspace(0.0, math.pi, 200)
    bend = radius * np.stack([np.sin(turn), 1.0 - np.cos(turn)], axis=1)
    drive = driven(bend, (0.0, 0.0), 0.3, CAR)
    assert drive.headings[0] == 0.3
    # It is where its headings lead, and turns no tighter than it can.
    steps = np.diff(drive.stations)
    middle = 0.5 * (drive.headings[1:] + drive.headings[:-1])
    assert np.diff(drive.places[:, 0]) == pytest.approx(steps * np.cos(middle))
    assert np.abs(np.diff(drive.headings) / steps).max() <= CAR.bend * (1.0 + 1e-9)
    ahead = drive.middles - drive.places
    assert np.arctan2(ahead[:, 1], ahead[:, 0]) == pytest.approx(np.angle(np.exp(1j * drive.headings)))
    # Settled, it is beside the line by no more than the arc over its sight is high.
    away = np.abs(np.hypot(drive.places[:, 0], drive.places[:, 1] - radius) - radius)
    assert away[drive.stations > 4.0 * CAR.sight].max() < CAR.sight**2 / (8.0 * radius)
    assert drive.headings[-1] == pytest.approx(math.pi, abs=0.1)


def test_a_line_behind_the_car_is_turned_to() -> None:
    drive = driven(np.array([[0.0, 0.0], [-60.0, 0.0]]), (0.0, 0.0), 0.1, CAR)
    assert math.cos(drive.headings[-1]) == pytest.approx(-1.0, abs=1e-3)
    assert abs(drive.places[-1, 1]) < 0.1
    assert np.abs(np.diff(drive.headings) / np.diff(drive.stations)).max() <= CAR.bend * (1.0 + 1e-9)


def test_a_line_is_led_through_a_goal_beside_it() -> None:
    place = box(70.0, 2.0, 75.0, 4.0)
    line = led_through(STRAIGHT, [place], 30.0)
    assert LineString(line).intersection(place).length > 4.0
    assert np.all(line[line[:, 0] < 39.0, 1] == 0.0)
    assert np.abs(np.diff(line[:, 1]) / np.diff(line[:, 0])).max() < 0.2
    assert led_through(STRAIGHT, [box(70.0, -1.0, 75.0, 1.0)], 30.0) is STRAIGHT


def test_a_goal_is_entered_with_a_heading_that_it_allows() -> None:
    turn = np.linspace(0.0, 0.5 * math.pi, 100)
    bend = 30.0 * np.stack([np.sin(turn), 1.0 - np.cos(turn)], axis=1)
    drive = driven(bend, (0.0, 0.0), 0.0, CAR)
    place = box(10.0, -5.0, 35.0, 35.0)

    def entered(headings: tuple[float, float] | None, soonest: float = 0.0, depth: float = 0.0) -> int:
        return arrival(drive, [place], turned_too_far(drive.headings, headings, 1.0), soonest, depth).index

    first = entered(None)
    assert place.contains(Point(drive.middles[first]))
    assert not place.buffer(-1.0).contains(Point(drive.middles[first]))
    turned = entered((0.8 + 2.0 * math.pi, 1.0 + 2.0 * math.pi))
    assert 0.8 <= drive.headings[turned] <= 0.85
    assert drive.headings[entered((0.8, 1.0), depth=1.0)] > 0.95
    assert drive.stations[entered(None, soonest=20.0)] == pytest.approx(20.0, abs=0.5)
    # Where no heading is allowed that is driven, the nearest one counts; where nothing is inside, the nearest place.
    assert drive.headings[entered((2.5, 3.0))] == pytest.approx(drive.headings[entered(None, depth=1.0)], abs=0.05)
    far = arrival(drive, [box(40.0, 10.0, 50.0, 20.0)], np.zeros(len(drive.stations)), 0.0, 0.0).index
    away = np.hypot(np.maximum(40.0 - drive.middles[:, 0], 0.0), np.maximum(10.0 - drive.middles[:, 1], 0.0))
    assert far == int(np.argmin(np.hypot(away, np.maximum(drive.middles[:, 1] - 20.0, 0.0))))


def test_headings_beyond_a_range() -> None:
    headings = np.array([0.0, 0.4, 0.6, 0.7, 2.0 * math.pi + 0.6, -2.0])
    assert turned_too_far(headings, None, 1.0).tolist() == [0.0] * 6
    assert turned_too_far(headings, (0.2, 0.6), 0.5) == pytest.approx([0.3, 0.0, 0.1, 0.2, 0.1, 2.3])
    assert turned_too_far(headings, (0.2, 0.6), math.inf).tolist() == [0.0] * 6
