"""Plans of drawn scenes, checked against scenes, and from files, in which one field or two are another.

Fields are moved by 1e-6 to 1e8, removed, or replaced, and most of what is made so is refused. Of what is certified the
dense check has to find that it holds.
"""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.hostile import combined
from benchmarks.hostile.oracle import refused
from benchmarks.hostile.outcome import Outcome, judged
from benchmarks.hostile.wild import Data, Rng
from scp_planner.errors import TooLargeError

CASES_PER_PLAN = 25
"""Edits of one plan, as a plan takes longer than many checks."""
SMALLEST, LARGEST = -6.0, 8.0
"""Powers of ten, m, s or rad, by which a field is moved."""
SAMPLES = 20_000
SHIFTED = 0.15
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
    """Draw which plan is edited, and how."""
    return {"base": seed // CASES_PER_PLAN, "edit": int(rng.integers(2**62))}


@lru_cache(maxsize=4)
def _planned(base: int) -> tuple[Data, Data] | None:
    """A scene and its certified plan, if there is one soon."""
    for trial in range(8):
        scene = combined.draw(np.random.default_rng([base, trial, 65]))
        try:
            scenario = combined.scenario_of(scene)
            plan = sp.plan(scenario, time_limit=PLAN_TIME)
        except (sp.ScenarioError, TooLargeError, sp.EstimationError):
            continue
        except Exception:  # which the plans of these scenes find by themselves
            continue
        if plan.certified:
            written = plan.to_dict()
            del written["samples"]
            return scene, written
    return None


def check(data: Data) -> Outcome:
    """Edit a plan or its scene, and look at what is certified of it."""
    found = _planned(data["base"])
    if found is None:
        return Outcome("no plan")
    scene, written = (json.loads(json.dumps(each)) for each in found)
    rng = np.random.default_rng(data["edit"])
    edited = edit(scene, written, rng)
    try:
        scenario, plan = combined.scenario_of(scene), sp.Plan.from_dict(written, "edited")
    except (sp.ScenarioError, sp.PlanError, ValueError):
        return Outcome("bad input")
    certificate = sp.certify(scenario, plan)
    if not certificate.holds:
        return Outcome("does not hold")
    missed = refused({**scene, "least_time": None}, scenario, plan, samples=SAMPLES)
    return judged("certified", f"{edited}: {missed}" if missed else "", plan={"scene": scene, "plan": written})


def edit(scene: Data, written: Data, rng: Rng) -> str:
    """Edit a scene or a plan in place; return what was done."""
    if rng.random() < SHIFTED:
        return _shift(written, rng)
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
