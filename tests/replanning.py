"""Shared by tests of replans: solvers that fail or talk, and a vehicle that follows its plans."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable
from time import perf_counter, sleep
from typing import Any

import numpy as np

import scp_planner as sp
from scp_planner.online.plan import OnlinePlan
from scp_planner.online.planner import Planner
from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus

PERIOD = 0.1
WALL = {"polygon": [[-0.2, -40.0], [0.2, -40.0], [0.2, 40.0], [-0.2, 40.0]]}


class NoSolver:
    """A solver that always fails."""

    name = "none"

    def solve(self, program: QuadraticProgram) -> Solution:
        return Solution(SolverStatus.FAILED, np.zeros_like(program.gradient), np.zeros(0))


class TalkingSolver:
    """A solver during whose first call something else happens."""

    name = "talking"

    def __init__(self, planner: Planner, happens: Callable[[], None]) -> None:
        self.solver, self.happens, self.calls = planner.solver, happens, 0

    def solve(self, program: QuadraticProgram) -> Solution:
        self.calls += 1
        if self.calls == 1:
            self.happens()
        return self.solver.solve(program)


def threads() -> set[threading.Thread]:
    """Return the threads that run."""
    gc.collect()
    return set(threading.enumerate())


def begun_since(before: set[threading.Thread]) -> set[threading.Thread]:
    """Return the threads that have begun since and still run, whatever else has ended."""
    return set(threading.enumerate()) - before


def threads_end(before: set[threading.Thread]) -> bool:
    """Wait until none runs that has begun since; False if one still does after 10 s."""
    gc.collect()
    until = perf_counter() + 10.0
    while begun_since(before) and perf_counter() < until:
        sleep(0.001)
    return not begun_since(before)


def begin(planner: Planner, scenario: sp.Scenario, **options: Any) -> OnlinePlan:
    start = scenario.start
    return planner.replan(start.time, start.position, start.heading, start.speed, **options)


def follow(planner: Planner, time: float, **options: Any) -> OnlinePlan:
    """Replan where the last plan has the vehicle at a time."""
    plan = planner.plan
    assert plan is not None
    heading, speed = float(plan.heading(time)), max(float(plan.speed(time)), 0.0)
    signed = -speed if plan.backward(time) else speed
    return planner.replan(time, plan.position(time), heading, signed, **options)


def seen(
    name: str, position: tuple[float, float], velocity: tuple[float, float], noise: float, seed: int = 0, order: int = 1
) -> dict[str, Any]:
    """A disc of 0.4 m that has been observed for 3 s, at 10 Hz, up to time 0."""
    times = np.linspace(-2.9, 0.0, 30)
    errors = noise * np.random.default_rng(seed).standard_normal((30, 2))
    places = np.array(position) + times[:, None] * velocity + errors
    return {
        "id": name,
        "shape": {"disc": 0.4},
        "observations": {"time": times, "position": places, "covariance": noise**2 * np.eye(2)},
        "model": {"order": order},
    }


def observed(obstacle: dict[str, Any]) -> dict[str, Any]:
    data = dict(obstacle)
    data["observations"] = {key: value.tolist() for key, value in data["observations"].items()}
    return data
