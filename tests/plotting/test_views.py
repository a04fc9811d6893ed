"""Views of plans and of closed loops."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from figure_parts import Case, assert_legible, map_of, panel_of
from matplotlib.figure import Figure
from matplotlib.patches import Circle

import scp_planner as sp
from scp_planner.plotting import View


@pytest.mark.parametrize("view", View)
def test_views_of_a_plan(radar: Case, view: View) -> None:
    plan, scenario = radar
    assert_legible(plan.plot(scenario, view=view))


def test_plans_and_runs_are_drawn_as_they_are_plotted(radar: Case, drive: sp.Run, tmp_path: Path) -> None:
    plan, scenario = radar
    view = View.PROFILES
    plan.plot(scenario, tmp_path / "plotted.svg", view)
    plan.draw(scenario, tmp_path / "drawn.svg", str(view))
    assert (tmp_path / "plotted.svg").read_bytes() == (tmp_path / "drawn.svg").read_bytes()
    drive.plot(tmp_path / "plotted.svg", view)
    drive.draw(tmp_path / "drawn.svg", str(view))
    assert (tmp_path / "plotted.svg").read_bytes() == (tmp_path / "drawn.svg").read_bytes()


@pytest.mark.parametrize("view", View)
def test_views_of_a_run(drive: sp.Run, view: View) -> None:
    assert_legible(drive.plot(view=view))


def test_unknown_view_is_refused(radar: Case, drive: sp.Run) -> None:
    draws: list[Callable[[], Figure]] = [
        lambda: radar[0].plot(radar[1], view="globe"),
        lambda: drive.plot(view="globe"),
    ]
    for draw in draws:
        with pytest.raises(ValueError, match="view = 'globe': must be one of map, space-time, profiles"):
            draw()


def test_profiles_of_a_plan_are_those_of_the_map(radar: Case, figure: Figure) -> None:
    alone = radar[0].plot(radar[1], view="profiles")
    for title in ("speed (m/s)", "acceleration (m/s²)", "lateral", "curvature", "clearance"):
        drawn = [panel_of(each, title).lines[0].get_ydata() for each in (figure, alone)]
        assert np.ptp(drawn[1]) == pytest.approx(np.ptp(drawn[0]), rel=0.02)
        assert panel_of(alone, title).get_xlim() == panel_of(figure, title).get_xlim()


def test_map_of_a_run_shows_what_was_driven_and_planned(drive: sp.Run) -> None:
    axes = map_of(drive.plot())
    discs = [patch for patch in axes.patches if isinstance(patch, Circle) and patch.radius == 0.3]
    assert len(discs) >= 3
    for disc_of_vehicle in discs:
        assert np.linalg.norm(drive.position - disc_of_vehicle.center, axis=1).min() < 0.05
    (driven,) = axes.collections
    assert np.abs(driven.get_segments()[-1][-1] - drive.position[-1]).max() < 1e-9
    planned = [line for line in axes.lines if line.get_linestyle() == "--" and line.get_linewidth() == 1.0]
    assert len(planned) == len(discs)
