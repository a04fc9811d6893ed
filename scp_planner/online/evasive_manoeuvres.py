"""Evasive manoeuvres: short trips in many directions, each at several speeds and ending in a stop, seen all at once."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array, Index, unit_vectors
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.border import Border
from scp_planner.online.manoeuvre_courses import (
    COURSES,
    GRADUAL,
    GRADUAL_ASIDE,
    PROMPT_ASIDE,
    Bend,
    Courses,
    ManoeuvreProfiles,
)
from scp_planner.prediction.foresight import foreseen, smaller
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Vehicle
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.guide import CurvedGuide, Guide, StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import CELLS_PER_SPAN, TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class ManoeuvreParameters:
    samples: int = 48  # Samples of a manoeuvre
    # Spans of a path that turns: the fewest whose pieces are shorter than a fourth of the turn
    path_pieces: tuple[int, ...] = (4, 8, 16)
    exact_within: float = 0.1  # Units of length. Distances to outlines beyond this need not be exact
    together: int = 16_000  # Samples of manoeuvres, times zones, whose distances are computed together
    path_degree: int = 3  # Of the splines of a path that turns


EVASIVE_MANOEUVRES = ManoeuvreParameters()
BORDER = -1
"""Stands for the border of the ground among numbers of zones."""


@dataclass(frozen=True)
class Room:
    zones: Index  # (Z,)
    each: Array  # (Z, C, J) Distances from each of them, m: lower bounds that are exact where it is near

    @cached_property
    def least(self) -> Array:
        """The least of them, (C, J) m; inf where there is nothing near."""
        return self.each.min(axis=0, initial=np.inf)

    def less(self, spare: Array) -> Array:
        """The least of them, (C, J) m, where so much, (L, J) or (L, 1) m, is taken from those to all L zones."""
        if not spare.any():
            return self.least
        taken = np.concatenate([spare, np.zeros((1, spare.shape[1]))])[self.zones]  # the border is the last
        least = np.full(self.each.shape[1:], np.inf)
        for some in in_parts(len(self.each), least.size):
            np.minimum(least, (self.each[some] - taken[some, None]).min(axis=0), out=least)
        return least

    def nearest(self, manoeuvre: int, sample: int) -> int:
        """The nearest zone of one manoeuvre at one sample, or `BORDER`, also where there is nothing."""
        return int(self.zones[self.each[:, manoeuvre, sample].argmin()]) if len(self.zones) else BORDER


@dataclass(frozen=True)
class Size:
    share: float = 1.0
    latest: float = math.inf


WHOLE = Size()


@dataclass(frozen=True)
class Family:
    """All of some courses driven by all of some profiles: K P manoeuvres, the profiles of the first course first."""

    courses: Courses  # In the planning frame
    profiles: ManoeuvreProfiles
    lead: Array  # (K, P) m
    length: Array  # (K, P) m

    @classmethod
    def of(
        cls, courses: Courses, profiles: ManoeuvreProfiles, limits: Limits, radius: float, turning_at: float
    ) -> Family:
        fastest = profiles.fastest
        tightest = np.maximum(
            radius if np.isinf(limits.curvature) else 1.0 / (COURSES.limit_share * limits.curvature),
            fastest**2 / (COURSES.limit_share * limits.lateral_acceleration),
        )
        # Of a course that does not turn any length will do.
        length = np.maximum(courses.bend.peak * np.abs(courses.turn)[:, None], 1e-3) * tightest
        return cls(courses, profiles, np.maximum(turning_at * fastest - 0.5 * length, 0.0), length)

    @property
    def size(self) -> int:
        return self.length.size

    def some(self, courses: Index) -> Family:
        return Family(self.courses.some(courses), self.profiles, self.lead[courses], self.length[courses])

    def driven(self, times: Array) -> tuple[Array, Array]:
        """Places (K P, J, 2) m and headings (K P, J) rad at times (J,) s from now."""
        place, heading = self.courses.along(self.lead, self.length, self.profiles.distance(times))
        return place.reshape(self.size, len(times), 2), heading.reshape(self.size, len(times))

    def extents(self, batch: ZoneBatch, offset: Array, squared: Array, times: Array, until: Array) -> Array:
        assert batch.covariances is not None
        count, profiles = self.length.shape
        still = times > until[:, None]
        # (3, U, 1, P, J), or (3, U, 1, 1, J): the same for all courses, and all profiles that are under way.
        spread = np.ascontiguousarray(batch.covariances.grid(times).transpose(2, 1, 0))[:, :, None, None]
        if still.any():
            last = batch.covariances.grid(np.where(still.any(axis=1), until, 0.0)).transpose(2, 1, 0)
            spread = np.where(still, last[:, :, None, :, None], spread)
        xx, xy, yy = spread
        x, y = offset.reshape(2, -1, count, profiles, len(times))
        along, part = xx * x, (2.0 * xy) * y
        along += part
        along *= x
        np.multiply(yy, y, out=part)
        part *= y
        along += part
        along /= np.maximum(squared.reshape(x.shape), 1e-300, out=part)
        np.sqrt(np.maximum(along, 0.0, out=along), out=along)
        return along.reshape(-1, self.size, len(times))

    def trip(self, number: int, frame: PlanningFrame) -> Trip:
        course, profile = divmod(number, len(self.profiles.stands))
        turn, length = float(self.courses.turn[course]), float(self.length[course, profile])
        drive, driven = self.profiles.drive(profile), float(self.profiles.way[profile])
        far = max(driven * (1.0 + 1e-6), 1e-2)
        guide: Guide = StraightGuide(far)
        pieces = EVASIVE_MANOEUVRES.path_pieces[0]
        if turn != 0.0:
            wanted = 4.0 * far / (length * CELLS_PER_SPAN)
            pieces = next(
                (count for count in EVASIVE_MANOEUVRES.path_pieces if count >= wanted),
                EVASIVE_MANOEUVRES.path_pieces[-1],
            )
            stations = np.linspace(0.0, far, pieces * CELLS_PER_SPAN + 1)
            along = np.maximum(stations - self.lead[course, profile], 0.0)
            guide = CurvedGuide(far, turn * self.courses.bend.turned(along / length))
        space = TripSpace(
            guide, drive.start_speed, EVASIVE_MANOEUVRES.path_degree, pieces, drive.degree, drive.breakpoints
        )
        trajectory = Trajectory(Path(space, np.zeros(space.path_size)), drive.beta, drive.lasts)
        return Trip(
            PlanningFrame(frame.origin, frame.heading + float(self.courses.base[course]), frame.time), trajectory
        )


@dataclass(frozen=True)
class Driven:
    """Course of C manoeuvres at J times."""

    times: Array  # (J,) s from now
    position: Array  # (C, J, 2) m, in the planning frame
    heading: Array  # (C, J) rad
    until: Array  # (C,) When each is over, s from now


@dataclass(frozen=True)
class EvasiveManoeuvres(Driven):
    """C manoeuvres of one or two families, looked at together."""

    families: tuple[Family, ...]
    wait: float  # For how long a vehicle is to stand at the end, s

    @classmethod
    def of(
        cls,
        heading: float | None,
        profiles: ManoeuvreProfiles,
        limits: Limits,
        radius: float,
        wait: float,
        both_ways: bool,
        bend: Bend,
    ) -> EvasiveManoeuvres:
        families: tuple[Family, ...]
        if heading is None:
            late, turning_at = profiles.last(COURSES.bent_profiles), COURSES.bend_time * 2.0 * radius / limits.speed
            families = (
                Family.of(Courses.straight(), profiles, limits, radius, 0.0),
                Family.of(Courses.bent(), late, limits, radius, turning_at),
            )
        else:
            ways = (heading, heading + np.pi) if both_ways else (heading,)
            over = GRADUAL_ASIDE if bend is GRADUAL else PROMPT_ASIDE
            courses = [Courses.turning(each, COURSES.turns, bend) for each in ways]
            courses += [Courses.turning(each, COURSES.aside, over) for each in ways]
            families = tuple(Family.of(each, profiles, limits, radius, 0.0) for each in courses)
        return cls.sampled(
            families, wait, np.linspace(0.0, float((profiles.stands + wait).max()), EVASIVE_MANOEUVRES.samples)
        )

    @classmethod
    def sampled(cls, families: tuple[Family, ...], wait: float, times: Array) -> EvasiveManoeuvres:
        """Return all manoeuvres of families at times (J,), s from now."""
        driven = [family.driven(times) for family in families]
        position, headings = (np.concatenate(parts) for parts in zip(*driven, strict=True))
        stands = [np.tile(family.profiles.stands, len(family.courses.turn)) for family in families]
        return cls(times, position, headings, np.concatenate(stands) + wait, families, wait)

    @cached_property
    def fastest(self) -> Array:
        """Highest speeds, (C,) m/s."""
        return np.concatenate([np.tile(each.profiles.fastest, len(each.length)) for each in self.families])

    def few(self, most: float) -> EvasiveManoeuvres:
        """Return no more manoeuvres than that, but all of one course at least."""
        stride = max(math.ceil(len(self.position) / max(most, 1.0)), 1)
        if stride == 1:
            return self
        return self._of([np.arange(0, len(family.length), stride) for family in self.families])

    def best(self, most: float, worth: Array) -> tuple[EvasiveManoeuvres, Index]:
        """Return the courses of the manoeuvres of most worth, (C,), and of the first, and the numbers of all theirs.

        They are no more than that, but all of the first course.
        """
        count = np.concatenate([np.full(*family.length.shape) for family in self.families])
        best = np.maximum.reduceat(worth, np.cumsum(count) - count)
        best[0] = np.inf
        order, taken = np.argsort(-best, kind="stable"), np.zeros(len(best), dtype=bool)
        taken[order[np.cumsum(count[order]) <= most]] = taken[0] = True
        courses = np.split(taken, np.cumsum([len(family.length) for family in self.families])[:-1])
        return self._of([np.flatnonzero(each) for each in courses]), np.flatnonzero(np.repeat(taken, count))

    def _of(self, courses: Sequence[Index]) -> EvasiveManoeuvres:
        kept = zip(self.families, courses, strict=True)
        families = tuple(family.some(each) for family, each in kept if len(each))
        return EvasiveManoeuvres.sampled(families, self.wait, self.times)

    def trip(self, number: int, frame: PlanningFrame) -> Trip:
        for family in self.families:
            if number < family.size:
                return family.trip(number, frame)
            number -= family.size
        raise IndexError(f"there is no manoeuvre {number}")

    def rooms(
        self, batch: ZoneBatch, border: Border, vehicle: Vehicle, unseen: float, near: Index, sizes: tuple[Size, ...]
    ) -> list[Room]:
        """Distances to some zones, of which ellipses are of such sizes, and to the border of the ground."""
        rounds, others = near[batch.outline_slot[near] < 0], near[batch.outline_slot[near] >= 0]
        zones, shaped = batch.subset(rounds), [_of_size(batch.subset(others), size) for size in sizes]
        numbers, least = np.concatenate([rounds, others, [BORDER] * border.is_there]).astype(np.intp), list[Array]()
        for offset in vehicle.discs:
            place = self.position
            if offset != 0.0:
                place = place + offset * unit_vectors(self.heading)
            found = [[some] for some in self._from_rounds(zones, place, unseen, sizes)]
            for parts, outlined in zip(found, shaped, strict=True):
                if len(others):
                    times, points = np.tile(self.times, len(place)), place.reshape(-1, 2)
                    away = outlined.distances(times, points, EVASIVE_MANOEUVRES.exact_within)
                    parts.append(away.T.reshape(-1, *self.heading.shape))
                if border.is_there:
                    parts.append(border.room(place)[None])
            each = [np.concatenate(parts) if len(parts) > 1 else parts[0] for parts in found]
            least = [np.minimum(*both) for both in zip(least, each, strict=True)] if least else each
        return [Room(numbers, one) for one in least]

    def _from_rounds(self, batch: ZoneBatch, place: Array, unseen: float, sizes: tuple[Size, ...]) -> Array:
        """Distances to S sizes of zones without outlines, (S, L, C, J) m, towards their centres: never too large."""
        distance = np.empty((len(sizes), batch.size, *place.shape[:-1]))
        for part in in_parts(batch.size, place[..., 0].size):
            some = np.arange(part.start, part.stop)
            zones = batch.subset(some) if len(some) < batch.size else batch
            self._put_distances(zones, place, unseen, sizes, distance[:, part])
        return distance

    def _put_distances(
        self, batch: ZoneBatch, place: Array, unseen: float, sizes: tuple[Size, ...], out: Array
    ) -> None:
        """Put the distances to S sizes of some zones, (S, l, C, J) m, into an array."""
        centers = batch.centers.grid(self.times).transpose(2, 1, 0)[:, :, None]
        offset = np.empty((2, *out.shape[1:]))
        for axis in (0, 1):
            np.subtract(place[..., axis], centers[axis], out=offset[axis])
        squared: Array = offset[0] * offset[0]
        squared += np.multiply(offset[1], offset[1], out=out[0])
        distance: Array = np.sqrt(squared, out=out[0])
        distance -= batch.radius[:, None, None]
        out[1:] = distance
        if batch.covariances is not None:
            if len(batch.uncertain) < batch.size:
                offset, squared = offset[:, batch.uncertain], squared[batch.uncertain]
            first = 0
            for family in self.families:
                some = slice(first, first + family.size)
                until = np.maximum(family.profiles.stands, unseen)
                extents = {
                    latest: family.extents(
                        batch, offset[:, :, some], squared[:, some], self.times, np.minimum(until, latest)
                    )
                    for latest in dict.fromkeys(size.latest for size in sizes)
                }
                for size, each in zip(sizes, out, strict=True):
                    reach = extents[size.latest]
                    each[batch.uncertain, some] -= reach if size.share == 1.0 else size.share * reach
                first += family.size

    def within_reach(self, batch: ZoneBatch, vehicle: Vehicle) -> Index:
        """The zones, in the planning frame, that any manoeuvre of a vehicle may come near to."""
        if batch.size == 0:
            return np.zeros(0, dtype=np.intp)
        here = np.zeros((len(self.times), 2))
        away = batch.distances(self.times, here, EVASIVE_MANOEUVRES.exact_within)
        longest = max(map(abs, vehicle.discs)) + EVASIVE_MANOEUVRES.exact_within
        reach = np.hypot(self.position[..., 0], self.position[..., 1]).max(axis=0) + longest
        return np.flatnonzero((away <= reach[:, None]).any(axis=0))


def _of_size(batch: ZoneBatch, size: Size) -> ZoneBatch:
    return smaller(foreseen(batch, size.latest, {}) if math.isfinite(size.latest) else batch, size.share)


def in_parts(count: int, size: int) -> Iterator[slice]:
    """Slices of so many zones, each of so many samples, that are looked at together."""
    together = max(EVASIVE_MANOEUVRES.together // max(size, 1), 1)
    for first in range(0, count, together):
        yield slice(first, min(first + together, count))
