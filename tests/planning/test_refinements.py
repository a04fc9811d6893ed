"""What a finer solve may gain is told by the trip that was found: splines get finer there, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import disc, drone, scene

import scp_planner as sp
from scp_planner.planning.attempts import ATTEMPTS
from scp_planner.planning.refinements import (
    REFINEMENT,
    FinerDrive,
    FinerNearly,
    FinerPath,
    may_gain_by_spans,
    over_finer_path,
    over_other_breakpoints,
    refinements,
    with_short_spans,
)
from scp_planner.planning.runs import CheckedRuns, ScpRun, Task
from scp_planner.planning.trip_search import TripSearch
from scp_planner.planning.ways_round import ways_round
from scp_planner.problem.build import build_problem
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

DRONE = NaturalUnits.of(drone(1, 1.2)).scenario(drone(1, 1.2))


def searched(scenario: Scenario, arrival_step: float | None = None) -> TripSearch:
    task = Task(scenario, sp.zones(scenario), for_scene(Settings()), np.inf, arrival_step=arrival_step)
    search = TripSearch(CheckedRuns(task))
    search.walk(ways_round(search.runs))
    return search


def found_in(scenario: Scenario, arrival_step: float | None = None) -> ScpRun:
    best = searched(scenario, arrival_step).best
    assert best is not None
    return best


def going_on_from(best: ScpRun, arrival_step: float | None = None) -> TripSearch:
    search = TripSearch(CheckedRuns(replace(best.runs.task, arrival_step=arrival_step)))
    search.best = best
    return search


@pytest.fixture(scope="module")
def among() -> ScpRun:
    return found_in(DRONE)


def test_a_trip_over_twice_as_many_spans_is_the_very_same_trip(among: ScpRun) -> None:
    trip = among.trajectory
    basis = trip.space.acceleration
    spans = 2 * len(trip.space.path.widths)
    finer = build_problem(DRONE, (), Settings(), tuple(basis.breakpoints.tolist()), trip.space.guide, spans)
    again = over_finer_path(finer, trip)
    places = np.linspace(0.0, 1.0, 401)
    assert len(again.theta) == len(trip.theta) + spans // 2
    assert again.path.points(places).position == pytest.approx(trip.path.points(places).position, abs=1e-12)
    assert again.travel_time == pytest.approx(trip.travel_time, rel=1e-9)


def test_a_drone_gains_by_shorter_spans_and_tells_beforehand(among: ScpRun) -> None:
    assert among.holds
    assert may_gain_by_spans(among)
    search = going_on_from(among)
    search.walk([FinerPath(3, np.inf)])
    assert search.best is not None and search.best.holds
    assert search.best.travel_time < (1.0 - REFINEMENT.notable) * among.travel_time
    assert len(search.best.trajectory.space.path.widths) >= 2 * len(among.trajectory.space.path.widths)


def test_where_the_bound_is_near_nothing_gets_finer() -> None:
    best = found_in(scene(disc("beside", (10.0, 1.0), radius=0.8)))
    search = going_on_from(best)
    tried = search.tally.iterations
    search.walk(refinements(search.task))
    assert search.best is best
    assert search.tally.iterations == tried


def test_the_drive_gets_its_spans_before_the_path_gets_more_than_twice_as_many(among: ScpRun) -> None:
    """Else a path with ever more spans swerves for what a drive with too few of them loses."""
    *_, first, drive, again = refinements(among.runs.task)
    assert isinstance(first, FinerPath) and isinstance(drive, FinerDrive) and isinstance(again, FinerPath)
    search = going_on_from(among)
    search.walk([first])
    assert search.best is not None
    before = len(among.trajectory.space.path.widths)
    assert len(search.best.trajectory.space.path.widths) == 2 * before
    assert again.due(search) is (first.gained >= FinerPath.worth)


def test_a_trip_that_fails_by_far_is_not_tried_again_with_shorter_spans(among: ScpRun) -> None:
    trip = among.trajectory
    through = Trajectory.of(trip.space, np.zeros_like(trip.theta), trip.beta, trip.travel_time)
    run = among.runs.loop.run(through, 0)
    assert run.evaluation.worst_violation > ATTEMPTS.hardly
    assert not may_gain_by_spans(among.runs.judged(run))


def test_a_faster_trip_that_hardly_fails_is_mended_by_shorter_spans() -> None:
    """The way behind both discs needs turns that the usual spans make no trip of; the others lead far round."""
    obstacles = [
        disc("near", (2.9, 1.5), (0.58, -1.13), (0.42, 0.32), radius=0.66),
        disc("far", (2.27, 30.39), (0.32, -2.35), (0.47, -0.53), radius=0.8),
    ]
    goal = {"position": (18.29, -4.5), "speed": 0.99, "heading": -2.04}
    given = scene(*obstacles, goal=goal)
    search = searched(NaturalUnits.of(given).scenario(given))
    before, nearly = search.best, search.nearly
    assert before is not None and before.holds and nearly is not None
    assert nearly.travel_time < 0.9 * before.travel_time
    search.walk([FinerNearly(REFINEMENT.finer_paths, np.inf)])
    assert search.best is not None and search.best.holds
    assert search.best.travel_time < 0.9 * before.travel_time
    spans, usual = (len(one.trajectory.space.path.widths) for one in (search.best, nearly))
    assert spans >= 2 * usual


def test_a_trip_that_hardly_fails_and_is_no_faster_stays_as_it_is(among: ScpRun) -> None:
    search = going_on_from(among)
    search.nearly = among
    assert not FinerNearly(REFINEMENT.finer_paths, np.inf).due(search)


def test_work_on_a_better_trip_is_bounded(among: ScpRun) -> None:
    search = going_on_from(among)
    search.walk([FinerPath(3, search.tally.iterations - 1)])
    assert search.best is among


def test_more_spans_of_the_drive_begin_with_a_trip_that_arrives() -> None:
    """It stops at the goal: accelerations taken between other breakpoints may stop it before."""
    scenario = scene(start={"speed": 1.0}, goal={"speed": 0.0}, speed_limits=[{"from": 6.0, "to": 12.0, "speed": 1.0}])
    trip = found_in(scenario).trajectory
    for spans in (23, 47, 60):
        finer = build_problem(scenario, (), for_scene(Settings(acceleration_spans=spans)), guide=trip.space.guide)
        again = over_other_breakpoints(finer, trip)
        breaks = finer.space.acceleration.breakpoints
        assert again.travel_time == pytest.approx(trip.travel_time, rel=5e-3)
        assert again.speed_at(breaks) == pytest.approx(trip.speed_at(breaks), abs=0.05)


def test_many_small_zones_get_shorter_spans_and_few_or_large_ones_do_not() -> None:
    def spans(count: int, radius: float, settings: Settings | None = None) -> int:
        crossers = [disc(f"{k}", (20.0 * k / count, -3.5 * k / count), (0.0, 0.5), radius=radius) for k in range(count)]
        scenario = scene(*crossers[1:], vehicle={"radius": 0.02})
        before = CheckedRuns(Task(scenario, sp.zones(scenario), for_scene(settings or Settings()), np.inf))
        after = with_short_spans(before, bends=False)
        found = after.problem.space.path.widths
        assert (after is before) == (len(found) == len(before.problem.space.path.widths))
        assert found == pytest.approx(np.full(len(found), 1.0 / len(found)))
        return len(found)

    usual = len(CheckedRuns(Task(scene(), (), for_scene(Settings()), np.inf)).problem.space.path.widths)
    assert spans(91, 0.02) == 30 > usual
    assert spans(20, 0.02) == usual
    assert spans(91, 0.2) == usual
    assert spans(91, 0.02, Settings(path_span=1.6)) < usual
    assert spans(91, 0.02, Settings(max_path_spans=25)) == 25


def test_where_arrivals_count_in_steps_a_gain_within_one_is_none() -> None:
    scenario = scene(start={"speed": 1.0}, speed_limits=[{"from": 6.0, "to": 12.0, "speed": 1.0}])
    best = found_in(scenario)
    finer = FinerDrive(2, np.inf)
    search = going_on_from(best, arrival_step=0.3 * best.travel_time)  # the steps are at 0.9 and 1.2 times that
    assert search.best is best and best.holds
    for gain, worth in ((0.05, False), (0.11, True), (np.inf, True)):
        finer.hoped = gain * best.travel_time
        assert finer.promising(search, best) is worth
    finer.hoped = 0.0
    assert finer.promising(going_on_from(best), best), "without steps every gain counts"


def test_accelerations_over_steps_of_time_that_would_end_early_lead_to_the_goal() -> None:
    """Mean accelerations over whole seconds stop this vehicle before its goal: it ended in a ValueError."""
    scenario = Scenario(
        vehicle={
            "radius": 0.232080959,
            "max_speed": 3.679171684,
            "max_acceleration": 0.657218027,
            "max_deceleration": 5.776600229,
            "max_curvature_rate": 1.881952617,
        },
        start={
            "time": 0.0,
            "position": [197.217085819, 108.035235246],
            "heading": -1.138865163,
            "speed": 3.679171684,
            "acceleration": -0.627565719,
        },
        goal={
            "position": [241.89493001, 79.937428012],
            "heading": -1.848499974,
            "speed": 0.090671582,
            "arrival_step": 1.0,
        },
        speed_limits=[
            {
                "from": 26.944036973,
                "to": 39.125023898,
                "speed": 0.865445504,
                "line": [[192.516675348, 110.47512125], [215.116568786, 96.841183715], [250.903547565, 74.434020084]],
            }
        ],
    )
    found = sp.plan(scenario)
    assert found.certified
    assert found.travel_time == pytest.approx(round(found.travel_time), abs=0.01)
