"""Simple motions in closed form: arcs in either gear, each with a smooth speed profile, and turns on the spot."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

USED = 0.7
"""Share of each limit of the vehicle that a motion uses."""
GRID: Array = np.linspace(0.0, 1.0, 401)
"""Shares of the time of a piece, at which its largest speed, acceleration and jerk are looked up."""


@dataclass(frozen=True)
class Profile:
    """Share of the length by share of the time: a quintic without acceleration at its ends.

    ``begin`` and ``end`` are the speeds there, in lengths a duration.
    """

    begin: float = 0.0
    end: float = 0.0

    def derivative(self, order: int, share: ArrayLike) -> Array:
        """Evaluate a derivative with respect to the share of the time; of order 0, the profile itself."""
        d, e = self.begin, self.end
        cubic = np.polynomial.Polynomial(
            [0.0, d, 0.0, 10.0 - 6.0 * d - 4.0 * e, -15.0 + 8.0 * d + 7.0 * e, 6.0 - 3.0 * (d + e)]
        )
        return np.asarray(cubic.deriv(order)(np.asarray(share, dtype=float)) if order else cubic(np.asarray(share)))

    def most(self, order: int) -> float:
        """Largest absolute value of a derivative."""
        return float(np.abs(self.derivative(order, GRID)).max())


@dataclass(frozen=True)
class Turn:
    """Turn on the spot, by so many rad."""

    angle: float
    profile: Profile = Profile()

    def duration(self, vehicle: Mapping[str, Any]) -> float:
        return abs(self.angle) * self.profile.most(1) / (USED * float(vehicle["max_turn_rate"]))

    def poses(self, begin: Array, share: Array) -> Array:
        return begin + self.profile.derivative(0, share)[:, None] * np.array([0.0, 0.0, self.angle])

    def speeds(self, share: Array, _: float) -> Array:
        return np.zeros_like(share)


@dataclass(frozen=True)
class Drive:
    """Drive along arcs of (length, curvature), in m and 1/m, in one gear: 1 ahead, -1 backwards."""

    arcs: tuple[tuple[float, float], ...]
    profile: Profile = Profile()
    gear: float = 1.0

    @property
    def length(self) -> float:
        return sum(length for length, _ in self.arcs)

    def duration(self, vehicle: Mapping[str, Any]) -> float:
        """Return the least time, s, that leaves room to every limit."""
        top, speeding = float(vehicle["max_speed"]), float(vehicle["max_acceleration"])
        if self.gear < 0.0:
            top = float(vehicle["reverse"]["max_speed"])
        least = min(speeding, float(vehicle["max_deceleration"]))
        bent = max(abs(curvature) for _, curvature in self.arcs)
        times = [
            self.length * self.profile.most(1) / (USED * top),
            math.sqrt(self.length * self.profile.most(2) / (USED * least)),
            self.length * self.profile.most(1) * math.sqrt(bent / (USED * float(vehicle["max_lateral_acceleration"]))),
        ]
        if vehicle.get("max_jerk") is not None:
            times.append(math.cbrt(self.length * self.profile.most(3) / (USED * float(vehicle["max_jerk"]))))
        return max(times)

    def poses(self, begin: Array, share: Array) -> Array:
        """Return poses (n, 3) at shares of the time, from one pose on."""
        driven = self.length * self.profile.derivative(0, share)
        found = np.broadcast_to(begin, (len(share), 3)).copy()
        for length, curvature in self.arcs:
            here = driven > 0.0
            found[here] = _arc(begin, self.gear * np.minimum(driven[here], length), curvature)
            begin, driven = _arc(begin, np.array([self.gear * length]), curvature)[0], driven - length
        return found

    def speeds(self, share: Array, duration: float) -> Array:
        return self.gear * self.length / duration * self.profile.derivative(1, share)


Piece = Turn | Drive


def _arc(begin: Array, driven: Array, curvature: float) -> Array:
    """Poses (n, 3) after signed distances (n,), m, on an arc."""
    x, y, heading = begin
    half = 0.5 * curvature * driven
    chord = driven * np.sinc(half / math.pi)
    return np.stack([x + chord * np.cos(heading + half), y + chord * np.sin(heading + half), heading + 2.0 * half], 1)


class Motion:
    """Pieces one after the other, from a pose and a time on, within the limits of a vehicle."""

    def __init__(self, begin: Array, clock: float, pieces: Iterable[Piece], vehicle: Mapping[str, Any]) -> None:
        self.pieces = tuple(pieces)
        durations = [piece.duration(vehicle) for piece in self.pieces]
        self.times = clock + np.concatenate([[0.0], np.cumsum(durations)])
        poses = [np.asarray(begin, dtype=float)]
        for piece in self.pieces:
            poses.append(piece.poses(poses[-1], np.ones(1))[0])
        self._poses = poses

    @property
    def start(self) -> float:
        return float(self.times[0])

    @property
    def end(self) -> float:
        return float(self.times[-1])

    @property
    def duration(self) -> float:
        return self.end - self.start

    def poses(self, times: ArrayLike) -> Array:
        """Poses (n, 3): x, y in m, and the heading of the vehicle in rad, at times (n,) s."""
        when = np.atleast_1d(np.asarray(times, dtype=float))
        found = np.empty((when.size, 3))
        for here, number, share in self._pieces_at(when):
            found[here] = self.pieces[number].poses(self._poses[number], share)
        return found

    def position(self, times: ArrayLike) -> Array:
        return self.poses(times)[:, :2]

    def heading(self, times: ArrayLike) -> Array:
        return self.poses(times)[:, 2]

    def speeds(self, times: ArrayLike) -> Array:
        """Speeds (n,), m/s, negative backwards."""
        when = np.atleast_1d(np.asarray(times, dtype=float))
        found = np.empty(when.size)
        for here, number, share in self._pieces_at(when):
            found[here] = self.pieces[number].speeds(share, float(np.diff(self.times)[number]))
        return found

    def velocity(self, time: float) -> Array:
        (heading,), (speed,) = self.heading(time), self.speeds(time)
        return float(speed) * np.array([math.cos(heading), math.sin(heading)])

    def _pieces_at(self, when: Array) -> Iterable[tuple[NDArray[np.bool_], int, Array]]:
        """Find the times that belong to each piece, and the shares of its duration that they are."""
        owner = np.clip(np.searchsorted(self.times, when, side="right") - 1, 0, len(self.pieces) - 1)
        for number in range(len(self.pieces)):
            here = owner == number
            share = (when[here] - self.times[number]) / (self.times[number + 1] - self.times[number])
            yield here, number, np.clip(share, 0.0, 1.0)
