"""How long estimates take: batch and recursive, one obstacle and hundreds.

    python -m benchmarks.estimation                 a table and a CSV file
    python -m benchmarks.estimation --repeat 2000

Times are medians and 99 % quantiles of single calls on one thread. One recursive update of 200 obstacles is to take
under 0.2 ms, and a frame, one observation of each of 200 obstacles with all that is noticed, under 1 ms.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import argparse
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from itertools import count
from pathlib import Path
from time import perf_counter

import numpy as np

import scp_planner as sp
from scp_planner.prediction import sensor_frames
from scp_planner.prediction.obstacle_tracks import ObstacleTracks
from scp_planner.prediction.track import Seen
from scp_planner.scenario.process_model import ProcessModel
from scp_planner.tracking.dynamics import dynamics_of
from scp_planner.tracking.kalman import estimate_process, first_state, update_state
from scp_planner.tracking.maximum_likelihood import estimate_motion
from scp_planner.tracking.motion_estimate import region_scale
from scp_planner.tracking.recursive import RecursiveEstimator

OBSTACLES = (1, 60, 200, 1000)
FRAME_NOISE = 0.1  # m
LEARNT, MOST_FRAMES = 40, 500  # frames that are taken in before, and at most, one after the other
SIGMA = np.array([[0.01, 0.002], [0.002, 0.01]])
WALKERS = ProcessModel(process={"kind": "random_walk", "diffusion": 0.05}, velocity_deviation=1.0, noise_deviation=0.05)


@dataclass(frozen=True)
class Times:
    """Of single calls, s."""

    median: float
    rare: float
    """Longer than 99 % of them."""


def measure(call: Callable[[], object], repeat: int) -> Times:
    """Measure single calls."""
    times = []
    for _ in range(repeat):
        began = perf_counter()
        call()
        times.append(perf_counter() - began)
    return Times(*np.quantile(times, (0.5, 0.99)).tolist())


def updates(kind: str, obstacles: int) -> Callable[[], object]:
    """Give a call that updates all obstacles once, later each time."""
    positions = np.random.default_rng(0).normal(size=(1000, obstacles, 2))
    if kind == "random walk":
        return filtered_updates(positions)
    covariance = None
    if kind == "covariances vary":
        estimator = RecursiveEstimator(obstacles, 2, varying=True)
        covariance = np.broadcast_to(SIGMA, (obstacles, 2, 2))
    else:
        estimator = RecursiveEstimator(obstacles, 2, SIGMA if kind == "covariance known" else None)
    steps = count()

    def update() -> None:
        step = next(steps)
        estimator.update(0.1 * step, positions[step % 1000], covariance)

    return update


def filtered_updates(positions: np.ndarray) -> Callable[[], object]:
    """Give a call that updates the filters of all obstacles once, later each time."""
    dynamics, obstacles, steps = dynamics_of(WALKERS), positions.shape[1], count(1)
    noise = np.broadcast_to(SIGMA, (obstacles, 2, 2))
    state = first_state(dynamics, WALKERS.velocity_deviation**2, np.zeros(obstacles), positions[0], noise)

    def update() -> None:
        step = next(steps)
        update_state(dynamics, state, np.full(obstacles, 0.1 * step), positions[step % 1000], noise)

    return update


def observed_frames(kind: str, obstacles: int) -> Callable[[], object]:
    """Give a call that takes in one observation of each obstacle; calm ones move as predicted, restless ones do not."""
    rng = np.random.default_rng(0)
    tracks, names = ObstacleTracks(sp.Confidence()), [f"o{number}" for number in range(obstacles)]
    for name in names:
        tracks.add_unseen(name, sp.Disc(disc=0.3), sp.Model(order=2), 0.0, FRAME_NOISE**2 * np.eye(2))
    start, velocity = 10.0 * rng.normal(size=(obstacles, 2)), rng.normal(size=(obstacles, 2))
    steps = count()

    def course(time: float) -> list[Seen]:
        sway = 0.3 * np.sin(2.0 * time) if kind == "restless" else 0.0
        places = start + velocity * time + sway + FRAME_NOISE * rng.normal(size=(obstacles, 2))
        return [Seen(time, (x, y)) for x, y in places.tolist()]

    made = [course(0.1 * step) for step in range(LEARNT + MOST_FRAMES)]
    for step in range(LEARNT):
        sensor_frames.take_in(tracks, names, made[step])
    return lambda: sensor_frames.take_in(tracks, names, made[LEARNT + next(steps)])


def cases() -> Iterator[tuple[str, str, int, Callable[[], object]]]:
    """Give what is measured: operation, variant, obstacles, call."""
    for kind in ("covariance known", "covariance estimated", "covariances vary", "random walk"):
        for obstacles in OBSTACLES:
            yield "recursive update", kind, obstacles, updates(kind, obstacles)
    for kind in ("calm", "restless"):
        for obstacles in OBSTACLES:
            yield "frame of observations", kind, obstacles, observed_frames(kind, obstacles)
    times = 0.4 * np.arange(8)
    positions = np.random.default_rng(1).normal(size=(8, 2))
    for order in (0, 1, 2):
        yield (
            "batch estimate of 8",
            f"order {order}",
            1,
            partial(estimate_motion, times, positions, SIGMA, order),
        )
    each = np.broadcast_to(SIGMA, (8, 2, 2))
    yield "batch estimate of 8", "covariances vary", 1, lambda: estimate_motion(times, positions, each)
    yield "batch estimate of 8", "random walk", 1, lambda: estimate_process(times, positions, WALKERS)
    quadratic, walker = estimate_motion(times, positions, SIGMA), estimate_process(times, positions, WALKERS)
    for name, estimate, stop in (("quadratic", quadratic, float("inf")), ("random walk", walker, 20.0)):
        yield "polynomials over 17 s", name, 1, partial(estimate.polynomials, 2.8, 20.0)
        for level in ("per_time", "joint"):
            yield (
                f"region scale, {level}",
                name,
                1,
                partial(region_scale, level, 0.95, estimate, obstacles=5, start=2.8, stop=stop),
            )


def main() -> None:
    """Measure, print a table and write a CSV file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repeat", type=int, default=500, help="calls of which the median is taken")
    parser.add_argument("-o", "--output", type=Path, default=common.DEFAULT_OUTPUT, help="folder for estimation.csv")
    chosen = parser.parse_args()
    rows = []
    for operation, variant, obstacles, call in cases():
        found = measure(call, min(chosen.repeat, MOST_FRAMES) if "frame" in operation else chosen.repeat)
        rows.append({"operation": operation, "variant": variant, "obstacles": obstacles, **asdict(found)})
        print(f"{operation:<24}{variant:<22}{obstacles:>6}{1e3 * found.median:>10.3f} ms{1e3 * found.rare:>10.3f} ms")
    common.write_csv(chosen.output / "estimation.csv", rows)


if __name__ == "__main__":
    main()
