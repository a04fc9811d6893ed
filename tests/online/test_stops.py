"""Stops by the textbook: a vehicle at speed v that brakes with d stands after v / d and v^2 / 2 d."""

from __future__ import annotations

import numpy as np
import pytest
from replanning import begin, observed, seen
from scenes import disc, scene

import scp_planner as sp
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.planner import Planner
from scp_planner.online.remaining import State
from scp_planner.online.stops import EvenBraking, fits, standing_from, straight_stop
from scp_planner.scenario.limits import Limits
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.guide import StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

BREAKS = tuple(np.linspace(0.0, 1.0, 21).tolist())
FRAME = PlanningFrame.between((0.0, 0.0), (20.0, 0.0), 0.0)


def straight(length: float, speed: float) -> Path:
    space = TripSpace(StraightGuide(length), speed, 5, 4, 0, BREAKS)
    return Path(space, np.zeros(space.path_size))


def at_speed(speed: float) -> State:
    return State(0.0, (0.0, 0.0), None, speed)


def at(trajectory: Trajectory, times: np.ndarray) -> np.ndarray:
    """Distances driven, m."""
    return trajectory.at(trajectory.space.time_table(times / trajectory.travel_time)).distance


@pytest.mark.parametrize(("speed", "deceleration"), [(0.5, 2.0), (3.0, 2.0), (2.5, 0.7)])
def test_a_stop_now_takes_the_time_and_the_way_of_the_textbook(speed: float, deceleration: float) -> None:
    stop = EvenBraking(deceleration).stop_now(straight(20.0, speed), at_speed(speed))
    assert stop.travel_time == pytest.approx(speed / deceleration, rel=1e-12)
    times = np.linspace(0.0, stop.travel_time, 101)
    assert at(stop, times) == pytest.approx(speed * times - 0.5 * deceleration * times**2, abs=1e-12)
    assert at(stop, times)[-1] == pytest.approx(speed**2 / (2.0 * deceleration), rel=1e-12)
    assert stop.final_speed == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("share", "fitting"), [(0.999, False), (1.001, True)])
def test_a_stop_fits_a_path_that_is_as_long_as_its_way(share: float, fitting: bool) -> None:
    speed, deceleration = 3.0, 2.0
    path = straight(share * speed**2 / (2.0 * deceleration), speed)
    assert fits(EvenBraking(deceleration).stop_now(path, at_speed(speed))) is fitting


def test_who_stands_goes_on_standing() -> None:
    stop = EvenBraking(2.0).stop_now(straight(5.0, 0.0), at_speed(0.0))
    assert np.all(at(stop, np.linspace(0.0, stop.travel_time, 20)) == 0.0)
    assert standing_from(stop) == 0.0 and fits(stop)


@pytest.mark.parametrize("spans", [2, 5])
def test_a_later_stop_keeps_the_deceleration_until_it_stands(spans: int) -> None:
    """A cruise of 20 s at 3 m/s in spans of 1 s: 1.5 s of braking, so 1 m/s is left after the first span."""
    cruise = Trajectory(straight(60.0, 3.0), np.zeros(20), 20.0)
    stop = EvenBraking(2.0).stop_after(cruise, spans)
    assert stop is not None
    expected = np.zeros(20)
    expected[spans : spans + 2] = [-2.0, -1.0]
    assert stop.beta == pytest.approx(expected, abs=1e-12)
    assert stop.speed_at(np.arange(21) / 20.0)[spans : spans + 3] == pytest.approx([3.0, 1.0, 0.0], abs=1e-9)
    assert standing_from(stop) == pytest.approx(spans + 2.0)


def test_room_to_stop_is_the_gap_that_is_left() -> None:
    """At 3 m/s towards a post: the gap after the lead and the braking distance, nothing where the path ends first."""
    scenario = scene(disc("post", (9.0, 0.0), radius=0.5))
    zones = ZoneBatch.of(sp.zones(scenario), FRAME, 0.3)
    cruise = Trajectory(straight(12.0, 3.0), np.zeros(20), 4.0)
    leads = np.array([1.7, 1.8, 1.9, 3.5])
    room = EvenBraking(2.0).room(cruise, leads, zones)
    gap = 9.0 - 0.8 - (3.0 * leads + 9.0 / 4.0)
    assert 0.0 < gap[2] < gap[0] < 1.0 and gap[3] < 0.0
    near = gap[:3] < 0.5  # farther ones need not be exact
    assert room[:3][near] == pytest.approx(gap[:3][near], abs=1e-9) and np.all(room[:3][~near] >= 0.5)
    assert room[3] == -np.inf
    free = EvenBraking(2.0).room(cruise, leads, zones.subset(np.zeros(0, dtype=np.intp)))
    assert np.array_equal(free, [np.inf, np.inf, np.inf, -np.inf])


def test_a_straight_stop_goes_where_the_vehicle_heads() -> None:
    scenario = scene()
    limits = Limits.of(scenario, 0.0)
    state = State(7.0, (2.0, -1.0), 0.6, 2.4)
    stop = straight_stop(state, EvenBraking(limits.deceleration), Settings(), BREAKS)
    end = stop.frame.to_world(stop.at(np.array([7.0 + 2.4 / limits.deceleration]))[0].path.position)[0]
    way = 2.4**2 / (2.0 * 2.0)
    assert end == pytest.approx([2.0 + way * np.cos(0.6), -1.0 + way * np.sin(0.6)], abs=1e-9)


def test_stop_needs_spans_to_stop_in() -> None:
    assert EvenBraking(2.0).stop_after(Trajectory(straight(60.0, 3.0), np.zeros(20), 20.0), 19) is None


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
