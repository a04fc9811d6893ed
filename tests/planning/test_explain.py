"""Reasons of failures: the cause by name, gravest first, and no trifles beside it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from clock import FakeClock
from scenes import CROSSERS, disc, scene

import scp_planner as sp
from scp_planner.certificate.check import certify_trip
from scp_planner.certificate.checked_trip import Scope
from scp_planner.certificate.lower_bound import no_trip_within
from scp_planner.certificate.verdict import Certificate, Clearance, Violation
from scp_planner.planning.explain import Ending, explain, grave_violations
from scp_planner.scp.record import LoopStatus

BOX = {"min": [-1.0, -3.0], "max": [21.0, 3.0]}


def block(name: str, center: tuple[float, float], size: tuple[float, float]) -> dict[str, Any]:
    """A rectangle along the axes that stands."""
    return {"id": name, "shape": {"rectangle": size, "heading": 0.0}, "motion": {"position": center}}


def reason(*obstacles: dict[str, Any], **changes: Any) -> str:
    plan = sp.plan(scene(*obstacles, **changes))
    assert plan.status == "infeasible" and plan.reason is not None
    return plan.reason


def seen(name: str) -> dict[str, Any]:
    """An obstacle on the way that was seen for a second by a poor sensor, and may accelerate."""
    places = np.array([[10.0, 0.1], [10.1, 0.0], [9.9, 0.05], [10.0, -0.1], [10.0, 0.0]])
    observations = {"time": [-1.0, -0.75, -0.5, -0.25, 0.0], "position": places.tolist()}
    return {"id": name, "shape": {"disc": 0.5}, "observations": {**observations, "covariance": [[0.04, 0], [0, 0.04]]}}


def test_what_covers_the_goal_is_named_and_what_is_far_is_not() -> None:
    text = reason(disc("crate", (20.0, 0.3), radius=1.0), disc("far", (5.0, 30.0)), disc("beside", (8.0, 2.5)))
    assert text.startswith("clearance to crate -0.99")
    assert "crate covers the goal" in text and "penalty left" in text
    # The disc covers the goal by 1.0 + 0.3 - 0.3 m: so much less of it would do.
    assert float(text.split("acceptable with ")[1].split(" m less of crate")[0]) == pytest.approx(1.0, abs=0.02)
    assert "Best of 1 arc;" in text, "no route is searched where none can lead to the goal"
    assert "far" not in text and "beside" not in text


def test_two_that_cover_the_goal_do_so_together() -> None:
    text = reason(disc("crate", (20.0, 0.3), radius=1.0), disc("barrel", (20.0, -0.4), radius=1.0))
    assert "crate and barrel cover the goal" in text or "barrel and crate cover the goal" in text


@pytest.mark.parametrize(("time_limit", "proved"), [(30.0, True), (0.9, False)])
def test_a_proof_waits_for_no_time_limit(time_limit: float, proved: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock stands still: it is how long a proof may take that decides."""
    FakeClock(0.0).rule(monkeypatch)
    plan = sp.plan(scene(disc("crate", (20.0, 0.3), radius=1.0)), time_limit=time_limit)
    assert plan.reason is not None
    assert ("No trip at all" in plan.reason) is proved


def test_a_trip_that_there_was_no_time_to_check_is_told_from_one_that_breaks_something() -> None:
    scenario, plan = scene(), sp.plan(scene())
    cut_off = certify_trip(scenario, plan.trip, (), Scope(deadline=-np.inf))
    assert not cut_off.holds and not cut_off.violations
    ending = Ending(LoopStatus.TIME_LIMIT, 0.0, {"way round": 1, "guide along the path": 2})
    text = explain(scenario, (), plan.trip, ending, cut_off, prove_until=-np.inf)
    tried = "1 way round and 2 guides along the path"
    assert text == f"No time was left to check the trip. Best of {tried}; the time limit was reached"


def test_an_obstacle_is_named_once_whichever_of_its_futures_is_in_the_way() -> None:
    places = [(5.0, 30.0), (20.0, 0.3), (19.8, 0.1)]
    weights = (0.25, 0.25, 0.5)
    futures = [{"weight": one, "motion": {"position": place}} for one, place in zip(weights, places, strict=True)]
    text = reason({"id": "crate", "shape": {"disc": 1.0}, "motion": {"futures": futures}})
    assert text.startswith("clearance to crate -")
    assert ": crate covers the goal" in text


