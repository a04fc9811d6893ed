"""Each check of the certificate, on each kind of plan: it holds, and a plan that is broken in one way does not."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from math import cos, pi, sin
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import scp_planner as sp
from scp_planner.certificate.verdict import UNITS
from scp_planner.trips.guide import CurvedGuide
from scp_planner.trips.legs import Leg, Legs, Stand
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory

TABLE = Path(__file__).parents[2] / "docs" / "explanation" / "certificate.md"
CAR = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0, "max_curvature": 1.0}
START: dict[str, Any] = {"time": 2.0, "position": [1.0, -2.0], "heading": 0.2, "speed": 0.0}
KINDS = ("one leg", "legs", "leg backwards", "samples", "foreign file", "online stop")
Data = dict[str, Any]


@dataclass(frozen=True)
class Drive:
    """A plan, the scenario that it keeps to, and what is seen of it."""

    plan: Any
    data: Data
    middle: tuple[float, float]
    top: float


def plain(goal: Data) -> Data:
    return {"vehicle": {**CAR}, "start": {**START}, "goal": goal}


@cache
def driven(kind: str) -> Drive:
    data = plain({"position": [10.0, 3.0], "speed": 0.0})
    plan = sp.plan(sp.Scenario(**data))
    trip: Any = plan.trip
    made: Any = plan
    if kind == "legs":
        late = replace(trip, frame=replace(trip.frame, time=trip.frame.time + 1.0))
        leg = Leg(late)
        legs = Legs((leg,), Stand(2.0, leg.state(leg.begin)[1]), Stand(leg.end + 0.5, leg.state(leg.end)[1]))
        made, trip = SimpleNamespace(trip=late, legs=legs), late
    if kind == "leg backwards":
        back = Leg(trip, backward=True)
        made = SimpleNamespace(
            trip=trip, legs=Legs((back,), *(Stand(time, back.state(time)[1]) for time in (back.begin, back.end)))
        )
        data["start"]["heading"] += pi
        data["vehicle"]["reverse"] = {"max_speed": 3.0}
    if kind == "foreign file":
        made = sp.Plan.from_dict({key: value for key, value in plan.to_dict().items() if key != "samples"}, "file")
    if kind == "samples":
        times = np.linspace(plan.start_time, plan.arrival_time, 4001)
        made = sp.SampledTrajectory(times, plan.position(times), plan.heading(times), plan.speed(times))
        data["vehicle"] |= {"max_acceleration": 1.8, "max_deceleration": 2.4, "max_curvature": 100.0, "max_speed": 3.01}
    if kind == "online stop":
        data["start"]["speed"] = 2.0
        taken = {"id": "taken", "shape": {"disc": 1.0}, "motion": {"position": [10.0, 3.0]}}
        planner = sp.Planner(sp.Scenario(**data, obstacles=[taken]))
        trip = planner.replan(2.0, START["position"], START["heading"], 2.0).trip
        made = SimpleNamespace(trip=trip)
    times = trip.frame.time + np.linspace(0.0, trip.trajectory.travel_time, 2001)
    points, _ = trip.at(times)
    places = trip.frame.to_world(points.path.position)
    data["goal"] = {"position": places[-1].tolist(), "speed": 0.0}
    return Drive(made, data, tuple(places[1000].tolist()), float(points.speed.max()))


def set_in(part: str, **values: Any) -> Callable[[Drive, Data], None]:
    def fault(drive: Drive, data: Data) -> None:
        data[part] |= {key: value(drive, data[part]) if callable(value) else value for key, value in values.items()}

    return fault


def gear(drive: Drive, data: Data) -> None:
    limit = {"max_speed": 0.9 * drive.top}
    data["vehicle"] |= {"reverse": limit} if "reverse" in data["vehicle"] else limit


def beside(drive: Drive, part: Data) -> list[float]:
    return [part["position"][0] + 1e-3, part["position"][1]]


def arrival(drive: Drive) -> float:
    plan = drive.plan
    if isinstance(plan, sp.SampledTrajectory):
        return float(plan.time[-1])
    legs = getattr(plan, "legs", None) or Legs.of(plan.trip)
    return float(legs.last.time)


def region(drive: Drive, data: Data) -> None:
    x, y = data["goal"]["position"]
    corners = [[x + a, y + b] for a, b in ((1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0))]
    data["goal"] |= {"position": [x + 1.5, y + 0.5], "region": corners}


def obstacle(drive: Drive, data: Data) -> None:
    data["obstacles"] = [{"id": "post", "shape": {"disc": 0.1}, "motion": {"position": list(drive.middle)}}]


def place(drive: Drive, data: Data) -> None:
    data["goals"] = [{"position": [drive.middle[0], drive.middle[1] + 4.0], "radius": 0.5}]


def box(drive: Drive, data: Data) -> None:
    (x, _), radius = drive.middle, CAR["radius"]
    data["bounds"] = {"min": [-90.0, -90.0], "max": [x + 0.5 * radius, 90.0]}


def slow_zone(drive: Drive, data: Data) -> None:
    data["speed_limits"] = [{"from": 1.5, "to": 90.0, "speed": 0.5 * drive.top, "line": [[0.0, -3.0], [99.0, 20.0]]}]


def watched(drive: Drive, data: Data) -> None:
    times = np.linspace(1.0, 2.0, 11)
    seen = {"time": times, "position": np.stack([60.0 + times, 0.0 * times], axis=1), "covariance": np.eye(2) * 1e-4}
    data["obstacles"] = [{"id": "seen", "shape": {"disc": 0.1}, "observations": seen}]
    data["vehicle"] |= {"max_speed": 1e8, "max_acceleration": 1e8, "max_deceleration": 1e8}


FAULTS: dict[str, Callable[[Drive, Data], None]] = {
    "start time": set_in("start", time=1.999),
    "distance from the start": set_in("start", position=beside),
    "start speed": set_in("start", speed=lambda _, part: part["speed"] + 1e-3),
    "start acceleration error": set_in("start", acceleration=1.4),
    "start heading": set_in("start", heading=0.201),
    "distance from goals": place,
    "earliest arrival": set_in("goal", earliest_arrival=lambda drive, _: arrival(drive) + 1e-3),
    "latest arrival": set_in("goal", latest_arrival=lambda drive, _: arrival(drive) - 1e-3),
    "arrival off the step": set_in("goal", arrival_step=lambda drive, _: (arrival(drive) - 2.0) / 1.5),
    "distance from the goal": set_in("goal", position=beside),
    "distance from the goal region": region,
    "goal heading": set_in("goal", heading=3.0),
    "goal speed error": set_in("goal", speed=0.01),
    "goal speed": set_in("goal", speed=None, speed_range=[0.01, 1.0]),
    "clearance": obstacle,
    "workspace bounds": box,
    "speed": gear,
    "speed_limits": slow_zone,
    "acceleration": set_in("vehicle", max_acceleration=0.01, max_deceleration=0.01),
    "curvature": set_in("vehicle", max_curvature=1e-3),
    "lateral_acceleration": set_in("vehicle", max_lateral_acceleration=1e-3),
    "curvature_rate": set_in("vehicle", max_curvature_rate=1e-4),
    "total_acceleration": set_in("vehicle", max_total_acceleration=0.01),
    "power": set_in("vehicle", max_power=1e-6),
    "jerk": set_in("vehicle", max_jerk=1e-6),
    "arrival beyond what is known of observed obstacles": watched,
}
UNASKED = {  # who brakes needs no power, and places on the way are not taken beside a reverse gear
    ("power", "online stop"),
    ("distance from goals", "leg backwards"),
}


def changed_trip(drive: Drive, change: Callable[[Any], Any]) -> Any:
    """The drive, of which the trajectory of the only leg is another."""
    plan = drive.plan
    trip = plan.trip
    other = replace(trip, trajectory=change(trip.trajectory))
    legs = getattr(plan, "legs", None)
    if legs is None:
        return SimpleNamespace(trip=other)
    return SimpleNamespace(trip=other, legs=replace(legs, legs=(Leg(other, legs.legs[0].backward),)))


def cusp(one: Trajectory) -> Trajectory:
    bend = CurvedGuide(20.0, np.linspace(0.0, 4.0, 21))  # a radius of 5 m, round which a path at 5 m turns on the spot
    space = TripSpace(bend, 1.0, 3, 4, 0, tuple(np.linspace(0.0, 1.0, 5)))
    theta = np.zeros(space.path_size)
    theta[2:5] = 5.0
    return Trajectory.of(space, theta, np.zeros(space.acceleration_size))


TRIP_FAULTS: dict[str, Callable[[Any], Any]] = {
    "travel time": lambda one: type(one)(one.path, np.full_like(one.beta, np.nan), one.travel_time),
    "error of the positions": cusp,
    "distance beyond the path": lambda one: type(one)(one.path, one.beta, 2.5 * one.travel_time),
}


def turned_first(legs: Legs) -> Legs:
    return replace(legs, first=Stand(legs.first.time, legs.first.heading + 0.1))


def second_leg(legs: Legs, *, aside: float = 0.0, early: float = 0.0, cut: bool = False) -> Legs:
    """Legs of which the second one repeats the first from where that ends."""
    (leg,) = legs.legs
    place, heading, _ = leg.state(leg.end)
    frame = replace(leg.trip.frame, origin=(place[0] + aside, place[1]), time=leg.end - early)
    frame = replace(frame, heading=heading + leg.trip.frame.heading - leg.state(leg.begin)[1])
    other = Leg(replace(leg.trip, frame=frame))
    return Legs((leg, other), legs.first, Stand(other.end, other.state(other.end)[1]))


SEAM_FAULTS: dict[str, Callable[[Legs], Legs]] = {
    "gap between legs": lambda legs: second_leg(legs, aside=1e-3),
    "overlap of legs": lambda legs: second_leg(legs, early=1e-2),
    "turn while standing": turned_first,
}


def found(drive: Drive, data: Data, plan: Any = None) -> set[str]:
    base = sp.Scenario(**drive.data)
    loose = {**data, "start": {**data["start"]}}
    parts = sp.Scenario.model_validate(loose) if data.get("bounds") is None else base
    if data.get("bounds") is not None:
        from scp_planner.scenario.models import Bounds

        parts = base.model_copy(update={"bounds": Bounds(**data["bounds"])})
    certificate = sp.certify(parts, drive.plan if plan is None else plan)
    assert certificate.holds == (not certificate.violations)
    return {one.what.partition("[")[0] for one in certificate.violations}


def copied(data: Data) -> Data:
    return {key: dict(value) for key, value in data.items()}


@pytest.mark.parametrize("kind", KINDS)
def test_a_plan_of_each_kind_holds(kind: str) -> None:
    drive = driven(kind)
    assert found(drive, drive.data) == set()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("what", FAULTS)
def test_each_check_is_applied_to_each_kind(kind: str, what: str) -> None:
    if (what, kind) in UNASKED:
        return
    drive = driven(kind)
    data = copied(drive.data)
    FAULTS[what](drive, data)
    assert what in found(drive, data)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "samples"])
@pytest.mark.parametrize("what", TRIP_FAULTS)
def test_each_check_of_splines_is_applied_to_each_kind_that_has_them(kind: str, what: str) -> None:
    drive = driven(kind)
    assert what in found(drive, drive.data, changed_trip(drive, TRIP_FAULTS[what]))


@pytest.mark.parametrize("what", SEAM_FAULTS)
def test_each_check_of_seams_is_applied_to_legs(what: str) -> None:
    drive = driven("legs")
    legs = SEAM_FAULTS[what](drive.plan.legs)
    assert what in found(drive, drive.data, SimpleNamespace(trip=drive.plan.trip, legs=legs))


def test_a_leg_that_ends_at_speed_is_not_followed_by_another() -> None:
    stop = driven("online stop")
    trip = stop.plan.trip
    legs = Legs.of(trip)
    waits = replace(legs, first=Stand(legs.first.time - 1.0, legs.first.heading))
    data = copied(stop.data)
    data["start"]["time"] -= 1.0
    assert {"speed at rest", "start speed"} <= found(stop, data, SimpleNamespace(trip=trip, legs=waits))


def test_the_table_of_the_docs_names_exactly_the_checks() -> None:
    checks, _, _ = TABLE.read_text().partition("## Starts beyond a limit")
    rows = re.findall(r"^\| `([^`]+)` \|", checks, re.MULTILINE)
    assert sorted(rows) == sorted(UNITS)
    tested = {*FAULTS, *TRIP_FAULTS, *SEAM_FAULTS, "speed at rest"}
    assert tested == set(UNITS)


FAR = [("one leg", 1e2), ("one leg", 1e5), *((kind, 1e8) for kind in KINDS)]


@pytest.mark.parametrize(("kind", "far"), FAR)
@pytest.mark.parametrize("field", ["hint", "guide", "obstacle", "wall", "bounds", "limits", "heading hint"])
@pytest.mark.parametrize("miss", [0.0, 1e-4, 1.0])
def test_a_field_that_does_not_matter_changes_no_verdict(field: str, kind: str, far: float, miss: float) -> None:
    drive = driven(kind)
    data = copied(drive.data)
    x, y = data["goal"]["position"]
    data["goal"] = {"position": [x, y + miss], "speed": 0.0}
    if field in ("hint", "heading hint"):
        turn = 0.5 * pi if field == "hint" else pi
        still = {"motion": {"position": [x, y + miss], "velocity": [0.0, 0.0]}}
        data["goal"] = {"target": still, "position": [far * cos(turn), far * sin(turn)], "speed": 0.0}
    if field == "guide":
        data["guide"] = [START["position"], [far, 0.0], [x, y + miss]]
    if field == "obstacle":
        data["obstacles"] = [{"id": "far", "shape": {"disc": 0.1}, "motion": {"position": [far, far]}}]
    if field == "wall":
        data["walls"] = [[[far, far], [far + 1.0, far], [far, far + 1.0]]]
    if field == "bounds":
        data["bounds"] = {"min": [-far, -far], "max": [far, far]}
    if field == "limits":
        data["vehicle"] |= {"max_speed": 10.0 * far, "max_acceleration": far, "max_deceleration": far}
    certificate = sp.certify(sp.Scenario(**data), drive.plan)
    assert certificate.holds == (miss == 0.0)
    start = copied(drive.data) | {key: value for key, value in data.items() if key not in ("goal", "guide", "start")}
    start["start"]["position"] = [START["position"][0], START["position"][1] + miss]
    assert sp.certify(sp.Scenario(**start), drive.plan).holds == (miss == 0.0)


@pytest.mark.parametrize("away", [0.0, 1e-9])
def test_a_goal_where_the_vehicle_stands_is_checked(away: float) -> None:
    scenario = sp.Scenario(**plain({"position": [10.0, 3.0]}))
    near = scenario.goal.model_copy(update={"position": (START["position"][0] + away, START["position"][1])})
    here = scenario.model_copy(update={"goal": near})
    certificate = sp.certify(here, driven("one leg").plan)
    assert {one.what for one in certificate.violations} == {"distance from the goal"}
