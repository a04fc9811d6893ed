"""Puts the page together."""

from __future__ import annotations

from benchmarks import common  # isort: skip

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.report.parts import Figures, Row
from benchmarks.report.peers import peers_part, random_peers_part
from benchmarks.report.planning import random_part, reference_part, scaling_part, sizes_part

FIGURE_FOLDER = "figures"
SECTIONS = {
    "planning": ("reference scenarios", "benchmarks.planning"),
    "scaling": ("many obstacles, most of them far away", "benchmarks.planning --scaling"),
    "random": ("random scenarios", "benchmarks.planning --random"),
    "sizes": ("vehicles of every size", "benchmarks.sizes"),
    "peers": ("other methods", "benchmarks.peers"),
    "peers-random": ("other methods in random scenarios", "benchmarks.peers --random"),
    "online-replan": ("replans", "benchmarks.online replan"),
    "online-loops": ("closed loops", "benchmarks.online loops"),
    "online-levels": ("the price of safety", "benchmarks.online levels"),
    "online-crowds": ("recorded crowds", "benchmarks.online crowds"),
    "online-faults": ("faults on purpose", "benchmarks.online faults"),
    "crowds": ("among people", "benchmarks.crowds"),
    "crowds-recorded": ("recorded crowds as published", "benchmarks.crowds recorded"),
}
"""Files of results, without .csv: the titles of their sections, lower case, and the commands that write them."""


def online_part(name: str, title: str, rows: list[Row]) -> list[str]:
    """Section on planning while driving."""
    from benchmarks import online

    table, text = {
        "online-replan": (
            online.replan_table,
            f"{len(rows)} warm replans among 10 obstacles observed with noise; first plans are not counted.",
        ),
        "online-loops": (
            online.loop_table,
            f"{len(rows)} closed loops at 10 Hz among accelerating obstacles observed with 0.05 to 0.3 m of "
            f"noise, at the joint level {online.LEVEL}. `truth` is the plan with the true motions.",
        ),
        "online-levels": (online.level_table, "The same loops at other levels of confidence."),
        "online-crowds": (
            online.crowd_table,
            "Trips through recorded crowds that do not react, at 1.5 m/s: with zones, with predictions of constant "
            "velocity instead, by ORCA, and standing still until the path is free. Recorded people walk into a "
            "standing vehicle: *touched standing*.",
        ),
        "online-faults": (
            online.fault_table,
            "Runs with faults. `refused` counts certified plans and stops that the dense check refuses; `unsaid` plans "
            "without a reason.",
        ),
    }[name]
    return [f"## {title.capitalize()}", text, table(rows), f"`python -m {SECTIONS[name][1]}`"]


def _rows(path: Path) -> list[Row]:
    return common.read_csv(path) if path.is_file() else []


def _online_rows(results: Path, name: str) -> list[Row]:
    """Rows of a file of results; loops at the usual level and those at others share one."""
    from benchmarks.online import LEVEL

    rows = _rows(results / f"{'online-loops' if name == 'online-levels' else name}.csv")
    if name == "online-loops":
        return [row for row in rows if float(row["level"]) == LEVEL]
    if name == "online-levels":
        others = {row["seed"] for row in rows if float(row["level"]) != LEVEL}
        chosen = [row for row in rows if row["seed"] in others]
        return sorted(chosen, key=lambda row: float(row["level"]))
    return rows


def _environment(path: Path) -> str:
    return ", ".join(f"{row['what']} {row['value']}" for row in common.read_csv(path))


def _part(name: str, rows: list[Row], results: Path, figures: Figures) -> list[str]:
    """The sections that are made of one file of results."""
    from benchmarks.crowds import protocols, recorded

    match name:
        case "planning":
            return reference_part(rows, figures)
        case "scaling":
            return scaling_part(rows, figures)
        case "random":
            return random_part(rows)
        case "sizes":
            return sizes_part(rows, figures)
        case "crowds":
            return protocols.section(rows, SECTIONS[name][0])
        case "crowds-recorded":
            return recorded.section(rows, SECTIONS[name][0])
        case "peers":
            return peers_part(rows, common.read_csv(results / "peers-starts.csv"), figures)
        case _:
            return random_peers_part(rows, common.read_csv(results / "peers-random-starts.csv"))


def page(results: Path, figures: Figures) -> str:
    """Put the page together from what the results folder holds.

    Raises
    ------
    FileNotFoundError
        If it holds nothing.
    """
    sections: list[str] = []
    links = []
    for name, (title, _) in SECTIONS.items():
        online = name.startswith("online-")
        rows = _online_rows(results, name) if online else _rows(results / f"{name}.csv")
        if not rows:
            continue
        links.append(f"[{title}](#{title.lower().replace(',', '').replace(' ', '-')})")
        sections += online_part(name, title, rows) if online else _part(name, rows, results, figures)
    if not sections:
        raise FileNotFoundError(
            f"{results} holds no results: run benchmarks.planning, benchmarks.sizes, benchmarks.peers or "
            "benchmarks.online first"
        )
    sections.append("## Machine and versions")
    for name in ("planning", "sizes", "peers", "peers-random", "online", "crowds"):
        path = results / f"{name}-environment.csv"
        if path.is_file():
            sections.append(f"`{name}.csv`: {_environment(path)}.")
    parts = [
        "# Benchmarks",
        "<!-- Generated by `python -m benchmarks.report`: do not edit. -->",
        f"Sections: {', '.join(links)}. Everything runs on one thread. All times depend on the machine: compare "
        "ratios within one run. The command below a table repeats the measurement.",
        *sections,
    ]
    return "\n\n".join(parts) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page."""
    made = argparse.ArgumentParser(
        prog="python -m benchmarks.report", description="Write the page of results from CSV files."
    )
    made.add_argument("--results", type=Path, default=common.DEFAULT_OUTPUT, help="folder of the CSV files")
    made.add_argument("--page", type=Path, default=Path("docs/benchmarks.md"), help="page to write")
    options = made.parse_args(arguments)
    try:
        text = page(options.results, Figures(options.page.parent / FIGURE_FOLDER))
    except FileNotFoundError as error:
        common.say(f"benchmarks.report: {error}")
        return 2
    common.write_text(options.page, text)
    print(options.page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
