"""What can be reached on the grid, station by station, and the fastest ways back from the goal.

Several cases, which differ in the cells that are free, are swept together: most of the time of a sweep is that of
calls, which they share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Index
from scp_planner.search.grid import DELAYS, LOOKS, Grid, Words

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
        """The same without slopes and speeds at the ends that nothing is reached with; None if nothing is reached."""
        some = np.bitwise_or.reduce(self.words.reshape(*self.words.shape[:2], -1), axis=2) != 0
        speeds, slopes = np.flatnonzero(some.any(axis=1)), np.flatnonzero(some.any(axis=0))
        if len(slopes) == 0:
            return None
        k, m = int(speeds[0]), int(slopes[0])
        words = self.words[k : int(speeds[-1]) + 1, m : int(slopes[-1]) + 1]
        return _Reached(words, self.speed + k, self.slope + m, self.offset)


class Sweep:
    """One sweep over the stations.

    Parameters
    ----------
    grid : Grid
    free : (lines, half offsets, C) array of words
        Free cells in each case.
    ends : Ends
    """

    def __init__(self, grid: Grid, free: Words, ends: Ends) -> None:
        self.grid, self.free = grid, free
        self._margin = len(grid.slopes) // 2
        start = np.zeros((len(grid.speeds), len(grid.slopes), 1, free.shape[2]), dtype=np.uint64)
        start[grid.first_speeds, ends.first_slopes] = ONE
        first = _Reached(start, 0, 0, grid.middle).trimmed()
        assert first is not None, "there is a slope and a speed at the start"
        self.reached = [first]
        self.arrivals: Words = np.zeros_like(start)
        open_ = np.any(free[::LOOKS, ::2] != 0, axis=2)
        some = open_.any(axis=1)
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
        grid, margin, before = self.grid, self._margin, self.reached[-1]
        left = self._turned(self._driven(before))
        speeds, steep, width, cases = left.words.shape
        # No way leads from the offsets by more than the margin, and back by as much again.
        room = np.zeros((speeds, steep, width + 4 * margin, cases), dtype=np.uint64)
        room[:, :, 2 * margin : 2 * margin + width] = left.words
        speed, row, column, cell = room.strides
        begin = (low - before.offset + 3 * margin - left.slope) * column
        # Seen along the slopes: what arrives at an offset with a slope has left from another one.
        shape, strides = (speeds, steep, high - low, cases), (speed, row - column, column, cell)
        arriving: Words = np.ndarray(shape, np.uint64, room, begin, strides)
        line = LOOKS * (i - 1) + 1
        some = (slice(left.speed, left.speed + speeds), slice(left.slope, left.slope + steep))
        words: Words = np.left_shift(arriving, grid.shifts[line - 1][some][:, :, None, None])
        words &= self._halfway(line, low, high)[some[1]]
        np.left_shift(words, grid.shifts[line][some][:, :, None, None], out=words)
        free = self.free[line + 1, 2 * low : 2 * high - 1 : 2]
        words &= free
        if left.speed + speeds == len(grid.speeds):
            _wait(words[-1], free)
        return _Reached(words, left.speed, left.slope, low)

    def _driven(self, before: _Reached) -> _Reached:
        """The same states after changes of speed."""
        grid, (speeds, slopes, width, cases) = self.grid, before.words.shape
        fast = max(before.speed - grid.rises, 0)
        slow = min(before.speed + speeds + grid.falls, len(grid.speeds))
        driven = np.zeros((slow - fast, slopes, width, cases), dtype=np.uint64)
        for change in range(-grid.rises, grid.falls + 1):
            first, last = max(before.speed + change, 0), min(before.speed + speeds + change, len(grid.speeds))
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
        margin, cases = self._margin, self.free.shape[2]
        rows = np.zeros((2 * (high - low) - 1 + 2 * margin, cases), dtype=np.uint64)
        first, last = max(2 * low - margin, 0), min(2 * high - 1 + margin, self.free.shape[1])
        begin = first - (2 * low - margin)
        rows[begin : begin + last - first] = self.free[line, first:last]
        row, cell = rows.strides
        # The half offset 2 o - m of offset o and slope m, which counts from the steepest to the right
        shape, strides = (2 * margin + 1, high - low, cases), (-row, 2 * row, cell)
        halfway: Words = np.ndarray(shape, np.uint64, rows, 2 * margin * row, strides)
        return halfway

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
        straight = some[:, 0] + np.abs(some[:, 1] - self._margin) + np.abs(some[:, 2] - grid.middle)
        states[count, :4] = *some[int(np.argmin(straight))], delay
        for i in range(count, 0, -1):
            k, m, o, d, _ = states[i].tolist()
            came = self._came(case, i, m, o, d) if k == len(grid.speeds) - 1 else d
            states[i, 4] = d - came
            d = came - int(grid.shifts[LOOKS * i - 2, k, m] + grid.shifts[LOOKS * i - 1, k, m])
            states[i - 1, :4] = *self._before(case, i, m, k, o - (m - self._margin), d), d
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
        line, k, mask = LOOKS * (i - 1) + 1, len(grid.speeds) - 1, int(ALL)
        words = self._earlier(case, i, m, k, offset - (m - self._margin)).words
        came = int(np.bitwise_or.reduce(words, axis=None)) << int(grid.shifts[line - 1, k, m]) & mask
        came &= int(self.free[line, 2 * offset - (m - self._margin), case])
        came = came << int(grid.shifts[line, k, m]) & mask & int(self.free[line + 1, 2 * offset, case])
        return (came & (2 << delay) - 1).bit_length() - 1


def _wait(slowest: Words, free: Words) -> None:
    """Let the slowest wait while their cell stays free, (M, B, C) and (B, C)."""
    if not slowest.any():
        return
    open_ = free.copy()
    for shift in WAITS:
        slowest |= open_ & (slowest << shift)
        open_ &= open_ << shift
