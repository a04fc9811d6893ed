"""Plan the fastest safe trip of an unmanned vehicle among moving obstacles.

The public names are loaded when they are first used, so that importing the package stays quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scp_planner.baseline.penalty_descent import penalty_descent as penalty_descent
    from scp_planner.certificate.check import certify as certify
    from scp_planner.certificate.lower_bound import lower_bound as lower_bound
    from scp_planner.errors import EstimationError as EstimationError
    from scp_planner.errors import PlanError as PlanError
    from scp_planner.errors import SamplesError as SamplesError
    from scp_planner.errors import ScenarioError as ScenarioError
    from scp_planner.errors import ScpPlannerError as ScpPlannerError
    from scp_planner.errors import TooLargeError as TooLargeError
    from scp_planner.mathematics.occupancy import OccupancyMap as OccupancyMap
    from scp_planner.online.plan import OnlinePlan as OnlinePlan
    from scp_planner.online.plan import Outcome as Outcome
    from scp_planner.online.planner import Planner as Planner
    from scp_planner.online.predictor import Predictor as Predictor
    from scp_planner.online.reasons import ReasonCode as ReasonCode
    from scp_planner.planning.meeting import Meeting as Meeting
    from scp_planner.planning.meeting import meeting as meeting
    from scp_planner.planning.meeting import meetings as meetings
    from scp_planner.planning.plan import Plan as Plan
    from scp_planner.planning.plan_search import plan as plan
    from scp_planner.planning.search import Source as Source
    from scp_planner.planning.search import Tried as Tried
    from scp_planner.planning.task import Skeleton as Skeleton
    from scp_planner.scenario.estimates import Estimate as Estimate
    from scp_planner.scenario.map_files import load_map as load_map
    from scp_planner.scenario.map_files import save_map as save_map
    from scp_planner.scenario.models import Bounds as Bounds
    from scp_planner.scenario.models import Confidence as Confidence
    from scp_planner.scenario.models import ConfidenceLevel as ConfidenceLevel
    from scp_planner.scenario.models import Goal as Goal
    from scp_planner.scenario.models import Ground as Ground
    from scp_planner.scenario.models import Model as Model
    from scp_planner.scenario.models import Observations as Observations
    from scp_planner.scenario.models import Obstacle as Obstacle
    from scp_planner.scenario.models import Passage as Passage
    from scp_planner.scenario.models import Scenario as Scenario
    from scp_planner.scenario.models import SpeedLimit as SpeedLimit
    from scp_planner.scenario.models import Start as Start
    from scp_planner.scenario.models import Vehicle as Vehicle
    from scp_planner.scenario.motions import Course as Course
    from scp_planner.scenario.motions import Future as Future
    from scp_planner.scenario.motions import Futures as Futures
    from scp_planner.scenario.motions import Motion as Motion
    from scp_planner.scenario.shapes import Disc as Disc
    from scp_planner.scenario.shapes import Ellipse as Ellipse
    from scp_planner.scenario.shapes import PolygonShape as PolygonShape
    from scp_planner.scenario.shapes import Rectangle as Rectangle
    from scp_planner.scp.given import TripVariables as TripVariables
    from scp_planner.settings.online import GiveWay as GiveWay
    from scp_planner.settings.online import OnlineSettings as OnlineSettings
    from scp_planner.settings.online import Safety as Safety
    from scp_planner.settings.planning import Settings as Settings
    from scp_planner.simulation.loop import simulate as simulate
    from scp_planner.simulation.run import Run as Run
    from scp_planner.simulation.sensors import Sensor as Sensor
    from scp_planner.simulation.setup import Follower as Follower
    from scp_planner.simulation.setup import SimulationSettings as SimulationSettings
    from scp_planner.threat_zones.of_scenario import zones as zones
    from scp_planner.tracking.maximum_likelihood import estimate_motion as estimate_motion
    from scp_planner.trips.samples import SampledTrajectory as SampledTrajectory

__version__ = "0.1.0"

_NAMES_OF = {
    "baseline.penalty_descent": "penalty_descent",
    "certificate.check": "certify",
    "certificate.lower_bound": "lower_bound",
    "errors": "EstimationError PlanError SamplesError ScenarioError ScpPlannerError TooLargeError",
    "mathematics.occupancy": "OccupancyMap",
    "online.plan": "OnlinePlan Outcome",
    "online.planner": "Planner",
    "online.predictor": "Predictor",
    "online.reasons": "ReasonCode",
    "planning.meeting": "Meeting meeting meetings",
    "planning.plan_search": "plan",
    "planning.search": "Source Tried",
    "planning.task": "Skeleton",
    "planning.plan": "Plan",
    "scenario.estimates": "Estimate",
    "scenario.map_files": "load_map save_map",
    "scenario.models": "Bounds Confidence ConfidenceLevel Goal Ground Model Observations Obstacle Passage Scenario"
    " SpeedLimit Start Vehicle",
    "scenario.motions": "Course Future Futures Motion",
    "scenario.shapes": "Disc Ellipse PolygonShape Rectangle",
    "scp.given": "TripVariables",
    "settings.online": "GiveWay OnlineSettings Safety",
    "settings.planning": "Settings",
    "simulation.loop": "simulate",
    "simulation.run": "Run",
    "simulation.sensors": "Sensor",
    "simulation.setup": "Follower SimulationSettings",
    "threat_zones.of_scenario": "zones",
    "tracking.maximum_likelihood": "estimate_motion",
    "trips.samples": "SampledTrajectory",
}

_MODULE_OF = {name: module for module, names in _NAMES_OF.items() for name in names.split()}

__all__ = ["__version__", *_MODULE_OF]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
