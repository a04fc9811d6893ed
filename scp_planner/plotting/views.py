"""Views of a plan or a closed loop, and the file formats for them."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING

from scp_planner.files import check_suffix
from scp_planner.plotting.animation import animate, animate_plan
from scp_planner.plotting.figures import plot_plan, plot_profiles, plot_run, plot_run_profiles
from scp_planner.plotting.run_recording import record_run
from scp_planner.plotting.space_time import plot_run_space_time, plot_space_time
from scp_planner.plotting.viewer import save_recording, save_viewer
from scp_planner.settings.knobs import word_of
from scp_planner.settings.pictures import FIGURE_SUFFIXES, FILM_SUFFIXES, PAGE_SUFFIXES, PICTURE_SUFFIXES, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario
    from scp_planner.simulation.run import Run


_OF_PLANS = {View.MAP: plot_plan, View.SPACE_TIME: plot_space_time, View.PROFILES: plot_profiles}
_OF_RUNS = {View.MAP: plot_run, View.SPACE_TIME: plot_run_space_time, View.PROFILES: plot_run_profiles}


def plot_view(
    plan: Plan, scenario: Scenario, path: str | PathLike[str] | None = None, view: View | str = View.MAP
) -> Figure:
    """Draw a plan."""
    return _OF_PLANS[word_of(View, view, "view")](plan, scenario, path)


def plot_run_view(run: Run, path: str | PathLike[str] | None = None, view: View | str = View.MAP) -> Figure:
    """Draw a closed loop."""
    return _OF_RUNS[word_of(View, view, "view")](run, path)


def draw_plan(plan: Plan, scenario: Scenario, path: str | PathLike[str], view: View | str = View.MAP) -> None:
    """Draw a plan into a file, as its suffix says."""
    suffix = check_suffix(path, PICTURE_SUFFIXES)
    if suffix in PAGE_SUFFIXES:
        save_viewer(plan, scenario, path)
    elif suffix in FILM_SUFFIXES:
        animate_plan(plan, scenario, path)
    else:
        plot_view(plan, scenario, path, view)


def draw_run(run: Run, path: str | PathLike[str], view: View | str = View.MAP) -> None:
    """Draw a closed loop into a file, as its suffix says."""
    suffix = check_suffix(path, PICTURE_SUFFIXES)
    if suffix in FIGURE_SUFFIXES:
        plot_run_view(run, path, view)
    elif suffix in PAGE_SUFFIXES:
        save_recording(record_run(run), path)
    else:
        animate(record_run(run), path)
