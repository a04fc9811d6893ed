"""The results page: ``python -m benchmarks.report`` writes ``docs/benchmarks.md`` and its figures from the CSV files.

Every number on the page comes from the files that ``benchmarks.planning``, ``benchmarks.peers`` and
``benchmarks.online`` wrote; parts whose file is missing are left out.
"""

from __future__ import annotations

from benchmarks import common  # isort: skip

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import sizes

Row = dict[str, str]
FIGURE_FOLDER = "figures"
COLORS = ("#0b6e99", "#d9730d", "#448361", "#9065b0", "#c14c8a", "#787774")
REFERENCE = "scp_planner.plan"
ONE_RUN = "scp_planner one run"
IN_STEP = "scp_planner in step"
NLP = "casadi-ipopt"
EQUAL = 1e-3  # relative difference of travel times that does not count


def _value(row: Row, key: str) -> float:
    return float(row[key]) if row.get(key) not in (None, "") else float("nan")


def _families(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(row["family"] for row in rows))


def _of(rows: Sequence[Row], family: str) -> list[Row]:
    return [row for row in rows if family in ("all", row["family"])]


def _median(rows: Sequence[Row], key: str, level: float = 0.5) -> float:
    return common.quantile((_value(row, key) for row in rows), level)


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
    "crowds-recorded": ("recorded crowds as others drive through them", "benchmarks.crowds recorded"),
}
"""Files of results, without .csv: the titles of their sections, lower case, and the commands that write them."""


class Figures:
    """Draws into one folder, in one style, the same bytes for the same numbers."""

    def __init__(self, folder: Path) -> None:
        import matplotlib

        matplotlib.use("Agg")
        matplotlib.rcParams.update(
            {
                "svg.hashsalt": "scp_planner",
                "font.size": 9,
                "axes.spines.top": False,
                "axes.spines.right": False,
                "axes.grid": True,
                "axes.axisbelow": True,
                "grid.color": "#e3e2e0",
                "legend.frameon": False,
            }
        )
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def axes(self, width: float = 7.0, height: float = 3.2, count: int = 1) -> tuple[Any, Any]:
        """Return a figure and its axes (an array if more than one)."""
        import matplotlib.pyplot as plt

        return plt.subplots(1, count, figsize=(width, height), layout="constrained")

    def save(self, figure: Any, name: str, alternative: str) -> str:
        """Save as SVG; return the Markdown that shows it."""
        import matplotlib.pyplot as plt

        figure.savefig(self._folder / f"benchmarks-{name}.svg", metadata={"Date": None})
        plt.close(figure)
        return f"![{alternative}]({self._folder.name}/benchmarks-{name}.svg)"


def reference_part(rows: list[Row], figures: Figures) -> list[str]:
    """Section on the reference scenarios."""
    stages = [key for key in rows[0] if key.endswith("_ms") and key != "wall_ms"]
    lines = []
    for family in [*_families(rows), "all"]:
        chosen = _of(rows, family)
        ratios = [_value(row, "ratio") for row in chosen]
        lines.append(
            [
                family,
                f"{sum(row['certified'] == '1' for row in chosen)}/{len(chosen)}",
                f"{sum(row['dense_check'] == '1' for row in chosen)}/{len(chosen)}",
                *(common.number(common.quantile(ratios, level), 5) for level in (0.5, 0.95)),
                sum(ratio < 1.0 for ratio in ratios),
                common.number(_median(chosen, "iterations"), 0),
                common.number(_median(chosen, "wall_ms"), 1),
                common.number(_median(chosen, "wall_ms", 0.95), 1),
            ]
        )
    headings = ["family", "certified", "dense check", "time ratio", "ratio 95 %", "faster than best known"]
    headings += ["iterations", "wall ms", "wall ms 95 %"]
    families = _families(rows)

    figure, (left, right) = figures.axes(8.0, 3.2, 2)
    for place, family in enumerate(families):
        excess = 100.0 * (np.array([_value(row, "ratio") for row in _of(rows, family)]) - 1.0)
        spread = np.linspace(-0.18, 0.18, excess.size)
        left.scatter(place + spread, excess, s=14, color=COLORS[0], alpha=0.8, linewidths=0)
    left.axhline(0.0, color="black", linewidth=0.8)
    left.set_xticks(range(len(families)), families, rotation=30, ha="right")
    left.set_ylabel("travel time against best known, %")
    bottom = np.zeros(len(families))
    for color, stage in zip(COLORS, stages, strict=False):
        heights = np.array([_median(_of(rows, family), stage) for family in families])
        right.bar(range(len(families)), heights, bottom=bottom, color=color, label=stage.removesuffix("_ms"))
        bottom += np.nan_to_num(heights)
    right.set_xticks(range(len(families)), families, rotation=30, ha="right")
    right.set_ylabel("median time of each stage, ms")
    right.legend()
    picture = figures.save(figure, "reference", "Travel times against the best known, and the time of each stage")
    return [
        "## Reference scenarios",
        "One call of `scp_planner.plan` each: search, runs of the loop, certificate. *Time ratio* is the travel time "
        "divided by the best known one, medians over certified plans; *dense check* counts plans that "
        "`verification.dense_check` confirms with the errors of finite differences as its only tolerance.",
        common.table(headings, lines),
        picture,
        "`python -m benchmarks.planning`",
    ]


