"""Starts for any method: different ways round, and bows where there is none."""

from __future__ import annotations

import numpy as np
from scenes import CROSSERS, disc, scene

from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scenario.models import Scenario
from scp_planner.search.first_trips import bows
from scp_planner.search.starts import starts
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.of_scenario import zones


def problem_of(scenario: Scenario) -> Problem:
    return build_problem(scenario, zones(scenario), Settings(path_span=2.5, acceleration_spans=8, samples=80))


def test_starts_are_several_different_ways() -> None:
    found = list(starts(problem_of(scene(*CROSSERS)), 12))
    assert len(found) >= 3
    assert found[0][0] == min(estimate for estimate, _ in found)
    ends = {tuple(np.round(trajectory.theta, 3)) for _, trajectory in found}
    assert len(ends) == len(found)


def test_starts_are_bows_where_there_is_no_way() -> None:
    problem = problem_of(scene(disc("on-goal", (20.0, 0.5), radius=2.0)))
    found = list(starts(problem, 4))
    assert {estimate for estimate, _ in found} == {0.0}
    assert [start.travel_time for _, start in found] == [bow.travel_time for bow in bows(problem)]
