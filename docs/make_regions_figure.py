"""Draws the figure of `explanation/noticing.md` anew: `python -m docs.make_regions_figure`, at the root.

What it shows is what `python -m benchmarks.online regions` wrote; another folder may be named: `... FOLDER`.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

from matplotlib.figure import Figure

from docs.make_gallery import shrink
from scp_planner.plotting.style import COLOURS, GREY, INK, save, style

FIGURE = Path(__file__).parent / "figures" / "regions.png"
DPI = 130
LEADS = {"0": "next", "1": "1 s", "2": "2 s", "4": "4 s"}
LEVEL, WITHIN = 95.0, 2.0  # %


def main() -> None:
    """Write the figure."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("benchmark-results")
    with (folder / "online-regions.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    with style():
        save(drawn(rows), FIGURE)
    shrink(FIGURE, FIGURE)


def drawn(rows: list[dict[str, str]]) -> Figure:
    """Draw how many predictions hold, in %, by family or recording, one panel for each time ahead."""
    names = list(dict.fromkeys(row["family"] for row in rows))
    figure = Figure(figsize=(9.0, 0.28 * len(names) + 1.3), dpi=DPI, layout="constrained")
    panels = figure.subplots(1, len(LEADS), sharey=True)
    for axes, (lead, title) in zip(panels, LEADS.items(), strict=True):
        axes.axvspan(LEVEL - WITHIN, LEVEL + WITHIN, color=GREY, alpha=0.25, lw=0)
        axes.axvline(LEVEL, color=INK, lw=0.8)
        for (way, marker), colour in zip((("model", "o"), ("adaptive", "D")), COLOURS, strict=False):
            some = [row for row in rows if row["regions"] == way]
            share = [100.0 * float(row[f"held_{lead}"]) / float(row[f"number_{lead}"]) for row in some]
            place = [names.index(row["family"]) for row in some]
            axes.plot(share, place, marker, color=colour, ms=4.5, label=way)
        axes.set(title=title, xlabel="truth in its region, %", xlim=(40.0, 102.0))
        axes.set_yticks(range(len(names)), names)
    panels[0].invert_yaxis()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, [f"regions: {label}" for label in labels], loc="outside lower center", ncols=2)
    return figure


if __name__ == "__main__":
    main()