def scaling_part(rows: list[Row], figures: Figures) -> list[str]:
    """Section on the number of obstacles."""
    counts = sorted({int(row["obstacles"]) for row in rows})
    walls, more = (
        [_median([row for row in rows if int(row["obstacles"]) == count], key) for count in counts]
        for key in ("wall_ms", "more_ms")
    )
    figure, axes = figures.axes(4.6, 3.0)
    for crowd in sorted({row["crowd"] for row in rows}):
        chosen = [row for row in rows if row["crowd"] == crowd]
        axes.plot(
            [int(row["obstacles"]) for row in chosen],
            [_value(row, "wall_ms") for row in chosen],
            color=COLORS[5],
            linewidth=0.8,
        )
    axes.plot(counts, walls, color=COLORS[0], marker="o", markersize=4, label="median")
    axes.set_xlabel(f"obstacles, {counts[0]} of them near")
    axes.set_ylabel("time of a plan, ms")
    axes.set_ylim(bottom=0.0)
    axes.legend()
    picture = figures.save(figure, "scaling", "Time of a plan against the number of obstacles")
    return [
        "## Many obstacles, most of them far away",
        f"{counts[0]} obstacles are near, the others stay hundreds of metres away. "
        f"{counts[-1] - counts[0]} far obstacles cost {more[-1]:.1f} ms together "
        "(median of the differences within rounds in which all sizes take turns).",
        common.table(
            ["obstacles", "wall ms", f"more than {counts[0]} near ones, ms"],
            [[count, f"{wall:.1f}", f"{extra:.1f}"] for count, wall, extra in zip(counts, walls, more, strict=True)],
        ),
        picture,
        "`python -m benchmarks.planning --scaling`",
    ]


def random_part(rows: list[Row]) -> list[str]:
    """Section on random scenarios."""
    lines = []
    for family in [*_families(rows), "all"]:
        chosen = _of(rows, family)
        certified = [row for row in chosen if row["certified"] == "1"]
        others = Counter(row["status"] for row in chosen if row["certified"] != "1")
        lines.append(
            [
                family,
                len(chosen),
                f"{100.0 * len(certified) / len(chosen):.1f} %",
                ", ".join(f"{name} {number}" for name, number in others.most_common()),
                sum(row["dense_check"] != "1" for row in certified),
                common.number(_median(chosen, "wall_ms"), 1),
                common.number(_median(chosen, "wall_ms", 0.95), 1),
            ]
        )
    headings = ["family", "scenarios", "certified", "others", "certified but refused", "wall ms", "wall ms 95 %"]
    return [
        "## Random scenarios",
        f"{len(rows)} scenarios that nobody has looked at, from the generators in `benchmarks.families`; some have no "
        "solution. *Certified but refused* counts certified plans in which the dense check finds a violation.",
        common.table(headings, lines),
        f"`python -m benchmarks.planning --random {len(rows)}`",
    ]


