"""Functions that read, draw and export scenarios, plans and runs, by name."""

from __future__ import annotations

import base64
from collections.abc import Callable
from html import escape
from importlib import import_module
from io import BytesIO
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OUTPUTS = {
    "plan read": "scp_planner.planning.plan_file:read_plan",
    "plan table": "scp_planner.export.tables:plan_table",
    "plan export": "scp_planner.export.files:export_plan",
    "plan plot": "scp_planner.plotting.views:plot_view",
    "plan sketch": "scp_planner.plotting.sketches:sketch_plan",
    "scenario sketch": "scp_planner.plotting.sketches:sketch_scenario",
    "plan draw": "scp_planner.plotting.views:draw_plan",
    "run table": "scp_planner.export.tables:run_table",
    "run export": "scp_planner.export.files:export_run",
    "run plot": "scp_planner.plotting.views:plot_run_view",
    "run draw": "scp_planner.plotting.views:draw_run",
    "run recorded": "scp_planner.simulation.recorder:load_recording",
    "planner record": "scp_planner.simulation.recorder:Recorder",
    "live scene": "scp_planner.export.foxglove:LiveScene",
    "run recording": "scp_planner.plotting.run_recording:record_run",
}


def output_named(name: str) -> Callable[..., Any]:
    """Return the function behind an output; its module is imported only now."""
    module, function = OUTPUTS[name].split(":")
    found: Callable[..., Any] = getattr(import_module(module), function)
    return found


def picture_or_text(draw: Callable[[], Figure], text: str) -> str:
    """Return a picture and its text as HTML; the text alone where nothing can draw."""
    words = f"<pre>{escape(text)}</pre>"
    try:
        figure = draw()
    except ImportError:
        return words
    with BytesIO() as file:
        figure.savefig(file, format="png")
        picture = base64.b64encode(file.getvalue()).decode("ascii")
    return f'<img alt="{escape(text)}" src="data:image/png;base64,{picture}">{words}'
