"""Programs of very many rows, of which few matter: solved with those that may, until no other is violated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus
from scp_planner.solvers.preparation import given_up, whole_preparation
from scp_planner.solvers.slacked import SlackedProgram
from scp_planner.solvers.tolerances import ROW_TOLERANCE


@dataclass(frozen=True)
class WorkingRows:
    """Number of rows that are looked at."""

    many: int = 3  # rows to a variable, from which on they are not all looked at
    # products of a program's rows, from which on choosing among them takes less than what it saves
    worth: int = 4_000_000
    # to a variable: rows that are looked at first, and of the violated ones that are added at once
    first: int = 2
    more: int = 1
    rounds: int = 10  # after which all rows are taken


WORKING = WorkingRows()


def solved_with_few_rows(program: SlackedProgram, solve: Callable[[QuadraticProgram], Solution]) -> Solution:
    """Solve a program, with few of its rows where there are very many."""
    rows, size = len(program.bound), len(program.gradient)
    boxed = np.isfinite(program.lower).all() and np.isfinite(program.upper).all()
    if rows <= WORKING.many * size or rows * size**2 < WORKING.worth or not boxed:
        return solve(program.whole())
    until, active = perf_counter() + program.time_limit, program.active
    kept = _first_rows(program)
    for _ in range(WORKING.rounds):
        left = until - perf_counter()
        if left <= 0.0:
            return given_up(program)
        chosen = np.flatnonzero(kept)
        found = solve(program.only(chosen, active, left))
        if found.status is SolverStatus.INFEASIBLE:
            return replace(given_up(program), status=found.status)
        if found.status is not SolverStatus.OPTIMAL:
            break
        solution = _of_all_rows(program, chosen, found)
        over = program.of_rows(found.x) - program.bound
        over[kept] = 0.0
        violated = int((over > ROW_TOLERANCE).sum())
        if not violated:
            return solution
        kept[_largest(over, min(violated, WORKING.more * size))] = True
        active = np.sign(solution.multipliers).astype(np.int8)
    left = until - perf_counter()
    # Not at 0 either: some solvers take that for no limit
    return given_up(program) if left <= whole_preparation(program) else solve(replace(program.whole(), time_limit=left))


def _first_rows(program: SlackedProgram) -> Mask:
    """Rows that hold with equality, that are taken as active at first, and that the least share of a step meets."""
    rows, size = len(program.bound), len(program.gradient)
    middle, half = 0.5 * (program.upper + program.lower), 0.5 * (program.upper - program.lower)
    most = program.of_rows(middle) + program.reach_of_rows(half)  # of each row within the bounds
    with np.errstate(over="ignore"):  # no step meets a row without entries
        share = np.where(program.bound > 0.0, program.bound / np.maximum(most, np.finfo(float).tiny), 0.0)
    kept = np.zeros(rows, dtype=bool)
    kept[_largest(-share, WORKING.first * size)] = True
    kept[: program.equalities] = True
    if program.active is not None:
        kept |= program.active[size:] != 0
    return kept


def _largest(values: Array, count: int) -> Index:
    return np.argpartition(values, len(values) - count)[len(values) - count :]


def _of_all_rows(program: SlackedProgram, chosen: Index, found: Solution) -> Solution:
    size = len(program.gradient)
    multipliers = np.zeros(size + len(program.bound))
    multipliers[:size], multipliers[size + chosen] = found.multipliers[:size], found.multipliers[size:]
    return replace(found, multipliers=multipliers)
