"""Run the peers: ``python -m benchmarks.peers``.

Scenario by scenario, and in the same order for all, every method plans from the same starts; a method that
chooses its starts itself plans once. `one` is the first start; `ten` is the best checked answer of all of
them, and the sum of their times. An answer is *certified* here if the method calls it a success and the
dense check holds with the tolerances of ``benchmarks.peers.base.JUDGE``, the same for every method.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.families import random_scenario
from benchmarks.peers.base import Attempt, MissingPeerError, Scenario, judge
from benchmarks.peers.starts import TEN_STARTS, Start

RANDOM_FAMILIES = ("crossing10", "crossing20", "crossing30", "headon", "convoy")
"""Those of `benchmarks.families` whose obstacles are discs with known motions, as the peers have them."""

HARDER_FAMILIES = ("crossing20", "crossing40", "convoy", "headon")
"""Families of random scenarios that follow the reference scenarios in the same run: most starts fail in these."""

PACKAGES = ("numpy", "scipy", "daqp", "casadi", "openscvx", "jax", "cvxpy")
REFERENCE = "scp_planner.plan"
REFERENCE_RUN = "scp_planner one run"


def makers() -> dict[str, Callable[[], Any]]:
    """The methods by name, in the order in which they run; each is imported only when it is made."""

    def own(name: str) -> Callable[[], Any]:
        def make() -> Any:
            from benchmarks.peers import own as module

            return getattr(module, name)()

        return make

    def casadi() -> Any:
        from benchmarks.peers.casadi_ipopt import CasadiIpopt

        return CasadiIpopt()

    def openscvx() -> Any:
        from benchmarks.peers.openscvx_ptr import OpenScvx

        return OpenScvx()

    def slsqp() -> Any:
        from benchmarks.peers.slsqp import Slsqp

        return Slsqp()

    return {
        REFERENCE: own("WholePlan"),
        REFERENCE_RUN: own("OneRun"),
        "casadi-ipopt": casadi,
        "openscvx": openscvx,
        "scipy-slsqp": slsqp,
        "penalty descent": own("PenaltyDescent"),
    }


def run_start(peer: Any, scenario: Scenario, start: Start, repeat: int) -> dict[str, Any]:
    """Solve ``repeat`` times from one start; the median time, and the verdicts on the last answer."""
    walls = []
    for _ in range(repeat):
        began = perf_counter()
        try:
            attempt = peer.solve(scenario, start)
        except Exception as error:  # a method that breaks down has failed at this start, no more
            attempt = Attempt(False, None, 0.0, float("nan"), 0, f"{type(error).__name__}: {error}")
            common.say(f"  {peer.name} at {scenario['name']}: {attempt.detail}")
        walls.append(perf_counter() - began)
    return _judged(peer, scenario, start, attempt, common.median(walls))


def _judged(peer: Any, scenario: Scenario, start: Start, attempt: Attempt, wall: float) -> dict[str, Any]:
    report = judge(scenario, attempt)
    checked = report is not None and report.ok
    return {
        "method": peer.name,
        "scenario": scenario["name"],
        "bow": None if peer.own_starts else start.bow,
        "speed_share": None if peer.own_starts else start.speed_share,
        "wall_ms": 1e3 * wall,
        "success": int(attempt.success),
        "checked": int(checked),
        "certified": int(attempt.success and checked),
        "travel_time": attempt.travel_time,
        "iterations": attempt.iterations,
        "detail": attempt.detail,
        "dense_check_says": "" if report is None or report.ok else str(report),
    }


def several(starts: Sequence[Start]) -> str:
    """Name of a set of more than one start."""
    return "ten" if len(starts) == len(TEN_STARTS) else f"first {len(starts)}"


def summarised(rows: Sequence[dict[str, Any]], start_set: str) -> dict[str, Any]:
    """One method on one scenario: the starts in ``rows`` taken together."""
    certified = [row for row in rows if row["certified"]]
    best = min(certified, key=lambda row: row["travel_time"]) if certified else None
    return {
        "method": rows[0]["method"],
        "family": common.family_of(rows[0]["scenario"]),
        "scenario": rows[0]["scenario"],
        "start_set": start_set,
        "starts": len(rows),
        "wall_ms": sum(row["wall_ms"] for row in rows),
        "success": int(any(row["success"] for row in rows)),
        "checked": int(any(row["checked"] for row in rows)),
        "certified": int(bool(certified)),
        "certified_starts": len(certified),
        "travel_time": best["travel_time"] if best else float("nan"),
        "iterations": sum(row["iterations"] for row in rows),
    }


def chosen_scenarios(options: argparse.Namespace, family: str) -> list[dict[str, Any]]:
    """The reference scenarios of a family, or as many random ones as are asked for."""
    if options.random is None:
        return common.load_family(common.scenario_folder(options.data), family, options.count)
    rng = np.random.default_rng([options.seed, *family.encode()])
    return [random_scenario(family, rng, f"{family}-r{options.seed}.{k}") for k in range(options.random)]


def file_stem(options: argparse.Namespace) -> str:
    """Name of the CSV files, without what follows it."""
    return "peers" if options.random is None else "peers-random"


def measure(options: argparse.Namespace) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Run everything; return the rows per scenario and those per start."""
    peers = []
    for name in options.methods:
        try:
            peers.append(makers()[name]())
        except (MissingPeerError, ImportError) as error:
            common.say(f"{name} is left out: {error}")
    starts = TEN_STARTS[: options.starts]
    summaries: list[dict[str, Any]] = []
    details: list[dict[str, Any]] = []
    for family in options.families:
        scenarios = chosen_scenarios(options, family)
        ready = []
        for peer in peers:
            began = perf_counter()
            try:
                peer.build(scenarios)
            except (MissingPeerError, ImportError) as error:
                common.say(f"{peer.name} is left out of {family}: {error}")
                continue
            ready.append(peer)
            common.say(f"{family}: built {peer.name} in {perf_counter() - began:.2f} s (not counted below)")
        for scenario in scenarios:
            for peer in ready:
                chosen = starts[:1] if peer.own_starts else starts
                rows = [run_start(peer, scenario, start, options.repeat) for start in chosen]
                sets = ["plan"] if peer.own_starts else ["one"] + ([several(starts)] if len(starts) > 1 else [])
                details += rows
                for start_set in sets:
                    summary = summarised(rows[:1] if start_set == "one" else rows, start_set)
                    summaries.append(summary)
                    line = f"  {scenario['name']:<13} {peer.name:<20} {start_set:<4}"
                    line += f" {summary['wall_ms']:9.1f} ms, {summary['travel_time']:.4f} s,"
                    common.say(f"{line} certified {summary['certified_starts']}/{summary['starts']}")
            # Written as it goes: a long run that is interrupted leaves what it has measured.
            common.write_csv(options.output / f"{file_stem(options)}.csv", summaries)
            common.write_csv(options.output / f"{file_stem(options)}-starts.csv", details)
    return summaries, details


