"""Try hostile input for some minutes, and report whatever may never happen.

``python -m benchmarks.hostile`` tries damaged scenario files, corridors with holes, absurd command lines, other clocks
and odd sensors, scenes from the product of features, their plans with edited fields, and drives through them with
absurd calls and other states than planned ones, in processes of their own. It finds exceptions other than those that
are documented, what takes over 10 s of the processor or 500 MB, and certified and safe plans that an independent check
refuses. Every finding is written with all that trying it again needs; ``--only KIND --seed N --count 1`` tries the one
of that seed.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from benchmarks import common
from benchmarks.hostile.cases import PLAN_TIME, Kind, make
from benchmarks.hostile.outcome import Outcome
from benchmarks.hostile.workers import tried

CODE_OF_FINDINGS = 1
INTERRUPTED = 130
COLUMNS = ("kind", "seed", "fault", "detail", "file")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return 0 if there was nothing to find, and 130, with what was tried until then, on Ctrl-C."""
    options = _parser().parse_args(argv)
    kinds = options.only or list(Kind)
    until = time.monotonic() + 60.0 * options.minutes
    report = Report(options.output, options.plan_time)
    drives = options.count if options.drives is None else options.drives
    counts = {kind: drives if kind is Kind.RIDE else options.count for kind in kinds}
    jobs = _jobs(counts, options.seed, until)
    code = 0
    try:
        for case in tried(jobs, options.workers, options.seconds, options.memory * 10**6, options.plan_time):
            report.add(*case)
    except KeyboardInterrupt:
        code = INTERRUPTED
    report.write()
    print(report.table())
    return code or (CODE_OF_FINDINGS if report.findings else 0)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.hostile", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("--seed", type=int, default=0, help="of the first case of each kind (default: 0)")
    parser.add_argument("--count", type=int, default=None, help="cases of each kind, at most (default: no limit)")
    parser.add_argument("--drives", type=int, default=None, help="rides, at most (default: as --count)")
    parser.add_argument("--minutes", type=float, default=5.0, help="after which no case is begun (default: 5)")
    parser.add_argument(
        "--only", type=Kind, action="append", metavar="KIND", help=f"one of {', '.join(Kind)}; repeatable"
    )
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes (default: one a core)")
    parser.add_argument("--seconds", type=float, default=10.0, help="of the processor for one case (default: 10)")
    parser.add_argument(
        "--plan-time", type=float, default=PLAN_TIME, help=f"s that a plan may take (default: {PLAN_TIME:g})"
    )
    parser.add_argument("--memory", type=int, default=500, help="MB for one process (default: 500)")
    parser.add_argument("--output", type=Path, default=common.DEFAULT_OUTPUT / "hostile", help="folder for findings")
    return parser


def _jobs(counts: Mapping[Kind, int | None], seed: int, until: float) -> Iterator[tuple[Kind, int]]:
    """Take kinds in turn, each with the next seed, until the time or the count of each is over."""
    for number in itertools.count():
        due = [kind for kind, count in counts.items() if count is None or number < count]
        if not due:
            return
        for kind in due:
            if time.monotonic() > until:
                return
            yield kind, seed + number


class Report:
    """What was tried, and what was found.

    Parameters
    ----------
    folder : Path
        Findings are written there as they come, and a table of them in the end.
    plan_time : float
        s that a plan was given.
    """

    def __init__(self, folder: Path, plan_time: float = PLAN_TIME) -> None:
        self.folder = folder
        self.plan_time = plan_time
        self.results: Counter[tuple[Kind, str]] = Counter()
        self.checked: Counter[Kind] = Counter()
        self.warned: Counter[str] = Counter()
        self.findings: list[dict[str, object]] = []

    def add(self, kind: Kind, seed: int, outcome: Outcome) -> None:
        """Count what came of a case, and write it down if it is a finding."""
        self.results[kind, outcome.result] += 1
        self.checked[kind] += outcome.checked
        self.warned.update(outcome.warned)
        if outcome.fault is None:
            return
        file = self.folder / f"{kind}-{seed}.json"
        case = asdict(make(kind, seed, self.plan_time))
        told = {"fault": outcome.fault, "detail": outcome.detail, "case": case, "plan": outcome.plan}
        common.write_text(file, json.dumps(told, indent=1) + "\n")
        last = outcome.detail.strip().splitlines()[-1:] or [""]
        common.say(f"{kind} {seed}: {outcome.fault}: {last[0]}")
        self.findings.append({"kind": kind, "seed": seed, "fault": outcome.fault, "detail": last[0], "file": file.name})

    def write(self) -> None:
        """Write the tables of findings, of results and of warnings."""
        common.write_csv(self.folder / "findings.csv", self.findings, COLUMNS)
        rows = [{"kind": kind, "result": result, "cases": n} for (kind, result), n in sorted(self.results.items())]
        common.write_csv(self.folder / "results.csv", rows, ("kind", "result", "cases"))
        told = [{"warning": warning, "cases": n} for warning, n in self.warned.most_common()]
        common.write_csv(self.folder / "warnings.csv", told, ("warning", "cases"))

    def table(self) -> str:
        """Give a line for each kind."""
        lines = []
        for kind in Kind:
            cases = sum(n for (each, _), n in self.results.items() if each is kind)
            if not cases:
                continue
            faults = Counter(str(one["fault"]) for one in self.findings if one["kind"] is kind)
            results = Counter({result: n for (each, result), n in self.results.items() if each is kind})
            came = ", ".join(f"{n} {result}" for result, n in results.most_common())
            found = ", ".join(f"{n} {fault}" for fault, n in faults.most_common()) or "nothing"
            lines.append([kind.value, cases, self.checked[kind], found, came])
        return common.table(["kind", "cases", "checked densely", "found", "came to"], lines)


if __name__ == "__main__":
    raise SystemExit(main())
