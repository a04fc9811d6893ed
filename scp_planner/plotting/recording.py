"""A trip and the obstacles around it, sampled in time for pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from textwrap import shorten
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index
from scp_planner.mathematics import corridor, planar
from scp_planner.mathematics.occupancy import NAME as MAP
from scp_planner.mathematics.occupancy import OccupancyMap
from scp_planner.mathematics.polylines import lengths_along, points_at
from scp_planner.planning.meeting import meetings
from scp_planner.plotting.borders import body_of, turned, vehicle_rectangle
from scp_planner.plotting.scales import clock_of, length_text
from scp_planner.scenario.places import Stretch, followed, limits_at, stretches
from scp_planner.scenario.shapes import Disc
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.boundaries import boundaries_of
from scp_planner.threat_zones.of_scenario import whom_it_touches, zones
from scp_planner.threat_zones.target import goal_on_arrival, tracked
from scp_planner.threat_zones.zone import ThreatZone, by_obstacle
from scp_planner.trips.trip import discs_at

if TYPE_CHECKING:
    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Obstacle, Passage, Scenario, Vehicle

Truth = Mapping[str, Callable[[Array], ArrayLike] | tuple[ArrayLike, ArrayLike]]
"""True motions of obstacles by id: a function from times (n,) s to centres (n, 2) m, or the two arrays."""


@dataclass(frozen=True)
class Profile:
    """A quantity over time and its limits."""

    name: str  # As it stands at the axis
    unit: str
    values: Array  # (n,)
    lower: float | None = None  # None: unbounded
    upper: float | None = None
    upper_at: Array | None = None  # (n,) The upper limit at each time, where it is not the same in all places


@dataclass(frozen=True)
class ObstacleRecord:
    """One obstacle at the times of a recording."""

    id: str
    center: Array  # (n, 2)
    heading: Array  # (n,) Direction in which it moves, or is thought to move where nobody knows, rad
    body: Array  # (k, 2) Vertices of its shape about its centre, at heading 0, m
    turns: bool
    padded: bool
    boundary: Array  # (n, p, m, 2) Points on the boundaries of the p convex pieces of its zones
    clearance: Array  # (n,) From the vehicle's disc to the zone, m, negative inside; NaN while there is none
    truth: Array | None = None  # (n, 2)
    observed: Array | None = None  # (j, 2) Positions from which its motion was estimated, m
    outside: bool = False

    def zone_at(self, index: int) -> Array:
        """Points on the boundaries of the zone's convex pieces at one of the times, (p, m, 2) m."""
        return self.center[index] + self.boundary[index]

    def truth_at(self, index: int) -> Array | None:
        """True centre at one of the times, (2,) m; None without a record."""
        if self.truth is None or np.isnan(self.truth[index]).any():
            return None
        return self.truth[index]

    def body_at(self, index: int, center: Array | None = None) -> Array:
        """Vertices of the shape at one of the times, (k, 2) m, about the thought centre or another one."""
        body = turned(self.body, self.heading[index]) if self.turns else self.body
        return (self.center[index] if center is None else center) + body


@dataclass(frozen=True)
class ReplanRecord:
    """Result of a replan: absolute time in s, outcome, whether that is safe, and why."""

    time: float
    outcome: str
    safe: bool
    reason: str


