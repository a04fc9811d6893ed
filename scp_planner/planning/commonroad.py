"""From a CommonRoad file to the plan that a solution is written of: the best of what its goal leaves open."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from time import perf_counter

from scp_planner.planning.offline import plan
from scp_planner.planning.plan import Plan
from scp_planner.scenario.commonroad import read_commonroad, scenario_of
from scp_planner.scenario.commonroad_goals import GoalAim
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.planning import Settings

TIMED_WAYS = (1.0, 0.75, 0.5, 0.25, 1.3)
"""Of the way that a vehicle drives at the speed of its start: where on it goals of time alone are tried, in turn."""

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

    Of several goal states the one that is reached first counts. A goal of time alone is a place on the lane that can be
    reached in time, the farthest of a few.

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
    deadline = None if time_limit is None else perf_counter() + time_limit
    best: CommonRoadPlan | None = None
    for number, state in enumerate(file.goal_states()):
        for way in (1.0,) if state.places else TIMED_WAYS:
            left = None if deadline is None else deadline - perf_counter()
            if best is not None and left is not None and left <= 0.0:
                break
            scenario = scenario_of(file, model=model, car=car, aim=GoalAim(number, way))
            made = CommonRoadPlan(scenario, plan(scenario, settings or road_settings(scenario), time_limit=left))
            best = made if best is None or _better(made.plan, best.plan) else best
            if made.plan.certified:
                break
    assert best is not None, "there is a goal state, or it has been refused"
    return best


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
