"""Options of `plan` for solutions of CommonRoad's benchmark."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from scp_planner.batch.jobs import PlanningMethod
from scp_planner.cli.options import COMMONROAD_SUFFIX, bad_option, check_target
from scp_planner.cli.output import tell
from scp_planner.errors import ScenarioError

if TYPE_CHECKING:
    from scp_planner.formats.commonroad.planning import CommonRoadPlan
    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario
    from scp_planner.trips.samples import SampledTrajectory


@dataclass(frozen=True)
class SolutionOptions:
    file: Annotated[
        Path | None,
        typer.Option("--commonroad-solution", help="Plan for a model of CommonRoad, and write the solution file, XML."),
    ] = None
    model: Annotated[
        Literal["PM", "KS", "KST"],
        typer.Option("--commonroad-model", help="PM: point mass; KS: kinematic single track; KST: with a trailer."),
    ] = "PM"
    cost: Annotated[
        Literal["JB1", "SM1", "WX1"],
        typer.Option(
            "--commonroad-cost", help="JB1, SM1 or WX1, which the solution is submitted for; plans are fast for each."
        ),
    ] = "JB1"

    def check(self, scenario_file: str, method: PlanningMethod) -> None:
        """Refuse a solution file before planning that could not be written after it."""
        if self.file is None:
            return
        check_target("--commonroad-solution", self.file, scenario_file)
        if not scenario_file.lower().endswith(COMMONROAD_SUFFIX):
            raise bad_option("--commonroad-solution", self.file, f"needs a scenario of CommonRoad, not {scenario_file}")
        if method is not PlanningMethod.SCP:
            raise bad_option("--method", method, "must be scp for a solution of CommonRoad")
        if importlib.util.find_spec("commonroad") is None:
            raise bad_option("SCENARIO", scenario_file, "needs commonroad-io: pip install 'scp-planner[commonroad]'")

    def planned(self, scenario_file: str, values: dict[str, Any], time_limit: float | None) -> CommonRoadPlan:
        """Plan a problem of CommonRoad for the model, with some settings of one's own."""
        from scp_planner.formats.commonroad.planning import plan_commonroad, road_settings
        from scp_planner.formats.commonroad.reading import load_commonroad

        model, settings = self.model, None
        if values:
            settings = replace(road_settings(load_commonroad(scenario_file, model=model)), **values)
        return plan_commonroad(scenario_file, model=model, settings=settings, time_limit=time_limit)

    def write(self, made: Plan, scenario_file: str, *, quiet: bool) -> None:
        """Write the solution file of a certified plan, and say so; none of another."""
        from scp_planner.formats.commonroad.solution import export_commonroad_solution

        if not made.certified or self.file is None:
            return
        try:
            export_commonroad_solution(made, scenario_file, self.file, model=self.model, cost=self.cost)
        except ValueError as error:
            raise bad_option("--commonroad-solution", self.file, str(error)) from error
        if not quiet:
            model = f"model {self.model}, cost {self.cost}"
            tell(f"wrote {self.file}: a solution of {scenario_file} for CommonRoad's {model}")


def scenario_of(scenario_file: str, trip: Plan | SampledTrajectory) -> Scenario | None:
    """Load the scenario that a trip was planned for, if it is a plan for a model of CommonRoad."""
    from scp_planner.planning.plan import Plan

    if not isinstance(trip, Plan) or trip.commonroad is None or not scenario_file.lower().endswith(COMMONROAD_SUFFIX):
        return None
    from scp_planner.formats.commonroad.planning import scenario_planned

    try:
        return scenario_planned(scenario_file, trip)
    except ScenarioError:
        raise
    except ValueError as error:
        raise bad_option("FILE", trip.commonroad, f"of its plan for CommonRoad, {error}") from error
