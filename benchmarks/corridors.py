"""What a corridor of 40 polygons costs: a trip with it, without it along the same middle, and on a straight way.

    python -m benchmarks.corridors [--repeats N] [--output FOLDER] [NAME ...]

Each road is planned three times: in its corridor; without it, along its middle; and without it to a goal straight
ahead, as far away as its middle is long. Among obstacles too, which move along it. A way that bends makes another trip
than a straight one, so it is told beside the cost how many iterations each took, and how many programs were solved.
Times are of the processor, medians, of the plan and of the scenario from its numbers, with no corridor kept of before.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import argparse
import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any
from unittest import mock

import numpy as np

import scp_planner
from scp_planner.mathematics import corridor
from scp_planner.solvers.daqp_solver import DaqpSolver

Scene = dict[str, Any]
Points = np.ndarray[Any, np.dtype[np.float64]]

PIECES = 40
OVERLAP = 0.15  # of a piece, over each of its ends
FINE = 2000  # points of a middle
CAR = {
    "radius": 0.9,
    "max_speed": 12.0,
    "max_acceleration": 2.5,
    "max_deceleration": 4.0,
    "max_lateral_acceleration": 3.0,
    "max_curvature": 0.2,
}  # SI units
POINT = {
    "radius": 0.3,
    "max_speed": 4.0,
    "max_acceleration": 2.0,
    "max_deceleration": 2.0,
    "max_lateral_acceleration": 3.0,
}
KEPT = (corridor.known_outside, corridor.known_outlines, corridor.known_way)


@dataclass(frozen=True)
class Road:
    """A road of a length in m, by its heading in rad and its half width in m at shares of the way."""

    length: float
    heading: Callable[[Points], Points]
    half_width: Callable[[Points], Points]
    vehicle: Scene
    joined: bool = False  # quadrilaterals that share their ends, as lanelets, or rectangles that overlap

    def middle(self) -> tuple[Points, Points]:
        """Points of its middle, (n, 2) m, and its headings there, rad."""
        share = np.linspace(0.0, 1.0, FINE + 1)
        heading = self.heading(share)
        steps = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        points = np.cumsum(0.5 * (steps[1:] + steps[:-1]), axis=0) * self.length / FINE
        return np.concatenate([np.zeros((1, 2)), points]), heading

    def corridor(self) -> list[list[list[float]]]:
        """Its polygons, which overlap."""
        points, heading = self.middle()
        half, size = self.half_width(np.linspace(0.0, 1.0, FINE + 1)), self.length / PIECES
        across = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
        found = []
        for first in range(0, FINE, FINE // PIECES):
            last = first + FINE // PIECES
            if self.joined:  # a little longer than it is, along its own middle
                ends = [points[first] - across[first] * half[first], points[last] - across[last] * half[last]]
                ends += [points[last] + across[last] * half[last], points[first] + across[first] * half[first]]
                low, high, left, right = ends[0], ends[1], ends[3], ends[2]
                grown = [low + OVERLAP * (low - high), high + OVERLAP * (high - low)]
                grown += [right + OVERLAP * (right - left), left + OVERLAP * (left - right)]
            else:
                chord = points[last] - points[first]
                along = chord / float(np.hypot(*chord))
                side = np.array([-along[1], along[0]]) * half[first : last + 1].max()
                more = OVERLAP * size * along
                grown = [points[first] - more - side, points[last] + more - side]
                grown += [points[last] + more + side, points[first] - more + side]
            found.append([[float(x), float(y)] for x, y in grown])
        room = 2.0 * self.vehicle["radius"]
        for place, corners, ahead in ((0, (0, 3), -room), (-1, (1, 2), room)):
            for corner in corners:
                found[place][corner][0] += ahead * math.cos(heading[place])
                found[place][corner][1] += ahead * math.sin(heading[place])
        return found

    def guide(self) -> list[list[float]]:
        """Its middle, as a polyline with a corner in each polygon."""
        points, _ = self.middle()
        return [[float(x), float(y)] for x, y in points[:: FINE // PIECES]]


def _sine(size: float, waves: float) -> Callable[[Points], Points]:
    return lambda share: size * np.sin(2.0 * math.pi * waves * share)


def _bend(size: float) -> Callable[[Points], Points]:
    return lambda share: size * np.clip(2.0 * share - 0.5, 0.0, 1.0)


def _even(width: float) -> Callable[[Points], Points]:
    return lambda share: np.full_like(share, width)


def _straight(share: Points) -> Points:
    return np.zeros_like(share)


def _swaying(width: float, share_off: float, waves: float) -> Callable[[Points], Points]:
    return lambda share: width * (1.0 + share_off * np.sin(2.0 * math.pi * waves * share))


ROADS = {
    "straight-40-point": Road(40.0, _straight, _even(1.5), POINT),
    "straight-400-car": Road(400.0, _straight, _even(3.5), CAR),
    "lanelets-200-car": Road(200.0, _sine(0.2, 1.0), _even(3.0), CAR, joined=True),
    "widening-120-car": Road(120.0, _sine(0.3, 1.0), lambda share: 2.5 + 3.0 * share, CAR, joined=True),
    "narrowing-60-point": Road(60.0, _bend(0.8), lambda share: 3.0 - 2.0 * share, POINT, joined=True),
    "swaying-150-car": Road(150.0, _straight, _swaying(3.0, 0.3, 4.0), CAR, joined=True),
    "bend-100-car": Road(100.0, _bend(math.pi / 2.0), _even(3.0), CAR),
    "bend-40-point": Road(40.0, _bend(math.pi / 2.0), _even(1.2), POINT, joined=True),
    "s-80-point": Road(80.0, _sine(1.0, 1.0), _even(1.5), POINT),
    "s-200-car": Road(200.0, _sine(0.8, 1.0), _even(3.0), CAR),
    "serpentine-120-point": Road(120.0, _sine(1.0, 3.0), _even(1.5), POINT),
    "serpentine-400-car": Road(400.0, _sine(0.7, 3.0), _even(3.5), CAR, joined=True),
}


def obstacles(road: Road, count: int, seed: int) -> list[Scene]:
    """Discs that move along the middle of a road, ahead or towards the vehicle, beside it by up to half its room."""
    rng = np.random.default_rng(seed)
    points, heading = road.middle()
    half = road.half_width(np.linspace(0.0, 1.0, FINE + 1))
    size, found = 0.6 * road.vehicle["radius"], []
    for k in range(count):
        at = int(FINE * (0.2 + 0.7 * (k + rng.uniform(0.2, 0.8)) / count))
        room = half[at] - size
        side = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.7, 1.0) * room)
        speed = float(rng.uniform(-0.1, 0.2) * road.vehicle["max_speed"])
        along = np.array([math.cos(heading[at]), math.sin(heading[at])])
        place = points[at] + side * np.array([-along[1], along[0]])
        motion = {"position": place.tolist(), "velocity": (speed * along).tolist()}
        found.append({"id": f"mover{k}", "shape": {"disc": size}, "motion": motion})
    return found


def scenes(name: str, road: Road, movers: int, seed: int) -> dict[str, Scene]:
    """One road's three scenes."""
    points, heading = road.middle()
    others = obstacles(road, movers, seed) if movers else []
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": float(heading[0])}
    start["speed"] = 0.5 * road.vehicle["max_speed"]
    bent = {"vehicle": road.vehicle, "start": start, "obstacles": others, "goal": {"position": points[-1].tolist()}}
    ahead = Road(road.length, _straight, road.half_width, road.vehicle)
    straight = bent | {"start": start | {"heading": 0.0}, "goal": {"position": [road.length, 0.0]}}
    straight["obstacles"] = obstacles(ahead, movers, seed) if movers else []
    return {
        "corridor": bent | {"name": f"{name} in its corridor", "corridor": road.corridor()},
        "guide": bent | {"name": f"{name} along its middle", "guide": road.guide()},
        "straight": straight | {"name": f"{name} straight ahead"},
    }


