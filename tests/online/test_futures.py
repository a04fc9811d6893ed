"""Predictions that change while driving."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.threat_zones.zone import by_obstacle

TIMES = np.linspace(0.0, 8.0, 9)


def future(weight: float, rate: tuple[float, float], deviation: float = 0.05) -> dict[str, Any]:
    """A future of someone who is beside the way."""
    position = np.array([8.0, -3.0]) + TIMES[:, None] * np.array(rate)
    covariance = [[deviation**2, 0.0], [0.0, deviation**2]]
    return {
        "weight": weight,
        "motion": {"time": TIMES.tolist(), "position": position.tolist(), "covariance": covariance},
    }


FORK = {"futures": [future(0.5, (0.0, 0.9)), future(0.5, (1.0, 0.0))]}
STATE: dict[str, Any] = {"time": 0.0, "position": (0.0, 0.0), "heading": 0.0, "speed": 1.0}


def person(motion: dict[str, Any]) -> dict[str, Any]:
    """A person with a motion."""
    return {"id": "person", "shape": {"disc": 0.3}, "motion": motion}


def test_new_futures_replace_the_known_ones_and_the_zones_are_those_of_a_scenario() -> None:
    planner = sp.Planner(scene(disc("post", (5.0, 3.0))))
    planner.add_obstacle(person({"futures": [future(1.0, (1.0, 0.0))]}))
    assert planner.replan(**STATE).safe
    assert [zone.id for zone in planner.zones] == ["post", "person"]
    planner.update_motion("person", FORK)
    plan = planner.replan(**{**STATE, "time": 0.1})
    assert plan.safe
    assert [zone.id for zone in planner.zones] == ["post", "person", "person"]
    given = sp.zones(planner.scenario)
    for here, there in zip(planner.zones, given, strict=True):
        assert here.center(3.0) == pytest.approx(there.center(3.0))
        assert here.covariance(3.0) == pytest.approx(there.covariance(3.0))
    assert isinstance(planner.scenario.obstacles[1].motion, sp.Futures)
    planner.update_motion("person", sp.Motion(position=(8.0, -3.0)))
    planner.replan(**{**STATE, "time": 0.2})
    assert [zone.id for zone in planner.zones] == ["post", "person"]


def test_a_plan_online_keeps_clear_of_all_futures() -> None:
    planner = sp.Planner(scene(person(FORK)))
    plan = planner.replan(**STATE)
    assert plan.safe
    zones = by_obstacle(planner.zones)["person"]
    assert len(zones) == 2
    certificate = sp.certify(planner.scenario, plan)
    if plan.certified:
        assert certificate.holds
    # A trip that knows nothing of the second future meets it.
    rash = sp.plan(scene(person({"futures": [FORK["futures"][1] | {"weight": 1.0}]})))
    moments = np.linspace(0.0, rash.travel_time, 300)
    distance = zones[0].signed_distance(moments, rash.position(moments))
    assert distance.min() < 0.3
    assert not sp.certify(planner.scenario, rash).holds


def test_an_observation_puts_predictions_aside() -> None:
    planner = sp.Planner(scene(person(FORK)))
    planner.replan(**STATE)
    for k in range(5):
        planner.observe("person", 0.02 * (k + 1), (8.0 + 0.02 * k, -3.0), [[1e-4, 0.0], [0.0, 1e-4]])
    planner.replan(**{**STATE, "time": 0.1})
    assert [zone.id for zone in planner.zones] == ["person"]
    assert planner.scenario.obstacles[0].observations is not None
    planner.update_motion("person", FORK)
    planner.replan(**{**STATE, "time": 0.2})
    assert [zone.id for zone in planner.zones] == ["person", "person"]


def test_what_is_wrong_with_a_prediction_is_named() -> None:
    planner = sp.Planner(scene(person(FORK)))
    with pytest.raises(sp.ScenarioError, match=r"motion\.futures = 0\.5: .*add up to 0\.5"):
        planner.update_motion("person", {"futures": [future(0.5, (0.0, 0.9))]})
    planner.replan(**STATE)
    assert len(planner.zones) == 2


def test_a_simulated_world_draws_one_of_the_futures_by_its_weight() -> None:
    from scp_planner.simulation.worlds import drawn_course

    futures = [{"weight": weight, "motion": {"position": [9.0, y]}} for weight, y in ((0.8, 4.0), (0.2, 5.0))]
    obstacle = scene(person({"futures": futures})).obstacles[0]
    rng = np.random.default_rng(1)
    drawn = np.array([drawn_course(obstacle, rng)(np.zeros(1))[0, 1] for _ in range(1000)])
    assert set(drawn) == {4.0, 5.0}
    assert (drawn == 5.0).mean() == pytest.approx(0.2, abs=0.04)
