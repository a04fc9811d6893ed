"""Coverage of confidence regions, measured by simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from scp_planner.arrays import Array
from scp_planner.tracking.confidence import LEVELS
from scp_planner.tracking.maximum_likelihood import estimate_motion
from scp_planner.tracking.motion_estimate import PolynomialEstimate, region_scale

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NOISE = np.array([[0.02, 0.009], [0.009, 0.01]])  # m^2, lopsided


@dataclass(frozen=True)
class Simulated:
    """Observations that coverage is simulated with."""

    leads: tuple[float, ...] = (0.0, 1.0, 5.0)  # s after the last observation, at which ``per_time`` is judged
    time_step: float = 0.1  # s
    span_times: int = 240  # At which "at all times" is judged, evenly spread in angle up to infinity
    chunk: int = 2_000  # Runs at once
    wilson: float = 1.959963984540054  # Standard normal quantile of a 95 % interval


SIMULATED = Simulated()


@dataclass(frozen=True)
class Coverage:
    """One measured coverage."""

    level: str
    covariance: str  # "known" or "estimated"
    order: int
    observations: int
    obstacles: int
    lead_time: float  # After the last observation, for ``per_time``; NaN where it is all times
    nominal: float
    coverage: float
    low: float  # Wilson's 95 % interval of the coverage
    high: float  # Wilson's 95 % interval of the coverage
    runs: int
    scale: float  # q of the regions


def measure_coverage(
    *,
    probability: float = 0.95,
    runs: int = 20_000,
    counts: Sequence[int] = (5, 6, 8, 10, 20, 50, 100),
    orders: Sequence[int] = (0, 1, 2),
    obstacles: int = 5,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> list[Coverage]:
    """Measure the coverage of every level, with the covariance known and estimated."""
    cases = [
        _Case(order, count, known, probability, obstacles)
        for order in orders
        for count in counts
        for known in (True, False)
        if count >= order + (1 if known else 3)
    ]
    results: list[Coverage] = []
    for number, case in enumerate(cases, start=1):
        # each case has its own stream, whatever other cases there are
        generator = np.random.default_rng([seed, case.order, case.count, case.known])
        results += _measure(case, runs, generator)
        if progress is not None:
            progress(number, len(cases))
    return results


def wilson_interval(successes: int, runs: int) -> tuple[float, float]:
    """Give Wilson's 95 % confidence interval of a probability."""
    share, z2 = successes / runs, SIMULATED.wilson**2
    middle = (share + 0.5 * z2 / runs) / (1.0 + z2 / runs)
    half = SIMULATED.wilson / (1.0 + z2 / runs) * math.sqrt(share * (1.0 - share) / runs + 0.25 * z2 / runs**2)
    return middle - half, middle + half


@dataclass(frozen=True)
class _Case:
    order: int
    count: int
    known: bool
    probability: float
    obstacles: int

    def times(self) -> Array:
        return np.asarray(np.arange(self.count) * SIMULATED.time_step, dtype=float)

    def estimate(self, positions: Array) -> PolynomialEstimate:
        return estimate_motion(self.times(), positions, _NOISE if self.known else None, self.order)


def _measure(case: _Case, runs: int, generator: np.random.Generator) -> Iterator[Coverage]:
    times = case.times()
    pattern = case.estimate(generator.multivariate_normal(np.zeros(2), _NOISE, case.count))
    start = float(times[-1])
    scales = {
        level: region_scale(level, case.probability, pattern, obstacles=case.obstacles, start=start) for level in LEVELS
    }
    inside_at, inside_span = np.zeros(len(SIMULATED.leads), dtype=int), {"per_obstacle": 0, "joint": 0}
    done = 0
    while done < runs:
        now = min(SIMULATED.chunk, runs - done)
        shape = (now * case.obstacles, case.count)
        errors = standardised_errors(
            pattern, times, generator.multivariate_normal(np.zeros(2), _NOISE, shape), known=case.known
        )
        first = errors[:: case.obstacles]  # one obstacle of each run, for the levels that are about one
        for i, lead in enumerate(SIMULATED.leads):
            inside_at[i] += int(
                np.count_nonzero(squares_at(pattern, first, np.array([start + lead]))[:, 0] <= scales["per_time"])
            )
        worst = squares_at(pattern, errors, _span(pattern, start)).max(axis=1)
        inside_span["per_obstacle"] += int(np.count_nonzero(worst[:: case.obstacles] <= scales["per_obstacle"]))
        of_run = worst.reshape(now, case.obstacles).max(axis=1)
        inside_span["joint"] += int(np.count_nonzero(of_run <= scales["joint"]))
        done += now
    for lead, inside in zip(SIMULATED.leads, inside_at.tolist(), strict=True):
        yield _coverage(case, "per_time", lead, inside, runs, scales["per_time"])
    for level, inside in inside_span.items():
        yield _coverage(case, level, math.nan, inside, runs, scales[level])


