"""Planning while driving: how long a replan takes, and what closed loops come to.

    python -m benchmarks.online replan      replans among 10 obstacles seen with noise: the distribution of their times
    python -m benchmarks.online loops       closed loops at one level: contact, arrival, travel time against the truth
    python -m benchmarks.online levels      the same at other levels: the price of safety
    python -m benchmarks.online crowds      through recorded crowds, beside two simpler ways to drive
    python -m benchmarks.online noticing    obstacles and sensors that are not what they are taken for
    python -m benchmarks.online margins     what a margin of obstacles costs in time and spares in contacts
    python -m benchmarks.online regions     how often the truth is in its region, among them and in recordings
    python -m benchmarks.online answers     how soon a change of acceleration is answered, beside the best of all tests
    python -m benchmarks.online faults      solvers that fail, observations that vanish, jump, come late or twice

Each writes a CSV file, a row a run, as it goes on; called again it goes on from there. ``--fresh`` begins anew.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import argparse
import gc
import itertools
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks import families, online_answers, online_crowds, online_noticing, online_regions
from benchmarks.facts import facts_of
from benchmarks.online_faults import injected_run
from scp_planner.online.planner import Planner
from scp_planner.settings.online import Regions
from scp_planner.simulation.loop import simulate

Row = dict[str, Any]

LEVELS = (0.5, 0.8, 0.9, 0.95, 0.99, 0.999)
LEVEL = 0.99
LOOP_FAMILIES = ("crossing5", "crossing10")
NOISE = (0.05, 0.3)  # m, the range that the noise of a run is drawn from
MARGINS = (0.0, 0.02, 0.05, 0.1, 0.2)  # m
SAVED_EVERY = 2.0  # s: rows of short runs together, one of a long run at once


class Ledger:
    """Rows of a CSV file that is added to.

    Parameters
    ----------
    path : Path
    keys : tuple of str
        Columns that name a row.
    fresh : bool
        Whether to forget what is there.
    """

    def __init__(self, path: Path, keys: tuple[str, ...], fresh: bool) -> None:
        self.path, self.keys = path, keys
        self.rows: list[dict[str, Any]] = [] if fresh or not path.is_file() else list(common.read_csv(path))
        self._done = {self._name(row) for row in self.rows}

    def _name(self, row: Row) -> tuple[str, ...]:
        return tuple(str(row.get(key)) for key in self.keys)  # an older file may lack one

    def missing(self, wanted: Iterable[Row]) -> list[Row]:
        """What is wanted and not there yet."""
        return [row for row in wanted if self._name(row) not in self._done]

    def fill(self, wanted: Iterable[Row], run: Callable[[Row], Row]) -> list[Row]:
        """Run what is wanted and not there yet; return all rows that are wanted."""
        wanted = list(wanted)
        names = {self._name(row) for row in wanted}
        todo = self.missing(wanted)
        began = saved = perf_counter()
        for number, row in enumerate(todo, 1):
            self.rows.append({**row, **run(row)})
            self._done.add(self._name(row))
            now = perf_counter()
            if now - saved > SAVED_EVERY or number == len(todo):
                saved = now
                common.write_csv(self.path, self.rows)
                common.say(f"{self.path.name}: {number} of {len(todo)}, {perf_counter() - began:.0f} s")
        return [row for row in self.rows if self._name(row) in names]

    def fill_in_processes(self, wanted: Sequence[Row], run: Callable[[Row], Row], workers: int) -> list[Row]:
        """Like ``fill``, with so many processes; ``run`` is a function of a module."""
        if workers == 1:
            return self.fill(wanted, run)
        with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
            running = {tuple(row.values()): pool.submit(run, row) for row in self.missing(wanted)}
            return self.fill(wanted, lambda row: running[tuple(row.values())].result())


def values(rows: Iterable[Row], key: str) -> np.ndarray:
    """A column as numbers."""
    return np.array([float(row[key]) for row in rows])


# closed loops


def true_scene(family: str, seed: int) -> tuple[sp.Scenario, float]:
    """A random scene that has a certified plan with the truth, and the travel time of that, s."""
    rng = np.random.default_rng([seed, 5])
    while True:
        scenario = families.as_scenario(families.random_scenario(family, rng, f"{family}-{seed}"))
        plan = sp.plan(scenario)
        if plan.certified:
            return scenario, plan.travel_time


def loop(row: Row) -> Row:
    """One closed loop."""
    scenario, truth = true_scene(row["family"], int(row["seed"]))
    confidence = sp.Confidence(probability=float(row["level"]), level="joint")
    noise = float(np.random.default_rng([int(row["seed"]), 7]).uniform(*NOISE))
    run = simulate(scenario.model_copy(update={"confidence": confidence}), noise, 10.0, int(row["seed"]))
    return {"noise": round(noise, 4), "truth_time": truth, **facts_of(run)}


def loops(options: argparse.Namespace) -> int:
    """Closed loops at the level that is asked for."""
    ledger = Ledger(options.output / "online-loops.csv", ("family", "seed", "level"), options.fresh)
    wanted = [
        {"family": LOOP_FAMILIES[seed % 2], "seed": seed, "level": LEVEL}
        for seed in range(options.seed, options.seed + options.count)
    ]
    sys.stdout.write(loop_table(ledger.fill(wanted, loop)) + "\n")
    return 0


def levels(options: argparse.Namespace) -> int:
    """The same scenes at other levels."""
    ledger = Ledger(options.output / "online-loops.csv", ("family", "seed", "level"), options.fresh)
    wanted = [
        {"family": LOOP_FAMILIES[seed % 2], "seed": seed, "level": level}
        for level in LEVELS
        for seed in range(options.seed, options.seed + options.count)
    ]
    sys.stdout.write(level_table(ledger.fill(wanted, loop)) + "\n")
    return 0


LOOP_HEADINGS = (
    "runs",
    "contact, %",
    "touched standing, %",
    "arrived, %",
    "travel time / truth",
    "braking cycles, %",
    "not safe, %",
)


def loop_cells(rows: Sequence[Row]) -> list[object]:
    arrived = [row for row in rows if int(row["arrived"])]
    cycles = values(rows, "cycles").sum()
    ratio = values(arrived, "travel_time").mean() / values(arrived, "truth_time").mean() if arrived else np.nan
    return [
        len(rows),
        common.number(100.0 * values(rows, "contact").mean(), 1),
        common.number(100.0 * values(rows, "contact_standing").mean(), 1),
        common.number(100.0 * values(rows, "arrived").mean(), 1),
        common.number(float(ratio), 3),
        common.number(100.0 * values(rows, "braking").sum() / cycles, 2),
        common.number(100.0 * values(rows, "unsafe").sum() / cycles, 2),
    ]


def by(rows: Sequence[Row], key: str) -> list[tuple[str, list[Row]]]:
    """Rows by the values of a column, and all of them."""
    names = list(dict.fromkeys(str(row[key]) for row in rows))
    return [*((name, [row for row in rows if str(row[key]) == name]) for name in names), ("all", list(rows))]


def loop_table(rows: Sequence[Row]) -> str:
    """What came of closed loops, by family."""
    return common.table(["family", *LOOP_HEADINGS], [[name, *loop_cells(some)] for name, some in by(rows, "family")])


def level_table(rows: Sequence[Row]) -> str:
    """What came of closed loops, by level."""
    rows = sorted(rows, key=lambda row: float(row["level"]))
    lines = [[name, *loop_cells(some)] for name, some in by(rows, "level")[:-1]]
    return common.table(["level", *LOOP_HEADINGS], lines)


# replans


def replan(options: argparse.Namespace) -> int:
    """Times of single replans in the reference scenarios, the first plans apart."""
    folder = common.scenario_folder(options.data)
    scenarios = [families.as_scenario(data) for data in common.load_family(folder, options.family)]
    simulate(scenarios[0], seed=options.seed, time_limit=1.0)  # imports, caches
    rows: list[Row] = []
    measured = Planner.replan

    def timed(self: Planner, *arguments: Any, **choices: Any) -> Any:
        first, clock, processor = self.plan is None, perf_counter(), _processor_time()
        plan = measured(self, *arguments, **choices)
        if not first:
            rows.append(
                {
                    "wall_ms": 1e3 * (perf_counter() - clock),
                    "processor_ms": 1e3 * (_processor_time() - processor),
                    "outcome": str(plan.outcome),
                    "iterations": plan.iterations,
                    "reason": plan.reason,
                    **{f"{stage}_ms": 1e3 * plan.timings.get(stage, 0.0) for stage in STAGES},
                }
            )
        return plan

    Planner.replan = timed  # type: ignore[method-assign]
    # Looking for garbage among the many small records of the simulation is no work of the planner.
    gc.disable()
    try:
        seed = options.seed
        while len(rows) < options.count:
            for scenario in scenarios:
                gc.collect()
                simulate(scenario, options.noise, 10.0, seed, deadline=options.deadline)
            seed += 1
            common.say(f"replan: {len(rows)} cycles")
    finally:
        gc.enable()
        Planner.replan = measured  # type: ignore[method-assign]
    common.write_csv(options.output / "online-replan.csv", rows[: options.count])
    common.write_environment(options.output / "online-environment.csv", common.environment())
    sys.stdout.write(replan_table(rows[: options.count]) + "\n")
    return 0


def replan_table(rows: Sequence[Row]) -> str:
    """Distribution of the times of replans, by stage."""
    columns = {"all": "wall_ms", "all, processor time": "processor_ms", **{stage: f"{stage}_ms" for stage in STAGES}}
    lines = [[name, *_distribution(values(rows, column))] for name, column in columns.items()]
    return common.table(["stage", "median, ms", "90 %", "99 %", "longest"], lines)


STAGES = ("zones", "problem", "scp", "certificate", "search")


def _processor_time() -> float:
    from time import thread_time

    return thread_time()


def _distribution(times: np.ndarray) -> list[str]:
    return [common.number(float(q), 2) for q in (*np.quantile(times, (0.5, 0.9, 0.99)), times.max())]


# faults


def faults(options: argparse.Namespace) -> int:
    """Runs with faults."""
    ledger = Ledger(options.output / "online-faults.csv", ("seed",), options.fresh)

    def run(row: Row) -> Row:
        done = injected_run(int(row["seed"]), check_every=options.check_every)
        if not done.faultless:
            common.say(f"seed {done.seed}: {done.error or done.refused or done.unsaid}")
        return {
            "kinds": " ".join(done.kinds),
            "cycles": done.cycles,
            "checked": done.checked,
            "raised": int(bool(done.error)),
            "refused": len(done.refused),
            "unsaid": done.unsaid,
            "arrived": int(done.arrived),
            **{name: done.outcomes.get(name, 0) for name in ("improved", "kept", "repaired", "evading", "braking")},
            "says": done.error.splitlines()[-1] if done.error else "; ".join(done.refused),
        }

    rows = ledger.fill([{"seed": seed} for seed in range(options.seed, options.seed + options.count)], run)
    sys.stdout.write(fault_table(rows) + "\n")
    return int(any(int(row["raised"]) or int(row["refused"]) or int(row["unsaid"]) for row in rows))


def fault_table(rows: Sequence[Row]) -> str:
    """What came of runs with faults, by kind."""
    headings = ["fault", "runs", "replans", "checked", "raised", "refused", "unsaid", "arrived, %", "braking, %"]
    table = []
    for kind in ("solver", "vanish", "jump", "late", "doubled", "appears", "all"):
        some = [row for row in rows if kind == "all" or kind in str(row["kinds"]).split()]
        if not some:
            continue
        sums = [int(values(some, key).sum()) for key in ("cycles", "checked", "raised", "refused", "unsaid")]
        rates = values(some, "arrived").mean(), values(some, "braking").sum() / max(sums[0], 1)
        table.append([kind, len(some), *sums, *(common.number(100.0 * rate, 1) for rate in rates)])
    return common.table(headings, table)


def crowds(options: argparse.Namespace) -> int:
    """Through recorded crowds."""
    tracks = online_crowds.recordings(options.tracks, options.places)
    ledger = Ledger(options.output / "online-crowds.csv", ("place", "number", "way"), options.fresh)
    places = tuple(online_crowds.FILES)
    trips = ((number, places[number % len(places)]) for number in itertools.count(options.seed))
    wanted = [
        {"place": name, "number": number, "way": way}
        for number, name in itertools.islice((trip for trip in trips if trip[1] in tracks), options.count)
        for way in options.ways
    ]
    rows = ledger.fill(wanted, lambda row: online_crowds.drive(tracks[row["place"]], row))
    sys.stdout.write(crowd_table(rows) + "\n")
    return 0


def crowd_table(rows: Sequence[Row]) -> str:
    """What came of trips through crowds, by place and way of driving."""
    headings = ["place", "how", "runs", "contact, %", "touched standing, %", "arrived, %", "mean time, s", "median ms"]
    table = [
        [place, way, *online_crowds.cells(chosen)]
        for place, some in by(rows, "place")
        for way, chosen in by(some, "way")[:-1]
    ]
    return common.table(headings, table)


# obstacles and sensors that are not what they are taken for


_SCENES = lru_cache(maxsize=4)(true_scene)  # families of runs share them


def _scene(seed: int, margin: float) -> tuple[sp.Scenario, float]:
    scenario, truth = _SCENES(LOOP_FAMILIES[seed % len(LOOP_FAMILIES)], seed)
    wider = tuple(each.model_copy(update={"margin": each.margin + margin}) for each in scenario.obstacles)
    return scenario.model_copy(update={"obstacles": wider}), truth


def _noticed(row: Row) -> Row:
    return {**row, **online_noticing.drive(row, lambda seed: _scene(seed, float(row.get("margin", 0.0))))}


def _told(row: Row) -> Row:
    """Say what came of a run as soon as it is there: many take hours."""
    what = [name for name in ("arrived", "contact", "contact_standing") if int(row[name])]
    common.say(f"{row['family']} {row['seed']}: {row['travel_time']:.2f} s, {', '.join(what) or 'did not arrive'}")
    return row


def noticing(options: argparse.Namespace) -> int:
    """Closed loops among obstacles and with sensors that are not what they are taken for; so many of each family."""
    ledger = Ledger(options.output / "online-noticing.csv", ("family", "seed"), options.fresh)
    wanted = [
        {"family": family, "seed": seed}
        for seed in range(options.seed, options.seed + options.count)
        for family in (*online_noticing.FAMILIES, online_noticing.BELIEVED)
    ]
    if options.workers == 1:
        rows = ledger.fill(wanted, lambda row: _told(_noticed(row)))
    else:
        with ProcessPoolExecutor(options.workers, get_context("spawn")) as pool:
            running = {(row["family"], row["seed"]): pool.submit(_noticed, row) for row in ledger.missing(wanted)}
            rows = ledger.fill(wanted, lambda row: _told(running[row["family"], row["seed"]].result()))
    sys.stdout.write(loop_table(rows) + "\n")
    return 0


def margins(options: argparse.Namespace) -> int:
    """The same with margins of obstacles, m, where nothing and where something unexpected happens."""
    ledger = Ledger(options.output / "online-margins.csv", ("family", "margin", "seed"), options.fresh)
    wanted = [
        {"family": family, "margin": margin, "seed": seed}
        for seed in range(options.seed, options.seed + options.count)
        for family in ("nominal", "change0.3")
        for margin in MARGINS
    ]
    rows = ledger.fill(wanted, lambda row: _told(_noticed(row)))
    headings = ["family", "margin, m", *LOOP_HEADINGS, "deepest contact while driving, m"]
    table = []
    for (family, some), margin in itertools.product(by(rows, "family")[:-1], MARGINS):
        chosen = [row for row in some if float(row["margin"]) == margin]
        deepest = max((-float(row["least_clearance"]) for row in chosen if int(row["contact"])), default=0.0)
        table.append([family, f"{margin:g}", *loop_cells(chosen), common.number(deepest, 2)])
    sys.stdout.write(common.table(headings, table) + "\n")
    return 0


def regions(options: argparse.Namespace) -> int:
    """How often the truth is in its region of 95 %, one observation, 1 s, 2 s and 4 s ahead."""
    ledger = Ledger(options.output / "online-regions.csv", ("family", "regions"), options.fresh)
    recorded = online_regions.recordings(options.tracks)
    wanted = [
        {"family": family, "regions": str(way)} for family in (*online_noticing.FAMILIES, *recorded) for way in Regions
    ]

    def run(row: Row) -> Row:
        family, way = row["family"], Regions(row["regions"])
        if family in recorded:
            found = online_regions.of_recording(recorded[family], way)
        else:
            found = online_regions.of_family(family, options.count, way, options.seed)
        counted = online_regions.coverage(found)
        common.say(
            f"{row['family']}, {row['regions']}: " + ", ".join(f"{one.held / one.number:.3f}" for one in counted)
        )
        return {
            f"{what}_{lead:g}": value
            for lead, one in zip(online_regions.LEADS, counted, strict=True)
            for what, value in asdict(one).items()
        }

    sys.stdout.write(region_table(ledger.fill(wanted, run)) + "\n")
    return 0


def region_table(rows: Sequence[Row]) -> str:
    """Coverage of the truth, between bounds, and of what is seen, in %, and radius in m, by family and lead time."""
    leads = online_regions.LEADS
    table = []
    for row in rows:
        cells = []
        for lead in leads:
            number, held, met, area = (float(row[f"{what}_{lead:g}"]) for what in ("number", "held", "met", "area"))
            low, high = (100.0 * float(row[f"{what}_{lead:g}"]) for what in ("low", "high"))
            shares = f"{100.0 * held / number:.1f} ({low:.0f} to {high:.0f}) / {100.0 * met / number:.1f} %"
            cells.append(f"{shares}, {np.sqrt(area / number):.2f} m")
        table.append([row["family"], row["regions"], *cells])
    return common.table(["family", "regions", "next", *(f"{lead:g} s" for lead in leads[1:])], table)


def answers(options: argparse.Namespace) -> int:
    """How soon a change of acceleration of 0.5 m/s2 is answered, beside the best that any test can do."""
    headings = ["looks after it", "answered, %", "false answers, %", "best of all tests, %", "held 1 s ahead, %"]
    found = online_answers.answers(range(options.seed, options.seed + options.count))
    table = [
        [one.looks, *(common.number(100.0 * v, 1) for v in (one.answered, one.false, one.best, one.held))]
        for one in found
    ]
    sys.stdout.write(common.table(headings, table) + "\n")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    counts = {replan: 2000, loops: 1000, levels: 200, crowds: 200, noticing: 100, margins: 100, regions: 12}
    counts |= {answers: 25, faults: 500}
    for command, count in counts.items():
        sub = commands.add_parser(command.__name__, help=(command.__doc__ or "").splitlines()[0].replace("%", "%%"))
        sub.set_defaults(run=command)
        sub.add_argument("--count", type=int, default=count, help=f"replans or runs; default: {count}")
        sub.add_argument("--seed", type=int, default=0, help="of the first run")
        sub.add_argument("--output", type=Path, default=common.DEFAULT_OUTPUT, help="folder of the CSV files")
        sub.add_argument("--fresh", action="store_true", help="forget what an earlier call wrote")
    replans = commands.choices["replan"]
    replans.add_argument("--data", help="folder of the reference scenarios")
    replans.add_argument("--family", default="crossing10")
    replans.add_argument("--noise", type=float, default=0.1, help="m")
    replans.add_argument("--deadline", type=float, help="of each replan, s; default: none")
    checks = commands.choices["faults"]
    checks.add_argument("--check-every", type=int, default=3, help="plans from one that is checked to the next")
    for name in ("crowds", "regions"):
        commands.choices[name].add_argument("--tracks", help="folder of recorded motions; default: SCP_PLANNER_DATA")
    places, ways = tuple(online_crowds.FILES), online_crowds.WAYS
    recorded = commands.choices["crowds"]
    recorded.add_argument("--places", nargs="+", choices=places, default=places, help="default: all")
    recorded.add_argument("--ways", nargs="+", choices=ways, default=ways, help="to drive; default: all")
    commands.choices["noticing"].add_argument("--workers", type=int, default=2, help="processes; default: 2")
    return common.run_command(parser, argv)


if __name__ == "__main__":
    raise SystemExit(main())
