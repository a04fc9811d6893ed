"""What pictures show: a trip and the obstacles around it, sampled in time.

A :class:`Recording` is all that the animation and the viewer know. `record_plan` makes one of a plan; what
else moves (a closed loop, a log of a real vehicle) can be shown by making one of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from textwrap import shorten
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scp_planner import corridor, planar
from scp_planner.places import limits_at, stretches
from scp_planner.scenario import Disc, Ellipse, Rectangle
from scp_planner.zones import ThreatZone, zones

if TYPE_CHECKING:
    from scp_planner.plan import Plan
    from scp_planner.scenario import Obstacle, Scenario, Shape, Vehicle

Array = NDArray[np.float64]
Index = NDArray[np.intp]

Truth = Mapping[str, Callable[[Array], ArrayLike] | tuple[ArrayLike, ArrayLike]]
"""What obstacles really did, by id: a function from times (n,) s to centres (n, 2) m, or the two arrays
(times, centres) of a record, between which it is interpolated."""

FINE = 0.02
"""Borders of several polygons are cut into bits no longer than this part of their extent."""

BOUNDARY_POINTS = 60
"""Points on the boundary of a zone."""

FAR_CLOCK = 1e4
"""s. From here on a start time is too long a number to be read off an axis."""

_PHASE = 0.0123
"""rad. Turns the directions, so that none is normal to an edge: the boundary point would not be unique."""

_STEP = 1e-6
"""Relative step of the differences of the support function and of time."""


class Convex(Protocol):
    """Anything convex that moves."""

    def support(self, t: Array, directions: Array) -> Array:
        """Support function about the centre at times (...) s in directions (..., 2), m."""
        ...


@dataclass(frozen=True)
class Profile:
    """A quantity over time and its limits.

    Attributes
    ----------
    name, unit : str
        As they stand at the axis.
    values : (n,) array
    lower, upper : float or None
        Limits; None: unbounded.
    upper_at : (n,) array or None
        The upper limit at each time, where it is not the same in all places.
    """

    name: str
    unit: str
    values: Array
    lower: float | None = None
    upper: float | None = None
    upper_at: Array | None = None


@dataclass(frozen=True)
class ObstacleRecord:
    """One obstacle at the times of a recording.

    Attributes
    ----------
    id : str
    center : (n, 2) array
        Where it is thought to be, m; NaN while it is not known of.
    heading : (n,) array
        Direction in which it moves, or is thought to move where nobody knows, rad.
    body : (k, 2) array
        Vertices of its shape about its centre, at heading 0, m.
    turns : bool
        Whether the shape turns with the heading.
    padded : bool
        Whether the zone holds more than the shape.
    boundary : (n, p, m, 2) array
        Points on the boundaries of the p convex pieces of its zone, in order, relative to the centre, m.
    clearance : (n,) array
        From the vehicle's disc to the zone, m, negative inside; NaN while there is none.
    truth : (n, 2) array or None
        Where its centre really was, m; NaN at times without a record.
    observed : (j, 2) array or None
        Positions from which its motion was estimated, m.
    outside : bool
        Whether it is what lies outside the corridor: it has a clearance, but neither body nor boundary.
    """

    id: str
    center: Array
    heading: Array
    body: Array
    turns: bool
    padded: bool
    boundary: Array
    clearance: Array
    truth: Array | None = None
    observed: Array | None = None
    outside: bool = False

    def zone_at(self, index: int) -> Array:
        """Points on the boundaries of the zone's convex pieces at one of the times, (p, m, 2) m."""
        return self.center[index] + self.boundary[index]

    def truth_at(self, index: int) -> Array | None:
        """Where its centre really was at one of the times, (2,) m; None without a record."""
        if self.truth is None or np.isnan(self.truth[index]).any():
            return None
        return self.truth[index]

    def body_at(self, index: int, center: Array | None = None) -> Array:
        """Vertices of the shape at one of the times, (k, 2) m, about the thought centre or another one."""
        turned = self.body
        if self.turns:
            cos, sin = np.cos(self.heading[index]), np.sin(self.heading[index])
            turned = self.body @ np.array([[cos, sin], [-sin, cos]])
        return (self.center[index] if center is None else center) + turned