def standardised_errors(pattern: PolynomialEstimate, times: Array, noise: Array, *, known: bool) -> Array:
    """Estimate from many sets of noise at once; give the coefficients' errors, standardised by the noise covariance."""
    rows = ((times - pattern.center_time) / pattern.time_scale)[:, None] ** np.arange(pattern.order + 1)
    errors = np.linalg.pinv(rows) @ noise
    if known:
        root = np.linalg.cholesky(_NOISE)
    else:
        residuals = noise - rows @ errors
        degrees = rows.shape[0] - rows.shape[1]
        root = np.linalg.cholesky(np.swapaxes(residuals, 1, 2) @ residuals / degrees)
    return np.swapaxes(np.linalg.solve(root, np.swapaxes(errors, 1, 2)), 1, 2)


def squares_at(pattern: PolynomialEstimate, errors: Array, times: Array) -> Array:
    """Give z' C(t)^-1 z of each run's error at each time, which may be infinite: (runs, times)."""
    angles = np.arctan((times - pattern.center_time) / pattern.time_scale)
    powers = np.arange(pattern.order + 1)
    rows = np.sin(angles)[:, None] ** powers * np.cos(angles)[:, None] ** (pattern.order - powers)
    # h(t) Sigma is the covariance, and Sigma is in the standardised errors already
    spread = pattern.coefficient_covariance[:, 0, :, 0] / pattern.noise_covariance[0, 0]
    rows /= np.sqrt(np.einsum("tj,jk,tk->t", rows, spread, rows))[:, None]
    at = rows @ errors
    return np.einsum("rta,rta->rt", at, at)


def _span(pattern: PolynomialEstimate, start: float) -> Array:
    """Give times from start to infinity, evenly spread in angle."""
    if pattern.order == 0:
        return np.array([start])
    first = math.atan((start - pattern.center_time) / pattern.time_scale)
    angles = np.linspace(first, 0.5 * math.pi, SIMULATED.span_times)
    times = pattern.center_time + pattern.time_scale * np.tan(angles)
    times[-1] = math.inf
    return times


def _coverage(case: _Case, level: str, lead: float, inside: int, runs: int, scale: float) -> Coverage:
    low, high = wilson_interval(inside, runs)
    return Coverage(
        level=level,
        covariance="known" if case.known else "estimated",
        order=case.order,
        observations=case.count,
        obstacles=case.obstacles if level == "joint" else 1,
        lead_time=lead,
        nominal=case.probability,
        coverage=inside / runs,
        low=low,
        high=high,
        runs=runs,
        scale=scale,
    )


def summary(results: Sequence[Coverage]) -> str:
    """Tabulate, for each level and covariance, the least and the greatest coverage and where they are."""
    lines = [f"{'level':<13}{'covariance':<11}{'nominal':>8}  {'least':<28}{'greatest':<28}"]
    for level in LEVELS:
        for covariance in ("known", "estimated"):
            own = [r for r in results if (r.level, r.covariance) == (level, covariance)]
            if own:
                ends = (min(own, key=lambda r: r.coverage), max(own, key=lambda r: r.coverage))
                texts = [f"{r.coverage:.4f} (order {r.order}, n = {r.observations})" for r in ends]
                lines.append(f"{level:<13}{covariance:<11}{own[0].nominal:>8g}  {texts[0]:<28}{texts[1]:<28}")
    return "\n".join(lines)


def plot_coverage(results: Sequence[Coverage], path: str | PathLike[str] | None = None) -> Figure:
    """Draw coverage against the number of observations: a column for each level, a row for each covariance."""
    from matplotlib.figure import Figure

    from scp_planner.plotting.style import COLOURS, DPI, GREY, save, style

    with style():
        figure = Figure(figsize=(9.6, 6.8), dpi=DPI, layout="constrained")
        grid = figure.subplots(2, len(LEVELS), sharex=True, sharey=True)
        for row, covariance in zip(grid, ("known", "estimated"), strict=True):
            for axes, level in zip(row, LEVELS, strict=True):
                own = [r for r in results if (r.level, r.covariance) == (level, covariance)]
                for order in sorted({r.order for r in own}):
                    # of the moments that per_time is judged at, the last
                    last = {r.observations: r for r in own if r.order == order}
                    rows = sorted(last.values(), key=lambda r: r.observations)
                    middle = np.array([r.coverage for r in rows])
                    bars = np.array([[r.coverage - r.low, r.high - r.coverage] for r in rows]).T.clip(
                        min=0.0
                    )  # rounding
                    counts = [r.observations * (1.0 + 0.03 * (order - 1)) for r in rows]  # side by side
                    axes.errorbar(
                        counts,
                        middle,
                        bars,
                        color=COLOURS[order],
                        marker="o",
                        markersize=3,
                        lw=1,
                        label=f"order {order}",
                    )
                for r in own[:1]:
                    axes.axhline(r.nominal, color=GREY, lw=0.8, zorder=0)
                axes.set_title(f"{level}, covariance {covariance}")
                axes.set_xscale("log")
                ticks = sorted({r.observations for r in results})
                axes.set_xticks(ticks, [str(tick) for tick in ticks], minor=False)
                axes.minorticks_off()
        for axes in grid[-1]:
            axes.set_xlabel("observations")
        for axes in grid[:, 0]:
            axes.set_ylabel("coverage")
        grid[0, 0].legend()
        nominal = results[0].nominal
        low, high = min(r.low for r in results), max(r.high for r in results)
        grid[0, 0].set_ylim(min(low, nominal - 0.01), max(high, min(1.0, nominal + 0.03)))
        return save(figure, path)
