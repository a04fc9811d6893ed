"""Targets to meet on the way: where a trip comes nearest to each, it is within the target's radius."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.constraints.arrival import EARLIEST_MARGIN, EarliestArrival
from scp_planner.constraints.clearance import entry_gradient, refine_minima
from scp_planner.constraints.constraint import Constraint, LastTrip
from scp_planner.constraints.passing import in_order, radii, windows
from scp_planner.constraints.setup import Setup
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.threat_zones.contacts import ZoneContacts
from scp_planner.threat_zones.target import TargetMotion
from scp_planner.trips.trajectory import Trajectory, TripPoints

OUTSIDE = 1e3  # units of speed, by which times outside of a window count as lengths


@dataclass(frozen=True)
class _Nearest:
    """A trip where it comes nearest to each target, within its window."""

    points: TripPoints
    away: Array  # (K, 2) m, from the targets
    distance: Array  # (K,) m
    rate: Array  # (K, 2) m/s, of the targets
    held: Mask  # (K,) True at an end of the window


@dataclass(frozen=True)
class Meetings(Constraint):
    """Least distance from each target within its window, less its radius, m.

    At the nearest instant the distance does not change with time, so its gradient is that at a fixed time.
    """

    name: ClassVar[str] = "goals met"

    targets: PiecewisePolynomials  # (K,) m, in the planning frame and on its clock
    radius: Array  # (K,) m
    earliest: Array  # (K,) s after the start
    latest: Array  # (K,)
    _last: LastTrip[_Nearest] = field(default_factory=LastTrip, init=False, repr=False, compare=False)

    @property
    def size(self) -> int:
        return len(self.radius)

    def excess(self, trip: Trajectory) -> Array:
        return self._last.of(trip, self._nearest).distance - self.radius

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        near = self._last.of(trip, self._nearest)
        outward, points = near.away / np.maximum(near.distance, 1e-9)[:, None], near.points
        found = -entry_gradient(
            self.setup, trip, points, ZoneContacts(near.distance, outward, -(outward * near.rate).sum(axis=1))
        )
        # At the end of a window the time is fixed, not its share of the travel time
        own = points.speed[:, None] * points.path.direction
        found[:, -1] -= near.held * (outward * (own - near.rate)).sum(axis=1) * points.time
        some: Array = found[index]
        return some

    def _nearest(self, trip: Trajectory) -> _Nearest:
        samples, grid, each = trip.kept_at(self.setup.samples), self.setup.grid, np.arange(self.size)
        time, position = samples.time[:grid], samples.path.position[:grid]
        away = ((position[:, None] - self.targets.grid(time)) ** 2).sum(axis=2)
        outside = np.maximum(np.maximum(self.earliest - time[:, None], time[:, None] - self.latest), 0.0)
        column = in_order((away + (OUTSIDE * outside) ** 2).T)
        inner, step = np.clip(column, 1, grid - 2), float(time[1])
        bend = away[inner - 1, each] - 2.0 * away[inner, each] + away[inner + 1, each]
        # While neither turns, the squared distance is a parabola; else its slope there leads on
        free = refine_minima(self.setup.equidistant, away, column, each) * trip.travel_time
        near = self._at(trip, free)
        slope = 2.0 * (near.away * (near.points.speed[:, None] * near.points.path.direction - near.rate)).sum(axis=1)
        free = free - np.clip(slope * step * step / np.where(bend > 0.0, bend, np.inf), -step, step)
        kept = np.clip(free, self.earliest, self.latest)
        return replace(self._at(trip, kept), held=kept != free)

    def _at(self, trip: Trajectory, moment: Array) -> _Nearest:
        points = trip.at(self.setup.space.time_table(np.clip(moment / trip.travel_time, 0.0, 1.0)))
        place, rate = self.targets.at_with_rate(np.arange(self.size), points.time)
        away = points.path.position - place
        return _Nearest(points, away, np.hypot(*away.T), rate, np.zeros(self.size, dtype=np.bool_))


def meetings(setup: Setup) -> Iterator[Constraint]:
    """Make the constraint of the targets to meet on the way, if there are any."""
    scenario = setup.scenario
    moving = [one for one in scenario.goals if one.target is not None]
    if not moving:
        return
    targets = setup.frame.points_batch([TargetMotion.met(scenario, one).centers for one in moving])
    yield Meetings(setup, targets, radii(setup, moving), *windows(setup, moving))
    begun = [one.earliest_arrival - scenario.start.time for one in moving if one.earliest_arrival is not None]
    if begun and max(begun) > 0.0:
        yield EarliestArrival(setup, max(begun) + EARLIEST_MARGIN)
