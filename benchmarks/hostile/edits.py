"""Plan files of drawn scenes, and files that were written by hand, in which one field or two are another.

Fields are moved by 1e-6 to 1e8, removed, or replaced, and most of what is made so is refused. Of what is certified the
dense check has to find that it holds, and samples have to be those of the splines; no file is certified unchecked.
"""

from __future__ import annotations

import json
import math
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.interpolate import BSpline

import scp_planner as sp
from benchmarks.hostile import scenes
from benchmarks.hostile.features import Data, Rng
from benchmarks.hostile.oracle import Drive, refused
from benchmarks.hostile.outcome import Outcome, judged
from scp_planner import builtin
from scp_planner.errors import TooLargeError

CASES_PER_PLAN = 25
"""Edits of one plan, as a plan takes longer than many checks."""
SMALLEST, LARGEST = -6.0, 8.0
"""Powers of ten, m, s or rad, by which a field is moved."""
SAMPLES = 20_000
SHIFTED, SAMPLED = 0.15, 0.1
"""Share of the edits that move a whole plan in time, and of those that move a sample."""
WRITTEN = 0.2
"""Share of the files that are written by hand."""
LENGTH, SPEED = 20.0, 1.0
"""m and m/s of a trip that is written by hand."""
KEPT_SAMPLES = 20
NEAR = 1e-5
"""m, rad and m/s by which samples may miss the splines."""
PLAN_FIELDS = (
    "start_time",
    "arrival_time",
    "travel_time",
    "path",
    "acceleration",
    "legs",
    "first_heading",
    "last_heading",
)
PLAN_TIME = 5.0
"""s of the clock; what is edited is part of a finding, as it may be another one where the machine is slower."""


def draw(rng: Rng, seed: int) -> Data:
    """Draw which plan is edited, and how: the first time not at all."""
    edited = int(rng.integers(2**62))
    return {"base": seed // CASES_PER_PLAN, "edit": edited if seed % CASES_PER_PLAN else None}


@lru_cache(maxsize=4)
def _planned(base: int) -> tuple[Data, Data] | None:
    """A scene and the contents of its plan file, if there is one soon."""
    rng = np.random.default_rng([base, 65])
    if rng.random() < WRITTEN:
        return _written(rng)
    for _ in range(8):
        scene = {**scenes.draw(rng), "least_time": None}
        try:
            plan = sp.plan(scenes.scenario_of(scene), time_limit=PLAN_TIME)
        except Exception:  # which the plans of these scenes find by themselves
            continue
        if plan.certified:
            return scene, plan.to_dict(KEPT_SAMPLES)
    return None


@lru_cache(maxsize=1)
def _file() -> Data:
    return sp.plan(builtin.load("crossing")).to_dict()


def _written(rng: Rng) -> tuple[Data, Data]:
    """A path of any degree, driven at an even speed, and a scene that it may fit."""
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
    length = float((half * weights * np.hypot(1.0, path(ends[:-1, None] + half * (1.0 + nodes), 1))).sum())
    heading = float(rng.uniform(-3.0, 3.0))
    guide = {"origin": [0.0, 0.0], "heading": heading, "kind": "straight", "length": LENGTH}
    made = {key: value for key, value in _file().items() if key != "samples"}
    made["path"] = {"degree": degree, "knots": knots.tolist(), "offsets": offsets.tolist(), "guide": guide}
    made["acceleration"] = {"degree": 0, "knots": [0.0, 1.0], "coefficients": [0.0], "start_speed": SPEED}
    made.update(start_time=0.0, travel_time=length / SPEED, arrival_time=length / SPEED)
    vehicle = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0, "max_curvature": 1.0}
    if rng.random() < 0.5:
        vehicle["max_curvature_rate"] = 1.0
    begins = {"time": 0.0, "position": [0.0, 0.0], "speed": SPEED, "heading": heading + math.atan(float(path(0.0, 1)))}
    goal = [LENGTH * math.cos(heading), LENGTH * math.sin(heading)]
    return scenes.whole(sp.Scenario(vehicle=vehicle, start=begins, goal={"position": goal}).to_dict()), made