def sizes_part(rows: list[Row], figures: Figures) -> list[str]:
    """Section on vehicles of every size."""
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    figure, (left, right) = figures.axes(8.0, 3.2, 2)
    for place, kind in enumerate(kinds):
        chosen = [row for row in rows if row["kind"] == kind]
        work = [_value(row, "wall_ms") / _value(row, "reference_ms") for row in chosen]
        for axes, values in ((left, [100.0 * (_value(row, "ratio") - 1.0) for row in chosen]), (right, work)):
            axes.plot(values, [place] * len(chosen), "o", color=COLORS[0], markersize=4, alpha=0.6)
    left.set_yticks(range(len(kinds)), kinds)
    right.set_yticks(range(len(kinds)), [])
    left.set_xlabel("travel time above the best known, %")
    right.set_xlabel("work, times that of a reference scene")
    picture = figures.save(figure, "sizes", "Travel times against the best known, and the work, by kind of vehicle")
    return [
        "## Vehicles of every size",
        f"{len(rows)} scenes in SI units, from robots on a table top to ships and aircraft: easy and dense, obstacles "
        "known and observed with noise. *Best* is the shortest certified time of the same scene in three systems of "
        "units, with twice as many ways tried, and with splines twice as fine; *by any* counts the scenes that one of "
        "these certifies. The work is that of a reference scene with as many obstacles, on the same machine.",
        sizes.summary(rows),
        picture,
        "`python -m benchmarks.sizes`",
    ]


def peers_part(rows: list[Row], starts: list[Row], figures: Figures) -> list[str]:
    """Section on other methods."""
    from benchmarks.peers.base import JUDGE
    from benchmarks.peers.starts import TEN_STARTS

    plans = {row["scenario"]: row for row in rows if row["method"] == REFERENCE}
    pairs = list(dict.fromkeys((row["method"], row["start_set"]) for row in rows))
    parts = [
        "## Other methods",
        "All methods plan the same scenarios, in the same process and order, on one thread, from the same "
        f"{len(TEN_STARTS)} starts: bows to both sides, and a slow start. *One* is the first of them; *ten* takes the "
        "best answer and adds up the times. `scp_planner.plan` chooses its starts itself. Building (compiling, "
        "symbolic differentiation) is not counted.",
        "An answer counts as *certified* if the method itself calls it a success and the independent check, with the "
        f"same tolerances for all, agrees: {1e3 * JUDGE.clearance:g} mm of clearance, "
        f"{1e3 * JUDGE.position:g} mm at the ends, {JUDGE.speed:g} m/s, {JUDGE.acceleration:g} m/s2, "
        f"{JUDGE.curvature:g} 1/m. The last two columns are medians of the ratios to `scp_planner.plan` on the same "
        "scenario.",
        *speed_part(rows, starts),
        *certified_part(rows),
    ]
    for family in [*_families(rows), "all"]:
        lines = []
        for method, start_set in pairs:
            chosen = [row for row in _of(rows, family) if (row["method"], row["start_set"]) == (method, start_set)]
            if not chosen:
                continue
            both = [(row, plans[row["scenario"]]) for row in chosen if row["scenario"] in plans]
            lines.append(
                [
                    method,
                    start_set,
                    common.number(_median(chosen, "wall_ms"), 1),
                    f"{sum(row['certified'] == '1' for row in chosen)}/{len(chosen)}",
                    common.number(
                        common.median(_value(row, "wall_ms") / _value(plan, "wall_ms") for row, plan in both), 1
                    ),
                    common.number(
                        common.median(_value(row, "travel_time") / _value(plan, "travel_time") for row, plan in both),
                        5,
                    ),
                ]
            )
        headings = ["method", "starts", "wall ms", "certified", "wall / plan()", "travel time / plan()"]
        parts += [f"### {family}", common.table(headings, lines)]
    lines = []
    for method in dict.fromkeys(row["method"] for row in starts):
        chosen = [row for row in starts if row["method"] == method]
        lines.append(
            [
                method,
                str(len(chosen)),
                common.number(_median(chosen, "wall_ms"), 1),
                common.number(_median(chosen, "wall_ms", 0.95), 1),
                *(
                    f"{100.0 * sum(row[verdict] == '1' for row in chosen) / len(chosen):.0f} %"
                    for verdict in ("certified", "checked")
                ),
            ]
        )
    parts += [
        "### Each start by itself",
        common.table(["method", "starts", "wall ms a start", "wall ms 95 %", "certified", "checked"], lines),
        peers_figure(rows, pairs, plans, figures),
        "`python -m benchmarks.peers`; the peers are an optional extra, `pip install scp-planner[peers]`.",
    ]
    return parts


