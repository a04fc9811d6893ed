"""Plan files that were damaged by chance, or edited by hand so that most of what they say still fits together.

What is certified of a file has to hold for its splines by the dense check, and its samples have to be those of its
splines; and no file is certified before `certify` has seen it.
"""

from __future__ import annotations

import json
import math
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import BSpline

import scp_planner as sp
from benchmarks.hostile.damage import cut, damaged
from benchmarks.hostile.dense import checked
from benchmarks.hostile.outcome import Outcome, judged
from benchmarks.hostile.wild import Data, Wild
from scp_planner import builtin
from scp_planner.errors import ScpPlannerError

PLANNED = ("crossing", "headon", "overtaking")
"""Scenarios whose plan files are damaged and edited."""
EDITED = 0.6
SAMPLES = 20
LENGTH, SPEED = 20.0, 1.0
"""m and m/s of a trip that is written by hand."""
RATES = ("velocity", "heading", "speed", "acceleration", "curvature")
NEAR = 1e-5
"""m, rad and m/s by which samples may miss the splines."""
FINE = 20_000


@cache
def _planned(name: str) -> tuple[sp.Scenario, Data]:
    scenario = builtin.load(name)
    return scenario, sp.plan(scenario).to_dict(SAMPLES)


def draw(rng: np.random.Generator) -> Data:
    """Draw a scenario and the contents of a plan file."""
    name = str(rng.choice(PLANNED))
    scenario, plan = _planned(name)
    data = scenario.to_dict()
    if rng.random() < EDITED:
        made = json.loads(json.dumps(plan))
        edit = int(rng.integers(3))
        if edit == 0:
            data = _written(made, rng)
        if edit == 1:
            made["samples"] = damaged(made["samples"], rng)
        if edit == 2 or rng.random() < 0.3:
            made["status"] = str(rng.choice(["certified", "infeasible", "unverified"]))
        return {"scenario": data, "text": json.dumps(made)}
    if rng.random() < 0.8:
        return {"scenario": data, "text": json.dumps(damaged(plan, rng))}
    return {"scenario": data, "bytes": cut(json.dumps(plan).encode(), rng).hex()}


def _written(made: Data, rng: np.random.Generator) -> Data:
    """Write another path of any degree into a plan, driven at an even speed; return a scenario that it may fit."""
    degree, spans = int(rng.integers(1, 8)), int(rng.integers(2, 12))
    inner = np.linspace(0.0, LENGTH, spans + 1)[1:-1]
    if rng.random() < 0.4:  # knots of more than one fold
        inner = np.sort(np.append(inner, rng.choice(inner, int(rng.integers(1, degree + 1)))))
    knots = np.concatenate([np.zeros(degree + 1), inner, np.full(degree + 1, LENGTH)])
    offsets = rng.normal(0.0, 10.0 ** rng.uniform(-3.0, 0.0), len(knots) - degree - 1)
    offsets[[0, -1]] = 0.0
    path = BSpline(knots, offsets, degree)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    ends = np.unique(knots)
    half = 0.5 * np.diff(ends)[:, None]
    places = ends[:-1, None] + half * (1.0 + nodes)
    length = float((half * weights * np.hypot(1.0, path(places, 1))).sum())
    heading = float(rng.uniform(-3.0, 3.0))
    guide = {"origin": [0.0, 0.0], "heading": heading, "kind": "straight", "length": LENGTH}
    made["path"] = {"degree": degree, "knots": knots.tolist(), "offsets": offsets.tolist(), "guide": guide}
    made["acceleration"] = {"degree": 0, "knots": [0.0, 1.0], "coefficients": [0.0], "start_speed": SPEED}
    made.update(start_time=0.0, travel_time=length / SPEED, arrival_time=length / SPEED)
    times = np.linspace(0.0, length / SPEED, SAMPLES)
    made["samples"] = {"time": times.tolist(), "position": _on(made, times).tolist()}
    vehicle = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0, "max_curvature": 1.0}
    if rng.random() < 0.5:
        vehicle["max_curvature_rate"] = 1.0
    begins = {"time": 0.0, "position": [0.0, 0.0], "speed": SPEED, "heading": heading + math.atan(float(path(0.0, 1)))}
    goal = [LENGTH * math.cos(heading), LENGTH * math.sin(heading)]
    return sp.Scenario(vehicle=vehicle, start=begins, goal={"position": goal}).to_dict()


def _on(made: Data, times: np.ndarray) -> np.ndarray:
    """Places (n, 2) at times (n,) on the path of a plan that was written by hand."""
    path, along = made["path"], np.linspace(0.0, LENGTH, FINE + 1)
    over = np.stack([along, BSpline(np.array(path["knots"]), np.array(path["offsets"]), path["degree"])(along)])
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(over, axis=1)))])
    turn = path["guide"]["heading"]
    turned = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]) @ over
    return np.stack([np.interp(SPEED * times, driven, each) for each in turned], axis=1)


def check(data: Data) -> Outcome:
    """Load a plan file, certify it against its scenario, and look at what comes of that."""
    scenario = sp.Scenario(**data["scenario"])
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
        written = json.loads(file.read_bytes())
    early = ["certified before it was looked at"] if plan.certified else []
    if not certificate.holds:
        return judged("does not hold", "; ".join(early), 0, written)
    found = checked(Wild(data["scenario"], 1.0, 1.0), scenario, plan)
    each = [*early, _disagreeing(plan, written.get("samples")), found.detail]
    return judged("certified", "; ".join(filter(None, each)), plan=written)


def _disagreeing(plan: sp.Plan, samples: Any) -> str:
    """Say which samples are not those of the splines."""
    if not isinstance(samples, dict) or "time" not in samples:
        return ""
    keys = [key for key in (*RATES, "position", "time") if key in samples]
    try:
        known = {key: np.array(samples[key], dtype=float) for key in keys}
    except (TypeError, ValueError):
        return "samples that are no numbers"
    times = known.pop("time")
    if np.abs(times - np.clip(times, plan.start_time, plan.arrival_time)).max(initial=0.0) > NEAR:
        return f"samples from {times.min():g} s to {times.max():g} s"
    for key, values in known.items():
        true = np.asarray(getattr(plan, key)(times))
        if values.shape != true.shape:
            return f"samples: {values.shape} of {key}"
        off = np.remainder(values - true + math.pi, 2.0 * math.pi) - math.pi if key == "heading" else values - true
        if not np.abs(off).max(initial=0.0) <= NEAR:
            return f"samples: {key} is off by {np.abs(off).max():.3g}"
    return ""
