"""Random maps: trips are planned over them and checked against the bitmap, densely and without the package's code.

    python -m benchmarks.maps [--count N] [--kind KIND ...] [--first SEED] [--moving] [--output FILE]
    python -m benchmarks.maps --large

Maps are rooms with doors, blobs and winding corridors, turned against the axes. A trip is sampled so closely that it
moves by at most a fifth of a cell, and the distance of each disc from each occupied cell near it is computed. The time
is compared with that of the shortest way over free cells, by eight neighbours, at top speed. ``--large`` reads
a map of 300 m x 300 m at 5 cm in a fresh process, plans over it, and prints the time and memory.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip  # noqa: F401

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter, label
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import scp_planner as sp

Array = np.ndarray[Any, Any]

RADIUS = 0.3
VEHICLE: dict[str, Any] = {
    "max_speed": 2.0,
    "max_acceleration": 1.5,
    "max_deceleration": 2.0,
    "max_lateral_acceleration": 2.0,
    "max_curvature": 2.0,
}
BODIES = ({"radius": RADIUS}, {"radius": RADIUS, "discs": [0.0, 0.35]})
CELL = 0.05  # m
SIZE = 400  # cells


def rooms(rng: np.random.Generator, size: int = SIZE, room: int = 100) -> Array:
    """Walls on a grid with a door each, and boxes in the rooms."""
    cells = np.zeros((size, size), dtype=bool)
    for at in range(room, size, room):
        for begin in range(0, size, room):
            door = int(rng.integers(22, 50))
            for turned in (cells, cells.T):
                where = begin + int(rng.integers(6, room - door - 6))
                turned[at - 2 : at + 2, begin : begin + room] = True
                turned[at - 2 : at + 2, where : where + door] = False
    for _ in range((size // room) ** 2):
        x, y = rng.integers(0, size - 16, 2)
        cells[x : x + rng.integers(3, 16), y : y + rng.integers(3, 16)] = True
    return cells


def blobs(rng: np.random.Generator, size: int = SIZE) -> Array:
    """Smooth noise above a level."""
    noise = gaussian_filter(rng.standard_normal((size, size)), 14.0)
    found: Array = noise > np.quantile(noise, rng.uniform(0.6, 0.85))
    return found


def corridors(rng: np.random.Generator, size: int = SIZE) -> Array:
    """Corridors of random widths cut out of the solid."""
    cells = np.ones((size, size), dtype=bool)
    place = rng.integers(30, size - 30, 2)
    for _ in range(14):
        other, half = place.copy(), int(rng.integers(9, 22))
        axis = int(rng.integers(2))
        other[axis] = rng.integers(30, size - 30)
        low, high = np.minimum(place, other) - half, np.maximum(place, other) + half
        cells[max(low[0], 0) : high[0], max(low[1], 0) : high[1]] = False
        place = other
    return cells


KINDS: dict[str, Callable[[np.random.Generator], Array]] = {"rooms": rooms, "blobs": blobs, "corridors": corridors}


def free_of(cells: Array, radius: float) -> Array:
    """Distance of the centres of cells from occupied ones, less the radius, m; what lies beyond is occupied."""
    apart = CELL * (distance_transform_edt(~np.pad(cells, 1, constant_values=True))[1:-1, 1:-1] - 0.71)
    found: Array = apart - radius
    return found


def shortest(free: Array, begin: Array, end: Array) -> float:
    """Length of the shortest way over free cells by eight neighbours, m."""
    numbers = np.arange(free.size).reshape(free.shape)
    one, other, length = [], [], []
    for y, x in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = np.s_[: free.shape[0] - y, max(-x, 0) : free.shape[1] - max(x, 0)]
        there = np.s_[y:, max(x, 0) : free.shape[1] + min(x, 0)]
        both = free[here] & free[there]
        one.append(numbers[here][both])
        other.append(numbers[there][both])
        length.append(np.full(int(both.sum()), CELL * np.hypot(x, y)))
    graph = coo_array((np.concatenate(length), (np.concatenate(one), np.concatenate(other))), shape=(free.size,) * 2)
    return float(dijkstra(graph.tocsr(), directed=False, indices=numbers[tuple(begin)])[numbers[tuple(end)]])


def scene(kind: str, seed: int, moving: bool) -> tuple[sp.Scenario, Array, float] | None:
    """A scenario over a random map, its cells, and the length of the shortest way; None where there is none."""
    rng = np.random.default_rng([seed, sorted(KINDS).index(kind)])
    cells = KINDS[kind](rng)
    body = BODIES[int(rng.integers(len(BODIES)))]
    roomy = free_of(cells, RADIUS + 0.4)
    parts, count = label(roomy > 0.0)
    if count == 0:
        return None
    places = np.argwhere(parts == np.argmax(np.bincount(parts.ravel())[1:]) + 1)
    begin = places[rng.integers(len(places))]
    far = places[np.hypot(*(places - begin).T) > 0.4 * SIZE]
    if len(far) == 0:
        return None
    end = far[rng.integers(len(far))]
    ground = sp.OccupancyMap(cells, CELL, tuple(rng.uniform(-50.0, 50.0, 2)), float(rng.uniform(-3.0, 3.0)))
    start, goal = (ground.world(place[::-1] + 0.5).tolist() for place in (begin, end))
    obstacles = []
    for number in range(3 * moving):
        place = ground.world(places[rng.integers(len(places))][::-1] + 0.5)
        if np.hypot(*(place - start)) > 2.5 and np.hypot(*(place - goal)) > 2.5:
            motion = {"position": place.tolist(), "velocity": rng.uniform(-0.5, 0.5, 2).tolist()}
            obstacles.append({"id": f"o{number}", "shape": {"disc": 0.3}, "motion": motion})
    heading = float(rng.uniform(-3.0, 3.0)) if len(body) > 1 else None
    if heading is not None:
        ahead = ground.local(start + 0.35 * np.array([np.cos(heading), np.sin(heading)])).astype(int)[::-1]
        if not roomy[tuple(ahead)] > -0.4:
            return None
    scenario = sp.Scenario(
        vehicle={**VEHICLE, **body},
        start={"time": 0.0, "position": start, "speed": 0.0, "heading": heading},
        goal={"position": goal, "radius": 0.0 if heading is None else 0.3},
        obstacles=obstacles,
        ground={"map": ground},
    )
    return scenario, cells, shortest(free_of(cells, RADIUS) > 0.0, begin, end)


def deepest(plan: sp.Plan, scenario: sp.Scenario, cells: Array) -> float:
    """Least distance of a disc's border from an occupied cell, m, over dense samples of a trip."""
    time = scenario.start.time + moments(plan.travel_time, scenario)
    return apart(plan.position(time), plan.heading(time), scenario, cells)


