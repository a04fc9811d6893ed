"""What standing polygons cost: the same 30 near and far ones, and with 270 more about them; one with hundreds of edges.

    python -m benchmarks.shapes [--repeats N]

All scenes need the same way round. Times are the least of several plans, in ms, by part.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.families import VEHICLE

TRIP = 30.0  # m
NEAR, FAR = (4.0, 14.0), (14.0, 60.0)  # m to the sides of the trip


def polygon(rng: np.random.Generator, size: float) -> list[list[float]]:
    """A convex polygon of 3 to 8 corners about the origin."""
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi - 0.2, int(rng.integers(3, 9))))
    angle += np.linspace(0.0, 0.1, len(angle))
    return (size * np.stack([np.cos(angle), np.sin(angle)], axis=1)).tolist()


def standing(name: str, shape: dict[str, Any], x: float, y: float) -> dict[str, Any]:
    return {"id": name, "shape": shape, "motion": {"position": [x, y]}}


def field(count: int, seed: int = 0) -> sp.Scenario:
    """Ten polygons in or beside the way, twenty near it, and the others far from it."""
    rng = np.random.default_rng(seed)
    obstacles = []
    for k in range(count):
        if k < 10:
            y = rng.uniform(-2.5, 2.5)
        else:
            low, high = NEAR if k < 30 else FAR
            y = rng.choice([-1.0, 1.0]) * rng.uniform(low, high)
        x = rng.uniform(4.0, TRIP - 4.0) if k < 30 else rng.uniform(-20.0, TRIP + 20.0)
        obstacles.append(standing(f"p{k}", {"polygon": polygon(rng, rng.uniform(0.3, 0.8))}, x, y))
    return scene(f"field of {count}", obstacles)


def coast(edges: int) -> sp.Scenario:
    """One wall of hundreds of edges along the trip, concave all over, and a disc to drive round."""
    x = np.linspace(-5.0, TRIP + 5.0, edges // 2)
    shore = -1.2 + 0.7 * np.sin(0.9 * x) + 0.05 * np.cos(7.0 * x)
    outline = np.concatenate([np.stack([x, shore], axis=1), [[x[-1], -6.0], [x[0], -6.0]]])
    return scene(
        f"coast of {len(outline)} edges",
        [
            standing("coast", {"polygon": outline.tolist()}, 0.0, 0.0),
            standing("buoy", {"disc": 0.4}, 15.0, 0.6),
        ],
    )


def scene(name: str, obstacles: list[dict[str, Any]]) -> sp.Scenario:
    """The trip among obstacles."""
    return sp.Scenario(
        name=name,
        vehicle=VEHICLE,
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0},
        goal={"position": [TRIP, 0.0]},
        obstacles=obstacles,
    )


def measure(scenario: sp.Scenario, repeats: int) -> tuple[sp.Plan, dict[str, float]]:
    """The plan, and the least wall time of each part, s."""
    plans = [sp.plan(scenario) for _ in range(repeats + 1)][1:]
    best = min(plans, key=lambda plan: plan.wall_time)
    return best, {"all": best.wall_time, **best.timings}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--seeds", type=int, default=4)
    options = parser.parse_args(arguments)
    rows: list[tuple[str, ...]] = [
        ("scene", "status", "trip s", "iterations", "all", "build", "search", "scp", "certificate")
    ]
    ratios = []
    for seed in range(options.seeds):
        times = []
        for count in (30, 300):
            plan, parts = measure(field(count, seed), options.repeats)
            times.append(parts["all"])
            rows.append(row(f"{plan.scenario}, seed {seed}", plan, parts))
        ratios.append(times[1] / times[0])
    for edges in (50, 400):
        plan, parts = measure(coast(edges), options.repeats)
        rows.append(row(plan.scenario, plan, parts))
    for cells in rows:
        print("  ".join(f"{cell:>12}" for cell in cells))
    print("300 polygons cost " + ", ".join(f"{ratio:.2f}" for ratio in ratios) + " times as much as 30")


def row(name: str, plan: sp.Plan, parts: dict[str, float]) -> tuple[str, ...]:
    """One line of the table."""
    times = (f"{1e3 * parts[key]:.1f}" for key in ("all", "build", "search", "scp", "certificate"))
    return (name, str(plan.status), f"{plan.travel_time:.3f}", str(plan.iterations), *times)


if __name__ == "__main__":
    main()
