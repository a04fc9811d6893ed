"""The pieces of a sampled motion: their extremes in closed form, and where the vehicle's discs are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import atan2

import numpy as np

from scp_planner.arrays import Array, Mask, cross, left_of
from scp_planner.certificate.enclosures import Enclosed, Pace, Pieces, VehicleDisc
from scp_planner.certificate.tolerances import STANDING_TURN
from scp_planner.trips.sampled_motion import SampledMotion
from scp_planner.trips.tolerances import WITHOUT_DIRECTION

FEWEST_PARTS = 192  # of a motion at the first level


def first_pieces(motion: SampledMotion, knots: Array) -> Pieces:
    """Cut a motion at the ends of its pieces and at other times, (k,) s, and into no fewer parts than a few."""
    first, last = motion.begin[0], motion.end[-1]
    even = np.linspace(first, last, FEWEST_PARTS + 1)
    inner = knots[(knots > first) & (knots < last)]
    return Pieces.between(np.unique(np.concatenate([motion.begin, [last], even, inner])))


@dataclass(frozen=True)
class PieceVelocities:
    """Velocities of a motion's pieces."""

    motion: SampledMotion
    first: Array  # (m, 2) Velocities at the ends of the pieces, m/s
    last: Array  # (m, 2) Velocities at the ends of the pieces, m/s
    turn: Array  # (m,) Velocity x acceleration, m^2/s^3
    slowest: Array  # (m,) The least speed of each piece, m/s
    when_slowest: Array  # (m,) s
    still: float  # Slower than this, a velocity has no direction, m/s

    @classmethod
    def of(cls, motion: SampledMotion) -> PieceVelocities:
        """Return what can be said of a motion's pieces."""
        every = np.arange(len(motion.begin))
        first, last = motion.velocity_at(every, motion.begin), motion.velocity_at(every, motion.end)
        size = np.hypot(*motion.acceleration.T)
        square = np.where(size > 0.0, size, 1.0) ** 2
        away = -(motion.velocity * motion.acceleration).sum(axis=1) / square
        when = np.clip(motion.anchor + away, motion.begin, motion.end)
        when = np.where(size > 0.0, when, motion.begin)
        inside = (when > motion.begin) & (when < motion.end)
        turn = motion.turn
        slowest = np.where(
            inside, np.abs(turn) / np.where(size > 0.0, size, 1.0), np.hypot(*motion.velocity_at(every, when).T)
        )
        top = max(np.hypot(*first.T).max(), np.hypot(*last.T).max())
        return cls(motion, first, last, turn, slowest, when, WITHOUT_DIRECTION * float(top))

    def largest(self, numerator: Array, power: int) -> Array:
        """Return a numerator by a power of the least speed of each piece, (m,); 0 where the motion is straight."""
        turning = self.turn != 0.0
        found = np.zeros(len(numerator))
        with np.errstate(divide="ignore", over="ignore"):
            found[turning] = numerator[turning] / self.slowest[turning] ** power
        return found

    @cached_property
    def entering(self) -> Array:
        """Directions in which the pieces begin, (m, 2) unit vectors; nan where nothing moves."""
        return self._direction(self.first, self.motion.acceleration)

    @cached_property
    def leaving(self) -> Array:
        """Directions in which the pieces end, (m, 2) unit vectors; nan where nothing moves."""
        return self._direction(self.last, -self.motion.acceleration)

    def _direction(self, velocity: Array, otherwise: Array) -> Array:
        """Direction of a velocity, or where there is none of what it grows from."""
        speed = np.hypot(*velocity.T)
        duration = self.motion.end - self.motion.begin
        moves = np.hypot(*otherwise.T) * duration > self.still
        vector = np.where((speed > self.still)[:, None], velocity, np.where(moves[:, None], otherwise, np.nan))
        found: Array = vector / np.hypot(*vector.T)[:, None]
        return found

    def heading(self, piece: int) -> float:
        """Heading at the beginning of the first piece, or the end of the last one, of those that move, rad."""
        found = self.entering if piece == 0 else self.leaving
        moving = np.flatnonzero(np.isfinite(found[:, 0]))
        if not len(moving):
            return 0.0
        x, y = found[moving[piece]]
        return atan2(y, x)

    @cached_property
    def acceleration_at_begin(self) -> Array:
        """Along the path at the beginning of each piece, (m,) m/s^2."""
        return self._along(self.entering)

    @cached_property
    def acceleration_at_end(self) -> Array:
        """Along the path at the end of each piece, (m,) m/s^2."""
        return self._along(self.leaving)

    def _along(self, direction: Array) -> Array:
        found: Array = (self.motion.acceleration * np.nan_to_num(direction, nan=0.0)).sum(axis=1)
        return found

    @cached_property
    def backwards(self) -> Mask:
        """Pieces that come to a stop in line and go back."""
        against = (self.entering * self.leaving).sum(axis=1) < 0.0
        moving = np.minimum(np.hypot(*self.first.T), np.hypot(*self.last.T)) > self.still
        found: Mask = (self.turn == 0.0) & against & moving
        return found

    @cached_property
    def standing_turn(self) -> Array:
        """By how much each piece begins in another direction than the one before ended, (m,) rad, 0 of the first."""
        found = np.zeros(len(self.turn))
        moving = np.flatnonzero(np.isfinite(self.entering[:, 0]))
        before, after = self.leaving[moving[:-1]], self.entering[moving[1:]]
        angle = np.abs(np.arctan2(cross(before, after), (before * after).sum(axis=1)))
        standing = np.hypot(*self.first[moving[1:]].T) <= self.still
        found[moving[1:]] = np.where(standing, angle, 0.0)
        return found

    @cached_property
    def courses(self) -> Array:
        """A direction for each piece, that of the one before where nothing moves, (m, 2)."""
        moving = np.isfinite(self.entering[:, 0])
        if not moving.any():
            return np.tile([1.0, 0.0], (len(moving), 1))
        last = np.maximum.accumulate(np.where(moving, np.arange(len(moving)), -1))
        before = np.where((last >= 0)[:, None], self.leaving[last], self.entering[np.argmax(moving)])
        found: Array = np.where(moving[:, None], self.entering, before)
        return found

    def turned(self, offset: float) -> float:
        """Largest distance of a disc from its course where the vehicle stands and turns by very little, m."""
        return 0.5 * abs(offset) * min(float(self.standing_turn.max()), STANDING_TURN)


