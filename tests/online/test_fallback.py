"""What is driven where nothing better than the last plan is found."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import disc, scene

from scp_planner.online.means import Replan
from scp_planner.online.plan import Outcome
from scp_planner.online.planner import Planner
from scp_planner.online.remaining import State
from scp_planner.online.renewal import Renewal
from scp_planner.online.vetting import Refusal
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize(("radii", "tried"), [(-1.1, 1), (-0.9, 2), (0.5, 2), (math.inf, 2), (-math.inf, 2)])
def test_a_trip_all_of_whose_stops_are_deep_inside_of_zones_is_not_driven_still_slower(
    radii: float, tried: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner = Planner(scene(disc("a", (10.0, 0.3)), start={"speed": 3.0}))
    planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)
    means, slower, last = planner._means, list[Trajectory](), planner._last
    assert last is not None
    now = Replan(means.moment(State(0.0, (0.0, 0.0), 0.0, 3.0 / planner._units.speed)), 0.0, math.inf, last, 1)

    def refused(_now: Replan, _problem: object, trip: Trajectory, **_: float) -> Refusal:
        slower.append(trip)
        return Refusal("none", radii * now.moment.scenario.vehicle.radius)

    monkeypatch.setattr(means, "vet", refused)
    assert planner._decision._fallback._repair(now, means.problem(now), last.trip.trajectory) is None
    assert len(slower) == tried
    times = [trip.travel_time for trip in slower]
    assert times == sorted(times) and times[0] > last.trip.trajectory.travel_time


@pytest.mark.parametrize(("radii", "tried"), [(-2.1, False), (-1.9, True), (math.inf, True), (-math.inf, True)])
def test_a_trip_that_was_refused_for_stops_deep_inside_of_zones_is_not_driven_slower(
    radii: float, tried: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner = Planner(scene(disc("a", (10.0, 0.3)), start={"speed": 3.0}))
    planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)
    means, fallback, last, asked = planner._means, planner._decision._fallback, planner._last, list[str]()
    assert last is not None
    now = Replan(means.moment(State(0.0, (0.0, 0.0), 0.0, 3.0 / planner._units.speed)), 0.0, math.inf, last, 1)

    def noted(*_: object) -> None:
        asked.append("repair")

    monkeypatch.setattr(means.vetting, "vet_kept", lambda *_: None)
    monkeypatch.setattr(means.vetting, "vet_kept_stop", lambda *_: None)
    monkeypatch.setattr(fallback, "_repair", noted)
    refusal = Refusal("none", radii * now.moment.scenario.vehicle.radius)
    fallback.fall_back(now, Renewal(means, now), last, refusal)
    assert asked == ["repair"] * tried


@pytest.mark.parametrize("blocked", [False, True])
def test_a_dodge_that_was_begun_is_gone_on_with_while_it_is_certified(blocked: bool) -> None:
    """Without a look at any other; not where somebody stands where it leads."""
    slow = {"max_speed": 1.0, "max_acceleration": 0.5, "max_deceleration": 0.5, "steering": "any"}
    planner = Planner(scene(goal={"position": (20.0, 0.0)}, vehicle=slow))
    means = planner._means
    state = State(0.0, (0.0, 0.0), None, 1.0)
    now = Replan(means.moment(state), 0.0, math.inf, None, 0)
    dodge = planner._decision._fallback._evasion.safest(now)
    assert dodge is not None and dodge.moves
    begun = planner._decision._fallback._dodging(now, dodge, "at first")
    points, _ = begun.trip.at(np.array([0.1, begun.trip.frame.time + begun.trip.trajectory.travel_time]))
    here, end = begun.trip.frame.to_world(points.path.position).tolist()
    if blocked:
        planner.add_obstacle(disc("a", (end[0] * planner._units.length, end[1] * planner._units.length)))
    there = State(0.1, (here[0], here[1]), None, float(points.speed[0]))
    later = Replan(means.moment(there), 0.0, math.inf, begun, 1)
    plan = planner._decision._fallback.go_on(later, "no way")
    assert (plan is None) is blocked
    if plan is not None:
        assert plan.trip is begun.trip and plan.safe and plan.outcome is Outcome.EVADING
        assert "as before: no way" in str(plan.reason)
