"""Guides to plan along, and the spans of paths on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, dist, pi, remainder, sqrt

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.corridor import known_way
from scp_planner.mathematics.dubins import Pose, shortest_path
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.polylines import points_at
from scp_planner.mathematics.tolerances import ANGLE_DECIMALS, DECIMALS
from scp_planner.problem.problem import Problem
from scp_planner.problem.profile import SpeedProfile, fastest_profile
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.places import Line, anchored
from scp_planner.settings.planning import SceneSettings, Settings, for_scene
from scp_planner.trips.guide import CurvedGuide, Guide, StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.smoothing import guide_through, smooth_guide
from scp_planner.trips.space import CELLS_PER_SPAN

STEEPEST = 1.05  # rad; where a heading differs by more from the direction to the goal, the guide is no straight line
ROOM_TO_TURN = 2.0  # guides are rounded with so many times the least radius of the vehicle
WIDE_BEND = 4.0  # and corners of polylines with up to so many times that
GOAL_SHARE = 0.95  # of the goal's radius: the guide ends before its centre, and the path anywhere beside that
STEEP = 1.3  # of path to 1 of a straight guide; a path with more of it anywhere, 40 degrees, bends better over another
LEFT = 0.2  # spans of the offset; a path with larger offsets has left its guide
AT_LIMIT = 1e-3  # units of length; a control point that is nearer to its bound is held by it
MANY_SPANS = 200  # of a path over a curved guide; where there would be more, they get longer as far as bends allow:
BEND_SPAN = 0.75  # of the radius of the guide's bends, as long as those of a usual scene are at least
LEAST_RADIUS, RELATIVE_RADIUS = 1.0, 0.1  # units of length, and of the distance to the goal: where the vehicle has none


@dataclass(frozen=True)
class RouteGuideSettings:
    """Guides along routes, and drives along them."""

    looks: float = 0.25  # units of length, between points of a route that are compared with a guide
    most_looks: int = 1000  # of these: on longer routes they are farther apart
    aside: float = 0.5  # of the largest offset: as far is a route from a curved guide that serves it
    steepest: float = 1.28  # rad, of a route over the straight guide, if that serves it
    spans: int = 100  # of a path over a route, that its bends may need at first
    to_a_span: float = 2.0  # radii of bends at top speed
    steady: float = 0.9  # of the speed in the tightest bend
    stations: int = 400  # of a drive along a guide


ROUTE_GUIDES = RouteGuideSettings()


def path_spans(guide: Guide, settings: SceneSettings) -> int:
    """Number of spans of the offset's spline: so that the pieces of a curved guide are the cells of the quadrature."""
    if isinstance(guide, CurvedGuide) and guide.pieces % CELLS_PER_SPAN == 0:
        return guide.pieces // CELLS_PER_SPAN
    return _spans(guide.length, settings, straight=guide.straight)


def _spans(length: float, settings: SceneSettings, *, straight: bool) -> int:
    """Spans on a length, m; over a curved guide there are as many as its bends need."""
    wanted = round(length / settings.path_span)
    return max(4, min(wanted, settings.max_path_spans) if straight else wanted)


def default_guide(scenario: Scenario, frame: PlanningFrame, limits: Limits, settings: SceneSettings) -> Guide:
    """Return the guide of a scenario, in the planning frame."""
    start, goal = scenario.start, scenario.goal
    # A loop back to the start ends apart from it, by more than rounding
    distance = max(round(dist(goal.position, start.position), DECIMALS), 10.0 ** (1 - DECIMALS))
    radius = _turning_radius(limits, distance)
    short = round(GOAL_SHARE * goal.radius, DECIMALS)
    if scenario.guide is not None:
        return guide_over(frame.to_frame(np.array(scenario.guide)), scenario, limits, settings)
    turns = [
        None if heading is None else round(remainder(heading - frame.heading, 2.0 * pi), ANGLE_DECIMALS)
        for heading in (start.heading, goal.heading)
    ]
    through = known_way(scenario.corridor, start.position, goal.position) if scenario.corridor is not None else ()
    if through:
        line = np.array([start.position, *through, goal.position])
        polyline = _shortened(np.round(frame.to_frame(line), DECIMALS), short)
        return _smoothed(polyline, radius, settings)
    if all(turn is None or abs(turn) <= STEEPEST for turn in turns):
        return StraightGuide(distance - short)
    shortest = shortest_path(Pose((0.0, 0.0), turns[0]), Pose((distance, 0.0), turns[1]), radius)
    return _smoothed(_shortened(shortest, short), radius, settings)


