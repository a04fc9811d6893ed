"""Obstacles that have just changed their velocity, and so are likely to change it again."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array


@dataclass(frozen=True)
class _Looked:
    """Velocities of obstacles at a time, s: rows of (L, 2), m/s, by their ids, and since when each has been known."""

    time: float
    velocities: Array
    rows: dict[str, int]
    since: Array


class Unrest:
    """Remembers velocities of obstacles for a while."""

    def __init__(self, lasts: float) -> None:
        self._lasts = lasts
        self._looks = deque[_Looked]()

    def note(self, time: float, ids: Sequence[str], velocities: Array) -> Array:
        """Take note of velocities; return how each has changed within that time, (L, 2) m/s: the largest change."""
        while self._looks and self._looks[-1].time >= time:
            self._looks.pop()
        while self._looks and self._looks[0].time < time - self._lasts:
            self._looks.popleft()
        since = np.full(len(ids), time)
        if self._looks:
            last = self._looks[-1]
            row = np.array([last.rows.get(name, -1) for name in ids], dtype=np.intp)
            since = np.where(row >= 0, np.append(last.since, time)[row], time)
        self._looks.append(_Looked(time, velocities, {name: k for k, name in enumerate(ids)}, since))
        return self._changes()

    def _changes(self) -> Array:
        now = self._looks[-1]
        most = np.zeros((len(now.velocities), 2))
        ids = tuple(now.rows)
        for before in tuple(self._looks)[:-1]:
            row = np.array([before.rows.get(name, -1) for name in ids], dtype=np.intp)
            there = np.flatnonzero(row >= 0)
            there = there[before.time > now.since[there]]
            change = now.velocities[there] - before.velocities[row[there]]
            larger = np.hypot(*change.T) > np.hypot(*most[there].T)
            most[there[larger]] = change[larger]
        return most
