"""Dodges: short trips in many directions, each at several speeds and ending in a stop, looked at all together.

A *course* leads on from where the vehicle is: straight, in any direction where its heading is free; else it turns by
an angle, as tightly as the limits allow, and goes straight on. A *profile* speeds up or slows down to a level, keeps it
for a while, and brakes to a stop; then the vehicle stands. A dodge is a course driven by a profile. Standing still is
one.

All are sampled at the same times, so that distances to all zones come from a few array operations. Samples decide which
dodge is tried first, never what is safe: that is up to the certificate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.remaining import State
from scp_planner.scenario.limits import Box, Limits
from scp_planner.scenario.models import Vehicle
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.guide import CurvedGuide, Guide, StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import CELLS_PER_SPAN, TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

DIRECTIONS = 32
"""Where the heading is free."""
TURNS = np.radians([0.0, 10.0, 22.0, 40.0, 65.0, 100.0, 140.0, 180.0])
"""To either side, where it is not."""
LEVELS = (1.0, 0.5)
"""Shares of the top speed."""
CRUISES = (0.0, 1.0, 2.0, 4.0, 8.0)
"""Times for which a level is kept, in those in which the vehicle drives its own width."""
SPANS = 32
"""Of the accelerations of a dodge, all as long as each other."""
WHOLE = 3
"""Spans that are lost where phases become whole numbers of them."""
LOOKS = 48
"""Samples of a dodge."""
TABLE = 33
"""Points of a turn, of which the others are interpolated."""
LIMIT_SHARE = 0.98
"""Of the limits, that dodges use."""
BEND_PEAK = 1.5
"""The largest slope of the step by which a course turns."""
PATH_PIECES = (4, 8, 16)
"""Spans of a path that turns: the fewest whose pieces are shorter than a fourth of the turn."""
NEAR = 0.1
"""Units of length. Distances to outlines beyond this need not be exact."""
_SHARES = np.linspace(0.0, 1.0, TABLE)
_BREAKS = tuple(np.linspace(0.0, 1.0, SPANS + 1).tolist())
_PATH_DEGREE = 3


def _smooth(share: Array) -> Array:
    """A step from 0 to 1 without a jump of its slope."""
    share = np.minimum(share, 1.0)
    smooth: Array = share * share * (3.0 - 2.0 * share)
    return smooth


@dataclass(frozen=True)
class DodgeDrive:
    """What a dodge drives along its course.

    Attributes
    ----------
    start_speed : float
        m/s.
    degree : int
        Of the acceleration.
    breakpoints : tuple of float
        Of the acceleration, in normalised time.
    beta : array
        Control points of the acceleration, m/s^2.
    lasts : float
        s.
    """

    start_speed: float
    degree: int
    breakpoints: tuple[float, ...]
    beta: Array
    lasts: float


class DodgeProfiles(Protocol):
    """P drives that end in a stop."""

    @property
    def stands(self) -> Array:
        """When the vehicle stands, (P,) s from now."""
        ...

    @property
    def fastest(self) -> Array:
        """Highest speeds, (P,) m/s."""
        ...

    @property
    def way(self) -> Array:
        """How far they go, (P,) m."""
        ...

    def distance(self, times: Array) -> Array:
        """Distances driven at times (J,), (P, J) m."""
        ...

    def drive(self, number: int) -> DodgeDrive:
        """What one of them drives."""
        ...


def levels_and_cruises(top: float, width: float) -> tuple[Array, Array]:
    """The levels of profiles, (P,) m/s, and for how long they are kept, (P,) s; the first is a stop at once.

    Parameters
    ----------
    top : float
        Speed, m/s.
    width : float
        Of the vehicle, m.

    Returns
    -------
    ((P,) array, (P,) array)
    """
    levels, cruises = np.meshgrid(np.array(LEVELS) * top, np.array(CRUISES) * width / top)
    return np.concatenate([[0.0], levels.ravel()]), np.concatenate([[0.0], cruises.ravel()])


@dataclass(frozen=True)
class Profiles:
    """P drives that end in a stop.

    Attributes
    ----------
    speed : (P, SPANS + 1) array
        At the ends of the spans, m/s.
    span : (P,) array
        Length of a span, s.
    stands : (P,) array
        When the vehicle stands, s from now.
    """

    speed: Array
    span: Array
    stands: Array

    @classmethod
    def of(cls, state: State, limits: Limits, width: float, wait: float) -> Profiles:
        """Return the profiles of a vehicle.

        Parameters
        ----------
        state : State
        limits : Limits
        width : float
            Of the vehicle, m.
        wait : float
            For how long it is to stand at the end, s.

        Returns
        -------
        Profiles
        """
        start_speed = state.speed
        level, cruise = levels_and_cruises(limits.speed, width)
        rate = np.where(level > start_speed, limits.acceleration, limits.deceleration) * LIMIT_SHARE
        change, braking = np.abs(level - start_speed) / rate, level / (limits.deceleration * LIMIT_SHARE)
        span = np.maximum(change + cruise + braking + wait, width / limits.speed) / (SPANS - WHOLE)
        first, last = np.ceil(change / span), np.ceil(braking / span)
        end = first + np.round(cruise / span) + last
        number = np.arange(SPANS + 1)
        risen = np.clip(number / np.maximum(first, 1.0)[:, None], 0.0, 1.0)
        left = np.clip((end[:, None] - number) / np.maximum(last, 1.0)[:, None], 0.0, 1.0)
        speed = (start_speed + (level - start_speed)[:, None] * risen) * np.where(last[:, None] > 0.0, left, 1.0)
        return cls(speed, span, end * span)

    @property
    def fastest(self) -> Array:
        """Highest speeds, (P,) m/s."""
        highest: Array = self.speed.max(axis=1)
        return highest

    @property
    def way(self) -> Array:
        """How far they go, (P,) m."""
        return self.driven[:, -1]

    def drive(self, number: int) -> DodgeDrive:
        """What one of them drives."""
        speeds, span = self.speed[number], float(self.span[number])
        return DodgeDrive(float(speeds[0]), 0, _BREAKS, np.diff(speeds) / span, SPANS * span)

    @cached_property
    def driven(self) -> Array:
        """Distances at the ends of the spans, (P, SPANS + 1) m."""
        steps = 0.5 * (self.speed[:, 1:] + self.speed[:, :-1]) * self.span[:, None]
        return np.concatenate([np.zeros((len(self.span), 1)), np.cumsum(steps, axis=1)], axis=1)

    def distance(self, times: Array) -> Array:
        """Distances driven at times (J,), (P, J) m."""
        place = np.minimum(times / self.span[:, None], SPANS - 1e-9)
        number = place.astype(np.intp)
        rest = place - number
        profile = np.arange(len(self.span))[:, None]
        begin, after = self.speed[profile, number], self.speed[profile, number + 1]
        distance: Array = self.driven[profile, number] + self.span[:, None] * rest * (
            begin + 0.5 * rest * (after - begin)
        )
        return distance


@dataclass(frozen=True)
class Courses:
    """K courses from a place.

    Attributes
    ----------
    base : (K,) array
        Direction in which each begins, rad.
    turn : (K,) array
        By how much it turns, rad.
    """

    base: Array
    turn: Array

    @classmethod
    def of(cls, heading: float | None, ahead: float) -> Courses:
        """Return the courses of a vehicle with a heading, or a free one; then one of them leads ahead, rad."""
        if heading is None:
            base = ahead + 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
            return cls(base, np.zeros(DIRECTIONS))
        turn = np.concatenate([TURNS, -TURNS[1:-1]])
        return cls(np.full(len(turn), heading), turn)

    @cached_property
    def _turning(self) -> Array:
        """Points of turns of length 1, (K, TABLE, 2) m, in the direction in which they begin."""
        angle = self.turn[:, None] * _smooth(_SHARES)
        unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        steps = 0.5 * (unit[:, 1:] + unit[:, :-1]) / (TABLE - 1)
        return np.concatenate([np.zeros((len(self.turn), 1, 2)), np.cumsum(steps, axis=1)], axis=1)

    def along(self, length: Array, distance: Array) -> tuple[Array, Array]:
        """Places and headings.

        Parameters
        ----------
        length : (K, P) array
            Of the turns, m.
        distance : (P, J) array
            m.

        Returns
        -------
        ((K, P, J, 2) array, (K, P, J) array)
            m from where the courses begin, and rad.
        """
        share = distance / length[:, :, None]
        within = np.minimum(share, 1.0)
        place = np.minimum(within * (TABLE - 1), TABLE - 1 - 1e-9)
        number = place.astype(np.intp)
        rest = (place - number)[..., None]
        course = np.arange(len(self.turn))[:, None, None]
        table = self._turning
        local = table[course, number] * (1.0 - rest) + table[course, number + 1] * rest
        end = np.stack([np.cos(self.turn), np.sin(self.turn)], axis=-1)[:, None, None]
        local += np.maximum(share - 1.0, 0.0)[..., None] * end
        local *= length[:, :, None, None]
        c, s = np.cos(self.base)[:, None, None], np.sin(self.base)[:, None, None]
        x, y = local[..., 0], local[..., 1]
        heading = self.base[:, None, None] + self.turn[:, None, None] * _smooth(within)
        return np.stack([c * x - s * y, s * x + c * y], axis=-1), heading


@dataclass(frozen=True)
class Dodges:
    """All courses driven by all profiles: C = K P dodges, the profiles of the first course first.

    Attributes
    ----------
    courses : Courses
        In the planning frame.
    profiles : DodgeProfiles
    length : (K, P) array
        Of the turns, m.
    wait : float
        For how long a vehicle is to stand at the end, s.
    times : (J,) array
        s from now.
    position : (C, J, 2) array
        m, in the planning frame.
    heading : (C, J) array
        rad.
    """

    courses: Courses
    profiles: DodgeProfiles
    length: Array
    wait: float
    times: Array
    position: Array
    heading: Array

    @classmethod
    def of(
        cls, heading: float | None, profiles: DodgeProfiles, ahead: float, limits: Limits, radius: float, wait: float
    ) -> Dodges:
        """Return the dodges of a vehicle.

        Parameters
        ----------
        heading : float or None
            In the planning frame, rad; None: free.
        profiles : DodgeProfiles
        ahead : float
            Direction of interest, rad.
        limits : Limits
        radius : float
            Of the vehicle, m: it does not turn more tightly, if nothing else limits that.
        wait : float
            For how long it is to stand at the end, s.

        Returns
        -------
        Dodges
        """
        courses = Courses.of(heading, ahead)
        fastest = profiles.fastest
        tightest = np.maximum(
            radius if np.isinf(limits.curvature) else 1.0 / (LIMIT_SHARE * limits.curvature),
            fastest**2 / (LIMIT_SHARE * limits.lateral_acceleration),
        )
        # Of a course that does not turn any length will do.
        length = np.maximum(BEND_PEAK * np.abs(courses.turn)[:, None], 1e-3) * tightest
        times = np.linspace(0.0, float((profiles.stands + wait).max()), LOOKS)
        position, headings = courses.along(length, profiles.distance(times))
        count = length.size
        return cls(
            courses, profiles, length, wait, times, position.reshape(count, LOOKS, 2), headings.reshape(count, LOOKS)
        )

    @cached_property
    def until(self) -> Array:
        """When each has been over for as long as it is to stand, (C,) s from now."""
        return np.tile(self.profiles.stands + self.wait, len(self.courses.turn))

    def distances(self, batch: ZoneBatch, box: Box, vehicle: Vehicle) -> tuple[Array, Index]:
        """Distances of the vehicle to all zones together, and to the border of the workspace.

        Parameters
        ----------
        batch : ZoneBatch
            In the planning frame, inflated by the vehicle.
        box : Box
        vehicle : Vehicle

        Returns
        -------
        ((C, J) array, (C, J) array of int)
            m, lower bounds that are exact where it is near; and the nearest zone, -1 for the border.
        """
        least, whose = np.full(self.heading.shape, np.inf), np.full(self.heading.shape, -1)
        near = self._within_reach(batch, max(map(abs, vehicle.discs)))
        rounds, others = near[batch.outline_slot[near] < 0], near[batch.outline_slot[near] >= 0]
        for offset in vehicle.discs:
            place = self.position
            if offset != 0.0:
                place = place + offset * np.stack([np.cos(self.heading), np.sin(self.heading)], axis=-1)
            found = []
            if len(rounds):
                found.append((rounds, self._from_rounds(batch.subset(rounds), place)))
            if len(others):
                times, points = np.tile(self.times, len(place)), place.reshape(-1, 2)
                found.append((others, batch.subset(others).distances(times, points, NEAR).reshape(*least.shape, -1)))
            if len(box.offsets):
                found.append((np.array([-1]), box.room(place)[..., None]))
            for numbers, distance in found:
                which = distance.argmin(axis=-1)
                value = np.take_along_axis(distance, which[..., None], axis=-1)[..., 0]
                whose = np.where(value < least, numbers[which], whose)
                least = np.minimum(least, value)
        return least, whose

    def _from_rounds(self, batch: ZoneBatch, place: Array) -> Array:
        """Distances to zones without outlines, (C, J, L) m, in the direction of their centres: never too large.

        They do not grow any more from when the vehicle stands.
        """
        count, profiles = len(self.courses.turn), len(self.profiles.stands)
        offset = place.reshape(count, profiles, LOOKS, 1, 2) - batch.centers.grid(self.times)
        x, y = offset[..., 0], offset[..., 1]
        squared = x * x + y * y
        distance: Array = np.sqrt(squared)
        if batch.covariances is not None:
            times = np.minimum(self.times, self.profiles.stands[:, None])
            covariance = batch.covariances.grid(times.ravel()).reshape(profiles, LOOKS, -1, 3)
            some = batch.uncertain_among(np.arange(batch.size))
            x, y = x[..., some], y[..., some]
            spread = covariance[..., 0] * x * x + (2.0 * covariance[..., 1]) * x * y + covariance[..., 2] * y * y
            distance[..., some] -= np.sqrt(np.maximum(spread / np.maximum(squared[..., some], 1e-300), 0.0))
        distance -= batch.radius
        return distance.reshape(count * profiles, LOOKS, -1)

    def _within_reach(self, batch: ZoneBatch, longest: float) -> Index:
        """The zones that any dodge may come near to."""
        if batch.size == 0:
            return np.zeros(0, dtype=np.intp)
        here = np.zeros((len(self.times), 2))
        away = batch.distances(self.times, here, NEAR)
        reach = np.hypot(self.position[..., 0], self.position[..., 1]).max(axis=0) + longest + NEAR
        return np.flatnonzero((away <= reach[:, None]).any(axis=0))

    def trip(self, number: int, frame: PlanningFrame) -> Trip:
        """Return a dodge as a trip, from the planning frame that they are in."""
        course, profile = divmod(number, len(self.profiles.stands))
        turn, length = float(self.courses.turn[course]), float(self.length[course, profile])
        drive, driven = self.profiles.drive(profile), float(self.profiles.way[profile])
        far = max(driven * (1.0 + 1e-6), 1e-2)
        guide: Guide = StraightGuide(far)
        pieces = PATH_PIECES[0]
        if turn != 0.0:
            wanted = 4.0 * far / (length * CELLS_PER_SPAN)
            pieces = next((count for count in PATH_PIECES if count >= wanted), PATH_PIECES[-1])
            stations = np.linspace(0.0, far, pieces * CELLS_PER_SPAN + 1)
            guide = CurvedGuide(far, turn * _smooth(stations / length))
        space = TripSpace(guide, drive.start_speed, _PATH_DEGREE, pieces, drive.degree, drive.breakpoints)
        trajectory = Trajectory(Path(space, np.zeros(space.path_size)), drive.beta, drive.lasts)
        return Trip(
            PlanningFrame(frame.origin, frame.heading + float(self.courses.base[course]), frame.time), trajectory
        )
