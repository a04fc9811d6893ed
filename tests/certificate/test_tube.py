"""The certificate of a vehicle that stays in a tube round its trip, against dense samples of speed and curvature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.errors import EstimationError
from scp_planner.scenario.units import NaturalUnits
from scp_planner.tracking.error_tube import TrackingTube

TUBE = TrackingTube(0.01, 0.02, 0.04, max_speed=4.0, max_lateral=3.0, probability=0.95, records=40)
POST, CROSSER = (9.0, 0.1), (14.0, -6.0)
SIZE, ROOM = 0.5, 0.3
STEPS = 40_000


def among(radius: float) -> sp.Scenario:
    return scene(
        disc("post", POST, radius=radius),
        disc("crosser", CROSSER, (0.0, 1.0), radius=radius),
        vehicle={"discs": [0.0, 0.4]},
    )


@pytest.fixture(scope="module")
def planned() -> tuple[sp.Scenario, sp.Plan]:
    """A scene, and a plan that has room in it: one among larger obstacles."""
    return among(SIZE), sp.plan(among(SIZE + ROOM))


def densely(scenario: sp.Scenario, plan: sp.Plan, tube: TrackingTube) -> float:
    """Least distance of the vehicle's discs to both obstacles, less the tube, at many times."""
    t = np.linspace(scenario.start.time, plan.arrival_time, STEPS)
    speed, curvature, heading = plan.speed(t), plan.curvature(t), plan.heading(t)
    off = tube.standing + tube.per_speed * speed + tube.per_lateral * speed**2 * np.abs(curvature)
    least = np.inf
    for offset in scenario.vehicle.discs:
        place = plan.position(t) + offset * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        for center in (np.array(POST), np.array(CROSSER) + (t - scenario.start.time)[:, None] * [0.0, 1.0]):
            apart = np.hypot(*(place - center).T) - SIZE - scenario.vehicle.radius - off
            least = min(least, float(apart.min()))
    return least


def scaled(factor: float) -> TrackingTube:
    sizes = {name: factor * getattr(TUBE, name) for name in ("standing", "per_speed", "per_lateral")}
    return replace(TUBE, **sizes)


@pytest.mark.parametrize("factor", [0.0, 0.5, 1.0])
def test_each_piece_of_a_trip_has_the_room_that_it_needs(planned: tuple[sp.Scenario, sp.Plan], factor: float) -> None:
    scenario, plan = planned
    found, dense = sp.certify(scenario, plan, tube=scaled(factor)), densely(scenario, plan, scaled(factor))
    assert found.holds and dense > 0.0
    precision = 1e-3 * NaturalUnits.of(scenario).length
    assert dense - precision - 1e-6 <= found.clearance.minimum <= dense + 1e-9


def test_what_the_tube_touches_is_refused(planned: tuple[sp.Scenario, sp.Plan]) -> None:
    scenario, plan = planned
    assert densely(scenario, plan, scaled(3.0)) < 0.0
    found = sp.certify(scenario, plan, tube=scaled(3.0))
    assert not found.holds and {one.what for one in found.violations} == {"clearance"}


def test_tube_by_piece_asks_for_less_than_its_bound(planned: tuple[sp.Scenario, sp.Plan]) -> None:
    scenario, plan = planned
    whole = sp.certify(scenario, plan).clearance.minimum - TUBE.bound(scenario.vehicle)
    assert sp.certify(scenario, plan, tube=TUBE).clearance.minimum > whole + 0.05 * TUBE.bound(scenario.vehicle)


def test_tube_leaves_the_workspace_before_the_vehicle_does(planned: tuple[sp.Scenario, sp.Plan]) -> None:
    scenario, plan = planned
    t = np.linspace(scenario.start.time, plan.arrival_time, STEPS)
    tip = plan.position(t) + 0.4 * np.stack([np.cos(plan.heading(t)), np.sin(plan.heading(t))], axis=1)
    y = np.concatenate([plan.position(t)[:, 1], tip[:, 1]])
    off = np.tile(TUBE.radius(plan.speed(t), plan.speed(t) ** 2 * np.abs(plan.curvature(t))), 2)
    for room, holds in ((1.01, True), (0.99, False)):
        low = float((y - room * off).min()) - scenario.vehicle.radius
        box = sp.Bounds(min=(-5.0, low), max=(25.0, 10.0))
        assert sp.certify(scenario.model_copy(update={"bounds": box}), plan, tube=TUBE).holds is holds


def test_tube_that_was_recorded_for_less_is_refused(planned: tuple[sp.Scenario, sp.Plan]) -> None:
    scenario, plan = planned
    with pytest.raises(EstimationError, match="speed"):
        sp.certify(scenario, plan, tube=replace(TUBE, max_speed=1.0))