@dataclass(frozen=True)
class Recording:
    """A trip and the obstacles around it at n increasing times."""

    name: str
    time: Array  # (n,) Absolute, s
    position: Array  # (n, 2) m
    heading: Array  # (n,) rad
    speed: Array  # (n,) m/s
    radius: float  # m
    max_speed: float  # m/s
    goal: tuple[float, float]
    paths: tuple[Array, ...]  # (k, 2) Planned paths, m: one for a plan, one a cycle for a closed loop
    path_index: Index  # (n,)
    profiles: tuple[Profile, ...] = ()
    obstacles: tuple[ObstacleRecord, ...] = ()
    goal_radius: float = 0.0  # m
    bounds: tuple[tuple[float, float], tuple[float, float]] | None = None  # Corners of the workspace, m
    corridor: tuple[Array, ...] = ()  # (k, 2) Polygons that the vehicle stays in, m
    discs: Sequence[float] = (0.0,)
    map: OccupancyMap | None = None  # whose occupied cells no disc of the vehicle touches
    walls: tuple[Array, ...] = ()  # (k, 2) Polygons that no disc of the vehicle enters, m
    lanes: tuple[Array, ...] = ()  # (k, 2) Borders of lanes, m, which nobody is kept from
    guide: Array | None = None  # (k, 2) The lane that the path is an offset of, m; None: straight
    stretches: tuple[Stretch, ...] = ()
    replans: tuple[ReplanRecord, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    goal_region: Array | None = None  # (k, 2) Polygon that the trip ends in, m
    places: tuple[tuple[float, float], ...] = ()  # m; to pass on the way, or former goals

    @property
    def epoch(self) -> float:
        """Origin of displayed times, s: 0, or the start on a clock that is far from 0."""
        return clock_of(self.time)

    @property
    def bodies(self) -> tuple[ObstacleRecord, ...]:
        """The obstacles without the ground: what lies outside the corridor, and walls."""
        return tuple(obstacle for obstacle in self.obstacles if not obstacle.outside)

    @property
    def speeds(self) -> tuple[float, float]:
        """Least and largest speed that colours tell, m/s: those driven, some apart."""
        low, high = float(self.speed.min()), float(self.speed.max())
        return min(low, 0.95 * high), max(high, 1e-3 * self.max_speed)

    @property
    def vehicle_body(self) -> Array | None:
        """Corners of a long vehicle about its reference point, (4, 2) m, at heading 0; None for discs."""
        return vehicle_rectangle(self.discs, self.radius)

    def vehicle_at(self, index: int) -> Array | None:
        """Corners of a long vehicle at one of the times, (4, 2) m; None for discs."""
        body = self.vehicle_body
        return None if body is None else self.position[index] + turned(body, self.heading[index])

    @property
    def clearance(self) -> Array:
        """Clearance to the nearest zone, (n,) m; inf without obstacles."""
        if not self.obstacles:
            return np.full(len(self.time), np.inf)
        return np.fmin.reduce([np.full(len(self.time), np.inf), *(each.clearance for each in self.obstacles)])

    def extent(self) -> tuple[Array, Array]:
        """Corners of the box that holds the trip and what comes near it, (2,) and (2,) m."""
        trip = np.vstack(
            [*discs_at(self.position, self.heading, self.discs), np.array([self.goal, *self.places]), *self.paths]
        )
        low, high = trip.min(axis=0), trip.max(axis=0)
        reach = max(float((high - low).max()), 4.0 * self.radius)
        near = [trip]
        for obstacle in self.bodies:
            # The zone at times when it is close: one that grows to kilometres must not shrink the picture.
            close = np.flatnonzero(obstacle.clearance < 0.05 * reach)[:: max(1, len(self.time) // 40)]
            near += [obstacle.zone_at(int(i)).reshape(-1, 2) for i in close]
        points = np.vstack(near)
        low = np.maximum(points.min(axis=0), low - 0.3 * reach)
        high = np.minimum(points.max(axis=0), high + 0.3 * reach)
        # A straight trip alone would be a line: some width beside it tells what passes.
        pad = np.maximum(0.15 * reach - 0.5 * (high - low), 0.0) + max(1.5 * self.radius, 0.03 * reach)
        low, high = low - pad, high + pad
        if self.bounds is not None:
            # A little of what waits outside is to be seen.
            edge = 0.1 * reach
            low, high = (
                np.maximum(low, np.subtract(self.bounds[0], edge)),
                np.minimum(high, np.add(self.bounds[1], edge)),
            )
        return low, high


def frame_count(span: float, frames_per_second: float) -> int:
    """Frames of a film of a span, s."""
    return int(np.clip(math.ceil(span * frames_per_second), 2, 1200))


def record_plan(plan: Plan, scenario: Scenario, times: ArrayLike | int = 200, truth: Truth | None = None) -> Recording:
    """Sample a plan and the zones of its scenario."""
    span = plan.start_time, plan.arrival_time
    time = np.linspace(*span, times) if isinstance(times, int) else np.asarray(times, dtype=float)
    asked = tracked(scenario)
    # Whom it meets is drawn, too
    scenario = changed(asked, goal=goal_on_arrival(scenario, plan.arrival_time), goals=_passed(scenario, plan))
    met = whom_it_touches(asked)
    truth = dict(truth or {})
    if unknown := sorted(set(truth) - {obstacle.id for obstacle in scenario.obstacles}):
        raise ValueError(f"truth: there is no obstacle {unknown[0]!r} in the scenario {scenario.name!r}")
    position, heading, vehicle = plan.position(time), plan.heading(time), scenario.vehicle
    return Recording(
        facts=_facts(plan),
        time=time,
        position=position,
        heading=heading,
        speed=plan.speed(time),
        paths=(plan.position(np.linspace(plan.start_time, plan.arrival_time, 400)),),
        path_index=np.zeros(len(time), dtype=np.intp),
        profiles=profiles_of(
            vehicle, plan.speed(time), plan.acceleration(time), plan.curvature(time), speed_limit_at(scenario, position)
        ),
        obstacles=tuple(
            replace(one, clearance=np.full(len(time), np.nan)) if one.id in met else one
            for one in _record_obstacles(scenario, time, position, heading, truth)
        ),
        **scene_of(scenario),
    )


def _passed(scenario: Scenario, plan: Plan) -> tuple[Passage, ...]:
    """The places to pass, with targets where a plan meets them."""
    found = meetings(scenario, plan) if any(one.target is not None for one in scenario.goals) else {}
    places = ((one, found[k].place if k in found else one.position) for k, one in enumerate(scenario.goals))
    return tuple(changed(one, target=None, offset=(0.0, 0.0), position=place) for one, place in places)


def record_course(scenario: Scenario, times: int) -> Recording:
    """Sample a scenario as if the vehicle drove along the guide at top speed: all obstacles count as near to it."""
    start, goal = scenario.start, scenario.goal
    line = np.array(scenario.guide or (start.position, goal.position))
    run = lengths_along(line)
    along = np.linspace(0.0, run[-1], times)
    position = points_at(along, run, line)
    heading = np.arctan2(*np.gradient(position, axis=0).T[::-1])
    heading[0] = heading[0] if start.heading is None else start.heading
    time = start.time + along / scenario.vehicle.max_speed
    return Recording(
        time=time,
        position=position,
        heading=heading,
        speed=np.full(times, scenario.vehicle.max_speed),
        paths=(position,),
        path_index=np.zeros(times, dtype=np.intp),
        obstacles=tuple(
            replace(one, clearance=np.zeros(times)) for one in _record_obstacles(scenario, time, position, heading, {})
        ),
        **scene_of(scenario),
    )


def _record_obstacles(
    scenario: Scenario, time: Array, position: Array, heading: Array, truth: Truth
) -> tuple[ObstacleRecord, ...]:
    vehicle, every_zone = scenario.vehicle, by_obstacle(zones(scenario))
    discs = discs_at(position, heading, vehicle.discs)
    clearances = {name: clearance_of(several, time, discs, vehicle.radius) for name, several in every_zone.items()}
    bodies = [
        _record_obstacle(one, every_zone[one.id], time, clearances[one.id], _true_centers(truth.get(one.id), time))
        for one in scenario.obstacles
    ]
    grounds = [name for name in ground_of(scenario) if name in clearances]  # the cells of a map are no zone
    return (*bodies, *(record_outside(name, clearances[name]) for name in grounds))


def ground_of(scenario: Scenario) -> tuple[str, ...]:
    """Names that the ground of a scenario has among its zones: of what lies outside the corridor, and of walls."""
    corridor_name = () if scenario.corridor is None else (corridor.NAME,)
    map_name = () if scenario.ground is None else (MAP,)
    return (*corridor_name, *((corridor.WALLS,) if scenario.walls else ()), *map_name)


def scene_of(scenario: Scenario) -> dict[str, Any]:
    """Fields of a recording that a scenario alone says."""
    vehicle, goal, bounds = scenario.vehicle, scenario.goal, scenario.bounds
    return {
        "name": scenario.name,
        "radius": vehicle.radius,
        "max_speed": vehicle.max_speed,
        "discs": vehicle.discs,
        "goal": goal.position,
        "goal_radius": goal.radius,
        "places": tuple(one.position for one in scenario.goals),
        "goal_region": None if goal.region is None else np.array(goal.region),
        "bounds": None if bounds is None else (bounds.min, bounds.max),
        "corridor": tuple(np.array(planar.anticlockwise(polygon)) for polygon in scenario.corridor or ()),
        "map": None if scenario.ground is None else scenario.ground.map,
        "walls": tuple(np.array(planar.anticlockwise(polygon)) for polygon in scenario.walls),
        "lanes": tuple(np.array(line) for line in scenario.lanes),
        "guide": None if scenario.guide is None else np.array(scenario.guide),
        "stretches": stretches(scenario),
    }


def speed_limit_at(scenario: Scenario, position: Array) -> Array | None:
    """Limit of the speed at positions of a drive (n, 2) m, (n,) m/s; None if it is the same in all places."""
    if not scenario.speed_limits:
        return None
    parts = stretches(scenario)
    return np.minimum(limits_at(parts, position, followed(parts, position)), scenario.vehicle.max_speed)


def profiles_of(
    vehicle: Vehicle, speed: Array, acceleration: Array, curvature: Array, speed_limit: Array | None = None
) -> tuple[Profile, ...]:
    """Set what a vehicle does beside what it can do."""
    lateral, bend = vehicle.max_lateral_acceleration, vehicle.max_curvature
    return (
        Profile("speed", "m/s", speed, 0.0, vehicle.max_speed, speed_limit),
        Profile("acceleration", "m/s²", acceleration, -vehicle.max_deceleration, vehicle.max_acceleration),
        Profile("lateral acceleration", "m/s²", speed**2 * curvature, _negated(lateral), lateral),
        Profile("curvature", "1/m", curvature, _negated(bend), bend),
    )


def clearance_of(several: Sequence[ThreatZone], time: Array, discs: Sequence[Array], radius: float) -> Array:
    """Clearance of a vehicle to an obstacle's zones, (...) m, at times (...) s with discs at (..., 2) m each."""
    clearance: Array = np.min([zone.signed_distance(time, disc) for zone in several for disc in discs], axis=0) - radius
    return clearance


def record_outside(name: str, clearance: Array) -> ObstacleRecord:
    """Record ground, what lies outside the corridor or walls, by the clearance (n,) to it, m."""
    count = len(clearance)
    return ObstacleRecord(
        id=name,
        center=np.zeros((count, 2)),
        heading=np.zeros(count),
        body=np.zeros((1, 2)),
        turns=False,
        padded=False,
        boundary=np.zeros((count, 1, 1, 2)),
        clearance=clearance,
        outside=True,
    )


def _record_obstacle(
    obstacle: Obstacle, several: Sequence[ThreatZone], time: Array, clearance: Array, truth: Array | None
) -> ObstacleRecord:
    body, turns = body_of(obstacle.shape)
    zone = several[0]
    ahead = zone.heading_vector(time)
    seen = obstacle.observations
    return ObstacleRecord(
        id=obstacle.id,
        center=zone.center(time),
        heading=np.arctan2(ahead[:, 1], ahead[:, 0]),
        body=body,
        turns=turns,
        padded=obstacle.motion is None
        or len(several) > 1
        or obstacle.margin > 0.0
        or not isinstance(obstacle.shape, Disc),
        boundary=boundaries_of(several, time),
        clearance=clearance,
        truth=truth,
        observed=None if seen is None else np.array(seen.position),
    )


def _true_centers(
    truth: Callable[[Array], ArrayLike] | tuple[ArrayLike, ArrayLike] | None, time: Array
) -> Array | None:
    if truth is None:
        return None
    if callable(truth):
        return np.asarray(truth(time), dtype=float)
    times, centers = (np.asarray(part, dtype=float) for part in truth)
    return points_at(time, times, centers, np.nan)


def _facts(plan: Plan) -> tuple[tuple[str, str], ...]:
    facts = [("status", str(plan.status)), ("travel time", f"{plan.travel_time:.2f} s")]
    if plan.start_time != 0.0:
        facts += [("arrival", f"{plan.arrival_time:.2f} s")]
    if plan.reason:
        facts += [("reason", shorten(plan.reason, 70, placeholder=" ..."))]
    nearest = plan.clearance
    if nearest.obstacle is not None:
        facts += [("least clearance", f"{length_text(nearest.minimum)} to {nearest.obstacle}")]
    facts += [
        ("method", f"{plan.method}, {plan.solver}"),
        ("iterations", f"{plan.iterations} in {plan.wall_time:.2f} s"),
    ]
    return tuple(facts)


def _negated(limit: float | None) -> float | None:
    return None if limit is None else -limit
