"""Good trips in which one promise is broken: the dense check names exactly that."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.special import fresnel

from scp_planner.arrays import Array
from verification.dense_check import check_trip

BRAKES, GAINS, TOP, RADIUS = 2.0, 1.5, 3.0, 4.0
BACKWARDS = 1.5
TURN = math.pi / 2.0
RATE = 1.0
VEHICLE = {
    "radius": 0.3,
    "max_speed": TOP,
    "max_acceleration": GAINS,
    "max_deceleration": BRAKES,
    "max_curvature": 1.0 / RADIUS,
    "max_turn_rate": RATE,
    "steering": "on_the_spot",
    "reverse": {"max_speed": BACKWARDS, "max_acceleration": 1.0},
}


@dataclass(frozen=True)
class Ramp:
    """Full acceleration, a top speed, full braking: distances at times since it began."""

    length: float
    top: float
    gains: float
    brakes: float = BRAKES

    @property
    def duration(self) -> float:
        return self.length / self.top + 0.5 * self.top * (1.0 / self.gains + 1.0 / self.brakes)

    def __call__(self, t: Array) -> Array:
        t = np.clip(t, 0.0, self.duration)
        rise, fall = self.top / self.gains, self.top / self.brakes
        left = self.duration - t
        return np.where(
            t < rise,
            0.5 * self.gains * t**2,
            np.where(left < fall, self.length - 0.5 * self.brakes * left**2, self.top * (t - 0.5 * rise)),
        )


@dataclass(frozen=True)
class Trip:
    """Forwards by 12 m along x, a turn on the spot to the left, and backwards by 5 m: down along y."""

    ahead: Ramp = Ramp(12.0, TOP, GAINS)
    back: Ramp = Ramp(5.0, BACKWARDS, 1.0)
    rest: float = TURN / RATE
    origin: tuple[float, float] = (0.0, 0.0)
    heading_off: float = 0.0
    begin: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    shifted: float = 0.5
    """Share of the rest, after which it is so much off."""

    @property
    def end(self) -> float:
        return self.begin + self.ahead.duration + self.rest + self.back.duration

    def position(self, t: Array) -> Array:
        since = np.asarray(t) - self.begin
        x = self.ahead(since)
        y = -self.back(since - self.ahead.duration - self.rest)
        jump = (since >= self.ahead.duration + self.shifted * self.rest)[:, None] * np.array(self.shift)
        return np.stack([x, y], axis=1) + np.array(self.origin) + jump

    def heading(self, t: Array) -> Array:
        share = (np.asarray(t) - self.begin - self.ahead.duration) / self.rest
        return self.heading_off + TURN * np.clip(share, 0.0, 1.0)


TRIP = Trip()
MIDDLE = TRIP.ahead.duration
DATA: dict[str, Any] = {
    "vehicle": VEHICLE,
    "start": {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0},
    "goal": {"position": [12.0, -5.0], "heading": TURN, "speed": 0.0},
    "goals": [{"position": [6.0, 0.5], "radius": 0.6}, {"position": [12.0, -2.0], "radius": 0.1}],
    "obstacles": [
        {"id": "late", "shape": {"disc": 0.5}, "motion": {"position": [12.0 + MIDDLE, 4.0], "velocity": [-1.0, 0.0]}}
    ],
    "walls": [[[2.0, 0.4], [3.0, 0.4], [3.0, 1.0], [2.0, 1.0]]],
}
GROUND = shapely.box(12.5, -4.0, 13.0, -1.0)


def change(path: str, value: Any) -> dict[str, Any]:
    data = copy.deepcopy(DATA)
    *keys, last = [int(key) if key.isdigit() else key for key in path.split(".")]
    inner: Any = data
    for key in keys:
        inner = inner[key]
    inner[last] = value
    return data


def broken(data: dict[str, Any] = DATA, trip: Trip = TRIP, **options: Any) -> set[str]:
    report = check_trip(
        data, trip.position, trip.begin, trip.end, heading=trip.heading, samples=5000, **{"ground": GROUND, **options}
    )
    return {finding.name for finding in report.violations}


def test_a_trip_in_legs_that_keeps_all_limits_holds() -> None:
    assert broken() == set()


@pytest.mark.parametrize(
    ("found", "path", "value"),
    [
        ("start_position", "start.position", [0.0, 1e-4]),
        ("start_speed", "start.speed", 0.01),
        ("start_heading", "start.heading", 1e-3),
        ("start_time", "start.time", 1e-3),
        ("goal_position", "goal.position", [12.0, -5.001]),
        ("goal_heading", "goal.heading", -TURN),
        ("goal_speed", "goal.speed", 0.01),
        ("latest_arrival", "goal.latest_arrival", TRIP.end - 0.01),
        ("passage", "goals.0.radius", 0.49),
        ("passage", "goals.1.earliest_arrival", TRIP.end - 0.1),
        ("passage", "goals", DATA["goals"][::-1]),
        ("passage", "goals.1.heading_range", [-0.1, 0.1]),
        ("passage", "goals", [{"position": [3.0, 9.0], "radius": 0.5}]),
        ("speed", "vehicle.max_speed", 2.999),
        ("speed", "vehicle.reverse.max_speed", 1.499),
        ("acceleration", "vehicle.reverse.max_acceleration", 0.99),
        ("deceleration", "vehicle.max_deceleration", 1.99),
        ("reversing", "vehicle.reverse", None),
        ("turn_while_standing", "vehicle.max_turn_rate", 0.99),
        ("clearance", "obstacles.0.motion.position", [12.0 + MIDDLE, 0.7]),
        ("walls", "walls.0", [[2.0, 0.299], [3.0, 0.299], [3.0, 1.0], [2.0, 1.0]]),
        ("bounds", "bounds", {"min": [-1.0, -5.299], "max": [13.0, 1.0]}),
        ("place_speed", "speed_limits", [{"from": 5.0, "to": 6.0, "speed": 2.9, "line": [[0.0, 0.0], [12.0, 0.0]]}]),
    ],
)
def test_a_promise_that_the_trip_breaks_is_found(found: str, path: str, value: Any) -> None:
    assert broken(change(path, value)) == {found}


@pytest.mark.parametrize(
    ("found", "trip"),
    [
        ({"start_position", "goal_position"}, replace(TRIP, origin=(2e-6, 0.0))),
        ({"goal_position", "jump", "heading_along_path"}, replace(TRIP, shift=(1e-4, 0.0))),
        ({"goal_position", "jump"}, replace(TRIP, shift=(-2e-5, -2e-5))),
        ({"heading_along_path", "start_heading", "goal_heading"}, replace(TRIP, heading_off=0.01)),
        ({"turn_while_standing"}, replace(TRIP, rest=0.9 * TRIP.rest)),
        (set(), replace(TRIP, shift=(5e-7, -5e-7))),
        (set(), replace(TRIP, shift=(5e-7, -5e-7), shifted=1.0)),
        ({"goal_position", "deceleration"}, replace(TRIP, shift=(0.0, -2e-5), shifted=1.0)),
        ({"acceleration"}, replace(TRIP, ahead=Ramp(12.0, TOP, 1.01 * GAINS))),
    ],
)
def test_a_trip_that_breaks_a_promise_is_found(found: set[str], trip: Trip) -> None:
    assert broken(trip=trip, data=change("obstacles", [])) == found


def test_occupied_ground_is_found() -> None:
    assert broken(ground=GROUND.buffer(0.21)) == {"ground"}


@pytest.mark.parametrize(
    ("found", "target", "more"),
    [
        (set(), {"position": [12.0, -5.0]}, {"match_velocity": True}),
        ({"target_velocity"}, {"position": [12.0 - TRIP.end, -5.0], "velocity": [1.0, 0.0]}, {"match_velocity": True}),
        ({"target_position"}, {"position": [12.0, -5.0], "velocity": [0.0, 1e-3]}, {}),
        (set(), {"position": [12.0, -5.0 - TRIP.end], "velocity": [0.0, 1.0]}, {"approach": [-0.1, 0.1]}),
        (
            {"target_approach"},
            {"position": [12.0, -5.0 + TRIP.end], "velocity": [0.0, -1.0]},
            {"approach": [-0.1, 0.1]},
        ),
    ],
)
def test_a_target_is_met_at_its_place_with_its_velocity_as_vectors(
    found: set[str], target: dict[str, Any], more: dict[str, Any]
) -> None:
    goal = {"position": [1e8, 0.0], "target": {"motion": target}, "speed": None, "heading": None, **more}
    assert broken({**DATA, "goal": goal}) == found


def braking(brakes: float, until: float) -> Callable[[Array], Array]:
    """Braking from 3 m/s to 1 m/s, and on."""

    def position(t: Array) -> Array:
        first = np.minimum(t, until)
        x = 3.0 * first - 0.5 * brakes * first**2 + (3.0 - brakes * until) * np.maximum(t - until, 0.0)
        return np.stack([x, np.zeros_like(x)], axis=1)

    return position


@pytest.mark.parametrize(
    ("found", "brakes", "until"), [(set(), 2.0, 1.0), ({"speed"}, 1.9, 2.0 / 1.9), ({"speed"}, 2.0, 0.99)]
)
def test_a_limit_that_was_lowered_holds_as_soon_as_the_vehicle_can_keep_it(
    found: set[str], brakes: float, until: float
) -> None:
    position = braking(brakes, until)
    data = {
        "vehicle": {**VEHICLE, "max_speed": 1.0},
        "start": {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 3.0},
        "goal": {"position": position(np.array([4.0]))[0].tolist()},
    }
    report = check_trip(data, position, 0.0, 4.0, lowered=True)
    assert {each.name for each in report.violations} == found
    assert "speed" in {each.name for each in check_trip(data, position, 0.0, 4.0).violations}


@dataclass(frozen=True)
class Bent:
    """Along a clothoid to a standstill and back again, backwards, with smooth accelerations."""

    length: float = 4.0
    lasts: float = 4.0
    sharpens: float = 0.1
    """1/m2, by which the curvature grows along the way."""

    def way(self, t: Array) -> Array:
        share = 1.0 - np.abs(np.clip(np.asarray(t) / self.lasts, 0.0, 2.0) - 1.0)
        return self.length * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)

    def position(self, t: Array) -> Array:
        unit = math.sqrt(math.pi / self.sharpens)
        y, x = fresnel(self.way(t) / unit)
        return unit * np.stack([x, y], axis=1)

    def heading(self, t: Array) -> Array:
        return 0.5 * self.sharpens * self.way(t) ** 2

    def peaks(self) -> dict[str, float]:
        """Largest values of what is limited, by the derivatives of the polynomial."""
        share, (length, lasts) = np.linspace(0.0, 1.0, 100_001), (self.length, self.lasts)
        way = length * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        speed = length / lasts * 30.0 * (share * (1.0 - share)) ** 2
        gains = length / lasts**2 * 60.0 * share * (1.0 - share) * (1.0 - 2.0 * share)
        lateral = self.sharpens * way * speed**2
        return {
            "curvature": self.sharpens * length,
            "curvature_rate": self.sharpens * float(speed.max()),
            "lateral_acceleration": float(lateral.max()),
            "total_acceleration": float(np.hypot(gains, lateral).max()),
            "jerk": 60.0 * length / lasts**3,
        }


BENT = Bent()


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize(("name", "peak"), BENT.peaks().items())
def test_limits_of_bends_and_forces_are_judged_in_each_gear(name: str, peak: float, backwards: bool) -> None:
    begin = BENT.lasts * backwards
    first, last = BENT.position(np.array([begin, begin + BENT.lasts])).tolist()
    vehicle = {"radius": 0.3, "max_speed": 2.0, "max_acceleration": 1.5, "max_deceleration": 1.5}
    start = {"time": begin, "position": first, "heading": float(BENT.heading(np.array(begin))), "speed": 0.0}
    for share, found in ((1.02, set()), (0.85, {name})):
        limited = {**vehicle, "reverse": {"max_speed": 2.0}, f"max_{name}": share * peak}
        data = {"vehicle": limited, "start": start, "goal": {"position": last, "speed": 0.0}}
        report = check_trip(data, BENT.position, begin, begin + BENT.lasts, heading=BENT.heading, samples=8000)
        assert {each.name for each in report.violations} == found


@pytest.mark.parametrize(
    ("place", "offset", "found"),
    [([12.0, -5.0], [0.0, 0.0], set()), ([6.0, -0.7], [6.0, -4.3], {"clearance"})],
)
def test_a_target_is_kept_clear_of_where_the_offset_leads_past_it(
    place: list[float], offset: list[float], found: set[str]
) -> None:
    met = {"id": "met", "shape": {"disc": 0.5}, "motion": {"position": place}}
    goal = {"target": "met", "offset": offset, "radius": 0.2}
    assert broken({**DATA, "goal": goal, "obstacles": [met]}) == found
    assert broken({**DATA, "goal": goal, "obstacles": [met, {**met, "id": "no target"}]}) == {"clearance"}


def test_a_map_of_free_ground_is_no_finding() -> None:
    assert broken(ground=shapely.union_all([])) == set()


def winding(bend: float, sharpens: float, speed: float, gains: float, jerk: float) -> Callable[[Array], Array]:
    """A path whose curvature begins with a bend, 1/m, and sharpens, 1/m2; the speed grows, and its growth, too."""

    def position(t: Array) -> Array:
        times = np.append(np.linspace(0.0, 1.01, 40_401), 2.0)
        way = speed * times + 0.5 * gains * times**2 + jerk * times**3 / 6.0
        heading = bend * way + 0.5 * sharpens * way**2
        steps = np.diff(way)[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)[:-1]
        turned = 0.5 * np.diff(heading)
        rotated = np.stack(
            [
                steps[:, 0] * np.cos(turned) - steps[:, 1] * np.sin(turned),
                steps[:, 0] * np.sin(turned) + steps[:, 1] * np.cos(turned),
            ],
            axis=1,
        )
        places = np.concatenate([np.zeros((1, 2)), rotated.cumsum(axis=0)])
        return np.stack([np.interp(t, times, places[:, k]) for k in (0, 1)], axis=1)

    return position


LOOSE = {"radius": 0.1, "max_speed": 9.0, "max_acceleration": 9.0, "max_deceleration": 9.0}


@pytest.mark.parametrize("found", ["curvature", "lateral_acceleration", "total_acceleration"])
def test_an_excess_of_a_start_may_fall_and_not_rise(found: str) -> None:
    for bend, sharpens, names in ((1.0, -0.3, set()), (0.6, 0.3, {found})):
        position = winding(bend, sharpens, 1.0, 0.0, 0.0)
        start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0}
        vehicle = {**LOOSE, f"max_{found}": 0.5}
        data = {"vehicle": vehicle, "start": start, "goal": {"position": position(np.ones(1))[0].tolist()}}
        report = check_trip(data, position, 0.0, 1.0, lowered=True, samples=4000)
        assert {each.name for each in report.violations} == names


@pytest.mark.parametrize(
    ("found", "limits", "values"),
    [
        ("jerk", {"max_jerk": 0.9}, (0.0, 0.0, 1.0, 0.0, 1.0)),
        ("curvature_rate", {"max_curvature_rate": 0.9}, (0.0, 0.5, 2.0, 0.0, 0.0)),
        ("curvature_rate", {"max_curvature_rate": 0.9}, (0.5, -0.5, 2.0, -0.5, 0.0)),
    ],
)
def test_jerk_and_the_rate_of_the_curvature_have_no_excess_that_may_fall(
    found: str, limits: dict[str, float], values: tuple[float, ...]
) -> None:
    """They may jump: a start has neither."""
    position = winding(*values)
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": values[2]}
    for share, names in ((1.0, {found}), (1.2, set())):
        vehicle = {**LOOSE, **{name: share * limit for name, limit in limits.items()}}
        data = {"vehicle": vehicle, "start": start, "goal": {"position": position(np.ones(1))[0].tolist()}}
        report = check_trip(data, position, 0.0, 1.0, lowered=True, samples=4000)
        assert {each.name for each in report.violations} == names


def test_a_power_above_a_lowered_limit_may_fall_and_not_rise() -> None:
    for jerk, names in ((-0.9, set()), (0.5, {"power"})):
        position = winding(0.0, 0.0, 1.0, 0.9, jerk)
        start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0}
        data = {
            "vehicle": {**LOOSE, "max_power": 0.8},
            "start": start,
            "goal": {"position": [position(np.ones(1))[0, 0], 0.0]},
        }
        report = check_trip(data, position, 0.0, 1.0, lowered=True, samples=4000)
        assert {each.name for each in report.violations} == names
