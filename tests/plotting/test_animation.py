"""Animations: that they play in real time and show what is."""

from __future__ import annotations

import math
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from figure_parts import Case
from matplotlib.image import imread
from PIL import Image

from scp_planner.plotting import animate, animate_plan
from scp_planner.plotting.animation import Film
from scp_planner.plotting.recording import record_plan
from scp_planner.plotting.style import style


def frames_of(film: Any) -> int:
    """Number of pictures of a film, which only some kinds of files have."""
    return int(film.n_frames)


def test_animation_of_several_pieces(pocket: Case, tmp_path: Path) -> None:
    animate_plan(*pocket, tmp_path / "pocket.gif", frames_per_second=1.0)
    with Image.open(tmp_path / "pocket.gif") as film:
        assert frames_of(film) == math.ceil(pocket[0].travel_time) + 1


def test_frames_name_the_obstacles(radar: Case) -> None:
    plan, scenario = radar
    with style():
        unnamed = record_plan(plan, scenario, 3)
        named = Film(unnamed).frame(1)
        nameless = replace(unnamed, obstacles=tuple(replace(one, id="") for one in unnamed.obstacles))
        assert (named != Film(nameless).frame(1)).any()


def test_gif_plays_in_real_time(radar: Case, tmp_path: Path) -> None:
    plan, scenario = radar
    path = tmp_path / "plan.gif"
    animate_plan(plan, scenario, path, frames_per_second=2.0)
    with Image.open(path) as film:
        frames = math.ceil(2.0 * plan.travel_time) + 1
        assert frames_of(film) == frames
        durations = []
        for index in range(frames):
            film.seek(index)
            durations.append(film.info["duration"])
    # Each frame is shown until the next; the last for a second more.
    assert sum(durations[:-1]) == pytest.approx(1000.0 * plan.travel_time, abs=10.0)
    assert durations[-1] > 1000
    assert list(tmp_path.iterdir()) == [path]


def test_frames_of_a_gif_are_those_of_the_film(radar: Case, tmp_path: Path) -> None:
    recording = record_plan(*radar, 3)
    animate(recording, tmp_path / "plan.gif")
    with style():
        film = Film(recording)
        drawn = [film.frame(index).astype(float) for index in range(3)]
    with Image.open(tmp_path / "plan.gif") as played:
        for index, frame in enumerate(drawn):
            played.seek(index)
            shown = np.asarray(played.convert("RGB")).astype(float)
            # The colours are those of a palette, so nearly the same everywhere.
            off = np.abs(shown - frame).max(axis=2)
            assert off.mean() < 1.0 and (off > 60.0).mean() < 1e-3
        assert np.abs(drawn[0] - drawn[2]).max() > 100.0


def test_film_of_a_closed_loop_shows_the_plan_of_each_cycle(radar: Case) -> None:
    """One path a cycle, as a closed loop has."""
    recording = record_plan(*radar, 4)
    straight = recording.paths[0] * [1.0, 0.0]
    loop = replace(recording, paths=(recording.paths[0], straight), path_index=np.array([0, 1, 1, 0]))
    with style():
        film, alone = Film(loop), Film(recording)
        same = [bool(np.array_equal(film.frame(i), alone.frame(i))) for i in range(4)]
    assert same == [True, False, False, True]


def test_video_without_ffmpeg_is_refused(radar: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ValueError, match=r"\.mp4 needs ffmpeg, which is not installed"):
        animate_plan(*radar, tmp_path / "plan.mp4")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg, which is not installed")
def test_video(radar: Case, tmp_path: Path) -> None:
    plan, scenario = radar
    path = tmp_path / "plan.mp4"
    animate_plan(plan, scenario, path, frames_per_second=5.0)
    ffmpeg = str(shutil.which("ffmpeg"))
    still = tmp_path / "still.png"
    command = [ffmpeg, "-loglevel", "error", "-ss", "1", "-i", str(path), "-frames:v", "1", str(still)]
    subprocess.run(command, check=True)
    height, width = imread(still).shape[:2]
    assert height % 2 == 0 and width == 720
    assert path.read_bytes()[4:8] == b"ftyp"
