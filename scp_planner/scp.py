"""The loop: linearise, solve, accept or reject, resize the trust region."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from scp_planner.constraints import Rows
from scp_planner.constraints.clearance import clearance_rows
from scp_planner.constraints.kinematics import KinematicRows, curvature_rows, lateral_rows
from scp_planner.evaluation import Evaluation, Penalties, evaluate_trip
from scp_planner.problem import Problem
from scp_planner.solvers.interface import QpSolver, SolverStatus
from scp_planner.subproblem import TrustRegion, build_subproblem
from scp_planner.trajectory import Trajectory

Array = NDArray[np.float64]

STRIDE = 3  # of the samples that become rows besides the minima
LIMIT_REACH = 1.0  # relative distance to a limit from which on a site becomes a row
FEASIBILITY = 2e-4  # largest violation of a converged trip: m in a zone inflated by more, relative for limits


class Status(Enum):
    """How a run of the loop ended."""

    CONVERGED = "converged"
    STALLED = "stalled"
    INFEASIBLE = "infeasible"
    ITERATION_LIMIT = "iteration limit"
    TIME_LIMIT = "time limit"
    SOLVER_FAILED = "solver failed"


@dataclass(frozen=True)
class Iteration:
    """One row of the iteration record."""

    number: int
    travel_time: float
    merit: float
    violation: float
    predicted: float
    actual: float
    accepted: bool
    trust: TrustRegion
    rows: int


@dataclass
class Run:
    """A run of the loop and where it ended."""

    status: Status
    evaluation: Evaluation
    penalties: Penalties
    record: list[Iteration] = field(default_factory=list)

    @property
    def feasible(self) -> bool:
        """Whether the trip keeps all sampled constraints."""
        return self.evaluation.worst_violation <= FEASIBILITY


class ScpLoop:
    def __init__(self, problem: Problem, solver: QpSolver) -> None:
        self.problem = problem
        self.solver = solver
        self.kinematics = KinematicRows(problem)
        self.zone_count = problem.zones.size
        self.skipped = np.ones(len(problem.samples.sigma), dtype=bool)
        self.skipped[: problem.grid : STRIDE] = False

    def run(self, start: Trajectory, max_iterations: int) -> Run:
        problem, settings = self.problem, self.problem.settings
        penalties = Penalties(np.full(self.zone_count, 5.0), np.full(3, 5.0))
        trust = TrustRegion(1.0, 3.0, 0.3)
        near = 1.5
        current = evaluate_trip(problem, start, near)
        run = Run(Status.ITERATION_LIMIT, current, penalties)
        self.timing = getattr(self, "timing", {"lin": 0.0, "qp": 0.0, "eval": 0.0})
        rejected = 0
        for number in range(1, max_iterations + 1):
            t0 = perf_counter()
            rows = self.linearise(current, trust, near)
            weights = np.concatenate([penalties.zones, penalties.limits])
            sub = build_subproblem(problem, self.kinematics, current.trajectory, rows, weights, trust)
            t1 = perf_counter()
            solution = self.solver.solve(sub.program)
            t2 = perf_counter()
            self.timing["lin"] += t1 - t0
            self.timing["qp"] += t2 - t1
            if solution.status is not SolverStatus.OPTIMAL:
                trust = trust.scaled(0.5)
                run.status = Status.SOLVER_FAILED
                if trust.theta < 1e-4:
                    break
                continue
            z = solution.x
            merit = current.merit(penalties)
            slack = z[sub.step_size :]
            model = current.trajectory.travel_time * (1 + z[sub.step_size - 1]) + float(weights[sub.groups] @ slack)
            predicted = merit - model
            candidate = evaluate_trip(problem, self.step(current.trajectory, z), near)
            self.timing["eval"] += perf_counter() - t2
            actual = merit - candidate.merit(penalties)
            ratio = actual / predicted if predicted > 0 else -1.0
            accepted = actual > 0.0 and ratio > 0.05
            run.record.append(
                Iteration(number, candidate.trajectory.travel_time, candidate.merit(penalties), candidate.worst_violation,
                          predicted, actual, accepted, trust, len(rows.gap)))
            small = predicted < settings.tolerance
            if accepted:
                current = candidate
                run.evaluation = current
            if small:
                if current.worst_violation <= FEASIBILITY:
                    run.status = Status.CONVERGED
                    break
                # escalate what stays
                stuck = np.concatenate([current.zone_violation, current.limit_violation]) > FEASIBILITY
                if weights[stuck].max(initial=0.0) > 1e4:
                    run.status = Status.INFEASIBLE
                    break
                penalties.zones[stuck[: self.zone_count]] *= 5
                penalties.limits[stuck[self.zone_count :]] *= 5
            if ratio < 0.25:
                trust = trust.scaled(0.4)
            elif ratio > 0.7:
                trust = TrustRegion(min(trust.theta * 1.7, 3.0), min(trust.beta * 1.7, 5.0), min(trust.rho * 1.7, 0.5))
            if trust.theta < 1e-5:
                run.status = Status.STALLED
                break
        return run

    def step(self, trajectory: Trajectory, z: Array) -> Trajectory:
        problem = self.problem
        theta = trajectory.theta.copy()
        free = problem.ends.free
        count = free.stop - free.start
        theta[free] += z[:count]
        size = problem.space.acceleration_size
        beta = (trajectory.beta + z[count : count + size]) / (1.0 + z[count + size]) ** 2
        return problem.space.trajectory(theta, beta)

    def linearise(self, current: Evaluation, trust: TrustRegion, near: float) -> Rows:
        """Rows of everything that a step inside the trust region could violate."""
        problem, trajectory = self.problem, current.trajectory
        low = current.clearance < near
        low[self.skipped] = False
        sample, zone = np.nonzero(low)
        points = current.points.take(sample)
        contacts = problem.zones.contacts(zone, points.time, points.path.position)
        rows = Rows.stack(
            [
                clearance_rows(problem, trajectory, current.minima_zone, current.minima, current.minima_contacts),
                clearance_rows(problem, trajectory, zone, points, contacts),
                lateral_rows(problem, trajectory, current.sites, LIMIT_REACH, self.zone_count),
                curvature_rows(problem, trajectory, current.sites, LIMIT_REACH, self.zone_count + 1),
            ]
        )
        absolute = np.abs(rows.matrix)
        count = problem.ends.free.stop - problem.ends.free.start
        reach = (
            trust.theta * (absolute[:, :count] @ problem.space.tables.leverage[problem.ends.free])
            + trust.beta * absolute[:, count:-1].sum(axis=1)
            + trust.rho * absolute[:, -1]
        )
        return rows.take(reach >= rows.gap)
