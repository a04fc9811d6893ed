"""Which trips may be driven: with a plain straight drive at 2 m/s, of which every answer is known beforehand."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.certificate.verdict import Certificate
from scp_planner.online.following import Following
from scp_planner.online.means import Replan
from scp_planner.online.planner import Planner
from scp_planner.online.remaining import State
from scp_planner.online.vetting import Moment, Refusal, Stop, Vetted, Vetting
from scp_planner.problem.build import build_problem
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics

SPEED = 2.0
PERIOD = 0.5
BREAKS = tuple(np.linspace(0.0, 1.0, 21).tolist())  # spans of half a second


def vetted(*obstacles: dict[str, Any], stops_will_do: bool, acceleration: float = 0.0) -> Vetted | Refusal:
    """What is said of driving 20 m straight on."""
    scenario = scene(*obstacles, start={"speed": SPEED})
    zones = sp.zones(scenario)
    problem = build_problem(scenario, zones, Settings(acceleration_degree=0), BREAKS)
    space = problem.space
    trajectory = Trajectory.of(space, np.zeros(space.path_size), np.full(space.acceleration_size, acceleration))
    state = State(0.0, (0.0, 0.0), 0.0, SPEED)
    return Vetting(PERIOD, stops_will_do, Following(scenario.vehicle, 0.0)).vet(
        Moment(state, scenario, zones), problem, trajectory
    )


@pytest.mark.parametrize("stops_will_do", [False, True])
@pytest.mark.parametrize("side", [0.81, 5.0])
def test_a_trip_that_passes_clear_may_be_driven_to_the_goal(stops_will_do: bool, side: float) -> None:
    """The bodies' radii add up to 0.8 m."""
    answer = vetted(disc("post", (10.0, side)), stops_will_do=stops_will_do)
    assert isinstance(answer, Vetted) and answer.certified and answer.stop is None
    assert answer.arrival == pytest.approx(20.0 / SPEED)


def test_a_trip_into_an_obstacle_may_be_driven_only_as_far_as_a_stop() -> None:
    post = disc("post", (10.0, 0.79))
    refused = vetted(post, stops_will_do=False)
    assert isinstance(refused, Refusal) and "post" in refused.why
    answer = vetted(post, stops_will_do=True)
    assert isinstance(answer, Vetted) and answer.stop is not None and not answer.certified
    assert PERIOD <= answer.stop.branch < answer.stop.stands
    stands = answer.stop.trip.frame.to_world(answer.stop.trip.at(np.array([answer.stop.stands]))[0].path.position)[0]
    assert np.hypot(*(stands - [10.0, 0.79])) > 0.8
    assert answer.stop.stands - answer.stop.branch == pytest.approx(1.0, abs=1e-6)  # from 2 m/s at 2 m/s2


@pytest.mark.parametrize(("gap", "stops"), [(1.95, False), (2.05, True)])
def test_a_stop_needs_the_next_period_and_the_braking_distance(gap: float, stops: bool) -> None:
    """2 m/s for half a second and v^2 / 2 d = 1 m: 2 m, and not less, are needed in front of the vehicle."""
    answer = vetted(disc("wall", (gap + 0.8, 0.0)), stops_will_do=True)
    assert isinstance(answer, Vetted) is stops
    if isinstance(answer, Refusal):
        assert "wall" in answer.why or "stop" in answer.why


@pytest.mark.parametrize(("acceleration", "kept"), [(0.12, True), (0.13, False)])
def test_a_trip_above_the_top_speed_is_refused_whole(acceleration: float, kept: bool) -> None:
    """It is 3 m/s; after 20 m the speed is sqrt(4 + 40 a), so a = 0.125 m/s2 reaches it."""
    answer = vetted(stops_will_do=False, acceleration=acceleration)
    assert isinstance(answer, Vetted) is kept
    if isinstance(answer, Refusal):
        assert "speed" in answer.why


@pytest.mark.parametrize("gap", [0.0, 1.0, 1.9])
def test_a_refusal_tells_how_deep_the_best_stop_is_inside(gap: float) -> None:
    """It stands 2 m farther on, and what is beyond the middle of the obstacle is nearer to its far side."""
    answer = vetted(disc("wall", (gap + 0.8, 0.0)), stops_will_do=True)
    assert isinstance(answer, Refusal)
    assert answer.room == pytest.approx(gap - 2.0 if gap > 1.2 else -0.8, abs=0.08)  # of samples


