"""Recorded motions: people of three places, cyclists, people and cars on a campus."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks import common, online_crowds
from benchmarks.prediction.motion import Array, Family, Motion
from scp_planner.tracking.tracks import Tracks

LEAST = 5.0  # s of a motion that counts
LONGEST = 60.0  # s of a scene
STEP = 0.1  # s
PLACES = ("people", "cyclists", "mixed: people", "mixed: cars")


def make(name: str, count: int, folder: str | os.PathLike[str] | None = None) -> Family:
    """Return a family of about ``count`` recorded motions, each with those that were there at the same time."""
    root = Path(folder or os.environ.get(common.DATA_VARIABLE, ""))
    if name == "people":
        places = online_crowds.recordings(folder).values()
        scenes = [
            scene for tracks in places for scene in _windows([(t.times, t.positions) for t in tracks], "pedestrian")
        ]
    elif name == "cyclists":
        files = sorted((root / "cyclists").glob("*/*.csv"))
        scenes = [_moved([(t.times, t.positions) for t in Tracks.load(file)], "cyclist") for file in files]
    else:
        kind, model = ("ped", "pedestrian") if name.endswith("people") else ("veh", "car")
        files = sorted((root / "mixed_traffic").glob(f"*{kind}*.csv"))
        scenes = [
            scene for file in files for scene in _windows([(t.times, t.positions) for t in Tracks.load(file)], model)
        ]
    scenes = [scene for scene in scenes if scene]
    if not scenes:
        raise common.MissingDataError(
            f"no recorded motions of {name}: set {common.DATA_VARIABLE} or give --tracks FOLDER"
        )
    order = np.random.default_rng(0).permutation(len(scenes))
    found: list[Sequence[Motion]] = []
    for k in order:
        if sum(len(scene) for scene in found) >= count:
            break
        found.append(scenes[k])
    return Family(name, found)


def _windows(tracks: Sequence[tuple[Array, Array]], model: str) -> list[list[Motion]]:
    """Cut recordings into windows of ``LONGEST``; a motion belongs to the window that it begins in."""
    begin = min(float(times[0]) for times, _ in tracks)
    windows: dict[int, list[tuple[Array, Array]]] = {}
    for times, positions in tracks:
        windows.setdefault(math.floor((times[0] - begin) / LONGEST), []).append((times, positions))
    return [_moved(each, model) for each in windows.values()]


def _moved(tracks: Sequence[tuple[Array, Array]], model: str) -> list[Motion]:
    """Motions on a clock that begins with the first one, interpolated where they were recorded coarsely."""
    begin = min(float(times[0]) for times, _ in tracks)
    found = []
    for given, positions in tracks:
        keep = np.concatenate([[True], np.diff(given) > 0.0])
        times = given[keep] - begin
        if times[-1] - times[0] < LEAST or len(times) < 5:
            continue
        fine = np.arange(times[0], times[-1], STEP)
        places = CubicSpline(times, positions[keep])(fine)
        if np.median(np.diff(times)) < STEP:
            places = np.stack([np.interp(fine, times, positions[keep, k]) for k in (0, 1)], axis=1)
        found.append(Motion(fine, places, np.array([]), model))
    return found