def report(summaries: list[dict[str, Any]], details: list[dict[str, Any]], known: dict[str, float]) -> str:
    """Tables of medians, of certified answers, and of ratios to scp_planner within this run."""
    parts = []
    for family in [*dict.fromkeys(row["family"] for row in summaries), "all"]:
        chosen = [row for row in summaries if family in ("all", row["family"])]
        plans = {row["scenario"]: row for row in chosen if row["method"] == REFERENCE}
        lines = []
        for method, start_set in dict.fromkeys((row["method"], row["start_set"]) for row in chosen):
            rows = [row for row in chosen if (row["method"], row["start_set"]) == (method, start_set)]
            names = {row["scenario"] for row in rows}
            starts = [row for row in details if row["method"] == method and row["scenario"] in names]
            lines.append(_line(rows, [] if start_set in ("one", "plan") else starts, plans, known))
        headings = ["method", "starts", "wall ms", "a start ms", "certified", "certified starts"]
        headings += ["time / best known", "wall / plan()", "time / plan()"]
        parts.append(f"### {family}\n\n{common.table(headings, lines)}\n")
    ratios = start_ratios(details, "casadi-ipopt", REFERENCE_RUN)
    if ratios:
        parts.append(f"Wall time a start, casadi-ipopt / {REFERENCE_RUN}: median {common.median(ratios):.1f}.\n")
    return "\n".join(parts)


