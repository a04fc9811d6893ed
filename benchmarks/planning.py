"""The reference scenarios with ``scp_planner.plan``: success, travel time, iterations, and the time of each
stage.

    python -m benchmarks.planning                    all families, a table and a CSV file
    python -m benchmarks.planning --scaling          time a plan against the number of far obstacles
    python -m benchmarks.planning --random 2000      random scenarios: does the dense check refuse a
    certified plan?
    python -m benchmarks.planning --random 200 --effort 20      the same, and which of them more effort makes faster
    python -m benchmarks.planning --folders DIR ...  travel time / best known over folders with a best_known.json

Every plan is judged by :mod:`verification.dense_check` with its strict tolerances, the errors of finite
differences. Times are medians of ``--repeat`` calls on one thread; the first call of a family is not timed.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import argparse
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import scp_planner
from benchmarks import families
from verification.dense_check import check_trip
from verification.findings import DenseReport

NOTABLY = 1.005  # times the best: a plan that misses it
SCALING_COUNTS = (50, 100, 200, 400, 600, 800, 1000)
SCALING_CROWDS = 3
SCALING_REPEATS = 15


@dataclass(frozen=True)
class Outcome:
    """A plan, how long it took, and what the dense check says of it."""

    plan: Any
    wall_time: float  # s, median
    timings: Mapping[str, float]  # s, medians
    report: DenseReport

    @property
    def refused(self) -> bool:
        """Whether the plan claims a certificate that the dense check does not confirm."""
        return bool(self.plan.certified) and not self.report.ok


def run(data: families.Scenario, repeat: int, solver: str | None = None, effort: float = 1.0) -> Outcome:
    """Plan one scenario ``repeat`` times, with some effort, and check the plan."""
    settings = scp_planner.Settings(effort=effort)
    scenario = families.as_scenario(data)
    walls, stages = [], []
    for _ in range(repeat):
        began = perf_counter()
        plan = scp_planner.plan(scenario, settings, solver=solver)
        walls.append(perf_counter() - began)
        stages.append(plan.timings)
    timings = {name: common.median(stage.get(name, 0.0) for stage in stages) for name in stages[-1]}
    report = check_trip(
        data, plan.position, plan.start_time, plan.arrival_time, regions=_regions(scenario, plan.arrival_time)
    )
    return Outcome(plan, common.median(walls), timings, report)


def _regions(scenario: scp_planner.Scenario, until: float) -> dict[str, float]:
    """Size of each observed obstacle's confidence region; the level is the planner's business, not the check's.

    The planner's regions hold for longer than the trip, and so are no smaller than these.
    """
    from scp_planner.tracking.estimate import estimate_obstacle
    from scp_planner.tracking.motion_estimate import region_scale

    observed = [obstacle for obstacle in scenario.obstacles if obstacle.observations is not None]
    return {
        obstacle.id: region_scale(
            str(scenario.confidence.level),
            scenario.confidence.probability,
            estimate_obstacle(obstacle),
            obstacles=len(observed),
            start=scenario.start.time,
            stop=until,
        )
        for obstacle in observed
    }


def reference(options: argparse.Namespace) -> int:
    """Run the reference scenarios; return how many certified plans were refused by the dense check."""
    folder = common.scenario_folder(options.data)
    best = common.best_known(folder)
    rows: list[dict[str, Any]] = []
    stages: list[str] = []
    for family in options.families:
        scenarios = common.load_family(folder, family, options.count)
        scp_planner.plan(families.as_scenario(scenarios[0]), solver=options.solver)
        for data in scenarios:
            outcome = run(data, options.repeat, options.solver)
            plan, known = outcome.plan, best.get(data["name"])
            stages += [name for name in outcome.timings if name not in stages]
            rows.append(
                {
                    "family": family,
                    "scenario": data["name"],
                    "status": str(plan.status),
                    "certified": int(plan.certified),
                    "dense_check": int(outcome.report.ok),
                    "travel_time": plan.travel_time,
                    "best_known": known,
                    "ratio": plan.travel_time / known if known and plan.certified else float("nan"),
                    "lower_bound": plan.lower_bound,
                    "iterations": plan.iterations,
                    "wall_ms": 1e3 * outcome.wall_time,
                    **{f"{name}_ms": 1e3 * seconds for name, seconds in outcome.timings.items()},
                    "reason": plan.reason or "",
                    "dense_check_says": "" if outcome.report.ok else str(outcome.report),
                }
            )
            common.say(_progress(rows[-1]))
    common.write_csv(options.output / "planning.csv", rows, _columns(rows))
    _print_environment(options)
    _print_reference(rows, stages, options)
    return _refused(rows)


def _progress(row: Mapping[str, Any]) -> str:
    check = "holds" if row["dense_check"] else f"REFUSED: {row['dense_check_says']}"
    reason = f" ({row['reason']})" if row["reason"] else ""
    return (
        f"{row['scenario']:<14} {row['status']:<10} {row['travel_time']:.4f} s, ratio {row['ratio']:.5f}, "
        f"{row['iterations']:>4} iterations, {row['wall_ms']:.1f} ms, dense check {check}{reason}"
    )


def _columns(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    names = list(dict.fromkeys(key for row in rows for key in row))
    late = ("reason", "dense_check_says")
    return [name for name in names if name not in late] + [name for name in late if name in names]


def _refused(rows: Sequence[Mapping[str, Any]]) -> int:
    return sum(1 for row in rows if row["certified"] and not row["dense_check"])


def _print_environment(options: argparse.Namespace) -> None:
    facts = common.environment()
    common.write_environment(options.output / "planning-environment.csv", facts)
    print(", ".join(f"{name} {value}" for name, value in facts.items()))
    print()


def _print_reference(rows: list[dict[str, Any]], stages: list[str], options: argparse.Namespace) -> None:
    headings = ["family", "certified", "dense check", "ratio median", "ratio 95 %", "ratio worst", "better"]
    headings += ["iterations", "wall ms", "wall ms 95 %", *(f"{name} ms" for name in stages)]
    lines = []
    for family in [*options.families, "all"]:
        chosen = [row for row in rows if family in ("all", row["family"])]
        ratios = [row["ratio"] for row in chosen]
        lines.append(
            [
                family,
                f"{sum(row['certified'] for row in chosen)}/{len(chosen)}",
                f"{sum(row['dense_check'] for row in chosen)}/{len(chosen)}",
                *(common.number(common.quantile(ratios, level), 5) for level in (0.5, 0.95, 1.0)),
                sum(ratio < 1.0 for ratio in ratios),
                common.median(row["iterations"] for row in chosen),
                common.number(common.median(row["wall_ms"] for row in chosen), 1),
                common.number(common.quantile((row["wall_ms"] for row in chosen), 0.95), 1),
                *(common.number(common.median(row.get(f"{name}_ms", np.nan) for row in chosen), 2) for name in stages),
            ]
        )
    print(common.table(headings, lines))
    print(f"\nratio: travel time / best known, certified plans only. {_refused(rows)} certified plans refused.")


def against_best(options: argparse.Namespace) -> int:
    """Compare with the best known times of all scenarios of some folders; return how many plans were refused."""
    rows: list[dict[str, Any]] = []
    for folder in options.folders:
        best = common.best_known(folder)
        if not best:
            raise common.MissingDataError(f"no best_known.json in {folder}")
        for name, known in sorted(best.items()):
            data = common.load_scenario(folder, name)
            outcome = run(data, options.repeat, options.solver, options.effort)
            plan = outcome.plan
            rows.append(
                {
                    "folder": folder.name,
                    "family": common.family_of(name),
                    "scenario": name,
                    "certified": int(plan.certified),
                    "dense_check": int(outcome.report.ok),
                    "travel_time": plan.travel_time,
                    "best_known": known,
                    "ratio": plan.travel_time / known if plan.certified else float("inf"),
                    "iterations": plan.iterations,
                    "wall_ms": 1e3 * outcome.wall_time,
                }
            )
            common.say(f"{name:<16} {plan.travel_time:.4f} s, ratio {rows[-1]['ratio']:.5f}")
    common.write_csv(options.output / "against-best.csv", rows)
    _print_environment(options)
    headings = ["scenarios", "number", "median", "95 %", "worst", "> 0.5 %", "better", "iterations", "ms", "ms 95 %"]
    groups = {family: [row for row in rows if row["family"] == family] for family in {row["family"]: 0 for row in rows}}
    lines = []
    for group, chosen in {**groups, "all": rows}.items():
        # a plan that is not certified is the worst of all
        ratios, walls = np.array([row["ratio"] for row in chosen]), [row["wall_ms"] for row in chosen]
        lines.append(
            [
                group,
                len(chosen),
                *(f"{np.quantile(ratios, level, method='inverted_cdf'):.5f}" for level in (0.5, 0.95, 1.0)),
                int(np.sum(ratios > NOTABLY)),
                int(np.sum(ratios < 1.0)),
                common.median(row["iterations"] for row in chosen),
                common.number(common.median(walls), 1),
                common.number(common.quantile(walls, 0.95), 1),
            ]
        )
    print(common.table(headings, lines))
    return _refused(rows)


def scaling(options: argparse.Namespace) -> int:
    """Time a plan against the number of obstacles, all but 50 of them far away.

    The sizes take turns, so that what slows the machine for a while slows them all.
    """
    rows = []
    for crowd in range(SCALING_CROWDS):
        crowds = {
            count: families.random_scenario(
                f"far{count}", np.random.default_rng([options.seed, crowd]), f"far{count}-{crowd}"
            )
            for count in SCALING_COUNTS
        }
        outcomes = {count: run(data, 1, options.solver) for count, data in crowds.items()}
        scenarios = {count: families.as_scenario(data) for count, data in crowds.items()}
        walls: dict[int, list[float]] = {count: [] for count in SCALING_COUNTS}
        for _ in range(max(options.repeat, SCALING_REPEATS)):
            for count, scenario in scenarios.items():
                began = perf_counter()
                scp_planner.plan(scenario, solver=options.solver)
                walls[count].append(perf_counter() - began)
        for count, outcome in outcomes.items():
            rows.append(
                {
                    "crowd": crowd,
                    "obstacles": count,
                    "certified": int(outcome.plan.certified),
                    "dense_check": int(outcome.report.ok),
                    "travel_time": outcome.plan.travel_time,
                    "wall_ms": 1e3 * common.median(walls[count]),
                    "more_ms": 1e3 * common.median(np.subtract(walls[count], walls[SCALING_COUNTS[0]])),
                }
            )
            common.say(f"crowd {crowd}, {count} obstacles: {rows[-1]['wall_ms']:.2f} ms, {outcome.plan.status}")
    common.write_csv(options.output / "scaling.csv", rows)
    _print_environment(options)
    lines = []
    for count in SCALING_COUNTS:
        some = [row for row in rows if row["obstacles"] == count]
        lines.append([count, *(f"{common.median(row[key] for row in some):.2f}" for key in ("wall_ms", "more_ms"))])
    print(common.table(["obstacles", "wall ms", "more than 50 near ones, ms"], lines))
    print(f"\n950 far obstacles cost {lines[-1][-1]} ms together.")
    return _refused(rows)


def random_scenarios(options: argparse.Namespace) -> int:
    """Plan random scenarios of all families: no certified plan may be refused, and none may crash."""
    rows = []
    began = perf_counter()
    for number in range(options.random):
        rows.append(_random_row(options, number))
        if (number + 1) % 100 == 0:
            common.say(f"{number + 1} scenarios, {perf_counter() - began:.0f} s")
    common.write_csv(options.output / "random.csv", rows, _columns(rows))
    _print_environment(options)
    print(_random_table(rows))
    return sum(1 for row in rows if row["status"] == "crashed" or (row["certified"] and not row["dense_check"]))


def _random_row(options: argparse.Namespace, number: int) -> dict[str, Any]:
    """What comes of the random scenario of a number."""
    family = families.FAMILIES[number % len(families.FAMILIES)]
    # Each scenario has a generator of its own: any one can be drawn again alone.
    rng = np.random.default_rng([options.seed, number])
    data = families.random_scenario(family, rng, f"{family}-r{number}")
    try:
        outcome = run(data, 1, options.solver)
    except Exception as error:  # one crash must not hide the other scenarios; it is counted
        reason = f"{type(error).__name__}: {error}"
        common.say(f"{data['name']}: {reason}")
        return {"scenario": data["name"], "family": family, "status": "crashed", "reason": reason}
    if outcome.refused:
        common.say(f"{data['name']}: certified, but {outcome.report}")
    return {
        "scenario": data["name"],
        "family": family,
        "status": str(outcome.plan.status),
        "certified": int(outcome.plan.certified),
        "dense_check": int(outcome.report.ok),
        "clearance": outcome.plan.clearance.minimum,
        "travel_time": outcome.plan.travel_time,
        "wall_ms": 1e3 * outcome.wall_time,
        "with_effort": _with_effort(data, options, outcome.plan),
        "reason": outcome.plan.reason or "",
        "dense_check_says": "" if outcome.report.ok else str(outcome.report),
    }


def _random_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Table of random scenarios, family by family."""
    lines = []
    for family in [*families.FAMILIES, "all"]:
        chosen = [row for row in rows if family in ("all", row["family"])]
        if not chosen:
            continue
        states = Counter(row["status"] for row in chosen)
        certified = sum(row.get("certified", 0) for row in chosen)
        lines.append(
            [
                family,
                len(chosen),
                f"{certified} ({100.0 * certified / len(chosen):.1f} %)",
                ", ".join(f"{name} {number}" for name, number in states.most_common() if name != "certified"),
                sum(1 for row in chosen if row.get("certified") and not row["dense_check"]),
                sum(1 for row in chosen if _notably_slower(row)),
                common.number(common.median(row.get("wall_ms", np.nan) for row in chosen), 1),
                common.number(common.quantile((row.get("wall_ms", np.nan) for row in chosen), 0.95), 1),
            ]
        )
    headings = [
        "family",
        "scenarios",
        "certified",
        "others",
        "certified but refused",
        "faster with effort",
        "wall ms",
        "wall ms 95 %",
    ]
    return common.table(headings, lines)


