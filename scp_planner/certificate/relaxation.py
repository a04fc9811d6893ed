"""Places that any trip of at most some duration can be at, at each of some instants: see `lower_bound`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import ceil, hypot, sqrt
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.certificate.cell_grid import CellGrid, Window
from scp_planner.certificate.fastest_drive import LONGEST_STEP, Speeds
from scp_planner.certificate.inscribed import polygons_inside
from scp_planner.certificate.tolerances import ALIGNED, ARRIVAL_TOLERANCE, ROUNDING
from scp_planner.certificate.verdict import off_a_step
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.scenario.limits import Box
from scp_planner.scenario.models import Scenario
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.bounds import ZoneBounds
from scp_planner.threat_zones.zone import ThreatZone


@dataclass(frozen=True)
class _Resolution:
    """Time between instants at top speed, and how many cells the vehicle then moves by along and across the line."""

    time: float
    columns: int
    rows: int


@dataclass(frozen=True)
class RelaxationSize:
    """Size of relaxations: cells, instants and work."""

    cells: int = 350_000  # at most, at an instant on average
    some_cells: int = 90_000  # for what a coarse look can exclude
    few_cells: int = 60_000  # for an answer in hundredths of a second
    most_work: float = 2e9  # cells at all instants together, and what zones cost: what a bound looks at, at most
    quick_work: float = 1e8  # the same of a quick proof
    offsets: int = 33  # at how far from the line a trip may be
    zone_work: int = 1000  # cells that cost as much as a zone
    resolutions: tuple[_Resolution, ...] = (
        _Resolution(0.1, 64, 64),
        _Resolution(0.1, 64, 48),
        _Resolution(0.1, 64, 32),
        _Resolution(0.1, 64, 24),
        _Resolution(0.1, 64, 16),
        _Resolution(0.1, 64, 12),
        _Resolution(0.1, 48, 8),
        _Resolution(0.15, 32, 8),
        _Resolution(0.2, 24, 6),
        _Resolution(0.3, 16, 5),
        _Resolution(0.5, 16, 4),
        _Resolution(1.0, 12, 4),
    )


SIZE = RelaxationSize()


class NotDecided(Exception):
    """A relaxation is too large, or the time is over: nothing is excluded."""


class Relaxation:
    """Places that trips of at most some duration can be at, at each instant."""

    def __init__(
        self,
        scenario: Scenario,
        threat_zones: tuple[ThreatZone, ...],
        longest: float,
        cells: int = SIZE.cells,
        deadline: float = np.inf,
    ) -> None:
        self.deadline = deadline
        start, goal = scenario.start, scenario.goal
        self.scenario = scenario
        self.distance = hypot(*np.subtract(goal.position, start.position))
        self.radius = goal.radius + ROUNDING
        self.frame = PlanningFrame.between(start.position, goal.position, start.time)
        self.box = Box.of(scenario, self.frame, 0.0)
        self.speeds = Speeds(scenario, longest)
        self._most_driven = float(self.speeds.driven(np.array([longest]))[0])
        self.grid, step = self._grid(cells, len(threat_zones))
        # What touches a zone is not inside it.
        self.zones = ZoneBatch.of(threat_zones, self.frame, scenario.vehicle.radius - ROUNDING)
        self.times = self.speeds.instants(step)
        self.driven = self.speeds.driven(self.times)
        # Whoever is to arrive in time is not farther back; a window has room for all that can be reached by then.
        back = self.distance - self.radius - ROUNDING - (self._most_driven - self.driven)
        self.windows = self.grid.windows(back, self._aside(self.driven))
        self.in_time()

    def in_time(self) -> None:
        """Go on, unless the time is over."""
        if perf_counter() > self.deadline:
            raise NotDecided

    def _grid(self, cells: int, zones: int) -> tuple[CellGrid, float]:
        """The finest grid that has not too many cells, and its step, m."""
        longest = self._most_driven + self.radius + ROUNDING
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
        work = SIZE.quick_work if cells == SIZE.few_cells else SIZE.most_work
        for resolution in SIZE.resolutions:
            step = self.speeds.top * resolution.time
            cell = np.array([step / resolution.columns, step / resolution.rows])
            room = 2 * resolution.columns + 4  # to both sides, and as far as a window moves
            window = ceil((longest - self.distance + ROUNDING) / cell[0]) + 3
            driven = np.linspace(0.0, self._most_driven, SIZE.offsets)
            aside = np.minimum(self._aside(driven), 0.5 * (high[1] - low[1]))
            rows = float(np.mean(2.0 * aside)) / cell[1] + 4.0
            count = rows * (min((high[0] - low[0]) / cell[0] + 4.0, window) + room)
            if count <= cells:
                break
        instants = self.speeds.duration / LONGEST_STEP + longest / step
        if instants * (count + SIZE.zone_work * zones) > work:
            raise NotDecided
        return CellGrid(low, high, cell, room, window), ALIGNED * step

    def _aside(self, driven: Array) -> Array:
        """Largest distance from the line, m, after a largest way, m, for a trip that arrives in time."""
        here, there = driven + ROUNDING, self._most_driven - driven + self.radius + ROUNDING
        # Half of the lens in which two discs meet, or of the smaller of them
        apart = max(self.distance, ROUNDING)
        along = (apart**2 + here**2 - there**2) / (2.0 * apart)
        lens = np.sqrt(np.maximum(here**2 - along**2, 0.0))
        aside: Array = np.where(along <= 0.0, here, np.where(along >= apart, there, lens))
        return aside

    @cached_property
    def allowed(self) -> list[int]:
        """Cells that are not wholly in a zone, outside the workspace or too far from the start, at each instant."""
        batch, grid, found = self.zones, self.grid, []
        standing = self._spans(batch.subset(batch.standing), self.times[:1])[0]
        moving = self._spans(batch.subset(batch.moving), self.times)
        for window, distance, spans in zip(self.windows, self.driven.tolist(), moving, strict=True):
            self.in_time()
            free = self._outside_of([standing, spans], window)
            free &= grid.disc((0.0, 0.0), distance + ROUNDING, window)
            if len(self.box.offsets):
                free &= grid.inside(self.box, window)
            found.append(grid.packed(free))
        return found

    def _spans(self, batch: ZoneBatch, times: Array) -> list[Index]:
        """Rows, first columns, and columns after the last, of cells that are wholly in zones, (3, n) at each time."""
        grid = self.grid
        low, high = grid.origin, grid.origin + grid.cell * [grid.columns, grid.rows]
        spans = [np.zeros((4, 0), dtype=np.intp)]
        for instants, polygons in polygons_inside(batch, times, low, high):
            self.in_time()
            place, row, begin, end = grid.covered(polygons)
            spans.append(np.stack([instants[place], row, begin, end]))
        every = np.concatenate(spans, axis=1)
        every = every[:, np.argsort(every[0], kind="stable")]
        bounds = np.searchsorted(every[0], np.arange(len(times) + 1))
        return [every[1:, first:last] for first, last in pairwise(bounds.tolist())]

    def _outside_of(self, spans: list[Index], window: Window) -> Mask:
        """Cells of a window that are not in spans, (rows, stride)."""
        grid = self.grid
        depth = np.zeros((window.rows, grid.stride), dtype=np.int16)
        for some in spans:
            row, begin, end = some[:, (some[0] >= window.row) & (some[0] < window.row + window.rows)]
            row = row - window.row
            np.add.at(depth, (row, np.clip(begin - window.column, 0, grid.window)), 1)
            np.add.at(depth, (row, np.clip(end - window.column, 0, grid.window)), -1)
        free: Mask = np.cumsum(depth, axis=1, dtype=np.int16) == 0
        return free

    @cached_property
    def goal_is_free(self) -> list[bool]:
        """True if some point of the goal may be outside the zones at some time between an instant and the next."""
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
        """True if a trip that takes no longer than a duration, s, cannot be excluded."""
        scenario, grid, times = self.scenario, self.grid, self.times
        earliest = scenario.goal.earliest_arrival
        waits_until = -np.inf
        if earliest is not None:
            step = scenario.goal.arrival_step
            off = ARRIVAL_TOLERANCE * duration + (0.0 if step is None else off_a_step(step))
            waits_until = earliest - off - scenario.start.time
        speeds = Speeds(scenario, duration)
        goal = (self.distance, 0.0)
        instants = np.append(times[times < duration], duration)
        driven = speeds.driven(instants)
        steps, remaining = np.diff(driven), driven[-1] - driven
        reached = grid.start(self.windows[0])
        for k, (step, window) in enumerate(zip(steps, self.windows, strict=False)):
            self.in_time()
            if k > 0:
                moved = window.bits_after(self.windows[k - 1], grid.stride)
                reached = grid.reached_from(reached, float(steps[k - 1]))
                reached = reached >> moved if moved >= 0 else reached << -moved
                reached &= self.allowed[k]
                reached &= grid.packed(grid.disc(goal, float(remaining[k]) + self.radius, window))
            if not reached:
                return False
            near_enough = driven[k + 1] + self.radius + ROUNDING >= self.distance
            if near_enough and instants[k + 1] >= waits_until and self.goal_is_free[k]:
                if reached & grid.packed(grid.disc(goal, float(step) + self.radius, window)):
                    return True
        return False
