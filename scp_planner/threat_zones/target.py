"""Motion of the target that a trip is to meet, as polynomials of absolute time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2, hypot

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.scenario.models import Confidence, ConfidenceLevel, Goal, Obstacle, Scenario
from scp_planner.scenario.shapes import Disc
from scp_planner.scenario.targets import Target
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.zone import ThreatZone

POINT = Disc(disc=1.0)


@dataclass(frozen=True)
class TargetMotion:
    """Place to meet, target and offset together, in the units of its scenario."""

    centers: PiecewisePolynomials  # m
    covariances: PiecewisePolynomials | None = None  # (xx, xy, yy), m^2; None where the motion is known

    @classmethod
    def of(cls, scenario: Scenario) -> TargetMotion | None:
        """Return the motion of a scenario's target; None of a goal that stands."""
        target, goal = scenario.goal.target, scenario.goal
        if target is None:
            return None
        if target.obstacle is not None:
            source = next(one for one in scenario.obstacles if one.id == target.obstacle)
        else:
            source = _as_obstacle(target, POINT)
        alone = changed(source, shape=POINT, margin=0.0)
        one_time = Confidence(probability=0.95, level=ConfidenceLevel.PER_TIME)
        standing = changed(goal, target=None)
        bare = changed(scenario, goal=standing, obstacles=(alone,), corridor=None, walls=(), confidence=one_time)
        (zone,) = ZonesOf(bare)
        return cls.seen_as(zone, goal.offset, one_time.probability)

    @classmethod
    def seen_as(cls, zone: ThreatZone, offset: tuple[float, float], probability: float = 0.95) -> TargetMotion:
        """Return the motion of whom a zone holds at each time with a probability, met at an offset from it, m."""
        spread = zone.covariances
        if spread is not None:
            from scp_planner.tracking.confidence import NormalErrors

            scale = NormalErrors().pointwise_scale(1.0 - probability)
            spread = PiecewisePolynomials(spread.breakpoints, spread.coefficients / scale)
        return cls((zone.expected or zone.centers).plus(offset), spread)

    def place(self, time: float) -> tuple[float, float]:
        """Return the place at an absolute time."""
        x, y = self._at(self.centers, time)
        return x, y

    def velocity(self, time: float) -> tuple[float, float]:
        """Return the velocity at an absolute time."""
        u, v = self._at(self.centers.derivative, time)
        return u, v

    def covariance(self, time: float) -> Array | None:
        """Return the covariance of the place at an absolute time, (2, 2); None where the motion is known."""
        if self.covariances is None:
            return None
        xx, xy, yy = self._at(self.covariances, time)
        return np.array([[xx, xy], [xy, yy]])

    def steady(self, since: float) -> TargetMotion:
        """Return the motion of a target that keeps up the velocity that it has at an absolute time, s."""
        line = np.array([self.place(since), self.velocity(since)])
        return replace(self, centers=PiecewisePolynomials.single(since, line))

    def goal_at(self, goal: Goal, time: float) -> Goal:
        """Return the goal that stands where the target is to be met at a time."""
        held: dict[str, object] = {"position": self.place(time), "target": None, "offset": (0.0, 0.0)}
        if goal.match_velocity:
            u, v = self.velocity(time)
            speed = hypot(u, v)
            held |= {"match_velocity": False, "speed": speed, "heading": atan2(v, u) if speed > 0.0 else None}
        return changed(goal, **held)

    @staticmethod
    def _at(polynomials: PiecewisePolynomials, time: float) -> list[float]:
        values: list[float] = polynomials.at(np.zeros(1, dtype=np.intp), np.array([time]))[0].tolist()
        return values


def tracked(scenario: Scenario) -> Scenario:
    """Return a scenario whose target is an obstacle: one named target, of the vehicle's size, where it was none."""
    target = scenario.goal.target
    if target is None or target.obstacle is not None:
        return scenario
    seen = _as_obstacle(target, Disc(disc=scenario.vehicle.radius))
    goal = changed(scenario.goal, target=Target.model_construct(obstacle=seen.id))
    return changed(scenario, goal=goal, obstacles=(*scenario.obstacles, seen))


def _as_obstacle(target: Target, shape: Disc) -> Obstacle:
    parts = {key: getattr(target, key) for key in ("motion", "observations", "estimate", "model")}
    return Obstacle.model_construct(id="target", shape=shape, margin=0.0, **parts)


def goal_on_arrival(scenario: Scenario, time: float) -> Goal:
    """Return the goal of a trip that arrives at a time; of a target, where that is then."""
    motion = TargetMotion.of(scenario)
    return scenario.goal if motion is None else motion.goal_at(scenario.goal, time)