def speed_part(rows: list[Row], starts: list[Row]) -> list[str]:
    """Wall times against the nonlinear program, start by start, and of its best answer against a whole plan."""
    parts = []
    walls = {_start_key(row): _value(row, "wall_ms") for row in starts}
    for fast, what in ((ONE_RUN, "one run of scp_planner from the same start"), (IN_STEP, "a start of runs in step")):
        ratios = [
            wall / walls[fast, *key]
            for (method, *key), wall in walls.items()
            if method == NLP and (fast, *key) in walls
        ]
        if ratios:
            low, middle, high = (common.quantile(ratios, level) for level in (0.1, 0.5, 0.9))
            parts.append(
                f"- **A start**: `{NLP}` takes {middle:.1f} times as long as {what} "
                f"(median of {len(ratios)} pairs; 10 % and 90 % quantiles {low:.1f} and {high:.1f})."
            )
    plans = {row["scenario"]: row for row in rows if row["method"] == REFERENCE}
    tens = [row for row in rows if row["method"] == NLP and row["start_set"] == "ten" and row["scenario"] in plans]
    pairs = [(row, plans[row["scenario"]]) for row in tens]
    if pairs:
        wall = common.median(_value(row, "wall_ms") / _value(plan, "wall_ms") for row, plan in pairs)
        both = [(row, plan) for row, plan in pairs if row["certified"] == plan["certified"] == "1"]
        times = [_value(row, "travel_time") / _value(plan, "travel_time") for row, plan in both]
        parts.append(
            f"- **The best of ten starts**: `{NLP}` takes {wall:.0f} times as long as `plan()` (median of {len(pairs)} "
            f"scenarios). Where both answers are certified, in {len(both)}, its travel time is {_median_of(times)} "
            f"times that of `plan()` (median); it is longer by more than {100 * EQUAL:g} % in "
            f"{sum(time > 1.0 + EQUAL for time in times)}, shorter by more than that in "
            f"{sum(time < 1.0 - EQUAL for time in times)}."
        )
    return ["\n".join(parts)] if parts else []


def _start_key(row: Row) -> tuple[str, ...]:
    return row["method"], row["scenario"], row["bow"], row["speed_share"]


def _median_of(ratios: Sequence[float]) -> str:
    return common.number(common.median(ratios), 5)


def certified_part(rows: list[Row]) -> list[str]:
    """Rates of certified answers, family by family; and where only one of a method and the planner has one."""
    families = _families(rows)
    plans = {row["scenario"]: row["certified"] for row in rows if row["method"] == REFERENCE}
    lines = []
    for method, start_set in dict.fromkeys((row["method"], row["start_set"]) for row in rows):
        mine = [row for row in rows if (row["method"], row["start_set"]) == (method, start_set)]
        pairs = [(row["certified"], plans[row["scenario"]]) for row in mine if row["scenario"] in plans]
        counts = []
        for family in [*families, "all"]:
            chosen = _of(mine, family)
            counts.append(f"{sum(row['certified'] == '1' for row in chosen)}/{len(chosen)}" if chosen else None)
        checked = f"{sum(row['checked'] == '1' for row in mine)}/{len(mine)}"
        only = [pairs.count(pair) for pair in (("0", "1"), ("1", "0"))]
        lines.append([method, start_set, *counts, checked, *(only if method != REFERENCE else (None, None))])
    headings = ["method", "starts", *families, "all", "checked", "only plan()", "only this one"]
    return [
        "Scenarios with a certified answer; *checked*: with one that passes the check, whatever the method itself "
        "says of it; *only plan()* and *only this one*: where one of both has a certified answer and the other none.",
        common.table(headings, lines),
    ]


def random_peers_part(rows: list[Row], starts: list[Row]) -> list[str]:
    """Section on other methods in random scenarios."""
    count = len({row["scenario"] for row in rows})
    return [
        "## Other methods in random scenarios",
        f"{count} scenarios from the generators in `benchmarks.families`, on the same terms. Some have no solution.",
        *speed_part(rows, starts),
        *certified_part(rows),
        "`python -m benchmarks.peers --random N`",
    ]


