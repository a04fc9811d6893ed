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
    from scp_planner.planning.offline import plan as plan
    from scp_planner.planning.plan import Plan as Plan
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

_MODULE_OF = {
    "Bounds": "scenario.models",
    "Confidence": "scenario.models",
    "ConfidenceLevel": "scenario.models",
    "Course": "scenario.motions",
    "Disc": "scenario.shapes",
    "Ellipse": "scenario.shapes",
    "Estimate": "scenario.estimates",
    "EstimationError": "errors",
    "Future": "scenario.motions",
    "Futures": "scenario.motions",
    "Goal": "scenario.models",
    "Ground": "scenario.models",
    "Meeting": "planning.meeting",
    "Model": "scenario.models",
    "Motion": "scenario.motions",
    "Observations": "scenario.models",
    "Obstacle": "scenario.models",
    "Passage": "scenario.models",
    "OccupancyMap": "mathematics.occupancy",
    "OnlinePlan": "online.plan",
    "OnlineSettings": "settings.online",
    "Outcome": "online.plan",
    "ReasonCode": "online.reasons",
    "Plan": "planning.plan",
    "PlanError": "errors",
    "PolygonShape": "scenario.shapes",
    "Predictor": "online.predictor",
    "Rectangle": "scenario.shapes",
    "Planner": "online.planner",
    "Run": "simulation.run",
    "GiveWay": "settings.online",
    "Safety": "settings.online",
    "Scenario": "scenario.models",
    "SampledTrajectory": "trips.samples",
    "SamplesError": "errors",
    "ScenarioError": "errors",
    "ScpPlannerError": "errors",
    "Sensor": "simulation.sensors",
    "Settings": "settings.planning",
    "SpeedLimit": "scenario.models",
    "Start": "scenario.models",
    "TripVariables": "scp.given",
    "Vehicle": "scenario.models",
    "Follower": "simulation.setup",
    "SimulationSettings": "simulation.setup",
    "TooLargeError": "errors",
    "certify": "certificate.check",
    "estimate_motion": "tracking.maximum_likelihood",
    "lower_bound": "certificate.lower_bound",
    "load_map": "scenario.map_files",
    "meeting": "planning.meeting",
    "penalty_descent": "baseline.penalty_descent",
    "plan": "planning.offline",
    "save_map": "scenario.map_files",
    "simulate": "simulation.loop",
    "zones": "threat_zones.of_scenario",
}

__all__ = ["__version__", *_MODULE_OF]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
