"""One planning problem, ready to be solved: splines, limits, zones and end conditions in the planning frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi, remainder, sqrt, tan
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from scp_planner.constraints.discs import DiscBox, DiscClearance
from scp_planner.constraints.optional import EarliestArrival, OptionalLimit, SpeedLimits
from scp_planner.constraints.rates import CurvatureRateLimit, JerkLimit
from scp_planner.corridor import way_through
from scp_planner.dubins import Pose, shortest_path
from scp_planner.frames import PlanningFrame
from scp_planner.guide import CurvedGuide, Guide, StraightGuide, guide_through, smooth_guide
from scp_planner.places import Line, SpeedProfile, Stretch, fastest_profile, limits_at, stretches
from scp_planner.scenario import Scenario
from scp_planner.settings import Settings
from scp_planner.trajectory import CELLS_PER_SPAN, Path, TimeTable, TripSpace
from scp_planner.zone_batch import DECIMALS
from scp_planner.zones import ThreatZone, ZoneBatch

if TYPE_CHECKING:
    from scp_planner.constraints.given import GivenConstraints

Array = NDArray[np.float64]

STEEPEST = 1.05  # rad; where a heading differs by more from the direction to the goal, the guide is no straight line
STEEPEST_PATH = 1.4  # rad; largest angle between path and guide at the ends
ROOM_TO_TURN = 2.0  # guides are rounded with so many times the least radius of the vehicle
WIDE_BEND = 4.0  # and corners of polylines with up to so many times that
ANGLE_DECIMALS = 10  # of rad: what is planned with is rounded, see ZoneBatch.rounded
GOAL_SHARE = 0.95  # of the goal's radius: the guide ends before its centre, and the path anywhere beside that
INSIDE = 1e-6  # m, from the border of the goal
REACTION = 0.1  # s, for which a given acceleration at the start is kept where accelerations are piecewise constant
STEEP = (
    1.3  # m of path to a m of a straight guide; a path with more of it anywhere, 40 degrees, bends better over another
)
LEFT = 0.2  # spans of the offset; a path with larger offsets has left its guide
AT_LIMIT = 1e-3  # m; a control point that is nearer to its bound is held by it
LEAST_RADIUS, RELATIVE_RADIUS = 1.0, 0.1  # m, and of the distance to the goal: where the vehicle has none
OPTIONAL_MARGIN = 2.5e-4  # relative, of optional limits, besides the margin of all limits
PROFILE_STEP = 0.02  # m, of the fastest drive along a guide with such limits
EARLIEST_MARGIN = 5e-4  # s, by which the trip is planned to arrive later than it has to
STANDING = 1e-5  # m/s; a stop at the goal is planned with this: speeds below 0 are refused, however small
FOLD = 0.8  # of the guide's radius of curvature: largest offset to the inside
FOLD_LOOKS = 16  # stations to a span at which the guide's curvature is looked at


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
    lower, upper : (K1,) arrays
        Bounds of the control points, m: the largest offset, and less where the guide would fold; the last one stays
        within the radius of the goal.
    start_acceleration : float or None
        What the first control point of the acceleration is to be, m/s^2.
    """

    theta: Array
    free: slice
    goal_speed: float | None
    lower: Array
    upper: Array
    start_acceleration: float | None = None


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
        normals = np.round(world @ frame.rotation, ANGLE_DECIMALS)
        return cls(normals, np.round(offsets - world @ np.asarray(frame.origin), DECIMALS))


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
    optional : tuple of OptionalLimit
        Limits that only some scenarios have.
    given : GivenConstraints or None
        A user's own.
    profile : SpeedProfile or None
        The fastest drive along the guide, where places limit the speed.
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
    optional: tuple[OptionalLimit, ...] = ()
    given: GivenConstraints | None = None
    profile: SpeedProfile | None = None

    @cached_property
    def jumps(self) -> TimeTable:
        """Those of the samples that are breakpoints of the acceleration."""
        return self.samples.take(slice(self.grid, None))

    @cached_property
    def highest_accelerations(self) -> Array:
        """Upper bounds of the accelerations, (K2,) m/s^2; a given one at the start is its own."""
        return self._bounds(self.limits.acceleration)

    @cached_property
    def lowest_accelerations(self) -> Array:
        """Lower bounds of the accelerations, (K2,) m/s^2."""
        return self._bounds(-self.limits.deceleration)

    def _bounds(self, limit: float) -> Array:
        bounds = np.full(self.space.acceleration_size, limit)
        if self.ends.start_acceleration is not None:
            bounds[0] = self.ends.start_acceleration
        return bounds

    @property
    def step_size(self) -> int:
        """Number of variables of a step: free offsets, accelerations, and rho."""
        return self.ends.free.stop - self.ends.free.start + self.space.acceleration_size + 1

    def tightened(
        self,
        zone_inflation: Array,
        lateral: float,
        curvature: float,
        box: float,
        optional: Mapping[str, float] | None = None,
    ) -> Problem:
        """Return the same problem with larger zones, lower limits and a smaller box.

        Parameters
        ----------
        zone_inflation : (L,) array
            m, added to each zone.
        lateral, curvature : float
            Relative reductions of the limits.
        box : float
            m, taken off each side of the workspace box.
        optional : mapping of str to float
            What is added to the excess over optional limits, by name.

        Returns
        -------
        Problem
        """
        more = optional or {}
        zones = self.zones.inflated(zone_inflation)
        limits = replace(
            self.limits,
            lateral_acceleration=self.limits.lateral_acceleration * (1.0 - lateral),
            curvature=self.limits.curvature * (1.0 - curvature),
        )
        return replace(
            self,
            limits=limits,
            zones=zones,
            box=replace(self.box, offsets=self.box.offsets - box),
            optional=tuple(limit.tightened(more.get(limit.name, 0.0)).among(zones) for limit in self.optional),
        )

    def among(self, zones: ZoneBatch) -> Problem:
        """Return the same problem with other zones."""
        return replace(self, zones=zones, optional=tuple(limit.among(zones) for limit in self.optional))


