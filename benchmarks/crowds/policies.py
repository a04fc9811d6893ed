"""Ways for a robot to drive among people: this package's planner, ORCA, and waiting until the way is free."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import scp_planner as sp
from scp_planner.settings.online import OnlineSettings
from scp_planner.simulation.crowds import Episode
from scp_planner.simulation.loop import simulate
from scp_planner.simulation.orca import Bodies, half_planes, nearest_velocities
from scp_planner.simulation.people import Manner
from scp_planner.simulation.run import Run
from scp_planner.simulation.worlds import VehicleState

Array = np.ndarray

SHY = 0.3  # m, by which people are missed by who waits
STANDING = 0.01  # m/s
PLAN_OUTCOMES = tuple(str(each) for each in sp.Outcome)


@dataclass(frozen=True)
class Outcome:
    """What came of an episode.

    Attributes
    ----------
    arrived : bool
        In time, touched or not.
    contact, contact_standing : bool
        Whether it touched somebody while it drove, and was touched while it stood.
    time : float
        s, rounded up to whole steps as the protocols count.
    least_distance : float
        To anybody, m; negative: overlap.
    replans : mapping
        Milliseconds of each replan, and how many had each outcome; empty without a planner.
    """

    arrived: bool
    contact: bool
    contact_standing: bool
    time: float
    least_distance: float
    replans: Mapping[str, Any]

    @property
    def success(self) -> bool:
        """Arrived in time and untouched."""
        return self.arrived and not self.contact and not self.contact_standing


def planned(episode: Episode, seed: int, online: OnlineSettings | None, model: sp.Model) -> tuple[Outcome, Run]:
    """Drive by the planner, in `simulate`: exact looks and a replan every step."""
    run = simulate(episode.scenario, rate=episode.rate, seed=seed, setup=episode.setup(online, model))
    return outcome_of(run, episode.step), run


def outcome_of(run: Run, step: float) -> Outcome:
    """What came of a run."""
    return Outcome(
        run.arrived,
        run.contact,
        run.contact_standing,
        math.ceil(run.travel_time / step - 1e-6) * step,
        min(record.clearance for record in run.records),
        {"wall_ms": [1e3 * wall for wall in run.wall_times[1:].tolist()], **run.outcomes},
    )


def orca_velocity(episode: Episode, vehicle: VehicleState, goal: Array) -> Array:
    """The velocity, (2,) m/s, of a robot that does its half as people do."""
    people = episode.people
    near = np.linalg.norm(people.positions - vehicle.position, axis=1) <= episode.view
    others = Bodies(people.positions[near], people.velocities[near], people.radii[near])
    return reciprocal_velocity(vehicle, goal, episode.scenario.vehicle.max_speed, others, people.manner)


def reciprocal_velocity(vehicle: VehicleState, goal: Array, top_speed: float, others: Bodies, manner: Manner) -> Array:
    """The velocity, (2,) m/s, by ORCA of a robot among others, (K,), with which it comes nearest to driving straight.

    Speeds are in m/s; ``goal`` is (2,) m; it heeds all others, in the manner of people.
    """
    padding = manner.padding
    own = Bodies(vehicle.position[None, None], vehicle.velocity[None, None], np.array([[vehicle.radius + padding]]))
    other = Bodies(others.position[None], others.velocity[None], others.radius[None] + padding)
    rows = half_planes(own, other, manner.horizon, manner.step)
    towards = goal - vehicle.position
    wanted = towards / max(float(np.hypot(*towards)), 1.0) * top_speed
    return nearest_velocities(rows, wanted[None], np.array([top_speed]))[0]


def waiting_velocity(episode: Episode, vehicle: VehicleState, goal: Array) -> Array:
    """The velocity, (2,) m/s, of a robot that drives straight and stands while anybody is near its way of a second."""
    people, limits = episode.people, episode.scenario.vehicle
    towards = goal - vehicle.position
    distance = float(np.hypot(*towards))
    ahead = towards / max(distance, 1e-9)
    offset = people.positions - vehicle.position
    along, across = offset @ ahead, offset @ np.array([-ahead[1], ahead[0]])
    wide = vehicle.radius + people.radii + SHY
    near = (along > 0.0) & (along < limits.max_speed + wide) & (np.abs(across) < wide) & (along < episode.view)
    return np.zeros(2) if near.any() else ahead * min(limits.max_speed, distance / episode.step)


POLICIES: dict[str, Callable[[Episode, VehicleState, Array], Array]] = {
    "orca": orca_velocity,
    "wait": waiting_velocity,
}


def stepped(episode: Episode, policy: Callable[[Episode, VehicleState, Array], Array]) -> Outcome:
    """Drive by velocities that are chosen every step and can change at once, as the protocols have it."""
    scenario, people, step = episode.scenario, episode.people, episode.step
    goal = np.array(scenario.goal.position)
    vehicle = VehicleState(0.0, np.array(scenario.start.position), np.zeros(2), scenario.vehicle.radius)
    elapsed, least, touched = 0.0, math.inf, {True: False, False: False}
    while elapsed < episode.time_limit - 1e-9:
        velocity = policy(episode, vehicle, goal)
        before = people.positions.copy()
        people.step(step, vehicle)
        moved = VehicleState(elapsed + step, vehicle.position + step * velocity, velocity, vehicle.radius)
        apart = closest(before - vehicle.position, people.positions - moved.position) - people.radii - vehicle.radius
        vehicle, elapsed = moved, elapsed + step
        least = min(least, float(apart.min(initial=math.inf)))
        standing = float(np.hypot(*velocity)) <= STANDING
        touched[standing] = touched[standing] or bool((apart < 0.0).any())
        if np.hypot(*(goal - vehicle.position)) < scenario.goal.radius:
            return Outcome(True, touched[False], touched[True], elapsed, least, {})
    return Outcome(False, touched[False], touched[True], elapsed, least, {})


def closest(before: Array, after: Array) -> Array:
    """Least distances from the origin of points that move straight, (n, 2) to (n, 2) m, (n,)."""
    moved = after - before
    squared = (moved**2).sum(axis=1)
    share = np.clip(-(before * moved).sum(axis=1) / np.where(squared > 0.0, squared, 1.0), 0.0, 1.0)
    return np.hypot(*(before + share[:, None] * moved).T)
