"""Trips that keep a tube of tracking errors clear: by the certificate, and against trips with room for its bound."""

from __future__ import annotations

from dataclasses import replace

import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.errors import EstimationError
from scp_planner.planning.plan import PlanStatus
from scp_planner.threat_zones.error_tube import TrackingTube

TUBE = TrackingTube(0.03, 0.06, 0.12, max_speed=4.0, max_lateral=3.0, probability=0.95, records=40)
POST = disc("post", (9.0, 0.1), radius=0.5)
CROSSER = disc("crosser", (14.0, -6.0), (0.0, 1.0), radius=0.5)
WALLS = {"min": (-1.0, -2.0), "max": (21.0, 1.5)}


def margin(obstacle: dict[str, object], room: float) -> dict[str, object]:
    return {**obstacle, "margin": room}


def test_trip_keeps_its_tube_and_takes_no_longer_than_with_room_for_the_widest() -> None:
    scenario = scene(POST, CROSSER)
    widest = TUBE.bound(scenario.vehicle)
    plain, plan = sp.plan(scenario), sp.plan(scenario, tube=TUBE)
    roomy = sp.plan(scene(margin(POST, widest), margin(CROSSER, widest)))
    assert plan.certified and sp.certify(scenario, plan, tube=TUBE).holds
    assert not sp.certify(scenario, plain, tube=TUBE).holds
    assert plain.travel_time < plan.travel_time < roomy.travel_time
    assert plan.lower_bound <= plan.travel_time
    # there is no more room than the tube takes
    assert 0.0 <= plan.clearance.minimum < 0.1 * widest
    assert plan.clearance.minimum == sp.certify(scenario, plan, tube=TUBE).clearance.minimum


@pytest.mark.parametrize("walls", ["bounds", "corridor"])
def test_tube_stays_in_the_workspace(walls: str) -> None:
    (x, y), (far_x, far_y) = WALLS["min"], WALLS["max"]
    box = [(x, y), (far_x, y), (far_x, far_y), (x, far_y)]
    scenario = scene(POST, **{walls: WALLS if walls == "bounds" else [box]})
    plan = sp.plan(scenario, tube=TUBE)
    assert plan.certified and sp.certify(scenario, plan, tube=TUBE).holds
    assert plan.planned is scenario


def test_where_there_is_no_room_for_the_tube_no_plan_is_certified() -> None:
    scenario = scene(POST, disc("gate", (9.0, 1.75), radius=0.5), bounds={"min": (-1.0, -0.5), "max": (21.0, 2.5)})
    assert sp.plan(scenario).certified, "there is room for the vehicle itself"
    plan = sp.plan(scenario, tube=TUBE)
    assert not plan.certified and plan.status is not PlanStatus.CERTIFIED
    assert "room for the tube" in str(plan.reason)


def test_tube_that_was_recorded_for_less_is_refused() -> None:
    with pytest.raises(EstimationError, match="speed"):
        sp.plan(scene(POST), tube=replace(TUBE, max_speed=1.0))
