"""Everyday closed loops: people, carts, cars, boats, drones, doors and lifts, as a new user writes them.

    python -m benchmarks.everyday                                     all scenes, configuration A, one seed
    python -m benchmarks.everyday --scenes lobby,patrol --controllers A,D,mppi --count 3
    python -m benchmarks.everyday --list                              the scenes, a line each

Controllers: the planner with default settings as A (class models, 4 cm of noise), B (no class models), C (class models,
exact positions, no covariance), D (as C without class models), E (as A with a deadline of 20 ms), F (as A, the vehicle
follows with a lag of 0.15 s); and stop-and-go, mppi, orca in the same loop. Each run is a row of a CSV file; called
again it goes on from there. ``--fresh`` begins anew.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from benchmarks.everyday import scenes
from benchmarks.everyday.controllers.product import CONFIGURATIONS
from benchmarks.everyday.runs import BASELINES, KEYS, run, table
from benchmarks.online import Ledger


def loops(options: argparse.Namespace) -> int:
    if options.list:
        for name in scenes.NAMES:
            first = (import_module(f"benchmarks.everyday.scenes.{name}").__doc__ or "").splitlines()[0]
            sys.stdout.write(f"{name:24s}{first}\n")
        return 0
    wanted = [
        dict(zip(KEYS, (scene, controller, seed), strict=True))
        for scene in options.scenes
        for controller in options.controllers
        for seed in range(options.seed, options.seed + options.count)
    ]
    ledger = Ledger(options.output / "everyday.csv", KEYS, options.fresh)
    rows = ledger.fill_in_processes(wanted, run, options.workers)
    sys.stdout.write(table(rows) + "\n")
    common.write_environment(options.output / "everyday-environment.csv", common.environment())
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.everyday", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.set_defaults(run=loops)
    parser.add_argument(
        "--scenes", type=common.names_among(scenes.NAMES), default=list(scenes.NAMES), help="default: all"
    )
    parser.add_argument(
        "--controllers", type=common.names_among((*CONFIGURATIONS, *BASELINES)), default=["A"], help="default: A"
    )
    parser.add_argument("--count", type=int, default=1, help="seeds a scene; default: 1")
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    parser.add_argument("--workers", type=int, default=1, help="processes; default: 1")
    parser.add_argument("--output", type=Path, default=common.DEFAULT_OUTPUT, help="folder of the CSV files")
    parser.add_argument("--fresh", action="store_true", help="forget what an earlier call wrote")
    parser.add_argument("--list", action="store_true", help="list the scenes")
    return common.run_command(parser, argv)


if __name__ == "__main__":
    raise SystemExit(main())