def moments(lasts: float, scenario: sp.Scenario) -> Array:
    """Times so close that the vehicle moves by at most a fifth of a cell, s."""
    return np.linspace(0.0, lasts, int(lasts * scenario.vehicle.max_speed / (0.2 * CELL)) + 2)


def apart(position: Array, heading: Array, scenario: sp.Scenario, cells: Array) -> float:
    """Least distance of a disc's border from an occupied cell, m, at places (n, 2) m with headings (n,) rad."""
    assert scenario.ground is not None
    ground, vehicle = scenario.ground.map, scenario.vehicle
    (x0, y0), yaw, least = ground.origin, ground.yaw, np.inf
    reach = int(vehicle.radius / CELL) + 3
    shifts = np.stack(np.meshgrid(*(np.arange(-reach, reach + 1),) * 2), axis=-1).reshape(-1, 2)
    padded = np.pad(cells, reach + 1, constant_values=True)
    for offset in vehicle.discs:
        x = position[:, 0] + offset * np.cos(heading) - x0
        y = position[:, 1] + offset * np.sin(heading) - y0
        u, v = (np.cos(yaw) * x + np.sin(yaw) * y) / CELL, (np.cos(yaw) * y - np.sin(yaw) * x) / CELL
        for first in range(0, len(u), 400):
            a, b = u[first : first + 400, None], v[first : first + 400, None]
            column, row = np.floor(a).astype(int) + shifts[:, 0], np.floor(b).astype(int) + shifts[:, 1]
            inside = [np.clip(one + reach + 1, 0, n - 1) for one, n in zip((row, column), padded.shape, strict=True)]
            apart = np.hypot(np.maximum(np.abs(a - column - 0.5) - 0.5, 0), np.maximum(np.abs(b - row - 0.5) - 0.5, 0))
            least = min(least, float(apart[padded[inside[0], inside[1]]].min(initial=np.inf)))
    return CELL * least - vehicle.radius


