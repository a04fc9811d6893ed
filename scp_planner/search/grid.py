"""The grid of the search: states of a vehicle that follows the guide, as fine as the scene asks for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scp_planner.arrays import Array, Index
from scp_planner.problem.problem import Problem
from scp_planner.scenario.limits import Limits

Words = NDArray[np.uint64]

DELAYS = 64
"""Bits of a word."""
EACH_STATION = 2
"""Looks at the zones from one station to the next: halfway, and there."""


@dataclass(frozen=True)
class Fineness:
    """Fineness of a grid, in ratios."""

    stations: float = 0.9  # Stations to a typical radius of what is in the way
    slope_step: float = 0.25  # The least slope but 0
    slopes: tuple[int, ...] = (1, 2, 3, 4, 6, 9, 14)  # Classes of slope to each side, in steps
    turns: int = 3  # Classes by which the slope changes between stations, at most
    speeds: int = 5  # Classes of speed
    delays: float = 10.0  # Delays to the time from one station to the next at top speed
    shrunk: float = 0.4  # Steps of the offset by which zones are taken to be smaller, so that narrow gaps hold a cell


@dataclass(frozen=True)
class GridSize:
    """Size of a grid."""

    # of the braking distance and of the turning radius at top speed: finer steps lead to no other ways
    least_step: float = 0.2
    fewest_stations: int = 12
    most_stations: int = 2000
    most_cells: int = 200_000  # stations times offsets to one side: detours are narrower where there would be more
    most_moments: int = 8  # of a delay
    profile_looks: int = 8  # at the fastest drive, between lines


SIZE = GridSize()


@dataclass(frozen=True)
class Grid:
    """See the module."""

    lines: Array  # (2 n + 1,) Stations, and the middles between them
    fastest: Array  # (2 n + 1,)
    offset_step: float
    delay_step: float
    middle: int  # Offsets to each side
    slopes: Array  # (M,) Slopes of the classes, increasing
    sidesteps: Index  # (M,) By how many offsets each leads to the side, from one station to the next
    speeds: Array  # (K,) Highest speed of each class, the fastest first
    turns: Index  # (K,) By how many classes the slope changes at most, from one station to the next
    rises: int  # By how many classes the speed rises and falls at most
    falls: int  # By how many classes the speed rises and falls at most
    first_speeds: slice  # Classes of the speed at the start
    shrunk: float  # By how much zones are taken to be smaller
    # Times about each delay at which zones are looked at: in the time of a coarse one, whole rows of them pass
    moments: tuple[float, ...] = (0.0,)

    @property
    def columns(self) -> int:
        """From one station to the next, so many times."""
        return (len(self.lines) - 1) // EACH_STATION

    @property
    def stations(self) -> Array:
        """Stations, (n + 1,)."""
        return self.lines[::EACH_STATION]

    @property
    def step(self) -> float:
        """Distance of stations."""
        return float(self.lines[EACH_STATION] - self.lines[0])

    @cached_property
    def offsets(self) -> Array:
        """Offsets at stations, (O,)."""
        offsets: Array = self.offset_step * np.arange(-self.middle, self.middle + 1, dtype=np.float64)
        return offsets

    @cached_property
    def half_offsets(self) -> Array:
        """Offsets on lines, (2 O - 1,): between stations they lie between those at stations too."""
        offsets: Array = 0.5 * self.offset_step * np.arange(-2 * self.middle, 2 * self.middle + 1, dtype=np.float64)
        return offsets

    @cached_property
    def turn_counts(self) -> list[int]:
        """``turns``, to be looked up one by one."""
        counts: list[int] = self.turns.tolist()
        return counts

    @cached_property
    def sidestep_counts(self) -> list[int]:
        """``sidesteps``, to be looked up one by one."""
        counts: list[int] = self.sidesteps.tolist()
        return counts

    @cached_property
    def speeds_before(self) -> list[range]:
        """From which classes of speed each is reached at a station."""
        classes = range(len(self.speeds))
        return [classes[max(k - self.falls, 0) : k + self.rises + 1] for k in classes]

    @cached_property
    def slopes_near(self) -> list[list[range]]:
        """Classes of slope after each class at a station, for each class of speed."""
        count = len(self.slopes)
        return [[range(max(m - by, 0), min(m + by + 1, count)) for m in range(count)] for by in self.turn_counts]

    @cached_property
    def durations(self) -> Array:
        """Time from one station to the next with each class of speed and slope, (n, K, M)."""
        least = np.diff(self.fastest[::EACH_STATION])
        speed = np.minimum(self.speeds, (self.step / least)[:, None])
        found: Array = self.step * np.hypot(1.0, self.slopes) / speed[:, :, None]
        return np.maximum(found, least[:, None, None])

    @cached_property
    def shifts(self) -> Words:
        """By how many delays each half of that is more than the fastest drive takes, (2 n, K, M)."""
        more = (self.durations - np.diff(self.fastest[::EACH_STATION])[:, None, None]) / (
            EACH_STATION * self.delay_step
        )
        more = np.repeat(np.minimum(more, 2.0 * DELAYS), EACH_STATION, axis=0)
        number = np.arange(len(more))[:, None, None]
        shifts: Words = (np.floor((number + 1) * more + 0.5) - np.floor(number * more + 0.5)).astype(np.uint64)
        return shifts

    @cached_property
    def shift_lists(self) -> list[list[list[int]]]:
        """``shifts``, to be looked up one by one."""
        shifts: list[list[list[int]]] = self.shifts.tolist()
        return shifts

    @classmethod
    def of(cls, problem: Problem, fineness: Fineness, coarseness: float = 1.0) -> Grid:
        """Return the grid of a problem, its delays in steps that are longer by a factor."""
        space, limits = problem.space, problem.limits
        # Classes of speeds that are never driven would leave too few for those that are
        reached = float(np.sqrt(space.start_speed**2 + 2.0 * limits.acceleration * space.length))
        top = max(min(limits.speed, reached), space.start_speed)
        radius = problem.zones.typical_radius
        count: float = SIZE.fewest_stations
        if radius is not None:
            finest = SIZE.least_step * min(top * top / (2.0 * limits.deceleration), _turning_radius(limits, top))
            count = space.length / max(radius / fineness.stations, finest)
        count = round(min(max(count, SIZE.fewest_stations), SIZE.most_stations))
        lines = np.linspace(0.0, space.length, EACH_STATION * count + 1)
        step = space.length / count
        offset_step = fineness.slope_step * step
        middle = max(2, min(int(problem.settings.max_offset / offset_step), SIZE.most_cells // count))
        steps = np.array([*(-some for some in reversed(fineness.slopes)), 0, *fineness.slopes], dtype=np.intp)
        squares = top * top * (1.0 - np.arange(fineness.speeds) / (fineness.speeds - 0.5))
        per_class = squares[0] - squares[1]
        with np.errstate(divide="ignore"):
            bends = np.minimum(limits.lateral_acceleration / squares, limits.curvature)
        turns = np.clip(np.round(np.minimum(bends * step / fineness.slope_step, fineness.turns)), 1, fineness.turns)
        slowest_first = int(np.searchsorted(-squares, -(space.start_speed**2), "left"))
        return cls(
            lines=lines,
            fastest=fastest_times(problem, lines),
            offset_step=offset_step,
            delay_step=coarseness * step / (top * fineness.delays),
            middle=middle,
            slopes=fineness.slope_step * steps.astype(np.float64),
            sidesteps=steps,
            speeds=np.sqrt(squares),
            turns=turns.astype(np.intp),
            rises=max(1, round(2.0 * limits.acceleration * step / per_class)),
            falls=max(1, round(2.0 * limits.deceleration * step / per_class)),
            first_speeds=slice(0, min(slowest_first + 1, fineness.speeds)),
            shrunk=fineness.shrunk * offset_step,
            moments=_moments(coarseness, coarseness * step / (top * fineness.delays)),
        )


def _moments(coarseness: float, delay_step: float) -> tuple[float, ...]:
    count = min(max(1, round(coarseness)), SIZE.most_moments)
    return tuple((((np.arange(count) + 0.5) / count - 0.5) * delay_step).tolist())


def _turning_radius(limits: Limits, speed: float) -> float:
    """Radius of the tightest bend at a speed; inf without limits, as nothing is to be told apart then."""
    bend = min(limits.curvature, limits.lateral_acceleration / (speed * speed))
    return 1.0 / bend if np.isfinite(bend) else np.inf


def fastest_times(problem: Problem, stations: Array) -> Array:
    """Earliest times at equidistant stations, from the first on, of a drive along the guide without obstacles."""
    if problem.profile is not None:
        return problem.profile.times_at(stations)
    space, limits = problem.space, problem.limits
    fine = np.linspace(stations[0], stations[-1], SIZE.profile_looks * (len(stations) - 1) + 1)
    squares = np.minimum(
        space.start_speed**2 + 2.0 * limits.acceleration * fine, max(limits.speed, space.start_speed) ** 2
    )
    goal_speed = problem.ends.goal_speed
    if goal_speed is not None:
        squares = np.minimum(squares, goal_speed**2 + 2.0 * limits.deceleration * (fine[-1] - fine))
    speeds = np.sqrt(squares)
    # Exact where the acceleration is constant
    times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(fine) / (speeds[:-1] + speeds[1:]))])
    return times[:: SIZE.profile_looks]
