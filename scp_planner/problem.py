"""One planning problem, ready to be solved: splines, limits, zones and end conditions in the planning frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt, tan

import numpy as np
from numpy.typing import NDArray

from scp_planner.frames import PlanningFrame
from scp_planner.guide import Guide, StraightGuide
from scp_planner.scenario import Scenario
from scp_planner.settings import Settings
from scp_planner.trajectory import TimeTable, TripSpace
from scp_planner.zones import ThreatZone, ZoneBatch

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Limits:
    """Limits of the vehicle as planned with: the scenario's, less the margin; inf where there is none.

    Attributes
    ----------
    speed : float
        m/s.
    acceleration, deceleration : float
        m/s^2, both positive.
    lateral_acceleration : float
        m/s^2.
    curvature : float
        1/m.
    """

    speed: float
    acceleration: float
    deceleration: float
    lateral_acceleration: float
    curvature: float

    @classmethod
    def of(cls, scenario: Scenario, margin: float = 0.0) -> Limits:
        """Return the limits of a scenario's vehicle, each reduced by a relative margin."""
        vehicle, keep = scenario.vehicle, 1.0 - margin
        return cls(
            vehicle.max_speed * keep,
            vehicle.max_acceleration * keep,
            vehicle.max_deceleration * keep,
            np.inf if vehicle.max_lateral_acceleration is None else vehicle.max_lateral_acceleration * keep,
            np.inf if vehicle.max_curvature is None else vehicle.max_curvature * keep,
        )


@dataclass(frozen=True)
class EndConditions:
    """Which control points of the offset are fixed, and the wanted speed at the goal.

    Attributes
    ----------
    theta : (K1,) array
        Fixed values where ``free`` excludes them, m.
    free : slice
        The free control points.
    goal_speed : float or None
        m/s.
    """

    theta: Array
    free: slice
    goal_speed: float | None


@dataclass(frozen=True)
class Box:
    """Half planes normal . r <= offset of the planning frame that the vehicle's reference point stays in.

    Attributes
    ----------
    normals : (S, 2) array
        Outward unit normals; S is 0 without a workspace box.
    offsets : (S,) array
        m, already less the vehicle's radius and the planner's margin.
    """

    normals: Array
    offsets: Array

    @classmethod
    def of(cls, scenario: Scenario, frame: PlanningFrame, margin: float) -> Box:
        """Return the workspace box of a scenario, in the planning frame."""
        if scenario.bounds is None:
            return cls(np.zeros((0, 2)), np.zeros(0))
        keep = scenario.vehicle.radius + margin
        world = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        low, high = scenario.bounds.min, scenario.bounds.max
        offsets = np.array([high[0], -low[0], high[1], -low[1]]) - keep
        return cls(world @ frame.rotation, offsets - world @ np.asarray(frame.origin))


@dataclass(frozen=True)
class Problem:
    """A scenario made ready for planning.

    Attributes
    ----------
    scenario : Scenario
    settings : Settings
    frame : PlanningFrame
    space : TripSpace
    ends : EndConditions
    limits : Limits
        With the planner's margin.
    zones : ZoneBatch
        Inflated by the vehicle's radius and the planner's margin.
    box : Box
    samples : TimeTable
        Times at which constraints are looked at: equidistant ones, then the breakpoints of the acceleration.
    grid : int
        How many of them are equidistant.
    """

    scenario: Scenario
    settings: Settings
    frame: PlanningFrame
    space: TripSpace
    ends: EndConditions
    limits: Limits
    zones: ZoneBatch
    box: Box
    samples: TimeTable
    grid: int

    @property
    def step_size(self) -> int:
        """Number of variables of a step: free offsets, accelerations, and rho."""
        return self.ends.free.stop - self.ends.free.start + self.space.acceleration_size + 1

    def tightened(self, zone_inflation: Array, lateral: float, curvature: float, box: float) -> Problem:
        """Return the same problem with larger zones, lower limits and a smaller box.

        Parameters
        ----------
        zone_inflation : (L,) array
            m, added to each zone.
        lateral, curvature : float
            Relative reductions of the limits.
        box : float
            m, taken off each side of the workspace box.
        """
        limits = replace(
            self.limits,
            lateral_acceleration=self.limits.lateral_acceleration * (1.0 - lateral),
            curvature=self.limits.curvature * (1.0 - curvature),
        )
        return replace(
            self,
            limits=limits,
            zones=self.zones.inflated(zone_inflation),
            box=replace(self.box, offsets=self.box.offsets - box),
        )


