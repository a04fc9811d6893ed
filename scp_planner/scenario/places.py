"""Places along a line: which stretch of it a point belongs to, and how fast it may be driven there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from scp_planner.arrays import Array, Mask, cross
from scp_planner.scenario.tolerances import SAME_FOOT, SAME_PLACE

if TYPE_CHECKING:
    from scp_planner.scenario.models import Scenario


FOLLOWED = 150  # of the points of a drive, at most, of each of which the next one's place along a line is told


class Line:
    """A polyline with stations."""

    def __init__(self, points: Array) -> None:
        self.points = np.asarray(points, dtype=float)
        legs = np.diff(self.points, axis=0)
        self._lengths = np.hypot(legs[:, 0], legs[:, 1])
        self._tangents = legs / self._lengths[:, None]
        self._stations = np.concatenate([[0.0], np.cumsum(self._lengths)])
        self.length = float(self._stations[-1])

    @cached_property
    def loop(self) -> float:
        """Length of the shortest loop that the line makes, from a place to where it crosses itself there, m; or inf."""
        begins, ends, least = self.points[:-1], self.points[1:], np.inf
        for k in range(len(begins) - 2):
            here, to, far = ends[k] - begins[k], ends[k + 2 :] - begins[k + 2 :], begins[k + 2 :] - begins[k]
            with np.errstate(divide="ignore", invalid="ignore"):
                own, other = cross(far, to) / cross(here, to), cross(far, here) / cross(here, to)
            met = (own >= 0.0) & (own <= 1.0) & (other >= 0.0) & (other <= 1.0)
            apart = (self._stations[k + 2 : -1] + other * self._lengths[k + 2 :])[met]
            least = min(least, float((apart - self._stations[k] - own[met] * self._lengths[k]).min(initial=np.inf)))
        return least

    def followed(self, points: Array) -> Array | None:
        """Stations of a vehicle at points in the order that it drives over them, (n, 2) m; None if nothing crosses.

        Where the line crosses itself, the vehicle stays on the part of it that it came by.
        """
        if not np.isfinite(self.loop):
            return None
        some = np.unique(np.linspace(0, len(points) - 1, FOLLOWED).round().astype(np.intp))
        stations = [self.nearest(points[:1])]
        for k in some[1:].tolist():
            stations.append(self.nearest(points[k : k + 1], stations[-1]))
        return self.nearest(points, np.interp(np.arange(len(points)), some, np.concatenate(stations)))

    def nearest(self, points: Array, about: Array | None = None) -> Array:
        """Stations of the points of the line nearest to points (n, 2), (n,) m; within half a loop of some, (n,) m."""
        along, away = self._onto_legs(points, about)
        leg = np.argmin(away, axis=1)
        every = np.arange(len(points))
        stations: Array = self._stations[leg] + np.clip(along[every, leg], 0.0, self._lengths[leg])
        return stations

    def distances(self, points: Array) -> Array:
        """Distances of points (n, 2), (n,) m."""
        least: Array = self._onto_legs(points)[1].min(axis=1)
        return least

    def across_border(self, position: Array, border: float) -> Array:
        """Return the direction in which points pass over a border most directly."""
        leg = int(np.searchsorted(self._stations[1:-1], border, "right"))
        along = self._onto_legs(position[None])[0][0] + self._stations[:-1]
        before = self._foot(position, np.clip(along, self._stations[:-1], np.minimum(self._stations[1:], border)))
        after = self._foot(position, np.clip(along, np.maximum(self._stations[:-1], border), self._stations[1:]))
        if np.hypot(*(after - before)) < SAME_FOOT * self.length:
            tangent: Array = self._tangents[leg]
            return tangent
        away, beyond = position - before, position - after
        normal = away / np.hypot(*away) - beyond / np.hypot(*beyond)
        direction: Array = normal / np.hypot(*normal)
        return direction

    def _foot(self, position: Array, stations: Array) -> Array:
        """The nearest of points at given stations, one a leg; those that are not on their leg do not count."""
        on_leg = (stations >= self._stations[:-1]) & (stations <= self._stations[1:])
        feet = self.points[:-1] + (stations - self._stations[:-1])[:, None] * self._tangents
        away = np.where(on_leg, np.hypot(*(position - feet).T), np.inf)
        nearest: Array = feet[np.argmin(away)]
        return nearest

    def may_be_between(
        self, points: Array, reach: Array, first: float, last: float, about: Array | None = None
    ) -> Mask:
        """True if any point within a distance of the points (n, 2), (n,) m, may belong to a stretch."""
        along, away = self._onto_legs(points, about)
        reach = reach[:, None]
        candidate = away - reach <= away.min(axis=1, keepdims=True) + reach
        low = self._stations[:-1] + np.clip(along - reach, 0.0, self._lengths)
        high = self._stations[:-1] + np.clip(along + reach, 0.0, self._lengths)
        found: Mask = np.any(candidate & (high >= first) & (low <= last), axis=1)
        return found

    def _onto_legs(self, points: Array, about: Array | None = None) -> tuple[Array, Array]:
        """Stations of points on each leg, not limited to it, and distances from it, (n, legs) m.

        Only what lies within half a loop of stations, (n,) m, counts where these are given.
        """
        offset = points[:, None] - self.points[:-1]
        along = (offset * self._tangents).sum(axis=2)
        across = offset[:, :, 0] * self._tangents[:, 1] - offset[:, :, 1] * self._tangents[:, 0]
        if about is None:
            beyond = along - np.clip(along, 0.0, self._lengths)
            return along, np.hypot(across, beyond)
        since = about[:, None] - self._stations[:-1]
        low, high = np.maximum(since - 0.5 * self.loop, 0.0), np.minimum(since + 0.5 * self.loop, self._lengths)
        nearest = np.clip(along, low, high)
        return nearest, np.where(low <= high, np.hypot(across, along - nearest), np.inf)


@dataclass(frozen=True)
class Stretch:
    """A stretch of a line and how fast it may be driven: stations in m, m/s."""

    line: Line
    first: float
    last: float
    speed: float


def stretches(scenario: Scenario) -> tuple[Stretch, ...]:
    """Return the speed limits of a scenario by place, in world coordinates; those along one line share it."""
    found, lines = [], dict[Sequence[tuple[float, float]], Line]()
    for limit in scenario.speed_limits:
        points = tuple(limit.line or reference_line(scenario))
        line = lines.setdefault(points, Line(np.array(points)))
        found.append(Stretch(line, limit.from_, np.inf if limit.to is None else limit.to, limit.speed))
    return tuple(found)


def reference_line(scenario: Scenario) -> Sequence[tuple[float, float]]:
    """Return what places are measured along: the guide of a scenario, or the straight line from start to goal."""
    return scenario.guide or (scenario.start.position, scenario.goal.position)


def anchored(scenario: Scenario) -> Scenario:
    """Return a scenario whose places stay where they are when its start moves on."""
    if all(limit.line is not None for limit in scenario.speed_limits):
        return scenario
    line = reference_line(scenario)
    limits = tuple(limit.model_copy(update={"line": limit.line or line}) for limit in scenario.speed_limits)
    return scenario.model_copy(update={"speed_limits": limits})


def followed(parts: Sequence[Stretch], positions: Array) -> dict[Line, Array | None]:
    """Return the stations along each line of a vehicle that drives over positions, (n, 2) m, in their order."""
    return {line: line.followed(positions) for line in {part.line: None for part in parts}}


def limits_at(parts: Sequence[Stretch], positions: Array, about: Mapping[Line, Array | None] | None = None) -> Array:
    """Lowest limit at positions (n, 2) m, (n,) m/s; inf where there is none; of each line within half a loop of some.

    See :meth:`Line.followed`.
    """
    limit = np.full(len(positions), np.inf)
    driven = about or {}
    stations = {line: line.nearest(positions, driven.get(line)) for line in {part.line: None for part in parts}}
    for part in parts:
        station, near = stations[part.line], SAME_PLACE * part.line.length
        within = (station >= part.first - near) & (station <= part.last + near)
        np.minimum(limit, part.speed, out=limit, where=within)
    return limit
