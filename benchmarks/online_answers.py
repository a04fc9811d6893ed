"""How soon a change of acceleration is answered, beside how soon any test can know of it.

Obstacles that have been seen for long change their acceleration at once. Looks later it is counted of how many the zone
is another one, that is, by how many it is suspected or noticed; the same is counted of those that do not change it. The
best that any test can do with as many false answers is the test of Neyman and Pearson, which is told when the change
would have been, which way and how large.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

import scp_planner as sp
from benchmarks import online_noticing
from benchmarks.online_regions import BORDER, known
from scp_planner.prediction import sensor_frames
from scp_planner.prediction.track import Seen
from scp_planner.settings.online import Regions
from scp_planner.tracking.conformal import square_within

CHANGE = 0.5  # m/s2
BEFORE, AFTER = 100, 15  # looks
TOGETHER = 40  # obstacles
AHEAD = 1.0  # s


@dataclass(frozen=True)
class Answers:
    """So many looks after a change.

    Attributes
    ----------
    looks : int
    answered, false : float
        Share of those whose zones allow for a change; of those that changed, and of those that did not.
    best : float
        The most that any test can answer with as many false answers.
    held : float
        Share of regions of 95 % that hold where those that changed are a second later.
    """

    looks: int
    answered: float
    false: float
    best: float
    held: float


def best_power(looks: int, false: float, noise: float = online_noticing.NOISE) -> float:
    """Most that any test answers after so many looks with a share of false answers: Neyman and Pearson."""
    step = 1.0 / online_noticing.RATE
    signal = 0.5 * CHANGE * (np.arange(1, looks + 1) * step) ** 2 / noise
    return float(ndtr(math.sqrt(float(signal @ signal)) + ndtri(false))) if false > 0.0 else 0.0


def _answered(seed: int, change: float) -> tuple[np.ndarray, np.ndarray]:
    """Whether zones allow for a change, and hold a second later, each (looks, obstacles)."""
    rng = np.random.default_rng([seed, 17])
    tracks, names = known(Regions.MODEL), [f"o{number}" for number in range(TOGETHER)]
    for name in names:
        tracks.add_unseen(name, sp.Disc(disc=0.3), sp.Model(order=2), 0.0, online_noticing.NOISE**2 * np.eye(2))
    start, velocity = 10.0 * rng.normal(size=(TOGETHER, 2)), rng.normal(size=(TOGETHER, 2))
    angle, step = rng.uniform(0.0, 2.0 * math.pi, TOGETHER), 1.0 / online_noticing.RATE
    way = change * np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def truth(time: float) -> np.ndarray:
        return start + velocity * time + 0.5 * max(time, 0.0) ** 2 * way

    found = np.zeros((2, AFTER, TOGETHER), dtype=bool)
    for look in range(-BEFORE, AFTER + 1):
        time = look * step
        places = truth(time) + online_noticing.NOISE * rng.normal(size=(TOGETHER, 2))
        sensor_frames.take_in(tracks, names, [Seen(time, (x, y)) for x, y in places.tolist()])
        zones = tracks.zones(time)
        if look >= 1:
            later = np.array([time + AHEAD])
            offset = truth(time + AHEAD) - np.array([zone.center(later)[0] for zone in zones])
            spread = np.array([zone.covariance(later)[0][[0, 0, 1], [0, 1, 1]] for zone in zones]) / BORDER
            every = [tracks.tracks[name] for name in names]
            found[0, look - 1] = [track.alarmed or track.suspected for track in every]
            found[1, look - 1] = square_within(offset, spread) <= BORDER
    return found[0], found[1]


def answers(seeds: Sequence[int], looks: Sequence[int] = (3, 5, 8, 10, 12, 15)) -> list[Answers]:
    """What is answered so many looks after a change, from so many frames of obstacles."""
    changed, calm = ([_answered(seed, change) for seed in seeds] for change in (CHANGE, 0.0))
    rows = []
    for number in looks:
        share, held = (float(np.mean([one[part][number - 1] for one in changed])) for part in (0, 1))
        false = float(np.mean([one[0] for one in calm]))
        rows.append(Answers(number, share, false, best_power(number, false), held))
    return rows
