"""Sections on other methods."""

from __future__ import annotations

from benchmarks import common  # isort: skip

from collections.abc import Sequence

import numpy as np

from benchmarks.report.parts import COLORS, Figures, Row, families_of, median_of, of_family, value_of

REFERENCE = "scp_planner.plan"
ONE_RUN = "scp_planner one run"
NLP = "casadi-ipopt"
EQUAL = 1e-3  # relative difference of travel times that does not count


def peers_part(rows: list[Row], starts: list[Row], figures: Figures) -> list[str]:
    """Section on other methods."""
    from benchmarks.peers.base import JUDGE
    from benchmarks.peers.starts import TEN_STARTS

    plans = {row["scenario"]: row for row in rows if row["method"] == REFERENCE}
    pairs = list(dict.fromkeys((row["method"], row["start_set"]) for row in rows))
    return [
        "## Other methods",
        "All methods plan the same scenarios, in the same process and order, on one thread, from the same "
        f"{len(TEN_STARTS)} starts: arc initial guesses to both sides, and a slow start. *One* is the first of them; "
        "*ten* takes the best answer and adds up the times. `scp_planner.plan` chooses its starts itself. Building "
        "(compiling, symbolic differentiation) is not counted.",
        "An answer counts as *certified* if the method itself calls it a success and the independent check, with the "
        f"same tolerances for all, agrees: {1e3 * JUDGE.clearance:g} mm of clearance, "
        f"{1e3 * JUDGE.position:g} mm at the ends, {JUDGE.speed:g} m/s, {JUDGE.acceleration:g} m/s2, "
        f"{JUDGE.curvature:g} 1/m.",
        *speed_part(rows, starts),
        *certified_part(rows),
        "Medians of the wall time over that of `scp_planner.plan` on the same scenario, by family; the median wall "
        "time in ms; and the median travel time over that of `scp_planner.plan`.",
        _times(rows, pairs, plans),
        "### Each start by itself",
        _by_start(starts),
        peers_figure(rows, pairs, plans, figures),
        "`python -m benchmarks.peers`; the peers are an optional extra, `pip install scp-planner[peers]`.",
    ]


def _times(rows: list[Row], pairs: list[tuple[str, str]], plans: dict[str, Row]) -> str:
    """Table of times over those of the planner on the same scenario: wall times by family, travel times of all."""
    families = [*families_of(rows), "all"]
    lines = []
    for method, start_set in pairs:
        chosen = [row for row in rows if (row["method"], row["start_set"]) == (method, start_set)]
        walls = [common.number(_ratio(of_family(chosen, family), plans, "wall_ms"), 1) for family in families]
        travel = common.number(_ratio(chosen, plans, "travel_time"), 5)
        lines.append([method, start_set, *walls, common.number(median_of(chosen, "wall_ms"), 1), travel])
    return common.table(["method", "starts", *families, "wall ms", "travel time"], lines)


def _ratio(rows: list[Row], plans: dict[str, Row], key: str) -> float:
    pairs = [(row, plans[row["scenario"]]) for row in rows if row["scenario"] in plans]
    return common.median(value_of(row, key) / value_of(plan, key) for row, plan in pairs)


def _by_start(starts: list[Row]) -> str:
    """Results of single starts, by method."""
    lines = []
    for method in dict.fromkeys(row["method"] for row in starts):
        chosen = [row for row in starts if row["method"] == method]
        lines.append(
            [
                method,
                str(len(chosen)),
                common.number(median_of(chosen, "wall_ms"), 1),
                common.number(median_of(chosen, "wall_ms", 0.95), 1),
                *(
                    f"{100.0 * sum(row[verdict] == '1' for row in chosen) / len(chosen):.0f} %"
                    for verdict in ("certified", "checked")
                ),
            ]
        )
    return common.table(["method", "starts", "wall ms a start", "wall ms 95 %", "certified", "checked"], lines)


def speed_part(rows: list[Row], starts: list[Row]) -> list[str]:
    """Wall times against the nonlinear program, start by start, and of its best answer against a whole plan."""
    parts = []
    walls = {_start_key(row): value_of(row, "wall_ms") for row in starts}
    ratios = [
        wall / walls[ONE_RUN, *key]
        for (method, *key), wall in walls.items()
        if method == NLP and (ONE_RUN, *key) in walls
    ]
    if ratios:
        low, middle, high = (common.quantile(ratios, level) for level in (0.1, 0.5, 0.9))
        parts.append(
            f"- **A start**: `{NLP}` takes {middle:.1f} times as long as one run of scp_planner from the same start "
            f"(median of {len(ratios)} pairs; 10 % and 90 % quantiles {low:.1f} and {high:.1f})."
        )
    plans = {row["scenario"]: row for row in rows if row["method"] == REFERENCE}
    tens = [row for row in rows if row["method"] == NLP and row["start_set"] == "ten" and row["scenario"] in plans]
    pairs = [(row, plans[row["scenario"]]) for row in tens]
    if pairs:
        wall = common.median(value_of(row, "wall_ms") / value_of(plan, "wall_ms") for row, plan in pairs)
        both = [(row, plan) for row, plan in pairs if row["certified"] == plan["certified"] == "1"]
        times = [value_of(row, "travel_time") / value_of(plan, "travel_time") for row, plan in both]
        parts.append(
            f"- **The best of ten starts**: `{NLP}` takes {wall:.0f} times as long as `plan()` (median of {len(pairs)} "
            f"scenarios). Where both answers are certified, in {len(both)}, its travel time is {_middle(times)} "
            f"times that of `plan()` (median); it is longer by more than {100 * EQUAL:g} % in "
            f"{sum(time > 1.0 + EQUAL for time in times)}, shorter by more than that in "
            f"{sum(time < 1.0 - EQUAL for time in times)}."
        )
    return ["\n".join(parts)] if parts else []


def _start_key(row: Row) -> tuple[str, ...]:
    return row["method"], row["scenario"], row["bow"], row["speed_share"]


def _middle(ratios: Sequence[float]) -> str:
    return common.number(common.median(ratios), 5)


def certified_part(rows: list[Row]) -> list[str]:
    """Rates of certified answers, family by family; and where only one of a method and the planner has one."""
    families = families_of(rows)
    plans = {row["scenario"]: row["certified"] for row in rows if row["method"] == REFERENCE}
    lines = []
    for method, start_set in dict.fromkeys((row["method"], row["start_set"]) for row in rows):
        mine = [row for row in rows if (row["method"], row["start_set"]) == (method, start_set)]
        pairs = [(row["certified"], plans[row["scenario"]]) for row in mine if row["scenario"] in plans]
        counts = []
        for family in [*families, "all"]:
            chosen = of_family(mine, family)
            counts.append(f"{sum(row['certified'] == '1' for row in chosen)}/{len(chosen)}" if chosen else None)
        checked = f"{sum(row['checked'] == '1' for row in mine)}/{len(mine)}"
        only = [pairs.count(pair) for pair in (("0", "1"), ("1", "0"))]
        lines.append([method, start_set, *counts, checked, *(only if method != REFERENCE else (None, None))])
    headings = ["method", "starts", *families, "all", "checked", "only plan()", "only this one"]
    return [
        "Scenarios with a certified answer; *checked*: with an answer that passes the check, even if the method does "
        "not call it a success; *only plan()* and *only this one*: scenarios that only one of both certifies.",
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
                value_of(row, "wall_ms") / value_of(plans[row["scenario"]], "wall_ms"),
                100.0 * (value_of(row, "travel_time") / value_of(plans[row["scenario"]], "travel_time") - 1.0),
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
