"""How often what is predicted of an obstacle holds: an observation, 1, 2 and 4 s ahead, in families and recordings.

Predictions are the zones of `ObstacleTracks`, made at every observation, as `Regions` size them. What is learnt goes on
from run to run; the first half of the time only serves for that. Two things are counted: whether the truth is in its
region, and whether what is seen of it is in the region and the noise of the sensor together, which is all that can be
learnt from.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import scp_planner as sp
from benchmarks import common, families, online_crowds, online_noticing
from scp_planner.prediction import sensor_frames
from scp_planner.prediction.obstacle_tracks import ObstacleTracks
from scp_planner.prediction.track import Seen
from scp_planner.settings.online import Regions, SceneOnlineSettings
from scp_planner.simulation.worlds import Course, track_course
from scp_planner.tracking.confidence import NormalErrors
from scp_planner.tracking.conformal import square_within
from scp_planner.tracking.tracks import Track, Tracks

Array = np.ndarray

LEADS = (0.0, 1.0, 2.0, 4.0)  # s; 0: the next observation
LEVEL = 0.95
BORDER = NormalErrors().pointwise_scale(1.0 - LEVEL)
DRIVEN, BEFORE = 20.0, 10.0  # s of a run, and before the time that its family begins at
STEP = 0.1  # s between observations, at least
RECORDED_NOISE = 0.1  # m, added to recorded positions
LONGEST = 400.0  # s of a recording
PAUSE = 3.0  # s from one recorded scene to the next
SIGMAS = 1.96  # of bounds that hold with a probability of 95 %
LOST = 2.5  # steps after which one that is not seen has gone


@dataclass
class Counted:
    """Of one lead time: how many predictions, how many held, and the areas of their regions.

    Attributes
    ----------
    number, held, met : int
        Predictions; of these how many had the truth in their region, and how many what was seen of it in theirs.
    area : float
        Sum of the areas of their regions over pi, m2.
    low, high : float
        Between which the share that holds is, with a probability of 95 %, by how much obstacles differ; see `between`.
    """

    number: int = 0
    held: int = 0
    met: int = 0
    area: float = 0.0
    low: float = 0.0
    high: float = 1.0


def known(regions: Regions) -> ObstacleTracks:
    """What a planner knows of no obstacles yet."""
    return ObstacleTracks(
        sp.Confidence(probability=LEVEL, level="per_time"), settings=SceneOnlineSettings(regions=regions)
    )


def predictions(
    tracks: ObstacleTracks, courses: Mapping[str, Course], times: Array, seen: Mapping[str, Array], order: int
) -> list[Array]:
    """Let obstacles be observed, and put down what comes of each prediction.

    Parameters
    ----------
    tracks : ObstacleTracks
        What is known of others.
    courses : mapping of str to Course
        The truth.
    times : (n,) array
        Of the observations, s, equally far apart.
    seen : mapping of str to (n, 2) array
        Observed positions, m; NaN where there is none.
    order : int
        Of the motions.

    Returns
    -------
    list of (m, 10) arrays
        For each lead time: when a prediction was made, s; by how much what was seen and what was true is off, m; the
        covariance of the region, over the border, and the variance of the noise, m2; the number of the obstacle.
    """
    names, places, step = list(seen), np.array(list(seen.values())), float(np.median(np.diff(times)))
    there = ~np.isnan(places).any(axis=2)
    used = np.zeros_like(there)
    truth = np.array([courses[name](times) for name in names])
    number_of = {name: number for number, name in enumerate(names)}
    ahead = [max(1, round(lead / step)) for lead in LEADS]
    rows: list[list[Array]] = [[] for _ in LEADS]
    later: list[list[tuple[int, int]]] = [[] for _ in LEADS]
    for now, time in enumerate(times):
        some = np.flatnonzero(there[:, now])
        for k in some:
            if names[k] not in tracks.tracks:
                declared = online_noticing.NOISE**2 * np.eye(2)
                tracks.add_unseen(names[k], sp.Disc(disc=0.3), sp.Model(order=order), 0.0, declared)
        ones = [Seen(float(time), (float(places[k, now, 0]), float(places[k, now, 1]))) for k in some]
        said = sensor_frames.take_in(tracks, [names[k] for k in some], ones)
        used[[k for k, fault in zip(some, said, strict=True) if fault is None], now] = True
        for name in [name for name, track in tracks.tracks.items() if time - track.newest > LOST * step]:
            tracks.remove(name)
        for zone in tracks.zones(float(time)):
            track, row = tracks.tracks[zone.id], number_of[zone.id]
            if not track.settled:
                continue
            for lead, more in enumerate(ahead):
                due = now + more
                if due < len(times) and there[row, due]:
                    at = times[due : due + 1]
                    center, covariance = zone.center(at)[0], zone.covariance(at)[0][[0, 0, 1], [0, 1, 1]] / BORDER
                    offsets = places[row, due] - center, truth[row, due] - center
                    noise = track.noise_factor * online_noticing.NOISE**2
                    rows[lead].append(np.array([time, *np.concatenate(offsets), *covariance, noise, row]))
                    later[lead].append((row, due))
    kept = [[used[where] for where in each] for each in later]  # what was left out as an outlier says nothing
    return [np.array(each).reshape(-1, 10)[np.array(keep, dtype=bool)] for each, keep in zip(rows, kept, strict=True)]


def judged(rows: Array, since: float) -> Counted:
    """Count how often predictions made from a time on, s, hold."""
    late = rows[rows[:, 0] >= since]
    regions, noise = late[:, 5:8], late[:, 8:9] * np.array([1.0, 0.0, 1.0])
    held = square_within(late[:, 3:5], regions) <= BORDER
    met = square_within(late[:, 1:3], regions + noise) <= BORDER
    xx, xy, yy = regions.T
    area = BORDER * np.sqrt(xx * yy - xy * xy)
    low, high = between(held, late[:, 9])
    return Counted(len(late), int(held.sum()), int(met.sum()), float(area.sum()), low, high)


def between(held: Array, whose: Array) -> tuple[float, float]:
    """Bounds of a share, with a probability of 95 %, of what depends on what else is of the same obstacle.

    Wilson's, for as many independent predictions as would differ as much as obstacles do from each other (E. B. Wilson,
    J. Amer. Statist. Assoc. 22 (1927); L. Kish, *Survey Sampling*, Wiley (1965)); where all hold, one of each obstacle.

    Parameters
    ----------
    held : (n,) bool
    whose : (n,)
        Of which obstacle each is.

    Returns
    -------
    tuple of float
    """
    names, number = np.unique(whose, return_inverse=True)
    each, share, count = np.bincount(number), float(held.mean()), len(names)
    off = np.bincount(number, held - share)
    variance = float(off @ off) / len(held) ** 2 * count / max(count - 1, 1)
    size = share * (1.0 - share) / variance if variance > 0.0 else float(len(each))
    middle, root = share + 0.5 * SIGMAS**2 / size, math.sqrt(share * (1.0 - share) / size + (0.5 * SIGMAS / size) ** 2)
    low, high = (max(0.0, min((middle + way * SIGMAS * root) / (1.0 + SIGMAS**2 / size), 1.0)) for way in (-1.0, 1.0))
    return low, high


def of_family(family: str, count: int, regions: Regions, first: int = 0) -> list[Array]:
    """Predictions in so many runs of a family, one after the other."""
    tracks = known(regions)
    every: list[list[Array]] = [[] for _ in LEADS]
    for number, seed in enumerate(range(first, first + count)):
        rng = np.random.default_rng([seed, 5])
        scenario = families.as_scenario(families.random_scenario("crossing10", rng, "coverage"))
        world = online_noticing.world_of(scenario, family, seed, 0.5 * DRIVEN)
        begin = number * (BEFORE + DRIVEN + PAUSE)
        times = np.arange(-BEFORE, DRIVEN, STEP)
        noise, sensor = np.random.default_rng([seed, 13]), online_noticing.sensor_of(family)
        seen, courses = {}, {}
        for name, course in world.items():
            wild = noise.random(len(times)) < sensor.outliers
            size = online_noticing.NOISE * np.where(wild, online_noticing.OUTLIER_SIZE, sensor.factor)
            own = f"{seed}/{name}"
            seen[own] = course(times) + size[:, None] * noise.standard_normal((len(times), 2))
            courses[own] = _delayed(course, begin)
        for lead, rows in enumerate(predictions(tracks, courses, begin + times, seen, 2)):
            rows[:, 9] += number * len(world)
            every[lead].append(rows)
    return [np.concatenate(each) for each in every]


def _delayed(course: Course, delay: float) -> Course:
    return lambda times: course(np.asarray(times) - delay)


def of_recording(recorded: Sequence[Track], regions: Regions) -> list[Array]:
    """Predictions of recorded motions."""
    some = [track for track in recorded if len(track) > 4]
    step = max(float(np.median(np.concatenate([np.diff(track.times) for track in some]))), STEP)
    begin, end = min(float(track.times[0]) for track in some), max(float(track.times[-1]) for track in some)
    end = min(end, begin + LONGEST)
    times = np.arange(begin, end, step)
    courses = {track.id: track_course(track) for track in some if track.times[0] < end}
    noise = np.random.default_rng(3)
    seen = {
        name: course(times) + RECORDED_NOISE * noise.standard_normal((len(times), 2))
        for name, course in courses.items()
    }
    return predictions(known(regions), courses, times, seen, 1)


def coverage(rows: Sequence[Array]) -> list[Counted]:
    """Coverage of predictions of each lead time, in the second half of the time."""
    made = np.concatenate([each[:, 0] for each in rows])
    middle = 0.5 * float(made.min() + made.max())
    return [judged(each, middle) for each in rows]


def recordings(folder: str | os.PathLike[str] | None) -> dict[str, Sequence[Track]]:
    """The recorded motions: people of three places, cyclists, and people and cars together."""
    places: dict[str, Sequence[Track]] = dict(online_crowds.recordings(folder))
    root = Path(folder or os.environ[common.DATA_VARIABLE])
    cyclists = sorted((root / "cyclists").glob("*/*.csv"))
    mixed = sorted((root / "mixed_traffic").glob("*.csv"))
    if not cyclists or not mixed:
        raise common.MissingDataError(f"no recorded motions: there is nothing in {root / 'cyclists'}, or mixed_traffic")
    np.random.default_rng(0).shuffle(cyclists)  # those who start and those who stop are in folders of their own
    places["cyclists"] = _one_after_the_other([[file] for file in cyclists], PAUSE)
    scenes = sorted({file.name.rsplit("_traj", 1)[0] for file in mixed})
    places["mixed traffic"] = _one_after_the_other([[f for f in mixed if f.name.startswith(one)] for one in scenes])
    return places


def _one_after_the_other(scenes: Sequence[Sequence[Path]], every: float = math.inf) -> list[Track]:
    """Tracks of scenes, each of several files, on one clock: the next begins after the last, or after so many s."""
    moved, begin = [], 0.0
    for number, files in enumerate(scenes):
        some = [(file.stem, track) for file in files for track in Tracks.load(file)]
        first = min(float(track.times[0]) for _, track in some)
        last = max(float(track.times[-1]) for _, track in some)
        moved += [Track(f"{number}/{name}/{t.id}", t.times - first + begin, t.positions) for name, t in some]
        begin += min(PAUSE + last - first, every)
    return moved
