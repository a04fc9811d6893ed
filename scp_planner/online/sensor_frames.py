"""Observations of many obstacles that are taken in together, as a sensor gives them: a frame.

Where nothing is odd about an observation - its obstacle follows a motion that is noticed about, it is the newest, its
noise is the one that is known, and it is no outlier - it goes with all others of its kind into the bank at once
(`scp_planner.online.noticing`). All others are taken in one by one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain

import numpy as np

from scp_planner.online.noticing import Bank
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.online.track import ObstacleTrack, Seen


def take_in(obstacles: ObstacleTracks, names: Sequence[str], seen: Sequence[Seen]) -> list[str | None]:
    """Take in one observation each of different obstacles.

    Parameters
    ----------
    obstacles : ObstacleTracks
        That know all of them.
    names : sequence of str
        Ids of the obstacles, each at most once.
    seen : sequence of Seen
        One of each.

    Returns
    -------
    list of str or None
        What is wrong with each, if it was not used.
    """
    tracks = list(map(obstacles.tracks.__getitem__, names))
    alone: list[int] = []
    kinds: dict[Bank, list[int]] = {}
    last, numbers = None, list[int]()
    for number, (track, one) in enumerate(zip(tracks, seen, strict=True)):
        estimator = track.estimator
        if estimator is None or estimator.bank is None or track.in_doubt or one.time <= track.times[-1]:
            alone.append(number)
            continue
        if estimator.bank is not last:
            last = estimator.bank
            numbers = kinds.setdefault(last, [])
        numbers.append(number)
    for bank, numbers in kinds.items():
        if len(numbers) < len(tracks):
            some, ones = [tracks[number] for number in numbers], [seen[number] for number in numbers]
            alone += [numbers[k] for k in _left_by(obstacles, bank, some, ones)]
        else:
            alone = _left_by(obstacles, bank, tracks, seen)
    said: list[str | None] = [None] * len(names)
    for number in sorted(alone):
        one = seen[number]
        said[number] = obstacles.observe(names[number], one.time, one.position, one.covariance)
    return said


def _left_by(obstacles: ObstacleTracks, bank: Bank, tracks: Sequence[ObstacleTrack], seen: Sequence[Seen]) -> list[int]:
    """Let a bank take in all that it can of what is seen of its tracks; return the numbers of the others."""
    slots = np.array([track.estimator.slot for track in tracks if track.estimator is not None], dtype=np.intp)
    times = np.array([one.time for one in seen])
    positions = np.fromiter(chain.from_iterable([one.position for one in seen]), float, 2 * len(seen)).reshape(-1, 2)
    gate = obstacles.watch.gate_probability
    usual = bank.is_declared(slots, [one.covariance for one in seen])
    if gate > 0.0:
        usual &= bank.misfits(slots, times, positions) <= -2.0 * math.log(gate)
    left: list[int] = np.flatnonzero(~usual).tolist()
    if left:
        some = np.flatnonzero(usual).tolist()
        tracks, seen = [tracks[k] for k in some], [seen[k] for k in some]
        slots, times, positions = slots[some], times[some], positions[some]
    obstacles.remember(tracks, seen)
    by_slot = np.argsort(slots)  # neighbours are looked at where they are
    bank.update(slots[by_slot], times[by_slot], positions[by_slot])
    obstacles.judge_noise(bank.differences(slots))
    return left