def large(folder: Path) -> None:
    """Write a large map of rooms, and read and plan over it in a fresh process."""
    rng = np.random.default_rng(7)
    ground = sp.OccupancyMap(rooms(rng, 6000, 400), CELL, (-100.0, -50.0), 0.2)
    sp.save_map(ground, folder / "large.yaml")
    rooms_at_ends = (ground.occupied[:400, :400], ground.occupied[-400:, -400:])
    first, last = (np.argwhere(free_of(part, RADIUS + 0.4) > 0.0) for part in rooms_at_ends)
    roomy, far = first[0], last[-1] + 5600
    ends = [ground.world(one[::-1] + 0.5).tolist() for one in (roomy, far)]
    subprocess.run([sys.executable, "-m", "benchmarks.maps", "--drive", str(folder), json.dumps(ends)], check=True)


def drive(folder: Path, ends: list[list[float]]) -> None:
    began, used = perf_counter(), process_time()
    scenario = sp.Scenario(
        vehicle={**VEHICLE, **BODIES[0]},
        start={"time": 0.0, "position": ends[0], "speed": 0.0},
        goal={"position": ends[1]},
        obstacles=[],
        ground={"map": str(folder / "large.yaml")},
    )
    read = process_time() - used
    plan = sp.plan(scenario)
    print(plan, plan.reason)
    print(f"read {read:.2f} s, read and planned {process_time() - used:.2f} s CPU, {perf_counter() - began:.2f} s wall")
    print(f"peak {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10, help="maps of each kind")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--kind", nargs="+", choices=sorted(KINDS), default=sorted(KINDS))
    parser.add_argument("--moving", action="store_true", help="three moving discs")
    parser.add_argument("--output", type=Path, help="JSON lines, one a map")
    parser.add_argument("--large", action="store_true", help="a map of 36 million cells")
    parser.add_argument("--drive", nargs=2, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.drive:
        drive(Path(asked.drive[0]), json.loads(asked.drive[1]))
        return
    if asked.large:
        with tempfile.TemporaryDirectory() as folder:
            large(Path(folder))
        return
    found = []
    for kind in asked.kind:
        for seed in range(asked.first, asked.first + asked.count):
            made = scene(kind, seed, asked.moving)
            if made is None:
                continue
            scenario, cells, length = made
            began = process_time()
            plan = sp.plan(scenario)
            one = {"kind": kind, "seed": seed, "status": str(plan.status), "cpu": process_time() - began}
            one |= {"certified": plan.certified, "ratio": plan.travel_time / (length / VEHICLE["max_speed"])}
            one |= {"apart": deepest(plan, scenario, cells), "reason": plan.reason}
            found.append(one)
            if asked.output:
                with asked.output.open("a") as out:
                    print(json.dumps(one), file=out)
    for kind in asked.kind:
        some = [one for one in found if one["kind"] == kind]
        sure = [one for one in some if one["certified"]]
        touched = sum(one["apart"] < -1e-9 for one in sure)
        if not sure:
            continue
        ratio, cpu = ([float(one[key]) for one in sure] for key in ("ratio", "cpu"))
        print(f"{kind}: {len(some)} maps, {len(sure)} certified, {touched} of them touch a cell;", end=" ")
        print(f"time / shortest way at top speed: median {np.median(ratio):.3f}, most {max(ratio):.3f};", end=" ")
        print(f"CPU: median {np.median(cpu):.2f} s, most {max(cpu):.2f} s")


if __name__ == "__main__":
    main()
