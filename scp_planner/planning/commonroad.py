"""From a CommonRoad file to the plan that a solution is written of: the best of what its goal leaves open."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf
from os import PathLike
from time import perf_counter

from scp_planner.planning.offline import plan
from scp_planner.planning.plan import Plan
from scp_planner.scenario.commonroad import read_commonroad, scenario_of
from scp_planner.scenario.commonroad_goals import GoalAim, GoalState
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.planning import Settings

TIMED_WAYS = (0.8, 0.6, 1.0, 0.4, 1.3)
"""Of the way that a vehicle drives at the speed of its start: where on it goals of time alone are tried, in turn. None
is sooner than another; to fall back a little is the easiest in traffic."""

DEPTHS = (0.5, 1.0)
"""How far into a goal's region, where it is not reached as soon as it may be."""

SHARE = 0.5
"""Of the time that is left, that one trial is given: others may do."""

QUICK_RUNS, QUICK_SEARCHES = 2, 4
"""Settings of a look at an aim that is one of several."""

SPAN = 0.65
"""Lengths of the vehicle, of a span of the offset's spline: what drives fast bends slowly."""

SHORTEST_SPAN = 0.15
"""Units of length of the scene, of a span: on very long roads those of the vehicle's length would be too many."""


@dataclass(frozen=True)
class CommonRoadPlan:
    """A plan and what it is a plan of.

    Attributes
    ----------
    scenario : Scenario
    plan : Plan
    """

    scenario: Scenario
    plan: Plan


def plan_commonroad(
    path: str | PathLike[str],
    *,
    model: str = "PM",
    car: str | None = None,
    problem: int | None = None,
    settings: Settings | None = None,
    time_limit: float | None = None,
) -> CommonRoadPlan:
    """Plan a problem of a CommonRoad file for one of the benchmark's models.

    Of several goal states the one that is reached first counts. A region that cannot be reached where the road first
    comes into it is tried farther in. A goal of time alone is a place on the lane that can be reached in time.

    Parameters
    ----------
    path : path
        XML file.
    model, car, problem
        As in `load_commonroad`.
    settings : Settings, optional
        Default: `road_settings`.
    time_limit : float, optional
        Wall time in s for all of it, after which the best plan so far is returned.

    Returns
    -------
    CommonRoadPlan

    Raises
    ------
    ScenarioError, ValueError, ImportError, OSError
        As `load_commonroad`.
    """
    file = read_commonroad(path, problem)
    deadline = inf if time_limit is None else perf_counter() + time_limit
    best: CommonRoadPlan | None = None
    for number, state in enumerate(file.goal_states()):
        for trial in _trials(number, state):
            left = SHARE * (deadline - perf_counter())
            if best is not None and left <= 0.0:
                break
            scenario = scenario_of(file, model=model, car=car, aim=trial.aim)
            own = settings or road_settings(scenario)
            if trial.quick:
                own = replace(own, max_runs=QUICK_RUNS, searches=QUICK_SEARCHES)
            made = CommonRoadPlan(scenario, plan(scenario, own, time_limit=None if left == inf else left))
            best = made if best is None or _better(made.plan, best.plan) else best
            if made.plan.certified:
                break
    assert best is not None, "there is a goal state, or it has been refused"
    return best


@dataclass(frozen=True)
class _Trial:
    """What is planned for, and whether it is only looked at."""

    aim: GoalAim
    quick: bool


def _trials(number: int, state: GoalState) -> Iterator[_Trial]:
    """What is tried in turn for a goal state, until something is certified."""
    if state.places:
        yield _Trial(GoalAim(number), quick=False)
        if state.heading is not None:
            yield _Trial(GoalAim(number, turn=inf), quick=True)
        for depth in DEPTHS:
            yield _Trial(GoalAim(number, depth=depth), quick=True)
        return
    for quick in (True, False):
        for way in TIMED_WAYS:
            yield _Trial(GoalAim(number, timed_way=way), quick)


def road_settings(scenario: Scenario) -> Settings:
    """Return settings for a vehicle on a road.

    Parameters
    ----------
    scenario : Scenario

    Returns
    -------
    Settings
    """
    discs = scenario.vehicle.discs
    wanted = SPAN * (max(discs) - min(discs) + 2.0 * scenario.vehicle.radius)
    return Settings(path_span=max(wanted, SHORTEST_SPAN * NaturalUnits.of(scenario).length))


def _better(one: Plan, other: Plan) -> bool:
    """Certified before not certified, then sooner."""
    return (not one.certified, one.arrival_time) < (not other.certified, other.arrival_time)
