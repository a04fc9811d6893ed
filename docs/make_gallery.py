"""Draws the figures of `gallery.md` and of the tutorial anew: `python -m docs.make_gallery [NAME ...]`, at the root.

Every example, or each that is named, is run as a user would run it; `tutorial` is the name of the tutorial's. Those of
real people need the recorded data: set SCP_PLANNER_DATA to their folder.
"""

from __future__ import annotations

import logging
import re
import runpy
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import process_time
from unittest.mock import patch

from PIL import Image

import scp_planner as sp
from scp_planner import builtin
from scp_planner.plotting import plot_plan

DOCS = Path(__file__).resolve().parent
EXAMPLES = DOCS.parent / "examples"
GALLERY = DOCS / "figures" / "gallery"
WIDTH = 1000  # pixels
TAKES_FOLDER = {"export_messages", "watch"}


def main(*names: str) -> None:
    """Write every figure, or those of some examples."""
    GALLERY.mkdir(exist_ok=True)
    for example in sorted(EXAMPLES.glob("*.py")):
        if names and example.stem not in names:
            continue
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            target = folder if example.stem in TAKES_FOLDER else folder / f"{example.stem}.png"
            if _run(example, "-o", str(target)) != 0:
                logging.warning("no figure of %s", example.name)
                continue
            for figure in (*folder.glob("*.png"), *folder.glob("*.gif")):
                shrink(figure, GALLERY / f"{example.stem}{figure.suffix}")
    if not names or "tutorial" in names:
        _draw_tutorial()


@contextmanager
def as_on_a_quiet_machine() -> Iterator[None]:
    """Let plans tell the processor's time, whatever else is going on; the first one, which loads much, has been."""
    sp.plan(builtin.load("headon"))
    with patch("scp_planner.pauses.perf_counter", process_time):
        yield


def _run(example: Path, *arguments: str) -> int:
    with patch.object(sys, "argv", [str(example), *arguments]), as_on_a_quiet_machine():
        try:
            runpy.run_path(str(example), run_name="__main__")
        except SystemExit as end:
            return int(end.code or 0)
    return 0


def shrink(source: Path, target: Path) -> None:
    """Copy a picture, no wider than the page and with no more colours than it needs."""
    if source.suffix == ".gif":
        target.write_bytes(source.read_bytes())
        return
    with Image.open(source) as picture:
        width = min(WIDTH, picture.width)
        height = round(picture.height * width / picture.width)
        small = picture.convert("RGB").resize((width, height), Image.Resampling.LANCZOS)
        # No dots, and few steps in a bar of colours
        few = small.quantize(256, method=Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
        few.save(target, optimize=True)


def _draw_tutorial() -> None:
    """Plan the scene of the tutorial, as its page has it."""
    text = (DOCS / "tutorial.md").read_text(encoding="utf-8")
    found = re.search(r'```yaml title="warehouse.yaml"\n(.*?)```', text, flags=re.DOTALL)
    assert found is not None
    with tempfile.TemporaryDirectory() as name:
        file, figure = Path(name) / "warehouse.yaml", Path(name) / "plan.png"
        file.write_text(found.group(1), encoding="utf-8")
        scenario = sp.Scenario.load(file)
        with as_on_a_quiet_machine():
            plot_plan(sp.plan(scenario), scenario, figure)
        shrink(figure, DOCS / "figures" / "tutorial_plan.png")


if __name__ == "__main__":
    main(*sys.argv[1:])
