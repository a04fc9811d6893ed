"""Style of pictures, and how they are saved."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from scp_planner.files import check_suffix, replacing
from scp_planner.plotting.scales import Unit
from scp_planner.settings.pictures import FIGURE_SUFFIXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

    from scp_planner.plotting.recording import Recording

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#8C6D00")
"""Okabe and Ito's, neighbours apart in lightness too; but for their yellow, which is too light on white."""
INK, GREY, FAINT, WARNING = "#222222", "#777777", "#C8C8C8", "#B2182B"
LABEL: dict[str, Any] = {"fontsize": 7.5, "zorder": 6, "clip_on": True}
"""Looks of a name on a map."""
FORBIDDEN, SLOW, SLOW_TEXT = "#DCDCDC", "#E8C547", "#6B5500"
"""Colours of ground: forbidden to the vehicle, or with a low speed limit."""
DOTTED = (0, (1, 1.2))
DPI = 150

_SETTINGS: dict[str, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.6,
    "text.color": INK,
    "legend.frameon": False,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.hashsalt": "scp_planner",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
}


@contextmanager
def style() -> Iterator[None]:
    """Draw in the package's style, whatever the user's settings are: they are put back afterwards."""
    import matplotlib

    settings: Any = _SETTINGS
    with matplotlib.rc_context():
        matplotlib.rcdefaults()  # leaves the backend as it is
        matplotlib.rcParams.update(settings)
        yield


def colour_of(number: int) -> str:
    """Colour of a scenario's obstacle, by its number, in all pictures."""
    return COLOURS[number % len(COLOURS)]


def halo() -> list[Any]:
    """Effects of text that has a white border."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.0, foreground="white")]


def settle(figure: Figure) -> None:
    """Lay a figure out for good: what is moved by the first pass may ask for other margins in the second."""
    from matplotlib.axes import Axes

    engine = figure.get_layout_engine()
    if engine is not None:
        for _ in range(2):
            engine.execute(figure)
    figure.set_layout_engine(None)  # "none" would be one that does nothing, for which saving draws once more
    # The solver of the layout is not repeatable to the last bit, but files of the same figure are to be the same.
    for axes in figure.findobj(Axes):
        for which in ("original", "active"):
            left, bottom, width, height = np.round(axes.get_position(original=which == "original").bounds, 9).tolist()
            axes.set_position((left, bottom, width, height), which=which)


def check_figure(path: str | PathLike[str] | None) -> None:
    """Refuse a path of another suffix before a figure is drawn."""
    if path is not None:
        check_suffix(path, FIGURE_SUFFIXES)


def save(figure: Figure, path: str | PathLike[str] | None) -> Figure:
    """Save a figure, if there is a path, whole or not at all; without the date: the same figure is the same file."""
    if path is None:
        return figure
    suffix = check_suffix(path, FIGURE_SUFFIXES)
    dateless: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with replacing(path) as temporary:
        figure.savefig(temporary, format=suffix.removeprefix("."), metadata=dateless.get(suffix))
    return figure


def finish(figure: Figure, path: str | PathLike[str] | None) -> Figure:
    """Settle a figure, and save it."""
    settle(figure)
    return save(figure, path)


def limit_times(axes: Axes, recording: Recording) -> None:
    """Let a time axis span a recording."""
    axes.set_xlim(recording.time[0] - recording.epoch, recording.time[-1] - recording.epoch)


def label_lengths(axis: Axis, quantity: str, unit: Unit) -> None:
    """Label an axis of lengths in m, or of speeds in m/s and so on, and its ticks, in a unit."""
    axis.set_label_text(unit.label(quantity))
    tick_lengths(axis, unit)


def tick_lengths(axis: Axis, unit: Unit) -> None:
    """Write the ticks of an axis of lengths in m, or of speeds in m/s and so on, in a unit."""
    from matplotlib.ticker import FuncFormatter

    if unit.size != 1.0:
        axis.set_major_formatter(FuncFormatter(lambda value, _: unit.text(value)))


def time_label(epoch: float) -> str:
    """Label of a time axis whose times are relative to an epoch, s."""
    return "time after the start (s)" if epoch else "time (s)"


def time_text(seconds: float) -> str:
    """Write a time with at most two decimals."""
    return f"{seconds:.2f}".rstrip("0").rstrip(".") + " s"
