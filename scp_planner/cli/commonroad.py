"""Options of `plan` for solutions of CommonRoad's benchmark."""

from __future__ import annotations

import importlib.util
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scp_planner.batch.jobs import Method
from scp_planner.cli.options import COMMONROAD_SUFFIX, bad_option, check_target

if TYPE_CHECKING:
    from scp_planner.planning.commonroad import CommonRoadPlan
    from scp_planner.planning.plan import Plan


class Model(StrEnum):
    """Models of motion of the benchmark."""

    PM = "PM"
    KS = "KS"
    KST = "KST"


class Cost(StrEnum):
    """Cost functions of the benchmark."""

    JB1 = "JB1"
    SM1 = "SM1"
    WX1 = "WX1"


SolutionFile = Annotated[
    Path | None,
    typer.Option("--commonroad-solution", help="Plan for a model of CommonRoad, and write the solution file, XML."),
]
ModelName = Annotated[
    Model,
    typer.Option("--commonroad-model", help="PM: point mass; KS: kinematic single track; KST: with a trailer."),
]
CostName = Annotated[
    Cost, typer.Option("--commonroad-cost", help="What the solution is submitted for; plans are fast for each.")
]


def check_solution(target: Path | None, scenario_file: str, method: Method) -> None:
    """Refuse a solution file before planning that could not be written after it."""
    if target is None:
        return
    check_target("--commonroad-solution", target, scenario_file)
    if not scenario_file.lower().endswith(COMMONROAD_SUFFIX):
        raise bad_option("--commonroad-solution", target, f"needs a scenario of CommonRoad, not {scenario_file}")
    if method is not Method.SCP:
        raise bad_option("--method", method, "must be scp for a solution of CommonRoad")
    if importlib.util.find_spec("commonroad") is None:
        raise bad_option("SCENARIO", scenario_file, "needs commonroad-io: pip install 'scp-planner[commonroad]'")


def plan_solution(
    scenario_file: str, model: Model, values: dict[str, object], time_limit: float | None
) -> CommonRoadPlan:
    """Plan a problem of CommonRoad for a model, with some settings of one's own."""
    from dataclasses import replace

    from scp_planner.planning.commonroad import plan_commonroad, road_settings
    from scp_planner.scenario.commonroad import load_commonroad

    settings = None
    if values:
        settings = replace(road_settings(load_commonroad(scenario_file, model=model.value)), **values)  # type: ignore[arg-type]  # checked there
    return plan_commonroad(scenario_file, model=model.value, settings=settings, time_limit=time_limit)


def write_solution(made: Plan, scenario_file: str, target: Path, model: Model, cost: Cost) -> None:
    """Write the solution file of a certified plan; none of another."""
    from scp_planner.export.commonroad_solution import export_commonroad_solution

    if made.certified:
        export_commonroad_solution(made, scenario_file, target, model=model.value, cost=cost.value)
