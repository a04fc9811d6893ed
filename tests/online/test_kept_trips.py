"""What is left of a trip, and the stop that leaves it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from replanning import PERIOD, begin, follow, observed, seen
from scenes import CROSSERS, disc, scene

import scp_planner as sp
from scp_planner.online.plan import Outcome
from scp_planner.online.planner import Planner
from scp_planner.online.remaining import State, remaining_trip
from scp_planner.online.stops import standing_from, stop_after
from scp_planner.problem.build import build_problem
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics


def test_stop_of_a_plan_is_one() -> None:
    """It begins like the plan, brakes within the limit, stands, and keeps clear until then."""
    walker = seen("walker", (12.0, -6.0), (0.0, 0.8), 0.1, order=2)
    scenario = scene(observed(walker), observed(seen("other", (6, 3), (0, 0), 0.1)))
    planner = Planner(scenario)
    plan = begin(planner, scenario)
    assert plan.stop is not None and not plan.certified and plan.safe
    stands = plan.stop.frame.time + standing_from(plan.stop.trajectory)
    assert plan.branch_time is not None and planner.online.period is not None
    assert planner.online.period <= plan.branch_time < stands
    times = np.linspace(0.0, plan.branch_time, 50)
    stop = plan.stop.frame.to_world(plan.stop.at(times)[0].path.position)
    assert np.abs(stop - plan.position(times)).max() < 1e-9
    speeds = plan.stop.at(np.linspace(0.0, stands + 0.2, 400))[0].speed
    assert (
        speeds[-1] < 2e-3 and np.diff(speeds).min() >= -scenario.vehicle.max_deceleration * (stands + 0.2) / 399 * 1.001
    )
    certificate = sp.certify(planner.scenario, plan)
    assert not certificate.holds and all(v.time > stands for v in certificate.violations if v.what == "clearance")


def test_stop_of_a_plan_that_is_kept_is_the_same_to_the_bit() -> None:
    """So that its limits need not be checked again."""
    scenario = scene(observed(seen("a", (12.0, -6.0), (0.0, 0.8), 0.1, order=2)))
    planner = Planner(scenario)
    plans = [begin(planner, scenario), *(follow(planner, k * PERIOD) for k in range(1, 12))]
    same = 0
    for last, plan in pairwise(plans):
        if plan.outcome is Outcome.KEPT and plan.stop is not None and plan.branch_time == last.branch_time:
            assert last.stop is not None
            ours, theirs = plan.stop.trajectory, last.stop.trajectory
            assert np.array_equal(ours.beta, theirs.beta) and np.array_equal(ours.theta, theirs.theta)
            same += 1
    assert same >= 3


@pytest.mark.parametrize("guide", [None, [[0, 0], [8, 0], [12, 4], [20, 4]]])
def test_what_is_left_of_a_trip_is_on_it(guide: list[list[float]] | None) -> None:
    """Over straight and curved guides: the rest passes where the trip did, at the same times."""
    goal = (20.0, 0.0 if guide is None else 4.0)
    scenario = scene(disc("post", (10.0, 1.0), radius=0.6), goal={"position": goal}, guide=guide)
    driving = Planner(scenario)
    begin(driving, scenario)
    plan = driving._last  # in the units of the scene
    assert plan is not None
    for time in (0.1, 1.5, 3.0, 5.0):
        state = State(time, tuple(plan.position(time).tolist()), float(plan.heading(time)), float(plan.speed(time)))
        planner = Planner(scenario)
        problem = build_problem(planner._means.scenario_at(state), (), planner.settings, planner._means.breakpoints)
        rest = Trip(problem.frame, remaining_trip(problem, plan.trip, state))
        end = problem.frame.time + rest.trajectory.travel_time
        assert end == pytest.approx(plan.arrival_time, abs=0.08)
        times = np.linspace(time, plan.arrival_time, 60)
        points = rest.frame.to_world(rest.at(times)[0].path.position)
        assert np.linalg.norm(points - plan.position(times), axis=1).max() < (0.12 if guide is None else 0.25)
        nearest = np.linalg.norm(points[:, None] - plan.position(np.linspace(time, plan.arrival_time, 800)), axis=2)
        assert nearest.min(axis=1).max() < (0.02 if guide is None else 0.06)


@pytest.mark.parametrize("spans", [1, 3, 7])
def test_stop_is_the_trip_up_to_where_it_leaves_it(spans: int) -> None:
    scenario = scene(*CROSSERS)
    trajectory = sp.plan(scenario, sp.Settings(acceleration_degree=0)).trip.trajectory
    stop = stop_after(trajectory, spans, 2.0)
    assert stop is not None
    breaks = trajectory.space.acceleration.breakpoints
    kept = trajectory.space.time_table(np.linspace(0.0, breaks[spans], 50))
    assert stop.at(kept).distance == pytest.approx(trajectory.at(kept).distance, abs=1e-12)
    speeds = stop.speed_at(np.linspace(0.0, 1.0, 401))
    assert speeds[-1] == pytest.approx(0.0, abs=1e-9) and speeds.min() > -1e-9
    assert stop.beta.min() >= -2.0 - 1e-9
    left = breaks[spans] * trajectory.travel_time
    (speed,) = trajectory.speed_at(breaks[spans : spans + 1])
    width = float(np.diff(breaks).max()) * trajectory.travel_time
    assert left + speed / 2.0 - 2e-3 <= standing_from(stop) <= left + speed / 2.0 + width


def test_stop_needs_spans_to_stop_in() -> None:
    trajectory = sp.plan(scene(), sp.Settings(acceleration_degree=0)).trip.trajectory
    assert stop_after(trajectory, 19, 2.0) is None
