"""CVXPY: the readable form of the same quadratic program, for any installed solver and for constraints of one's own."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import cvxpy as cp
import numpy as np

from scp_planner.arrays import Array
from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus, StepOrigin
from scp_planner.solvers.polishing import polish, violation
from scp_planner.solvers.scaling import Scaling, equilibrate
from scp_planner.solvers.tolerances import UNPOLISHED_VIOLATION

ExtraConstraints = Callable[[cp.Expression], list[cp.Constraint]]


@dataclass(frozen=True)
class Padding:
    """Size classes of programs, so that few are compiled, and numbers in them."""

    variable_class: int = 8  # variables are padded to a multiple of this
    row_classes: int = 4  # size classes of rows in each doubling
    large: float = 1e6  # stands for a missing bound, in scaled units
    least_time: float = 1e-3  # s; some solvers take 0 for no limit


PADDING = Padding()
# Accurate enough to tell the active constraints; polishing does the rest.
_OPTIONS: dict[str, dict[str, Any]] = {
    "CLARABEL": {
        "tol_gap_abs": 1e-11,
        "tol_gap_rel": 1e-11,
        "tol_feas": 1e-11,
        "max_threads": 1,
        "max_iter": 200,
        "input_sparse_dropzeros": True,
    },
    "OSQP": {"eps_abs": 1e-8, "eps_rel": 1e-8, "max_iter": 20000, "adaptive_rho_interval": 100},
    "SCS": {"eps_abs": 1e-8, "eps_rel": 1e-8, "max_iters": 50000},
    "DAQP": {"primal_tol": 1e-10, "iter_limit": 5000},
}
_TIME_LIMIT = {"CLARABEL": "time_limit", "OSQP": "time_limit", "SCS": "time_limit_secs", "DAQP": "time_limit"}
_STATUS = {
    cp.OPTIMAL: SolverStatus.OPTIMAL,
    cp.INFEASIBLE: SolverStatus.INFEASIBLE,
    cp.INFEASIBLE_INACCURATE: SolverStatus.INFEASIBLE,
}


class CvxpySolver:
    """Adapter of :class:`cvxpy.Problem`.

    Parameters
    ----------
    solver : str
        Any of :func:`cvxpy.installed_solvers` that takes quadratic programs.
    extra : callable, optional
        ``extra(values)`` returns convex constraints that every step has to keep, on a variable that holds what the step
        leads to, see :class:`StepOrigin`. Users give theirs to :func:`scp_planner.plan`, which also sees to it that a
        run starts where they can be kept, and that the plan keeps them.
    options : mapping, optional
        Passed to the solver, over this module's own.

    Raises
    ------
    ValueError
        If the solver is not installed.
    """

    name = "cvxpy"

    def __init__(
        self,
        solver: str = "CLARABEL",
        extra: ExtraConstraints | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        installed = cp.installed_solvers()  # type: ignore[no-untyped-call]
        if solver.upper() not in installed:
            raise ValueError(f"solver: cvxpy has no {solver!r} here; there are {', '.join(installed)}")
        self._solver = solver.upper()
        self._options = {**_OPTIONS.get(self._solver, {}), **(options or {})}
        self._extra = extra
        self._forms: dict[_Size, _Form] = {}

    def keeping(self, extra: ExtraConstraints) -> CvxpySolver:
        """Return the same solver with extra constraints."""
        return CvxpySolver(self._solver, extra, self._options)

    def _limited(self, deadline: float) -> dict[str, Any]:
        """The options, with what is left of the time for a solver that takes a limit, unless a user gave one."""
        name = _TIME_LIMIT.get(self._solver)
        if name is None:
            return self._options
        return {name: max(deadline - perf_counter(), PADDING.least_time), **self._options}

    def solve(self, program: QuadraticProgram) -> Solution:
        """Solve one quadratic program.

        Parameters
        ----------
        program : QuadraticProgram

        Returns
        -------
        Solution

        Raises
        ------
        ValueError
            If there are extra constraints, and the program does not say what it starts from.
        """
        if self._extra is not None and program.origin is None:
            raise ValueError("extra constraints need a program with an origin; give them to plan(constraints=...)")
        deadline = perf_counter() + program.time_limit
        size = _Size.of(program)
        if size not in self._forms:
            self._forms[size] = _Form(size, self._extra)
        form, scaling = self._forms[size], equilibrate(program)
        form.fill(scaling, program.origin)
        try:
            with warnings.catch_warnings():
                # An inaccurate answer is judged here: polished, or returned as failed if it is not feasible.
                warnings.filterwarnings("ignore", message="Solution may be inaccurate")
                # Without warm start: the answer may not depend on what was solved before.
                form.problem.solve(  # type: ignore[no-untyped-call]
                    solver=self._solver, warm_start=False, enforce_dpp=True, **self._limited(deadline)
                )
        except cp.SolverError:
            return _no_answer(program, SolverStatus.FAILED)
        status = _STATUS.get(form.problem.status, SolverStatus.FAILED)
        if self._extra is not None and form.problem.status == cp.OPTIMAL_INACCURATE:
            status = SolverStatus.OPTIMAL  # cones cannot be polished: a step that is feasible is one, see below
        answer = form.answer(scaling.program, status)
        if self._extra is None and status is not SolverStatus.INFEASIBLE:
            polished = polish(scaling.program, answer, deadline)
            if polished is not None:
                return scaling.original(polished)
        if status is SolverStatus.OPTIMAL and violation(scaling.program, answer.x) > UNPOLISHED_VIOLATION:
            answer = replace(answer, status=SolverStatus.FAILED)
        return scaling.original(answer)


@dataclass(frozen=True)
class _Size:
    """Numbers of variables with an origin, of all variables and of rows with padding, and of equalities."""

    step: int
    variables: int
    rows: int
    equalities: int

    @classmethod
    def of(cls, program: QuadraticProgram) -> _Size:
        count = len(program.gradient)
        return cls(
            0 if program.origin is None else len(program.origin.start),
            -(-count // PADDING.variable_class) * PADDING.variable_class,
            _row_class(len(program.bound) - program.equalities),
            program.equalities,
        )


def _row_class(rows: int) -> int:
    """Smallest size class for a number of rows."""
    step = max(2 ** (int(rows).bit_length() - 1) // PADDING.row_classes, 1) if rows else 1
    return max(-(-rows // step) * step, 1)


class _Form:
    """The quadratic program of one size, as it reads, in scaled variables y."""

    def __init__(self, size: _Size, extra: ExtraConstraints | None) -> None:
        n, m, k = size.variables, size.rows, size.equalities
        self.size, self.extra = size, extra is not None
        self.y = cp.Variable(n, name="y")
        self.factor = cp.Parameter((n, n), name="factor")
        self.gradient = cp.Parameter(n, name="gradient")
        self.matrix = cp.Parameter((m, n), name="matrix")
        self.bound = cp.Parameter(m, name="bound")
        self.equal_matrix = cp.Parameter((k, n), name="equal_matrix")
        self.equal_bound = cp.Parameter(k, name="equal_bound")
        self.lower = cp.Parameter(n, name="lower")
        self.upper = cp.Parameter(n, name="upper")

        self.rows = self.matrix @ self.y <= self.bound
        self.below = self.y <= self.upper
        self.above = self.y >= self.lower
        constraints = [self.rows, self.below, self.above]
        self.equal: cp.Constraint | None = None
        if k:
            self.equal = self.equal_matrix @ self.y == self.equal_bound
            constraints.append(self.equal)
        if extra is not None:
            # A variable of their own: so they need to be convex, but not to follow the rules for parameters.
            self.start = cp.Parameter(size.step, name="start")
            self.scale = cp.Parameter(size.step, name="scale")
            values = cp.Variable(size.step, name="values")
            moved = cp.multiply(self.scale, self.y[: size.step])  # type: ignore[attr-defined]
            constraints += [values == self.start + moved, *extra(values)]
        curved = cp.sum_squares(self.factor @ self.y)  # type: ignore[attr-defined]
        self.problem = cp.Problem(cp.Minimize(0.5 * curved + self.gradient @ self.y), constraints)

    def fill(self, scaling: Scaling, origin: StepOrigin | None) -> None:
        """Set all parameters."""
        program = scaling.program
        n, m, k = self.size.variables, self.size.rows, self.size.equalities
        count, rows = len(program.gradient), len(program.bound) - k
        factor = np.eye(n)
        factor[:count, :count] = np.linalg.cholesky(program.hessian).T
        self.factor.value = factor
        self.gradient.value = _padded(program.gradient, n, 0.0)
        self.lower.value = _padded(np.maximum(program.lower, -PADDING.large), n, -1.0)
        self.upper.value = _padded(np.minimum(program.upper, PADDING.large), n, 1.0)
        matrix = np.zeros((m, n))
        matrix[:rows, :count] = program.matrix[k:]
        bound = _padded(program.bound[k:], m, 1.0)
        missing = np.isinf(bound)
        matrix[missing], bound[missing] = 0.0, 1.0
        self.matrix.value, self.bound.value = matrix, bound
        equal = np.zeros((k, n))
        equal[:, :count] = program.matrix[:k]
        self.equal_matrix.value, self.equal_bound.value = equal, program.bound[:k]
        if self.extra and origin is not None:
            self.start.value = origin.start
            self.scale.value = origin.scale * scaling.columns[: self.size.step]

    def answer(self, program: QuadraticProgram, status: SolverStatus) -> Solution:
        """Return the last answer, without the padding; zeros where there is none."""
        if self.y.value is None or self.rows.dual_value is None:
            return _no_answer(program, SolverStatus.FAILED if status is SolverStatus.OPTIMAL else status)
        k, count, rows = self.size.equalities, len(program.gradient), len(program.bound)
        multipliers = np.zeros(count + rows)
        multipliers[:count] = (self.below.dual_value - self.above.dual_value)[:count]
        multipliers[count + k :] = self.rows.dual_value[: rows - k]
        if self.equal is not None:
            multipliers[count : count + k] = self.equal.dual_value
        return Solution(status, self.y.value[:count].copy(), multipliers)


def _no_answer(program: QuadraticProgram, status: SolverStatus) -> Solution:
    count = len(program.gradient)
    return Solution(status, np.zeros(count), np.zeros(count + len(program.bound)))


def _padded(values: Array, length: int, padding: float) -> Array:
    whole = np.full(length, padding)
    whole[: len(values)] = values
    return whole
