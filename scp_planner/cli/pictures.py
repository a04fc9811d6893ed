"""Pictures that commands write: what a suffix asks for, and whether it can be had."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path
from typing import Annotated

import typer

from scp_planner.cli.options import bad_option, check_target
from scp_planner.settings.pictures import FIGURE_SUFFIXES, FILM_SUFFIXES, PAGE_SUFFIXES, PICTURE_SUFFIXES, View

MOVING_SUFFIXES = (*FILM_SUFFIXES, *PAGE_SUFFIXES)


PictureView = Annotated[
    View,
    typer.Option(
        "--view",
        help="What the figure of --plot shows: map and profiles; space-time: which part of the way is taken when, and"
        " so why the vehicle waits; or profiles alone.",
    ),
]


def can_plot() -> bool:
    """True if matplotlib is there."""
    return importlib.util.find_spec("matplotlib") is not None


def check_picture(
    option: str,
    target: Path | None,
    source: str = "",
    suffixes: tuple[str, ...] = PICTURE_SUFFIXES,
    view: View = View.MAP,
) -> None:
    """Refuse before planning a picture that could not be drawn after it."""
    if target is None:
        if view is not View.MAP:
            raise bad_option("--view", view, f"needs {option}")
        return
    suffix = target.suffix.lower()
    if suffix not in suffixes:
        raise bad_option(option, target, f"must end in one of {', '.join(suffixes)}")
    if suffix not in PAGE_SUFFIXES and not can_plot():
        raise bad_option(option, target, "needs matplotlib: pip install 'scp-planner[plot]'")
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise bad_option(option, target, "needs ffmpeg, which is not installed; .gif does without")
    if view is not View.MAP and suffix not in FIGURE_SUFFIXES:
        raise bad_option("--view", view, f"is a figure: {option} must end in one of {', '.join(FIGURE_SUFFIXES)}")
    check_target(option, target, source)
