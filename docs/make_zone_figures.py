"""Draws the figures of `explanation/zones.md` anew: `python -m docs.make_zone_figures`, at the root.

Those of real people need the recorded data: set SCP_PLANNER_DATA to their folder.
"""

from __future__ import annotations

import logging
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from docs.make_gallery import shrink
from scp_planner.plotting.style import COLOURS, GREY, INK, save, style
from scp_planner.scenario.process_model import ProcessModel
from scp_planner.studies.coverage import measure_coverage, plot_coverage
from scp_planner.studies.recorded import RecordedCoverage, measure_recorded_coverage
from scp_planner.tracking.confidence import LEVELS
from scp_planner.tracking.kalman import estimate_process
from scp_planner.tracking.maximum_likelihood import MotionPrior, estimate_motion
from scp_planner.tracking.motion_estimate import MotionEstimate, region_scale
from scp_planner.tracking.tracks import Tracks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FIGURES = Path(__file__).parent / "figures"
DPI = 130
NOISE = 0.1  # m
TIMES = 0.1 * np.arange(-19, 1)  # s; 2 s of 10 Hz
VELOCITY = np.array([1.2, 0.0])
WALKER = ProcessModel(process={"kind": "random_walk", "diffusion": 0.05}, velocity_deviation=1.0, noise_deviation=NOISE)
PRIOR = MotionPrior(acceleration_deviation=0.1)


def main() -> None:
    """Write every figure; those of real people only where their recordings are."""
    with style():
        draw_growth()
        draw_models()
    plot_coverage(measure_coverage(), FIGURES / "coverage.png")
    folder = os.environ.get("SCP_PLANNER_DATA")
    if folder is None:
        logging.warning("no figure of real people: SCP_PLANNER_DATA is not set")
    else:
        with style():
            draw_recorded(Path(folder) / "pedestrians")
    for name in ("coverage", "zones_growth", "zones_models", *([] if folder is None else ["zones_people"])):
        shrink(FIGURES / f"{name}.png", FIGURES / f"{name}.png")


def seen(count: int = len(TIMES)) -> np.ndarray:
    """Observations of an obstacle that moves to the right: (count, 2) m."""
    rng = np.random.default_rng(4)
    return (TIMES[:, None] * VELOCITY + NOISE * rng.normal(size=(len(TIMES), 2)))[-count:]


def radius(estimate: MotionEstimate, leads: np.ndarray, level: str = "joint", stop: float = 5.0) -> np.ndarray:
    """Radius of the regions at times after the last observation, of five obstacles; geometric mean of the axes, m."""
    scale = region_scale(level, 0.95, estimate, obstacles=5, start=0.0, stop=stop)
    return np.sqrt(scale * np.sqrt(np.linalg.det(estimate.covariance(leads))))


def draw_growth() -> None:
    """How large the zones are over time: by order, by level, by what is known of the noise."""
    figure = Figure(figsize=(10.0, 3.4), dpi=DPI, layout="constrained")
    orders, levels, counts = figure.subplots(1, 3)
    leads, sigma = np.linspace(0.0, 5.0, 101), NOISE**2 * np.eye(2)
    for order, name in enumerate(("standing", "constant velocity", "constant acceleration")):
        estimate = estimate_motion(TIMES, seen(), sigma, order)
        orders.plot(leads, radius(estimate, leads), color=COLOURS[order], label=name)
    held = estimate_motion(TIMES, seen(), sigma, 2, PRIOR)
    orders.plot(leads, radius(held, leads), color=COLOURS[2], ls="--", label="... prior 0.1 m/s²")
    orders.set_title("motion (level joint)")
    quadratic = estimate_motion(TIMES, seen(), sigma)
    for level, colour in zip(LEVELS, COLOURS[3:], strict=False):
        levels.plot(leads, radius(quadratic, leads, level), color=colour, label=level)
    levels.set_title("level (constant acceleration)")
    for count, colour in zip((20, 10, 6), COLOURS, strict=False):
        times, positions = TIMES[-count:], seen(count)
        for noise, line in (("known", "-"), ("isotropic", "--"), ("general", ":")):
            given = sigma if noise == "known" else None
            estimate = estimate_motion(times, positions, given, 1, noise="general" if given is not None else noise)
            counts.plot(leads, radius(estimate, leads), color=colour, ls=line, label=f"n = {count}, {noise}")
    counts.set_title("noise covariance (constant velocity)")
    counts.set_ylim(bottom=0.0)
    for axes in (orders, levels, counts):
        axes.set_xlabel("time after the last observation (s)")
        axes.set_xlim(0.0, 5.0)
        axes.legend(fontsize=7, loc="upper left")
    orders.set_yscale("log")
    orders.set_ylabel("radius of the region (m)")
    save(figure, FIGURES / "zones_growth.png")


