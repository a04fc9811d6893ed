"""Cases: what is tried, drawn from a kind and a seed, and what may come of it.

A case is plain data, so that it can be written to a file, and tried again in a process of its own.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from contextlib import chdir
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

import scp_planner as sp
from benchmarks.hostile import clocks, commands, corridors, edits, oracle, rides, scenes, sensors
from benchmarks.hostile.damage import cut, damaged
from benchmarks.hostile.features import Data
from benchmarks.hostile.outcome import Fault, Outcome, judged
from benchmarks.hostile.scaling import scaled
from scp_planner.errors import TooLargeError

PLAN_TIME = 4.0
"""s that a plan may take if nobody says otherwise."""


class Kind(StrEnum):
    """What is tried."""

    SCENARIO = "scenario"
    """Damaged scenario files: refused, or planned."""
    COMMAND = "command"
    """Command lines with absurd arguments."""
    CORRIDOR = "corridor"
    """Trips through corridors of any size with holes and slivers, compared with the union of their polygons."""
    COMBINED = "combined"
    """Scenes from the product of features: planned, on time, and certified plans checked densely."""
    EDIT = "edit"
    """Plans of such scenes, checked after fields of the plan or the scene were edited."""
    RIDE = "ride"
    """Drives through such scenes; limits, goal and ground change, and odd states are reported."""
    CLOCK = "clock"
    """The same drive on another clock."""
    SENSOR = "sensor"
    """What drivers of sensors and trackers send, odd but common, and zones compared with where people are."""


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


def make(kind: Kind, seed: int, plan_time: float = PLAN_TIME) -> Case:
    """Draw a case."""
    rng = np.random.default_rng([seed, *kind.encode()])
    return Case(kind, seed, edits.draw(rng, seed) if kind is Kind.EDIT else _MAKERS[kind](rng), plan_time)


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
    scene = scenes.draw(rng)
    base = scaled(scene["scenario"], scene["length"], scene["time"])
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


def _try_combined(case: Case) -> Outcome:
    try:
        scenario = scenes.scenario_of(case.data)
    except sp.ScenarioError:
        return Outcome("bad input")
    began = time.process_time()
    try:
        plan = sp.plan(scenario, time_limit=case.plan_time, constraints=scenes.constraints_of(case.data))
    except (TooLargeError, sp.EstimationError):
        return Outcome("too large")
    took = time.process_time() - began
    if took > case.plan_time * (1.0 + rides.SHARE) + rides.SPARE:
        return Outcome(plan.status.value, Fault.HANG, f"{took:.2f} s for {case.plan_time:g} s")
    if not plan.certified:
        fault = None if plan.reason else Fault.REFUSED
        return Outcome(plan.status.value, fault, "" if plan.reason else "neither certified nor a reason")
    drive = oracle.Drive(plan, case.data["length"], case.data["time"])
    return judged("certified", oracle.refused(case.data, scenario, drive), plan=plan.to_dict())


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


_MAKERS: dict[Kind, Callable[[np.random.Generator], Data]] = {
    Kind.SCENARIO: _make_scenario,
    Kind.COMMAND: lambda rng: {"arguments": [word.hex() for word in commands.draw(rng)]},
    Kind.CORRIDOR: corridors.draw,
    Kind.COMBINED: scenes.draw,
    Kind.RIDE: rides.draw,
    Kind.CLOCK: clocks.draw,
    Kind.SENSOR: sensors.draw,
}
_TRIED: dict[Kind, Callable[[Case], Outcome]] = {
    Kind.SCENARIO: _try_scenario,
    Kind.COMMAND: _try_command,
    Kind.CORRIDOR: lambda case: corridors.check(case.data),
    Kind.COMBINED: _try_combined,
    Kind.EDIT: lambda case: edits.check(case.data),
    Kind.RIDE: lambda case: rides.drive(case.data),
    Kind.CLOCK: lambda case: clocks.check(case.data),
    Kind.SENSOR: lambda case: sensors.check(case.data),
}