def measured(scene: Scene, repeats: int) -> dict[str, Any]:
    """The plan of a scene, what it cost and what its scenario did, s, and its work."""
    plans, scenarios = list[float](), list[float]()
    for _ in range(repeats):
        for each in KEPT:
            each.cache_clear()
        began = process_time()
        scenario = scp_planner.Scenario(**scene)
        made = process_time()
        plan = scp_planner.plan(scenario)
        scenarios.append(made - began)
        plans.append(process_time() - made)
    with mock.patch.object(DaqpSolver, "solve", autospec=True, side_effect=DaqpSolver.solve) as solve:
        scp_planner.plan(scp_planner.Scenario(**scene))
    return {
        "status": str(plan.status),
        "plan": common.median(plans),
        "scenario": common.median(scenarios),
        "travel_time": plan.travel_time,
        "iterations": plan.iterations,
        "programs": solve.call_count,
        "parts": plan.timings,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a table; write all figures to a file of JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="roads; all without any")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--movers", type=int, nargs="*", default=[0, 5], help="numbers of obstacles")
    parser.add_argument("--seed", type=int, default=1, help="of the obstacles")
    parser.add_argument("--output", type=Path, default=common.DEFAULT_OUTPUT)
    options = parser.parse_args(arguments)
    found: dict[str, dict[str, Any]] = {}
    measured(scenes("all that is loaded once", ROADS["straight-40-point"], 1, 0)["corridor"], 1)
    for name in options.names or ROADS:
        for movers in options.movers:
            three = scenes(name, ROADS[name], movers, options.seed)
            found[f"{name}, {movers}"] = {kind: measured(scene, options.repeats) for kind, scene in three.items()}
            common.say(_row(f"{name}, {movers}", found[f"{name}, {movers}"]))
    common.write_text(options.output / "corridors.json", json.dumps(found, indent=1))
    for other in ("guide", "straight"):
        ratios = [_ratio(each, other) for each in found.values()]
        within = sum(ratio <= 2.0 for ratio in ratios)
        told = f"median {common.median(ratios):.2f}, worst {max(ratios):.2f}, at most 2 in {within} of {len(ratios)}"
        sys.stdout.write(f"plans, corridor / {other}: {told}\n")
    return 0


def _ratio(found: dict[str, dict[str, Any]], other: str) -> float:
    return float(found["corridor"]["plan"] / found[other]["plan"])


def _row(name: str, found: dict[str, dict[str, Any]]) -> str:
    """One road: ratios of plans; of each scene ms of plan and scenario, iterations, programs, time and status."""
    ratios = "  ".join(f"{_ratio(found, other):5.2f}" for other in ("guide", "straight"))
    cells = [
        f"{1e3 * each['plan']:5.0f} {1e3 * each['scenario']:3.0f} {each['iterations']:3d} {each['programs']:3d} "
        f"{each['travel_time']:6.2f} {each['status'][:4]}"
        for each in found.values()
    ]
    return f"{name:26} {ratios}   " + " | ".join(cells)


if __name__ == "__main__":
    sys.exit(main())
