"""Figures of the consistency study and of the comparison of methods."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from scp_planner.baseline.comparison import best_times
from scp_planner.plotting.style import COLOURS, DOTTED, DPI, GREY, save, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from scp_planner.baseline.comparison import Trial
    from scp_planner.baseline.methods import Method
    from scp_planner.studies.consistency import ConsistencyResult
    from scp_planner.studies.field import BorderPoint, Metric, ZoneKind

PANEL = (2.7, 2.9)  # inches
SHOWN = ("sup_difference", "offsets", "motion", "excess")
FIRST = {"evaluations": 1.0, "seconds": 1e-3}
"""First value of the axes of convergence curves."""

LEAST_GAP = 1e-5  # relative; convergence curves end here


def plot_consistency(result: ConsistencyResult, path: str | PathLike[str] | None = None) -> Figure:
    """Draw the means of the study against n on log-log axes, with confidence bands and fitted slopes."""
    from matplotlib.figure import Figure

    from scp_planner.studies.field import METRICS, ZoneKind

    metrics = [metric for metric in METRICS if metric.name in SHOWN]
    kinds = list(ZoneKind)
    with style():
        size = (PANEL[0] * len(metrics), PANEL[1] * len(kinds))
        figure = Figure(figsize=size, dpi=DPI, layout="constrained")
        panels = figure.subplots(len(kinds), len(metrics), sharex=True, squeeze=False)
        for row, kind in zip(panels, kinds, strict=True):
            for axes, metric in zip(row, metrics, strict=True):
                _draw_metric(axes, result, kind, metric)
            row[0].set_ylabel(f"zones: {kind.value}\n{row[0].get_ylabel()}")
        for axes in panels[-1]:
            axes.set_xlabel("observations n")
        return save(figure, path)


def _draw_metric(axes: Axes, result: ConsistencyResult, kind: ZoneKind, metric: Metric) -> None:
    sizes = np.array(result.settings.sizes, dtype=float)
    last = []
    for colour, noise in zip(COLOURS, result.settings.noises, strict=False):
        rows = [m for m in result.means if (m.kind, m.noise, m.metric) == (kind.value, noise, metric.name)]
        slope = result.settled_slope(kind, noise, metric)
        fitted = "" if slope is None else f": slope {slope.slope:.2f}, n ≥ {slope.from_size}"
        axes.plot(sizes, [m.mean for m in rows], "o-", color=colour, ms=3, lw=1, label=f"{noise:g} m{fitted}")
        axes.fill_between(sizes, [m.lower for m in rows], [m.upper for m in rows], color=colour, alpha=0.2, lw=0)
        last.append(rows[-1].mean)
        if metric.of_minimiser:
            same = result.same_way_means(kind, noise, metric)
            axes.plot(list(same), list(same.values()), "o", color=colour, mfc="white", ms=3, mew=0.7, zorder=3)
    middle = np.exp(np.mean(np.log(last)))
    theory = middle * (sizes / sizes[-1]) ** metric.exponent
    axes.plot(sizes, theory, ls=DOTTED, color=GREY, lw=1, label=f"theory: slope {metric.exponent:g}")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylabel(metric.label)
    axes.legend(fontsize=7.0, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)


def plot_border(points: Sequence[BorderPoint], path: str | PathLike[str] | None = None) -> Figure:
    """Draw travel time and its slope near the border of the domain."""
    from matplotlib.figure import Figure

    with style():
        figure = Figure(figsize=(2.2 * PANEL[0], 0.9 * PANEL[1]), dpi=DPI, layout="constrained")
        left, right = figure.subplots(1, 2)
        for colour, speed in zip(COLOURS, dict.fromkeys(point.start_speed for point in points), strict=False):
            mine = [point for point in points if point.start_speed == speed and point.distance > 0.0]
            distances = [point.distance for point in mine]
            label = f"$v_0$ = {speed:g} m/s"
            left.plot(distances, [point.travel_time for point in mine], "o-", color=colour, ms=3, lw=1, label=label)
            right.plot(distances, [-point.slope for point in mine], "o-", color=colour, ms=3, lw=1, label=label)
        for axes, text in ((left, "travel time τ (s)"), (right, "-dτ / da (s³/m)")):
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_xlabel("acceleration a above the border (m/s²)")
            axes.set_ylabel(text)
        left.legend()
        return save(figure, path)


def plot_comparison(trials: Sequence[Trial], path: str | PathLike[str] | None = None) -> Figure:
    """Draw how the methods converge, and what each trial cost and gave."""
    from matplotlib.figure import Figure

    methods = list(dict.fromkeys(trial.method for trial in trials))
    with style():
        figure = Figure(figsize=(3.9 * PANEL[0], 1.15 * PANEL[1]), dpi=DPI, layout="constrained")
        by_evaluations, by_time, outcome = figure.subplots(1, 3)
        _draw_convergence(by_evaluations, trials, methods, "evaluations")
        _draw_convergence(by_time, trials, methods, "seconds")
        by_evaluations.set_xlabel("evaluations")
        by_evaluations.set_ylabel("merit above the best, relative")
        by_time.set_xlabel("wall time (s)")
        _draw_outcomes(outcome, trials, methods)
        handles, labels = by_time.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
        return save(figure, path)


def _draw_convergence(axes: Axes, trials: Sequence[Trial], methods: Sequence[Method], against: str) -> None:
    least: dict[tuple[str, int], float] = {}
    for trial in trials:
        key = trial.scenario, trial.start
        least[key] = min(least.get(key, np.inf), float(trial.curve.merit[-1]))
    for colour, method in zip(COLOURS, methods, strict=False):
        mine = [trial for trial in trials if trial.method is method]
        first = FIRST[against]
        abscissae = [np.maximum(getattr(trial.curve, against), first) for trial in mine]
        grid = np.geomspace(first, max(x[-1] for x in abscissae) + first, 200)
        gaps = np.array(
            [
                (trial.curve.merit[np.maximum(np.searchsorted(x, grid, "right") - 1, 0)]) / least[key] - 1.0
                for trial, x in zip(mine, abscissae, strict=True)
                for key in [(trial.scenario, trial.start)]
            ]
        )
        low, middle, high = np.maximum(np.quantile(gaps, [0.25, 0.5, 0.75], axis=0), LEAST_GAP)
        axes.plot(grid, middle, color=colour, lw=1.2, label=method.value)
        axes.fill_between(grid, low, high, color=colour, alpha=0.2, lw=0)
    axes.set_xscale("log")
    axes.set_yscale("log")


def _draw_outcomes(axes: Axes, trials: Sequence[Trial], methods: Sequence[Method]) -> None:
    best = best_times(trials)
    excess = {
        id(trial): max(trial.travel_time / best[trial.scenario] - 1.0, LEAST_GAP) for trial in trials if trial.certified
    }
    top = 2.0 * max(excess.values(), default=1.0)
    for colour, method in zip(COLOURS, methods, strict=False):
        mine = [trial for trial in trials if trial.method is method]
        done = [trial for trial in mine if trial.certified]
        failed = [trial for trial in mine if not trial.certified]
        options: dict[str, Any] = {"color": colour, "ls": "", "ms": 4, "alpha": 0.7}
        axes.plot([trial.wall_time for trial in done], [excess[id(trial)] for trial in done], "o", mew=0, **options)
        axes.plot([trial.wall_time for trial in failed], [top] * len(failed), "x", **options)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("wall time of a trial (s)")
    axes.set_ylabel("travel time above the best, relative")
