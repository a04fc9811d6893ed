"""Convention by which a sampled trip is a motion in continuous time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index, cross, unit_vectors
from scp_planner.mathematics.tolerances import STRAIGHT
from scp_planner.trips.samples import SampledTrajectory


@dataclass(frozen=True)
class EndVelocity:
    """Known velocity at an end of a trip: m/s and rad, None where nothing is known."""

    speed: float | None = None
    heading: float | None = None


NOTHING_KNOWN = EndVelocity()


def velocities(
    samples: SampledTrajectory, first: EndVelocity = NOTHING_KNOWN, last: EndVelocity = NOTHING_KNOWN
) -> Array:
    """Return the velocities at the samples."""
    found = _of_parabolas(samples.time, samples.position)
    speed = np.hypot(found[:, 0], found[:, 1])
    chords = np.diff(samples.position, axis=0)
    # Where it stands, a given speed needs a direction all the same: that of the way ahead.
    ahead = np.where((speed > 0.0)[:, None], found, np.concatenate([chords, chords[-1:]]))
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    for row, end in ((0, first), (-1, last)):
        heading[row] = heading[row] if end.heading is None else end.heading
        speed[row] = speed[row] if end.speed is None else end.speed
    heading = heading if samples.heading is None else samples.heading
    unit = unit_vectors(heading)
    if samples.speed is not None:
        speed = samples.speed
    elif samples.heading is not None:
        inner = slice(0 if first.speed is None else 1, len(speed) - (0 if last.speed is None else 1))
        speed[inner] = np.maximum((found * unit).sum(axis=1), 0.0)[inner]
    result: Array = speed[:, None] * unit
    return result


def _of_parabolas(time: Array, position: Array) -> Array:
    """Velocities of the parabolas through three neighbours each."""
    step = np.diff(time)[:, None]
    mean = np.diff(position, axis=0) / step
    if len(mean) == 1:
        return np.concatenate([mean, mean])
    inner = (step[1:] * mean[:-1] + step[:-1] * mean[1:]) / (step[:-1] + step[1:])
    found = np.concatenate([2.0 * mean[:1] - inner[:1], inner, 2.0 * mean[-1:] - inner[-1:]])
    still = ~mean.any(axis=1)
    found[:-1][still] = 0.0
    found[1:][still] = 0.0
    return found


@dataclass(frozen=True)
class SampledMotion:
    """A motion in m pieces of constant acceleration, in order of time: two between any two samples."""

    begin: Array  # (m,) Times, s
    end: Array  # (m,) Times, s
    anchor: Array  # (m,) The end of the piece that is a sample, s
    position: Array  # (m, 2) At the anchor, m and m/s
    velocity: Array  # (m, 2) At the anchor, m and m/s
    acceleration: Array  # (m, 2) m/s^2

    @classmethod
    def between(cls, samples: SampledTrajectory, velocity: Array) -> SampledMotion:
        """Return the motion through samples with velocities (n, 2), m/s."""
        time, position = samples.time, samples.position
        step = np.diff(time)[:, None]
        mean, before, after = np.diff(position, axis=0) / step, velocity[:-1], velocity[1:]
        # By differences of velocities: a velocity that stays the same leaves no acceleration but rounding.
        first = (4.0 * (mean - before) - (after - before)) / step
        second = (4.0 * (after - mean) - (after - before)) / step
        middle = 0.5 * (time[:-1] + time[1:])
        return cls(
            _woven(time[:-1], middle),
            _woven(middle, time[1:]),
            _woven(time[:-1], time[1:]),
            _woven(position[:-1], position[1:]),
            _woven(before, after),
            _woven(first, second),
        )

    def at(self, times: Array) -> tuple[Array, Array]:
        """Positions and velocities at times, (n,) s, of the motion: (n, 2) m and m/s."""
        piece = np.minimum(np.searchsorted(self.end, times), len(self.end) - 1)
        elapsed = (times - self.anchor[piece])[:, None]
        changed = elapsed * self.acceleration[piece]
        return self.position[piece] + elapsed * (self.velocity[piece] + 0.5 * changed), self.velocity[piece] + changed

    def velocity_at(self, piece: Index, time: Array) -> Array:
        """Velocities at times (n,) of pieces (n,), (n, 2) m/s."""
        elapsed = (time - self.anchor[piece])[:, None]
        found: Array = self.velocity[piece] + elapsed * self.acceleration[piece]
        return found

    def position_at(self, piece: Index, time: Array) -> Array:
        """Positions at times (n,) of pieces (n,), (n, 2) m."""
        elapsed = (time - self.anchor[piece])[:, None]
        moved = self.velocity[piece] + 0.5 * elapsed * self.acceleration[piece]
        found: Array = self.position[piece] + elapsed * moved
        return found

    @property
    def turn(self) -> Array:
        """Velocity x acceleration, (m,) m^2/s^3: constant on a piece; 0 where they are in line but for rounding."""
        turn = cross(self.velocity, self.acceleration)
        size = np.hypot(*self.velocity.T) * np.hypot(*self.acceleration.T)
        found: Array = np.where(np.abs(turn) <= STRAIGHT * size, 0.0, turn)
        return found


def _woven(a: Array, b: Array) -> Array:
    """Rows of two arrays in turns."""
    return np.stack([a, b], axis=1).reshape(-1, *a.shape[1:])
