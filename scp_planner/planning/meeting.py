"""Arrival of a plan at a target that moves."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, pi, sqrt

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.check import HasTrip
from scp_planner.certificate.passing import passes_of
from scp_planner.certificate.tolerances import END_TOLERANCE
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.threat_zones.target import TargetMotion
from scp_planner.trips.legs import Legs


@dataclass(frozen=True)
class Meeting:
    """Arrival of a plan at a target of its scenario, or at a place to pass.

    Attributes
    ----------
    time : float
        s, absolute.
    place, velocity : tuple of float
        Of the target at that time, with the goal's offset, m and m/s; of a target that is estimated, the mean.
    distance : float
        From the place to the vehicle, m.
    probability : float
        With which the target is within its radius, m, of the vehicle then: 1 or 0 of a motion that is known.
    """

    time: float
    place: tuple[float, float]
    velocity: tuple[float, float]
    distance: float
    probability: float


def meeting(scenario: Scenario, plan: HasTrip) -> Meeting:
    """Tell how a plan meets the target of its scenario.

    Parameters
    ----------
    scenario : Scenario
        With a target.
    plan : Plan
        Or whatever else has a ``trip``.

    Returns
    -------
    Meeting

    Raises
    ------
    ValueError
        If the goal of the scenario has no target.
    """
    target, legs = TargetMotion.of(scenario), _legs(plan)
    if target is None:
        raise ValueError("scenario.goal.target: null; the goal of this scenario stands")
    return _met(scenario, legs, legs.last.time, target, scenario.goal.radius)


def meetings(scenario: Scenario, plan: HasTrip) -> dict[int, Meeting]:
    """Tell when and where a plan passes places and meets targets on the way, each for the first time in its order.

    Parameters
    ----------
    scenario : Scenario
        With ``goals``.
    plan : Plan
        Or whatever else has a ``trip``.

    Returns
    -------
    dict of int to Meeting
        By the number of each of ``goals``, the first one 0, in the order in which they are passed.
    """
    found = dict[int, Meeting]()
    for one in sorted(passes_of(_legs(plan), scenario), key=lambda one: one.time):
        if one.passed:
            goal = scenario.goals[one.number]
            target = TargetMotion.met(scenario, goal)
            found[one.number] = _met(scenario, _legs(plan), one.time, target, goal.within(scenario.vehicle))
    return found


def _legs(plan: HasTrip) -> Legs:
    return getattr(plan, "legs", None) or Legs.of(plan.trip)


def _met(scenario: Scenario, legs: Legs, time: float, target: TargetMotion, radius: float) -> Meeting:
    away = legs.poses(time)[:2] - np.array(target.place(time))
    distance, covariance = float(np.hypot(*away)), target.covariance(time)
    if covariance is None:
        certain = float(distance <= radius + END_TOLERANCE * NaturalUnits.to_check(scenario, legs.length).length)
        return Meeting(time, target.place(time), target.velocity(time), distance, certain)
    return Meeting(time, target.place(time), target.velocity(time), distance, within(radius, away, covariance))


def within(radius: float, mean: Array, covariance: Array) -> float:
    """Return the probability that a normal vector of a mean (2,), m, is no longer than a radius, m.

    In the axes of the covariance, one component is integrated out in closed form and the other by quadrature.
    """
    from scipy.integrate import quad  # takes long to load
    from scipy.special import ndtr

    variances, axes = np.linalg.eigh(covariance)
    (s, t), (m, n) = np.sqrt(np.maximum(variances, 0.0)), axes.T @ mean
    if radius <= 0.0:
        return 0.0
    if s == 0.0:
        raise ValueError("covariance: must be positive definite")

    def strip(y: float) -> float:
        half, z = sqrt(max(radius * radius - y * y, 0.0)), (y - n) / t
        inside = ndtr((half - m) / s) - ndtr((-half - m) / s)
        return float(exp(-0.5 * z * z) / (sqrt(2.0 * pi) * t) * inside)

    low, high = max(-radius, n - 9.0 * t), min(radius, n + 9.0 * t)
    return float(quad(strip, low, high, epsabs=1e-10, limit=200)[0]) if low < high else 0.0