def over_places(scenario: Scenario, legs: Sequence[Array]) -> tuple[Scenario, ...]:
    """Return a scenario with guides that lead over its places to pass, along polylines, (n, 2) m, between them.

    The first is the polyline. Where that turns sharply at a place, another one passes it in the middle of the turn,
    along arcs that the vehicle can drive: some such trips bend less, others come better round the corner.
    """
    start, goal, vehicle = scenario.start, scenario.goal, scenario.vehicle
    bend = vehicle.max_curvature
    if bend is None and vehicle.max_lateral_acceleration is not None:
        bend = vehicle.max_lateral_acceleration / vehicle.max_speed**2
    straight = [leg[0] for leg in legs] + [legs[-1][-1]]
    leaves = [float(np.arctan2(*(leg[1] - leg[0])[::-1])) for leg in legs]
    comes = [float(np.arctan2(*(leg[-1] - leg[-2])[::-1])) for leg in legs]
    halfway = list[float | None]()
    for one, before, after in zip(scenario.goals, comes, leaves[1:], strict=False):
        half = 0.5 * remainder(after - before, 2.0 * pi)
        given = None if one.heading_range is None else 0.5 * (one.heading_range[0] + one.heading_range[1])
        halfway.append(before + half if given is None and abs(half) > 0.5 * STEEPEST else given)
    ends = [start.heading, *halfway, goal.heading]
    line = np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])
    lines = {tuple((x, y) for x, y in line.tolist()): None}
    if bend is not None and any(heading is not None for heading in halfway):
        arcs = [straight[0][None]]
        for leg, first, last in zip(legs, ends, ends[1:], strict=False):
            turned = (first is not None or last is not None) and len(leg) == 2
            (begin, end) = ((x, y) for x, y in leg[[0, -1]].tolist())
            poses = Pose(begin, first), Pose(end, last)
            arcs.append(shortest_path(*poses, ROOM_TO_TURN / bend)[1:-1] if turned else leg[1:-1])
            arcs.append(leg[-1:])
        lines[tuple((x, y) for x, y in np.concatenate(arcs).tolist())] = None
    fixed = anchored(scenario)
    return tuple(fixed.model_copy(update={"guide": line}) for line in lines)


def bend_radius(points: Array, limits: Limits, speed: float) -> float:
    """Radius that a polyline from start to goal is rounded with where it is driven at a speed, if there is room, m."""
    radius = _turning_radius(limits, round(float(np.hypot(*points[-1])), DECIMALS))
    # Offsets to the outside of a bend are easy, those to the inside are not
    return max(radius, min(speed**2 / limits.lateral_acceleration, WIDE_BEND * radius))


def guide_over(
    points: Array,
    scenario: Scenario,
    limits: Limits,
    settings: SceneSettings,
    spans: float = 0.0,
    radius: float | None = None,
) -> Guide:
    """Return the guide along a polyline from start to goal, its corners as wide as they may be driven, or of a radius.

    Paths over it have spans as short as its tightest bends need, if these are no more than ``spans``.
    """
    radius = radius or bend_radius(points, limits, limits.speed)
    short = round(GOAL_SHARE * scenario.goal.radius, DECIMALS)
    polyline = _shortened(np.round(points, DECIMALS), short)
    if spans:
        length = float(np.hypot(*np.diff(polyline, axis=0).T).sum())
        finest = max(length / spans, BEND_SPAN * _turning_radius(limits, float(np.hypot(*points[-1]))))
        settings = replace(settings, path_span=min(settings.path_span, finest))
    return _smoothed(polyline, radius, settings)


def _turning_radius(limits: Limits, distance: float) -> float:
    """Radius that guides to a goal in a distance, m, are rounded with at least, m."""
    if np.isfinite(limits.curvature):
        return ROOM_TO_TURN / limits.curvature
    return max(LEAST_RADIUS, RELATIVE_RADIUS * distance)


def _smoothed(polyline: Array, radius: float, settings: SceneSettings) -> Guide:
    """The guide along a polyline, (n, 2) m, with bends of a radius, m: each span of a path over it is five pieces."""
    length = float(np.hypot(*np.diff(polyline, axis=0).T).sum())
    span = max(settings.path_span, min(length / MANY_SPANS, BEND_SPAN * radius))
    return smooth_guide(polyline, radius, span / CELLS_PER_SPAN, CELLS_PER_SPAN)


