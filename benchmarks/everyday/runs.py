"""Rows of everyday loops, and their table."""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import json
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.everyday import scenes
from benchmarks.everyday.controllers.baseline import Baseline
from benchmarks.everyday.controllers.mppi import Mppi
from benchmarks.everyday.controllers.orca import Orca
from benchmarks.everyday.controllers.product import CONFIGURATIONS, Product
from benchmarks.everyday.controllers.stop_and_go import StopAndGo
from benchmarks.everyday.loop import Controller, drive
from benchmarks.everyday.scene import Scene
from benchmarks.everyday.truth import known_trip, needless_stands
from benchmarks.online import Row

BASELINES: Mapping[str, Callable[[Scene], Baseline]] = {"stop-and-go": StopAndGo, "mppi": Mppi, "orca": Orca}
KEYS = ("scene", "controller", "seed")


def run(row: Row) -> Row:
    """One closed loop: times in s, lengths in m, processor times in ms."""
    scene, name = scenes.make(row["scene"], int(row["seed"])), row["controller"]
    configuration = CONFIGURATIONS.get(name)
    controller: Controller
    if configuration is None:
        controller = BASELINES[name](scene)
        found = drive(scene, controller, int(row["seed"]))
        stands: list[str] = [f"stands from {begin:.1f} to {end:.1f} s" for begin, end in found.stands]
    else:
        controller = Product(scene, configuration)
        found = drive(scene, controller, int(row["seed"]), configuration.exact, configuration.follower)
        stands = needless_stands(scene, found)
    known = math.nan if scene.is_patrol else known_trip(scene, found).travel_time
    median, most = np.quantile(found.times, (0.5, 0.99)) if found.times else (math.nan, math.nan)
    return {
        "arrived": int(found.arrived),
        "time": round(found.time, 2),
        "known": round(known, 3),
        "goals": found.goals,
        "gap": round(found.gap, 3),
        "ground": round(found.ground, 3),
        "driving": sum(each.driving for each in found.contacts),
        "standing": sum(not each.driving for each in found.contacts),
        "contacts": json.dumps([vars(each) for each in found.contacts]),
        "unsafe": found.unsafe,
        "replans": found.replans,
        "excess": round(found.excess, 3),
        "stands": json.dumps(stands),
        "median_ms": round(float(median), 2),
        "most_ms": round(float(most), 2),
        "reason": controller.reason,
    }


TIMES = ("median_ms", "most_ms")
HEADINGS = (
    "scene",
    "controller",
    "arrived",
    "time",
    "/ known",
    "goals",
    "contacts driving, standing",
    "gap",
    "stands",
    "unsafe, %",
    "ms, 99 %",
)


def table(rows: Sequence[Row]) -> str:
    """Rows of the same scene and controller together: medians over the seeds."""
    found = []
    for name, controller in dict.fromkeys((row["scene"], row["controller"]) for row in rows):
        some = [row for row in rows if (row["scene"], row["controller"]) == (name, controller)]
        there = [row for row in some if int(row["arrived"])]
        share = [float(row["time"]) / float(row["known"]) for row in there]
        driving, standing = (sum(int(row[key]) for row in some) for key in ("driving", "standing"))
        unsafe = 100.0 * sum(int(row["unsafe"]) for row in some) / sum(int(row["replans"]) for row in some)
        patrol = sum(int(row["goals"]) for row in some)
        found.append(
            (
                name,
                controller,
                f"{len(there)} of {len(some)}" if not patrol else "-",
                common.number(common.median(float(row["time"]) for row in there), 1),
                common.number(common.median(share), 2),
                common.number(patrol / len(some), 1) if patrol else "-",
                f"{driving}, {standing}",
                common.number(min(float(row["gap"]) for row in some), 2),
                sum(len(json.loads(row["stands"])) for row in some),
                common.number(unsafe, 1),
                ", ".join(common.number(common.median(float(row[key]) for row in some), 1) for key in TIMES),
            )
        )
    return common.table(HEADINGS, found)
