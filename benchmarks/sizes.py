"""Vehicles of every size, in SI units and in others: the same scenes must be planned alike, and as fast.

    python -m benchmarks.sizes                    all kinds of vehicle, a table and a CSV file
    python -m benchmarks.sizes FOLDER ...         scenarios of one's own, kind-0.json, kind-1.json, ...

Each scene is planned as it is, rewritten so that the trip is 20 long at a top speed of 3, in units that are far from
both, with twice as many ways tried, and with splines twice as fine: the best of all is what the plan of the scene as it
is, by default, is measured by. The work is compared with that for a scene of the reference family with as many
obstacles, the median of several; as these differ among each other, it is told as well how many of as many of them take
over three times their own median.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import argparse
import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

import scp_planner
from benchmarks import families

Scene = dict[str, Any]

LONG = 3.0  # times the median work of reference scenes
AGAIN = 3  # timed calls of a scene, of which the median counts
MORE = scp_planner.Settings(max_runs=16, searches=48)  # for the best known time: more ways
FINER = scp_planner.Settings(acceleration_spans=40, samples=320, max_iterations=150)  # and finer splines
FINER_SPAN = 0.75  # of 20 on the trip
OTHER_UNITS = (0.013, 0.17)  # factors of lengths and times that no scene is written in
SEEN = 20  # observations of each obstacle
SEEN_SHARE = 0.15  # of the time of the trip, over which they are spread


@dataclass(frozen=True)
class Kind:
    """A kind of vehicle, SI.

    Attributes
    ----------
    trip, top, acceleration, radius : float
        m, m/s, m/s2 and m.
    turn : float
        Least radius of a turn, m; 0: it turns on the spot.
    obstacle : float
        Radius of a typical obstacle, m.
    crowd : int
        Obstacles of a dense scene; an easy one has a quarter of them.
    """

    trip: float
    top: float
    acceleration: float
    radius: float
    turn: float
    obstacle: float
    crowd: int


KINDS = {
    "microrobot": Kind(0.4, 0.1, 0.2, 0.01, 0.0, 0.012, 12),
    "tabletop": Kind(1.5, 0.5, 0.6, 0.03, 0.05, 0.04, 12),
    "warehouse": Kind(40.0, 2.0, 0.6, 0.6, 1.0, 0.8, 16),
    "delivery": Kind(80.0, 1.5, 0.8, 0.4, 0.6, 0.4, 20),
    "car": Kind(200.0, 15.0, 3.0, 1.2, 6.0, 1.5, 16),
    "lorry": Kind(500.0, 20.0, 0.8, 2.0, 14.0, 2.5, 16),
    "drone": Kind(300.0, 15.0, 5.0, 0.5, 0.0, 1.0, 20),
    "rail": Kind(3000.0, 30.0, 0.6, 2.0, 300.0, 4.0, 24),
    "submarine": Kind(400.0, 1.5, 0.1, 2.0, 10.0, 4.0, 16),
    "boat": Kind(1500.0, 10.0, 0.5, 4.0, 40.0, 12.0, 16),
    "ship": Kind(12000.0, 9.0, 0.03, 60.0, 500.0, 120.0, 16),
    "aircraft": Kind(8000.0, 60.0, 2.0, 20.0, 600.0, 60.0, 12),
}


def drawn_scene(kind: Kind, rng: np.random.Generator, count: int, observed: bool, name: str) -> Scene:
    """Return a trip of a kind among discs that cross its line about when the vehicle might be there."""
    scene: Scene = {
        "schema": 1,
        "name": name,
        "vehicle": {
            "radius": kind.radius,
            "max_speed": kind.top,
            "max_acceleration": kind.acceleration,
            "max_deceleration": 1.3 * kind.acceleration,
            "max_lateral_acceleration": 1.3 * kind.acceleration,
            "max_curvature": 1.0 / kind.turn if kind.turn else None,
        },
        "start": {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.3 * kind.top},
        "goal": {"position": [kind.trip, 0.0]},
        "obstacles": [],
    }
    while len(scene["obstacles"]) < count:
        obstacle = _crosser(kind, rng, f"o{len(scene['obstacles'])}", observed)
        try:
            families.as_scenario({**scene, "obstacles": [obstacle]})
        except scp_planner.ScenarioError:
            continue  # it covers the start
        scene["obstacles"].append(obstacle)
    return scene


def _crosser(kind: Kind, rng: np.random.Generator, name: str, observed: bool) -> Scene:
    along = rng.uniform(0.15, 0.9) * kind.trip
    velocity = kind.top * np.array([rng.uniform(-0.2, 0.2), rng.choice([-1.0, 1.0]) * rng.uniform(0.15, 0.5)])
    when = along / (0.9 * kind.top) + rng.normal(0.0, 0.04) * kind.trip / kind.top
    place = np.array([along, 0.0]) - velocity * when
    obstacle: Scene = {"id": name, "shape": {"disc": float(kind.obstacle * rng.uniform(0.7, 1.5))}}
    if not observed:
        return {**obstacle, "motion": {"position": place.tolist(), "velocity": velocity.tolist()}}
    deviation = 0.1 * kind.obstacle
    times = np.linspace(-SEEN_SHARE * kind.trip / kind.top, 0.0, SEEN)
    places = place + times[:, None] * velocity + deviation * rng.normal(size=(SEEN, 2))
    noise = [[deviation**2, 0.0], [0.0, deviation**2]]
    seen = {"time": times.tolist(), "position": places.tolist(), "covariance": noise}
    return {**obstacle, "observations": seen, "model": {"order": 1}}


def rewritten(scene: Mapping[str, Any], length: float, time: float) -> Scene:
    """Return the same scene with lengths and times so many times as large: of what scenes of this benchmark have."""
    copy: Scene = json.loads(json.dumps(scene))
    speed, rate = length / time, length / time**2
    _scale(copy["vehicle"], radius=length, max_speed=speed, max_acceleration=rate, max_deceleration=rate)
    _scale(copy["vehicle"], max_lateral_acceleration=rate, max_curvature=1.0 / length)
    _scale(copy["start"], time=time, position=length, speed=speed)
    _scale(copy["goal"], position=length, speed=speed, radius=length)
    for obstacle in copy["obstacles"]:
        _scale(obstacle, margin=length)
        _scale(obstacle["shape"], disc=length)
        _scale(obstacle.get("motion") or {}, position=length, velocity=speed, acceleration=rate)
        _scale(obstacle.get("observations") or {}, time=time, position=length, covariance=length**2)
    return copy


def _scale(part: Scene, **units: float) -> None:
    for key, unit in units.items():
        if part.get(key) is not None:
            part[key] = (unit * np.array(part[key], dtype=float)).tolist()


def natural_factors(scene: Mapping[str, Any]) -> tuple[float, float]:
    """Factors of lengths and times by which a scene's trip becomes 20 long at a top speed of 3."""
    length = 20.0 / math.dist(scene["start"]["position"], scene["goal"]["position"])
    return length, length * scene["vehicle"]["max_speed"] / 3.0


