"""Shared by tests of figures: plans to draw, and parts of a figure."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text

import scp_planner as sp
from scp_planner import builtin

Case = tuple[sp.Plan, sp.Scenario]


def tall_scenario() -> sp.Scenario:
    """Upwards, far from the origin, on a Unix clock, with shapes that are no discs."""
    return sp.Scenario.model_validate(
        {
            "name": "tall",
            "vehicle": {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0},
            "start": {"time": 1.6e9, "position": [691000.0, 5335000.0], "speed": 0.5},
            "goal": {"position": [691002.0, 5335020.0], "radius": 0.5},
            "obstacles": [
                {"id": "car", "shape": {"rectangle": [4.5, 1.8]}, "motion": {"position": [691006.0, 5335008.0]}},
                {
                    "id": "block",
                    "shape": {"polygon": [[-1, -1], [1, -1], [0, 1.6]]},
                    "motion": {"position": [690997.0, 5335014.0]},
                },
            ],
        }
    )


def case_of(name: str) -> Case:
    if name == "tall":
        scenario = tall_scenario()
    elif name == "alone":
        scenario = builtin.load("crossing").model_copy(update={"obstacles": ()})
    elif name == "late":
        scenario = builtin.load("headon")
        scenario = scenario.model_copy(update={"goal": scenario.goal.model_copy(update={"latest_arrival": 0.5})})
    elif name in builtin.names():
        scenario = builtin.load(name)
    else:
        scenario = sp.Scenario.load(Path(__file__).parent / "suite" / f"{name}.yaml")
    return sp.plan(scenario, sp.Settings(max_runs=1)), scenario  # any trip will do for a picture


def map_of(figure: Figure) -> Any:
    return next(axes for axes in figure.axes if axes.get_xlabel() == "x (m)")


def panel_of(figure: Figure, title: str) -> Any:
    return next(axes for axes in figure.axes if axes.get_title("left").startswith(title))


def _texts(figure: Figure) -> list[Text]:
    """All that can be read, but for the obstacles' names, which stand where the obstacles are."""
    return [
        text
        for text in figure.findobj(Text)
        if text.get_visible() and text.get_text().strip() and not isinstance(text, Annotation)
    ]


def assert_legible(figure: Figure) -> None:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    frame = figure.bbox
    # Labels of ticks beyond the axes' ends exist, but are not drawn.
    drawn = set[int]()
    for axis in (each for axes in figure.axes if axes.axison for each in (axes.xaxis, axes.yaxis)):
        low, high = sorted(axis.get_view_interval())
        for tick in axis.get_major_ticks():
            if low - 1e-9 * (high - low) <= tick.get_loc() <= high + 1e-9 * (high - low):
                drawn |= {id(tick.label1), id(tick.label2)}
    ticks = {id(label) for axes in figure.axes for axis in (axes.xaxis, axes.yaxis) for label in axis.get_ticklabels()}
    boxes = [
        (text.get_text(), text.get_window_extent(renderer))
        for text in _texts(figure)
        if id(text) not in ticks or id(text) in drawn
    ]
    assert len(boxes) > 10
    for text, box in boxes:
        assert box.x0 >= -1 and box.y0 >= -1 and box.x1 <= frame.x1 + 1 and box.y1 <= frame.y1 + 1, text
        assert box.height >= 9.0, text
    for (one, first), (other, second) in combinations(boxes, 2):
        apart = first.x1 <= second.x0 or second.x1 <= first.x0 or first.y1 <= second.y0 or second.y1 <= first.y0
        assert apart, (one, other)
