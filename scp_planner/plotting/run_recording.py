"""Recordings of closed loops: at each time the plan and the zones of that time's cycle, and what really was."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.polylines import points_at, rates
from scp_planner.plotting.borders import body_of
from scp_planner.plotting.recording import (
    ObstacleRecord,
    Recording,
    ReplanRecord,
    clearance_of,
    frame_count,
    ground_of,
    profiles_of,
    record_outside,
    scene_of,
    speed_limit_at,
)
from scp_planner.plotting.scales import length_text
from scp_planner.scenario.shapes import Disc
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.boundaries import boundaries_of
from scp_planner.threat_zones.zone import by_obstacle
from scp_planner.trips.trip import discs_at

if TYPE_CHECKING:
    from scp_planner.scenario.models import Scenario
    from scp_planner.simulation.run import Run
    from scp_planner.threat_zones.zone import ThreatZone


def record_run(run: Run, frames_per_second: float = 12.5, times: ArrayLike = ()) -> Recording:
    """Sample a closed loop."""
    span = float(run.time[-1] - run.time[0])
    time = np.union1d(np.linspace(run.time[0], run.time[-1], frame_count(span, frames_per_second) + 1), times)
    cycle_times = np.array([cycle.time for cycle in run.records])
    cycle = np.clip(np.searchsorted(cycle_times, time + 1e-9, "right") - 1, 0, None)
    position = points_at(time, run.time, run.position)
    speed = np.interp(time, run.time, run.speed)
    acceleration, curvature = _driven(run)
    vehicle = run.scenario.vehicle
    given, last = (run.scenario, *run.changes), run.last_scenario
    places = dict.fromkeys(
        place for each in given for place in (*(one.position for one in each.goals), each.goal.position)
    )
    own_heading = np.interp(time, run.time, np.unwrap(run.heading))
    return Recording(
        facts=_facts(run),
        time=time,
        position=position,
        heading=own_heading,
        speed=speed,
        paths=tuple(
            plan.position(np.linspace(moment, max(moment, plan.arrival_time), 100))
            for moment, plan in zip(cycle_times, run.plans, strict=True)
        ),
        path_index=cycle,
        profiles=profiles_of(
            vehicle,
            speed,
            np.interp(time, run.time, acceleration),
            np.interp(time, run.time, curvature),
            speed_limit_at(run.scenario, position),
        ),
        obstacles=_obstacles(run, time, cycle, discs_at(position, own_heading, vehicle.discs)),
        **scene_of(_where_it_ended(run)) | {"places": tuple(one for one in places if one != last.goal.position)},
        replans=tuple(ReplanRecord(each.time, each.outcome, each.safe, each.reason) for each in run.records),
    )


def _obstacles(run: Run, time: Array, cycle: Index, discs: list[Array]) -> tuple[ObstacleRecord, ...]:
    zones = [by_obstacle(each.zones) for each in run.records]
    radius, ground = run.scenario.vehicle.radius, ground_of(run.last_scenario)
    return tuple(
        record_outside(name, clearance_of(next(each[name] for each in zones if name in each), time, discs, radius))
        if name in ground
        else _obstacle(name, run, time, cycle, discs, zones)
        for name in names_of(run)
    )


def _where_it_ended(run: Run) -> Scenario:
    """The last scenario; a target stands where it really was at the end."""
    scenario, goal = run.last_scenario, run.last_scenario.goal
    course = None if goal.target is None else run.obstacles.get(str(goal.target.obstacle))
    if course is None:
        return scenario
    x, y = (course[-1] + goal.offset).tolist()
    return changed(scenario, goal=changed(goal, position=(x, y)))


def names_of(run: Run) -> tuple[str, ...]:
    """Names of all obstacles of a run: those of its scenario first, in its order; the ground last."""
    known = [record.id for each in run.records for record in each.zones]
    names = dict.fromkeys([*(obstacle.id for obstacle in run.scenario.obstacles), *known, *run.obstacles])
    return tuple(sorted(names, key=lambda name: name in ground_of(run.last_scenario)))


def _obstacle(
    name: str, run: Run, time: Array, cycle: Index, discs: list[Array], zones: list[dict[str, list[ThreatZone]]]
) -> ObstacleRecord:
    """Put together what the cycles knew of one obstacle."""
    count = len(time)
    center, heading = np.full((count, 2), np.nan), np.zeros(count)
    # One at least, of which nothing is known, where no cycle knew of it.
    parts = max([1, *(sum(len(one.outlines) or 1 for one in several.get(name, ())) for several in zones)])
    boundary, clearance = np.full((count, parts, 48, 2), np.nan), np.full(count, np.nan)
    radius = 0.0
    for number in np.unique(cycle):
        several = zones[number].get(name)
        if several is None:
            continue
        zone = several[0]
        now = np.flatnonzero(cycle == number)
        center[now] = zone.center(time[now])
        velocity = zone.center(time[now] + 1e-3) - zone.center(time[now] - 1e-3)
        heading[now] = np.arctan2(velocity[:, 1], velocity[:, 0])
        pieces = boundaries_of(several, time[now], 48)
        # Where a cycle knew of fewer pieces, the last is drawn again.
        boundary[now] = pieces[:, np.minimum(np.arange(parts), pieces.shape[1] - 1)]
        clearance[now] = clearance_of(several, time[now], [disc[now] for disc in discs], run.scenario.vehicle.radius)
        radius = zone.radius
    shapes = {**run.shapes, **{obstacle.id: obstacle.shape for obstacle in run.scenario.obstacles}}
    body, turns = body_of(shapes.get(name) or Disc(disc=max(radius, 1e-6)))
    seen = [seen.position for each in run.records for seen in each.observations if seen.obstacle == name]
    truth = run.obstacles.get(name)
    if truth is not None:
        known = _directions(run.time, truth, time)
        heading = np.where(np.isnan(known), heading, known)
    return ObstacleRecord(
        id=name,
        center=center,
        heading=heading,
        body=body,
        turns=turns,
        padded=True,
        boundary=boundary,
        clearance=clearance,
        truth=None if truth is None else points_at(time, run.time, truth),
        observed=np.array(seen) if seen else None,
    )


def _directions(known: Array, centers: Array, time: Array) -> Array:
    """Directions of a true motion, (n,) rad: 0 where it stands, NaN where it is not there."""
    velocity = rates(centers, known)
    # m/s: slower motion has no direction.
    angle = np.where(np.hypot(*velocity.T) < 1e-6, 0.0, np.arctan2(velocity[:, 1], velocity[:, 0]))
    nearest: Array = angle[np.clip(np.searchsorted(known, time), 0, len(known) - 1)]
    return nearest


def _driven(run: Run) -> tuple[Array, Array]:
    """Acceleration, m/s2, and curvature, 1/m, of what was driven; no curvature while standing."""
    acceleration = rates(run.speed, run.time)
    turning = rates(np.unwrap(run.heading), run.time)
    # Below that the curvature is a quotient of two differences near 0.
    moving = run.speed > 0.01 * run.scenario.vehicle.max_speed
    return acceleration, np.where(moving, turning / np.where(moving, run.speed, 1.0), 0.0)


def _facts(run: Run) -> tuple[tuple[str, str], ...]:
    end = "arrived" if run.arrived else "did not arrive"
    touched = ", touched an obstacle" if run.contact else ", was touched while standing" if run.contact_standing else ""
    facts = [("closed loop", end + touched), ("travel time", f"{run.travel_time:.2f} s")]
    if math.isfinite(run.least_clearance):
        facts += [("least distance", f"{length_text(run.least_clearance)} to a true obstacle, moving")]
    outcomes = ", ".join(f"{count} {name}" for name, count in run.outcomes.items() if count)
    return (*facts, ("cycles", f"{len(run.records)}: {outcomes}"))
