"""Plans of CommonRoad files that are changed at random, and which of them its official checker refuses.

What is certified for a model of the benchmark should be accepted; what is not is printed, with the seed that makes it
again, and counts in the exit code::

    python -m benchmarks.commonroad --make-checker checker
    python -m benchmarks.commonroad_hunt FOLDER --checker checker --model KS --seed 0 --count 100
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
from collections import Counter
from math import cos, sin
from pathlib import Path
from xml.etree import ElementTree

from benchmarks.commonroad import JUDGE, python_of
from scp_planner.errors import ScenarioError
from scp_planner.formats.commonroad.planning import plan_commonroad
from scp_planner.formats.commonroad.solution import export_commonroad_solution

KNOWN = ("accepted", "refused", "infeasible", "feasible", "not written")
"""What may come of a file."""

Element = ElementTree.Element

ASKED = f"""
import sys
sys.argv = [""] * 3
for line in sys.stdin:
    sys.argv[1:] = line.rstrip("\\n").split("\\t")
    exec({JUDGE!r})
    sys.stdout.flush()
"""
"""Run by the checker's Python: a verdict for each line, which names a scenario and its solution."""


def start_of(root: Element) -> Element:
    """Give the state that the vehicle starts in."""
    found = root.find(".//planningProblem/initialState")
    assert found is not None
    return found


def at(element: Element, path: str) -> Element:
    """Give a part that must be there."""
    found = element.find(path)
    if found is None:
        raise LookupError(path)
    return found


def number(element: Element, path: str) -> float:
    """Read a part that is a number."""
    return float(at(element, path).text or "nan")


def place(state: Element, along: float, left: float, heading: float) -> None:
    """Move a state, m."""
    for axis, by in (
        ("x", along * cos(heading) - left * sin(heading)),
        ("y", along * sin(heading) + left * cos(heading)),
    ):
        at(state, f"position/point/{axis}").text = str(number(state, f"position/point/{axis}") + by)


def start_elsewhere(root: Element, rng: random.Random) -> None:
    """Move and turn the start."""
    state = start_of(root)
    heading = number(state, "orientation/exact")
    place(state, rng.uniform(-2.0, 6.0), rng.uniform(-0.5, 0.5), heading)
    at(state, "orientation/exact").text = str(heading + rng.choice([0.0, rng.uniform(-0.1, 0.1)]))


def start_faster(root: Element, rng: random.Random) -> None:
    """Change the speed of the start."""
    speed = at(start_of(root), "velocity/exact")
    speed.text = str(float(speed.text or 0.0) * rng.choice([0.0, 0.3, 0.6, 0.8, 1.2, 1.5]))


def coarser(root: Element, rng: random.Random) -> None:
    """Make the file's step longer: all that moves is slower."""
    root.set("timeStepSize", rng.choice(["0.15", "0.2", "0.25"]))


def fewer(root: Element, rng: random.Random) -> None:
    """Take obstacles away."""
    part = rng.choice([0.3, 0.7, 1.0])
    for one in [e for e in root if e.tag in ("dynamicObstacle", "staticObstacle", "obstacle")]:
        if rng.random() < part:
            root.remove(one)


def traffic_later(root: Element, rng: random.Random) -> None:
    """Let traffic come by later."""
    steps = rng.choice([3, 6, 10])
    for state in root.iterfind("dynamicObstacle/trajectory/state"):
        at(state, "time/exact").text = str(int(number(state, "time/exact")) + steps)


def traffic_slower(root: Element, rng: random.Random) -> None:
    """Let traffic drive a part of its way, or more."""
    part = rng.choice([0.5, 0.7, 1.3])
    for one in root.iterfind("dynamicObstacle"):
        for axis in ("x", "y"):
            first = number(one, f"initialState/position/point/{axis}")
            for state in one.iterfind("trajectory/state"):
                value = at(state, f"position/point/{axis}")
                value.text = str(first + part * (float(value.text or 0.0) - first))