def _shortened(points: Array, length: float) -> Array:
    """A polyline without the last part that lies within a distance of its end."""
    away = np.hypot(*(points - points[-1]).T)
    if away.max() <= length:  # a leg that begins as near as it is to end
        return points
    last = int(np.flatnonzero(away > length)[-1])
    begin, end = points[last] - points[-1], points[last + 1] - points[-1]
    leg = end - begin
    # |begin + x leg| = length, the larger root
    a, b, c = leg @ leg, begin @ leg, begin @ begin - length**2
    share = (-b + sqrt(max(b * b - a * c, 0.0))) / a if begin @ leg >= 0.0 else (-b - sqrt(max(b * b - a * c, 0.0))) / a
    return np.concatenate([points[: last + 1], (points[-1] + begin + min(share, 1.0) * leg)[None]])


def guide_along(path: Path, given: Settings) -> CurvedGuide:
    """Return the guide that is a path over another guide."""
    settings = for_scene(given)
    space = path.space
    spans = _spans(path.arc_length, settings, straight=space.guide.straight)
    if spans > MANY_SPANS and not space.guide.straight:
        # No finer than over the guide before, whose bends allowed for its spans.
        spans = min(spans, max(MANY_SPANS, round(len(space.path.widths) * path.arc_length / space.length)))
    count = CELLS_PER_SPAN * spans
    stations = path.parameter_at(np.linspace(0.0, path.arc_length, count + 1))
    direction = path.points(stations).direction
    headings = np.unwrap(np.arctan2(direction[:, 1], direction[:, 0]))
    goal = path.points(np.ones(1)).position[0]
    return guide_through(headings, path.arc_length, goal)


def guide_on(scenario: Scenario, line: Array, settings: SceneSettings) -> Guide:
    """Return a guide on a route, (n, 2) m from start to goal, that the vehicle can follow."""
    limits = Limits.of(scenario, settings.limit_margin).rounded()
    frame = PlanningFrame.between(scenario.start.position, scenario.goal.position, scenario.start.time)
    points = frame.to_frame(line)
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    spans = min(ROUTE_GUIDES.spans, length / (ROUTE_GUIDES.to_a_span * bend_radius(points, limits, limits.speed)))
    return guide_over(points, scenario, limits, settings, spans)


def serves(guide: Guide, points: Array, largest: float = 8.0) -> bool:
    """True if a polyline is an offset of a guide that is nowhere steep."""
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.linspace(0.0, along[-1], _looks(along[-1]) + 1)
    places = points_at(at, along, points)
    if guide.straight:
        least = cos(ROUTE_GUIDES.steepest) * (at[1] - at[0])
        return bool(np.abs(places[:, 1]).max() <= largest and np.diff(places[:, 0]).min() >= least)
    least = cos(STEEPEST) * (at[1] - at[0])
    stations = np.linspace(0.0, guide.length, _looks(guide.length) + 1)
    line = Line(guide.frame(stations).position)
    far = line.distances(places).max() > ROUTE_GUIDES.aside * largest
    return not far and bool(np.diff(line.nearest(places)).min() >= least)


def _looks(length: float) -> int:
    return max(2, round(min(length / ROUTE_GUIDES.looks, ROUTE_GUIDES.most_looks)))


def drive_along(guide: Guide, problem: Problem, *, steady: bool = False) -> SpeedProfile:
    """Return the fastest drive along a guide within the limits at each bend, or everywhere at the tightest."""
    if problem.profile is not None and not steady:
        return problem.profile
    limits, stations = problem.limits, np.linspace(0.0, guide.length, ROUTE_GUIDES.stations + 1)
    with np.errstate(divide="ignore"):
        allowed = np.minimum(limits.speed, np.sqrt(limits.lateral_acceleration / np.abs(guide.curvature(stations))))
    if steady:
        allowed = np.full(len(allowed), ROUTE_GUIDES.steady * allowed.min())
    start, goal = problem.space.start_speed, problem.ends.goal_speed
    return fastest_profile(stations, allowed, start, goal, limits.acceleration, limits.deceleration)


def may_want_another_guide(problem: Problem, path: Path) -> bool:
    """True if another guide might let a path go further."""
    ends, free = problem.ends, problem.ends.free
    theta = path.theta[free]
    if not problem.space.guide.straight and np.abs(theta).max(initial=0.0) > LEFT * problem.settings.path_span:
        return True
    if problem.space.guide.straight and path.node_speed.max() > STEEP:
        return True
    return bool(np.any((theta > ends.upper[free] - AT_LIMIT) | (theta < ends.lower[free] + AT_LIMIT)))