@dataclass(frozen=True)
class Recording:
    """A trip and the obstacles around it at n increasing times.

    Attributes
    ----------
    name : str
        Of the scenario.
    facts : tuple of (str, str)
        What is to be told of the whole, as name and text.
    time : (n,) array
        Absolute, s.
    position : (n, 2) array
        Of the vehicle, m.
    heading, speed : (n,) arrays
        rad, m/s.
    radius : float
        Of the vehicle, m.
    max_speed : float
        m/s.
    goal : (x, y) in m
    goal_radius : float
        m.
    bounds : ((x, y), (x, y)) or None
        Corners of the workspace, m.
    paths : tuple of (k, 2) arrays
        Planned paths, m: one for a plan, one a cycle for a closed loop.
    path_index : (n,) array of int
        Which of the paths is the plan at each time.
    profiles : tuple of Profile
    obstacles : tuple of ObstacleRecord
    corridor : tuple of (k, 2) arrays
        Polygons that the vehicle stays in, m.
    discs : tuple of float
        Where the vehicle's discs are on its axis, m ahead of the position.
    """

    name: str
    facts: tuple[tuple[str, str], ...]
    time: Array
    position: Array
    heading: Array
    speed: Array
    radius: float
    max_speed: float
    goal: tuple[float, float]
    goal_radius: float
    bounds: tuple[tuple[float, float], tuple[float, float]] | None
    paths: tuple[Array, ...]
    path_index: Index
    profiles: tuple[Profile, ...]
    obstacles: tuple[ObstacleRecord, ...]
    corridor: tuple[Array, ...] = ()
    discs: tuple[float, ...] = (0.0,)

    @property
    def epoch(self) -> float:
        """What times are shown relative to, s: 0, or the start on a clock that is far from 0."""
        return clock_of(self.time)

    @property
    def bodies(self) -> tuple[ObstacleRecord, ...]:
        """The obstacles without what lies outside the corridor."""
        return tuple(obstacle for obstacle in self.obstacles if not obstacle.outside)

    @property
    def clearance(self) -> Array:
        """Clearance to the nearest zone, (n,) m; inf without obstacles."""
        if not self.obstacles:
            return np.full(len(self.time), np.inf)
        return np.fmin.reduce([np.full(len(self.time), np.inf), *(each.clearance for each in self.obstacles)])

    def extent(self) -> tuple[Array, Array]:
        """Corners of the box that holds the trip and what comes near it, (2,) and (2,) m."""
        trip = np.vstack([self.position, np.array([self.goal]), *self.paths])
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


def clock_of(time: Array) -> float:
    """What to show times (n,) s relative to, s: 0, or the first one on a clock that is far from 0."""
    return float(time[0]) if abs(time[0]) > FAR_CLOCK else 0.0


def record_plan(plan: Plan, scenario: Scenario, times: ArrayLike | int = 200, truth: Truth | None = None) -> Recording:
    """Sample a plan and the zones of its scenario.

    Parameters
    ----------
    plan : Plan
    scenario : Scenario
        Its zones are computed anew.
    times : (n,) array or int
        Absolute times, s, or how many, spread equally over the trip.
    truth : mapping, optional
        What obstacles really did, see `Truth`.

    Returns
    -------
    Recording

    Raises
    ------
    ValueError
        If `truth` names an obstacle that is not there.
    """
    time = (
        np.linspace(plan.start_time, plan.arrival_time, times)
        if isinstance(times, int)
        else np.asarray(times, dtype=float)
    )
    truth = dict(truth or {})
    unknown = sorted(set(truth) - {obstacle.id for obstacle in scenario.obstacles})
    if unknown:
        raise ValueError(f"truth: there is no obstacle {unknown[0]!r} in the scenario {scenario.name!r}")
    position, heading, vehicle = plan.position(time), plan.heading(time), scenario.vehicle
    discs, every_zone = discs_at(position, heading, vehicle.discs), zones(scenario)
    clearances = [clearance_of(zone, time, discs, vehicle.radius) for zone in every_zone]
    obstacles = tuple(
        _record_obstacle(obstacle, zone, time, clearance, _true_centers(truth.get(obstacle.id), time))
        for obstacle, zone, clearance in zip(scenario.obstacles, every_zone, clearances, strict=False)
    )
    if len(every_zone) > len(obstacles):  # the corridor's comes last
        obstacles += (record_outside(clearances[-1]),)
    bounds = scenario.bounds
    return Recording(
        name=scenario.name,
        facts=_facts(plan),
        time=time,
        position=position,
        heading=heading,
        speed=plan.speed(time),
        radius=vehicle.radius,
        max_speed=vehicle.max_speed,
        goal=scenario.goal.position,
        goal_radius=scenario.goal.radius,
        bounds=None if bounds is None else (bounds.min, bounds.max),
        paths=(plan.position(np.linspace(plan.start_time, plan.arrival_time, 400)),),
        path_index=np.zeros(len(time), dtype=np.intp),
        profiles=profiles_of(
            vehicle, plan.speed(time), plan.acceleration(time), plan.curvature(time), speed_limit_at(scenario, position)
        ),
        obstacles=obstacles,
        corridor=corridor_of(scenario),
        discs=vehicle.discs,
    )