def draw_models() -> None:
    """The regions of one obstacle in the plane, by what its motion is taken for."""
    figure = Figure(figsize=(10.0, 7.2), dpi=DPI, layout="constrained")
    sigma, ahead = NOISE**2 * np.eye(2), (0.0, 1.0, 2.0, 3.0)
    estimates: list[tuple[str, MotionEstimate]] = [
        ("constant velocity", estimate_motion(TIMES, seen(), sigma, 1)),
        ("constant acceleration", estimate_motion(TIMES, seen(), sigma, 2)),
        ("constant acceleration, prior 0.1 m/s²", estimate_motion(TIMES, seen(), sigma, 2, PRIOR)),
        ("random walk of the velocity", estimate_process(TIMES, seen(), WALKER)),
    ]
    for axes, (name, estimate) in zip(figure.subplots(2, 2, sharex=True, sharey=True).ravel(), estimates, strict=True):
        axes.plot(*seen().T, ".", color=GREY, ms=3, label="observed")
        path = estimate.position(np.linspace(0.0, 3.0, 31))
        axes.plot(*path.T, color=INK, lw=0.8, label="expected")
        scale = region_scale("joint", 0.95, estimate, obstacles=5, start=0.0, stop=5.0)
        for t, colour in zip(ahead, COLOURS, strict=False):
            draw_region(axes, estimate, t, scale, colour)
        axes.set_title(name)
        axes.set_aspect("equal")
    axes.set_xlim(-3.0, 8.0)
    axes.set_ylim(-4.0, 4.0)
    for row in figure.axes[2:]:
        row.set_xlabel("x (m)")
    figure.axes[0].set_ylabel("y (m)")
    figure.axes[2].set_ylabel("y (m)")
    figure.axes[0].legend(loc="lower right")
    save(figure, FIGURES / "zones_models.png")


def draw_region(axes: Axes, estimate: MotionEstimate, t: float, scale: float, colour: str) -> None:
    """Draw the ellipse of one time."""
    angles = np.linspace(0.0, 2.0 * math.pi, 121)
    root = np.linalg.cholesky(scale * estimate.covariance(t))
    outline = estimate.position(t) + np.stack([np.cos(angles), np.sin(angles)], axis=1) @ root.T
    axes.fill(*outline.T, color=colour, alpha=0.15, lw=0)
    axes.plot(*outline.T, color=colour, lw=1.0, label=f"{t:g} s")


def draw_recorded(folder: Path) -> None:
    """Coverage and size of the regions of real people."""
    figure = Figure(figsize=(10.0, 5.6), dpi=DPI, layout="constrained")
    grid = figure.subplots(2, 3, sharex=True, sharey="row")
    looks = {
        "random_walk": ("random walk, fitted", COLOURS[0], "-"),
        "mean_reverting": ("mean-reverting, fitted", COLOURS[2], "-"),
        "quadratic": ("constant acceleration, believed", COLOURS[3], "-"),
        "linear": ("constant velocity, believed", COLOURS[1], "-"),
        "quadratic, inflated": ("constant acceleration, inflated", COLOURS[3], ":"),
        "linear, inflated": ("constant velocity, inflated", COLOURS[1], ":"),
    }
    for (above, below), name in zip(grid.T, ("eth", "hotel", "univ"), strict=True):
        results = measure_recorded_coverage(Tracks.load(folder / f"{name}_obsmat.txt"), data=name)
        for model, (label, colour, line) in looks.items():
            own: list[RecordedCoverage] = [r for r in results if (r.model, r.level, r.fold) == (model, "per_time", 2)]
            leads = [r.lead_time for r in own]
            if line == "-":
                errors = [100 * 2 * r.error for r in own]
                above.errorbar(
                    leads, [100 * r.coverage for r in own], errors, color=colour, marker="o", ms=3, label=label
                )
            if line == ":" or own[0].coverage > 0.9:
                below.plot(leads, [r.radius for r in own], color=colour, ls=line, marker="o", ms=3, label=label)
        above.axhspan(93.0, 97.0, color=GREY, alpha=0.2, lw=0)
        above.set_title(name.upper())
        below.set_xlabel("time after the last observation (s)")
    grid[0, 0].set_ylabel("coverage (%), nominal 95")
    grid[1, 0].set_ylabel("radius of the regions (m)")
    handles = dict(zip(*reversed(grid[1, 0].get_legend_handles_labels()), strict=True))
    handles |= dict(zip(*reversed(grid[0, 0].get_legend_handles_labels()), strict=True))
    figure.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=3, fontsize=8)
    save(figure, FIGURES / "zones_people.png")


if __name__ == "__main__":
    main()
