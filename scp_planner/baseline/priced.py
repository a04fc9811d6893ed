from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index, rows_of
from scp_planner.baseline.tolerances import COUNTS, SETTLED_EXCESS
from scp_planner.constraints.clearance import local_minima, refine_minima
from scp_planner.constraints.constraint import Constraint
from scp_planner.constraints.drive import kept_by_every_step
from scp_planner.constraints.goals import GoalSpeed
from scp_planner.constraints.settling import settle_minima
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import Evaluation
from scp_planner.trips.trajectory import Trajectory


def priced_constraints(problem: Problem) -> tuple[Constraint, ...]:
    """Return what has a price: what the loop prices, then what its rows keep exactly, 0 on its iterates."""
    return (*problem.constraints, *kept_by_every_step(problem))


def violation_count(problem: Problem) -> int:
    """Return how many violations have a price, G."""
    return sum(constraint.size for constraint in priced_constraints(problem))


def places_of(problem: Problem, name: str) -> Index:
    """Return which of the violations are of constraints of a name."""
    names = [constraint.name for constraint in priced_constraints(problem) for _ in range(constraint.size)]
    return np.flatnonzero([each == name for each in names])


def uniform(problem: Problem, zones: float, others: float) -> Array:
    """Return one value for all zones and one for all else, (G,): prices, or widths of the hinge."""
    count = problem.zones.size
    return np.concatenate([np.full(count, zones), np.full(violation_count(problem) - count, others)])


def times_near(problem: Problem, trajectory: Trajectory, near: float) -> Array:
    """Return the problem's normalised times, and more about the minima of clearance below ``near``, m, of a trip."""
    grid, zones = problem.equidistant, problem.zones
    points = trajectory.at(rows_of(problem.samples, slice(problem.grid)))
    clearance = zones.distances(points.time, points.path.position, near)
    row, zone = local_minima(clearance, near)
    minima = refine_minima(grid, clearance, row, zone)
    step = problem.limits.speed * trajectory.travel_time / (problem.grid - 1)
    settle_minima(zones, step, points, row, zone, minima, clearance[row, zone])
    about = (minima[:, None] + np.linspace(-1.0, 1.0, 9) * (grid[1] - grid[0])).ravel()
    return np.concatenate([problem.samples.sigma, np.unique(np.clip(about, 0.0, 1.0))])


def trapezoidal_shares(sigma: Array) -> Array:
    """Weights of the trapezoidal rule on [0, 1] at normalised times, (n,)."""
    order = np.argsort(sigma, kind="stable")
    half = 0.5 * np.diff(sigma[order])
    shares = np.zeros(len(sigma))
    shares[order[:-1]] += half
    shares[order[1:]] += half
    return shares


def soft_excess(excess: Array, shares: Array, width: float) -> tuple[Array, Array]:
    """Make one violation of many excesses: S_w, and its derivative with respect to each of them."""
    top = np.maximum(excess.max(axis=-1, initial=0.0), 0.0)
    if width == 0.0:
        derivative = np.zeros_like(excess)
        if excess.shape[-1]:
            where = excess.argmax(axis=-1)[..., None]
            np.put_along_axis(derivative, where, (top > 0.0)[..., None].astype(float), axis=-1)
        return top, derivative
    scaled = shares * np.exp((excess - top[..., None]) / width)
    beyond_one = scaled.sum(axis=-1) + np.expm1(-top / width)
    return top + width * np.log1p(beyond_one), scaled / (1.0 + beyond_one)[..., None]


@dataclass(frozen=True)
class Violations:
    """The violations of a constraint, (size,), and their derivatives by each excess, (size, n)."""

    values: Array
    shares: Array


def softened(constraint: Constraint, trip: Trajectory, shares: Array, margins: Array, width: float) -> Violations:
    """Return the violations of a trip, margins, (size,), added to all excesses; shares are those of zones, at times."""
    excess = constraint.excess(trip).reshape(-1, constraint.size).T + margins[:, None]
    count = excess.shape[1]
    each = shares if constraint.name == "clearance" else np.full(count, 1.0 / max(count, 1))
    return Violations(*soft_excess(excess, each, width))


def slope(constraint: Constraint, trip: Trajectory, found: Violations, prices: Array) -> Array | float:
    """Gradient of the priced violations, prices (size,), with respect to a step, (step,); 0 where nothing counts."""
    shares = found.shares.T
    price = (prices * shares).ravel()
    (index,) = ((shares.ravel() > COUNTS) & (price != 0.0)).nonzero()
    return constraint.slope(trip, index, price[index]) if len(index) else 0.0


def signed_excess(problem: Problem, evaluation: Evaluation) -> Array:
    """Return the signed excesses of a trip, (G,), with the minima between samples refined; of accelerations -inf."""
    trip, found = evaluation.trajectory, []
    further = tuple(one.excess(trip) for one in kept_by_every_step(problem))
    for constraint, excess in zip(priced_constraints(problem), evaluation.excesses + further, strict=True):
        worst = constraint.worst(trip, excess)
        found.append(worst - SETTLED_EXCESS if isinstance(constraint, GoalSpeed) else worst)
    signed = np.concatenate(found)
    signed[places_of(problem, "acceleration")] = -np.inf  # kept as bounds
    return signed


def with_margins(problem: Problem, more: Array) -> Problem:
    """Return the problem with larger zones and lower limits, by margins, (G,), as the exact checks see it."""
    zones = problem.zones.size
    names = [constraint.name for constraint in priced_constraints(problem)[1:]]
    return problem.tightened(more[:zones], dict(zip(names, more[zones:].tolist(), strict=True)))