def scenes(options: argparse.Namespace) -> Iterator[tuple[str, Scene]]:
    """Kinds and scenes: those of the folders, or drawn ones."""
    for folder in options.folders:
        for path in sorted(folder.glob("*.json")):
            data = json.loads(path.read_text(encoding="utf-8"))
            if "vehicle" in data:
                yield common.family_of(path.stem), {**data, "name": path.stem}
    if options.folders:
        return
    for number, (name, kind) in enumerate(KINDS.items()):
        for case in range(options.count):
            for observed in (False, True):
                for dense in (False, True):
                    rng = np.random.default_rng([options.seed, number, case, observed, dense])
                    count = kind.crowd if dense else kind.crowd // 4
                    label = f"{'observed' if observed else 'known'}-{'dense' if dense else 'easy'}"
                    yield name, drawn_scene(kind, rng, count, observed, f"{name}-{label}-{case}")


def measured(kind: str, scene: Scene) -> dict[str, Any]:
    """Plan one scene in all units; return its row."""
    length, time = natural_factors(scene)
    mine, work = _planned(scene, AGAIN)
    other, _ = _planned(rewritten(scene, length, time), 1)
    third, _ = _planned(rewritten(scene, *OTHER_UNITS), 1)
    more = scp_planner.plan(families.as_scenario(scene), MORE)
    fine = scp_planner.plan(families.as_scenario(scene), replace(FINER, path_span=FINER_SPAN / length))
    times = [mine.travel_time, other.travel_time / time, third.travel_time / OTHER_UNITS[1]]
    times += [more.travel_time, fine.travel_time]
    held = [plan.certified for plan in (mine, other, third, more, fine)]
    best = min((each for each, holds in zip(times, held, strict=True) if holds), default=math.nan)
    return {
        "kind": kind,
        "scenario": scene["name"],
        "obstacles": len(scene["obstacles"]),
        "certified": int(mine.certified),
        "certified_rewritten": int(other.certified),
        "certified_anyhow": int(any(held)),
        "travel_time": times[0],
        "rewritten": times[1],
        "best": best,
        "ratio": times[0] / best if mine.certified else math.nan,
        "converged": int(bool(mine.converged)),
        "iterations": mine.iterations,
        "work_ms": 1e3 * work,
    }


