"""Goal of a vehicle that meets a target: where the newest estimate of the target has it at arrival."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import dist, inf

import numpy as np

from scp_planner.certificate.meeting import first_meeting
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.online.plan import OnlinePlan
from scp_planner.online.tolerances import OFF
from scp_planner.prediction.track import ObstacleTrack
from scp_planner.scenario.models import Goal, Passage, Scenario
from scp_planner.scenario.targets import obstacle_met
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.of_scenario import is_touched
from scp_planner.threat_zones.target import TargetMotion
from scp_planner.threat_zones.zone import ThreatZone


@dataclass(frozen=True)
class MovingGoalParameters:
    surely: float = 2.0  # Standard deviations of the estimate by which who has met the target is inside of the radius
    widest: float = 0.5  # Share of the radius that this takes at most


MOVING_GOAL = MovingGoalParameters()


def doubt(target: TargetMotion, time: float, radius: float) -> float:
    """Reduction of a radius, m, so that a target itself is surely within it at a time, s."""
    spread = target.covariance(time)
    if spread is None:
        return 0.0
    deviation = float(np.sqrt(np.linalg.eigvalsh(spread)[-1]))
    return min(MOVING_GOAL.surely * deviation, MOVING_GOAL.widest * radius)


def motion_seen(goal: Goal | Passage, zones: Sequence[ThreatZone]) -> TargetMotion | None:
    """Return the motion of a target by the newest zones of all obstacles; None where it is not among them."""
    seen = next((zone for zone in zones if zone.id == obstacle_met(goal)), None)
    return None if seen is None else TargetMotion.seen_as(seen, goal.offset)


def but_for_touched(
    zones: tuple[ThreatZone, ...],
    goals: Sequence[Goal | Passage],
    scenario: Scenario,
    tracks: Mapping[str, ObstacleTrack],
) -> tuple[ThreatZone, ...]:
    """Return the zones but for those of the targets that the vehicle is to touch."""
    met = [(tracks.get(obstacle_met(goal) or ""), goal) for goal in goals]
    touched = {one.id for one, goal in met if one and is_touched(scenario, one.shape, one.margin, goal)}
    return tuple(zone for zone in zones if zone.id not in touched) if touched else zones


@dataclass(frozen=True)
class MovingGoal:
    """A target and what is asked of the arrival at it, in units of the scene."""

    target: TargetMotion
    goal: Goal  # as given, with the target
    near: float  # m, of the place: as near is met
    speed: float  # by which a velocity that is to be matched may be missed, m/s
    heading: float  # rad

    @classmethod
    def of(
        cls, goal: Goal, zones: Sequence[ThreatZone], near: float, speed: float, heading: float
    ) -> MovingGoal | None:
        """Return the goal by the newest zones of all obstacles; None where that of the target is not among them."""
        target = motion_seen(goal, zones)
        return None if target is None else cls(target, goal, near, speed, heading)

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
        if self.target.covariances is None:  # known exactly, it is met as in the certificate of a plan
            return self.target.goal_at(self.goal, time)
        goal = changed(self.at(time), radius=self.near)
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

    def is_met_by(self, last: OnlinePlan) -> bool:
        """True if a plan ends where the newest estimate has the target then."""
        time = last.arrival_time
        return dist(last.position(time), self.target.place(time)) <= self.near + OFF

    def is_neared_by(self, last: OnlinePlan, time: float) -> bool:
        """True if a plan ends nearer to the target than it is at an absolute time, s."""
        here, end = (dist(last.position(one), self.target.place(one)) for one in (time, last.arrival_time))
        return end < here

    def doubt(self, time: float) -> float:
        """Reduction of the radius, m, so that the target itself is surely within it at a time, s."""
        return doubt(self.target, time, self.goal.radius)

    def meeting(self, scenario: Scenario, last: OnlinePlan | None) -> float:
        """Return the absolute time at which the target is met, s; inf if it gets away.

        The vehicle is taken to come as much later than straight on at full acceleration as by the last plan. Where the
        target has got away by then, the time is the lower bound.
        """
        now = scenario.start.time
        straight = changed(scenario, goal=self.goal)
        least = first_meeting(straight, self.target)
        if last is None or least == inf:
            return now + least
        end = TargetMotion(PiecewisePolynomials.single(now, np.array([last.position(last.arrival_time)])))
        delay = max(last.arrival_time - now - first_meeting(straight, end), 0.0)
        delayed = changed(straight, start=changed(straight.start, time=now + delay))
        met = first_meeting(delayed, self.target)
        return now + (least if met == inf else delay + met)
