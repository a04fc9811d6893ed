"""Observations of many obstacles that are taken in together, as a sensor gives them: a frame."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from scp_planner.prediction.obstacle_tracks import ObstacleTracks
from scp_planner.prediction.track import ObstacleTrack, Seen, slots_of
from scp_planner.tracking.noticing import Bank
from scp_planner.tracking.predictions import misfits


def take_in(obstacles: ObstacleTracks, names: Sequence[str], seen: Sequence[Seen]) -> list[str | None]:
    """Take in one observation each of different obstacles."""
    tracks = [obstacles.tracks[name] for name in names]
    banks = [_bank_of(track, one) for track, one in zip(tracks, seen, strict=True)]
    alone = [number for number, bank in enumerate(banks) if bank is None]
    for bank in dict.fromkeys(banks):
        if bank is not None:
            some = [number for number, one in enumerate(banks) if one is bank]
            left = _left_by(obstacles, bank, [tracks[number] for number in some], [seen[number] for number in some])
            alone += [some[k] for k in left]
    said: list[str | None] = [None] * len(names)
    for number in sorted(alone):
        one = seen[number]
        said[number] = obstacles.observe(names[number], one.time, one.position, one.covariance)
    return said


def _bank_of(track: ObstacleTrack, one: Seen) -> Bank | None:
    """The bank that takes in what is seen of a track, if its motion is not given, none is suspect, and it is newer."""
    estimator = track.estimator
    if estimator is None or track.fixed is not None or track.given is not None or track.suspects:
        return None
    history = track.history
    return estimator.bank if history and one.time > history[-1].time else None


def _left_by(obstacles: ObstacleTracks, bank: Bank, tracks: Sequence[ObstacleTrack], seen: Sequence[Seen]) -> list[int]:
    """Let a bank take in all that it can of what is seen of its tracks; return the numbers of the others."""
    slots = slots_of(tracks)
    times = np.array([one.time for one in seen])
    positions = np.array([one.position for one in seen])
    gate = obstacles.settings.gate_probability
    usual = bank.is_declared(slots, [one.covariance for one in seen])
    if gate > 0.0:
        squares = misfits([track.predicted for track in tracks], times, positions, bank.noise_of(slots))
        usual &= squares <= -2.0 * math.log(gate)
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
