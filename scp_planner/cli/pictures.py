"""Pictures that commands write: what a suffix asks for, and whether it can be had."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from scp_planner.cli.options import bad_option, check_target

if TYPE_CHECKING:
    from scp_planner.plan import Plan
    from scp_planner.run import Run
    from scp_planner.scenario import Scenario

PAGE_SUFFIX = ".html"
FILM_SUFFIXES = (".gif", ".mp4")
FIGURE_SUFFIXES = (".pdf", ".png", ".svg")
MOVING_SUFFIXES = (*FILM_SUFFIXES, PAGE_SUFFIX)
PICTURE_SUFFIXES = (*FIGURE_SUFFIXES, *MOVING_SUFFIXES)


def can_plot() -> bool:
    """Whether matplotlib is there."""
    return importlib.util.find_spec("matplotlib") is not None


def check_picture(
    option: str, target: Path | None, source: str = "", suffixes: tuple[str, ...] = PICTURE_SUFFIXES
) -> None:
    """Refuse before planning a picture that could not be drawn after it."""
    if target is None:
        return
    suffix = target.suffix.lower()
    if suffix not in suffixes:
        raise bad_option(option, target, f"must end in one of {', '.join(suffixes)}")
    if suffix != PAGE_SUFFIX and not can_plot():
        raise bad_option(option, target, "needs matplotlib: pip install 'scp-planner[plot]'")
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise bad_option(option, target, "needs ffmpeg, which is not installed; .gif does without")
    check_target(option, target, source)


def draw(plan: Plan, scenario: Scenario, path: Path) -> None:
    """Draw a plan as the file's suffix says: a page for a browser, an animation or a figure."""
    suffix = path.suffix.lower()
    if suffix == PAGE_SUFFIX:
        from scp_planner.viewer import save_viewer

        save_viewer(plan, scenario, path)
    elif suffix in FILM_SUFFIXES:
        from scp_planner.plotting import animate_plan

        animate_plan(plan, scenario, path)
    else:
        from scp_planner.plotting import plot_plan

        plot_plan(plan, scenario, path)


def animate_run(run: Run, path: Path) -> None:
    """Draw a run as the file's suffix says: a page for a browser, or an animation."""
    if path.suffix.lower() == PAGE_SUFFIX:
        from scp_planner.viewer import save_recording

        save_recording(run.recording(), path)
    else:
        from scp_planner.plotting import animate

        animate(run.recording(), path)
