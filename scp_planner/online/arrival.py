"""Arrival: where, how fast and in which heading the vehicle is at its goal."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from scp_planner.certificate.tolerances import GOAL_SPEED_TOLERANCE
from scp_planner.online.following import Following
from scp_planner.online.moving_goal import MovingGoal
from scp_planner.online.remaining import State
from scp_planner.online.stops import Braking
from scp_planner.scenario.goals import distance_outside
from scp_planner.scenario.models import Goal
from scp_planner.scenario.units import changed
from scp_planner.settings.online import SceneOnlineSettings
from scp_planner.trips.trip import Trip


class Waiting:
    """Counts the time in which the vehicle comes no nearer to its goal than it was; coming nearer makes up for it."""

    def __init__(self) -> None:
        self._nearest, self._clock, self._waited = math.inf, math.inf, 0.0

    def waited(self, time: float, away: float) -> float:
        """Take note of a time, s, and of how far the goal is, m, and return the time, s."""
        passed, nearer = max(time - self._clock, 0.0), away < self._nearest
        self._waited = max(self._waited + (-passed if nearer else passed), 0.0)
        self._nearest, self._clock = min(away, self._nearest), time
        return self._waited


@dataclass(frozen=True)
class ArrivalParameters:
    arrived: float = 1e-3  # Units of length: nearer than this there is no way left to plan
    heading: float = 0.05  # rad, of a goal's heading, where the follower states no tolerance that is larger
    gentle: float = 0.5  # Least share of the deceleration with which the vehicle brakes to its goal


ARRIVAL = ArrivalParameters()


class Arrival:
    """Conditions of arrival at a goal, in units of the scene."""

    def __init__(self, goal: Goal, following: Following, online: SceneOnlineSettings) -> None:
        self.goal, self._vehicle = goal, following.vehicle
        given = online.arrival_tolerance
        if given is None:
            given = online.period * following.top_speed if goal.radius == 0.0 and goal.region is None else 0.0
        self.near = max(goal.radius + given, ARRIVAL.arrived)
        self.tolerance = self._tolerance = self.near + following.largest
        self.speed = GOAL_SPEED_TOLERANCE + max(
            following.vehicle.max_deceleration * online.period, following.speed or 0.0
        )
        self.heading = max(ARRIVAL.heading, following.heading or 0.0)

    def move(self, moving: MovingGoal, time: float) -> None:
        """Take the goal for where it is at an absolute time, s."""
        goal, doubt = moving.at(time), moving.doubt(time)
        # Within the radius, whose velocity is not that of the target yet has not met it.
        self.goal = changed(goal, radius=0.0 if moving.goal.match_velocity else goal.radius - doubt)
        self.tolerance = self._tolerance - doubt

    def is_there(self, place: tuple[float, float], heading: float | None = None) -> bool:
        """True if a position is within the tolerance of the goal; of a goal that is a region, that of the middle."""
        if self.goal.region is None:
            return math.dist(place, self.goal.position) <= self.tolerance
        if heading is not None:
            ahead = self._vehicle.centre
            place = place[0] + ahead * math.cos(heading), place[1] + ahead * math.sin(heading)
        return distance_outside(self.goal.region, place) <= self.tolerance

    def is_end_of(self, trip: Trip) -> bool:
        end = trip.positions_at(np.array([trip.frame.time + trip.trajectory.travel_time]))
        ((x, y),) = trip.frame.to_world(end).tolist()
        if self.goal.region is None:
            return self.is_there((x, y))
        return distance_outside(self.goal.region, (x, y)) <= self.tolerance + abs(self._vehicle.centre)

    def is_as_asked(self, state: State) -> bool:
        goal, heading = self.goal, state.heading
        low, high = goal.speed_range or (goal.speed, goal.speed)
        if low is not None and high is not None and not low - self.speed <= state.speed <= high + self.speed:
            return False
        if heading is None:
            return True
        if goal.heading is not None:
            return abs(math.remainder(heading - goal.heading, 2.0 * math.pi)) <= self.heading
        if goal.heading_range is None:
            return True
        first, last = goal.heading_range
        turned = abs(math.remainder(heading - 0.5 * (first + last), 2.0 * math.pi))
        return turned <= 0.5 * (last - first) + self.heading

    def is_done(self, place: tuple[float, float]) -> bool:
        """True if there is no way left to plan from a position: it is in the goal."""
        if self.goal.region is not None and distance_outside(self.goal.region, place) == 0.0:
            return True
        return math.dist(place, self.goal.position) <= max(ARRIVAL.arrived, self.goal.radius)

    @property
    def may_be_passed(self) -> bool:
        """True if the goal asks for no speed."""
        return self.goal.speed is None and self.goal.speed_range is None

    @property
    def is_to_stand(self) -> bool:
        """True if the goal asks for a speed at which the vehicle stands."""
        low, _ = self.goal.speed_range or (self.goal.speed, self.goal.speed)
        return low is not None and low <= self.speed

    def braking_to_it(self, state: State, braking: Braking) -> Braking:
        """Return the braking that ends nearest to the goal straight ahead, between half and all of a braking."""
        heading, (x, y) = state.heading or 0.0, self.goal.position
        ahead = (x - state.position[0]) * math.cos(heading) + (y - state.position[1]) * math.sin(heading)
        asked = state.speed**2 / (2.0 * ahead) if ahead > 0.0 else braking.deceleration
        least = ARRIVAL.gentle * braking.deceleration
        return replace(braking, deceleration=min(max(asked, least), braking.deceleration))