def discs_at(position: Array, heading: Array, offsets: Sequence[float]) -> list[Array]:
    """Centres of the discs of a vehicle, (n, 2) m each, at positions (n, 2) m and headings (n,) rad."""
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    return [position + offset * ahead if offset else position for offset in offsets]


def speed_limit_at(scenario: Scenario, position: Array) -> Array | None:
    """Limit of the speed at positions (n, 2) m, (n,) m/s; None if it is the same in all places."""
    if not scenario.speed_limits:
        return None
    return np.minimum(limits_at(stretches(scenario), position), scenario.vehicle.max_speed)


def profiles_of(
    vehicle: Vehicle, speed: Array, acceleration: Array, curvature: Array, speed_limit: Array | None = None
) -> tuple[Profile, ...]:
    """Set what a vehicle does beside what it can do.

    Parameters
    ----------
    vehicle : Vehicle
    speed, acceleration, curvature : (n,) arrays
        m/s; along the path, m/s2; signed, 1/m.
    speed_limit : (n,) array, optional
        Where it is not the same in all places, m/s.

    Returns
    -------
    tuple of Profile
        Speed, acceleration, lateral acceleration, curvature.
    """
    lateral, bend = vehicle.max_lateral_acceleration, vehicle.max_curvature
    return (
        Profile("speed", "m/s", speed, 0.0, vehicle.max_speed, speed_limit),
        Profile("acceleration", "m/s²", acceleration, -vehicle.max_deceleration, vehicle.max_acceleration),
        Profile("lateral acceleration", "m/s²", speed**2 * curvature, _negated(lateral), lateral),
        Profile("curvature", "1/m", curvature, _negated(bend), bend),
    )


def boundary_of(zone: Convex, times: Array, count: int = BOUNDARY_POINTS) -> Array:
    """Points on the boundary of a convex zone about its centre: the gradient of its support function.

    Parameters
    ----------
    zone : Convex
    times : (n,) array
        Absolute, s.
    count : int
        Number of directions.

    Returns
    -------
    (n, count, 2) array
        Relative to the centre, m, anticlockwise.
    """
    angles = _PHASE + np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    shape = (len(times), count)
    directions = np.broadcast_to(np.stack([np.cos(angles), np.sin(angles)], axis=-1), (*shape, 2))
    t = np.broadcast_to(times[:, None], shape)
    points = np.empty((*shape, 2))
    for axis in (0, 1):
        step = np.zeros(2)
        step[axis] = _STEP
        points[..., axis] = (zone.support(t, directions + step) - zone.support(t, directions - step)) / (2.0 * _STEP)
    return points


def body_of(shape: Shape) -> tuple[Array, bool]:
    """Vertices of a shape, (k, 2) m, at heading 0 if it turns with the heading, and whether it does."""
    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    if isinstance(shape, Disc):
        return shape.disc * circle, False
    if isinstance(shape, Ellipse | Rectangle):
        if isinstance(shape, Ellipse):
            points = np.array(shape.ellipse) * circle
        else:
            points = 0.5 * np.array(shape.rectangle) * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        own = shape.heading or 0.0
        turn = np.array([[np.cos(own), np.sin(own)], [-np.sin(own), np.cos(own)]])
        return points @ turn, shape.heading is None
    return np.array(shape.polygon), False


def convex_pieces_of(zone: ThreatZone) -> list[ThreatZone]:
    """Give zones of which a zone is the union, and that are convex, so that their support functions tell all."""
    if len(zone.outlines) < 2:
        return [zone]
    return [replace(zone, outlines=(outline,)) for outline in zone.outlines]


def clearance_of(zone: ThreatZone, time: Array, discs: Sequence[Array], radius: float) -> Array:
    """Clearance of a vehicle to a zone, (n,) m, at times (n,) s with discs at (n, 2) m each."""
    clearance: Array = np.min([zone.signed_distance(time, disc) for disc in discs], axis=0) - radius
    return clearance


def record_outside(clearance: Array) -> ObstacleRecord:
    """Record what lies outside the corridor by the clearance (n,) to it, m."""
    count = len(clearance)
    return ObstacleRecord(
        id=corridor.NAME,
        center=np.zeros((count, 2)),
        heading=np.zeros(count),
        body=np.zeros((1, 2)),
        turns=False,
        padded=False,
        boundary=np.zeros((count, 1, 1, 2)),
        clearance=clearance,
        outside=True,
    )


