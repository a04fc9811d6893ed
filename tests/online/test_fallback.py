"""What is driven where nothing better than the last plan is found."""

from __future__ import annotations

import math

import pytest
from scenes import disc, scene

from scp_planner.online.means import Replan
from scp_planner.online.planner import Planner
from scp_planner.online.remaining import State
from scp_planner.online.vetting import Refusal
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize(("radii", "tried"), [(-4.1, 1), (-3.9, 3), (0.5, 3), (math.inf, 3), (-math.inf, 3)])
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
