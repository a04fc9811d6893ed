"""Faults on purpose: solvers that fail, observations that vanish, jump, come late or twice, and sudden obstacles.

Each run draws a scene and some faults, and drives :class:`scp_planner.Planner` through them. What may never happen: an
exception, a plan without a reason, a plan called certified (or a stop that is said to hold) that
:mod:`verification.dense_check` refuses.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import math
import traceback
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks import families
from benchmarks.hostile.rides import Ride
from benchmarks.hostile.scenes import whole
from scp_planner.online.plan import AWAY, OnlinePlan
from scp_planner.online.planner import Planner
from scp_planner.settings.online import OnlineSettings
from scp_planner.solvers.interface import QpSolver, QuadraticProgram, Solution, SolverStatus
from verification.following import Told

__all__ = ["KINDS", "FaultRun", "FlakySolver", "common", "injected_run"]

KINDS = ("solver", "vanish", "jump", "late", "doubled", "appears")
PERIOD, HISTORY, NOISE = 0.1, 3.0, 0.1  # s, s, m
LONGEST, STAYS = 12.0, 3.0  # s, of a run, and of a sudden obstacle
JUMP, AHEAD = 5.0, 1.0  # m


class FlakySolver:
    """A solver that fails, calls programs infeasible, or gives nonsense for an answer, now and then."""

    def __init__(self, solver: QpSolver, rng: np.random.Generator, failures: float = 0.3) -> None:
        self.name = solver.name
        self._solver, self._rng, self._failures = solver, rng, failures

    def solve(self, program: QuadraticProgram) -> Solution:
        solution = self._solver.solve(program)
        if self._rng.random() >= self._failures:
            return solution
        match self._rng.integers(4):
            case 0:
                return Solution(SolverStatus.FAILED, solution.x, solution.multipliers)
            case 1:
                return Solution(SolverStatus.INFEASIBLE, solution.x, solution.multipliers)
            case 2:
                nonsense = self._rng.normal(0.0, 1.0, len(solution.x))
                return Solution(SolverStatus.OPTIMAL, nonsense, np.zeros_like(solution.multipliers))
        return Solution(SolverStatus.OPTIMAL, np.full(len(solution.x), np.nan), np.zeros_like(solution.multipliers))


@dataclass
class FaultRun:
    """What came of one run.

    Attributes
    ----------
    seed : int
    kinds : tuple of str
        The faults in it.
    cycles, checked : int
        Replans, and certified trips and stops that the dense check looked at.
    error : str
        The exception, if there was one.
    refused : list of str
        What the dense check says of trips and stops that it refuses.
    unsaid : int
        Plans without a reason.
    outcomes : Counter
    arrived : bool
    slowest : float
        s, the longest replan.
    """

    seed: int
    kinds: tuple[str, ...]
    cycles: int = 0
    checked: int = 0
    error: str = ""
    refused: list[str] = field(default_factory=list)
    unsaid: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    arrived: bool = False
    slowest: float = 0.0

    @property
    def faultless(self) -> bool:
        """Whether nothing happened that may never happen."""
        return not self.error and not self.refused and not self.unsaid


def injected_run(
    seed: int,
    kinds: tuple[str, ...] | None = None,
    deadline: float | None = None,
    longest: float = LONGEST,
    check_every: int = 1,
) -> FaultRun:
    """Drive one scene with faults.

    Parameters
    ----------
    seed : int
    kinds : tuple of str, optional
        Faults; drawn, one or more, if not given.
    deadline : float, optional
        Of each replan, s.
    longest : float
        s after which the run ends; faults begin in its first quarter.
    check_every : int
        Every so many plans are checked.
    """
    rng = np.random.default_rng([seed, 6])
    data = families.random_scenario(str(rng.choice(["crossing3", "crossing5"])), rng)
    if kinds is None:
        chosen = [kind for kind in KINDS if rng.random() < 0.4]
        kinds = tuple(chosen or [str(rng.choice(KINDS))])
    run = FaultRun(seed, kinds)
    try:
        _Drive(data, rng, run, deadline, longest, check_every).go()
    except Exception:  # whatever it is, it is what this looks for
        run.error = traceback.format_exc()
    return run


class _Drive:
    def __init__(
        self,
        data: dict[str, Any],
        rng: np.random.Generator,
        run: FaultRun,
        deadline: float | None,
        longest: float,
        check_every: int,
    ) -> None:
        self.rng, self.run, self.deadline = rng, run, deadline
        self.longest, self.check_every = longest, check_every
        self.motions = {each["id"]: each["motion"] for each in data["obstacles"]}
        self.sudden: dict[str, np.ndarray] = {}
        self.faults_begin = float(rng.uniform(0.3, 0.25 * longest))
        self.jumps = (str(rng.choice(list(self.motions))), float(rng.choice([0.1, 0.5, LONGEST])))
        angle = rng.uniform(0.0, 2.0 * math.pi)
        self.jump = JUMP * np.array([math.cos(angle), math.sin(angle)])
        self.late: list[tuple[float, str, float, np.ndarray]] = []
        times = np.linspace(PERIOD - HISTORY, 0.0, round(HISTORY / PERIOD))
        for obstacle in data["obstacles"]:
            seen = [self._seen(obstacle["id"], float(time)).tolist() for time in times]
            obstacle["observations"] = {
                "time": times.tolist(),
                "position": seen,
                "covariance": (NOISE**2 * np.eye(2)).tolist(),
            }
            del obstacle["motion"]
        scenario = families.as_scenario(data)
        self.planner = Planner(scenario, online=OnlineSettings(period=PERIOD, forget_after=2.0))
        self.ride = Ride(whole(data), self.planner)
        if "solver" in run.kinds:
            self.planner.solver = FlakySolver(self.planner.solver, rng)
        self.position, self.heading, self.speed = np.array(data["start"]["position"]), 0.0, data["start"]["speed"]

    def _true(self, name: str, time: float) -> np.ndarray:
        if name in self.sudden:
            return self.sudden[name]
        place, velocity, acceleration = (
            np.array(self.motions[name][key]) for key in ("position", "velocity", "acceleration")
        )
        return place + velocity * time + acceleration * time**2 / 2.0

    def _seen(self, name: str, time: float) -> np.ndarray:
        return self._true(name, time) + NOISE * self.rng.standard_normal(2)

    def _faulty(self, kind: str, time: float, duration: float = 1.0) -> bool:
        return kind in self.run.kinds and self.faults_begin <= time < self.faults_begin + duration

    def go(self) -> None:
        number, time = 0, 0.0
        while time < self.longest:
            plan = self.planner.replan(time, self.position, self.heading, self.speed, deadline=self.deadline)
            self._judge(plan, time)
            if plan.arrived or (plan.outcome not in AWAY and plan.arrival_time <= time + PERIOD):
                self.run.arrived = True
                return
            number += 1
            time = number * PERIOD
            self.position = plan.position(time)
            self.heading, self.speed = float(plan.heading(time)), max(float(plan.speed(time)), 0.0)
            self._look(time)

    def _look(self, time: float) -> None:
        """Observe, with faults."""
        rng = self.rng
        if "appears" in self.run.kinds and not self.sudden and time >= self.faults_begin:
            ahead = np.array([math.cos(self.heading), math.sin(self.heading)])
            self.sudden["sudden"] = self.position + (AHEAD + 0.6) * ahead  # discs of 0.3 m, 1 m between them
            self.planner.add_obstacle("sudden", {"disc": 0.3})
        if self.sudden and time >= self.faults_begin + STAYS and "sudden" in self.planner.obstacles.tracks:
            self.planner.remove_obstacle("sudden")
            self.sudden["sudden"] = np.full(2, np.inf)
        vanished = self._faulty("vanish", time)
        there = [name for name, place in self.sudden.items() if np.isfinite(place).all()]
        for name in [*self.motions, *there]:
            place = self._seen(name, time)
            if name == self.jumps[0] and self._faulty("jump", time, self.jumps[1]):
                place = place + self.jump
            if not vanished:
                delay = float(rng.uniform(0.1, 0.8)) if "late" in self.run.kinds and rng.random() < 0.3 else 0.0
                self.late.append((time + delay, name, time, place))
                if "doubled" in self.run.kinds and rng.random() < 0.3:
                    again = place if rng.random() < 0.7 else self._seen(name, time)
                    self.late.append((time + delay, name, time, again))
        for one in sorted(self.late, key=lambda one: one[0]):
            if one[0] <= time and (one[1] in self.motions or one[1] in there):
                self._tell(*one[1:])
        self.late = [one for one in self.late if one[0] > time]

    def _tell(self, name: str, time: float, place: np.ndarray) -> None:
        noise = NOISE**2 * np.eye(2)
        if name not in self.planner.obstacles.tracks:  # forgotten in the meantime
            shape = next((o.shape for o in self.planner.given.obstacles if o.id == name), {"disc": 0.3})
            self.planner.add_obstacle(name, shape, covariance=noise)
        self.planner.observe(name, time, place, noise)

    # what came of it

    def _judge(self, plan: OnlinePlan, time: float) -> None:
        run = self.run
        run.cycles += 1
        run.outcomes[str(plan.outcome)] += 1
        run.unsaid += not plan.reason
        run.slowest = max(run.slowest, plan.wall_time)
        if run.cycles % self.check_every:
            return
        refused = self.ride.judge(plan, Told(time, self.position, self.heading, self.speed))
        run.checked = self.ride.checked
        if refused:
            run.refused.append(f"t = {time:.1f} s: {refused}")
