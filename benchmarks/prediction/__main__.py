"""Predicted regions: how sharp they are and how often they hold.

    python -m benchmarks.prediction                                   all families and recordings, level per_obstacle
    python -m benchmarks.prediction --families walkers,weaving --levels per_time,per_obstacle,joint --labels yes,no

Of each family: share of the truths in their regions and radius at leads of 0.5, 1 and 2 s, the best constant radius in
hindsight; share of whole tubes to 2 s and the best constant tube; the ratio (radius + s) / (best + s) at 1 s with s =
max(noise, 0.1 m); the share that is held again 0.2, 0.5 and 1 s after a change of motion. Recordings are read from
``SCP_PLANNER_DATA`` or ``--tracks``.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.online import Ledger
from benchmarks.prediction import families, recordings
from benchmarks.prediction.rows import KEYS, measure, table

LEVELS = ("per_time", "per_obstacle", "joint")


def regions(options: argparse.Namespace) -> int:
    wanted = [
        dict(zip(KEYS, (family, label, level, options.count, options.seed), strict=True))
        for family in options.families
        for label in options.labels
        for level in options.levels
    ]
    for row in wanted:
        row["tracks_folder"] = options.tracks or ""
    ledger = Ledger(options.output / "prediction.csv", KEYS, options.fresh)
    rows = ledger.fill_in_processes(wanted, measure, options.workers)
    sys.stdout.write(table(rows) + "\n")
    for level in options.levels:
        ratios = [float(row["ratio"]) for row in rows if row["level"] == level]
        mean = float(np.exp(np.mean(np.log(ratios))))
        sys.stdout.write(f"{level}: ratio {mean:.2f} in the geometric mean, {max(ratios):.2f} at most\n")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.prediction",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=regions)
    every = (*families.NAMES, *recordings.PLACES)
    parser.add_argument("--families", type=common.names_among(every), default=list(every), help="default: all")
    parser.add_argument(
        "--levels", type=common.names_among(LEVELS), default=["per_obstacle"], help="default: per_obstacle"
    )
    parser.add_argument(
        "--labels", type=common.names_among(("yes", "no")), default=["yes"], help="class models; default: yes"
    )
    parser.add_argument("--count", type=int, default=42, help="motions of a family; default: 42")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1, help="processes; default: 1")
    parser.add_argument("--tracks", help="folder of recorded motions; default: SCP_PLANNER_DATA")
    parser.add_argument("--output", type=Path, default=common.DEFAULT_OUTPUT, help="folder of the CSV file")
    parser.add_argument("--fresh", action="store_true", help="forget what an earlier call wrote")
    return common.run_command(parser, argv)


if __name__ == "__main__":
    raise SystemExit(main())
