"""Cases: what is tried, drawn from a kind and a seed, and what may come of it.

A case is plain data, so that it can be written to a file, and tried again in a process of its own.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
import traceback
import warnings
from collections.abc import Callable
from contextlib import chdir
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache
from pathlib import Path

import numpy as np

import scp_planner as sp
from benchmarks.hostile import calls, commands, drives
from benchmarks.hostile.damage import ODD, cut, damaged
from benchmarks.hostile.wild import Data, Wild, wild
from scp_planner import builtin
from scp_planner.errors import ScpPlannerError, TooLargeError
from scp_planner.estimation.confidence import alpha_of_one, marginal_scale, region_scale
from scp_planner.estimation.estimate import estimate_obstacle
from scp_planner.scenario.models import Obstacle, Steering
from scp_planner.scenario.motions import Course, Futures, is_uncertain
from scp_planner.settings.online import Safety
from scp_planner.threat_zones.of_scenario import given_zones
from scp_planner.threat_zones.zone import ThreatZone
from verification.dense_check import check_trip
from verification.findings import Tolerances

PLAN_TIME = 4.0
"""s that a plan may take if nobody says otherwise."""
PLANNED = ("crossing", "headon", "overtaking")
"""Scenarios whose plan files are damaged."""


class Kind(StrEnum):
    """What is tried."""

    SCENARIO = "scenario"
    """Damaged scenario files: refused, or planned."""
    WILD = "wild"
    """Wild but legal scenarios: planned, and certified plans checked densely."""
    PLAN = "plan"
    """Damaged plan files: refused, or certified against a scenario, and then checked densely."""
    COMMAND = "command"
    """Command lines with absurd arguments."""
    PLANNER = "planner"
    """Calls of an online planner with absurd values."""
    DRIVE = "drive"
    """Wild scenarios driven with an online planner, and what it calls certified checked densely."""


class Fault(StrEnum):
    """What may never happen."""

    TRACEBACK = "traceback"
    """An exception other than those that are documented."""
    HANG = "hang"
    MEMORY = "memory"
    REFUSED = "refused by the dense check"
    EXIT_CODE = "exit code"
    DIED = "died"


@dataclass(frozen=True)
class Case:
    """Something to try.

    Attributes
    ----------
    kind : Kind
    seed : int
    data : dict
        What JSON can hold: all that trying it needs.
    plan_time : float
        s that a plan may take; it returns somewhat later, with the best so far.
    """

    kind: Kind
    seed: int
    data: Data
    plan_time: float = PLAN_TIME


@dataclass(frozen=True)
class Outcome:
    """What came of a case.

    Attributes
    ----------
    result : str
        In a word, such as ``certified`` or ``bad input``.
    fault : Fault or None
    detail : str
        Of the fault.
    warned : tuple of str
        Warnings of numpy on the way.
    checked : int
        Certified plans that the dense check looked at.
    plan : dict or None
        The one that was refused: how far a search gets in its time is hardly ever the same again.
    """

    result: str
    fault: Fault | None = None
    detail: str = ""
    warned: tuple[str, ...] = field(default=())
    checked: int = 0
    plan: Data | None = None


def make(kind: Kind, seed: int, plan_time: float = PLAN_TIME) -> Case:
    """Draw a case."""
    return Case(kind, seed, _MAKERS[kind](np.random.default_rng([seed, list(Kind).index(kind)])), plan_time)


def carry_out(case: Case) -> Outcome:
    """Try a case; whatever is raised becomes a fault."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            outcome = _TRIED[case.kind](case)
        except Exception:
            outcome = Outcome("raised", Fault.TRACEBACK, traceback.format_exc())
    told = {f"{each.category.__name__}: {each.message} ({Path(each.filename).name}:{each.lineno})" for each in heard}
    return replace(outcome, warned=tuple(sorted(told)))


# scenarios


def _make_scenario(rng: np.random.Generator) -> Data:
    base = wild(rng).scaled()
    suffix = str(rng.choice([".json", ".yaml"]))
    if rng.random() < 0.7:
        text = json.dumps(damaged(base, rng))
        return {"suffix": suffix, "text": text}  # JSON is YAML too, but for its numbers
    return {"suffix": suffix, "bytes": cut(json.dumps(base, indent=1).encode(), rng).hex()}