def straight_travel_time(
    length: float, start_speed: float, limits: Limits, goal_speed: float | None = None
) -> tuple[float, tuple[float, ...]]:
    """Shortest time to drive a length: accelerate, cruise, and decelerate to the goal speed if there is one.

    Parameters
    ----------
    length : float
        m.
    start_speed : float
        m/s.
    limits : Limits
    goal_speed : float, optional
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
    zones: Sequence[ThreatZone],
    settings: Settings,
    breakpoints: tuple[float, ...] | None = None,
    guide: Guide | None = None,
) -> Problem:
    """Make a scenario ready for planning.

    Parameters
    ----------
    scenario : Scenario
    zones : sequence of ThreatZone
        One an obstacle.
    settings : Settings
    breakpoints : tuple of float, optional
        Of the acceleration, in normalised time: the same ones for many problems share their tables.
    guide : Guide, optional
        In the planning frame; by default the scenario's polyline, smoothed, or else what :func:`default_guide` gives.

    Returns
    -------
    Problem
    """
    start, goal = scenario.start, scenario.goal
    if scenario.vehicle.max_jerk is not None and settings.acceleration_degree == 0:
        settings = replace(settings, acceleration_degree=1)  # accelerations that do not jump
    frame = PlanningFrame.between(start.position, goal.position, start.time)
    limits = Limits.of(scenario, settings.limit_margin)
    if guide is None:
        guide = default_guide(scenario, frame, limits, settings)
    slow = _slow_stretches(scenario, frame, settings)
    profile = _fastest_drive(guide, slow, scenario, limits) if slow else None
    if breakpoints is None:
        time, switches = straight_travel_time(guide.length, start.speed, limits, goal.speed)
        if profile is not None:
            time, switches = float(profile.times[-1]), profile.switches
        breakpoints = acceleration_breakpoints(settings.acceleration_spans, tuple(s / time for s in switches))
        if start.acceleration is not None and settings.acceleration_degree == 0:
            breakpoints = tuple(sorted({*breakpoints, min(REACTION / time, 0.5 * breakpoints[1])}))
    space = TripSpace(
        guide,
        start.speed,
        settings.path_degree,
        path_spans(guide, settings),
        settings.acceleration_degree,
        breakpoints,
    )
    inflation = scenario.vehicle.radius + settings.clearance_margin
    ends = _end_conditions(scenario, frame, space, settings.max_offset)
    batch = ZoneBatch(zones, frame, inflation).rounded()
    box = Box.of(scenario, frame, settings.box_margin)
    samples = space.time_table(
        np.concatenate([np.linspace(0.0, 1.0, settings.samples + 1), space.acceleration.breakpoints[1:-1]])
    )
    optional = _optional_limits(scenario, space, ends, slow, settings.limit_margin)
    for offset in scenario.vehicle.discs:
        if offset != 0.0:
            optional += (DiscClearance(offset, ends.free, samples, batch),)
            if len(box.offsets):
                step_size = ends.free.stop - ends.free.start + space.acceleration_size + 1
                optional += (DiscBox(offset, ends.free, step_size, box.normals, box.offsets),)
    return Problem(
        scenario,
        settings,
        frame,
        space,
        ends,
        limits,
        batch,
        box,
        samples,
        settings.samples + 1,
        optional,
        profile=profile,
    )


def _slow_stretches(scenario: Scenario, frame: PlanningFrame, settings: Settings) -> tuple[Stretch, ...]:
    """Return the speed limits by place in the planning frame, less the margins."""
    keep = 1.0 - settings.limit_margin - OPTIONAL_MARGIN
    return tuple(
        replace(
            part,
            line=Line(np.round(frame.to_frame(part.line.points), DECIMALS)),
            speed=min(part.speed * keep, part.speed),
        )
        for part in stretches(scenario)
    )


def _fastest_drive(guide: Guide, slow: tuple[Stretch, ...], scenario: Scenario, limits: Limits) -> SpeedProfile:
    """Return the fastest drive along a guide that keeps to the limits of places."""
    stations = np.linspace(0.0, guide.length, max(2, round(guide.length / PROFILE_STEP)) + 1)
    allowed = np.minimum(limits_at(slow, guide.frame(stations).position), limits.speed)
    start, goal = scenario.start.speed, scenario.goal.speed
    return fastest_profile(stations, allowed, start, goal, limits.acceleration, limits.deceleration)


def _optional_limits(
    scenario: Scenario, space: TripSpace, ends: EndConditions, slow: tuple[Stretch, ...], margin: float
) -> tuple[OptionalLimit, ...]:
    """Return what a scenario asks for beyond what every trip keeps.

    A latest arrival is none of it: the trip is to be as fast as it may be anyway.
    """
    found: list[OptionalLimit] = []
    step_size = ends.free.stop - ends.free.start + space.acceleration_size + 1
    earliest = scenario.goal.earliest_arrival
    if earliest is not None and earliest > scenario.start.time:
        found.append(EarliestArrival(earliest - scenario.start.time + EARLIEST_MARGIN, step_size))
    if slow:
        found.append(SpeedLimits(space, ends.free, slow))
    vehicle, keep = scenario.vehicle, 1.0 - margin
    if vehicle.max_jerk is not None:
        free_size = step_size - space.acceleration_size - 1
        found.append(JerkLimit(space, free_size, vehicle.max_jerk * (keep - OPTIONAL_MARGIN)))
    if vehicle.max_curvature_rate is not None:
        limit = vehicle.max_curvature_rate * (keep - OPTIONAL_MARGIN)
        found.append(CurvatureRateLimit(space, ends.free, limit))
    return tuple(found)


def acceleration_breakpoints(spans: int, switches: tuple[float, ...]) -> tuple[float, ...]:
    """Equal spans of normalised time, the nearest inner breakpoint moved onto each switching time."""
    breaks = np.linspace(0.0, 1.0, spans + 1)
    for switch in switches:
        nearest = int(np.argmin(np.abs(breaks - switch)))
        if 0 < nearest < spans and 1e-3 < switch < 1 - 1e-3:
            breaks[nearest] = switch
    return tuple(float(value) for value in np.unique(np.round(breaks, 12)))


def path_spans(guide: Guide, settings: Settings) -> int:
    """Number of spans of the offset's spline: so that the pieces of a curved guide are the cells of the quadrature."""
    if isinstance(guide, CurvedGuide) and guide.pieces % CELLS_PER_SPAN == 0:
        return guide.pieces // CELLS_PER_SPAN
    return _spans(guide.length, settings, straight=guide.straight)