def test_a_wall_across_the_workspace_is_named_with_the_room_beside_it() -> None:
    text = reason(block("wall", (10.0, 0.1), (1.0, 5.4)), bounds=BOX)
    # 3.0 + 0.1 - 2.7 below it, less above; the vehicle is 0.6 m wide.
    assert "between wall and the workspace bounds (at most 0.4 m between them; the vehicle takes 0.6 m)" in text


def test_two_blocks_are_both_named_though_one_is_touched_deepest() -> None:
    text = reason(block("upper", (10.0, 1.75), (1.0, 3.0)), block("lower", (10.0, -1.7), (1.0, 3.0)), bounds=BOX)
    (between,) = [sentence for sentence in text.split(". ") if "No trip at all" in sentence]
    assert {"upper", "lower", "the workspace bounds"} == set(
        between.split(", between ")[1].replace(" and ", ", ").split(", ")
    )


def test_an_arrival_that_nothing_hinders_but_the_vehicle_itself() -> None:
    text = reason(disc("beside", (9.0, 3.0)), goal={"latest_arrival": 5.0})
    earliest = sp.plan(scene()).arrival_time
    assert text.startswith("latest arrival ")
    assert "even with nothing in the way" in text and "beside" not in text
    assert float(text.split("No trip arrives before t = ")[1].split(" s")[0]) == pytest.approx(earliest, abs=2e-3)


def test_an_arrival_that_an_obstacle_hinders() -> None:
    text = reason(disc("gate", (20.0, 0.5), velocity=(0.0, 0.02)), goal={"latest_arrival": 8.0})
    assert text.startswith("latest arrival ")
    assert "No trip at all arrives by t = 8 s: gate covers the goal" in text


def test_what_cannot_be_stopped_before_is_told() -> None:
    text = reason(block("wall", (3.0, 0.0), (1.0, 20.0)), start={"speed": 3.0})
    # 3 m/s at 2 m/s2 take 2.25 m to stop; 2.5 - 0.3 m are left. 3 t - t^2 = 2.2.
    touch = 1.5 - np.sqrt(1.5**2 - 2.2)
    told = float(text.split("it would touch wall at t = ")[1].split(" s")[0])
    assert told == pytest.approx(touch, abs=1.5 / 64 + 1e-3)


@pytest.mark.parametrize(("first", "last", "needed"), [(0.0, 3.0, "3"), (3.0, 0.0, "2.25")])
def test_a_way_that_is_too_short_for_the_speeds(first: float, last: float, needed: str) -> None:
    text = reason(start={"speed": first}, goal={"position": [1.0, 0.0], "speed": last})
    assert f"From {first:g} m/s to {last:g} m/s takes {needed} m" in text


def test_a_turn_that_is_too_tight() -> None:
    hall = {"min": [-1.0, -1.0], "max": [4.0, 4.0]}
    text = reason(vehicle={"max_curvature": 0.2}, goal={"position": [2.0, 2.0]}, bounds=hall)
    assert text.startswith("curvature 0.")
    assert "has a radius of 5 m" in text
    assert "lateral_acceleration" not in text, "an excess of a thousandth is a trifle beside that"


def test_uncertainty_is_told_apart_from_size() -> None:
    text = reason(seen("ghost"), bounds=BOX)
    depth = float(text.split("clearance to ghost -")[1].split(" m")[0])
    uncertain = float(text.split("the position of ghost is uncertain by up to ")[1].split(" m")[0])
    assert uncertain > 0.5 * depth > 10.0


def test_small_excesses_beside_a_grave_one_are_left_out_and_grave_ones_are_sorted() -> None:
    plan = sp.plan(scene())
    found = {
        "trifle": Violation("goal speed error", 0.05, 1e-3, 7.0),
        "limit": Violation("curvature", 1.5, 1.0, 3.0),
        "small, but alone of its kind": Violation("excess over given constraint 1", 1e-3, 2e-4, 0.0),
        "gravest": Violation("clearance", -2.4, 0.0, 4.0, "shelf"),
        "of another disc": Violation("clearance", -2.3, 0.0, 4.1, "shelf"),
        "outside": Violation("workspace bounds", -0.2, 0.0, 4.0),
    }
    certificate = Certificate(False, Clearance(-2.4, "shelf", 4.0), {}, tuple(found.values()))
    told = grave_violations(scene(), plan.trip, certificate)
    assert told == [found[name] for name in ("small, but alone of its kind", "gravest", "outside", "limit")]
    alone = Certificate(False, Clearance(0.0), {}, (found["trifle"],))
    assert grave_violations(scene(), plan.trip, alone) == [found["trifle"]]