def borders_of(pieces: Sequence[Array]) -> Array:
    """Give the border of the union of convex polygons.

    Parameters
    ----------
    pieces : sequence of (k, 2) arrays
        Vertices, anticlockwise, m.

    Returns
    -------
    (n, 2, 2) array
        Its bits, m, as start and end; whether one belongs to it is decided by its middle.
    """
    size = float(np.ptp(np.concatenate(pieces), axis=0).max())
    return np.concatenate([_borders(piece, k, pieces, size) for k, piece in enumerate(pieces)])


def _borders(piece: Array, own: int, pieces: Sequence[Array], size: float) -> Array:
    """Cut the border of a convex piece into bits, (n, 2, 2) m, and leave out those that are seams.

    A seam lies in another piece, or on its border and runs the other way.
    """
    ends = np.roll(piece, -1, axis=0)
    counts = np.ceil(np.linalg.norm(ends - piece, axis=1) / (FINE * size)).astype(int)
    parts = np.concatenate([np.arange(count) / count for count in counts if count])
    start, side = np.repeat(piece, counts, axis=0), np.repeat(ends - piece, counts, axis=0)
    step = side / np.repeat(counts, counts)[:, None]
    first = start + parts[:, None] * side
    bits, middle = np.stack([first, first + step], axis=1), first + 0.5 * step
    seam = np.zeros(len(bits), dtype=bool)
    for k, other in enumerate(pieces):
        edges = np.roll(other, -1, axis=0) - other
        known = np.linalg.norm(edges, axis=1) > 1e-9 * size
        if k == own or not known.any():
            continue
        edges = edges[known]
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
        beyond = np.einsum("nij,ij->ni", middle[:, None] - other[known], normals)
        nearest = beyond.argmax(axis=1)
        distance = beyond[np.arange(len(bits)), nearest]
        against = np.einsum("ij,ij->i", edges[nearest], step) < 0.0
        seam |= (distance < -1e-6 * size) | ((distance <= 1e-6 * size) & against)
    return bits[~seam]


def corridor_of(scenario: Scenario) -> tuple[Array, ...]:
    """Give the polygons of a scenario's corridor, anticlockwise, (k, 2) m each; none without one."""
    return tuple(np.array(planar.anticlockwise(polygon)) for polygon in scenario.corridor or ())


def _record_obstacle(
    obstacle: Obstacle, zone: ThreatZone, time: Array, clearance: Array, truth: Array | None
) -> ObstacleRecord:
    body, turns = body_of(obstacle.shape)
    velocity = zone.center(time + 1e-3) - zone.center(time - 1e-3)
    seen = obstacle.observations
    return ObstacleRecord(
        id=obstacle.id,
        center=zone.center(time),
        heading=np.arctan2(velocity[:, 1], velocity[:, 0]),
        body=body,
        turns=turns,
        padded=seen is not None or obstacle.margin > 0.0 or not isinstance(obstacle.shape, Disc),
        boundary=np.stack([boundary_of(piece, time) for piece in convex_pieces_of(zone)], axis=1),
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
    return np.stack([np.interp(time, times, centers[:, axis], left=np.nan, right=np.nan) for axis in (0, 1)], axis=-1)


def _facts(plan: Plan) -> tuple[tuple[str, str], ...]:
    facts = [
        ("status", str(plan.status)),
        ("travel time", f"{plan.travel_time:.2f} s"),
    ]
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


def length_text(metres: float) -> str:
    """Write a length in a unit of its size."""
    for unit, size in (("\N{MICRO SIGN}m", 1e-6), ("mm", 1e-3)):
        if abs(metres) < 999.5 * size and abs(metres) < 0.1:
            return f"{metres / size:.3g} {unit}"
    return f"{metres:.2f} m"


def _negated(limit: float | None) -> float | None:
    return None if limit is None else -limit


def nice_times(start: float, end: float, most: int = 6) -> Array:
    """Instants to show: round ones after the start, the start and the end, (n,) s.

    Parameters
    ----------
    start, end : float
        s.
    most : int
        No more than this many, at least 2.

    Returns
    -------
    (n,) array
        s.
    """
    span = end - start
    power = 10.0 ** np.floor(np.log10(span / most))
    step = next(
        power * factor for factor in (1, 1.5, 2, 3, 4, 5, 10, 15, 20) if span / (power * factor) <= most - 1 + 1e-9
    )
    times = start + step * np.arange(int(span / step) + 1)
    if end - times[-1] < 0.4 * step and len(times) > 1:
        times = times[:-1]
    return np.append(times, end)


def nearest_indices(times: Array, wanted: Sequence[float] | Array) -> Index:
    """Index of the time nearest to each of the wanted ones."""
    return np.abs(np.asarray(wanted)[:, None] - times).argmin(axis=1)
