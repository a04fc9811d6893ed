"""Goal of a vehicle that meets a target: where the newest estimate of the target has it at arrival."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, dist, inf, sin

import numpy as np

from scp_planner.certificate.meeting import first_meeting
from scp_planner.online.plan import OnlinePlan
from scp_planner.scenario.models import Goal, Scenario
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.target import TargetMotion
from scp_planner.threat_zones.zone import ThreatZone


@dataclass(frozen=True)
class MovingGoalParameters:
    slowest_gain: float = 0.1  # Share of the top speed at which the vehicle gains on the target at least
    longest: float = 2.0  # times the time to the meeting, which changes by no more in one replan
    surely: float = 2.0  # Standard deviations of the estimate by which who has met the target is inside of the radius
    widest: float = 0.5  # Share of the radius that this takes at most


MOVING_GOAL = MovingGoalParameters()


@dataclass(frozen=True)
class MovingGoal:
    """A target and what is asked of the arrival at it, in units of the scene."""

    target: TargetMotion
    goal: Goal  # as given, with the target
    speed: float  # by which a velocity that is to be matched may be missed, m/s
    heading: float  # rad

    @classmethod
    def of(cls, goal: Goal, zones: Sequence[ThreatZone], speed: float, heading: float) -> MovingGoal | None:
        """Return the goal by the newest zones of all obstacles; None where that of the target is not among them."""
        assert goal.target is not None, "the goal moves"
        seen = next((zone for zone in zones if zone.id == goal.target.obstacle), None)
        return None if seen is None else cls(TargetMotion.seen_as(seen, goal.offset), goal, speed, heading)

    @property
    def name(self) -> str:
        """Id of the obstacle that is the target."""
        assert self.goal.target is not None and self.goal.target.obstacle is not None, "it is an obstacle"
        return self.goal.target.obstacle

    def at(self, time: float) -> Goal:
        """Return the goal at an absolute time, s."""
        goal = self.target.goal_at(self.goal, time)
        stands = self.goal.match_velocity and goal.speed is not None and goal.speed <= self.speed
        return changed(goal, heading=None) if stands else goal

    def planned(self, time: float) -> Goal:
        """Return the goal that a plan aims at, to arrive at an absolute time, s: the estimate itself."""
        goal = self.at(time)
        return goal if self.target.covariances is None else changed(goal, radius=0.0)

    def accepted(self, time: float) -> Goal:
        """Return the goal that a trip has to reach that arrives at an absolute time, s."""
        goal = self.at(time)
        if not self.goal.match_velocity or goal.speed is None:
            return goal
        speeds, ahead = (max(goal.speed - self.speed, 0.0), goal.speed + self.speed), goal.heading
        headings = None if ahead is None else (ahead - self.heading, ahead + self.heading)
        return changed(goal, speed=None, speed_range=speeds, heading=None, heading_range=headings)

    def is_left_by(self, last: OnlinePlan) -> bool:
        """True if a plan's end is off the target's newest estimate by more than a standard deviation of that."""
        spread = self.target.covariance(last.arrival_time)
        if spread is None or self.goal.match_velocity:  # the time of a meeting with a velocity is that of the last plan
            return False
        off = np.subtract(self.target.place(last.arrival_time), last.position(last.arrival_time))
        return bool(off @ np.linalg.solve(spread, off) > 1.0)

    def is_neared_by(self, last: OnlinePlan, time: float) -> bool:
        """True if a plan ends nearer to the target than it is at an absolute time, s."""
        here, end = (dist(last.position(one), self.target.place(one)) for one in (time, last.arrival_time))
        return end < here

    def doubt(self, time: float) -> float:
        """Reduction of the radius, m, so that the target itself is surely within it at a time, s."""
        spread = self.target.covariance(time)
        if spread is None:
            return 0.0
        deviation = float(np.sqrt(np.linalg.eigvalsh(spread)[-1]))
        return min(MOVING_GOAL.surely * deviation, MOVING_GOAL.widest * self.goal.radius)

    def meeting(self, scenario: Scenario, last: OnlinePlan | None) -> float:
        """Return the absolute time at which the target is met, s; inf if it gets away.

        That is when the last plan arrives, and so much later as the vehicle takes for what its end is short of the
        target then; and never before the lower bound.
        """
        now, top = scenario.start.time, scenario.vehicle.max_speed
        least = first_meeting(changed(scenario, goal=self.goal), self.target)
        if last is None or least == inf:
            return now + least
        arrival, heading = last.arrival_time, float(last.heading(last.arrival_time))
        if self.goal.match_velocity:  # the end of the trip heads as the target does, wherever that comes from
            return now + max(arrival - now, least)
        (x, y), (u, v) = self.target.place(arrival), self.target.velocity(arrival)
        end, ahead = last.position(arrival), (cos(heading), sin(heading))
        short = (x - end[0]) * ahead[0] + (y - end[1]) * ahead[1]
        gains = max(top - u * ahead[0] - v * ahead[1], MOVING_GOAL.slowest_gain * top)
        wanted = arrival - now + float(short) / gains
        return now + max(min(wanted, MOVING_GOAL.longest * max(arrival - now, least)), least)