@pytest.mark.parametrize("factor", [0.999, 1.001, 1.5])
def test_no_trip_is_excluded_that_there_is(factor: float) -> None:
    """The quick proof excludes nothing at or above the time of a certified trip."""
    for scenario in (scene(*CROSSERS), scene(block("block", (10.0, 0.0), (1.0, 4.0)), bounds=BOX), scene()):
        plan = sp.plan(scenario)
        assert plan.certified
        excluded = no_trip_within(scenario, factor * plan.travel_time, sp.zones(scenario))
        assert not excluded or factor < 1.0
    assert no_trip_within(scene(), 0.99 * sp.plan(scene()).lower_bound, ())


def crowd(count: int, model: object, gap: float = 4.0) -> list[dict[str, Any]]:
    """People in a row across the way, each seen for a second."""
    rng = np.random.default_rng(0)
    times = np.linspace(-1.0, 0.0, 6)
    people = []
    for k in range(count):
        place = np.outer(np.ones(6), [6.0 + gap * k, 0.0]) + rng.normal(0.0, 0.1, (6, 2))
        noise = [[0.01, 0.0], [0.0, 0.01]]
        seen = {"time": times.tolist(), "position": place.tolist(), "covariance": noise}
        people.append({"id": f"person{k}", "shape": {"disc": 0.3}, "observations": seen, "model": model})
    return people


def hasty(*obstacles: dict[str, Any]) -> str:
    """The reason after a short search."""
    plan = sp.plan(scene(*obstacles), settings=sp.Settings(max_runs=1, max_iterations=4))
    assert plan.reason is not None
    return plan.reason


def test_zones_larger_than_the_scene_name_the_model_to_change() -> None:
    text = hasty(*crowd(1, {"order": 2}))
    assert "uncertain by up to" in text
    assert "more than the whole scene, 20 m: the model, order 2 (constant acceleration)" in text
    assert (
        "if it keeps its velocity, set order: 1; if one fits, set model: pedestrian, cyclist, car, ship or drone"
        in text
    )
    assert "far smaller zones of person0" in text


def test_a_model_that_fits_is_not_blamed() -> None:
    text = hasty(*crowd(1, "pedestrian"), disc("crate", (20.0, 0.3), radius=1.0))
    assert "set model" not in text and "whole scene" not in text


def test_the_same_fault_in_many_obstacles_is_told_once() -> None:
    text = hasty(*crowd(7, {"order": 2}, gap=0.5))
    assert text.count("clearance to person") == text.count("uncertain by up to") == text.count("set model") == 1
    assert "as of 6 more (person" in text and ", ...)" in text


def test_a_rectangle_that_is_taken_for_a_disc_is_told() -> None:
    times = np.linspace(-1.0, 0.0, 6).tolist()
    noise = [[0.0001, 0.0], [0.0, 0.0001]]
    seen = {"time": times, "position": [[20.0, 2.0]] * 6, "covariance": noise}
    crate = {"id": "crate", "shape": {"rectangle": [6.0, 1.0]}, "observations": seen, "model": {"order": 1}}
    assert "crate is taken for a disc of 3.04 m, as its heading is not known: give shape.heading" in hasty(crate)
    known = {**crate, "shape": {"rectangle": [6.0, 5.0], "heading": 0.0}}
    assert "taken for a disc" not in hasty(known)


def test_a_passage_that_is_too_narrow_is_named_with_what_is_missing() -> None:
    """0.45 m between two shelves, for a vehicle of 0.6 m."""
    hall = {"min": [-2.0, -5.0], "max": [22.0, 5.0]}
    text = reason(block("low", (10.0, -2.8), (1.0, 5.0)), block("high", (10.0, 2.65), (1.0, 5.0)), bounds=hall)
    told = text.split("No route leads to the goal: the widest passage (past ")[1]
    assert told.startswith("low and high) is 0.44")
    assert float(told.split("wide, ")[1].split(" m")[0]) == pytest.approx(0.15, abs=5e-3)


def test_routes_that_were_tried_are_counted() -> None:
    """A vehicle that cannot turn round the end of a wall in a hall, on either side of it."""
    hall = {"min": [-2.0, -3.0], "max": [22.0, 3.0]}
    text = reason(block("wall", (10.0, 0.0), (1.0, 4.2)), bounds=hall, vehicle={"max_curvature": 0.02})
    assert "2 routes round what stands, all tried" in text