def peers_figure(rows: list[Row], pairs: list[tuple[str, str]], plans: dict[str, Row], figures: Figures) -> str:
    """Wall time against travel time, and how many scenarios got a certified answer."""
    from matplotlib.ticker import NullLocator

    methods = list(dict.fromkeys(method for method, _ in pairs))
    figure, (left, right) = figures.axes(8.0, 3.8, 2)
    shares = []
    for method, start_set in pairs:
        chosen = [row for row in rows if (row["method"], row["start_set"]) == (method, start_set)]
        color = COLORS[methods.index(method) % len(COLORS)]
        shares.append((f"{method}, {start_set}", 100.0 * np.mean([row["certified"] == "1" for row in chosen]), color))
        points = [
            (
                _value(row, "wall_ms") / _value(plans[row["scenario"]], "wall_ms"),
                100.0 * (_value(row, "travel_time") / _value(plans[row["scenario"]], "travel_time") - 1.0),
            )
            for row in chosen
            if row["scenario"] in plans and row["certified"] == "1"
        ]
        if points and method != REFERENCE:
            x, y = np.array(points).T
            left.scatter(
                x,
                y,
                s=14,
                color=color if start_set == "one" else "none",
                edgecolors=color,
                linewidths=0.7,
                label=f"{method}, {start_set}",
            )
    left.axhline(0.0, color="black", linewidth=0.8)
    left.axvline(1.0, color="black", linewidth=0.8)
    left.set_xscale("log")
    left.set_yscale("symlog", linthresh=0.1)
    ticks = (-1.0, -0.1, 0.0, 0.1, 1.0, 10.0)
    low, high = left.get_ylim()
    left.set_ylim(min(low, -0.2), max(high, 0.2))
    left.set_yticks([tick for tick in ticks if low <= tick <= high or abs(tick) <= 0.1])
    left.yaxis.set_major_formatter("{x:g}")
    left.yaxis.set_minor_locator(NullLocator())
    left.set_xlabel("wall time / scp_planner.plan")
    left.set_ylabel("travel time against scp_planner.plan, %")
    figure.legend(fontsize=7, loc="outside lower center", ncols=4)
    names, heights, colors = zip(*reversed(shares), strict=True)
    right.barh(range(len(names)), heights, color=colors)
    right.set_yticks(range(len(names)), names, fontsize=7)
    right.set_xlabel("scenarios with a certified answer, %")
    return figures.save(figure, "peers", "Other methods: wall time, travel time, rate of certified answers")


def online_part(name: str, title: str, rows: list[Row]) -> list[str]:
    """Section on planning while driving."""
    from benchmarks import online

    table, text = {
        "online-replan": (
            online.replan_table,
            f"{len(rows)} replans, warm, among 10 obstacles that are seen with noise; the first plans are not counted.",
        ),
        "online-loops": (
            online.loop_table,
            f"{len(rows)} closed loops at 10 Hz among obstacles that accelerate and are seen with 0.05 to 0.3 m of "
            f"noise, at the joint level {online.LEVEL}. `truth` is the plan with the true motions.",
        ),
        "online-levels": (online.level_table, "The same loops at other levels of confidence."),
        "online-crowds": (
            online.crowd_table,
            "Trips through recorded crowds that do not react, at 1.5 m/s: with zones, with predictions of constant "
            "velocity instead, and standing still until the way is free. People walk into what stands in their way "
            "in the recordings, which knew nothing of a vehicle: *touched standing*.",
        ),
        "online-faults": (
            online.fault_table,
            "Runs with faults. `refused` counts certified plans and stops that the dense check refuses; `unsaid` plans "
            "without a reason.",
        ),
    }[name]
    return [f"## {title.capitalize()}", text, table(rows)]


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
    made_by = []
    for name, (title, command) in SECTIONS.items():
        online = name.startswith("online-")
        rows = _online_rows(results, name) if online else _rows(results / f"{name}.csv")
        if not rows:
            continue
        made_by.append(f"[{title}](#{title.replace(',', '').replace(' ', '-')}) by `{command}`")
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
        f"How these figures were made: {', '.join(made_by)}; everything on one thread. All times depend on the "
        "machine: compare ratios within one run.",
        *sections,
    ]
    return "\n\n".join(parts) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page."""
    made = argparse.ArgumentParser(prog="python -m benchmarks.report", description=__doc__.splitlines()[0])
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
