"""What the penalised objective is made of: prices, hinge, margins, when it looks, and its value."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import local_minima, refine_minima
from scp_planner.scp.merit import LIMIT_NAMES, Limit, Penalties
from scp_planner.scp.settling import settle_minima
from scp_planner.trips.space import TimeTable
from scp_planner.trips.trajectory import Trajectory

OBJECTIVE_LIMITS = (*LIMIT_NAMES, "reverse", "acceleration", "offset")
"""What the penalties of limits are for; the last three SCP keeps by linear rows, so that they are 0 on its iterates."""

LATERAL, CURVATURE, SPEED = Limit.LATERAL_ACCELERATION, Limit.CURVATURE, Limit.SPEED
BOX, GOAL_SPEED = Limit.WORKSPACE_BOUNDS, Limit.GOAL_SPEED
REVERSE, ACCELERATION, OFFSET = range(len(Limit), len(OBJECTIVE_LIMITS))
OPTIONAL = len(OBJECTIVE_LIMITS)  # where the problem's optional limits begin
CLUSTER = np.linspace(-1.0, 1.0, 9)  # samples about a minimum of clearance, in steps of the grid


def limit_count(problem: Problem) -> int:
    """Return how many limits have a penalty."""
    return len(OBJECTIVE_LIMITS) + len(problem.optional)


@dataclass(frozen=True)
class Weights:
    """Prices mu of the violations.

    Attributes
    ----------
    zones : (L,) array
        s per m of entry.
    limits : (8 + E,) array
        s per unit of excess, see OBJECTIVE_LIMITS: relative, but m for box and offsets, and m/s for the goal speed;
        then of the problem's optional limits.
    """

    zones: Array
    limits: Array

    @classmethod
    def uniform(cls, problem: Problem, zones: float, limits: float | None = None) -> Weights:
        """Return one price for all zones and one (default: the same) for all limits."""
        price = zones if limits is None else limits
        return cls(np.full(problem.zones.size, zones), np.full(limit_count(problem), price))

    @classmethod
    def of(cls, penalties: Penalties) -> Weights:
        """Return the prices of a run of SCP; what its rows keep exactly costs as much as its dearest limit."""
        hard = np.full(len(OBJECTIVE_LIMITS) - len(LIMIT_NAMES), float(np.max(penalties.limits)))
        own, optional = np.split(penalties.limits, [len(LIMIT_NAMES)])
        return cls(penalties.zones.copy(), np.concatenate([own, hard, optional]))


@dataclass(frozen=True)
class Hinge:
    """Widths w of the smooth hinge; 0 is the exact one.

    Attributes
    ----------
    zones : float
        m.
    limits : float
        In the units of the excesses over limits.
    """

    zones: float = 0.0
    limits: float = 0.0


@dataclass(frozen=True)
class Margins:
    """What is added to every excess: distances to be kept, or given away where negative.

    Attributes
    ----------
    zones : (L,) array
        m.
    limits : (8 + E,) array
        See OBJECTIVE_LIMITS.
    """

    zones: Array
    limits: Array

    @classmethod
    def none(cls, problem: Problem) -> Margins:
        """Return no margins."""
        return cls(np.zeros(problem.zones.size), np.zeros(limit_count(problem)))


@dataclass(frozen=True)
class SampleTimes:
    """When clearances are looked at.

    Attributes
    ----------
    table : TimeTable
        The problem's samples, and more where a zone is near.
    shares : (n,) array
        Weights of the trapezoidal rule on [0, 1].
    jumps : (J,) array of int
        Those times at which the acceleration jumps.
    """

    table: TimeTable
    shares: Array
    jumps: Index

    @classmethod
    def of(cls, problem: Problem, extra: Array | None = None) -> SampleTimes:
        """Return the problem's samples, and further normalised times."""
        own = problem.samples.sigma
        sigma = own if extra is None else np.concatenate([own, extra])
        order = np.argsort(sigma, kind="stable")
        half = 0.5 * np.diff(sigma[order])
        shares = np.zeros(len(sigma))
        shares[order[:-1]] += half
        shares[order[1:]] += half
        table = problem.samples if extra is None else problem.space.time_table(sigma)
        return cls(table, shares, np.arange(problem.grid, len(own)))

    @classmethod
    def refined(cls, problem: Problem, trajectory: Trajectory, near: float) -> SampleTimes:
        """Return the problem's samples, and more about the minima of clearance below ``near`` (m) of a trip."""
        grid = problem.samples.sigma[: problem.grid]
        points = trajectory.at(problem.samples.take(np.arange(problem.grid)))
        clearance = problem.zones.distances(points.time, points.path.position, near)
        row, zone = local_minima(clearance, near)
        minima = refine_minima(grid, clearance, row, zone)
        settle_minima(problem, trajectory, points, row, zone, minima, clearance[row, zone])
        about = (minima[:, None] + CLUSTER * (grid[1] - grid[0])).ravel()
        return cls.of(problem, np.unique(np.clip(about, 0.0, 1.0)))


@dataclass(frozen=True)
class Pricing:
    """What the penalised objective at a fixed problem is made of.

    Attributes
    ----------
    problem : Problem
    weights : Weights
    hinge : Hinge
    times : SampleTimes
    margins : Margins
    """

    problem: Problem
    weights: Weights
    hinge: Hinge
    times: SampleTimes
    margins: Margins


@dataclass(frozen=True)
class ObjectiveValue:
    """The objective at one trip.

    Attributes
    ----------
    value : float
        Q, s.
    travel_time : float
        tau, s; inf outside D0(v0).
    zones : (L,) array
        Violations of zones, m.
    limits : (8 + E,) array
        Violations of limits, see OBJECTIVE_LIMITS.
    zone_use, limit_use : (L,), (8 + E,) arrays
        Derivatives of the violations with respect to a common margin, in [0, 1]: times the price, the multiplier.
    gradient : (K,) array
        dQ / d omega; empty if it was not asked for.
    """

    value: float
    travel_time: float
    zones: Array
    limits: Array
    zone_use: Array
    limit_use: Array
    gradient: Array = field(default_factory=lambda: np.zeros(0))


def soft_excess(excess: Array, shares: Array, width: float) -> tuple[Array, Array]:
    """Make one violation of many excesses: S_w, and its derivative with respect to each of them.

    Parameters
    ----------
    excess : (..., n) array
        g; -inf for what does not count.
    shares : (n,) array
        p, adding up to 1.
    width : float
        w, in the unit of the excess; 0: the exact hinge.

    Returns
    -------
    (violation, derivative) : (...), (..., n) arrays
    """
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
