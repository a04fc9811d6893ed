"""Vehicles that stay in a tube round their plans: what is certified of it, and what it leaves, by dense sampling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from replanning import PERIOD, begin
from scenes import CROSSERS, disc, scene

import scp_planner as sp
from scp_planner.errors import EstimationError
from scp_planner.online.planner import Planner
from scp_planner.planning.plan import Plan
from scp_planner.scenario.models import Scenario
from scp_planner.settings.online import OnlineSettings
from scp_planner.simulation.loop import simulate
from scp_planner.simulation.setup import Follower
from scp_planner.threat_zones.error_tube import TrackingTube

TUBE = TrackingTube(0.03, 0.05, 0.08, max_speed=4.0, max_lateral=3.0, probability=0.95, records=40)
POST = disc("post", (9.0, 0.1), radius=0.5)
BESIDE = disc("beside", (0.2, 0.95), radius=0.5)

pytestmark = pytest.mark.numerics


def room_left(scenario: Scenario, plan: Plan, since: float, tube: TrackingTube) -> float:
    """The least distance between what a vehicle in a tube may take up and all obstacles, whose motions are known."""
    times = np.linspace(since, plan.arrival_time, 2001)
    speed, curvature = plan.speed(times), plan.curvature(times)
    off = tube.standing + tube.per_speed * speed + tube.per_lateral * speed**2 * np.abs(curvature)
    least = np.inf
    for obstacle in scenario.obstacles:
        motion, shape = obstacle.motion, obstacle.shape
        assert isinstance(motion, sp.Motion) and isinstance(shape, sp.Disc)
        center = np.add(motion.position, times[:, None] * np.array(motion.velocity))
        center += 0.5 * times[:, None] ** 2 * np.array(motion.acceleration)
        away = np.linalg.norm(plan.position(times) - center, axis=1) - scenario.vehicle.radius - shape.disc
        least = min(least, float((away - off).min()))
    return least


def test_certified_plans_keep_their_whole_tube_clear() -> None:
    scenario = scene(POST, *CROSSERS)
    planner = Planner(scenario, tube=TUBE)
    plan = begin(planner, scenario)
    assert plan.certified and room_left(scenario, plan, 0.0, TUBE) > 0.0
    assert sp.certify(planner.scenario, plan, tube=planner.tube).holds
    plain = begin(Planner(scenario), scenario)
    assert plain.certified and room_left(scenario, plain, 0.0, TUBE) < 0.0


@pytest.mark.parametrize("seed", range(2))
def test_vehicle_that_errs_within_its_tube_is_not_hit(seed: int) -> None:
    scenario = scene(disc("post", (4.0, 0.1), radius=0.5), CROSSERS[0], goal={"position": [8.0, 0.0]})
    run = simulate(scenario, rate=1.0 / PERIOD, follower=Follower(tube=TUBE), seed=seed)
    assert run.arrived and not run.contact
    off, most = [], []
    for record, plan in zip(run.records, run.plans, strict=True):
        times = run.time[(run.time > record.time + 1e-9) & (run.time <= record.time + PERIOD + 1e-9)]
        places = run.position[(run.time > record.time + 1e-9) & (run.time <= record.time + PERIOD + 1e-9)]
        off += np.linalg.norm(places - plan.position(times), axis=1).tolist()
        speed = plan.speed(times)
        most += (
            TUBE.standing + TUBE.per_speed * speed + TUBE.per_lateral * speed**2 * np.abs(plan.curvature(times))
        ).tolist()
    assert np.all(np.array(off) <= np.array(most) + 1e-9)
    assert max(off) > TUBE.standing  # it errs by more than one number for a vehicle that stands allows for


def test_who_stands_is_not_kept_away_as_far_as_who_drives() -> None:
    scenario = scene(BESIDE, start={"speed": 0.0})
    with_most = Planner(scenario, online=OnlineSettings(tracking_error=TUBE.bound(scenario.vehicle)))
    assert not begin(with_most, scenario).safe, "the vehicle is in the zone from the beginning on"
    plan = begin(Planner(scenario, tube=TUBE), scenario)
    assert plan.safe and room_left(scenario, plan, 0.0, TUBE) > 0.0


def test_tubes_that_do_not_fit_are_refused() -> None:
    scenario = scene(POST)
    with pytest.raises(EstimationError, match="speed"):
        Planner(scenario, tube=replace(TUBE, max_speed=1.0))
    with pytest.raises(ValueError, match="give one of them"):
        Planner(scenario, online=OnlineSettings(tracking_error=0.1), tube=TUBE)