def goal_sooner(root: Element, rng: random.Random) -> None:
    """Let goals end sooner or later."""
    for goal in root.iterfind(".//planningProblem/goalState"):
        end = at(goal, "time/intervalEnd")
        least = int(number(goal, "time/intervalStart")) + 1
        end.text = str(max(least, int(int(end.text or 0) * rng.choice([0.6, 0.8, 1.3]))))


def goal_speed(root: Element, rng: random.Random) -> None:
    """Ask for a speed at the goal."""
    speed = number(start_of(root), "velocity/exact") * rng.choice([0.4, 0.8, 1.0, 1.2])
    for goal in root.iterfind(".//planningProblem/goalState"):
        for old in goal.findall("velocity"):
            goal.remove(old)
        velocity = ElementTree.SubElement(goal, "velocity")
        ElementTree.SubElement(velocity, "intervalStart").text = str(speed)
        ElementTree.SubElement(velocity, "intervalEnd").text = str(speed + 1.0)


def goal_of_time(root: Element, rng: random.Random) -> None:  # noqa: ARG001
    """Ask for nothing but a time."""
    for goal in root.iterfind(".//planningProblem/goalState"):
        for part in [e for e in goal if e.tag != "time"]:
            goal.remove(part)


CHANGES = (
    start_elsewhere,
    start_faster,
    coarser,
    fewer,
    traffic_later,
    traffic_slower,
    goal_sooner,
    goal_speed,
    goal_of_time,
)


def changed(file: Path, rng: random.Random, folder: Path) -> tuple[Path, str]:
    """Write a file with one to three changes, and give its path and what they are."""
    tree = ElementTree.parse(file)
    done = []
    for change in rng.sample(CHANGES, rng.choice([1, 2, 3])):
        try:
            change(tree.getroot(), rng)
            done.append(change.__name__)
        except LookupError:
            pass  # the file has nothing of the kind
    path = folder / file.name
    tree.write(path, encoding="utf-8", xml_declaration=True)
    return path, ", ".join(done)


def outcome(path: Path, solution: Path, model: str, time_limit: float, judge: subprocess.Popen[str]) -> str:
    """Plan a file and ask the checker."""
    try:
        made = plan_commonroad(path, model=model, time_limit=time_limit)
    except ScenarioError:
        return "refused"
    if not made.plan.certified:
        return str(made.plan.status)
    try:
        export_commonroad_solution(made.plan, path, solution, model=model)
    except ValueError:
        return "not written"
    assert judge.stdin is not None and judge.stdout is not None
    judge.stdin.write(f"{path}\t{solution}\n")
    judge.stdin.flush()
    return judge.stdout.readline().strip()


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="scenarios, XML")
    parser.add_argument("--checker", type=Path, metavar="DIR", required=True, help="the checker's environment")
    parser.add_argument("--model", default="KS", choices=["PM", "KS"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--time-limit", type=float, default=3.0, metavar="S")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="where to keep the files")
    given = parser.parse_args()
    files, counts = sorted(given.folder.glob("*.xml")), Counter[str]()
    command = [python_of(given.checker), "-c", ASKED]
    with (
        tempfile.TemporaryDirectory() as scratch,
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        ) as judge,
    ):
        kept = given.keep or Path(scratch)
        for seed in range(given.seed, given.seed + given.count):
            rng = random.Random(seed)
            folder = kept / str(seed)
            folder.mkdir(parents=True, exist_ok=True)
            path, changes = changed(rng.choice(files), rng, folder)
            verdict = outcome(path, folder / "solution.xml", given.model, given.time_limit, judge)
            counts[verdict] += 1
            if verdict not in KNOWN:
                print(f"{seed} {path.stem} ({changes}): {verdict}", flush=True)
    print(f"{given.model}: {dict(counts)}")
    sys.exit(any(verdict not in KNOWN for verdict in counts))


if __name__ == "__main__":
    main()