def straight_travel_time(
    length: float, start_speed: float, limits: Limits, goal_speed: float | None = None
) -> tuple[float, tuple[float, ...]]:
    """Shortest time to drive a length: accelerate, cruise, and decelerate to the goal speed if there is one.

    Parameters
    ----------
    length : float
        m.
    start_speed, goal_speed : float
        m/s; None: free.

    Returns
    -------
    (time, switches)
        Seconds, and the times in s at which the acceleration changes.
    """
    a, d, top = limits.acceleration, limits.deceleration, max(limits.speed, start_speed)
    end = goal_speed
    # The peak speed that uses up the length: (vp^2 - v0^2) / 2a + (vp^2 - ve^2) / 2d = length
    if end is None:
        peak = sqrt(start_speed**2 + 2.0 * a * length)
    else:
        peak = sqrt(max((2.0 * a * d * length + d * start_speed**2 + a * end**2) / (a + d), 0.0))
    peak = max(min(peak, top), start_speed)
    rise = (peak - start_speed) / a
    fall = 0.0 if end is None else max(peak - end, 0.0) / d
    driven = (peak**2 - start_speed**2) / (2 * a) + (0.0 if end is None else (peak**2 - end**2) / (2 * d))
    cruise = max(length - driven, 0.0) / peak
    return rise + cruise + fall, (rise, rise + cruise)


def build_problem(
    scenario: Scenario,
    zones: tuple[ThreatZone, ...],
    settings: Settings,
    breakpoints: tuple[float, ...] | None = None,
) -> Problem:
    """Make a scenario ready for planning.

    Parameters
    ----------
    scenario : Scenario
    zones : tuple of ThreatZone
        One an obstacle.
    settings : Settings
    breakpoints : tuple of float, optional
        Of the acceleration, in normalised time: the same ones for many problems share their tables.
    """
    start, goal = scenario.start, scenario.goal
    frame = PlanningFrame.between(start.position, goal.position, start.time)
    guide: Guide = StraightGuide(float(np.hypot(*np.subtract(goal.position, start.position))))
    limits = Limits.of(scenario, settings.limit_margin)
    if breakpoints is None:
        time, switches = straight_travel_time(guide.length, start.speed, limits, goal.speed)
        breakpoints = acceleration_breakpoints(settings.acceleration_spans, tuple(s / time for s in switches))
    space = TripSpace(
        guide,
        start.speed,
        settings.path_degree,
        max(4, round(guide.length / settings.path_span)),
        settings.acceleration_degree,
        breakpoints,
    )
    inflation = scenario.vehicle.radius + settings.clearance_margin
    return Problem(
        scenario,
        settings,
        frame,
        space,
        _end_conditions(scenario, frame, space),
        limits,
        ZoneBatch(zones, frame, inflation),
        Box.of(scenario, frame, settings.box_margin),
        space.time_table(
            np.concatenate([np.linspace(0.0, 1.0, settings.samples + 1), space.acceleration.breakpoints[1:-1]])
        ),
        settings.samples + 1,
    )


def acceleration_breakpoints(spans: int, switches: tuple[float, ...]) -> tuple[float, ...]:
    """Equal spans of normalised time, the nearest inner breakpoint moved onto each switching time."""
    breaks = np.linspace(0.0, 1.0, spans + 1)
    for switch in switches:
        nearest = int(np.argmin(np.abs(breaks - switch)))
        if 0 < nearest < spans and 1e-3 < switch < 1 - 1e-3:
            breaks[nearest] = switch
    return tuple(float(value) for value in np.unique(np.round(breaks, 12)))


def _end_conditions(scenario: Scenario, frame: PlanningFrame, space: TripSpace) -> EndConditions:
    theta = np.zeros(space.path_size)
    first, last = 1, space.path_size - 1
    degree = space.path.coefficients.shape[1] - 1
    spans = len(space.path.widths)
    reach = space.length / (degree * spans)
    if scenario.start.heading is not None:
        theta[1] = reach * tan(scenario.start.heading - frame.heading)
        first = 2
    if scenario.goal.heading is not None:
        theta[-2] = -reach * tan(scenario.goal.heading - frame.heading)
        last -= 1
    return EndConditions(theta, slice(first, last), scenario.goal.speed)
