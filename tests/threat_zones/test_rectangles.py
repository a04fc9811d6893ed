"""Rectangles stay rectangles: on courses that stand now and then, and where their heading is estimated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from shapely import affinity
from shapely.geometry import Point, box

import scp_planner as sp
from scp_planner.mathematics.ellipse import support
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.threat_zones.widening import Widening, widened

Array = np.ndarray
LENGTH, WIDTH = 4.8, 1.9
ACROSS = np.array([0.0, 1.0])


def waiting(jitter: float) -> dict[str, Any]:
    """A car that waits for 3 s beside the lane, and then sets off along it."""
    times = np.arange(0.0, 12.5, 0.5)
    places = np.stack([np.where(times < 3.0, 30.0, 30.0 + (times - 3.0) ** 2), np.full_like(times, 3.2)], axis=1)
    places += np.random.default_rng(0).normal(0.0, 1.0, places.shape) * jitter
    return {"id": "car", "shape": {"rectangle": [LENGTH, WIDTH]}, "motion": {"time": times, "position": places}}


def lane(*obstacles: dict[str, Any], **others: Any) -> sp.Scenario:
    return sp.Scenario(
        vehicle={
            "radius": 1.0,
            "max_speed": 12.0,
            "max_acceleration": 2.0,
            "max_deceleration": 4.0,
            "max_lateral_acceleration": 3.0,
            "max_curvature": 0.2,
        },
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 8.0},
        goal={"position": [80.0, 0.0]},
        bounds={"min": [-5.0, -1.3], "max": [85.0, 5.5]},
        obstacles=obstacles,
        **others,
    )


def test_two_centimetres_of_jitter_do_not_make_a_disc() -> None:
    scenario = lane(waiting(0.02))
    (zone,) = sp.zones(scenario)
    times = np.linspace(0.0, 12.0, 200)
    half = zone.support(times, np.broadcast_to(ACROSS, (200, 2)))
    assert np.all((half >= 0.5 * WIDTH - 0.05) & (half < 0.5 * WIDTH + 0.15))
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    assert plan.travel_time == pytest.approx(sp.plan(lane(waiting(0.0))).travel_time, rel=0.01)


def warehouse() -> sp.Scenario:
    """A truck brings a pallet, stands, and goes on round a corner; a slow zone lies before it."""
    rng = np.random.default_rng(4)
    times = np.arange(0.0, 16.0, 0.4)
    east = np.clip(1.2 * times, 0.0, 6.0)
    since = np.maximum(times - 9.0, 0.0)
    bend = np.stack(
        [1.5 * np.sin(np.minimum(0.25 * since, 1.2)), -1.5 * (1.0 - np.cos(np.minimum(0.25 * since, 1.2)))], 1
    )
    places = np.stack([4.0 + east, np.full_like(times, 2.6)], axis=1) + bend + rng.normal(0.0, 0.01, (len(times), 2))
    return sp.Scenario(
        vehicle={
            "radius": 0.5,
            "max_speed": 2.0,
            "max_acceleration": 0.8,
            "max_deceleration": 1.0,
            "max_curvature": 0.8,
        },
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0},
        goal={"position": [18.0, 0.0]},
        speed_limits=[{"from": 6.0, "to": 10.0, "speed": 0.8}],
        obstacles=[{"id": "truck", "shape": {"rectangle": [2.2, 0.9]}, "motion": {"time": times, "position": places}}],
    )


def test_the_certificate_of_a_trip_past_a_truck_that_stands_and_turns() -> None:
    """Against rectangles drawn with shapely, at headings that nothing of the certificate computes."""
    scenario = warehouse()
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    (zone,) = sp.zones(scenario)
    times = np.linspace(0.0, plan.travel_time, 1500)
    places, heading = plan.position(times), zone.heading_vector(times)
    centers = zone.center(times)
    least = np.inf
    for place, unit, center in zip(places, heading, centers, strict=True):
        drawn = affinity.rotate(box(-1.1, -0.45, 1.1, 0.45), np.arctan2(unit[1], unit[0]), (0.0, 0.0), use_radians=True)
        least = min(least, affinity.translate(drawn, *center).distance(Point(*place)) - 0.5)
    certificate = sp.certify(scenario, plan)
    assert certificate.clearance.minimum <= least + 1e-9
    assert least - certificate.clearance.minimum < 0.05


CORNERS = 0.5 * np.array([[LENGTH, WIDTH], [LENGTH, -WIDTH], [-LENGTH, -WIDTH], [-LENGTH, WIDTH]])
TIMES = np.linspace(-2.0, 0.0, 21)
NOISE = [[0.01, 0.0], [0.0, 0.01]]
PASSING = [20.0, 3.0] + TIMES[:, None] * [6.0, 0.0] + np.random.default_rng(0).normal(0.0, 0.1, (len(TIMES), 2))
"""Where a car was seen that drives along the lane."""


def driving(places: Array, model: object, level: str) -> sp.Scenario:
    """A car that has been seen."""
    seen = {"time": TIMES, "position": places, "covariance": NOISE}
    car = {"id": "car", "shape": {"rectangle": [LENGTH, WIDTH]}, "observations": seen, "model": model}
    return lane(car, confidence={"probability": 0.9, "level": level})


def holds(zone: Any, times: Array, centers: Array, velocities: Array) -> bool:
    """True if a zone holds the true rectangle at all times; the zone is convex, so corners will do."""
    angle = np.arctan2(velocities[:, 1], velocities[:, 0])
    turn = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=1).reshape(-1, 2, 2)
    corners = centers[:, None] + np.einsum("nab,cb->nca", turn, CORNERS)
    return bool(zone.signed_distance(np.repeat(times, 4), corners.reshape(-1, 2)).max() <= 0.0)


@pytest.mark.parametrize(
    ("order", "acceleration", "level"),
    [
        (1, (0.0, 0.0), "joint"),
        (2, (0.3, 1.0), "per_obstacle"),
        pytest.param(1, (0.0, 0.0), "per_obstacle", marks=pytest.mark.slow),
        pytest.param(2, (0.3, 1.0), "joint", marks=pytest.mark.slow),
    ],
)
def test_an_observed_rectangle_is_held_at_all_times(order: int, acceleration: tuple[float, float], level: str) -> None:
    """Drawn from noisy observations, again and again: centre and heading at once, as often as was said."""
    rng, runs, inside, shaped = np.random.default_rng(order), 150, 0, 0
    velocity, change = np.array([6.0, 2.0]), np.array(acceleration)
    later = np.linspace(0.0, 8.0, 33)
    then = [20.0, 3.0] + later[:, None] * velocity + 0.5 * later[:, None] ** 2 * change
    past = [20.0, 3.0] + TIMES[:, None] * velocity + 0.5 * TIMES[:, None] ** 2 * change
    for _ in range(runs):
        (zone,) = sp.zones(driving(past + rng.normal(0.0, 0.1, past.shape), {"order": order}, level))
        inside += holds(zone, later, then, velocity + later[:, None] * change)
        shaped += len(zone.outlines) == 1
    assert shaped == runs
    assert inside / runs >= 0.9 - 3.0 * np.sqrt(0.09 / runs)


def test_an_observed_rectangle_is_far_narrower_than_its_disc() -> None:
    zone, disc = sp.zones(driving(PASSING, {"order": 1}, "joint"))[0], 0.5 * np.hypot(LENGTH, WIDTH)
    blur = np.sqrt(zone.covariance(0.0)[1, 1])
    assert zone.support(0.0, ACROSS) < 0.5 * WIDTH + 0.5
    assert zone.support(0.0, ACROSS) < disc
    assert blur < 0.5


def test_a_tracked_rectangle_that_wanders_is_held_at_all_times() -> None:
    """The velocity does a random walk: its direction is off by the estimate's error and by what comes."""
    rng, runs, inside, shaped = np.random.default_rng(3), 120, 0, 0
    covariance, diffusion, step = np.diag([0.04, 0.04, 0.05, 0.05]), 0.15, 0.02
    process = {
        "process": {"kind": "random_walk", "diffusion": diffusion},
        "velocity_deviation": 8.0,
        "noise_deviation": 0.1,
    }
    lead = np.arange(0.0, 4.0, step)
    for _ in range(runs):
        error = rng.multivariate_normal(np.zeros(4), covariance)
        told = {"time": 0.0, "position": [20.0, 3.0], "velocity": [7.0, 1.0], "covariance": covariance}
        car = {"id": "car", "shape": {"rectangle": [LENGTH, WIDTH]}, "estimate": told, "model": {"process": process}}
        (zone,) = sp.zones(lane(car, confidence={"probability": 0.9, "level": "per_obstacle"}))
        kicks = np.sqrt(diffusion * step) * rng.normal(size=(len(lead), 2))
        velocity = np.array([7.0, 1.0]) + error[2:] + np.cumsum(kicks, axis=0) - kicks[0]
        center = np.array([20.0, 3.0]) + error[:2] + step * (np.cumsum(velocity, axis=0) - velocity[0])
        inside += holds(zone, lead[::5], center[::5], velocity[::5])
        shaped += len(zone.outlines) == 1
    assert shaped == runs
    assert inside / runs >= 0.9 - 3.0 * np.sqrt(0.09 / runs)


