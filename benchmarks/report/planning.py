"""Sections on planning: reference scenarios, many obstacles, random scenarios, vehicles of every size."""

from __future__ import annotations

from benchmarks import common  # isort: skip

from collections import Counter

import numpy as np

from benchmarks import sizes
from benchmarks.report.parts import COLORS, Figures, Row, families_of, median_of, of_family, value_of


def reference_part(rows: list[Row], figures: Figures) -> list[str]:
    """Section on the reference scenarios."""
    stages = [key for key in rows[0] if key.endswith("_ms") and key != "wall_ms"]
    lines = []
    for family in [*families_of(rows), "all"]:
        chosen = of_family(rows, family)
        ratios = [value_of(row, "ratio") for row in chosen]
        lines.append(
            [
                family,
                f"{sum(row['certified'] == '1' for row in chosen)}/{len(chosen)}",
                f"{sum(row['dense_check'] == '1' for row in chosen)}/{len(chosen)}",
                *(common.number(common.quantile(ratios, level), 5) for level in (0.5, 0.95)),
                sum(ratio < 1.0 for ratio in ratios),
                common.number(median_of(chosen, "iterations"), 0),
                common.number(median_of(chosen, "wall_ms"), 1),
                common.number(median_of(chosen, "wall_ms", 0.95), 1),
            ]
        )
    headings = ["family", "certified", "dense check", "time ratio", "ratio 95 %", "faster than best known"]
    headings += ["iterations", "wall ms", "wall ms 95 %"]
    families = families_of(rows)

    figure, (left, right) = figures.axes(8.0, 3.2, 2)
    for place, family in enumerate(families):
        excess = 100.0 * (np.array([value_of(row, "ratio") for row in of_family(rows, family)]) - 1.0)
        spread = np.linspace(-0.18, 0.18, excess.size)
        left.scatter(place + spread, excess, s=14, color=COLORS[0], alpha=0.8, linewidths=0)
    left.axhline(0.0, color="black", linewidth=0.8)
    left.set_xticks(range(len(families)), families, rotation=30, ha="right")
    left.set_ylabel("travel time against best known, %")
    bottom = np.zeros(len(families))
    for color, stage in zip(COLORS, stages, strict=False):
        heights = np.array([median_of(of_family(rows, family), stage) for family in families])
        right.bar(range(len(families)), heights, bottom=bottom, color=color, label=stage.removesuffix("_ms"))
        bottom += np.nan_to_num(heights)
    right.set_xticks(range(len(families)), families, rotation=30, ha="right")
    right.set_ylabel("median time of each stage, ms")
    right.legend()
    picture = figures.save(figure, "reference", "Travel times against the best known, and the time of each stage")
    return [
        "## Reference scenarios",
        "One call of `scp_planner.plan` each: search, SCP loop, certificate. *Time ratio* is the travel time "
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
        [median_of([row for row in rows if int(row["obstacles"]) == count], key) for count in counts]
        for key in ("wall_ms", "more_ms")
    )
    figure, axes = figures.axes(4.6, 3.0)
    for crowd in sorted({row["crowd"] for row in rows}):
        chosen = [row for row in rows if row["crowd"] == crowd]
        axes.plot(
            [int(row["obstacles"]) for row in chosen],
            [value_of(row, "wall_ms") for row in chosen],
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
    for family in [*families_of(rows), "all"]:
        chosen = of_family(rows, family)
        certified = [row for row in chosen if row["certified"] == "1"]
        others = Counter(row["status"] for row in chosen if row["certified"] != "1")
        lines.append(
            [
                family,
                len(chosen),
                f"{100.0 * len(certified) / len(chosen):.1f} %",
                ", ".join(f"{name} {number}" for name, number in others.most_common()),
                sum(row["dense_check"] != "1" for row in certified),
                common.number(median_of(chosen, "wall_ms"), 1),
                common.number(median_of(chosen, "wall_ms", 0.95), 1),
            ]
        )
    headings = ["family", "scenarios", "certified", "others", "certified but refused", "wall ms", "wall ms 95 %"]
    return [
        "## Random scenarios",
        f"{len(rows)} unseen scenarios from the generators in `benchmarks.families`; some have no "
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
        work = [value_of(row, "work_ms") / value_of(row, "reference_ms") for row in chosen]
        for axes, values in ((left, [100.0 * (value_of(row, "ratio") - 1.0) for row in chosen]), (right, work)):
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
        "units, with twice as many attempts, and with splines twice as fine; *by any* counts the scenes that one of "
        "these certifies. The work is processor time on one thread. The next column is its ratio to the median work of "
        "30 reference scenes with as many obstacles, on the same machine. *Over 3 times* counts the scenes above three "
        "times that median; *reference* counts them among as many reference scenes.",
        sizes.summary(rows),
        picture,
        "`python -m benchmarks.sizes`",
    ]
