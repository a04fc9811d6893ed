"""Forward sweep over the grid, station by station, and the fastest ways back from the goal."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from scp_planner.arrays import Index
from scp_planner.pauses import pause
from scp_planner.search.grid import DELAYS, EACH_STATION, Grid, Words

WORD_BYTES = DELAYS // 8
FIRST_DELAYS = np.array([2**count - 1 for count in range(DELAYS + 1)], dtype="<u8")[:, None].view(np.uint8)


@dataclass(frozen=True)
class SweepChunks:
    """Work that is done at a time, and kept."""

    stretch: int = 64  # stations whose cells are made into integers together
    look_each: int = 16  # stations: at the clock
    most_kept: float = 1e8  # bytes, were all classes reached everywhere, beyond which it is not kept of all stations


CHUNKS = SweepChunks()
WAITS = tuple(2**power for power in range(6))  # doubled, they reach all delays of a word

Counts = NDArray[np.uint8]

Reached = list[dict[int, int]]
"""Reached offsets and delays, as bits, for each class of speed and slope."""


@dataclass(frozen=True)
class WayEnds:
    """Start and end of ways."""

    first_slopes: slice  # Slopes before the start and at the goal
    last_slopes: slice  # Slopes before the start and at the goal
    goal: Words  # (O,)


@dataclass(frozen=True)
class States:
    """States on the way, one a station."""

    slope: Index  # (n + 1,) Classes and cells; slope and speed are those of the leg that ends at the station
    speed: Index  # (n + 1,) Classes and cells; slope and speed are those of the leg that ends at the station
    offset: Index  # (n + 1,) Classes and cells; slope and speed are those of the leg that ends at the station
    delay: Index  # (n + 1,) Classes and cells; slope and speed are those of the leg that ends at the station
    waited: Index  # (n,) Delays for which the vehicle waits at each station but the first


@dataclass(frozen=True)
class Begun:
    """Cells that a sweep has reached up to a station, from which another one with the same cells goes on."""

    sweep: Sweep
    station: int

    @property
    def reached(self) -> list[Reached | None]:
        """Reached cells at each station so far."""
        last = min(self.station, len(self.sweep.reached) - 1)
        return [*self.sweep.reached[:last], self.sweep.at(last)]


class Layout:
    """Words of delays as one integer: offset after offset, the lowest first, and case after case."""

    def __init__(self, first: int, size: int, beside: int, cases: int, delays: int) -> None:
        self.first, self.size, self.cases = first, size, cases
        self._bytes = max(1, ceil(delays / 8))
        self.length = 8 * self._bytes
        self.word = (1 << self.length) - 1
        self._room = size + beside
        self.offsets = _repeated(1, self.length, size)
        every = _repeated(1, self.length, self._room * cases)
        self.early = [every * (self.word >> delays) for delays in range(self.length)]
        self.bytes = self._bytes * self._room * cases

    def bit(self, offset: int, delay: int, case: int) -> int:
        """The number of a bit."""
        return (case * self._room + offset - self.first) * self.length + delay

    def of_cases(self, words: Words) -> list[int]:
        """Integers of rows of words that differ from case to case, (rows, O, C)."""
        rows, size, cases = words.shape
        some = words.transpose(0, 2, 1).astype("<u8", order="C")
        return self._of_bytes(some.view(np.uint8).reshape(rows, cases, size, WORD_BYTES))

    def of_each(self, words: Words) -> list[int]:
        """Integers of rows of words that are the same in all cases, (rows, O)."""
        size = words.shape[1]
        return self._of_bytes(
            words.astype("<u8", order="C").view(np.uint8).reshape(-1, 1, size, WORD_BYTES), self.cases
        )

    def of_counts(self, counts: Counts) -> list[int]:
        """Integers of rows of words whose first so many delays are set, the same in all cases, (rows, O)."""
        return self._of_bytes(FIRST_DELAYS[counts[:, None], : self._bytes], self.cases)

    def _of_bytes(self, words: NDArray[np.uint8], times: int = 1) -> list[int]:
        """Integers of rows of words byte by byte, (rows, C, O, 8 or fewer), each repeated so many times."""
        rows, cases, size, _ = words.shape
        room = np.zeros((rows, cases, self._room, self._bytes), dtype=np.uint8)
        room[:, :, :size] = words[..., : self._bytes]
        data, length = room.tobytes(), cases * self._room * self._bytes
        return [int.from_bytes(data[k : k + length] * times, "little") for k in range(0, len(data), length)]

    def words(self, bits: int) -> Words:
        """The words of an integer, (C, O)."""
        data = bits.to_bytes(self.cases * self._room * self._bytes, "little")
        found = np.zeros((self.cases, self.size, WORD_BYTES), dtype=np.uint8)
        found[..., : self._bytes] = np.frombuffer(data, dtype=np.uint8).reshape(self.cases, self._room, -1)[
            :, : self.size
        ]
        words: Words = found.view("<u8")[..., 0].astype(np.uint64, copy=False)
        return words


def _repeated(bits: int, length: int, count: int) -> int:
    """Bits repeated so many times, so far apart."""
    return bits * (((1 << length * count) - 1) // ((1 << length) - 1))


class _Leaving:
    """Cells left from a station after changes of speed and slope; classes of speed are asked for in order."""

    def __init__(self, grid: Grid, before: Reached) -> None:
        self._grid, self._before = grid, before
        self._driven: dict[int, int] = {}
        self._speeds = range(0)
        self._turns = 0
        self._left: dict[int, int] = {}

    def left(self, k: int) -> dict[int, int]:
        grid, speeds, turns = self._grid, self._grid.speeds_before[k], self._grid.turn_counts[k]
        if speeds == self._speeds and turns == self._turns:
            return self._left
        further = range(self._speeds.stop, speeds.stop)
        if speeds.start != self._speeds.start or not self._speeds:
            self._driven, further = {}, speeds
        driven = self._driven
        for speed in further:
            for m, bits in self._before[speed].items():
                driven[m] = driven[m] | bits if m in driven else bits
        left: dict[int, int] = {}
        near = grid.slopes_near[k]
        for m, bits in driven.items():
            for other in near[m]:
                left[other] = left[other] | bits if other in left else bits
        self._speeds, self._turns, self._left = speeds, turns, left
        return left


class Sweep:
    """One sweep over the stations."""

    def __init__(
        self,
        grid: Grid,
        free: Words,
        ends: WayEnds,
        in_time: Counts,
        deadline: float = np.inf,
        begun: Begun | None = None,
    ) -> None:
        self.grid, self.free, self.in_time = grid, free, in_time
        looked_at = np.append(np.flatnonzero(in_time.any(axis=(0, 1))), grid.middle)
        first, last = int(looked_at.min()), int(looked_at.max())
        beside = max(map(abs, grid.sidestep_counts))
        # A delay is never made up for: one that is too long at the goal is too long everywhere.
        self.layout = Layout(first, last + 1 - first, beside, free.shape[2], int(in_time[-1].max()))
        self._sides = grid.sidestep_counts
        self._aside = [self.layout.length * side for side in self._sides]
        self._loaded = range(0)
        classes = len(grid.speeds) * len(grid.slopes)
        self._thin = classes * grid.columns * self.layout.bytes > CHUNKS.most_kept
        self.reached: list[Reached | None] = [self._first(ends)] if begun is None else begun.reached
        self.arrivals: Reached = [{} for _ in grid.speeds]
        self.cut_off = False
        before = self.reached[-1]
        assert before is not None, "the last one is kept"
        for i in range(len(self.reached), grid.columns + 1):
            before = self._advanced(i, before)
            if i % CHUNKS.look_each == 0:
                pause()
                self.cut_off = perf_counter() > deadline
            if self.cut_off or not any(before):
                return
            self.reached.append(before)
            if self._thin and (i - 1) % CHUNKS.stretch:
                self.reached[i - 1] = None
        goal = self.layout.of_each(ends.goal[None, first : last + 1])[0]
        at_last = set(range(len(grid.slopes))[ends.last_slopes])
        self.arrivals = [
            {m: bits & goal for m, bits in some.items() if m in at_last and bits & goal} for some in before
        ]

    def _first(self, ends: WayEnds) -> Reached:
        grid, start = self.grid, 0
        for case in range(self.layout.cases):
            start |= 1 << self.layout.bit(grid.middle, 0, case)
        slopes, speeds = range(len(grid.slopes))[ends.first_slopes], range(len(grid.speeds))
        return [dict.fromkeys(slopes, start) if k in speeds[grid.first_speeds] else {} for k in speeds]

    def _load(self, begin: int) -> None:
        """Take the cells of some stations as integers: free at stations, and halfway at whole and at half offsets."""
        layout, free = self.layout, self.free
        end = min(begin + CHUNKS.stretch, self.grid.columns + 1)
        self._loaded = range(begin, end)
        first, last = layout.first, layout.first + layout.size
        at = slice(EACH_STATION * begin, EACH_STATION * end - 1, EACH_STATION)
        self._free = layout.of_cases(free[at, 2 * first : 2 * last - 1 : 2])
        between = free[EACH_STATION * begin - 1 : EACH_STATION * end - 2 : EACH_STATION, 2 * first : 2 * last - 1]
        self._even = layout.of_cases(between[:, ::2])
        self._odd = layout.of_cases(between[:, 1::2])
        speeds = len(self.grid.speeds)
        timely = layout.of_counts(self.in_time[begin:end, :, first:last].reshape(-1, layout.size))
        self._timely = [timely[row : row + speeds] for row in range(0, len(timely), speeds)]

    def at(self, i: int) -> Reached:
        """Reached cells at a station."""
        found = self.reached[i]
        if found is None:
            begin = i - i % CHUNKS.stretch
            end = min(begin + CHUNKS.stretch, len(self.reached))
            for later in range(end + 1, min(end + CHUNKS.stretch, len(self.reached) - 1)):
                self.reached[later] = None
            for j in range(begin + 1, end):
                before = self.reached[j - 1]
                assert before is not None, "one is kept before each stretch"
                self.reached[j] = self._advanced(j, before)
            found = self.reached[i]
        assert found is not None, "it was found again"
        return found

    def _advanced(self, i: int, before: Reached) -> Reached:
        """Reached cells at the next station."""
        grid, layout = self.grid, self.layout
        if i not in self._loaded:
            self._load(i - (i - 1) % CHUNKS.stretch)
        place = i - self._loaded.start
        line = EACH_STATION * (i - 1)
        free, early, aside, length = self._free[place], layout.early, self._aside, layout.length
        halfway: dict[int, int] = {}
        reached: Reached = []
        leaving = _Leaving(grid, before)
        for k, timely in enumerate(self._timely[place]):
            here: dict[int, int] = {}
            reached.append(here)
            open_ = timely & free
            if not open_:
                continue
            first, second = grid.shift_lists[line][k], grid.shift_lists[line + 1][k]
            for m, left in leaving.left(k).items():
                delays, more = first[m], second[m]
                later = delays + more
                if later >= length or not (bits := left & early[later] if later else left):
                    continue
                if m not in halfway:
                    halfway[m] = self._halfway(place, m)
                by = aside[m] + delays
                bits = ((bits << by if by >= 0 else bits >> -by) & halfway[m]) << more & open_
                if bits:
                    here[m] = bits
        if reached[-1]:
            self._wait(reached[-1], open_)
        return reached

    def _halfway(self, place: int, m: int) -> int:
        """Free cells halfway to each offset with a slope."""
        whole, half = divmod(self._sides[m], 2)
        cells = self._odd[place] if half else self._even[place]
        by = self.layout.length * (whole + half)
        return cells << by if by >= 0 else cells >> -by

    def _wait(self, slowest: dict[int, int], open_: int) -> None:
        """Let the slowest wait while their cell stays free."""
        for delays in WAITS:
            if delays >= self.layout.length:
                break
            early = self.layout.early[delays]
            for m, bits in slowest.items():
                slowest[m] = bits | (bits & early) << delays & open_
            open_ &= (open_ & early) << delays

    def first_arrival(self, case: int = 0) -> int | None:
        """The least delay at the goal in a case; None if it is not reached."""
        found = 0
        for some in self.arrivals:
            for bits in some.values():
                found |= bits
        word = int(np.bitwise_or.reduce(self.layout.words(found)[case]))
        return None if word == 0 else (word & -word).bit_length() - 1

    def trace(self, delay: int, case: int = 0) -> States:
        """Follow a way back from the goal that arrives with a delay, as straight and as fast as there is one."""
        grid, count = self.grid, self.grid.columns
        states = np.zeros((count + 1, 5), dtype=np.intp)
        k, m, o = min(self._arriving(delay, case), key=self._detour)
        d = delay
        for i in range(count, 0, -1):
            came = self._came(case, i, m, o, d) if k == len(grid.speeds) - 1 else d
            states[i] = k, m, o, d, d - came
            d = came - grid.shift_lists[EACH_STATION * i - 2][k][m] - grid.shift_lists[EACH_STATION * i - 1][k][m]
            o -= self._sides[m]
            k, m = self._before(i, m, k, self.layout.bit(o, d, case))
        states[0] = k, m, o, d, 0
        return States(states[:, 1], states[:, 0], states[:, 2], states[:, 3], states[1:, 4])

    def _arriving(self, delay: int, case: int) -> Iterator[tuple[int, int, int]]:
        """Classes of speed and slope, and offsets, with which the goal is reached."""
        layout = self.layout
        first = layout.bit(layout.first, delay, case)
        for k, some in enumerate(self.arrivals):
            for m in sorted(some):
                bits = some[m] >> first & layout.offsets
                while bits:
                    least = bits & -bits
                    yield k, m, layout.first + (least.bit_length() - 1) // layout.length
                    bits ^= least

    def _detour(self, state: tuple[int, int, int]) -> int:
        """Cost of a state: slowness, slope and distance from the guide."""
        speed, slope, offset = state
        return speed + abs(self._sides[slope]) + abs(offset - self.grid.middle)

    def _before(self, i: int, m: int, k: int, bit: int) -> tuple[int, int]:
        """Speed and slope at the station before, with the least change."""
        turns, before, possible = self.grid.turn_counts[k], self.at(i - 1), []
        for speed in self.grid.speeds_before[k]:
            for slope, bits in before[speed].items():
                if -turns <= slope - m <= turns and bits >> bit & 1:
                    possible.append((2 * abs(slope - m) + abs(speed - k), speed, slope))
        _, speed, slope = min(possible)
        return speed, slope

    def _came(self, case: int, i: int, m: int, offset: int, delay: int) -> int:
        """The delay at which the slowest came to a station where they then waited until another."""
        grid, k, side = self.grid, len(self.grid.speeds) - 1, self._sides[m]
        line = EACH_STATION * (i - 1) + 1
        left, turns, before = 0, grid.turn_counts[k], self.at(i - 1)
        for speed in self.grid.speeds_before[k]:
            for slope, bits in before[speed].items():
                if -turns <= slope - m <= turns:
                    left |= bits
        came = left >> self.layout.bit(offset - side, 0, case) & self.layout.word
        came = came << grid.shift_lists[line - 1][k][m] & int(self.free[line, 2 * offset - side, case])
        came = came << grid.shift_lists[line][k][m] & int(self.free[line + 1, 2 * offset, case])
        came &= (1 << int(self.in_time[i, k, offset])) - 1
        return (came & (2 << delay) - 1).bit_length() - 1