@pytest.mark.parametrize(("wall", "slower", "certified"), [(1.6, False, 0), (1.6, True, 0), (9.0, False, 1)])
def test_stops_that_do_not_stay_clear_are_not_certified(
    wall: float, slower: bool, certified: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As samples tell: not even the one that leaves a trip where that of the last plan did, which comes first."""
    planner = Planner(scene(disc("wall", (wall, 0.0)), start={"speed": SPEED}))
    planner.replan(0.0, (0.0, 0.0), 0.0, SPEED)
    means, last, tried = planner._means, planner._last, []
    assert last is not None
    certify = Vetting.certify_stop

    def counted(self: Vetting, *given: Any) -> Certificate:
        tried.append(given)
        return certify(self, *given)

    monkeypatch.setattr(Vetting, "certify_stop", counted)
    state = State(0.0, (0.0, 0.0), 0.0, SPEED / planner._units.speed)
    now = Replan(means.moment(state), 0.0, np.inf, replace(last, branch_time=1.0 / planner._units.time), 1)
    problem = means.problem(now)
    space = problem.space
    onward = Trajectory.of(space, np.zeros(space.path_size), np.zeros(space.acceleration_size))
    vet = partial(means.vet, branch=np.inf) if slower else means.vet
    answer = vet(now, problem, onward)
    assert len(tried) == certified
    assert isinstance(answer, Refusal) if not certified else isinstance(answer, Vetted) and answer.stop is not None
    assert not certified or tried[0][1].branch == pytest.approx(1.0 / planner._units.time, rel=0.3)


@pytest.mark.parametrize(("ahead", "certified"), [(0.0, 0), (4.0, 1)])
def test_a_stop_that_somebody_has_come_into_is_not_certified_again(
    ahead: float, certified: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where it stands, or that much farther on; the stop was made where nobody was."""
    answer = vetted(disc("post", (15.0, 0.0)), stops_will_do=True)
    assert isinstance(answer, Vetted) and answer.stop is not None
    (x, y) = answer.trip.frame.to_world(answer.stop.trip.at(np.array([answer.stop.stands]))[0].path.position)[0]
    scenario = scene(disc("post", (x + ahead, y)), start={"speed": SPEED})
    tried, certify = [], Vetting.certify_stop

    def counted(self: Vetting, *given: Any) -> Certificate:
        tried.append(given)
        return certify(self, *given)

    monkeypatch.setattr(Vetting, "certify_stop", counted)
    now = Moment(State(0.0, (0.0, 0.0), 0.0, SPEED), scenario, sp.zones(scenario))
    kept = Vetting(PERIOD, True, Following(scenario.vehicle, 0.0)).vet_kept_stop(now, answer.trip, answer.stop)
    assert len(tried) == certified and (kept is not None) is bool(certified)


@pytest.mark.parametrize("side", [0.3, 0.79, 2.0])
def test_the_most_room_of_the_stops_is_that_of_one_that_is_sampled_densely(side: float) -> None:
    """Each keeps to the trip up to the end of a span, and then brakes: all on the line that the trip is."""
    scenario = scene(disc("post", (4.0, side)), start={"speed": SPEED})
    zones = sp.zones(scenario)
    problem = build_problem(scenario, zones, Settings(acceleration_degree=0), BREAKS)
    space = problem.space
    trip = Trip(problem.frame, Trajectory.of(space, np.zeros(space.path_size), np.zeros(space.acceleration_size)))
    moment = Moment(State(0.0, (0.0, 0.0), 0.0, SPEED), scenario, zones)
    ends = SPEED * np.arange(PERIOD, PERIOD + 3.01, 0.5) + 0.5 * SPEED**2 / scenario.vehicle.max_deceleration
    rooms = [np.hypot(np.linspace(0.0, end, 2001) - 4.0, side).min() - 0.8 for end in ends]
    found = Vetting(PERIOD, True, Following(scenario.vehicle, 0.0)).most_room(moment, trip)
    assert max(rooms) - 1e-9 <= found <= max(rooms) + 0.02


def test_there_is_no_room_where_the_trip_ends_before_a_stop() -> None:
    scenario = scene(start={"speed": SPEED})
    zones = sp.zones(scenario)
    problem = build_problem(scenario, zones, Settings(acceleration_degree=0), BREAKS)
    space = problem.space
    trip = Trip(problem.frame, Trajectory.of(space, np.zeros(space.path_size), np.zeros(space.acceleration_size)))
    moment = Moment(State(0.0, (0.0, 0.0), 0.0, SPEED), scenario, zones)
    assert Vetting(20.0, True, Following(scenario.vehicle, 0.0)).most_room(moment, trip) == -np.inf


@pytest.mark.parametrize(("acceleration", "tried"), [(0.3, 1), (1.6, 0)])
def test_no_stop_is_tried_that_leaves_the_trip_after_what_it_must_not_do(
    acceleration: float, tried: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The limit is 1.5 m/s2: what exceeds it from the beginning on cannot be left before."""
    stops, certify = list[Stop](), Vetting.certify_stop

    def noted(self: Vetting, now: Moment, stop: Stop, since: float | None) -> Certificate:
        stops.append(stop)
        return certify(self, now, stop, since)

    monkeypatch.setattr(Vetting, "certify_stop", noted)
    answer = vetted(disc("aside", (10.0, 1.2)), stops_will_do=True, acceleration=acceleration)
    assert len(stops) == tried
    if tried:
        assert isinstance(answer, Vetted) and answer.stop is stops[0]
    else:
        assert isinstance(answer, Refusal) and answer.why.endswith("; no stop from it: none leaves it before that")
        assert "acceleration 1.6 m/s2 at t = 0.000 s" in answer.why