def _spans(length: float, settings: Settings, *, straight: bool) -> int:
    """Spans on a length, m; over a curved guide there are as many as its bends need."""
    wanted = round(length / settings.path_span)
    return max(4, min(wanted, settings.max_path_spans) if straight else wanted)


def default_guide(scenario: Scenario, frame: PlanningFrame, limits: Limits, settings: Settings) -> Guide:
    """Return the guide of a scenario, in the planning frame.

    It is the scenario's polyline, smoothed. Without one it is the straight line to the goal, or where that leaves the
    corridor, a polyline in it. Where the heading at an end differs from that line by more than can be done by offsets,
    it is the shortest path of a curvature somewhat below the limit.
    """
    start, goal = scenario.start, scenario.goal
    distance = round(float(np.hypot(*np.subtract(goal.position, start.position))), DECIMALS)
    if np.isfinite(limits.curvature):
        radius = ROOM_TO_TURN / limits.curvature
    else:
        radius = max(LEAST_RADIUS, RELATIVE_RADIUS * distance)
    piece = settings.path_span / CELLS_PER_SPAN
    short = round(GOAL_SHARE * goal.radius, DECIMALS)
    if scenario.guide is not None:
        # Offsets to the outside of a bend are easy, those to the inside are not: bends as wide as they may be driven.
        radius = max(radius, min(limits.speed**2 / limits.lateral_acceleration, WIDE_BEND * radius))
        polyline = _shortened(np.round(frame.to_frame(np.array(scenario.guide)), DECIMALS), short)
        return smooth_guide(polyline, radius, piece, CELLS_PER_SPAN)
    turns = [
        None if heading is None else round(remainder(heading - frame.heading, 2.0 * pi), ANGLE_DECIMALS)
        for heading in (start.heading, goal.heading)
    ]
    through = way_through(scenario.corridor, start.position, goal.position) if scenario.corridor is not None else ()
    if through:
        line = np.array([start.position, *through, goal.position])
        polyline = _shortened(np.round(frame.to_frame(line), DECIMALS), short)
        return smooth_guide(polyline, radius, piece, CELLS_PER_SPAN)
    if all(turn is None or abs(turn) <= STEEPEST for turn in turns):
        return StraightGuide(distance - short)
    shortest = shortest_path(Pose((0.0, 0.0), turns[0]), Pose((distance, 0.0), turns[1]), radius)
    return smooth_guide(_shortened(shortest, short), radius, piece, CELLS_PER_SPAN)


