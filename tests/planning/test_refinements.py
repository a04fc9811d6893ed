"""What a finer solve may gain is told by the trip that was found: splines get finer there, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import disc, drone, scene

import scp_planner as sp
from scp_planner.planning.checked import QUALITY
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.planning.sources.refinements import (
    REFINEMENT,
    Refinements,
    may_gain_by_spans,
    over_finer_path,
    over_other_breakpoints,
    with_short_spans,
)
from scp_planner.planning.sources.sides import Sides
from scp_planner.planning.starts import SCENE, OverGuide, Start, TripSearch
from scp_planner.planning.task import Task, new_log
from scp_planner.problem.build import build_problem
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

DRONE = NaturalUnits.of(drone(1, 1.2)).scenario(drone(1, 1.2))


def found_in(scenario: Scenario) -> ScpRun:
    search = TripSearch(CheckedRuns(Task(scenario, sp.zones(scenario), for_scene(Settings()))))
    search.sources = [Sides(search)]
    best = search.explore(Start(SCENE, OverGuide(search.runs)))
    assert best is not None
    return best


def refined(best: ScpRun, arrival_step: float | None = None) -> TripSearch:
    """Refine a trip, and nothing else."""
    task = replace(best.runs.task, arrival_step=arrival_step, log=new_log())
    search = TripSearch(CheckedRuns(task))
    search.best, search.sources = best, [Refinements(search)]
    search.explore(Start(SCENE, OverGuide(search.runs)))
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
    search = refined(among)
    assert search.best is not None and search.best.holds
    assert search.best.travel_time < (1.0 - REFINEMENT.notable) * among.travel_time
    assert len(search.best.trajectory.space.path.widths) >= 2 * len(among.trajectory.space.path.widths)


def test_where_the_bound_is_near_nothing_gets_finer() -> None:
    best = found_in(scene(disc("beside", (10.0, 1.0), radius=0.8)))
    search = refined(best)
    assert search.best is best
    assert search.log.iterations == 0


def test_a_trip_that_fails_by_far_is_not_tried_again_with_shorter_spans(among: ScpRun) -> None:
    trip = among.trajectory
    through = Trajectory.of(trip.space, np.zeros_like(trip.theta), trip.beta, trip.travel_time)
    run = among.runs.loop.run(through, 0)
    assert run.evaluation.worst_violation > QUALITY.hardly
    assert not may_gain_by_spans(among.runs.judged(run))


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
        before = CheckedRuns(Task(scenario, sp.zones(scenario), for_scene(settings or Settings())))
        after = with_short_spans(before, bends=False)
        found = after.problem.space.path.widths
        assert (after is before) == (len(found) == len(before.problem.space.path.widths))
        assert found == pytest.approx(np.full(len(found), 1.0 / len(found)))
        return len(found)

    usual = len(CheckedRuns(Task(scene(), (), for_scene(Settings()))).problem.space.path.widths)
    assert spans(91, 0.02) == 30 > usual
    assert spans(20, 0.02) == usual
    assert spans(91, 0.2) == usual
    assert spans(91, 0.02, Settings(path_span=1.6)) < usual
    assert spans(91, 0.02, Settings(max_path_spans=25)) == 25


def test_where_arrivals_count_in_steps_a_gain_within_one_is_none() -> None:
    best = found_in(scene(start={"speed": 1.0}, speed_limits=[{"from": 6.0, "to": 12.0, "speed": 1.0}]))
    assert best.holds
    alone, step = refined(best), 4.0 * best.travel_time  # the first step is far beyond the trip
    within = refined(best, arrival_step=step)
    assert alone.log.tried["drive with shorter spans"] > 0
    assert not within.log.tried["drive with shorter spans"]


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
