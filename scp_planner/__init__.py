"""Plan the fastest safe trip of an unmanned vehicle among moving obstacles.

The public names are loaded when they are first used, so that importing the package stays quick.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scp_planner.certificate import certify as certify
    from scp_planner.constraints.given import TripVariables as TripVariables
    from scp_planner.errors import EstimationError as EstimationError
    from scp_planner.errors import PlanError as PlanError
    from scp_planner.errors import ScenarioError as ScenarioError
    from scp_planner.errors import ScpPlannerError as ScpPlannerError
    from scp_planner.estimation import estimate_motion as estimate_motion
    from scp_planner.lower_bound import lower_bound as lower_bound
    from scp_planner.online import OnlinePlan as OnlinePlan
    from scp_planner.online import OnlineSettings as OnlineSettings
    from scp_planner.online import Outcome as Outcome
    from scp_planner.online import Planner as Planner
    from scp_planner.online import Safety as Safety
    from scp_planner.penalty_descent import penalty_descent as penalty_descent
    from scp_planner.plan import Plan as Plan
    from scp_planner.planner import plan as plan
    from scp_planner.run import Run as Run
    from scp_planner.scenario import Bounds as Bounds
    from scp_planner.scenario import Confidence as Confidence
    from scp_planner.scenario import ConfidenceLevel as ConfidenceLevel
    from scp_planner.scenario import Course as Course
    from scp_planner.scenario import Disc as Disc
    from scp_planner.scenario import Ellipse as Ellipse
    from scp_planner.scenario import Goal as Goal
    from scp_planner.scenario import Model as Model
    from scp_planner.scenario import Motion as Motion
    from scp_planner.scenario import Observations as Observations
    from scp_planner.scenario import Obstacle as Obstacle
    from scp_planner.scenario import PolygonShape as PolygonShape
    from scp_planner.scenario import Rectangle as Rectangle
    from scp_planner.scenario import Scenario as Scenario
    from scp_planner.scenario import SpeedLimit as SpeedLimit
    from scp_planner.scenario import Start as Start
    from scp_planner.scenario import Vehicle as Vehicle
    from scp_planner.sensors import Sensor as Sensor
    from scp_planner.settings import Settings as Settings
    from scp_planner.simulation import Follower as Follower
    from scp_planner.simulation import simulate as simulate
    from scp_planner.zones import zones as zones

__version__ = "0.1.0"

_MODULE_OF = {
    "Bounds": "scenario",
    "Confidence": "scenario",
    "ConfidenceLevel": "scenario",
    "Course": "scenario",
    "Disc": "scenario",
    "Ellipse": "scenario",
    "EstimationError": "errors",
    "Goal": "scenario",
    "Model": "scenario",
    "Motion": "scenario",
    "Observations": "scenario",
    "Obstacle": "scenario",
    "OnlinePlan": "online",
    "OnlineSettings": "online",
    "Outcome": "online",
    "Plan": "plan",
    "PlanError": "errors",
    "PolygonShape": "scenario",
    "Rectangle": "scenario",
    "Planner": "online",
    "Run": "run",
    "Safety": "online",
    "Scenario": "scenario",
    "ScenarioError": "errors",
    "ScpPlannerError": "errors",
    "Sensor": "sensors",
    "Settings": "settings",
    "SpeedLimit": "scenario",
    "Start": "scenario",
    "TripVariables": "constraints.given",
    "Vehicle": "scenario",
    "Follower": "simulation",
    "certify": "certificate",
    "estimate_motion": "estimation",
    "lower_bound": "lower_bound",
    "penalty_descent": "penalty_descent",
    "plan": "planner",
    "simulate": "simulation",
    "zones": "zones",
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


class _Package(ModuleType):
    """Keeps `scp_planner.plan` and `scp_planner.zones` the functions, although modules bear these names too.

    The import machinery binds every imported submodule to its name in the package.
    `from scp_planner.plan import Plan` works all the same: it does not go by that name.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _MODULE_OF and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