def _shortened(points: Array, length: float) -> Array:
    """A polyline without the last part that lies within a distance of its end."""
    if length == 0.0:
        return points
    away = np.hypot(*(points - points[-1]).T)
    last = int(np.flatnonzero(away > length)[-1])
    begin, end = points[last] - points[-1], points[last + 1] - points[-1]
    leg = end - begin
    # |begin + x leg| = length, the larger root
    a, b, c = leg @ leg, begin @ leg, begin @ begin - length**2
    share = (-b + sqrt(max(b * b - a * c, 0.0))) / a if begin @ leg >= 0.0 else (-b - sqrt(max(b * b - a * c, 0.0))) / a
    return np.concatenate([points[: last + 1], (points[-1] + begin + min(share, 1.0) * leg)[None]])


def guide_along(path: Path, settings: Settings) -> CurvedGuide:
    """Return the guide that is a path over another guide."""
    count = CELLS_PER_SPAN * _spans(path.arc_length, settings, straight=path.space.guide.straight)
    stations = path.parameter_at(np.linspace(0.0, path.arc_length, count + 1))
    direction = path.points(stations).direction
    headings = np.unwrap(np.arctan2(direction[:, 1], direction[:, 0]))
    goal = path.points(np.ones(1)).position[0]
    return guide_through(headings, path.arc_length, goal)


