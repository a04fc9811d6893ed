"""Motion of the target that a trip is to meet, as polynomials of absolute time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2, hypot
from typing import Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import Fault, ScenarioError
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.scenario.models import Confidence, ConfidenceLevel, Goal, Obstacle, Passage, Scenario
from scp_planner.scenario.shapes import Disc
from scp_planner.scenario.targets import Target
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.zone import ThreatZone

POINT = Disc(disc=1.0)


class Followed(Target):
    """A target whose motion is estimated elsewhere, at the place to meet."""

    seen: Any = None  # TargetMotion


@dataclass(frozen=True)
class TargetMotion:
    """Place to meet, target and offset together, in the units of its scenario."""

    centers: PiecewisePolynomials  # m
    covariances: PiecewisePolynomials | None = None  # (xx, xy, yy), m^2; None where the motion is known

    @classmethod
    def of(cls, scenario: Scenario, goal: Goal | Passage | None = None) -> TargetMotion | None:
        """Return the motion of the target of a scenario's goal, or of a place to pass; None where that stands."""
        goal = goal or scenario.goal
        target = goal.target
        if target is None:
            return None
        if isinstance(target, Followed):
            seen: TargetMotion = target.seen
            return seen
        if target.obstacle is not None:
            named = [one for one in scenario.obstacles if one.id == target.obstacle]
            if not named:
                fault = Fault("target", target.obstacle, "there is no obstacle of this id")
                raise ScenarioError("Scenario", [fault])
            source = named[0]
        else:
            source = _as_obstacle(target, POINT)
        alone = changed(source, shape=POINT, margin=0.0)
        one_time = Confidence(probability=0.95, level=ConfidenceLevel.PER_TIME)
        standing = changed(scenario.goal, target=None)
        bare = changed(
            scenario, goal=standing, goals=(), obstacles=(alone,), corridor=None, walls=(), confidence=one_time
        )
        (zone,) = ZonesOf(bare)
        return cls.seen_as(zone, goal.offset, one_time.probability)

    @classmethod
    def met(cls, scenario: Scenario, goal: Goal | Passage) -> TargetMotion:
        """Return the motion of a goal, or of a place to pass: that of its target, or it stands."""
        return cls.of(scenario, goal) or cls(PiecewisePolynomials.single(0.0, np.array([goal.position])))

    @classmethod
    def seen_as(cls, zone: ThreatZone, offset: tuple[float, float], probability: float = 0.95) -> TargetMotion:
        """Return the motion of whom a zone holds at each time with a probability, met at an offset from it, m."""
        spread = zone.covariances
        if spread is not None:
            from scp_planner.tracking.confidence import NormalErrors

            scale = NormalErrors().pointwise_scale(1.0 - probability)
            spread = PiecewisePolynomials(spread.breakpoints, spread.coefficients / scale)
        return cls((zone.expected or zone.centers).plus(offset), spread)

    def places(self, times: Array) -> Array:
        """Return the places at absolute times, (n,) s to (n, 2) m."""
        return self.centers.grid(times)[:, 0]

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
        if goal.match_velocity or goal.approach is not None:
            u, v = self.velocity(time)
            speed = hypot(u, v)
        if goal.approach is not None:
            course = atan2(v, u)
            held |= {"approach": None, "heading_range": tuple(course + turn for turn in goal.approach)}
        if goal.match_velocity:
            held |= {"match_velocity": False, "speed": speed, "heading": atan2(v, u) if speed > 0.0 else None}
        return changed(goal, **held)

    @staticmethod
    def _at(polynomials: PiecewisePolynomials, time: float) -> list[float]:
        values: list[float] = polynomials.at(np.zeros(1, dtype=np.intp), np.array([time]))[0].tolist()
        return values


def tracked(scenario: Scenario) -> Scenario:
    """Return a scenario whose targets are obstacles: those that were none are of the vehicle's size.

    That of the goal is named target, and that of a place to pass by its key, goals[0].
    """
    seen = list[Obstacle]()
    parts: list[Any] = [scenario.goal, *scenario.goals]
    for number, one in enumerate(parts):
        if one.target is None or one.target.obstacle is not None:
            continue
        name = f"goals[{number - 1}]" if number else "target"
        seen.append(_as_obstacle(one.target, Disc(disc=scenario.vehicle.radius), name))
        parts[number] = changed(one, target=Target.model_construct(obstacle=name))
    if not seen:
        return scenario
    return changed(scenario, goal=parts[0], goals=tuple(parts[1:]), obstacles=(*scenario.obstacles, *seen))


def _as_obstacle(target: Target, shape: Disc, name: str = "target") -> Obstacle:
    parts = {key: getattr(target, key) for key in ("motion", "observations", "estimate", "model")}
    return Obstacle.model_construct(id=name, shape=shape, margin=0.0, **parts)


def goal_on_arrival(scenario: Scenario, time: float) -> Goal:
    """Return the goal of a trip that arrives at a time; of a target, where that is then."""
    motion = TargetMotion.of(scenario)
    return scenario.goal if motion is None else motion.goal_at(scenario.goal, time)
