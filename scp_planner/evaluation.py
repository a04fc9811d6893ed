"""Everything the loop needs to know of one trip: violations, the merit, and the contacts that rows are made from.

The merit is the one objective of all methods (docs: the penalised objective),

    Q = tau + sum_l mu_l max(0, deepest entry into zone l) + sum_k mu_k max(0, excess over limit k),

with the minima between samples refined, so that it is a function of the trip and not of the sampling.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scp_planner.problem import Problem
from scp_planner.trajectory import PathBend, TimeTable, Trajectory, TripPoints
from scp_planner.zones import ZoneContacts

Array = NDArray[np.float64]
Index = NDArray[np.intp]

LIMIT_NAMES = ("lateral acceleration", "curvature", "speed")


@dataclass
class Penalties:
    """Weights of the violations in the merit.

    Attributes
    ----------
    zones : (L,) array
        s per m of the deepest entry into each zone.
    limits : (3,) array
        s per unit of relative excess over lateral acceleration, curvature and speed.
    """

    zones: Array
    limits: Array


@dataclass(frozen=True)
class Evaluation:
    """One trip, evaluated.

    Attributes
    ----------
    trajectory : Trajectory
    points : TripPoints
        At the problem's samples.
    clearance : (N, L) array
        Signed distances to the inflated zones, m.
    zone_index, contact_points, contacts
        Refined minima of clearance and samples near zones, one row each.
    zone_violation : (L,) array
        Deepest entry into each zone, m, 0 where there is none.
    limit_violation : (3,) array
        Relative excess over the limits, see LIMIT_NAMES.
    """

    trajectory: Trajectory
    points: TripPoints
    bend: PathBend
    clearance: Array
    minima: TimeTable
    zone_index: Index
    minima_points: TripPoints
    contacts: ZoneContacts
    zone_violation: Array
    limit_violation: Array

    def merit(self, penalties: Penalties) -> float:
        """Travel time plus penalised violations, s."""
        return float(
            self.trajectory.travel_time
            + penalties.zones @ self.zone_violation
            + penalties.limits @ self.limit_violation
        )

    @property
    def worst_violation(self) -> float:
        """Largest of all violations (m for zones, relative for limits)."""
        worst = float(self.limit_violation.max())
        return max(worst, float(self.zone_violation.max())) if len(self.zone_violation) else worst


def evaluate_trip(problem: Problem, trajectory: Trajectory, near: float) -> Evaluation:
    """Evaluate a trip.

    Parameters
    ----------
    problem : Problem
    trajectory : Trajectory
    near : float
        Clearances below this are looked at closely, m.
    """
    samples = problem.samples
    points = trajectory.at(samples)
    clearance = problem.zones.distances(points.time, points.path.position, near)
    bend = trajectory.path.bend(points.path)
    sample, zone = local_minima(clearance, near)
    sigma = refine_minima(samples.sigma, clearance, sample, zone)
    minima = problem.space.time_table(sigma)
    minima_points = trajectory.at(minima)
    contacts = problem.zones.contacts(zone, minima_points.time, minima_points.path.position)
    violation = np.zeros(problem.zones.size)
    if problem.zones.size:
        np.maximum(-clearance.min(axis=0), 0.0, out=violation)
        np.maximum.at(violation, zone, -contacts.distance)
    return Evaluation(
        trajectory,
        points,
        bend,
        clearance,
        minima,
        zone,
        minima_points,
        contacts,
        violation,
        _limit_violation(problem, trajectory, points, bend),
    )


def local_minima(values: Array, below: float) -> tuple[Index, Index]:
    """Rows and columns of the local minima, along the rows, of the values below a bound, ends included."""
    low = values < below
    low[1:] &= values[1:] <= values[:-1]
    low[:-1] &= values[:-1] < values[1:]
    return np.nonzero(low)


def refine_minima(grid: Array, values: Array, row: Index, column: Index) -> Array:
    """Abscissae of the minima of parabolas through a sample and its two neighbours, on an equidistant grid."""
    last = len(grid) - 1
    inner = np.minimum(np.maximum(row, 1), last - 1)
    before, here, after = values[inner - 1, column], values[inner, column], values[inner + 1, column]
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / np.where(bend > 0.0, bend, np.inf)
    shift = np.where((row > 0) & (row < last), np.minimum(np.maximum(shift, -1.0), 1.0), row - inner)
    return grid[inner] + shift * (grid[1] - grid[0])


def _limit_violation(problem: Problem, trajectory: Trajectory, points: TripPoints, bend: PathBend) -> Array:
    limits = problem.limits
    curvature = np.abs(bend.curvature)
    lateral = float((points.speed**2 * curvature).max()) / limits.lateral_acceleration - 1.0
    speed = float(trajectory.speed_control_points()[1:].max()) / limits.speed - 1.0
    return np.maximum([lateral, float(curvature.max()) / limits.curvature - 1.0, speed], 0.0)
