"""One linearisation of the trip as a convex quadratic program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scp_planner.arrays import Array, Index, Mask
from scp_planner.constraints.drive import DriveRows
from scp_planner.constraints.rows import Rows
from scp_planner.problem.problem import Problem
from scp_planner.scp.last_step import LastStep
from scp_planner.scp.linearisation import TrustRegion
from scp_planner.solvers.interface import Solution, StepOrigin
from scp_planner.solvers.slacked import SlackedProgram
from scp_planner.trips.trajectory import Trajectory

PROXIMAL_OFFSET = 1e-2  # on steps of the offset's control points
PROXIMAL_ACCELERATION = 1e-3  # on those of its accelerations
PROXIMAL_TIME = 1e-3  # on the relative step of the travel time
SLACK_CURVATURE = 1e-3
MOST_SLACK = 1e6
MULTIPLIER_SPEED = 0.3  # of the top speed: bounds the multiplier 1 / v of arrival


@dataclass
class ActiveSet:
    step: NDArray[np.int8]  # (n,): of the bounds of the step: -1 at the lower one, +1 at the upper one, 0 inactive
    hard: NDArray[np.int8]  # (h,): of the hard rows
    keys: Index  # (k,): sorted keys of the active rows that may be violated at a price
    violated: Mask  # (G,): whether the slack of each violation was positive

    def guess(self, rows: Rows, groups: Index) -> NDArray[np.int8]:
        """Return the guess for a program with these rows and slacks."""
        slacks = self.violated[groups].astype(np.int8) - np.int8(1)
        return np.concatenate([self.step, slacks, self.hard, _among(rows.key, self.keys)])


@dataclass(frozen=True)
class Subproblem:
    """A quadratic program and how its variables are laid out."""

    program: SlackedProgram
    rows: Rows  # those that may be violated at a price
    step_size: int  # number of variables of the step; the slacks follow
    groups: Index  # (g,): violation that each slack belongs to
    group_count: int  # number G of violations in the merit

    def prices(self, solution: Solution) -> Array:
        """Return the multipliers of all rows, the hard ones first, in a solution of the program."""
        return solution.multipliers[len(self.program.gradient) :]

    def active_set(self, solution: Solution) -> ActiveSet:
        """Return what is active in a solution of the program."""
        signs = np.sign(solution.multipliers).astype(np.int8)
        size, total = self.step_size, len(self.program.gradient)
        soft = len(signs) - len(self.rows.gap)
        return ActiveSet(
            signs[:size],
            signs[total:soft],
            np.sort(self.rows.key[signs[soft:] != 0]),
            self._violated(signs[size:total] == 0),
        )

    def _violated(self, positive: Mask) -> Mask:
        violated = np.zeros(self.group_count, dtype=bool)
        violated[self.groups] = positive
        return violated


def build_subproblem(
    problem: Problem,
    drive: DriveRows,
    trajectory: Trajectory,
    rows: Rows,
    weights: Array,
    trust: TrustRegion,
    active: ActiveSet | None = None,
    last: LastStep | None = None,
) -> Subproblem:
    """Build the quadratic program of a step from a trip."""
    present = np.bincount(rows.group, minlength=len(weights)) > 0
    (groups,) = present.nonzero()
    slack = (present.cumsum() - 1)[rows.group]
    size = drive.width
    total = size + len(groups)
    gradient = np.zeros(total)
    gradient[size - 1] = trajectory.travel_time
    gradient[size:] = weights[groups]
    lower, upper = _bounds(problem, trajectory, trust, total)
    program = SlackedProgram(
        _hessian(problem, trajectory, rows, total, last),
        gradient,
        lower,
        upper,
        drive.matrix(trajectory),
        rows.matrix,
        size + slack,
        np.concatenate([drive.bounds(trajectory), rows.gap]),
        drive.equalities,
        None if active is None else active.guess(rows, groups),
        None if problem.given is None else _origin(problem, trajectory),
    )
    return Subproblem(program, rows, size, groups, len(weights))


def _hessian(problem: Problem, trajectory: Trajectory, rows: Rows, total: int, last: LastStep | None) -> Array:
    """Second derivative of the Lagrangian, by step and slacks, (total, total)."""
    hessian = np.zeros((total, total))
    free, size = problem.ends.free, problem.step_size
    theta = free.stop - free.start
    hessian[:theta, :theta] = _arc_length_hessian(problem, trajectory)[free, free]
    diagonal = np.empty(total)
    diagonal[:theta] = PROXIMAL_OFFSET
    diagonal[theta : size - 1] = PROXIMAL_ACCELERATION / problem.agility**2
    diagonal[size - 1] = PROXIMAL_TIME
    diagonal[size:] = SLACK_CURVATURE
    hessian.flat[:: total + 1] += diagonal
    if last is not None:
        last.teach(problem, rows, hessian[:size, :size], diagonal[:size])
    return hessian


def _bounds(problem: Problem, trajectory: Trajectory, trust: TrustRegion, total: int) -> tuple[Array, Array]:
    """Bounds of the step, by the trust region and those of the offsets, and of the slacks, (total,) each."""
    lower, upper = np.empty(total), np.empty(total)
    free, size = problem.ends.free, problem.step_size
    theta = free.stop - free.start
    offsets = trajectory.theta[free]
    radius = trust.theta * problem.space.tables.leverage[free]
    upper[:theta] = np.minimum(radius, problem.ends.upper[free] - offsets)
    lower[:theta] = np.maximum(-radius, problem.ends.lower[free] - offsets)
    upper[theta : size - 1] = trust.beta * problem.agility
    lower[theta : size - 1] = -trust.beta * problem.agility
    upper[size - 1] = trust.rho
    lower[size - 1] = -trust.rho
    upper[size:] = MOST_SLACK
    lower[size:] = 0.0
    return lower, upper


def _origin(problem: Problem, trajectory: Trajectory) -> StepOrigin:
    """The variables (theta, b, tau) that a user's own constraints are about, and how a step moves them."""
    tau, offsets = trajectory.travel_time, trajectory.theta[problem.ends.free]
    start = np.concatenate([offsets, tau**2 * trajectory.beta, [tau]])
    scale = np.concatenate([np.ones(len(offsets)), np.full(len(trajectory.beta), tau**2), [tau]])
    return StepOrigin(start, scale)


def _among(keys: Index, wanted: Index) -> NDArray[np.int8]:
    """1 where a key is among the wanted ones, which are sorted, else 0."""
    if len(wanted) == 0:
        return np.zeros(len(keys), dtype=np.int8)
    place = np.minimum(wanted.searchsorted(keys), len(wanted) - 1)
    return (wanted[place] == keys).astype(np.int8)


def _arc_length_hessian(problem: Problem, trajectory: Trajectory) -> Array:
    """Second derivative of the arc length, times the multiplier of arrival, (K1, K1)."""
    space, path = problem.space, trajectory.path
    tables = space.tables
    cells = space.length / tables.cells
    weights = tables.node_weights * (cells / space.length**2) / (path.node_speed**2 * path.node_speed)
    if path.node_stretch is not None:
        weights = weights * path.node_stretch**2
    multiplier = 1.0 / max(trajectory.final_speed, MULTIPLIER_SPEED * problem.limits.speed)
    return tables.slopes_squared(multiplier * weights)
