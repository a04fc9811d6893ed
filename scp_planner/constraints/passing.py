"""Places to pass: beside the station of the guide that is nearest to each, the path keeps what that place asks for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, pi, remainder, tan
from typing import ClassVar, Self

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.constraints.constraint import Constraint
from scp_planner.constraints.setup import Setup
from scp_planner.scenario.models import Passage
from scp_planner.trips.guide import Guide
from scp_planner.trips.trajectory import Trajectory


@dataclass(frozen=True)
class PassingSettings:
    """Margins from what a place asks for, in natural units, and stations that are looked at."""

    near: float = 4e-4  # units of length, from the border of the disc of a place; half of a smaller radius
    turned: float = 1e-3  # rad, from the ends of a range of headings; half of a smaller range
    askew: float = 1.4  # rad off the guide: farther turned are no headings of a path over it
    early: float = 5e-4  # units of time, from the ends of a window; half of a smaller one
    step: float = 0.05  # units of length, between stations among which the nearest is looked for
    most: int = 20_000  # of them
    slowest: float = 0.1  # units of speed, at which a delay is told from a length


PASSING = PassingSettings()


@dataclass(frozen=True)
class Beside(Constraint):
    """Excess rows . theta - upper: bounds of offsets and slopes at stations are linear in the control points."""

    name: ClassVar[str] = "goals"

    matrix: Array  # (n, K1)
    upper: Array  # (n,)

    @property
    def size(self) -> int:
        return len(self.upper)

    def tightened(self, more: float) -> Self:
        return replace(self, upper=self.upper - more)

    def excess(self, trip: Trajectory) -> Array:
        found: Array = self.matrix @ trip.theta - self.upper
        return found

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        del trip  # they are linear
        return self.setup.of_path(self.matrix[index][:, self.setup.ends.free])


@dataclass(frozen=True)
class InTime(Constraint):
    """Excess t(s) - latest, then earliest - t(s), of the times at which stations are passed, s."""

    name: ClassVar[str] = "goals in time"

    parameter: Array  # (n,) Normalised stations
    earliest: Array  # (n,) s after the start
    latest: Array  # (n,)

    @property
    def size(self) -> int:
        return 2 * len(self.parameter)

    def excess(self, trip: Trajectory) -> Array:
        time = trip.travel_time * trip.arrivals(trip.path.arc_length_at(self.parameter)).sigma
        return np.concatenate([time - self.latest, self.earliest - time])

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        """Gradient of a time, from D(t) = L(s): (dL - tau^2 C . d beta) / v + t (1 - v0 / v) rho."""
        late, place = np.divmod(index, len(self.parameter))
        parameter, space, tau = self.parameter[place], trip.space, trip.travel_time
        met = trip.arrivals(trip.path.arc_length_at(parameter))
        v, sign = np.maximum(met.speed, PASSING.slowest), np.where(late, -1.0, 1.0)
        theta = trip.path.arc_length_gradient(parameter) / v[:, None]
        beta = space.time_table(met.sigma).distance * (-tau * tau / v)[:, None]
        rho = tau * met.sigma * (1.0 - space.start_speed / v)
        return self.setup.of_all(sign[:, None] * theta, sign[:, None] * beta, sign * rho)


def passing(setup: Setup) -> Iterator[Constraint]:
    """Make the constraints of the places to pass, if there are any."""
    guide, space = setup.space.guide, setup.space
    goals = [one for one in setup.scenario.goals if one.target is None]
    if not goals:
        return
    places = setup.frame.to_frame(np.array([one.position for one in goals]))
    stations = stations_of(guide, places)
    parameter, frame = stations / space.length, guide.frame(stations)
    away = places - frame.position
    radius = radii(setup, goals)
    along, offset = (away * frame.tangent).sum(axis=1), (away * frame.normal).sum(axis=1)
    half = np.sqrt(np.maximum(radius**2 - along**2, 0.0))
    rows, slopes = space.path.rows(parameter), space.path.derivative.rows(parameter) / space.length
    matrix, upper = [*rows, *-rows], [*(offset + half), *(half - offset)]
    for k, one in enumerate(goals):
        if one.heading_range is None:
            continue
        low, high = one.heading_range
        spread = max(0.5 * (high - low) - PASSING.turned, 0.25 * (high - low))
        guided = setup.frame.heading + float(np.arctan2(frame.tangent[k, 1], frame.tangent[k, 0]))
        middle = remainder(0.5 * (low + high) - guided, 2.0 * pi)
        # The path turns off the guide by h where f' = tan h (1 - k f)
        for sign, turn in ((1.0, middle + spread), (-1.0, middle - spread)):
            slope = tan(min(max(turn, -PASSING.askew), PASSING.askew))
            matrix.append(sign * (slopes[k] + slope * frame.curvature[k] * rows[k]))
            upper.append(sign * slope)
    yield Beside(setup, np.array(matrix), np.array(upper))
    timed = [k for k, one in enumerate(goals) if one.earliest_arrival is not None or one.latest_arrival is not None]
    if timed:
        early, late = windows(setup, [goals[k] for k in timed])
        yield InTime(setup, parameter[timed], early, late)


def radii(setup: Setup, goals: Sequence[Passage]) -> Array:
    """Return the radii of places to pass, less a margin, (K,) m."""
    radius = np.array([one.within(setup.vehicle) for one in goals])
    return radius - np.minimum(PASSING.near, 0.5 * radius)


def windows(setup: Setup, goals: Sequence[Passage]) -> tuple[Array, Array]:
    """Return the earliest and latest times of places to pass, a margin inside of their windows, (K,) s from start."""
    start = setup.scenario.start.time
    early = np.array([-inf if one.earliest_arrival is None else one.earliest_arrival - start for one in goals])
    late = np.array([inf if one.latest_arrival is None else one.latest_arrival - start for one in goals])
    margin = np.minimum(PASSING.early, 0.5 * (late - early))
    return early + margin, late - margin


def stations_of(guide: Guide, places: Array) -> Array:
    """Stations of a guide at which it is nearest to places, (K, 2) m, one after the other: (K,) m."""
    count = min(max(2, round(guide.length / PASSING.step)), PASSING.most)
    stations = np.linspace(0.0, guide.length, count + 1)
    away = ((places[:, None] - guide.frame(stations).position) ** 2).sum(axis=2)
    nearest = stations[in_order(away)]
    for _ in range(2):
        frame = guide.frame(nearest)
        relative = places - frame.position
        along, across = (relative * frame.tangent).sum(axis=1), (relative * frame.normal).sum(axis=1)
        step = along / np.maximum(1.0 - frame.curvature * across, 0.1)
        nearest = np.clip(nearest + np.clip(step, -PASSING.step, PASSING.step), 0.0, guide.length)
    return nearest


def in_order(costs: Array) -> Index:
    """Columns, one for each row of costs, (K, n), none before the one of the row before, of the least sum: (K,)."""
    columns = np.arange(costs.shape[1])
    least, chosen = costs[0], list[Array]()
    for row in costs[1:]:
        best = np.minimum.accumulate(least)
        leads = np.where(least <= best, columns, 0)
        chosen.append(np.maximum.accumulate(leads))
        least = best + row
    found = [int(np.argmin(least))]
    for before in reversed(chosen):
        found.append(int(before[found[-1]]))
    return np.array(found[::-1])