def _line(
    rows: Sequence[dict[str, Any]],
    starts: Sequence[dict[str, Any]],
    plans: dict[str, dict[str, Any]],
    known: dict[str, float],
) -> list[object]:
    """One line of the table: medians of one method over the scenarios of a family."""

    def certified(of: Sequence[dict[str, Any]]) -> str:
        return f"{sum(row['certified'] for row in of)}/{len(of)}" if of else ""

    both = [(row, plans[row["scenario"]]) for row in rows if row["scenario"] in plans]
    to_known = common.median(row["travel_time"] / known.get(row["scenario"], np.nan) for row in rows)
    to_plan = common.median(row["travel_time"] / plan["travel_time"] for row, plan in both)
    return [
        rows[0]["method"],
        rows[0]["start_set"],
        common.number(common.median(row["wall_ms"] for row in rows), 1),
        common.number(common.median(row["wall_ms"] for row in starts), 1) if starts else "",
        certified(rows),
        certified(starts),
        common.number(to_known, 5),
        common.number(common.median(row["wall_ms"] / plan["wall_ms"] for row, plan in both), 2),
        common.number(to_plan, 5),
    ]


def start_ratios(details: Sequence[dict[str, Any]], slow: str, fast: str) -> list[float]:
    """Ratios of the wall time of two methods, for each scenario and start that both have."""
    walls = {(row["method"], row["scenario"], row["bow"], row["speed_share"]): row["wall_ms"] for row in details}
    return [
        wall / walls[(fast, *key)] for (method, *key), wall in walls.items() if method == slow and (fast, *key) in walls
    ]


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    made = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__.splitlines()[0])
    known, methods = common.REFERENCE_FAMILIES, list(makers())
    made.add_argument("--families", nargs="+", metavar="FAMILY",
                      help=f"of {', '.join(known)} (default: all), or of benchmarks.families")  # fmt: skip
    made.add_argument("--count", type=int, help="scenarios of each family (default: all)")
    made.add_argument("--methods", nargs="+", default=methods, choices=methods, metavar="METHOD",
                      help=f"of {', '.join(repr(name) for name in methods)} (default: all)")  # fmt: skip
    made.add_argument("--starts", type=int, default=10, choices=range(1, 11), metavar="N",
                      help="of the ten starts, the first N (default: 10)")  # fmt: skip
    made.add_argument("--repeat", type=int, default=1, help="timed calls a start, the median counts (default: 1)")
    made.add_argument("--random", type=int, metavar="N",
                      help="N random scenarios of each family instead of the reference scenarios")  # fmt: skip
    made.add_argument("--harder", type=int, default=0, metavar="N",
                      help=f"in the same run, also N random ones of each of {', '.join(HARDER_FAMILIES)}")  # fmt: skip
    made.add_argument("--seed", type=int, default=0, help="of the random scenarios (default: 0)")
    made.add_argument("--data", type=Path, help="folder of the reference scenarios")
    made.add_argument("--output", type=Path, default=common.DEFAULT_OUTPUT, help="folder of the CSV files")
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print."""
    options = parser().parse_args(arguments)
    if options.families is None:
        options.families = common.REFERENCE_FAMILIES if options.random is None else RANDOM_FAMILIES
    parts = [options]
    if options.harder and options.random is None:
        parts.append(argparse.Namespace(**{**vars(options), "random": options.harder, "families": HARDER_FAMILIES}))
    try:
        known = {} if options.random is not None else common.best_known(common.scenario_folder(options.data))
        measured = [measure(part) for part in parts]
    except common.MissingDataError as error:
        common.say(f"benchmarks.peers: {error}")
        return 2
    facts = common.environment(PACKAGES)
    for part in parts:
        common.write_environment(options.output / f"{file_stem(part)}-environment.csv", facts)
    print(", ".join(f"{name} {value}" for name, value in facts.items()))
    for part, (summaries, details) in zip(parts, measured, strict=True):
        print(f"\n## {'Random' if part.random is not None else 'Reference'} scenarios\n")
        print(report(summaries, details, known))
    if len(parts) > 1:
        print(f"## {' and '.join(str(len(scenarios_of(rows))) for rows, _ in measured)} scenarios together\n")
        print(rates([row for summaries, _ in measured for row in summaries]))
    return 0


def scenarios_of(rows: Sequence[dict[str, Any]]) -> set[str]:
    """Names of the scenarios that rows are about."""
    return {row["scenario"] for row in rows}


def rates(rows: Sequence[dict[str, Any]]) -> str:
    """Table of the certified answers of each method to all scenarios."""
    lines = []
    for method, start_set in dict.fromkeys((row["method"], row["start_set"]) for row in rows):
        chosen = [row for row in rows if (row["method"], row["start_set"]) == (method, start_set)]
        lines.append([method, start_set, f"{sum(row['certified'] for row in chosen)}/{len(chosen)}"])
    return common.table(["method", "starts", "certified"], lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