def check(data: Data) -> Outcome:
    """Edit a plan or its scene, and look at what is certified of it."""
    found = _planned(data["base"])
    if found is None:
        return Outcome("no plan")
    scene, written = (json.loads(json.dumps(each)) for each in found)
    edited = "" if data["edit"] is None else edit(scene, written, np.random.default_rng(data["edit"]))
    try:
        scenario, plan = scenes.scenario_of(scene), sp.Plan.from_dict(written, "edited")
    except (sp.ScenarioError, sp.PlanError, TooLargeError, ValueError):
        return Outcome("bad input")
    if plan.certified:
        return judged("certified", "certified before it was looked at", plan=written)
    if not sp.certify(scenario, plan).holds:
        return Outcome("does not hold")
    missed = refused(scene, scenario, Drive(plan, scene["length"], scene["time"]), samples=SAMPLES)
    missed = "; ".join(filter(None, (missed, _disagreeing(plan, written.get("samples")))))
    return judged("certified", f"{edited}: {missed}" if missed else "", plan={"scene": scene, "plan": written})


def _disagreeing(plan: sp.Plan, samples: Any) -> str:
    """Say which samples are not those of the splines."""
    if not samples:
        return ""
    for key in ("position", "velocity", "heading", "speed", "acceleration", "curvature"):
        true = np.asarray(getattr(plan, key)(samples["time"]))
        off = np.array(samples[key]) - true
        if key == "heading":
            off = np.remainder(off + math.pi, 2.0 * math.pi) - math.pi
        if not np.abs(off).max() <= NEAR * max(1.0, float(np.abs(true).max())):
            return f"samples: {key} is off by {np.abs(off).max():.3g}"
    return ""


def edit(scene: Data, written: Data, rng: Rng) -> str:
    """Edit a scene or a plan in place; return what was done."""
    written["status"] = str(rng.choice(["certified", "infeasible", "failed"]))
    if rng.random() < SHIFTED:
        written.pop("samples", None)
        return _shift(written, rng)
    if "samples" in written and rng.random() < SAMPLED:
        leaves = list(_leaves(written["samples"], ()))
        return _move(written["samples"], leaves[int(rng.integers(len(leaves)))][0], rng)
    written.pop("samples", None)
    done = []
    for _ in range(int(rng.choice([1, 1, 2]))):
        parts = {key: written[key] for key in PLAN_FIELDS if key in written}
        inside: Any = parts if rng.random() < 0.3 else scene["scenario"]
        leaves = list(_leaves(inside, ()))
        keys, _ = leaves[int(rng.integers(len(leaves)))]
        done.append(_move(inside, keys, rng))
        if inside is parts:
            written.update(parts)
    return ", ".join(done)


def _leaves(data: Any, keys: tuple[Any, ...]) -> list[tuple[tuple[Any, ...], Any]]:
    if isinstance(data, dict):
        return [leaf for key, value in data.items() for leaf in _leaves(value, (*keys, key))]
    if isinstance(data, list) and keys[-1:] != ("cells",):
        return [leaf for key, value in enumerate(data) for leaf in _leaves(value, (*keys, key))]
    return [(keys, data)]


def _move(data: Any, keys: tuple[Any, ...], rng: Rng) -> str:
    for key in keys[:-1]:
        data = data[key]
    was = data[keys[-1]]
    size = float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(SMALLEST, LARGEST))
    if isinstance(was, bool) or was is None:
        new: Any = (not was) if isinstance(was, bool) else abs(size)
    elif isinstance(was, int | float):
        new = was * (1.0 + size / 1e4) if rng.random() < 0.3 else was + size
        new = new if rng.random() < 0.95 else None
    else:
        new = None
    data[keys[-1]] = new
    return f"{'.'.join(map(str, keys))}: {was!r} is {new!r}"


def _shift(written: Data, rng: Rng) -> str:
    """Move a whole plan in time, wait longer between legs, leave a leg out, or turn one round."""
    size = float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(SMALLEST, 1.0))
    legs = written.get("legs")
    what = int(rng.integers(5))
    if legs is None:
        written["start_time"] += size * (what % 2)
        written["arrival_time"] += size
        return f"shifted by {size!r}"
    number = int(rng.integers(len(legs)))
    if what == 0:
        legs[number]["backward"] = not legs[number]["backward"]
    elif what == 1 and len(legs) > 1:
        del legs[number]
    elif what == 2:
        written["start_time"] -= size
        written["travel_time"] += size
    else:
        for leg in legs[number:]:
            leg["start_time"] += size
        written["arrival_time"] += size
        written["travel_time"] += size
    return f"legs: edit {what} of leg {number} by {size!r}"