def test_what_stands_or_is_seen_badly_stays_a_disc_and_is_told(caplog: pytest.LogCaptureFixture) -> None:
    places = np.array([20.0, 3.0]) + np.random.default_rng(0).normal(0.0, 0.1, (len(TIMES), 2))
    for model in ({"order": 2}, {"order": 1}, "car", "ship"):
        with caplog.at_level("INFO", logger="scp_planner"):
            (zone,) = sp.zones(driving(places, model, "joint"))
        (told,) = [record.getMessage() for record in caplog.records]
        assert told == "car: taken for a disc of 2.58 m, the heading of its rectangle is not known"
        caplog.clear()
        assert not zone.outlines
        assert zone.radius == pytest.approx(0.5 * np.hypot(LENGTH, WIDTH), abs=0.01)


def test_an_ellipse_and_a_widening_lie_in_the_widened_ellipse() -> None:
    rng = np.random.default_rng(6)
    for _ in range(20):
        root = rng.normal(size=(3, 2, 2)) * rng.uniform(0.01, 2.0, (3, 1, 1))
        terms = (root @ root.transpose(0, 2, 1))[:, [0, 0, 1], [0, 1, 1]] + [1e-4, 0.0, 1e-4]
        breaks = np.array([[1.0, 3.0, 11.0]])
        later = np.stack([terms[0] + 2.0 * terms[1] + 4.0 * terms[2], terms[1], terms[2]])
        before = PiecewisePolynomials(breaks, np.stack([terms, later])[None])
        leads = np.array([0.0, 0.3, 1.0, 4.0, 10.0])
        widening = Widening(float(rng.uniform(0.0, 3.0)), leads, np.sort(rng.uniform(0.0, 1.5, (5, 2)), axis=0))
        after = widened(before, widening)
        times = np.linspace(1.0, 11.0, 801)
        every = np.zeros(len(times), dtype=int)
        along, across = (np.interp(times - 1.0, leads, each) for each in widening.squares.T)
        for angle in np.linspace(0.0, np.pi, 13):
            nu = np.broadcast_to([np.cos(angle), np.sin(angle)], (len(times), 2))
            off = angle - widening.heading
            width = np.sqrt(along * np.cos(off) ** 2 + across * np.sin(off) ** 2)
            whole, own = support(after.at(every, times), nu), support(before.at(every, times), nu)
            assert np.all(whole >= (own + width) * (1.0 - 1e-12))


