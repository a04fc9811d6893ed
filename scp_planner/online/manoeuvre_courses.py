"""Courses of evasive manoeuvres, and the speed profiles to drive them by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array, Index, unit_vectors
from scp_planner.online.ramps import Ramps
from scp_planner.online.remaining import State
from scp_planner.online.stops import distinct_knots
from scp_planner.online.tolerances import JERK_SHARE, RELATIVE
from scp_planner.scenario.limits import Limits


@dataclass(frozen=True)
class CourseParameters:
    directions: int = 32  # Directions where the heading is free
    bent_directions: int = 16  # Directions of courses that turn later, where the heading is free
    bend: float = 60.0  # Degrees, by which these turn, to either side
    bend_time: float = 1.25  # Middle of that turn, in times in which the vehicle drives its own width
    bent_profiles: int = 4  # The last so many profiles: those that last long enough for that
    # Degrees, by which courses turn from the beginning on, to either side, where the heading is not free
    turns: tuple[float, ...] = (0.0, 10.0, 22.0, 40.0, 70.0, 120.0, 180.0)
    # Degrees, by which courses turn aside and back again, to either side: the vehicle moves over
    aside: tuple[float, ...] = (16.0, 32.0)
    # Widths that the vehicle drives from a stand and stops, where half of the top speed takes it farther
    short: tuple[float, ...] = (1.0, 2.0, 4.0)
    levels: tuple[float, ...] = (1.0, 0.5)  # Shares of the top speed
    # Times for which a level is kept, in those in which the vehicle drives its own width
    cruises: tuple[float, ...] = (0.0, 1.0, 2.0, 4.0, 8.0)
    spans: int = 32  # Spans of the accelerations of an evasive manoeuvre, of equal length
    rounded_spans: int = 3  # Spans that are lost where phases become whole numbers of them
    table: int = 33  # Points of a turn, of which the others are interpolated
    easing: float = 0.5  # Share of a prompt turn in which it ends
    limit_share: float = 0.98  # Share of the limits that evasive manoeuvres use, but for braking


COURSES = CourseParameters()
_SHARES = np.linspace(0.0, 1.0, COURSES.table)


def smooth_step(share: Array) -> Array:
    """A step from 0 to 1 without a jump of its slope."""
    share = np.minimum(share, 1.0)
    return share * share * (3.0 - 2.0 * share)


def prompt_step(share: Array) -> Array:
    """A step from 0 to 1 that rises evenly from the beginning on; at the end its slope and the change of that are 0."""
    share = np.minimum(share, 1.0)
    eased = np.maximum(share - (1.0 - COURSES.easing), 0.0) / COURSES.easing
    return (share - COURSES.easing * eased**3 * (1.0 - 0.5 * eased)) / (1.0 - 0.5 * COURSES.easing)


@dataclass(frozen=True)
class Bend:
    turned: Callable[[Array], Array]  # Shares of the angle at shares of the length
    peak: float  # The largest slope of that, and of splines through it
    end: float = 1.0  # Share of the angle at the end


def aside(share: Array) -> Array:
    """Rise from 0 to 1 and fall back to 0 along a parabola."""
    share = np.minimum(share, 1.0)
    return 4.0 * share * (1.0 - share)


def gradually_aside(share: Array) -> Array:
    """Rise from 0 to 1 and fall back to 0 without a jump of the slope."""
    return aside(share) ** 2


GRADUAL = Bend(smooth_step, 1.5)
GRADUAL_ASIDE = Bend(gradually_aside, 16.0 / 27.0**0.5, 0.0)
PROMPT_ASIDE = Bend(aside, 4.05, 0.0)
PROMPT = Bend(prompt_step, 1.015 / (1.0 - 0.5 * COURSES.easing))
"""Share of the span in which a vehicle turns whose curvature may jump: one that turned gradually would hardly turn
in a replan."""


@dataclass(frozen=True)
class ManoeuvreDrive:
    start_speed: float  # m/s
    degree: int
    breakpoints: tuple[float, ...]
    beta: Array  # Control points of the acceleration, m/s^2
    lasts: float  # s


def levels_and_cruises(limits: Limits, width: float) -> tuple[Array, Array]:
    """The levels of profiles, (P,) m/s, and for how long they are kept, (P,) s; the first is a stop at once."""
    top, rate = limits.speed, 2.0 / (1.0 / limits.acceleration + 1.0 / limits.deceleration)
    levels, cruises = np.meshgrid(np.array(COURSES.levels) * top, np.array(COURSES.cruises) * width / top)
    short = np.sqrt(rate * width * np.array(COURSES.short))
    short = np.append(0.0, short[short < levels.min()])
    return np.concatenate([short, levels.ravel()]), np.concatenate([np.zeros(len(short)), cruises.ravel()])


@dataclass(frozen=True)
class Profiles:
    """P drives that end in a stop."""

    speed: Array  # (P, spans + 1) At the ends of the spans, m/s
    span: Array  # (P,) Length of a span, s
    stands: Array  # (P,)

    @classmethod
    def of(cls, start_speed: float, limits: Limits, width: float, wait: float) -> Profiles:
        level, cruise = levels_and_cruises(limits, width)
        rate = np.where(level > start_speed, limits.acceleration * COURSES.limit_share, limits.deceleration)
        change, braking = np.abs(level - start_speed) / rate, level / limits.deceleration
        whole_spans = COURSES.spans - COURSES.rounded_spans
        span = np.maximum(change + cruise + braking + wait, width / limits.speed) / whole_spans
        # As promptly as the limits allow: whole spans of it, which are as long as that takes.
        whole = np.floor(change / span)
        span = np.where(whole > 0.0, change / np.maximum(whole, 1.0), span)
        first, last = np.where(whole > 0.0, whole, np.ceil(change / span)), np.ceil(braking / span)
        end = first + np.round(cruise / span) + last
        number = np.arange(COURSES.spans + 1)
        risen = np.clip(number / np.maximum(first, 1.0)[:, None], 0.0, 1.0)
        left = np.clip((end[:, None] - number) / np.maximum(last, 1.0)[:, None], 0.0, 1.0)
        speed = (start_speed + (level - start_speed)[:, None] * risen) * np.where(last[:, None] > 0.0, left, 1.0)
        return cls(speed, span, end * span)

    def last(self, count: int) -> Profiles:
        return Profiles(self.speed[-count:], self.span[-count:], self.stands[-count:])

    @property
    def fastest(self) -> Array:
        """Highest speeds, (P,) m/s."""
        return self.speed.max(axis=1)

    @property
    def way(self) -> Array:
        return self.driven[:, -1]

    def drive(self, number: int) -> ManoeuvreDrive:
        speeds, span = self.speed[number], float(self.span[number])
        breaks = tuple(np.linspace(0.0, 1.0, COURSES.spans + 1).tolist())
        return ManoeuvreDrive(float(speeds[0]), 0, breaks, np.diff(speeds) / span, COURSES.spans * span)

    @cached_property
    def driven(self) -> Array:
        """Distances at the ends of the spans, (P, spans + 1) m."""
        steps = 0.5 * (self.speed[:, 1:] + self.speed[:, :-1]) * self.span[:, None]
        return np.concatenate([np.zeros((len(self.span), 1)), np.cumsum(steps, axis=1)], axis=1)

    def distance(self, times: Array) -> Array:
        """Distances driven at times (J,), (P, J) m."""
        place = np.minimum(times / self.span[:, None], COURSES.spans - RELATIVE)
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
    """K courses from a place."""

    base: Array  # (K,) Direction in which each begins, rad
    turn: Array  # (K,) By how much it turns, rad
    bend: Bend = GRADUAL

    @classmethod
    def straight(cls) -> Courses:
        """Return those of a vehicle with a free heading; the first leads ahead."""
        many = COURSES.directions
        return cls(2.0 * np.pi * np.arange(many) / many, np.zeros(many))

    @classmethod
    def bent(cls) -> Courses:
        """Return those of such a vehicle that turn later."""
        many, bend = COURSES.bent_directions, np.radians(COURSES.bend)
        return cls(np.tile(2.0 * np.pi * np.arange(many) / many, 2), np.repeat([bend, -bend], many))

    @classmethod
    def turning(cls, heading: float, turns: tuple[float, ...], bend: Bend) -> Courses:
        """Return those of a vehicle with a heading, rad, that turn by so many degrees, to either side."""
        turn = np.radians([*turns, *(-one for one in turns if 0.0 < one < 180.0)])
        return cls(np.full(len(turn), heading), turn, bend)

    def some(self, which: Index) -> Courses:
        return Courses(self.base[which], self.turn[which], self.bend)

    @cached_property
    def _turning(self) -> Array:
        """Points of turns of length 1, (K, table, 2) m, in the direction in which they begin."""
        angle = self.turn[:, None] * self.bend.turned(_SHARES)
        unit = unit_vectors(angle)
        steps = 0.5 * (unit[:, 1:] + unit[:, :-1]) / (COURSES.table - 1)
        return np.concatenate([np.zeros((len(self.turn), 1, 2)), np.cumsum(steps, axis=1)], axis=1)

    @property
    def _ends(self) -> tuple[Array, Array]:
        """Components of the directions, (K,) each, in which turns end, from that in which they begin."""
        return np.cos(self.bend.end * self.turn), np.sin(self.bend.end * self.turn)

    def along(self, lead: Array, length: Array, distance: Array) -> tuple[Array, Array]:
        if not self.turn.any():
            heading = np.broadcast_to(self.base[:, None, None], (len(self.base), *distance.shape))
            ahead = unit_vectors(self.base)
            return distance[:, :, None] * ahead[:, None, None], heading
        before = np.minimum(distance, lead[:, :, None])
        share = (distance - before) / length[:, :, None]
        within = np.minimum(share, 1.0)
        place = np.minimum(within * (COURSES.table - 1), COURSES.table - 1 - RELATIVE)
        number = place.astype(np.intp)
        rest = place - number
        left, beyond = 1.0 - rest, np.maximum(share - 1.0, 0.0)
        number += COURSES.table * np.arange(len(self.turn))[:, None, None]
        local = []
        # NUMPY-CALLS: by axes, each on its own, as what is indexed in pairs takes twice as long
        for table, end in zip(self._turning.reshape(-1, 2).T.copy(), self._ends, strict=True):
            value = table.take(number)
            value *= left
            value += table.take(number + 1) * rest
            value += beyond * end[:, None, None]
            value *= length[:, :, None]
            local.append(value)
        x, y = local[0] + before, local[1]
        c, s = np.cos(self.base)[:, None, None], np.sin(self.base)[:, None, None]
        placed = np.empty((*x.shape, 2))
        np.subtract(c * x, s * y, out=placed[..., 0])
        np.add(s * x, c * y, out=placed[..., 1])
        heading = self.base[:, None, None] + self.turn[:, None, None] * self.bend.turned(within)
        return placed, heading


@dataclass(frozen=True)
class RampedProfiles:
    """P drives that end in a stop."""

    change: Ramps  # To the levels, and from them to a stop
    braking: Ramps  # To the levels, and from them to a stop
    level: Array  # (P,) m/s
    cruise: Array  # (P,) For how long it is kept, s
    lasts: Array  # (P,) Until it has stood for as long as it has to, s

    @classmethod
    def of(cls, state: State, limits: Limits, jerk: float, width: float, wait: float) -> RampedProfiles:
        level, cruise = levels_and_cruises(limits, width)
        speed, acceleration = np.full(len(level), state.speed), np.full(len(level), state.acceleration or 0.0)
        share, jerk = COURSES.limit_share, JERK_SHARE * jerk
        rise, fall = limits.acceleration * share, limits.deceleration
        stops = Ramps.stopping(speed, acceleration, fall, jerk)
        moving = Ramps.between(speed, acceleration, level, rise, fall, jerk)
        change = stops.where(level == 0.0, moving)
        braking = Ramps.stopping(level, np.zeros(len(level)), fall, jerk)
        stands = change.duration + cruise + braking.duration
        return cls(change, braking, level, cruise, np.maximum(stands + wait, width / limits.speed))

    def last(self, count: int) -> RampedProfiles:
        return RampedProfiles(
            self.change.last(count),
            self.braking.last(count),
            self.level[-count:],
            self.cruise[-count:],
            self.lasts[-count:],
        )

    @property
    def stands(self) -> Array:
        return self.change.duration + self.cruise + self.braking.duration

    @property
    def fastest(self) -> Array:
        return np.maximum(self.change.fastest, self.level)

    @cached_property
    def way(self) -> Array:
        return self.change.way + self.level * self.cruise + self.braking.way

    def distance(self, times: Array) -> Array:
        begun = (self.change.duration + self.cruise)[:, None]
        changing = self.change.distance(np.minimum(times, begun))
        braking: Array = self.braking.distance(
            np.minimum(np.maximum(times - begun, 0.0), self.braking.duration[:, None])
        )
        return changing + braking

    def drive(self, number: int) -> ManoeuvreDrive:
        change, braking, whole = self.change, self.braking, float(self.lasts[number])
        begun = change.duration[number] + self.cruise[number]
        times = np.concatenate([change.knots[number], begun + braking.knots[number], [whole]])
        accelerations = np.concatenate([change.acceleration[number], braking.acceleration[number], [0.0]])
        breaks, beta = distinct_knots(times / whole, accelerations)
        return ManoeuvreDrive(float(change.start_speed[number]), 1, tuple(breaks.tolist()), beta, whole)


ManoeuvreProfiles = Profiles | RampedProfiles
