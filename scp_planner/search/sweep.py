"""What can be reached on the grid, station by station, and the fastest ways back from the goal.

Several cases, which differ in the cells that are free, are swept together: most of the time of a sweep is that of
calls, which they share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Index
from scp_planner.search.grid import DELAYS, EACH_STATION, Grid, Words

ONE, ALL = np.uint64(1), np.uint64(2**DELAYS - 1)
WAITS = tuple(np.uint64(2**power) for power in range(6))  # doubled, they reach all delays of a word
NEVER = 10**6  # more than any change of slope and speed


@dataclass(frozen=True)
class Ends:
    """Where ways begin and end.

    Attributes
    ----------
    first_slopes, last_slopes : slice
        Slopes before the start and at the goal.
    goal : (O,) array of words
        Which offsets and delays are an arrival.
    """

    first_slopes: slice
    last_slopes: slice
    goal: Words


@dataclass(frozen=True)
class States:
    """States on the way, one a station.

    Attributes
    ----------
    slope, speed, offset, delay : (n + 1,) arrays of int
        Classes and cells; slope and speed are those of the leg that ends at the station.
    waited : (n,) array of int
        Delays for which the vehicle waits at each station but the first.
    """

    slope: Index
    speed: Index
    offset: Index
    delay: Index
    waited: Index


@dataclass(frozen=True)
class _Reached:
    """States that are reached at a station: those outside of a block are not.

    Attributes
    ----------
    words : (k, m, o, C) array
        Delays of each class of speed, slope and offset in each case: in this order long stretches of memory are moved.
    speed, slope, offset : int
        Where the block begins.
    """

    words: Words
    speed: int
    slope: int
    offset: int

    @property
    def last(self) -> int:
        """The offset after the last one."""
        return self.offset + self.words.shape[2]

    def trimmed(self) -> _Reached | None:
        """The same without ends of the block that nothing is reached with; None if nothing is reached."""
        words = self.words
        speeds = np.flatnonzero(np.bitwise_or.reduce(words.reshape(len(words), -1), axis=1))
        if len(speeds) == 0:
            return None
        some = np.bitwise_or.reduce(words, axis=0)
        slopes = np.flatnonzero(np.bitwise_or.reduce(some.reshape(len(some), -1), axis=1))
        offsets = np.flatnonzero(np.bitwise_or.reduce(np.bitwise_or.reduce(some, axis=0), axis=1))
        k, m, o = int(speeds[0]), int(slopes[0]), int(offsets[0])
        words = words[k : int(speeds[-1]) + 1, m : int(slopes[-1]) + 1, o : int(offsets[-1]) + 1]
        return _Reached(words, self.speed + k, self.slope + m, self.offset + o)


class Sweep:
    """One sweep over the stations.

    Parameters
    ----------
    grid : Grid
    free : (lines, half offsets, C) array of words
        Free cells in each case.
    ends : Ends
    in_time : (n + 1, K, O) array of words
        Delays that are looked at, at each station, of each class of speed and offset.
    """

    def __init__(self, grid: Grid, free: Words, ends: Ends, in_time: Words) -> None:
        self.grid, self.free, self.in_time = grid, free, in_time
        self._margin = int(grid.sidesteps.max())
        start = np.zeros((len(grid.speeds), len(grid.slopes), 1, free.shape[2]), dtype=np.uint64)
        start[grid.first_speeds, ends.first_slopes] = ONE
        first = _Reached(start, 0, 0, grid.middle).trimmed()
        assert first is not None, "there is a slope and a speed at the start"
        self.reached = [first]
        self.arrivals: Words = np.zeros_like(start)
        open_ = np.any(in_time != 0, axis=1)
        some = open_.any(axis=1)
        # Classes of speed from which the goal is reached in time, at each station
        self._timely = np.count_nonzero(np.any(in_time != 0, axis=2), axis=1).tolist()
        begin, end = np.argmax(open_, axis=1), open_.shape[1] - np.argmax(open_[:, ::-1], axis=1)
        for i in range(1, grid.columns + 1):
            before = self.reached[-1]
            low, high = max(int(begin[i]), before.offset - self._margin), min(int(end[i]), before.last + self._margin)
            here = self._advanced(i, low, high).trimmed() if some[i] and low < high else None
            if here is None:
                return
            self.reached.append(here)
        last = self.reached[-1]
        slopes: Words = np.zeros(len(grid.slopes), dtype=np.uint64)
        slopes[ends.last_slopes] = ALL
        arrivals: Words = last.words & ends.goal[last.offset : last.last].reshape(-1, 1)
        self.arrivals = arrivals & slopes[last.slope : last.slope + arrivals.shape[1]].reshape(-1, 1, 1)

    def _advanced(self, i: int, low: int, high: int) -> _Reached:
        """What is reached at the next station, at offsets from low to before high."""
        grid, before = self.grid, self.reached[-1]
        left = self._turned(self._driven(before, self._timely[i]))
        speeds, steep, _, cases = left.words.shape
        arriving = np.zeros((speeds, steep, high - low, cases), dtype=np.uint64)
        for row, side in enumerate(grid.sidesteps[left.slope : left.slope + steep].tolist()):
            first, last = max(before.offset + side, low), min(before.last + side, high)
            if first < last:
                begin = first - side - before.offset
                arriving[:, row, first - low : last - low] = left.words[:, row, begin : begin + last - first]
        line = EACH_STATION * (i - 1) + 1
        some = (slice(left.speed, left.speed + speeds), slice(left.slope, left.slope + steep))
        words: Words = np.left_shift(arriving, grid.shifts[line - 1][some][:, :, None, None], out=arriving)
        words &= self._halfway(line, low, high)[some[1]]
        np.left_shift(words, grid.shifts[line][some][:, :, None, None], out=words)
        free = self.free[line + 1, 2 * low : 2 * high - 1 : 2]
        words &= free & self.in_time[i, some[0], None, low:high, None]
        if left.speed + speeds == len(grid.speeds):
            _wait(words[-1], free & self.in_time[i, -1, low:high, None])
        return _Reached(words, left.speed, left.slope, low)

    def _driven(self, before: _Reached, timely: int) -> _Reached:
        """The same states after changes of speed, to so many classes, the fastest first."""
        grid, (speeds, slopes, width, cases) = self.grid, before.words.shape
        fast = max(before.speed - grid.rises, 0)
        slow = max(min(before.speed + speeds + grid.falls, timely), fast + 1)
        driven = np.zeros((slow - fast, slopes, width, cases), dtype=np.uint64)
        for change in range(-grid.rises, grid.falls + 1):
            first, last = max(before.speed + change, 0), min(before.speed + speeds + change, slow)
            if first < last:
                begin = first - change - before.speed
                driven[first - fast : last - fast] |= before.words[begin : begin + last - first]
        return _Reached(driven, fast, before.slope, before.offset)

    def _turned(self, before: _Reached) -> _Reached:
        """The same states after changes of slope, of which slower ones can do more."""
        grid, (speeds, slopes, width, cases) = self.grid, before.words.shape
        turns = int(grid.turns[before.speed + speeds - 1])
        left = max(before.slope - turns, 0)
        right = min(before.slope + slopes + turns, len(grid.slopes))
        turned = np.zeros((speeds, right - left, width, cases), dtype=np.uint64)
        turned[:, before.slope - left : before.slope - left + slopes] = before.words
        spread, first = turned, 0
        for slowest in grid.slowest_turns:
            slow = max(slowest - before.speed, 0)
            if slow >= speeds:
                break
            wider, first = spread[slow - first :], slow
            spread = wider.copy()
            spread[:, 1:] |= wider[:, :-1]
            spread[:, :-1] |= wider[:, 1:]
            turned[slow:] = spread
        return _Reached(turned, before.speed, left, before.offset)

    def _halfway(self, line: int, low: int, high: int) -> Words:
        """Free cells halfway to each offset from low to before high with each slope, (M, B, C)."""
        places = 2 * np.arange(low, high) - self.grid.sidesteps[:, None]
        free: Words = np.take(self.free[line], places, axis=0, mode="clip")
        return free

    def first_arrival(self, case: int = 0) -> int | None:
        """The least delay at the goal in a case; None if it is not reached."""
        word = int(np.bitwise_or.reduce(self.arrivals[..., case], axis=None))
        return None if word == 0 else (word & -word).bit_length() - 1

    def trace(self, delay: int, case: int = 0) -> States:
        """Follow a way back from the goal that arrives with a delay, as straight and as fast as there is one."""
        grid, count, last = self.grid, self.grid.columns, self.reached[-1]
        states = np.zeros((count + 1, 5), dtype=np.intp)
        corner = np.array([last.speed, last.slope, last.offset])
        some = corner + np.argwhere(self.arrivals[..., case] >> np.uint64(delay) & ONE)
        straight = some[:, 0] + np.abs(grid.sidesteps[some[:, 1]]) + np.abs(some[:, 2] - grid.middle)
        states[count, :4] = *some[int(np.argmin(straight))], delay
        for i in range(count, 0, -1):
            k, m, o, d, _ = states[i].tolist()
            came = self._came(case, i, m, o, d) if k == len(grid.speeds) - 1 else d
            states[i, 4] = d - came
            d = came - int(grid.shifts[EACH_STATION * i - 2, k, m] + grid.shifts[EACH_STATION * i - 1, k, m])
            states[i - 1, :4] = *self._before(case, i, m, k, o - int(grid.sidesteps[m]), d), d
        return States(states[:, 1], states[:, 0], states[:, 2], states[:, 3], states[1:, 4])

    def _earlier(self, case: int, i: int, m: int, k: int, offset: int) -> _Reached:
        """States at the station before at an offset, which is left with a slope and speed."""
        grid, before = self.grid, self.reached[i - 1]
        turns = int(grid.turns[k])
        steep, slow = max(m - turns, before.slope), max(k - grid.falls, before.speed)
        words = before.words[
            slow - before.speed : max(k + grid.rises + 1 - before.speed, 0),
            steep - before.slope : max(m + turns + 1 - before.slope, 0),
            max(offset - before.offset, 0) : max(offset + 1 - before.offset, 0),
            case : case + 1,
        ]
        return _Reached(words, slow, steep, offset)

    def _before(self, case: int, i: int, m: int, k: int, offset: int, delay: int) -> tuple[int, int, int]:
        """Speed, slope and offset at the station before, with the least change."""
        earlier = self._earlier(case, i, m, k, offset)
        possible = earlier.words[:, :, 0, 0] >> np.uint64(delay) & ONE
        rows, columns = possible.shape
        change = 2 * np.abs(np.arange(columns) + (earlier.slope - m))
        change = change + np.abs(np.arange(rows) + (earlier.speed - k))[:, None]
        best = int(np.where(possible, change, NEVER).argmin())
        return earlier.speed + best // columns, earlier.slope + best % columns, offset

    def _came(self, case: int, i: int, m: int, offset: int, delay: int) -> int:
        """The delay at which the slowest came to a station where they then waited until another."""
        grid = self.grid
        line, k, mask = EACH_STATION * (i - 1) + 1, len(grid.speeds) - 1, int(ALL)
        words = self._earlier(case, i, m, k, offset - int(grid.sidesteps[m])).words
        came = int(np.bitwise_or.reduce(words, axis=None)) << int(grid.shifts[line - 1, k, m]) & mask
        came &= int(self.free[line, 2 * offset - int(grid.sidesteps[m]), case])
        came = (
            came << int(grid.shifts[line, k, m])
            & mask
            & int(self.free[line + 1, 2 * offset, case] & self.in_time[i, k, offset])
        )
        return (came & (2 << delay) - 1).bit_length() - 1


def _wait(slowest: Words, free: Words) -> None:
    """Let the slowest wait while their cell stays free, (M, B, C) and (B, C)."""
    if not slowest.any():
        return
    open_ = free.copy()
    for shift in WAITS:
        slowest |= open_ & (slowest << shift)
        open_ &= open_ << shift