def may_want_another_guide(problem: Problem, path: Path) -> bool:
    """Whether another guide might let a path go further.

    So it is over a curved guide that it has left, since inside of a bend offsets have little room and resolution, over
    a straight one that it crosses steeply, or where a control point is at its bound.
    """
    ends, free = problem.ends, problem.ends.free
    theta = path.theta[free]
    if not problem.space.guide.straight and np.abs(theta).max(initial=0.0) > LEFT * problem.settings.path_span:
        return True
    if problem.space.guide.straight and path.node_speed.max() > STEEP:
        return True
    return bool(np.any((theta > ends.upper[free] - AT_LIMIT) | (theta < ends.lower[free] + AT_LIMIT)))


def _end_conditions(scenario: Scenario, frame: PlanningFrame, space: TripSpace, max_offset: float) -> EndConditions:
    theta = np.zeros(space.path_size)
    first, last = 1, space.path_size - 1
    degree = space.path.coefficients.shape[1] - 1
    spans = len(space.path.widths)
    reach = space.length / (degree * spans)
    ends = np.zeros(2)
    if not space.guide.straight:
        tangent = space.guide.frame(np.array([0.0, space.length])).tangent
        ends = np.arctan2(tangent[:, 1], tangent[:, 0])
    if scenario.start.heading is not None:
        theta[1] = reach * tan(_sideways(scenario.start.heading - frame.heading - float(ends[0])))
        first = 2
    lower, upper = _offset_bounds(space, max_offset)
    if scenario.goal.heading is None and scenario.goal.radius > 0.0:
        last += 1
        lower[-1], upper[-1] = _end_bounds(scenario, frame, space)
    if scenario.goal.heading is not None:
        theta[-2] = -reach * tan(_sideways(scenario.goal.heading - frame.heading - float(ends[1])))
        last -= 1
    goal_speed = scenario.goal.speed
    if goal_speed is not None:
        goal_speed = max(goal_speed, STANDING)
    return EndConditions(theta, slice(first, last), goal_speed, lower, upper, scenario.start.acceleration)


def _end_bounds(scenario: Scenario, frame: PlanningFrame, space: TripSpace) -> tuple[float, float]:
    """Offsets at the end of the guide that lie within the radius of the goal, m."""
    end = space.guide.frame(np.array([space.length]))
    goal = np.array([float(np.hypot(*np.subtract(scenario.goal.position, scenario.start.position))), 0.0])
    away = end.position[0] - goal
    along, across = float(away @ end.tangent[0]), float(away @ end.normal[0])
    half = sqrt(max(scenario.goal.radius**2 - along**2, 0.0))
    return min(-across - half + INSIDE, 0.0), max(-across + half - INSIDE, 0.0)


def _sideways(angle: float) -> float:
    """The nearest heading that a path over the guide can have."""
    return min(max(round(remainder(angle, 2.0 * pi), ANGLE_DECIMALS), -STEEPEST_PATH), STEEPEST_PATH)


def _offset_bounds(space: TripSpace, max_offset: float) -> tuple[Array, Array]:
    """Bounds of the control points: by convexity, wherever one has weight the guide does not fold."""
    upper = np.full(space.path_size, max_offset)
    lower = -upper
    if space.guide.straight:
        return lower, upper
    parameters = np.linspace(0.0, 1.0, FOLD_LOOKS * len(space.path.widths) + 1)
    curvature = space.guide.frame(parameters * space.length).curvature
    weighs = space.path.rows(parameters) > 0.0
    with np.errstate(divide="ignore"):
        left = np.where(curvature > 0.0, FOLD / np.maximum(curvature, 1e-300), np.inf)
        right = np.where(curvature < 0.0, FOLD / np.maximum(-curvature, 1e-300), np.inf)
    upper = np.minimum(upper, np.where(weighs, left[:, None], np.inf).min(axis=0))
    lower = np.maximum(lower, -np.where(weighs, right[:, None], np.inf).min(axis=0))
    return lower, upper
