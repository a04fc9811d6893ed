"""Times that no trip can be shorter than, with obstacles and without.

A trip of at most T seconds is a moving point that, at each of some instants t_k,

- is outside every zone, and inside the workspace;
- has moved since the instant before by no more than the highest speed allows,
  v(t) <= min(v0 + a_max t, v_max, goal speed + d_max (T - t));
- is as near to the start and to the goal as these speeds demand.

All else is given up: headings, curvature, lateral acceleration, and what happens between the instants. The points that
such a motion can be at are kept as a set of cells, always a superset of the true one: a cell is left out only if all
of it is in one zone, outside the workspace, or too far away, and it is reached if any of its points is near enough to
any point of a cell reached before. If no set holds a cell from which the goal can be reached by T, no trip takes T or
less: so this bound is true for every trip, however its path is written, up to the rounding that certificates allow.

Cells are wide across the line from start to goal and short along it. The farthest cell along that line is as far away
as its instant allows, to rounding: straight trips gain nothing by the cells, and sidesteps hardly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from math import ceil, floor, hypot, sqrt
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.certificate.verdict import ARRIVAL_TOLERANCE, END_TOLERANCE, GOAL_SPEED_TOLERANCE
from scp_planner.mathematics.ellipse import support
from scp_planner.mathematics.frames import PlanningFrame, directions_of, turned_back
from scp_planner.mathematics.outlines import Outline
from scp_planner.scenario.limits import Box, Limits, straight_travel_time
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.bounds import ZoneBounds
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.zone import ThreatZone

ROUNDING = (
    2.0 * END_TOLERANCE
)  # of lengths and speeds, in natural units; what is certified keeps its ends to END_TOLERANCE
SPEED_ROUNDING = 1e-8  # relative
EDGE = 1e-9  # of a cell
ALIGNED = 1.0 - 1e-6  # of a step that moves by whole cells
PRECISION = 1e-3  # relative, to which the bound is found
LONGEST_STEP = 0.25  # units of time between instants, before the vehicle is fast
CELLS = 700_000  # at most
FEW_CELLS = 60_000  # for an answer in hundredths of a second
CORNERS = 48  # of the polygon inside each zone
BESIDE = 1e-9  # rad
TINY = 1e-300
MOST_WORK = 2e9  # cells at all instants together, and what zones cost: what a bound looks at, at most
QUICK_WORK = 1e8  # the same of a quick proof
ZONE_WORK = 1000  # cells that cost as much as a zone
GROWTH = (1.02, 1.1, 1.25, 1.6, 2.2, 3.0, 4.0)
"""Times the kinematic bound: how long trips are looked for, until there may be one."""


@dataclass(frozen=True)
class _Resolution:
    """Time between instants at top speed, and how many cells the vehicle then moves by along and across the line."""

    time: float
    columns: int
    rows: int


RESOLUTIONS = (
    _Resolution(0.1, 64, 12),
    _Resolution(0.1, 48, 8),
    _Resolution(0.15, 32, 8),
    _Resolution(0.2, 24, 6),
    _Resolution(0.3, 16, 5),
    _Resolution(0.5, 16, 4),
    _Resolution(1.0, 12, 4),
)


def kinematic_bound(scenario: Scenario) -> float:
    """No trip is shorter than a straight one without obstacles, s, and none arrives before it may.

    Parameters
    ----------
    scenario : Scenario

    Returns
    -------
    float
        s.
    """
    time, _ = straight_travel_time(
        float(np.hypot(*np.subtract(scenario.goal.position, scenario.start.position))) - scenario.goal.radius,
        scenario.start.speed,
        Limits.of(scenario),
        scenario.goal.speed,
    )
    earliest = scenario.goal.earliest_arrival
    return time if earliest is None else max(time, earliest - scenario.start.time)


class _NotDecided(Exception):
    """A relaxation is too large, or the time is over: nothing is excluded."""


def lower_bound(
    scenario: Scenario,
    *,
    at_most: float | None = None,
    threat_zones: tuple[ThreatZone, ...] | None = None,
    time_limit: float | None = None,
) -> float:
    """Return a travel time that no trip among the obstacles is shorter than.

    Parameters
    ----------
    scenario : Scenario
    at_most : float, optional
        Travel time of a trip that is known, s: the bound is not looked for above it, which makes it quicker and finer.
        Without it, it is looked for up to four times the kinematic bound.
    threat_zones : tuple of ThreatZone, optional
        The scenario's zones, if they are at hand.
    time_limit : float, optional
        Wall time in s after which the best bound so far is returned.

    Returns
    -------
    float
        s, never less than :func:`kinematic_bound`, which it is where the trip is so long that there would be too many
        cells and instants to look at; it is the smaller of what is true and what cells and instants can
        show, to a thousandth. Waiting for what fills a bounded workspace shows, and going far round; the price of
        small sidesteps, and of turning, does not.
    """
    began = perf_counter()
    units = NaturalUnits.of(scenario)
    inside = units.scenario(scenario)
    found = tuple(ZonesOf(inside)) if threat_zones is None else tuple(zone.inside(units) for zone in threat_zones)
    deadline = np.inf if time_limit is None else began + time_limit
    return _bound(inside, None if at_most is None else at_most / units.time, found, deadline) * units.time


def _bound(scenario: Scenario, at_most: float | None, found: tuple[ThreatZone, ...], deadline: float) -> float:
    """:func:`lower_bound` in natural units."""
    least = kinematic_bound(scenario)
    if not scenario.obstacles:
        return least
    return _Bisection(scenario, found, least, deadline).bound(at_most)


class _Bisection:
    """The longest duration that is excluded, as far as it is found.

    Parameters
    ----------
    scenario : Scenario
    threat_zones : tuple of ThreatZone
    least : float
        The kinematic bound, s.
    deadline : float
        Of the clock of :func:`time.perf_counter`, s.
    """

    def __init__(self, scenario: Scenario, threat_zones: tuple[ThreatZone, ...], least: float, deadline: float) -> None:
        self.scenario, self.threat_zones = scenario, threat_zones
        self.least = self.excluded = least
        self.deadline = deadline

    def bound(self, at_most: float | None) -> float:
        """Return it, at most a duration that is known to be possible, s."""
        try:
            self._look(at_most)
        except _NotDecided:
            pass
        return self.excluded

    def _look(self, at_most: float | None) -> None:
        if at_most is None:
            for growth in GROWTH:
                longest = growth * self.least
                relaxation = self._relaxation(longest)
                if relaxation.possible(longest):
                    break
                self.excluded = longest
            else:
                return
        else:
            longest = at_most
            if longest <= self.least * (1.0 + PRECISION):
                return
            relaxation = self._relaxation(longest)
        while longest - self.excluded > PRECISION * self.least:
            middle = 0.5 * (self.excluded + longest)
            if relaxation.possible(middle):
                longest = middle
            else:
                self.excluded = middle

    def _relaxation(self, longest: float) -> _Relaxation:
        return _Relaxation(self.scenario, self.threat_zones, longest, deadline=self.deadline)


def no_trip_within(
    scenario: Scenario, travel_time: float, threat_zones: Sequence[ThreatZone], deadline: float = np.inf
) -> bool:
    """Whether it can be proved, quickly, that no trip takes a travel time or less.

    Parameters
    ----------
    scenario : Scenario
    travel_time : float
        s.
    threat_zones : sequence of ThreatZone
        What is in the way; none: the workspace alone.
    deadline : float
        Of the clock of :func:`time.perf_counter`, s: then it is left open.

    Returns
    -------
    bool
        If true there is none, however its path is written. If false, that is open; so it is where there would be too
        many cells and instants to look at.
    """
    if travel_time < kinematic_bound(scenario) * (1.0 - SPEED_ROUNDING):
        return True
    if not threat_zones:  # straight on, inside a convex workspace
        return False
    units = NaturalUnits.of(scenario)
    inside = units.scenario(scenario.model_copy(update={"obstacles": ()}))
    found = tuple(zone.inside(units) for zone in threat_zones)
    longest = travel_time / units.time
    try:
        return not _Relaxation(inside, found, longest, FEW_CELLS, deadline).possible(longest)
    except _NotDecided:
        return False


class _Speeds:
    """The highest speed at each time of a trip of given duration, and how far it leads.

    Parameters
    ----------
    scenario : Scenario
    duration : float
        s.
    """

    def __init__(self, scenario: Scenario, duration: float) -> None:
        vehicle, goal_speed = scenario.vehicle, scenario.goal.speed
        self.first = scenario.start.speed + ROUNDING
        self.gain, self.top, self.loss = vehicle.max_acceleration, vehicle.max_speed, vehicle.max_deceleration
        self.last = np.inf if goal_speed is None else goal_speed + GOAL_SPEED_TOLERANCE + ROUNDING
        self.duration = duration
        knots = [0.0, duration, (self.top - self.first) / self.gain]
        if np.isfinite(self.last):
            brake = self.last + self.loss * duration
            knots += [(brake - self.top) / self.loss, (brake - self.first) / (self.gain + self.loss)]
        self.knots = np.unique(np.clip(knots, 0.0, duration))
        speeds = self.at(self.knots)
        self.driven_at_knots = np.concatenate(
            [[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(self.knots))]
        )

    def at(self, times: Array) -> Array:
        """Highest speeds at times (n,), m/s."""
        rising = np.minimum(self.first + self.gain * times, self.top)
        if not np.isfinite(self.last):
            return rising
        falling: Array = np.minimum(rising, self.last + self.loss * (self.duration - times))
        return falling

    def driven(self, times: Array) -> Array:
        """Longest distances from the start until times (n,), m; exact, since speeds are linear between knots."""
        times = np.minimum(times, self.duration)
        knot = np.clip(np.searchsorted(self.knots, times, "right") - 1, 0, len(self.knots) - 1)
        begun = self.knots[knot]
        distance = self.driven_at_knots[knot] + 0.5 * (self.at(begun) + self.at(times)) * (times - begun)
        return (1.0 + SPEED_ROUNDING) * distance

    def instants(self, step: float) -> Array:
        """Times at which the vehicle has driven one step more each time, if nothing but its own speed holds it up."""
        times, knee = [0.0], max(self.top - self.first, 0.0) / self.gain
        to_knee = 0.5 * (self.first + self.top) * knee
        while times[-1] < self.duration:
            now = times[-1]
            rising = min(now, knee)
            wanted = self.first * rising + 0.5 * self.gain * rising**2 + self.top * (now - rising) + step
            if wanted <= to_knee:
                then = (sqrt(self.first**2 + 2.0 * self.gain * wanted) - self.first) / self.gain
            else:
                then = knee + (wanted - to_knee) / self.top
            times.append(min(then, now + LONGEST_STEP))
        return np.array(times)


class _Grid:
    """Cells of the planning frame, as bits of one integer: row after row, with room between the rows.

    Parameters
    ----------
    low, high : (2,) arrays
        Corners of what is covered, m; the origin is inside.
    cell : (2,) array
        Length and width of a cell, m.
    room : int
        Columns between rows: no step moves by more.
    """

    def __init__(self, low: Array, high: Array, cell: Array, room: int) -> None:
        self.cell = cell
        # The start lies just before the end of its cell, so that nothing is gained by the rest of it.
        columns_before = ceil(-low[0] / cell[0]) + 1
        rows_below = ceil(-low[1] / cell[1] - 0.5) + 1
        self.columns = columns_before + ceil(high[0] / cell[0]) + 1
        self.rows = rows_below + ceil(high[1] / cell[1] + 0.5) + 1
        self.stride = self.columns + room
        self.origin = np.array([ROUNDING - columns_before * cell[0], -(rows_below + 0.5) * cell[1]])
        self.start = 1 << (rows_below * self.stride + columns_before - 1)
        self._column = np.arange(self.stride)

    @property
    def lines(self) -> Array:
        """Borders between rows, (rows + 1,) m."""
        lines: Array = self.origin[1] + self.cell[1] * np.arange(self.rows + 1)
        return lines

    def packed(self, mask: Mask) -> int:
        """Bits of a mask, (rows, stride)."""
        return int.from_bytes(np.packbits(mask, bitorder="little").tobytes(), "little")

    def disc(self, center: tuple[float, float], radius: float) -> Mask:
        """Cells that a disc touches, (rows, stride)."""
        lines = self.lines
        away = np.clip(center[1], lines[:-1], lines[1:]) - center[1]
        half = np.sqrt(np.maximum(radius**2 - away**2, 0.0))
        first = np.floor((center[0] - half - self.origin[0]) / self.cell[0] - EDGE)
        last = np.floor((center[0] + half - self.origin[0]) / self.cell[0] + EDGE)
        last[np.abs(away) > radius] = -1.0
        mask: Mask = (self._column >= first[:, None]) & (self._column <= np.minimum(last, self.columns - 1)[:, None])
        return mask

    def inside(self, box: Box) -> Mask:
        """Cells that touch the workspace, (rows, stride)."""
        x = self.origin[0] + (self._column + 0.5) * self.cell[0]
        y = 0.5 * (self.lines[:-1] + self.lines[1:])
        mask = np.broadcast_to(self._column < self.columns, (self.rows, self.stride)).copy()
        for normal, offset in zip(box.normals, box.offsets, strict=True):
            nearest = 0.5 * float(np.abs(normal) @ self.cell)
            mask &= normal[0] * x + normal[1] * y[:, None] - nearest <= offset + ROUNDING
        return mask

    def covered(self, polygons: Array) -> tuple[Index, Index, Index, Index]:
        """Cells that lie wholly in convex polygons, one for each instant.

        Parameters
        ----------
        polygons : (K, C, 2) array
            Corners in order, m.

        Returns
        -------
        tuple of arrays of int
            Places in ``polygons``, rows, first columns, and columns after the last.
        """
        bottom = polygons[:, :, 1].min(axis=1)
        first_line = np.clip(np.ceil((bottom - self.origin[1]) / self.cell[1]), 0, self.rows).astype(np.intp)
        tallest = float((polygons[:, :, 1].max(axis=1) - bottom).max())
        count = min(floor(tallest / self.cell[1]) + 2, self.rows + 1)
        line = first_line[:, None] + np.arange(count)
        y = (self.origin[1] + self.cell[1] * line)[:, :, None]
        here, there = polygons[:, None], np.roll(polygons, -1, axis=1)[:, None]
        rise = there[..., 1] - here[..., 1]
        crossed = ((here[..., 1] <= y) != (there[..., 1] <= y)) & (rise != 0.0)
        share = np.where(crossed, (y - here[..., 1]) / np.where(rise == 0.0, 1.0, rise), 0.0)
        x = here[..., 0] + share * (there[..., 0] - here[..., 0])
        left = np.where(crossed, x, np.inf).min(axis=2)
        right = np.where(crossed, x, -np.inf).max(axis=2)
        # A cell lies in a convex polygon if both lines that bound its row do so at both of its ends.
        begin = np.ceil((np.maximum(left[:, :-1], left[:, 1:]) - self.origin[0]) / self.cell[0] + EDGE)
        end = np.floor((np.minimum(right[:, :-1], right[:, 1:]) - self.origin[0]) / self.cell[0] - EDGE)
        begin, end = np.clip(begin, 0, self.columns), np.clip(end, 0, self.columns)
        which, place = np.nonzero((end > begin) & (line[:, :-1] < self.rows))
        return (
            which,
            line[which, place],
            begin[which, place].astype(np.intp),
            end[which, place].astype(np.intp),
        )

    def reached_from(self, bits: int, distance: float) -> int:
        """Cells of which any point is within a distance, m, of any point of some cells."""
        up = down = 0
        wide, width = bits, 0
        for wanted in _widths(distance, float(self.cell[0]), float(self.cell[1])):
            while width < wanted:
                shift = min(wanted - width, 2 * width + 1)
                wide |= (wide << shift) | (wide >> shift)
                width += shift
            up, down = (up << self.stride) | wide, (down >> self.stride) | wide
        return up | down


@lru_cache(maxsize=256)
def _widths(distance: float, length: float, width: float) -> tuple[int, ...]:
    """By how many columns a step leads at most, in rows from the farthest that it leads to."""
    rows = floor(distance / width) + 1
    gaps = (max(row - 1, 0) * width for row in range(rows, -1, -1))
    return tuple(floor(sqrt(max(distance**2 - gap**2, 0.0)) / length + EDGE) + 1 for gap in gaps)


class _Relaxation:
    """Where trips of at most some duration can be, at each instant.

    Parameters
    ----------
    scenario : Scenario
    threat_zones : tuple of ThreatZone
    longest : float
        Durations up to this can be asked for, s.
    cells : int
        At most.
    deadline : float
        Of the clock of :func:`time.perf_counter`, s.

    Raises
    ------
    _NotDecided
        If there would be too much to look at, before anything is allocated; here and in all methods also when the
        time is over.
    """

    def __init__(
        self,
        scenario: Scenario,
        threat_zones: tuple[ThreatZone, ...],
        longest: float,
        cells: int = CELLS,
        deadline: float = np.inf,
    ) -> None:
        self.deadline = deadline
        start, goal = scenario.start, scenario.goal
        self.scenario = scenario
        self.distance = hypot(*np.subtract(goal.position, start.position))
        self.radius = goal.radius + ROUNDING
        self.frame = PlanningFrame.between(start.position, goal.position, start.time)
        self.box = Box.of(scenario, self.frame, 0.0)
        self.speeds = _Speeds(scenario, longest)
        self.grid, step = self._grid(cells, len(threat_zones))
        # What touches a zone is not inside it.
        self.zones = ZoneBatch.of(threat_zones, self.frame, scenario.vehicle.radius - ROUNDING)
        self.times = self.speeds.instants(step)
        self.in_time()

    def in_time(self) -> None:
        """Go on, unless the time is over."""
        if perf_counter() > self.deadline:
            raise _NotDecided

    def _grid(self, cells: int, zones: int) -> tuple[_Grid, float]:
        """The finest grid that has not too many cells, and its step, m."""
        longest = float(self.speeds.driven(np.array([self.speeds.duration]))[0]) + self.radius + ROUNDING
        half = max(0.5 * longest, 0.5 * self.distance)
        across = sqrt(max(half**2 - 0.25 * self.distance**2, 0.0))
        low = np.array([0.5 * self.distance - half, -across])
        high = np.array([0.5 * self.distance + half, across])
        if len(self.box.offsets):
            # corners of the workspace: where two neighbouring sides meet
            corners = [
                np.linalg.solve(self.box.normals[[i, j]], self.box.offsets[[i, j]] + ROUNDING)
                for i, j in ((0, 2), (0, 3), (1, 2), (1, 3))
            ]
            low, high = np.maximum(low, np.min(corners, axis=0)), np.minimum(high, np.max(corners, axis=0))
        low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
        work = QUICK_WORK if cells == FEW_CELLS else MOST_WORK
        for resolution in RESOLUTIONS:
            step = self.speeds.top * resolution.time
            cell = np.array([step / resolution.columns, step / resolution.rows])
            count = float(np.prod((high - low) / cell + 4.0))
            if count <= cells:
                break
        instants = self.speeds.duration / LONGEST_STEP + longest / step
        if instants * (count + ZONE_WORK * zones) > work:
            raise _NotDecided
        return _Grid(low, high, cell, resolution.columns + 2), ALIGNED * step

    @cached_property
    def allowed(self) -> list[int]:
        """Cells that are not wholly in a zone, outside the workspace or too far from the start, at each instant."""
        batch, driven = self.zones, self.speeds.driven(self.times)
        (standing,) = self._free(batch.subset(batch.standing), self.times[:1])
        standing &= self.grid.inside(self.box)
        found = []
        for distance, free in zip(driven, self._free(batch.subset(batch.moving), self.times), strict=True):
            self.in_time()
            free &= standing
            free &= self.grid.disc((0.0, 0.0), float(distance) + ROUNDING)
            found.append(self.grid.packed(free))
        return found

    def _free(self, batch: ZoneBatch, times: Array) -> Iterator[Mask]:
        """Cells that are not wholly in some part of a zone, at each time."""
        grid = self.grid
        low, high = grid.origin, grid.origin + grid.cell * [grid.columns, grid.rows]
        spans = [np.zeros((4, 0), dtype=np.intp)]
        for instants, polygons in _polygons_inside(batch, times, low, high):
            self.in_time()
            place, row, begin, end = grid.covered(polygons)
            spans.append(np.stack([instants[place], row, begin, end]))
        every = np.concatenate(spans, axis=1)
        instant, row, begin, end = every[:, np.argsort(every[0], kind="stable")]
        bounds = np.searchsorted(instant, np.arange(len(times) + 1))
        for first, last in pairwise(bounds.tolist()):
            mine = slice(first, last)
            depth = np.zeros((grid.rows, grid.stride), dtype=np.int16)
            np.add.at(depth, (row[mine], begin[mine]), 1)
            np.add.at(depth, (row[mine], end[mine]), -1)
            free: Mask = np.cumsum(depth, axis=1, dtype=np.int16) == 0
            yield free

    @cached_property
    def goal_is_free(self) -> list[bool]:
        """Whether some point of the goal may be outside the zones at some time between an instant and the next."""
        free = []
        for first, last in pairwise(self.times.tolist()):
            self.in_time()
            half = 0.5 * (last - first)
            goal = np.array([[self.distance, 0.0]])
            depth = -self.zones.distances(np.array([first + half]), goal)[0]
            moves = ZoneBounds(self.zones).approach(first, last, np.array([half]), np.zeros(1))[0]
            free.append(not bool(np.any(depth > moves + self.radius)))
        return free

    def possible(self, duration: float) -> bool:
        """Whether a trip that takes no longer than a duration, s, cannot be excluded."""
        scenario, grid, times = self.scenario, self.grid, self.times
        earliest = scenario.goal.earliest_arrival
        waits_until = -np.inf if earliest is None else earliest - ARRIVAL_TOLERANCE - scenario.start.time
        speeds = _Speeds(scenario, duration)
        goal = (self.distance, 0.0)
        instants = np.append(times[times < duration], duration)
        driven = speeds.driven(instants)
        steps, remaining = np.diff(driven), driven[-1] - driven
        reached = grid.start
        for k, step in enumerate(steps):
            self.in_time()
            if k > 0:
                reached = grid.reached_from(reached, float(steps[k - 1])) & self.allowed[k]
                reached &= grid.packed(grid.disc(goal, float(remaining[k]) + self.radius))
            if not reached:
                return False
            near_enough = driven[k + 1] + self.radius + ROUNDING >= self.distance
            if near_enough and instants[k + 1] >= waits_until and self.goal_is_free[k]:
                if reached & grid.packed(grid.disc(goal, float(step) + self.radius)):
                    return True
        return False


def _polygons_inside(batch: ZoneBatch, times: Array, low: Array, high: Array) -> Iterator[tuple[Index, Array]]:
    """Convex polygons inside the parts of zones that come near a box with given corners, m.

    Yields
    ------
    (k,) array of int, (k, C, 2) array
        Instants, and the corners at each in order, m: the points of the part that are farthest in some directions.
    """
    centers, reaches = batch.centers.grid(times), batch.reach(times)
    headings = directions_of(batch.directions.grid(times)) if batch.any_turning else None
    covariances = None if batch.covariances is None else batch.covariances.grid(times)
    for part in range(batch.size):
        center, reach = centers[:, part], reaches[:, part, None]
        met = np.flatnonzero(np.all((center + reach >= low) & (center - reach <= high), axis=1))
        if len(met) == 0:
            continue
        outline = None
        if batch.outlines is not None and batch.outline_slot[part] >= 0:
            outline = batch.outlines.outlines[batch.outline_slot[part]]
        own = _directions(outline)
        corners = batch.radius[part] * own
        if outline is not None:
            corners = corners + _farthest(outline, own)
        directions, corners = (np.broadcast_to(vectors, (len(met), *own.shape)) for vectors in (own, corners))
        if headings is not None and batch.turning[part]:
            backwards = headings[met, part][:, None] * [1.0, -1.0]
            directions, corners = turned_back(directions, backwards), turned_back(corners, backwards)
        if covariances is not None and batch.slot[part] >= 0:
            corners = corners + _ellipse_points(covariances[met, batch.slot[part]][:, None], directions)
        yield met, center[met, None] + corners


def _directions(outline: Outline | None) -> Array:
    """Directions all around, and beside those of a polygon's edges, by their angle, (C, 2)."""
    angles = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    if outline is not None and outline.vertices is not None:
        normals = np.arctan2(outline.normals[:, 1], outline.normals[:, 0])
        angles = np.concatenate([angles, (normals - BESIDE) % (2.0 * np.pi), (normals + BESIDE) % (2.0 * np.pi)])
    angles = np.sort(angles)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _farthest(outline: Outline, directions: Array) -> Array:
    """Points of an outline that are farthest in directions (C, 2), m."""
    if outline.vertices is not None:
        farthest: Array = outline.vertices[np.argmax(directions @ outline.vertices.T, axis=1)]
        return farthest
    assert outline.matrix is not None
    return _ellipse_points(outline.matrix, directions)


def _ellipse_points(matrix: Array, directions: Array) -> Array:
    """The points A nu / sqrt(nu' A nu) of ellipses, A = (..., 3) m^2, farthest in directions nu (..., 2)."""
    xx, xy, yy = np.moveaxis(matrix, -1, 0)
    x, y = directions[..., 0], directions[..., 1]
    return (
        np.stack([xx * x + xy * y, xy * x + yy * y], axis=-1) / np.maximum(support(matrix, directions), TINY)[..., None]
    )