def _try_scenario(case: Case) -> Outcome:
    data = case.data
    raw = bytes.fromhex(data["bytes"]) if "bytes" in data else data["text"].encode()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"scenario{data['suffix']}"
        file.write_bytes(raw)
        try:
            scenario = sp.Scenario.load(file)
        except sp.ScenarioError as error:
            str(error).encode("utf-8", "backslashreplace")
            return Outcome("bad input")
        scenario.save(Path(folder) / "again.yaml")
        if sp.Scenario.load(Path(folder) / "again.yaml") != scenario:
            return Outcome("legal", Fault.REFUSED, "what is saved is not what is loaded")
        try:
            plan = sp.plan(scenario, time_limit=case.plan_time)
        except TooLargeError:
            return Outcome("too large")
        plan.save(Path(folder) / "plan.json")
        sp.Plan.load(Path(folder) / "plan.json")
    return Outcome(plan.status.value)


def _make_wild(rng: np.random.Generator) -> Data:
    drawn = wild(rng)
    return {"data": drawn.data, "length": drawn.length, "time": drawn.time}


def _try_wild(case: Case) -> Outcome:
    drawn = Wild(**case.data)
    try:
        scenario = sp.Scenario(**drawn.scaled())
    except sp.ScenarioError:
        return Outcome("bad input")
    try:
        plan = sp.plan(scenario, time_limit=case.plan_time)
    except TooLargeError:
        return Outcome("too large")
    if not plan.reason and not plan.certified:
        return Outcome(plan.status.value, Fault.REFUSED, "neither certified nor a reason")
    return _checked(drawn, scenario, plan) if plan.certified else Outcome(plan.status.value)


def _checked(drawn: Wild, scenario: sp.Scenario, plan: sp.Plan) -> Outcome:
    """Check a plan that is said to be certified, in the scenario's own units."""
    length, time = drawn.length, drawn.time
    # What the planner promises to a micrometre and to a millisecond is that in its units, not in the scenario's own.
    usual, finer = Tolerances(), min(1.0, length)
    allowed = replace(
        usual,
        position=max(usual.position, 2e-6 / finer),
        clearance=usual.clearance + 1e-6 / finer,
        arrival=usual.arrival / min(1.0, time),
        goal_speed=drives.goal_speed_missed(drawn.data),
    )
    aimed = {"position": [value / length for value in scenario.goal.position]}  # may be left out for a region
    report = check_trip(
        {**drawn.data, "goal": {**aimed, **drawn.data["goal"]}},
        lambda times: plan.position(np.clip(times * time, plan.start_time, plan.arrival_time)) / length,
        plan.start_time / time,
        plan.arrival_time / time,
        tolerances=allowed,
        regions=regions(scenario, plan.arrival_time),
    )
    if report.ok:
        return Outcome("certified", checked=1)
    return Outcome("certified", Fault.REFUSED, str(report), checked=1, plan=plan.to_dict())


def regions(scenario: sp.Scenario, until: float) -> dict[str, float]:
    """Size of each confidence region up to a time, s; the level is the planner's business, not the check's."""
    level, probability = str(scenario.confidence.level), scenario.confidence.probability
    start = scenario.start.time
    uncertain = [each for each in scenario.obstacles if is_uncertain(each.motion)]
    found: dict[str, float] = {}
    for each in uncertain:
        if each.motion is None:
            estimate = estimate_obstacle(each)
            found[each.id] = region_scale(
                level, probability, estimate, obstacles=len(uncertain), start=start, stop=max(until, start)
            )
        elif isinstance(each.motion, Futures):
            found |= _of_futures(each, each.motion, scenario, len(uncertain))
        else:
            assert isinstance(each.motion, Course)
            found[each.id] = marginal_scale(level, probability, len(each.motion.time), len(uncertain))
    return found


def _of_futures(obstacle: Obstacle, motion: Futures, scenario: sp.Scenario, uncertain: int) -> dict[str, float]:
    """Size of the region of each future, read off its zone; of one that is improbable enough there is none.

    Raises
    ------
    AssertionError
        If all together miss the obstacle with more than the probability that is left to it.
    """
    confidence, found, missed = scenario.confidence, {}, 0.0
    zones = given_zones(obstacle.id, obstacle.shape, obstacle.margin, motion, confidence, uncertain)
    level = str(confidence.level)
    for k, future in enumerate(motion.futures):
        course = future.motion
        if not isinstance(course, Course) or course.covariance is None:
            continue  # known exactly, and kept clear of
        times = np.array(course.time)
        given = np.broadcast_to(np.array(course.covariance), (len(times), 2, 2))
        own = [each for each in zones if _is_about(each, course)]
        if not own:
            missed += future.weight
            continue
        assert own[0].covariances is not None
        scaled = own[0].covariances.grid(times[:1]).ravel()
        scale = float(scaled[0] / given[0, 0, 0])
        found[f"{obstacle.id}[{k}]"] = scale
        once = math.exp(-0.5 * scale)
        missed += future.weight * (once if level == "per_time" else -math.expm1(len(times) * math.log1p(-once)))
    alpha = alpha_of_one(level, confidence.probability, uncertain)
    assert missed <= alpha * (1.0 + 1e-6), f"{obstacle.id}: missed with {missed}, {alpha} allowed"
    return found


