"""The truth of a simulation: where the vehicle and the obstacles are and have been, and how near they came."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from scp_planner.arrays import Array, Mask
from scp_planner.scenario.models import Goal, Order, Passage, Scenario
from scp_planner.scenario.shapes import Disc, Shape
from scp_planner.scenario.targets import obstacle_met
from scp_planner.scenario.units import NaturalUnits
from scp_planner.simulation.run import STRANGER
from scp_planner.simulation.worlds import Script, VehicleState, World
from scp_planner.threat_zones.of_scenario import covering_radius, is_touched
from scp_planner.trips.trip import discs_at


class Stage:
    """A vehicle and what moves round it."""

    def __init__(self, scenario: Scenario, world: World | Script, shapes: Mapping[str, Shape], clock: float) -> None:
        self.scenario, self.world, self.clock = scenario, world, clock
        self.units = NaturalUnits.of(scenario)
        self.shapes = {**shapes, **{obstacle.id: obstacle.shape for obstacle in scenario.obstacles}}
        start, goal = scenario.start, scenario.goal.position
        towards = math.atan2(goal[1] - start.position[1], goal[0] - start.position[0])
        self.position = np.array(start.position, dtype=float)
        self.heading = towards if start.heading is None else start.heading
        self.speed = start.speed
        self.centers: dict[str, Array] = {}
        self.times: list[float] = []
        self.positions: list[Array] = []
        self.headings: list[float] = []
        self.speeds: list[float] = []
        self.courses: dict[str, list[Array]] = {}

    def move_world(self, time: float) -> None:
        """Let obstacles move until a time, s, with the vehicle as it is."""
        if isinstance(self.world, Script):
            places = self.world.at(np.array([time]))
            self.centers = {name: place[0] for name, place in places.items() if not np.isnan(place[0]).any()}
        else:
            velocity = self.speed * np.array([math.cos(self.heading), math.sin(self.heading)])
            vehicle = VehicleState(self.clock, self.position.copy(), velocity, self.scenario.vehicle.radius)
            moved = self.world.step(max(time - self.clock, 0.0), vehicle)
            self.centers = {name: np.asarray(place, dtype=float) for name, place in moved.items()}
        self.clock = time

    def write_down(self, time: float) -> None:
        """Write down where everybody is at a time, s."""
        self.times.append(time)
        self.positions.append(self.position.copy())
        self.headings.append(self.heading)
        self.speeds.append(self.speed)
        absent = np.full(2, np.nan)
        for name in self.centers:
            if name not in self.courses:
                self.courses[name] = [absent] * (len(self.times) - 1)
        for name, course in self.courses.items():
            course.append(self.centers.get(name, absent))

    def is_met(self) -> bool:
        """True if the vehicle is at the target, where the goal has one, and has been at those on the way."""
        goal, since = self.scenario.goal, 0
        for one in self.scenario.goals:
            if one.target is None:
                continue
            course = np.array(self.courses[one.target.obstacle or ""])
            away = np.hypot(*(np.array(self.positions) - course - one.offset).T)
            met = np.flatnonzero(away[since:] <= one.within(self.scenario.vehicle))
            if not len(met):
                return False
            if self.scenario.goals_order is Order.GIVEN:
                since += int(met[0])
        if goal.target is None:
            return True
        place = self.centers.get(goal.target.obstacle or "")
        return place is not None and float(np.hypot(*(place + goal.offset - self.position))) <= goal.radius

    def moving(self) -> Mask:
        """Between which times that were written down the vehicle moved, (n - 1,) booleans."""
        speeds = np.array(self.speeds)
        # Contact at a lower speed is contact of a vehicle that stands.
        return np.asarray(np.maximum(speeds[1:], speeds[:-1]) > 0.01 * self.units.speed)

    def clearances(self, first: int = 0) -> Array:
        """Least distances to the true obstacles between written times from one on, (n - 1 - first,) m; inf if none."""
        last = len(self.times) - 1
        reference, heading = np.array(self.positions[first:]), np.array(self.headings[first:])
        discs = discs_at(reference, heading, self.scenario.vehicle.discs)
        return np.asarray(np.min([self._disc_clearances(disc, first, last) for disc in discs], axis=0))

    def _disc_clearances(self, own: Array, first: int, last: int) -> Array:
        least = np.full(last - first, np.inf)
        goals: list[Goal | Passage] = [self.scenario.goal, *self.scenario.goals]
        for name, course in self.courses.items():
            center = np.array(course[first:])
            shape = self.shapes.get(name, STRANGER)
            if any(obstacle_met(one) == name and is_touched(self.scenario, shape, goal=one) for one in goals):
                continue
            relative = own - center
            distance = _closest(relative)
            reach = covering_radius(shape)
            distance = distance - reach
            if not isinstance(shape, Disc):
                distance = self._exact(shape, center, own, distance)
            least = np.fmin(least, distance)
        return least - self.scenario.vehicle.radius

    def _exact(self, shape: Shape, center: Array, own: Array, bound: Array) -> Array:
        """Distances to a shape that is no disc, at the ends of the steps where they matter."""
        distance = bound.copy()
        # Farther ones cannot be the nearest that matters.
        near = np.flatnonzero(bound < self.scenario.vehicle.radius + 0.5 * self.units.length)
        velocity = np.diff(center, axis=0)
        for k in near:
            heading = math.atan2(velocity[k, 1], velocity[k, 0])
            distance[k] = min(shape.distance(tuple(own[i] - center[i]), heading) for i in (k, k + 1))
        return distance


def _closest(relative: Array) -> Array:
    """Least distance from the origin of each straight piece of a polyline (n + 1, 2), (n,); NaN where not there."""
    begin, step = relative[:-1], np.diff(relative, axis=0)
    squared = (step * step).sum(axis=1)
    along = -(begin * step).sum(axis=1) / np.where(squared > 0.0, squared, 1.0)
    nearest = begin + np.clip(along, 0.0, 1.0)[:, None] * step
    return np.asarray(np.hypot(nearest[:, 0], nearest[:, 1]))
