"""Random grounds, and the fastest trip over each that a lattice of position, heading and speed finds.

    python -m benchmarks.grounds [--count N] [--kind KIND ...] [--first SEED] [--moving] [--polish] [--output FILE]

Grounds are walls, U, L, combs, rooms with doors, spirals and mazes, with passages from 1.02 vehicles on; with
``--moving`` three discs move about. The oracle is independent of the planner: Dijkstra over arcs on a lattice of places
and headings, clear of what stands by shapely. A way that it misses may exist: the lattice is coarser than the narrowest
passages. What the planner fails at is told by kind, and the ratio of its time to the lower bound; with ``--polish``
also that to the best of itself and of two trips planned with that way as the guide, one with four times the effort.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip  # noqa: F401

import argparse
import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from shapely import LineString, MultiPolygon, box, contains_xy, prepare
from shapely.affinity import rotate, translate

import scp_planner as sp

Array = np.ndarray[Any, np.dtype[np.float64]]
Wall = tuple[float, float, float, float]
"""Left, low, right and high sides, m."""

VEHICLE = {
    "radius": 0.3,
    "max_speed": 2.0,
    "max_acceleration": 1.5,
    "max_deceleration": 2.0,
    "max_lateral_acceleration": 2.0,
    "max_curvature": 2.0,
}
THICK = 0.3  # m, of walls
NARROWEST, WIDEST = 1.02, 4.0  # widths of the vehicle, of passages
HEADINGS = 24  # of the lattice
STEP = 0.15  # m, of the lattice
LATE = 1.05  # times the best, of trips that are named


@dataclass(frozen=True)
class Ground:
    """Walls, and where a trip begins and ends, m."""

    walls: list[Wall]
    start: tuple[float, float]
    goal: tuple[float, float]


def gap(rng: np.random.Generator) -> float:
    """Width of a passage, m: narrow ones are as frequent as wide ones."""
    share = math.exp(rng.uniform(math.log(NARROWEST), math.log(WIDEST)))
    return 2.0 * float(VEHICLE["radius"]) * share


def single_wall(rng: np.random.Generator) -> Ground:
    height, off = rng.uniform(2.0, 22.0), rng.uniform(-0.4, 0.4)
    low = -0.5 * height + off * height
    return Ground([(9.0, low, 9.0 + rng.uniform(0.2, 2.0), low + height)], (0.0, 0.0), (20.0, 0.0))


def u_shape(rng: np.random.Generator) -> Ground:
    half, arm, x = rng.uniform(1.5, 7.0), rng.uniform(1.0, 8.0), 11.0
    back = (x, -half - THICK, x + THICK, half + THICK)
    arms: list[Wall] = [
        (x - arm, side * half + min(side, 0) * THICK, x, side * half + max(side, 0) * THICK) for side in (-1, 1)
    ]
    return Ground([back, *arms], (x - rng.uniform(1.0, 10.0), rng.uniform(-0.5, 0.5)), (20.0, rng.uniform(-1.0, 1.0)))


def l_shape(rng: np.random.Generator) -> Ground:
    height, arm = rng.uniform(3.0, 14.0), rng.uniform(2.0, 8.0)
    low = -rng.uniform(0.2, 0.8) * height
    walls: list[Wall] = [
        (10.0, low, 10.0 + THICK, low + height),
        (10.0 - arm, low + height - THICK, 10.0, low + height),
    ]
    return Ground(walls, (0.0, 0.0), (20.0, rng.uniform(-2.0, 2.0)))


def comb(rng: np.random.Generator) -> Ground:
    """Walls from below and above in turn, which leave a passage at their ends."""
    height, walls = rng.uniform(4.0, 8.0), list[Wall]()
    x, up = 2.5, bool(rng.integers(2))
    while x < 16.0:
        end = gap(rng)
        walls.append((x, 0.0, x + THICK, height - end) if up else (x, end, x + THICK, height))
        x, up = x + THICK + max(gap(rng), 1.2), not up
    walls += [(-2.0, -THICK, 20.0, 0.0), (-2.0, height, 20.0, height + THICK)]
    return Ground(walls, (0.0, 0.5 * height), (x + 1.0, 0.5 * height))


def rooms(rng: np.random.Generator) -> Ground:
    """Three by two rooms with a door in each wall between them."""
    size, walls = 6.0, list[Wall]()
    for x in (size, 2.0 * size):
        for y in (0.0, size):
            walls += _with_door(rng, x, y, size, upright=True)
    for k in range(3):
        walls += _with_door(rng, size, k * size, size, upright=False)
    walls += [(-THICK, -THICK, 0.0, 2 * size), (3 * size, -THICK, 3 * size + THICK, 2 * size + THICK)]
    walls += [(-THICK, -THICK, 3 * size, 0.0), (-THICK, 2 * size, 3 * size, 2 * size + THICK)]
    goal = (rng.uniform(2 * size + 1.5, 3 * size - 1.5), rng.uniform(size + 1.5, 2 * size - 1.5))
    return Ground(walls, (1.5, rng.uniform(1.5, 4.5)), goal)


def _with_door(rng: np.random.Generator, across: float, along: float, size: float, *, upright: bool) -> list[Wall]:
    door = gap(rng)
    begin = along + rng.uniform(0.5, size - door - 0.5)
    parts = ((along, begin), (begin + door, along + size))
    if upright:
        return [(across - 0.5 * THICK, a, across + 0.5 * THICK, b) for a, b in parts]
    return [(a, across - 0.5 * THICK, b, across + 0.5 * THICK) for a, b in parts]


def spiral(rng: np.random.Generator) -> Ground:
    """A way that winds inwards between walls."""
    wide, walls = max(gap(rng), 0.9), list[Wall]()
    pitch, turns = wide + THICK, int(rng.integers(2, 4))
    outer = pitch * (turns + 1.0)
    for k in range(turns):
        r = outer - k * pitch
        walls += [(-r, -r, r, -r + THICK), (r - THICK, -r, r, r), (-r, r - THICK, r, r)]
        walls.append((-r, -r + pitch, -r + THICK, r))
        if k + 1 < turns:
            walls.append((-r, -r + pitch, -r + pitch, -r + pitch + THICK))
    return Ground(walls, (-outer - 1.5, -outer + 0.5 * pitch + 0.5 * THICK), (0.0, 0.0))


def maze(rng: np.random.Generator, count: int = 10) -> Ground:
    """A spanning tree of count x count cells."""
    size = max(gap(rng), 0.8) + THICK
    shut = {(x, y, d) for x in range(count) for y in range(count) for d in (0, 1)}
    seen, stack = {(0, 0)}, [(0, 0)]
    while stack:
        x, y = stack[-1]
        near = [(x + a, y + b) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        near = [one for one in near if one not in seen and 0 <= min(one) and max(one) < count]
        if not near:
            stack.pop()
            continue
        u, v = near[int(rng.integers(len(near)))]
        shut.discard((max(x, u), y, 0) if y == v else (x, max(y, v), 1))
        seen.add((u, v))
        stack.append((u, v))
    walls: list[Wall] = []
    half = 0.5 * THICK
    for x, y, d in sorted(shut):
        if (d == 0 and x == 0) or (d == 1 and y == 0):
            continue
        if d == 0:
            walls.append((x * size - half, y * size - half, x * size + half, (y + 1) * size + half))
        else:
            walls.append((x * size - half, y * size - half, (x + 1) * size + half, y * size + half))
    total = count * size
    walls += [(-half, -half, half, total + half), (total - half, -half, total + half, total + half)]
    walls += [(-half, -half, total + half, half), (-half, total - half, total + half, total + half)]
    return Ground(walls, (0.5 * size, 0.5 * size), (total - 0.5 * size, total - 0.5 * size))


KINDS: dict[str, Callable[[np.random.Generator], Ground]] = {
    "wall": single_wall,
    "u": u_shape,
    "l": l_shape,
    "comb": comb,
    "rooms": rooms,
    "spiral": spiral,
    "maze": maze,
}


def scenario_of(kind: str, seed: int, moving: bool = False) -> sp.Scenario:
    """Return a random scenario of a kind, turned and mirrored at random."""
    rng = np.random.default_rng([seed, sorted(KINDS).index(kind)])
    ground = KINDS[kind](rng)
    turn, mirror = rng.uniform(0.0, 2.0 * math.pi), float(rng.choice([-1.0, 1.0]))

    def placed(x: float, y: float) -> list[float]:
        y = mirror * y
        return [math.cos(turn) * x - math.sin(turn) * y, math.sin(turn) * x + math.cos(turn) * y]

    obstacles: list[dict[str, Any]] = [
        {
            "id": f"wall{k}",
            "shape": {"rectangle": [right - left, high - low], "heading": turn},
            "motion": {"position": placed(0.5 * (left + right), 0.5 * (low + high))},
        }
        for k, (left, low, right, high) in enumerate(ground.walls)
    ]
    for k in range(3 if moving else 0):
        x, y = ground.start
        while math.dist((x, y), ground.start) < 1.0:
            x, y = rng.uniform(4.0, 16.0), rng.uniform(-6.0, 6.0)
        u, v = rng.normal(0.0, 0.6, 2)
        obstacles.append(
            {"id": f"disc{k}", "shape": {"disc": 0.3}, "motion": {"position": placed(x, y), "velocity": placed(u, v)}}
        )
    return sp.Scenario(
        name=f"{kind}-{seed}",
        vehicle=VEHICLE,
        start={
            "time": 0.0,
            "position": placed(*ground.start),
            "heading": _heading(kind, ground, turn, mirror),
            "speed": 0.0,
        },
        goal={"position": placed(*ground.goal), "speed": 0.0},
        obstacles=obstacles,
    )


def _heading(kind: str, ground: Ground, turn: float, mirror: float) -> float | None:
    if kind in ("maze", "rooms"):
        return None
    away = np.subtract(ground.goal, ground.start) * [1.0, mirror] if kind != "spiral" else np.array([1.0, 0.0])
    return math.remainder(turn + math.atan2(away[1], away[0]), 2.0 * math.pi)


class Lattice:
    """Shortest ways of a vehicle of a least turning radius over what stands, on a lattice of places and headings."""

    def __init__(self, scenario: sp.Scenario) -> None:
        self.scenario = scenario
        standing = [one for one in scenario.obstacles if not any(one.motion.velocity)]  # type: ignore[union-attr]
        shapes = [_polygon(one) for one in standing]
        self.ground = MultiPolygon(shapes).buffer(scenario.vehicle.radius, quad_segs=16)
        prepare(self.ground)
        ends = np.array([scenario.start.position, scenario.goal.position])
        left, low, right, high = MultiPolygon(shapes).bounds
        self.low = np.minimum([left, low], ends.min(axis=0)) - 2.0
        self.high = np.maximum([right, high], ends.max(axis=0)) + 2.0
        self.shape = np.ceil((self.high - self.low) / STEP).astype(int) + 1

    def shortest(self) -> tuple[float, Array]:
        """Return the length of the shortest way, m, and its places, (n, 2) m; inf and none where there is none."""
        nx, ny = self.shape
        x, y = np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")
        free = ~contains_xy(self.ground, self.low[0] + STEP * x, self.low[1] + STEP * y)
        rows, columns, costs = [], [], []
        number = np.arange(nx * ny * HEADINGS).reshape(nx, ny, HEADINGS)
        for heading in range(HEADINGS):
            for turn in (-1, 0, 1):
                along, across, length = self._primitive(heading, turn)
                looks = self._looks(heading, turn)
                a = slice(max(-along, 0), nx - max(along, 0)), slice(max(-across, 0), ny - max(across, 0))
                b = slice(max(along, 0), nx + min(along, 0)), slice(max(across, 0), ny + min(across, 0))
                passed = free[a] & free[b]
                px, py = self.low[0] + STEP * x[a][passed], self.low[1] + STEP * y[a][passed]
                kept = np.ones(len(px), dtype=bool)
                for dx, dy in looks:
                    kept &= ~contains_xy(self.ground, px + dx, py + dy)
                rows.append(number[:, :, heading][a][passed][kept])
                columns.append(number[:, :, (heading + turn) % HEADINGS][b][passed][kept])
                costs.append(np.full(int(kept.sum()), length))
        graph = csr_array(
            (np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), shape=(number.size,) * 2
        )
        start, goal = (
            np.rint((np.array(end) - self.low) / STEP).astype(int)
            for end in (self.scenario.start.position, self.scenario.goal.position)
        )
        begun = self.scenario.start.heading
        firsts = range(HEADINGS) if begun is None else [round(begun * HEADINGS / (2.0 * math.pi)) % HEADINGS]
        sources = [int(number[start[0], start[1], one]) for one in firsts]
        found, before, _ = dijkstra(graph, indices=sources, min_only=True, return_predecessors=True)
        near = number[goal[0] - 1 : goal[0] + 2, goal[1] - 1 : goal[1] + 2].ravel()
        at = int(near[np.argmin(found[near])])
        length, way = float(found[at]), list[int]()
        while math.isfinite(length) and at >= 0:
            way.append(at // HEADINGS)
            at = int(before[at])
        return length, self.low + STEP * np.stack(np.divmod(np.array(way[::-1], dtype=int), ny), axis=1)

    def _arc(self, heading: int, turn: int) -> tuple[float, float, float, float]:
        """Heading, rad, radius, m, angle, rad, and length of a step, m."""
        h, angle = 2.0 * math.pi * heading / HEADINGS, 2.0 * math.pi * turn / HEADINGS
        length = 2.4 / float(VEHICLE["max_curvature"]) * 2.0 * math.pi / HEADINGS * 1.5
        return h, math.inf if turn == 0 else length / angle, angle, length

    def _places(self, heading: int, turn: int, shares: Array) -> Array:
        h, radius, angle, length = self._arc(heading, turn)
        if turn == 0:
            return length * shares[:, None] * np.array([math.cos(h), math.sin(h)])
        at = h + angle * shares
        return radius * np.stack([np.sin(at) - math.sin(h), math.cos(h) - np.cos(at)], axis=1)

    def _primitive(self, heading: int, turn: int) -> tuple[int, int, float]:
        end = self._places(heading, turn, np.ones(1))[0]
        along, across = np.rint(end / STEP).astype(int).tolist()
        return along, across, max(self._arc(heading, turn)[3], STEP * math.hypot(along, across))

    def _looks(self, heading: int, turn: int) -> list[tuple[float, float]]:
        along, across, _ = self._primitive(heading, turn)
        shares = np.array([0.25, 0.5, 0.75])
        places = self._places(heading, turn, shares)
        moved = np.array([along, across]) * STEP - self._places(heading, turn, np.ones(1))[0]
        return [(float(x), float(y)) for x, y in places + shares[:, None] * moved]


def _polygon(obstacle: Any) -> Any:
    length, width = obstacle.shape.rectangle
    made = rotate(box(-0.5 * length, -0.5 * width, 0.5 * length, 0.5 * width), obstacle.shape.heading, use_radians=True)
    return translate(made, *obstacle.motion.position)


@dataclass(frozen=True)
class Outcome:
    """A ground, what the oracle knows of it, and what the planner made of it."""

    name: str
    lattice: float  # m; inf where the oracle found no way
    certified: bool
    travel_time: float
    lower_bound: float
    cpu: float
    reason: str
    best: float  # s, travel time of the best of the plan and of those along the lattice's way


def tried(kind: str, seed: int, moving: bool, polish: bool) -> Outcome:
    """Plan one ground."""
    scenario = scenario_of(kind, seed, moving)
    begin = process_time()
    plan = sp.plan(scenario)
    cpu = process_time() - begin
    length, way = Lattice(scenario).shortest() if polish or not plan.certified else (math.nan, np.zeros((0, 2)))
    best = plan.travel_time if plan.certified else math.inf
    if polish and math.isfinite(length):
        best = min(best, *polished(scenario, way))
    return Outcome(
        scenario.name, length, plan.certified, plan.travel_time, plan.lower_bound, cpu, plan.reason or "", best
    )


def polished(scenario: sp.Scenario, way: Array) -> list[float]:
    """Travel times of certified trips with a way as the guide, s."""
    line = LineString([scenario.start.position, *way[1:-1].tolist(), scenario.goal.position]).simplify(0.5 * STEP)
    guided = sp.Scenario.model_validate({**scenario.model_dump(), "guide": list(line.coords)})
    plans = [sp.plan(guided, sp.Settings(effort=effort)) for effort in (1.0, 4.0)]
    return [one.travel_time if one.certified else math.inf for one in plans]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.grounds", description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10, help="grounds of each kind")
    parser.add_argument("--kind", nargs="*", choices=sorted(KINDS), default=sorted(KINDS))
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--moving", action="store_true", help="with three moving discs")
    parser.add_argument("--polish", action="store_true", help="plan along the lattice's way as well")
    parser.add_argument("--output", type=Path, help="JSON file of all outcomes")
    chosen = parser.parse_args(arguments)
    everything: list[Outcome] = []
    for kind in chosen.kind:
        seeds = range(chosen.first, chosen.first + chosen.count)
        found = [tried(kind, seed, chosen.moving, chosen.polish) for seed in seeds]
        everything += found
        good = [one for one in found if one.certified]
        missed = [one for one in found if not one.certified and math.isfinite(one.lattice)]
        ratios = [one.travel_time / one.lower_bound for one in good]
        print(
            f"{kind:8s} {len(good)} of {len(found)} certified, {len(missed)} missed though the lattice has a way;"
            f" time / bound median {np.median(ratios or [np.nan]):.3f}, largest {max(ratios, default=np.nan):.3f};"
            f" CPU median {np.median([one.cpu for one in found]):.2f}, largest {max(one.cpu for one in found):.2f} s",
            flush=True,
        )
        if chosen.polish:
            behind = [one.travel_time / one.best for one in good]
            shares = np.quantile(behind or [np.nan], (0.5, 0.95, 1.0))
            late = ", ".join(one.name for one in good if one.travel_time > LATE * one.best)
            print("    time / best median {:.4f}, 95 % {:.4f}, largest {:.4f}".format(*shares), late, flush=True)
        for one in missed:
            print(f"    {one.name}: lattice {one.lattice:.2f} m: {one.reason[:150]}", flush=True)
    if chosen.output is not None:
        chosen.output.write_text(json.dumps([asdict(one) for one in everything], indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