def _is_about(zone: ThreatZone, course: Course) -> bool:
    place = zone.centers.grid(np.array(course.time[:1])).ravel()
    return zone.covariances is not None and math.dist(place, course.position[0]) < 1e-6 * (1.0 + math.hypot(*place))


# plan files


@cache
def _planned(name: str) -> tuple[sp.Scenario, Data]:
    scenario = builtin.load(name)
    return scenario, sp.plan(scenario).to_dict(20)


def _make_plan(rng: np.random.Generator) -> Data:
    name = str(rng.choice(PLANNED))
    plan = _planned(name)[1]
    if rng.random() < 0.8:
        return {"scenario": name, "text": json.dumps(damaged(plan, rng))}
    return {"scenario": name, "bytes": cut(json.dumps(plan).encode(), rng).hex()}


def _try_plan(case: Case) -> Outcome:
    data = case.data
    scenario, _ = _planned(data["scenario"])
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "plan.json"
        file.write_bytes(bytes.fromhex(data["bytes"]) if "bytes" in data else data["text"].encode())
        try:
            plan = sp.Plan.load(file)
        except sp.PlanError:
            return Outcome("bad input")
        certificate = sp.certify(scenario, plan)
        try:
            plan.export(Path(folder) / "plan.csv")
        except ScpPlannerError:
            return Outcome("not exported")
    if not certificate.holds:
        return Outcome("does not hold")
    return _checked(Wild(scenario.to_dict(), 1.0, 1.0), scenario, plan)


# the rest is of modules of its own


def _try_command(case: Case) -> Outcome:
    data = case.data
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        commands.lay_out()
        code, said = commands.run([os.fsdecode(bytes.fromhex(word)) for word in data["arguments"]])
    if said:
        return Outcome("raised", Fault.TRACEBACK, said)
    if code not in commands.KNOWN_CODES:
        return Outcome(f"exit code {code}", Fault.EXIT_CODE, f"{code}")
    return Outcome(f"exit code {code}")


def _make_planner(rng: np.random.Generator) -> Data:
    drawn = wild(rng)
    return {"scenario": drawn.scaled(), "calls": calls.draw(rng, drawn.scaled(), ODD)}


def _try_planner(case: Case) -> Outcome:
    data = case.data
    try:
        scenario = sp.Scenario(**data["scenario"])
    except sp.ScenarioError:
        return Outcome("bad input")
    refused = calls.play(scenario, data["calls"])
    return Outcome("driven, some calls refused" if refused else "driven")


def _make_drive(rng: np.random.Generator) -> Data:
    drawn = wild(rng)
    vehicle, goal = drawn.data["vehicle"], drawn.data["goal"]
    if len(vehicle.get("discs", ())) < 2:
        vehicle["steering"] = str(rng.choice(list(Steering)))
    for key in ("earliest_arrival", "latest_arrival", "arrival_step"):
        goal.pop(key, None)  # for whoever drives, another trip each time
    options = {
        "period": float(rng.choice([0.05, 0.1, 0.5])),
        "cycles": int(rng.integers(*drives.CYCLES)),
        "safety": str(rng.choice(list(Safety))),
    }
    return {"data": drawn.data, "options": options}


def _try_drive(case: Case) -> Outcome:
    try:
        scenario = sp.Scenario(**case.data["data"])
    except sp.ScenarioError:
        return Outcome("bad input")
    found = drives.drive(scenario, case.data["options"], case.plan_time, regions)
    fault = Fault.REFUSED if found.refused else None
    return Outcome("driven", fault, found.refused, checked=found.checked)


_MAKERS: dict[Kind, Callable[[np.random.Generator], Data]] = {
    Kind.SCENARIO: _make_scenario,
    Kind.WILD: _make_wild,
    Kind.PLAN: _make_plan,
    Kind.COMMAND: lambda rng: {"arguments": [word.hex() for word in commands.draw(rng)]},
    Kind.PLANNER: _make_planner,
    Kind.DRIVE: _make_drive,
}
_TRIED: dict[Kind, Callable[[Case], Outcome]] = {
    Kind.SCENARIO: _try_scenario,
    Kind.WILD: _try_wild,
    Kind.PLAN: _try_plan,
    Kind.COMMAND: _try_command,
    Kind.PLANNER: _try_planner,
    Kind.DRIVE: _try_drive,
}
