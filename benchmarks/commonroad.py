"""Scenarios of CommonRoad, planned here and judged by the benchmark's official checker.

The checker (commonroad-drivability-checker) needs commonroad-io of 2024, and so a Python of its own::

    python -m benchmarks.commonroad --make-checker checker
    python -m benchmarks.commonroad FOLDER --model KS --checker checker
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import venv
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter

from scp_planner.errors import ScenarioError
from scp_planner.formats.commonroad.planning import plan_commonroad
from scp_planner.formats.commonroad.solution import export_commonroad_solution

CHECKER = ("commonroad-drivability-checker[triangle]==2025.4.0", "commonroad-io>=2024,<2025")
"""What the checker's environment holds."""

PUBLISHED = {"DEU_A9-1_1": 3.6, "DEU_Ffb-1_1": 4.4, "DEU_Gar-1_1": 2.0, "ZAM_Over-1_1": 2.7, "DEU_A9-2_1": 4.6}
"""Travel times of published solutions, s: of the reactive planner, and the best one of DEU_A9-2_1."""

JUDGE = """
import logging, sys, warnings
logging.disable(logging.WARNING)
warnings.simplefilter("ignore")
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad.common.solution import CommonRoadSolutionReader
from commonroad_dc.feasibility import solution_checker as checks
world, problems = CommonRoadFileReader(sys.argv[1]).open()
answer = CommonRoadSolutionReader.open(sys.argv[2])
try:
    valid, results = checks.valid_solution(world, problems, answer)
    steps = [len(inputs.state_list) for kept, inputs, _ in results.values() if not kept]
    print("accepted" if valid else f"kinematics of step {steps[0]}")
except Exception as error:
    asked = {
        "goal": lambda: checks.goal_reached(world, problems, answer),
        "start": lambda: checks.starts_at_correct_state(answer, problems),
        "traffic": lambda: checks.obstacle_collision(world, problems, answer),
        "border": lambda: checks.boundary_collision(world, problems, answer),
    }
    failed = []
    for name, check in asked.items():
        try:
            check()
        except checks.SolutionCheckerException:
            failed.append(name)
    print(", ".join(failed) or type(error).__name__)
"""
"""Run by the checker's Python: prints one line, with what it objects to."""


@dataclass(frozen=True)
class Row:
    """What came of one scenario.

    Attributes
    ----------
    name : str
    status : str
        Of the plan, or why there is none.
    travel_time, planning_time : float or None
        s.
    verdict : str
        The checker's; empty where it was not asked.
    """

    name: str
    status: str
    travel_time: float | None = None
    planning_time: float | None = None
    verdict: str = ""


def make_checker(folder: Path) -> None:
    """Make the checker's environment."""
    venv.create(folder, with_pip=True)
    subprocess.run([python_of(folder), "-m", "pip", "install", "--quiet", *CHECKER], check=True)


def python_of(folder: Path) -> str:
    """Give the Python of an environment."""
    return str(folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python"))


def judged(file: Path, solution: Path, checker: Path) -> str:
    """Ask the checker about a solution."""
    done = subprocess.run(
        [python_of(checker), "-c", JUDGE, file, solution], capture_output=True, text=True, check=False
    )
    lines = done.stdout.strip().splitlines()
    return lines[-1] if lines else f"checker failed: {done.stderr.strip().splitlines()[-1:]}"


def row_of(file: Path, model: str, folder: Path, checker: Path | None, time_limit: float | None) -> Row:
    """Plan a scenario, write its solution, and ask the checker about it."""
    name, clock = file.stem, perf_counter()
    try:
        made = plan_commonroad(file, model=model, time_limit=time_limit)
    except ScenarioError as error:
        return Row(name, str(error.faults[0].message))
    planning_time = perf_counter() - clock
    if not made.plan.certified:
        return Row(name, f"{made.plan.status}: {made.plan.reason}", made.plan.travel_time, planning_time)
    solution = folder / f"{name}.{model}.xml"
    try:
        export_commonroad_solution(made.plan, file, solution, model=model)
    except ValueError as error:
        return Row(name, str(error), made.plan.travel_time, planning_time)
    verdict = "" if checker is None else judged(file, solution, checker)
    return Row(name, str(made.plan.status), made.plan.travel_time, planning_time, verdict)


HEAD = """\
| scenario | travel time, s | published, s | planning, s | checker | plan |
| --- | --- | --- | --- | --- | --- |"""


def line_of(row: Row) -> str:
    """Lay out a row, with a published travel time beside it."""
    published = next((time for key, time in PUBLISHED.items() if row.name.startswith(key)), None)
    times = [None if value is None else f"{value:.2f}" for value in (row.travel_time, published, row.planning_time)]
    cells = [row.name, *(value or "" for value in times), row.verdict, row.status]
    return f"| {' | '.join(cells)} |"


def count_of(rows: list[Row]) -> str:
    """Count what came of the rows."""
    accepted = sum(row.verdict == "accepted" for row in rows)
    planned = sum(row.status == "certified" for row in rows)
    return f"{len(rows)} scenarios, {planned} certified, {accepted} accepted"


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, help="scenarios, XML")
    parser.add_argument("--make-checker", type=Path, metavar="DIR", help="make the checker's environment, and end")
    parser.add_argument("--checker", type=Path, metavar="DIR", help="the checker's environment")
    parser.add_argument("--model", default="PM", choices=["PM", "KS", "KST"])
    parser.add_argument("--solutions", type=Path, metavar="DIR", help="where to keep the solutions")
    parser.add_argument("--time-limit", type=float, metavar="S")
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    if given.make_checker is not None:
        make_checker(given.make_checker)
        return
    if given.folder is None:
        parser.error("FOLDER is needed")
    files = sorted(given.folder.glob("*.xml"))
    with tempfile.TemporaryDirectory() as scratch, ProcessPoolExecutor(given.workers) as pool:
        kept = given.solutions or Path(scratch)
        kept.mkdir(exist_ok=True)
        work = partial(row_of, model=given.model, folder=kept, checker=given.checker, time_limit=given.time_limit)
        rows = []
        print(HEAD, flush=True)
        for row in pool.map(work, files):
            rows.append(row)
            print(line_of(row), flush=True)  # at once: a folder may take long
        print(f"\n{count_of(rows)}")


if __name__ == "__main__":
    main()