def _notably_slower(row: Mapping[str, Any]) -> bool:
    """Whether more effort makes a plan notably faster."""
    time = row["travel_time"] if row.get("certified") else float("inf")
    return bool(time > NOTABLY * row.get("with_effort", float("inf")))


def _with_effort(data: families.Scenario, options: argparse.Namespace, plan: Any) -> float:
    """Travel time with more effort, s, if it is asked for; inf if there is no certified plan."""
    if options.effort == 1.0:
        return float(plan.travel_time) if plan.certified else float("inf")
    more = scp_planner.plan(families.as_scenario(data), scp_planner.Settings(effort=options.effort))
    return float(more.travel_time) if more.certified else float("inf")


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    made = argparse.ArgumentParser(prog="python -m benchmarks.planning", description=__doc__.splitlines()[0])
    known = common.REFERENCE_FAMILIES
    made.add_argument("--families", nargs="+", default=known, metavar="FAMILY", help=f"of {', '.join(known)}")
    made.add_argument("--count", type=int, help="scenarios of each family (default: all)")
    made.add_argument("--repeat", type=int, default=3, help="timed calls a scenario (default: 3)")
    made.add_argument("--solver", help="subproblem solver (default: the planner's)")
    made.add_argument("--scaling", action="store_true", help="time against the number of far obstacles")
    made.add_argument("--random", type=int, metavar="N", help="N random scenarios of all families")
    made.add_argument("--effort", type=float, default=1.0, help="of the planner's search (default: 1)")
    made.add_argument("--folders", type=Path, nargs="+", metavar="DIR", help="compare with the best known times there")
    made.add_argument("--seed", type=int, default=0, help="of the random scenarios (default: 0)")
    made.add_argument("--data", type=Path, help="folder of the reference scenarios")
    made.add_argument("--output", type=Path, default=common.DEFAULT_OUTPUT, help="folder of the CSV files")
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the options ask for. Exit code 1: a certified plan was refused, or the planner crashed."""
    options = parser().parse_args(arguments)
    try:
        if options.folders:
            refused = against_best(options)
        elif options.scaling:
            refused = scaling(options)
        elif options.random is not None:
            refused = random_scenarios(options)
        else:
            refused = reference(options)
    except common.MissingDataError as error:
        common.say(f"benchmarks.planning: {error}")
        return 2
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())