@pytest.mark.parametrize("shape", [{"rectangle": [LENGTH, WIDTH]}, {"ellipse": [2.4, 0.95]}])
def test_a_widened_shape_holds_it_at_every_heading_that_is_possible(shape: dict[str, Any]) -> None:
    """By dense search: the shape turned by what its heading may be off, at the beginning and when nothing is known."""
    seen = {"time": TIMES, "position": PASSING, "covariance": NOISE}
    own = {"id": "car", "shape": shape, "observations": seen, "model": {"order": 2}}
    (zone,) = sp.zones(lane(own))
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    nu = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    (late,) = (zone.support(np.full(721, 90.0), nu),)
    reach = zone.outlines[0].reach
    assert np.all(late >= reach)  # every heading
    (outline,) = zone.outlines
    for off in np.linspace(-0.05, 0.05, 11):  # less than what two seconds of observations leave open
        turned = np.stack([np.cos(angle - off), np.sin(angle - off)], axis=1)
        assert np.all(zone.support(np.zeros(721), nu) >= outline.support(turned))


WANDERER = {
    "process": {
        "process": {"kind": "random_walk", "diffusion": 0.1},
        "velocity_deviation": 8.0,
        "noise_deviation": 0.1,
    }
}


@pytest.mark.parametrize("model", [{"order": 1}, WANDERER])
def test_online_an_observed_rectangle_is_the_scenarios_own(model: object) -> None:
    planner = sp.Planner(driving(PASSING, model, "joint"))
    plan = planner.replan(0.0, (0.0, 0.0), 0.0, 8.0)
    (zone,), (again,) = planner.zones, sp.zones(planner.scenario)
    assert len(zone.outlines) == len(again.outlines) == 1
    at = np.linspace(0.0, 6.0, 13)
    nu = np.broadcast_to(ACROSS, (13, 2))
    np.testing.assert_allclose(again.support(at, nu), zone.support(at, nu), rtol=1e-3)
    assert plan.safe
    assert sp.certify(planner.scenario, plan).holds is plan.certified
