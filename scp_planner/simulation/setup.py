"""Setup of a closed loop besides its scenario: following, sensing, the planner's settings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np

from scp_planner.planning.plan import Plan
from scp_planner.scenario.models import Model, Scenario
from scp_planner.scenario.shapes import Shape
from scp_planner.settings.online import OnlineSettings
from scp_planner.settings.planning import Settings
from scp_planner.simulation.sensors import Sensor
from scp_planner.simulation.worlds import Script, World, as_course, drawn_course
from scp_planner.solvers import QpSolver
from scp_planner.threat_zones.error_tube import TrackingTube


@dataclass(frozen=True)
class Follower:
    """Path following of the simulated vehicle.

    Attributes
    ----------
    tracking_error : float
        Largest distance from the plan, m.
    reaction_time : float
        From a replan to the moment from which its plan is followed, s.
    tube : TrackingTube, optional
        It stays in this, in place of the tracking error; the planner is told.
    """

    tracking_error: float = 0.0
    reaction_time: float = 0.0
    tube: TrackingTube | None = None

    def largest_error(self, plan: Plan, time: float) -> float:
        """Largest distance from where a plan has the vehicle at a time, s: m."""
        if self.tube is None:
            return self.tracking_error
        speed, curvature = float(plan.speed(time)), float(plan.curvature(time))
        lateral = min(speed**2 * abs(curvature), self.tube.max_lateral)
        return float(self.tube.radius(min(max(speed, 0.0), self.tube.max_speed), lateral))


@dataclass(frozen=True)
class SimulationSettings:
    """Choices of a closed loop besides its scenario, see :func:`scp_planner.simulate`.

    Attributes
    ----------
    world : World or mapping, optional
        What obstacles really do instead: an object with ``step``, or, by id, a function of times, a `Track`, or the
        arrays (times, centres). The planner is told of an obstacle when it is first seen.
    sensors : sequence of Sensor, optional
        Instead of one that sees everything at the loop's rate with its noise.
    follower : Follower, optional
        Default: a vehicle that follows its plan exactly and at once.
    settings : Settings, optional
        Of the planner's loop.
    online : OnlineSettings, optional
        Its ``period`` becomes that of the loop; unless it is given, its margin becomes that of the follower.
    solver : str or QpSolver, optional
    history : float, optional
        s of observations before the start. By default 10 units of time.
    deadline : float, optional
        Of each replan, s of wall time.
    time_limit : float, optional
        s after which the run ends.
    shapes : mapping, optional
        Shapes of a world's obstacles that are not in the scenario.
    model : Model, optional
        Of the motion of these.
    """

    world: World | Mapping[str, Any] | None = None
    sensors: Sequence[Sensor] | None = None
    follower: Follower | None = None
    settings: Settings | None = None
    online: OnlineSettings | None = None
    solver: str | QpSolver | None = None
    history: float | None = None
    deadline: float | None = None
    time_limit: float | None = None
    shapes: Mapping[str, Shape] | None = None
    model: Model | None = None


class SimulationChoices(TypedDict, total=False):
    """The fields of :class:`SimulationSettings` as keywords."""

    world: World | Mapping[str, Any] | None
    sensors: Sequence[Sensor] | None
    follower: Follower | None
    settings: Settings | None
    online: OnlineSettings | None
    solver: str | QpSolver | None
    history: float | None
    deadline: float | None
    time_limit: float | None
    shapes: Mapping[str, Shape] | None
    model: Model | None


def check_choices(noise: float, rate: float, history: float, seed: object) -> None:
    """Refuse numbers that are not allowed."""
    for name, value, positive in (("noise", noise, False), ("rate", rate, True), ("history", history, False)):
        if not (math.isfinite(value) and (value > 0.0 if positive else value >= 0.0)):
            raise ValueError(f"{name}: {value!r} must be finite and {'greater than' if positive else 'at least'} 0")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"seed: {seed!r} must be a whole number of at least 0")


def world_of(scenario: Scenario, world: World | Mapping[str, Any] | None, seed: int) -> World | Script:
    """The world that is given, or the one that a scenario tells of."""
    if world is None:
        rng = np.random.default_rng([seed, 0])
        return Script({obstacle.id: drawn_course(obstacle, rng) for obstacle in scenario.obstacles})
    if isinstance(world, Script):
        return world
    if isinstance(world, Mapping):
        return Script({name: as_course(course) for name, course in world.items()})
    if not hasattr(world, "step"):
        raise ValueError(f"world: {world!r} is neither a mapping nor an object with a step")
    return world