@dataclass(frozen=True)
class EnclosedSamples(Enclosed):
    """Bounds of a motion given by samples on pieces of time, s, none across the end of one of its own pieces."""

    velocities: PieceVelocities
    pieces: Pieces

    @property
    def pace(self) -> Pace:
        disc = self.disc(0.0)
        speed = np.hypot(*disc.velocity.T)
        return Pace(disc.half, disc.position, speed, speed + disc.acceleration * disc.half, disc.time)

    def disc(self, offset: float) -> VehicleDisc:
        known, motion, (middle, half) = self.velocities, self.velocities.motion, (self.pieces.middle, self.pieces.half)
        piece = np.searchsorted(motion.begin, middle, "right") - 1
        velocity = motion.velocity_at(piece, middle)
        position = motion.position_at(piece, middle)
        bend = np.hypot(*motion.acceleration.T)[piece]
        off = np.full(len(middle), known.turned(offset))
        if offset == 0.0:
            return VehicleDisc(middle, half, position, velocity, bend, off, off)
        turn, speed = known.turn[piece], np.hypot(*velocity.T)
        turning = turn != 0.0
        course = known.courses[piece].copy()
        course[turning] = velocity[turning] / speed[turning, None]
        across = left_of(course)
        least = np.maximum(speed - bend * half, known.slowest[piece])
        with np.errstate(divide="ignore", over="ignore"):
            rate = np.where(turning, turn / np.where(turning, speed, 1.0) ** 2, 0.0)
            most = np.where(turning, np.abs(turn) / np.where(turning, least, 1.0) ** 2, 0.0)
            change = 2.0 * most * bend / np.where(turning, least, 1.0)
        return VehicleDisc(
            middle,
            half,
            position + offset * course,
            velocity + (offset * rate)[:, None] * across,
            bend + abs(offset) * np.hypot(change, most**2),
            off,
            off,
        )
