"""Trips of several legs: each ahead or backwards, with the vehicle standing between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import pi, remainder

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index, Mask
from scp_planner.trips.trajectory import TripPoints
from scp_planner.trips.trip import Trip
from scp_planner.units import Point, Units


@dataclass(frozen=True)
class Leg:
    """A trip in one direction.

    Attributes
    ----------
    trip : Trip
        Of the reference point.
    backward : bool
        Whether the vehicle heads against the direction in which it drives.
    """

    trip: Trip
    backward: bool = False

    @property
    def begin(self) -> float:
        """Absolute time at which it sets out, s."""
        return self.trip.frame.time

    @property
    def end(self) -> float:
        """Absolute time at which it stops, s."""
        return self.begin + self.trip.trajectory.travel_time

    def heading(self, points: TripPoints) -> Array:
        """Headings of the vehicle at n points of the trip, (n,) rad in (-pi, pi]."""
        direction = self.trip.frame.vectors_to_world(points.path.direction)
        return np.arctan2(*(-direction if self.backward else direction).T[::-1])

    def pose(self, points: TripPoints) -> Array:
        """Positions in world coordinates, m, and headings of the vehicle, rad, at n points of the trip, (n, 3)."""
        return np.column_stack([self.trip.frame.to_world(points.path.position), self.heading(points)])

    def state(self, t: float) -> tuple[Point, float, float]:
        """Position in world coordinates, m, heading of the vehicle, rad, and speed, m/s, at an absolute time, s."""
        points, _ = self.trip.at(t)
        (x, y), heading = self.trip.frame.to_world(points.path.position)[0].tolist(), self.heading(points)
        return (x, y), float(heading[0]), float(points.speed[0])


@dataclass(frozen=True)
class Stand:
    """A vehicle that stands.

    Attributes
    ----------
    time : float
        Absolute time, s.
    heading : float
        Of the vehicle, rad.
    """

    time: float
    heading: float


@dataclass(frozen=True)
class Pause:
    """A time between legs, or before or after them, in which the vehicle stands, and may turn on the spot."""

    begin: Stand
    end: Stand
    position: Point

    @property
    def turn(self) -> float:
        """Angle by which the vehicle turns, rad, the shorter way round."""
        return remainder(self.end.heading - self.begin.heading, 2.0 * pi)


@dataclass(frozen=True)
class Legs:
    """Legs one after the other.

    Attributes
    ----------
    legs : tuple of Leg
        In order; the vehicle stands from the end of one to the begin of the next one.
    first, last : Stand
        Start and arrival, with the headings that the vehicle has then: it may wait, or turn on the spot, before the
        first leg and after the last one.
    """

    legs: tuple[Leg, ...]
    first: Stand
    last: Stand

    @property
    def length(self) -> float:
        """Distance that is driven, m."""
        return sum(leg.trip.trajectory.path.arc_length for leg in self.legs)

    @classmethod
    def of(cls, trip: Trip) -> Legs:
        """Return a trip as the only leg."""
        leg = Leg(trip)
        first, last = (Stand(time, leg.state(time)[1]) for time in (leg.begin, leg.end))
        return cls((leg,), first, last)

    @property
    def pauses(self) -> tuple[Pause, ...]:
        """Times in which the vehicle stands, or turns, before, between and after the legs: one more than these."""
        ends: list[tuple[Stand, Point]] = []
        for leg in self.legs:
            for time in (leg.begin, leg.end):
                position, heading, _ = leg.state(time)
                ends.append((Stand(time, heading), position))
        befores = [(self.first, ends[0][1]), *ends[1::2]]
        afters = [*(stand for stand, _ in ends[0::2]), self.last]
        return tuple(Pause(stand, after, place) for (stand, place), after in zip(befores, afters, strict=True))

    def inside(self, units: Units) -> Legs:
        """Return the legs in the units of their scene."""
        return self._of([leg.trip.inside(units) for leg in self.legs], units.instant)

    def outside(self, units: Units) -> Legs:
        """Return legs in the units of their scene in SI units."""
        return self._of([leg.trip.outside(units) for leg in self.legs], units.absolute)

    def _of(self, trips: Sequence[Trip], time: Callable[[float], float]) -> Legs:
        """Return the same legs of other trips, on another clock."""
        legs = tuple(Leg(trip, leg.backward) for trip, leg in zip(trips, self.legs, strict=True))
        first, last = (Stand(time(stand.time), stand.heading) for stand in (self.first, self.last))
        return Legs(legs, first, last)

    def told(self, t: ArrayLike, value: Callable[[Leg, TripPoints], Array]) -> Array:
        """Return a value of points of the legs at absolute times, (...) s to (..., k); while it stands, at their ends.

        At the time at which one ends and the next one begins it is that of the latter.
        """
        times = np.asarray(t, dtype=float)
        flat = times.ravel()
        index = self._index(flat)
        parts = {k: self.legs[k].trip.told(flat[index == k], partial(value, self.legs[k])) for k in set(index.tolist())}
        found = np.empty((len(flat), *next(iter(parts.values())).shape[1:])) if parts else np.empty(0)
        for k, part in parts.items():
            found[index == k] = part
        return found.reshape((*times.shape, *found.shape[1:]))

    def standing(self, t: ArrayLike) -> Mask:
        """True at the absolute times, (...) s, at which the vehicle stands between legs."""
        times = np.asarray(t, dtype=float)
        index = self._index(times)
        begin, end = np.array([(leg.begin, leg.end) for leg in self.legs]).T
        stands: Mask = (times < begin[index]) | (times > end[index])
        return stands

    def driven_before(self, t: ArrayLike) -> Array:
        """Lengths of all legs before those at absolute times, (...) s to (...) m."""
        lengths = [leg.trip.trajectory.path.arc_length for leg in self.legs]
        return np.concatenate([[0.0], np.cumsum(lengths[:-1])])[self._index(np.asarray(t, dtype=float))]

    def backward(self, t: ArrayLike) -> Mask:
        """True at the absolute times, (...) s, at which the vehicle drives backwards, or stood after it did."""
        return np.array([leg.backward for leg in self.legs])[self._index(np.asarray(t, dtype=float))]

    def heading(self, t: ArrayLike) -> Array:
        """Headings of the vehicle at absolute times, (...) s to (...) rad in (-pi, pi]."""
        heading: Array = self.poses(t)[..., 2]
        return heading

    def poses(self, t: ArrayLike) -> Array:
        """Positions in world coordinates, m, and headings, rad, at absolute times, (...) s to (..., 3)."""
        times = np.asarray(t, dtype=float)
        poses = self.told(times, Leg.pose)
        found = poses[..., 2]
        for pause in self.pauses:
            duration = pause.end.time - pause.begin.time
            there = (times > pause.begin.time) & (times < pause.end.time)
            share = (times - pause.begin.time) / (duration if duration > 0.0 else 1.0)
            found = np.where(there, pause.begin.heading + share * pause.turn, found)
        found = np.where(times >= self.last.time, self.last.heading, found)
        found = np.where(times <= self.first.time, self.first.heading, found)
        poses[..., 2] = np.arctan2(np.sin(found), np.cos(found))
        return poses

    def _index(self, times: Array) -> Index:
        begins = np.array([leg.begin for leg in self.legs])
        return np.maximum(np.searchsorted(begins, times, "right") - 1, 0)
