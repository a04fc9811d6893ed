"""Problems from scenarios."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import dist

import numpy as np

from scp_planner.constraints.ends import end_conditions
from scp_planner.constraints.registry import constraints_of
from scp_planner.constraints.setup import Setup, begins_beyond, hardest_deceleration, kept_of_limits
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.tolerances import DECIMALS, to_digits
from scp_planner.problem.guides import default_guide, path_spans
from scp_planner.problem.memory import check_memory
from scp_planner.problem.problem import EACH_SHARE, Problem
from scp_planner.problem.profile import SpeedProfile, fastest_profile
from scp_planner.scenario.limits import Box, Limits, straight_travel_time
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.places import Line, Stretch, followed, limits_at, stretches
from scp_planner.scenario.units import changed
from scp_planner.settings.planning import SceneSettings, Settings, for_scene
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.guide import Guide
from scp_planner.trips.space import TripSpace

REACTION = (
    0.1  # units of time, for which a given acceleration at the start is kept where accelerations are piecewise constant
)
PROFILE_STEP = 0.02  # units of length, of the fastest drive along a guide with such limits
MOST_PROFILE_STEPS = 200_000  # they are longer on trips that would need more
SOON = 1e-3  # of the trip's time; equidistant breakpoints are not moved so near to its ends
SAME_SWITCH = 1e-9  # of the trip's time
SHARE_DECIMALS = 12  # of the trip's time, to which breakpoints are rounded


def build_problem(
    scenario: Scenario,
    zones: Sequence[ThreatZone],
    given: Settings,
    breakpoints: tuple[float, ...] | None = None,
    guide: Guide | None = None,
    spans: int | None = None,
) -> Problem:
    """Make a scenario, in its natural units, ready for planning among zones, one an obstacle."""
    start, goal, settings = scenario.start, scenario.goal, for_scene(given)
    if scenario.guide is None and 0.0 < dist(start.position, goal.position) <= goal.radius:
        # Near enough already, but not as fast or turned as it is to be: the guide has to lead somewhere
        scenario = changed(scenario, goal=changed(goal, radius=0.0))
        goal = scenario.goal
    if scenario.vehicle.max_jerk is not None and settings.acceleration_degree == 0:
        settings = replace(settings, acceleration_degree=1)  # accelerations that do not jump
    frame = PlanningFrame.between(start.position, goal.position, start.time)
    limits = Limits.of(scenario, settings.limit_margin).rounded()
    beyond = begins_beyond(scenario)
    if beyond:
        limits = replace(limits, deceleration=hardest_deceleration(scenario.vehicle))
    if guide is None:
        guide = default_guide(scenario, frame, limits, settings)
    slow = slow_stretches(scenario, frame, settings)
    shared = scenario.vehicle.max_total_acceleration is not None or scenario.vehicle.max_power is not None
    profile = _fastest_drive(guide, slow, scenario, limits) if slow or shared or beyond else None
    if breakpoints is None:
        breakpoints = _breakpoints(guide, profile, scenario, limits, settings)
    spans = spans or path_spans(guide, settings)
    check_memory(spans, len(breakpoints) - 1, settings.samples, 0)
    space = TripSpace(
        guide, to_digits(start.speed), settings.path_degree, spans, settings.acceleration_degree, breakpoints
    )
    ends = end_conditions(scenario, frame, space, settings.max_offset)
    batch = ZoneBatch.of(zones, frame, scenario.vehicle.radius + settings.clearance_margin).rounded()
    box = Box.of(scenario, frame, settings.box_margin)
    times = np.concatenate([np.linspace(0.0, 1.0, settings.samples + 1), space.acceleration.breakpoints[1:-1]])
    samples, grid = space.time_table(times), settings.samples + 1
    basis = (scenario, settings, frame, space, ends, limits, batch, box, samples, grid, slow)
    return Problem(*basis, constraints_of(Setup(*basis)), profile=profile)


def _breakpoints(
    guide: Guide, profile: SpeedProfile | None, scenario: Scenario, limits: Limits, settings: SceneSettings
) -> tuple[float, ...]:
    """Breakpoints of the acceleration: where the fastest drive along the guide switches, and at equal spans."""
    start = scenario.start
    if profile is None:
        time, switches = straight_travel_time(guide.length, start.speed, limits, scenario.goal.speed)
    else:
        time, switches = float(profile.times[-1]), profile.switches
    switches = _with_ramps(switches, scenario)
    breakpoints = acceleration_breakpoints(settings.acceleration_spans, tuple(s / time for s in switches))
    if start.acceleration is None or settings.acceleration_degree != 0:
        return breakpoints
    return tuple(sorted({*breakpoints, min(REACTION / time, 0.5 * breakpoints[1])}))


def slow_stretches(scenario: Scenario, frame: PlanningFrame, settings: SceneSettings) -> tuple[Stretch, ...]:
    """Return the speed limits by place in the planning frame, less the margins; a start at a limit keeps it."""
    start = scenario.start.speed
    keep, found = kept_of_limits(settings), stretches(scenario)
    lines = {part.line: Line(np.round(frame.to_frame(part.line.points), DECIMALS)) for part in found}
    return tuple(
        replace(part, line=lines[part.line], speed=min(max(part.speed * keep, start), part.speed)) for part in found
    )


def _fastest_drive(guide: Guide, slow: tuple[Stretch, ...], scenario: Scenario, limits: Limits) -> SpeedProfile:
    """Return the fastest drive along a guide that keeps to the limits of places."""
    count = min(max(2, round(guide.length / PROFILE_STEP)), MOST_PROFILE_STEPS)
    stations = np.linspace(0.0, guide.length, count + 1)
    positions = guide.frame(stations).position
    allowed = np.minimum(limits_at(slow, positions, followed(slow, positions)), limits.speed)
    start, goal, vehicle = scenario.start.speed, scenario.goal.speed, scenario.vehicle
    rise, fall, power = limits.acceleration, limits.deceleration, vehicle.max_power or np.inf
    if goal is None and scenario.goal.speed_range is not None and scenario.goal.speed_range[1] < limits.speed:
        goal = scenario.goal.speed_range[1]
    if vehicle.max_total_acceleration is not None:
        # What is driven across bends is not there for speeding up: each gets its share.
        share = EACH_SHARE * vehicle.max_total_acceleration
        rise, fall = min(rise, share), min(fall, share)
        curvature = np.maximum(np.abs(guide.frame(stations).curvature), share / limits.speed**2)
        allowed = np.minimum(allowed, np.sqrt(share / curvature))
    return fastest_profile(stations, allowed, start, goal, rise, fall, power)


def _with_ramps(switches: tuple[float, ...], scenario: Scenario) -> tuple[float, ...]:
    """The times at which an acceleration that may not jump begins and ends to change, in place of switching times."""
    vehicle = scenario.vehicle
    if vehicle.max_jerk is None:
        return switches
    half = 0.5 * max(vehicle.max_acceleration, vehicle.max_deceleration) / vehicle.max_jerk
    return tuple(switch + side for switch in switches for side in (-half, half))


def acceleration_breakpoints(spans: int, switches: Sequence[float]) -> tuple[float, ...]:
    breaks = np.linspace(0.0, 1.0, spans + 1)
    moved, further = set[int](), list[float]()
    for switch in switches:
        nearest = int(np.argmin(np.abs(breaks - switch)))
        if 0 < nearest < spans and nearest not in moved and SOON < switch < 1.0 - SOON:
            breaks[nearest] = switch
            moved.add(nearest)
        elif 0.0 < switch < 1.0:
            further.append(switch)
    apart = [switch for switch in further if np.abs(breaks - switch).min() > SAME_SWITCH]
    return tuple(float(value) for value in np.unique(np.round(np.concatenate([breaks, apart]), SHARE_DECIMALS)))
