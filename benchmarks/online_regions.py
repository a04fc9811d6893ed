"""How often what is foretold of an obstacle holds: one observation, 1 s, 2 s and 4 s ahead, in families and recordings.

Predictions are those of `ObstacleTracks`, made at every observation. Their regions are judged twice, as they are and
scaled by what has come of earlier ones (`Regions`); the first half of the time only serves to learn. Two things are
counted: whether the truth is in its region, and whether what is seen of it is in the region and the sensor's noise
together, which is all that can be learnt from.
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
from scp_planner.estimation.conformal import AdaptiveScales, region_score, sized
from scp_planner.estimation.error_laws import NormalErrors
from scp_planner.estimation.track_files import Track
from scp_planner.estimation.tracks import Tracks
from scp_planner.online import sensor_frames
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.online.track import Seen
from scp_planner.settings.online import Regions
from scp_planner.simulation.worlds import Course, track_course

Array = np.ndarray

LEADS = (0.0, 1.0, 2.0, 4.0)  # s; 0: the next observation
LEVEL = 0.95
DRIVEN, BEFORE = 20.0, 10.0  # s of a run, and before the time that its family begins at
STEP = 0.1  # s between observations, at least
RECORDED_NOISE = 0.1  # m, added to recorded positions
LONGEST = 400.0  # s of a recording
PAUSE = 3.0  # s from one recorded scene to the next
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
    """

    number: int = 0
    held: int = 0
    met: int = 0
    area: float = 0.0


@dataclass(frozen=True)
class Foretold:
    """Predictions of one lead time, (n,) each, in the order in which what they are of is seen.

    Attributes
    ----------
    track : (n,) int
    made, due : (n,) s
        When, and of when.
    seen, truth : (n, 2) m
        By how much what was seen, and what was true, is off.
    covariance, noise : (n, 3) m2
        Of the prediction, not scaled, and of what is seen.
    """

    track: Array
    made: Array
    due: Array
    seen: Array
    truth: Array
    covariance: Array
    noise: Array

    @classmethod
    def of(cls, rows: Array) -> Foretold:
        """Sort rows of track, made, due, seen x, y, truth x, y, covariance xx, xy, yy, variance of the noise."""
        rows = rows[np.argsort(rows[:, 2], kind="stable")]
        noise = rows[:, 10:11] * np.array([1.0, 0.0, 1.0])
        return cls(rows[:, 0].astype(int), rows[:, 1], rows[:, 2], rows[:, 3:5], rows[:, 5:7], rows[:, 7:10], noise)


def predictions(
    courses: Mapping[str, Course], times: Array, seen: Mapping[str, Array], order: int, first: int = 0
) -> list[Array]:
    """Let obstacles be observed, and put down what comes of each prediction, for each lead time rows as in `Foretold`.

    Parameters
    ----------
    courses : mapping of str to Course
        The truth.
    times : (n,) array
        Of the observations, s, equally far apart.
    seen : mapping of str to (n, 2) array
        Observed positions, m; NaN where there is none.
    order : int
        Of the motions.
    first : int
        Number of the first track.
    """
    tracks = ObstacleTracks(sp.Confidence(probability=LEVEL, level="per_time"))
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
        for name in [name for name, track in tracks.tracks.items() if time - track.times[-1] > LOST * step]:
            tracks.remove(name)
        tracks.zones(float(time))
        for name, track in tracks.tracks.items():
            told, row = track.predicted, number_of[name]
            if told is None or not track.settled:
                continue
            for lead, more in enumerate(ahead):
                due = now + more
                if due < len(times) and there[row, due]:
                    center, covariance = told.at(float(times[due]))
                    offsets = places[row, due] - center, truth[row, due] - center
                    noise = track.noise_factor * online_noticing.NOISE**2
                    found = [first + row, time, times[due], *np.concatenate(offsets), *covariance, noise]
                    rows[lead].append(np.array(found))
                    later[lead].append((row, due))
    kept = [[used[where] for where in each] for each in later]  # what was left out as an outlier says nothing
    return [np.array(each).reshape(-1, 11)[np.array(keep, dtype=bool)] for each, keep in zip(rows, kept, strict=True)]


def judged(told: Foretold, regions: Regions, since: float) -> Counted:
    """Count how often predictions made from a time on, s, hold."""
    border = NormalErrors().pointwise_scale(1.0 - LEVEL)
    needed = region_score(told.seen, told.covariance, told.noise, border)
    truly = region_score(told.truth, told.covariance, np.zeros_like(told.noise), border)
    scales, due = AdaptiveScales(1.0 - LEVEL, 1), told.due
    given = np.ones(len(needed))
    if regions is Regions.ADAPTIVE:
        came = 0
        for number in np.argsort(told.made, kind="stable"):
            while due[came] <= told.made[number]:
                scales.take_in(0, str(told.track[came]), float(needed[came]))
                came += 1
            given[number] = scales.scales(str(told.track[number]))[0]
    late = told.made >= since
    xx, xy, yy = sized(told.covariance, given).T
    area = (border * np.sqrt(xx * yy - xy * xy))[late]
    held, met = (int((each <= given)[late].sum()) for each in (truly, needed))
    return Counted(int(late.sum()), held, met, float(area.sum()))


def of_family(family: str, count: int) -> list[Array]:
    """Predictions in so many runs of a family, one after the other."""
    every: list[list[Array]] = [[] for _ in LEADS]
    for seed in range(count):
        rng = np.random.default_rng([seed, 5])
        scenario = families.as_scenario(families.random_scenario("crossing10", rng, "coverage"))
        world = online_noticing.world_of(scenario, family, seed, 0.5 * DRIVEN)
        times = np.arange(-BEFORE, DRIVEN, STEP)
        noise, sensor = np.random.default_rng([seed, 13]), online_noticing.sensor_of(family)
        seen = {}
        for name, course in world.items():
            wild = noise.random(len(times)) < sensor.outliers
            size = online_noticing.NOISE * np.where(wild, online_noticing.OUTLIER_SIZE, sensor.factor)
            seen[name] = course(times) + size[:, None] * noise.standard_normal((len(times), 2))
        for lead, rows in enumerate(predictions(world, times, seen, 2, seed * len(world))):
            rows[:, 1:3] += seed * (BEFORE + DRIVEN + PAUSE)
            every[lead].append(rows)
    return [np.concatenate(each) for each in every]


def of_recording(tracks: Sequence[Track]) -> list[Array]:
    """Predictions of recorded motions."""
    some = [track for track in tracks if len(track) > 4]
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
    return predictions(courses, times, seen, 1)


def coverage(rows: Sequence[Array], regions: Regions) -> list[Counted]:
    """Coverage of predictions of each lead time, in the second half of the time."""
    made = np.concatenate([each[:, 1] for each in rows])
    middle = 0.5 * float(made.min() + made.max())
    return [judged(Foretold.of(each), regions, middle) for each in rows]


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
