"""Which features work together: pairs, over random scenes that can be driven by construction.

    python -m benchmarks.pairs                                plans, all pairs of 13 features
    python -m benchmarks.pairs --online                       closed loops, all pairs of 13 features
    python -m benchmarks.pairs --only map,reverse --count 20  these features alone
    python -m benchmarks.pairs --three                        three features that users combine

Each scene begins with a simple motion that keeps a share of every limit to spare. Walls, cells and obstacles are put
clear of it, and targets, windows and places so that it meets them. A scene is planned if its plan is certified, or if
the vehicle arrives in a closed loop within three times the motion's time, and an independent check finds no fault. It
is refused if a ScenarioError names both features. All else is wrong. A pair is planned if 19 of 20 scenes are and none
is wrong. Progress and what is wrong go to stderr, the matrix to stdout.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import argparse
import itertools
import json
import sys
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from benchmarks.pairs.features import EITHER, OFFLINE, ONLINE, THREES
from benchmarks.pairs.offline import try_offline
from benchmarks.pairs.online import try_online
from benchmarks.pairs.scene import Feature, build
from benchmarks.pairs.verdict import Verdict

PLANNED = 0.95
"""Share of the scenes of a pair that are planned, for the pair to count as planned."""
CODE_OF_WRONG = 1


@dataclass
class Tally:
    """What came of the scenes of one combination of features."""

    features: tuple[str, ...]
    scenes: list[dict[str, Any]] = field(default_factory=list)

    def count(self, verdict: Verdict) -> int:
        return sum(scene["verdict"] == verdict for scene in self.scenes)

    @property
    def verdict(self) -> Verdict:
        """The verdict of the combination."""
        if self.count(Verdict.WRONG):
            return Verdict.WRONG
        enough = self.count(Verdict.PLANNED) >= PLANNED * len(self.scenes)
        return Verdict.PLANNED if enough else Verdict.REFUSED

    @property
    def cell(self) -> str:
        """Scenes planned, and those that are refused (r) or wrong (w)."""
        others = [(Verdict.REFUSED, "r"), (Verdict.WRONG, "w")]
        told = [f"{self.count(verdict)}{letter}" for verdict, letter in others if self.count(verdict)]
        return " ".join([str(self.count(Verdict.PLANNED)), *told])


def scenes_of(features: Sequence[Feature], seeds: Sequence[int], *, online: bool) -> Tally:
    """Try scenes of one combination of features, one a seed."""
    tally = Tally(tuple(feature.name for feature in features))
    key = zlib.crc32(",".join(tally.features).encode())
    for seed in seeds:
        rng = np.random.default_rng([seed, key, online])
        scene = build(features, rng)
        began = process_time()
        result = try_online(features, scene, rng) if online else try_offline(features, scene)
        row: dict[str, Any] = {"seed": seed, "verdict": str(result.verdict), "detail": result.detail}
        row |= {"seconds": round(process_time() - began, 3), "motion": scene.motion.duration}
        if result.verdict is Verdict.WRONG:
            row["scene"] = scene.described
            common.say(f"{'+'.join(tally.features)}, seed {seed}: {result.detail}")
        tally.scenes.append(row)
    common.say(f"{'+'.join(tally.features)}: {tally.cell}")
    return tally


def matrix(features: Sequence[Feature], tallies: Sequence[Tally]) -> str:
    """Lay pairs out by their features."""
    cells = {frozenset(tally.features): tally.cell for tally in tallies}
    names = [feature.name for feature in features]
    rows = [[row, *(cells.get(frozenset((row, column)), "") for column in names[:-1])] for row in names[1:]]
    lower = [
        [each if column <= number + 1 else "" for column, each in enumerate(row)] for number, row in enumerate(rows)
    ]
    return common.table(["", *names[:-1]], lower)


def summary(tallies: Sequence[Tally]) -> str:
    """Count combinations by their verdict, and scenes by theirs."""
    pairs = Counter(tally.verdict for tally in tallies)
    scenes = Counter(scene["verdict"] for tally in tallies for scene in tally.scenes)
    told = [
        ", ".join(f"{counted[verdict]} {verdict}" for verdict in Verdict) + f" of {counted.total()} {what}"
        for what, counted in (("combinations", pairs), ("scenes", scenes))
    ]
    return "; ".join(told)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return 1 if anything is wrong."""
    options = _parser().parse_args(argv)
    table = ONLINE if options.online else OFFLINE
    features = [feature for feature in table if options.only is None or feature.name in options.only]
    size = 3 if options.three else 2
    combinations = list(itertools.combinations(features, size))
    if options.three and options.only is None:
        combinations = [tuple(each for each in table if each.name in names) for names in THREES[options.online]]
    if not combinations:
        known = ", ".join(feature.name for feature in table)
        _parser().error(f"--only: {size} features are needed, of {known}")
    seeds = range(options.seed, options.seed + options.count)
    tallies = [scenes_of(each, seeds, online=options.online) for each in combinations]
    if size == 2:
        sys.stdout.write(matrix(features, tallies) + "\n")
    else:
        rows = [["+".join(tally.features), tally.cell, tally.verdict] for tally in tallies]
        sys.stdout.write(common.table(["features", "scenes", "verdict"], rows) + "\n")
    sys.stdout.write(summary(tallies) + "\n")
    if options.json is not None:
        told = {"online": options.online, "environment": common.environment(), "combinations": []}
        told["combinations"] = [{**asdict(tally), "verdict": str(tally.verdict)} for tally in tallies]
        common.write_text(options.json, json.dumps(told, indent=1) + "\n")
    return CODE_OF_WRONG if any(tally.verdict is Verdict.WRONG for tally in tallies) else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.pairs", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--online", action="store_true", help="drive in closed loops")
    parser.add_argument("--count", type=int, default=1, help="scenes of each pair; default: 1")
    parser.add_argument("--seed", type=int, default=0, help="of the first scene; default: 0")
    parser.add_argument("--only", type=common.names_among(tuple(EITHER)), help="features, separated by commas")
    parser.add_argument("--three", action="store_true", help="threes that users combine, or all of --only")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every scene that was tried")
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