def _planned(scene: Scene, repeat: int) -> tuple[Any, float]:
    """A plan, and the processor time that it takes, s: on one thread, less hurt by what else runs than the clock."""
    scenario, works = families.as_scenario(scene), []
    for _ in range(repeat):
        began = process_time()
        plan = scp_planner.plan(scenario)
        works.append(process_time() - began)
    return plan, common.median(works)


@dataclass(frozen=True)
class ReferenceWork:
    """Processor time of plans of the reference family, ms: the median, and the share of scenes far above it."""

    median: float
    long: float


def reference_works(counts: Sequence[int], seed: int, scenes_each: int = 30) -> dict[int, ReferenceWork]:
    """Work of plans of the reference family with so many obstacles, by their number."""
    found = {}
    for count in sorted(set(counts)):
        rng = np.random.default_rng([seed, count])
        drawn = [families.random_scenario(f"crossing{count}", rng) for _ in range(scenes_each)]
        works = [1e3 * _planned(scene, AGAIN)[1] for scene in drawn]
        median = common.median(works)
        found[count] = ReferenceWork(median, sum(work > LONG * median for work in works) / scenes_each)
    return found


def summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table: a line for each kind, and one for all."""
    lines = []
    for kind in [*dict.fromkeys(row["kind"] for row in rows), "all"]:
        chosen = [row for row in rows if kind in (row["kind"], "all")]
        ratios = [float(row["ratio"]) for row in chosen]
        lines.append(
            [
                kind,
                f"{sum(int(row['certified']) for row in chosen)}/{sum(int(row['certified_anyhow']) for row in chosen)}",
                f"{common.quantile(ratios, 0.5):.4f}",
                f"{common.quantile(ratios, 0.95):.4f}",
                f"{common.median(float(row['work_ms']) for row in chosen):.0f}",
                f"{common.median(_of_reference(row) for row in chosen):.2f}",
                str(sum(_of_reference(row) > LONG for row in chosen)),
                f"{sum(float(row['reference_long']) for row in chosen):.1f}",
            ]
        )
    heads = [
        "kind",
        "certified / by any",
        "time / best",
        "95 %",
        "work ms",
        "of the reference's",
        "over 3 times",
        "reference",
    ]
    return common.table(heads, lines)


def _of_reference(row: Mapping[str, Any]) -> float:
    return float(row["work_ms"]) / float(row["reference_ms"])


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    made = argparse.ArgumentParser(prog="python -m benchmarks.sizes", description=(__doc__ or "").splitlines()[0])
    made.add_argument("folders", nargs="*", type=Path, metavar="FOLDER", help="of scenarios KIND-NUMBER.json")
    made.add_argument("--count", type=int, default=2, help="scenes of each kind and case (default: 2)")
    made.add_argument("--seed", type=int, default=0, help="of the scenes (default: 0)")
    made.add_argument("--output", type=Path, default=common.DEFAULT_OUTPUT, help="folder of the CSV file")
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """Run. Exit code 1: a scene is certified in some units, but not as it is."""
    options = parser().parse_args(arguments)
    scp_planner.plan(families.as_scenario(families.random_scenario("crossing3", np.random.default_rng(0))))
    rows = []
    for kind, scene in scenes(options):
        rows.append(measured(kind, scene))
        common.say(f"{scene['name']}: {rows[-1]['ratio']:.4f}, {rows[-1]['work_ms']:.0f} ms")
    works = reference_works([row["obstacles"] for row in rows], options.seed)
    for row in rows:
        work = works[row["obstacles"]]
        row.update(reference_ms=work.median, reference_long=work.long)
    common.write_csv(options.output / "sizes.csv", rows)
    common.write_environment(options.output / "sizes-environment.csv", common.environment())
    print(summary(rows))
    return int(any(row["certified_anyhow"] > row["certified"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
