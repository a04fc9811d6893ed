"""Draws the figures of the README and the documentation anew: `python -m docs.make_figures`, at the root."""

from __future__ import annotations

import logging
import re
import tempfile
from pathlib import Path
from typing import Any

import scp_planner as sp
from benchmarks.maps import scene
from benchmarks.parking import scenario_of
from docs.make_gallery import as_on_a_quiet_machine, shrink
from scp_planner import builtin
from scp_planner.plotting import animate_plan, plot_plan, plot_space_time
from scp_planner.plotting.viewer import save_viewer
from tests.browser import Browser, find_browser

FIGURES = Path(__file__).parent / "figures"
README_DPI = 100


def main() -> None:
    """Write every figure; the viewer's only where there is a browser."""
    scenario = builtin.load("radar")
    with as_on_a_quiet_machine():
        plan = min((sp.plan(scenario) for _ in range(5)), key=lambda each: each.wall_time)
    figure = plot_plan(plan, scenario)
    figure.savefig(FIGURES / "demo.png", dpi=README_DPI)
    animate_plan(plan, scenario, FIGURES / "demo.gif")
    plot_space_time(plan, scenario, FIGURES / "space_time.png")
    _photograph_viewer(plan, scenario)
    _draw_parking()
    _draw_map()
    _draw_meetings()
    for name in ("demo", "space_time", "viewer"):
        shrink(FIGURES / f"{name}.png", FIGURES / f"{name}.png")


def _draw_parking() -> None:
    scenario = scenario_of(0, seed=0)
    with as_on_a_quiet_machine():
        plan = sp.plan(scenario)
    assert plan.legs is not None
    stops = [plan.start_time, *(leg.end for leg in plan.legs.legs)]
    between = [0.5 * (leg.begin + leg.end) for leg in plan.legs.legs[:2]]
    plot_plan(plan, scenario, times=[*stops, *between]).savefig(FIGURES / "reversing.png", dpi=README_DPI)
    shrink(FIGURES / "reversing.png", FIGURES / "reversing.png")


def _draw_map() -> None:
    made = scene("rooms", 2, moving=True)
    assert made is not None
    sp.simulate(made[0]).draw(FIGURES / "maps.png")
    shrink(FIGURES / "maps.png", FIGURES / "maps.png")


def _draw_meetings() -> None:
    """Draw what the snippets of the how-to come to."""
    told: dict[str, Any] = {}
    for snippet in re.findall(
        r"```python\n(.*?)```", (FIGURES.parent / "howto" / "meeting.md").read_text("utf-8"), re.S
    ):
        exec(snippet, told)
    told["landed"].draw(FIGURES / "meeting_landing.png")
    told["visited"].draw(FIGURES / "meeting_person.png")
    told["cut_off"].draw(told["cutting_off"], FIGURES / "meeting_car.png")
    for name in ("landing", "person", "car"):
        shrink(FIGURES / f"meeting_{name}.png", FIGURES / f"meeting_{name}.png")


def _photograph_viewer(plan: sp.Plan, scenario: sp.Scenario) -> None:
    executable = find_browser()
    if executable is None:
        logging.warning("no figure of the viewer: there is no Chromium or Chrome")
        return
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "viewer.html"
        save_viewer(plan, scenario, page)
        with Browser(executable, Path(folder) / "profile") as browser:
            browser.open(page.as_uri())
            for _ in range(4):
                browser.press("ArrowRight", shift=True)
            browser.screenshot(FIGURES / "viewer.png")


if __name__ == "__main__":
    main()
