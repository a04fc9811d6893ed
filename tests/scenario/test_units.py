"""Natural units: a scene in other units, elsewhere, later or turned is planned alike, to the bit where it can be."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

import numpy as np
import pytest
from scenes import CROSSERS, disc, rewritten, scene

import scp_planner as sp
from scp_planner.certificate.verdict import UNITS
from scp_planner.scenario.scale import TOP_SPEED, TRIP_LENGTH
from scp_planner.scenario.units import NaturalUnits
from scp_planner.scenario.validation import Part

POWERS = (2.0**-20, 2.0**-7, 2.0**3, 2.0**20)
FACTORS = ((0.01, 0.1), (0.075, 0.45), (600.0, 200.0), (1.0, 7.3))


def seen(name: str = "seen", noise: float = 0.05) -> dict[str, Any]:
    """An obstacle that has been observed for two seconds."""
    rng = np.random.default_rng(7)
    times = np.linspace(-2.0, 0.0, 21)
    positions = np.array([9.0, 3.0]) + times[:, None] * [0.2, -0.9] + noise * rng.normal(size=(21, 2))
    return {
        "id": name,
        "shape": {"disc": 0.4},
        "observations": {
            "time": times.tolist(),
            "position": positions.tolist(),
            "covariance": [[noise**2, 0.0], [0.0, noise**2]],
        },
        "model": {"order": 1},
        "margin": 0.05,
    }


def everything() -> sp.Scenario:
    """A scene with a quantity of every kind that :func:`rewritten` knows."""
    return scene(
        *CROSSERS,
        seen(),
        vehicle={"max_jerk": 9.0, "max_curvature_rate": 2.0, "discs": [0.0, 0.4]},
        start={"time": 3.0, "acceleration": 0.5},
        goal={"radius": 0.5, "speed": 1.0, "earliest_arrival": 9.0, "latest_arrival": 40.0, "heading": 0.1},
    )


def test_a_trip_is_twenty_long_at_a_top_speed_of_three() -> None:
    inside = (units := NaturalUnits.of(far := rewritten(scene(), 37.0, 5.0, shift=(3.0, -4.0)))).scenario(far)
    assert math.dist(inside.start.position, inside.goal.position) == pytest.approx(TRIP_LENGTH)
    assert inside.vehicle.max_speed == pytest.approx(TOP_SPEED)
    assert (units.length, units.time) == pytest.approx((37.0, 5.0))
    assert (inside.start.position, inside.start.time) == ((0.0, 0.0), 0.0)


def test_a_vehicle_that_never_gets_fast_has_slower_units() -> None:
    slow = NaturalUnits.of(scene(vehicle={"max_speed": 1e3}, start={"speed": 2.0}))
    assert slow.time == pytest.approx(TOP_SPEED / math.sqrt(2.0**2 + 2.0 * 1.5 * 20.0))


def test_a_guide_tells_how_far_the_trip_leads_away() -> None:
    assert NaturalUnits.of(scene(guide=[[0, 0], [30, 40], [20, 0]])).length == pytest.approx(50.0 / TRIP_LENGTH)
    assert NaturalUnits.of(scene(guide=[[0, 0], [3, 4], [20, 0]])).length == pytest.approx(20.0 / TRIP_LENGTH)


@pytest.mark.parametrize("turned", [0.0, 1.0, 2.5])
def test_the_trip_of_a_vehicle_that_has_to_turn_about_is_as_long_as_its_loop(turned: float) -> None:
    """A goal that is behind by less than the radius of the tightest turn is reached by about a full circle."""

    def length(heading: float | None) -> float:
        start = {"time": 0.0, "position": (3.0, 1.0), "heading": heading, "speed": 0.0}
        goal = {"position": (3.0 - 0.02 * math.cos(turned), 1.0 - 0.02 * math.sin(turned))}
        vehicle = {"radius": 0.3, "max_speed": 0.8, "max_acceleration": 0.8, "max_deceleration": 0.8}
        vehicle["max_curvature"] = 2.0
        scene = sp.Scenario(start=start, goal=goal, vehicle=vehicle, obstacles=[])
        return TRIP_LENGTH * NaturalUnits.of(scene).length

    assert length(turned) == pytest.approx(2.0 * math.pi * 0.5, rel=0.02)
    assert length(None) == pytest.approx(0.02)


def test_the_scene_of_reference_has_the_units_of_the_user() -> None:
    assert NaturalUnits.of(scene()) == NaturalUnits()
    assert NaturalUnits().scenario(reference := scene(*CROSSERS)) is reference


@pytest.mark.parametrize("length", POWERS)
@pytest.mark.parametrize("time", POWERS)
def test_powers_of_two_do_not_change_a_bit_of_the_scene(length: float, time: float) -> None:
    other = rewritten(everything(), length, time)
    units = NaturalUnits.of(everything())
    assert NaturalUnits.of(other) == NaturalUnits(
        units.length * length, units.time * time, units.origin, units.clock * time
    )
    assert NaturalUnits.of(other).scenario(other) == units.scenario(everything())


def kinds_of_parts(kind: type[Part] = Part) -> Iterator[type[Part]]:
    for each in kind.__subclasses__():
        if each.__module__.startswith("scp_planner.scenario"):  # others, of run files, are never scaled
            yield each
        yield from kinds_of_parts(each)


def of_numbers(annotation: Any) -> Any:
    """A value of a type that is a number or rows of numbers; None of another type."""
    if annotation is float:
        return 3.0
    rows = get_origin(annotation) is tuple
    found = [value for each in get_args(annotation) if (value := of_numbers(each)) is not None]
    return ((tuple(found) * 2)[:2] if rows else found[0]) if found else None


NUMBERS = {
    f"{kind.__name__}.{name}": (kind, name, value, field.description or "")
    for kind in kinds_of_parts()
    for name, field in kind.model_fields.items()
    if (value := of_numbers(field.annotation)) is not None
}
UNIT = re.compile(r"(?:^|, |\], |so many )(m2/s[35]|m/s[23]|m/s|1/\(m s\)|1/m|m2|rad/s|rad|m|s)(?=$|[,;:. )])")
PLACES = {"position", "min", "max", "guide", "region", "line", "corridor", "walls", "lanes"}


@pytest.mark.parametrize("field", NUMBERS)
def test_every_number_is_divided_by_the_unit_that_its_description_names(field: str) -> None:
    kind, name, value, description = NUMBERS[field]
    units = NaturalUnits(length=2.0, time=5.0, origin=(1.0, -1.0), clock=10.0)
    values = {each: NUMBERS.get(f"{kind.__name__}.{each}", (None,) * 3)[2] for each in kind.model_fields}
    found, given = np.array(getattr(units.part(kind.model_construct(**values)), name)), np.array(value)
    if name in PLACES:
        assert np.array_equal(found, (given - units.origin) / units.length)
    elif name == "time" or "on the clock" in description:
        assert np.array_equal(found, (given - units.clock) / units.time)
    elif field == "Estimate.covariance":
        assert found == pytest.approx(given / units.length**2)
    else:
        unit = UNIT.search(description)
        factors = {"m2": units.length**2, "rad/s": 1.0 / units.time}
        factor = factors.get(unit[1]) or units.factor(unit[1]) if unit else 1.0
        assert found == pytest.approx(given / factor)


def test_an_estimates_covariance_is_divided_by_the_units_of_its_rows_and_columns() -> None:
    units = NaturalUnits(length=2.0, time=4.0)
    state = {"time": 0.0, "position": [0.0, 0.0], "velocity": [0.0, 0.0], "acceleration": [0.0, 0.0]}
    sizes = np.repeat([2.0, 0.5, 0.125], 2)
    found = units.part(sp.Estimate(**state, covariance=np.eye(6) + 0.5)).covariance
    assert np.array_equal(found, (np.eye(6) + 0.5) / np.outer(sizes, sizes))


def parts_of(part: Part) -> Iterator[Part]:
    """A part and all that are in it."""
    yield part
    for value in part.__dict__.values():
        for each in value if isinstance(value, tuple) else (value,):
            if isinstance(each, Part):
                yield from parts_of(each)


def test_parts_within_parts_are_in_the_same_units() -> None:
    motion = {"position": [9.0, 5.0], "velocity": [0.5, 0.0]}
    fork = {"futures": [{"weight": 1.0, "motion": motion}]}
    singer = {"kind": "singer", "deviation": 0.5, "time_constant": 4.0}
    process = {"process": singer, "velocity_deviation": 2.0, "noise_deviation": 0.5}
    tails = {"degrees_of_freedom": 5.0, "lead_time": [1.0], "inflation": [1.0]}
    given = scene(
        {"id": "fork", "shape": {"polygon": [[0, 0], [4, 0], [0, 2]]}, "motion": fork},
        {**seen("process"), "model": {"process": {**process, "tails": tails}}},
        {**seen("prior"), "model": {"prior": {"velocity_deviation": 2.0}}},
        bounds={"min": [-9.0, -9.0], "max": [31.0, 9.0]},
        speed_limits=[{"from": 2.0, "to": 6.0, "speed": 1.0, "line": [[0, 0], [20, 0]]}],
        goals=[{"target": {"motion": motion}, "radius": 0.5}],
    )
    units = NaturalUnits(length=2.0, time=4.0, origin=(1.0, -1.0), clock=8.0)
    inside = units.scenario(given)
    for part, own in zip(parts_of(inside), parts_of(given), strict=True):
        assert part == units.part(own)
    twice = NaturalUnits(length=2.0, time=4.0)
    assert twice.inverse.scenario(twice.scenario(given)) == given


def open_goal() -> sp.Scenario:
    """A scene with what roads have: a goal that leaves something open, walls, tyres, a motor, a heading of its own."""
    sled = {"time": [0.0, 4.0, 9.0], "position": [[9.0, 3.0], [10.0, 1.5], [13.0, 1.0]], "heading": [0.5, 1.0, 0.2]}
    return scene(
        {"id": "sled", "shape": {"rectangle": [3.0, 1.0]}, "motion": sled},
        vehicle={"discs": [0.0, 0.4], "centre": 0.2, "max_total_acceleration": 1.4, "max_power": 2.5},
        goal={
            "position": None,
            "region": [[18.0, -2.0], [24.0, -4.0], [26.0, 3.0], [19.0, 2.0]],
            "speed_range": [1.0, 2.0],
            "heading_range": [-0.4, -0.1],
            "arrival_step": 0.25,
        },
        walls=[[[5.0, -6.0], [7.0, -6.0], [7.0, 0.5], [5.0, 0.5]]],
        lanes=[[[1.0, 1.0], [9.0, 3.0]]],
    )


def test_what_goes_in_and_out_is_the_same() -> None:
    units = NaturalUnits(length=0.37, time=12.0, origin=(5.0, -2.0), clock=1e3)
    scenario = scene(*CROSSERS, seen())
    plan = sp.plan(scenario)
    times = np.linspace(plan.start_time, plan.arrival_time, 9)
    again = plan.trip.inside(units).outside(units)
    points, _ = again.at(times)
    np.testing.assert_allclose(again.frame.to_world(points.path.position), plan.position(times), atol=1e-9)
    np.testing.assert_allclose(points.speed, plan.speed(times), atol=1e-9)
    for zone in (*sp.zones(scenario), *sp.zones(open_goal())):
        inner = zone.inside(units)
        back = inner.outside(units)
        np.testing.assert_allclose(back.center(times), zone.center(times), atol=1e-9)
        np.testing.assert_allclose(back.covariance(times), zone.covariance(times), atol=1e-9)
        np.testing.assert_allclose(back.heading_vector(times), zone.heading_vector(times), atol=1e-9)
        away = zone.signed_distance(times, plan.position(times))
        places = (plan.position(times) - units.origin) / units.length
        inside = inner.signed_distance((times - units.clock) / units.time, places)
        np.testing.assert_allclose(inside * units.length, away, atol=1e-9)


def numbers(plan: sp.Plan, length: float, time: float) -> list[float]:
    """All of a plan in the units of a scene that was written in others."""
    found = [plan.travel_time / time, plan.lower_bound / time, plan.clearance.minimum / length]
    units = NaturalUnits(length, time)
    found += [use.worst / units.factor(UNITS[name.partition("[")[0]]) for name, use in plan.limits.items()]
    found += (plan.trip.trajectory.theta / length).tolist()
    found += (plan.trip.trajectory.beta / units.acceleration).tolist()
    return found


CORNERS = ((2.0**-20, 2.0**20), (2.0**20, 2.0**-20), (2.0**20, 2.0**20), (2.0**-20, 2.0**-20))
ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "scp_planner" / "builtin").glob("*.yaml")) + sorted((ROOT / "tests" / "suite").glob("*.yaml"))
SOME_FILES = [
    pytest.param(place, path, id=path.stem, marks=() if place % 3 == 2 else pytest.mark.slow)
    for place, path in enumerate(FILES)
]
"""All of them where there is time."""


@pytest.mark.parametrize(("place", "path"), SOME_FILES)
def test_powers_of_two_do_not_change_a_bit_of_any_plan(place: int, path: Path) -> None:
    """Guides, corridors, walls, forecasts and what else the scenes of the suite have."""
    scenario = sp.Scenario.load(path)
    length, time = CORNERS[place % len(CORNERS)]
    plan, other = sp.plan(scenario), sp.plan(NaturalUnits(1.0 / length, 1.0 / time).scenario(scenario))
    assert other.status is plan.status
    assert numbers(other, length, time) == numbers(plan, 1.0, 1.0)
    assert other.iterations == plan.iterations


@pytest.mark.parametrize("seed", range(len(CORNERS)))
def test_powers_of_two_do_not_change_a_bit_among_many(seed: int) -> None:
    rng = np.random.default_rng(seed)
    along, speed = rng.uniform(3.0, 18.0, 10), rng.uniform(-1.5, 1.5, (10, 2))
    starts = np.stack([along, rng.uniform(-1.0, 1.0, 10)], axis=1) - speed * (along / 2.8)[:, None]
    crowd = [
        disc(f"o{k}", tuple(place), tuple(pace), radius=0.4)
        for k, (place, pace) in enumerate(zip(starts, speed, strict=True))
        if np.hypot(*place) > 1.5
    ]
    scenario = scene(*crowd)
    length, time = CORNERS[seed % len(CORNERS)]
    plan, other = sp.plan(scenario), sp.plan(rewritten(scenario, length, time))
    assert plan.certified
    assert numbers(other, length, time) == numbers(plan, 1.0, 1.0)
    assert other.iterations == plan.iterations
    odd = sp.plan(rewritten(scenario, 0.37, 12.0))
    np.testing.assert_allclose(numbers(odd, 0.37, 12.0), numbers(plan, 1.0, 1.0), rtol=1e-9, atol=1e-9)
    assert odd.iterations == plan.iterations


@pytest.mark.slow
@pytest.mark.parametrize("path", [pytest.param(path, id=path.stem) for path in FILES])
def test_other_units_change_rounding_only_of_any_plan(path: Path) -> None:
    scenario = sp.Scenario.load(path)
    plan, other = sp.plan(scenario), sp.plan(NaturalUnits(1.0 / 0.37, 1.0 / 12.0).scenario(scenario))
    assert other.status is plan.status
    assert other.travel_time / 12.0 == pytest.approx(plan.travel_time, rel=1e-9)


@pytest.mark.parametrize("vehicle", [{}, {"max_jerk": 4.0}])
def test_a_slow_stretch_may_begin_where_stations_are(vehicle: dict[str, float]) -> None:
    """As wherever somebody writes round numbers: whether a station is in it is not for rounding to say."""
    given = scene(vehicle=vehicle, speed_limits=[{"from": 6.0, "to": 11.0, "speed": 1.2}])
    plan = sp.plan(given)
    for length, time in FACTORS:
        other = sp.plan(NaturalUnits(1.0 / length, 1.0 / time).scenario(given))
        assert other.travel_time / time == pytest.approx(plan.travel_time, rel=1e-9)


@pytest.fixture(scope="module")
def open_plan() -> sp.Plan:
    return sp.plan(open_goal())


@pytest.mark.parametrize(("length", "time"), [pytest.param(0.02, 0.3, marks=pytest.mark.slow), (700.0, 50.0)])
def test_what_roads_have_is_planned_alike_in_other_units(length: float, time: float, open_plan: sp.Plan) -> None:
    plan, given = open_plan, open_goal()
    scaled = rewritten(given, length, time, shift=(9.0 * length, 4.0 * length))
    other = sp.plan(scaled)
    assert plan.certified and other.certified, other.reason
    assert other.travel_time == pytest.approx(plan.travel_time * time, rel=1e-6)
    assert math.remainder(plan.travel_time, 0.25) == pytest.approx(0.0, abs=0.0025)
    for name, use in plan.limits.items():
        factor = NaturalUnits(length, time).factor(UNITS[name])
        assert other.limits[name].worst == pytest.approx(use.worst * factor, rel=1e-3)
    assert sp.certify(scaled, other, sp.zones(scaled)).holds
    change = {"position": None, "region": [[40, 9], [44, 9], [44, 12]], "speed_range": [2.5, 2.9], "arrival_step": 0.35}
    goal = {**given.to_dict()["goal"], **change}
    wrong = rewritten(
        sp.Scenario(**{**given.to_dict(), "goal": goal}), length, time, shift=(9.0 * length, 4.0 * length)
    )
    found, its = sp.certify(sp.Scenario(**{**given.to_dict(), "goal": goal}), plan), sp.certify(wrong, other)
    assert {each.what for each in found.violations} >= {"distance from the goal region", "goal speed"}
    for mine, each in zip(found.violations, its.violations, strict=True):
        factor = NaturalUnits(length, time).factor(UNITS[mine.what])
        assert each.what == mine.what
        assert each.value == pytest.approx(mine.value * factor, rel=1e-3, abs=1e-3 * factor)


@pytest.mark.parametrize(
    "change",
    [{"clock": 1e9}, {"shift": (1e7, -2e6)}, {"turn": 2.0}, {"clock": 1e9, "shift": (1e7, 0.0), "length": 75.0}],
    ids=str,
)
def test_the_clock_the_place_and_the_direction_change_rounding_only(change: dict[str, Any]) -> None:
    still = [{**each, "motion": {**each["motion"], "acceleration": (0.0, 0.0)}} for each in CROSSERS]
    scenario = scene(*still)
    plan, other = sp.plan(scenario), sp.plan(rewritten(scenario, **change))
    assert other.certified, other.reason
    # 1e9 s and 1e7 m are known to about 1e-7 and 1e-9 of themselves, and speeds of 1 m/s turn one into the other.
    assert other.travel_time == pytest.approx(plan.travel_time, rel=1e-6)


@pytest.mark.parametrize(("length", "time"), [pytest.param(0.01, 0.1, marks=pytest.mark.slow), (600.0, 200.0)])
def test_what_is_told_is_told_in_the_units_of_the_user(length: float, time: float) -> None:
    """Certificates, bounds, zones and reasons of a plan that is none."""
    wall = [disc(f"wall {k}", (10.0, 1.2 * k), radius=0.7) for k in range(-2, 3)]
    scenario = scene(*wall, bounds={"min": [-1.0, -3.0], "max": [21.0, 3.0]})
    data = rewritten(scenario.model_copy(update={"bounds": None}), length, time).to_dict()
    data["bounds"] = {"min": [-1.0 * length, -3.0 * length], "max": [21.0 * length, 3.0 * length]}
    other = sp.Scenario(**data)
    settings = sp.Settings(max_runs=1)
    plan, again = sp.plan(scenario, settings), sp.plan(other, settings)
    assert not plan.certified and not again.certified
    mine, its = sp.certify(scenario, plan), sp.certify(other, again)
    assert [each.what for each in its.violations] == [each.what for each in mine.violations]
    factor = NaturalUnits(length, time).factor(UNITS[mine.violations[0].what])
    assert its.violations[0].value == pytest.approx(mine.violations[0].value * factor, rel=1e-6)
    assert its.violations[0].time == pytest.approx(mine.violations[0].time * time, rel=1e-6)
    assert again.reason is not None and plan.reason is not None
    assert any(str(each) in again.reason for each in its.violations)
    proved, other_proved = (
        re.search(r"No trip at all arrives before t = (\S+) s", each) for each in (plan.reason, again.reason)
    )
    assert proved is not None and other_proved is not None
    assert float(other_proved[1]) == pytest.approx(float(proved[1]) * time, abs=1e-3 * time)  # three decimals


@pytest.mark.parametrize(
    ("length", "time"), [pytest.param(2.0**-10, 2.0**6, marks=pytest.mark.slow), (2.0**9, 2.0**11)]
)
def test_powers_of_two_do_not_change_a_bit_of_a_drive(length: float, time: float) -> None:
    still = {**disc("post", (4.0, 0.4), radius=0.4), "margin": 0.1}
    here = scene(still, CROSSERS[0], goal={"position": (5.0, 0.0)})
    runs = [sp.simulate(here, seed=3, rate=4.0), sp.simulate(rewritten(here, length, time), seed=3, rate=4.0 / time)]
    mine, its = runs
    assert mine.arrived and not mine.contact
    assert its.travel_time == mine.travel_time * time
    assert np.array_equal(its.position, mine.position * length)
    assert [record.outcome for record in its.records] == [record.outcome for record in mine.records]
    assert [plan.iterations for plan in its.plans] == [plan.iterations for plan in mine.plans]


def test_planners_of_other_sizes_say_what_their_certificates_say() -> None:
    """At one moment of a drive, in the units of the user: the scenario, the zones, the notes and the plan."""
    length, time = 75.0, 25.0
    far = rewritten(scene(seen()), length, time)
    planner = sp.Planner(far)
    assert planner.online.period == pytest.approx(0.1 * time)
    first = planner.replan(0.0, (0.0, 0.0), 0.0, 1.0 * length / time)
    planner.observe("seen", 0.1 * time, (9.02 * length, 2.9 * length))
    planner.observe("seen", 0.15 * time, (90.0 * length, 2.9 * length))
    now = 0.2 * time
    plan = planner.replan(now, first.position(now), float(first.heading(now)), float(first.speed(now)))
    assert plan.safe and plan.arrival_time == pytest.approx(first.arrival_time, rel=0.05)
    assert sp.certify(planner.scenario, plan).holds is plan.certified
    assert planner.notes[0].startswith(f"seen at t = {0.15 * time:.3f} s")
    (zone,) = planner.zones
    assert zone.center(now) == pytest.approx(np.array([9.04, 2.82]) * length, abs=0.2 * length)
    assert not planner.at_goal(plan.position(now)) and planner.at_goal((20.0 * length, 0.0))


def test_powers_of_two_do_not_change_a_bit_of_any_unit() -> None:
    """Powers of numbers are not rounded alike where these are multiplied by a power of two; products are."""
    rng = np.random.default_rng(0)
    kinds = {"m/s2": (1, -2), "m/s3": (1, -3), "m2/s3": (2, -3), "m2/s5": (2, -5), "1/(m s)": (-1, -1)}
    seen = [(0.7505351029663387, 1.708264036225728)]  # those of a scene where the square of the time was not
    for length, time in [*seen, *rng.uniform(0.5, 2.0, (500, 2)).tolist()]:
        up, down = NaturalUnits(length, time), NaturalUnits(length * 2.0**-14, time * 2.0**16)
        for kind, (lengths, times) in kinds.items():
            assert down.factor(kind) == up.factor(kind) * 2.0 ** (-14 * lengths + 16 * times)
        one = ((2.0, 0.5), (0.5, 1.0))
        moved = tuple(tuple(value * 2.0**-28 for value in row) for row in one)
        assert down.covariance(moved) == up.covariance(one)
