"""Calls of an online planner: drives, observations, obstacles that come and go, with absurd values among them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import ValidationError

import scp_planner as sp

Call = dict[str, Any]
FEWEST, MOST = 3, 10
DEADLINES = (None, 0.02, 0.2, 1e-9, -1.0, math.nan, math.inf)
ODD_NUMBERS: tuple[object, ...] = (
    0.0,
    -1.0,
    1e-300,
    1e9,
    -1e12,
    1e300,
    math.nan,
    math.inf,
    None,
    "x",
    True,
    10**400,
    [],
    1e-6,
)
PATIENCE = 1.0
"""s that a replan without a deadline of its own is given."""
NORMAL = 0.75
"""Probability that a value is as it should be."""


def draw(rng: np.random.Generator, scenario: Mapping[str, Any], odd: Sequence[Any]) -> list[Call]:
    """Draw calls, each with its method and arguments, for a planner of a scenario."""
    start, aim = scenario["start"], _aim(scenario["goal"])
    names = [each["id"] for each in scenario["obstacles"]] or ["nobody"]
    time, made = float(start["time"]), []
    size = math.dist(start["position"], aim)

    def number(usual: float) -> Any:
        return usual if rng.random() < NORMAL else ODD_NUMBERS[int(rng.integers(len(ODD_NUMBERS)))]

    def place() -> Any:
        if rng.random() < 0.1:
            return odd[int(rng.integers(len(odd)))]
        share = float(rng.uniform(0.0, 1.0))
        there = [
            a + share * (b - a) + float(rng.normal(0.0, 0.1 * size))
            for a, b in zip(start["position"], aim, strict=True)
        ]
        return [number(x) for x in there]

    for _ in range(int(rng.integers(FEWEST, MOST))):
        name = str(rng.choice([*names, "new", "", "nobody"]))
        match int(rng.integers(0, 8)):
            case 0 | 1 | 2:
                time += float(rng.choice([0.1, 0.1, 0.0, 5.0]))
                arguments = {
                    "time": number(time),
                    "position": start["position"] if rng.random() < 0.5 else place(),
                    "heading": number(float(rng.uniform(-4.0, 4.0))),
                    "speed": number(float(rng.uniform(0.0, 1.2)) * scenario["vehicle"]["max_speed"]),
                    "deadline": DEADLINES[int(rng.integers(len(DEADLINES)))],
                }
                made.append({"method": "replan", "arguments": arguments})
            case 3 | 4 | 5:
                for k in range(int(rng.choice([1, 1, 5, 100]))):
                    seen = {"obstacle": name, "time": number(time + 0.01 * k), "position": place()}
                    if rng.random() < 0.4:
                        seen["covariance"] = [[number(0.01), number(0.0)], [number(0.0), number(0.01)]]
                    made.append({"method": "observe", "arguments": seen})
            case 6:
                made.append({"method": "add_obstacle", "arguments": _added(name, rng, odd, number)})
            case _:
                made.append({"method": "remove_obstacle", "arguments": {"obstacle": name}})
    return made


def _aim(goal: Mapping[str, Any]) -> list[float]:
    """Where a trip goes about: a goal that is a region need not say."""
    if goal.get("position") is not None:
        return list(goal["position"])
    return [math.fsum(values) / len(values) for values in zip(*goal["region"], strict=True)]


def _added(name: str, rng: np.random.Generator, odd: Sequence[Any], number: Callable[[float], Any]) -> dict[str, Any]:
    """Arguments of an obstacle that is added."""
    shape = {"disc": number(0.3)} if rng.random() < NORMAL else odd[int(rng.integers(len(odd)))]
    arguments = {"obstacle": name, "shape": shape, "margin": number(0.0)}
    if rng.random() < 0.3:
        process = {"kind": "random_walk", "diffusion": 0.1}
        arguments["model"] = {"process": {"process": process, "velocity_deviation": 1.0, "noise_deviation": 0.1}}
    return arguments


def play(scenario: sp.Scenario, calls: Sequence[Call]) -> int:
    """Make the calls; return how many were refused by the exceptions that are documented."""
    planner = sp.Planner(scenario)
    refused = 0
    for call in calls:
        arguments = dict(call["arguments"])
        if call["method"] == "replan" and arguments.get("deadline") is None:
            arguments["deadline"] = PATIENCE
        try:
            answer = getattr(planner, call["method"])(**arguments)
        except (sp.ScenarioError, ValidationError):
            refused += 1
        except ValueError as error:
            if isinstance(error, np.linalg.LinAlgError):
                raise
            refused += 1
        else:
            if call["method"] == "replan" and not answer.reason:
                raise AssertionError(f"a plan without a reason: {answer.outcome}")
    return refused
