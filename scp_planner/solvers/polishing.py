"""From an approximate answer to an exact one: find the active constraints, solve for them, and check the result.

Interior-point and splitting methods stop where their residuals are small, which under a weak Hessian can be far from
the minimiser. Their answers tell the active constraints long before the last digits, and those then cost one linear
system. So all solvers give the same step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve

from scp_planner.solvers.interface import Array, QuadraticProgram, Solution, SolverStatus

TRIES = 8  # with each way of mending
TOLERANCE = 1e-10  # of bounds, relative to their sizes
PULL_TOLERANCE = 1e-13  # of multipliers, to the largest: a weak Hessian turns small ones into long ways
REGULARISATION = 1e-10  # lets active rows depend on each other
REFINEMENTS = 4


def polish(program: QuadraticProgram, guess: Solution) -> Solution | None:
    """Solve a program from a guess of its active constraints, mended a few times.

    Parameters
    ----------
    program : QuadraticProgram
        Well scaled: a constraint is first taken as active where its multiplier is larger than what is left of it.
    guess : Solution
        An approximate answer.

    Returns
    -------
    Solution or None
        Optimal within rounding: feasible, stationary and complementary. None if the guess led nowhere.
    """
    sides = _Sides(program)
    for mend in (_mend_all, _mend_worst):
        solution = _search(sides, sides.touched(guess), mend)
        if solution is not None:
            return solution
    return None


def violation(program: QuadraticProgram, x: Array) -> float:
    """Largest excess of x over the bounds and rows of a program, in their units."""
    sides = _Sides(program)
    value = sides.normals @ x
    return max(float((value - sides.upper).max()), float((sides.lower - value).max()), 0.0)


@dataclass
class _Active:
    """Which constraints are taken as active, at which side."""

    upper: NDArray[np.bool_]
    lower: NDArray[np.bool_]


class _Sides:
    """Bounds and rows of a program alike: lower <= normals x <= upper."""

    def __init__(self, program: QuadraticProgram) -> None:
        size = len(program.gradient)
        self.program = program
        self.normals = np.concatenate([np.eye(size), program.matrix])
        self.lengths = np.maximum(np.linalg.norm(self.normals, axis=1), 1e-12)
        self.upper = np.concatenate([program.upper, program.bound])
        self.lower = np.full(len(self.upper), -np.inf)
        self.lower[:size] = program.lower
        self.lower[size : size + program.equalities] = program.bound[: program.equalities]
        self.equal = self.lower == self.upper

    def touched(self, guess: Solution) -> _Active:
        """Constraints whose multiplier is larger than what is left of them."""
        value = self.normals @ guess.x
        upper = self.equal | (guess.multipliers > self.upper - value)
        return _Active(upper, ~upper & (-guess.multipliers > value - self.lower))

    def solve(self, active: _Active) -> Solution:
        """Minimiser with the active constraints as equalities, and their multipliers."""
        chosen = np.flatnonzero(active.upper | active.lower)
        normals = self.normals[chosen]
        size, count = len(self.program.gradient), len(chosen)
        system = np.zeros((size + count, size + count))
        system[:size, :size] = self.program.hessian
        system[:size, size:] = normals.T
        system[size:, :size] = normals
        right = np.concatenate([-self.program.gradient, np.where(active.upper, self.upper, self.lower)[chosen]])
        regular = system.copy()
        regular.flat[size * (size + count + 1) :: size + count + 1] = -REGULARISATION
        factors = lu_factor(regular, check_finite=False)
        solved = lu_solve(factors, right, check_finite=False)
        for _ in range(REFINEMENTS):
            solved += lu_solve(factors, right - system @ solved, check_finite=False)
        multipliers = np.zeros(len(self.upper))
        multipliers[chosen] = solved[size:]
        return Solution(SolverStatus.OPTIMAL, solved[:size], multipliers)


@dataclass(frozen=True)
class _Faults:
    """What is not optimal: multipliers of the wrong sign, and values beyond their bounds; 0 within rounding."""

    pull: Array
    above: Array
    below: Array

    @classmethod
    def of(cls, sides: _Sides, active: _Active, solution: Solution) -> _Faults:
        value, multipliers = sides.normals @ solution.x, solution.multipliers
        pull = np.where(active.upper, -multipliers, multipliers) * sides.lengths
        pull[sides.equal] = 0.0
        return cls(
            np.where(pull > PULL_TOLERANCE * (1.0 + np.abs(multipliers).max(initial=0.0)), pull, 0.0),
            _beyond((value - sides.upper) / sides.lengths, sides.upper),
            _beyond((sides.lower - value) / sides.lengths, sides.lower),
        )

    @property
    def none(self) -> bool:
        return not (self.pull.any() or self.above.any() or self.below.any())


def _beyond(excess: Array, bound: Array) -> Array:
    """Excess where it is more than rounding, else 0."""
    return np.where(excess > TOLERANCE * (1.0 + np.abs(np.where(np.isfinite(bound), bound, 0.0))), excess, 0.0)


def _search(sides: _Sides, active: _Active, mend: Callable[[_Active, _Faults], _Active | None]) -> Solution | None:
    for _ in range(TRIES):
        solution = sides.solve(active)
        faults = _Faults.of(sides, active, solution)
        if faults.none:
            multipliers = solution.multipliers
            np.maximum(multipliers, 0.0, out=multipliers, where=active.upper & ~sides.equal)
            np.minimum(multipliers, 0.0, out=multipliers, where=active.lower)
            return solution
        mended = mend(active, faults)
        if mended is None:
            return None
        active = mended
    return None


def _mend_all(active: _Active, faults: _Faults) -> _Active | None:
    """Change all faults at once (primal-dual active-set method): quick, but may go round in circles."""
    pull, above, below = faults.pull > 0.0, faults.above > 0.0, faults.below > 0.0
    if (above & active.upper).any() or (below & active.lower).any():
        return None  # active constraints that depend on each other
    return _Active((active.upper & ~pull & ~below) | above, (active.lower & ~pull & ~above) | below)


def _mend_worst(active: _Active, faults: _Faults) -> _Active | None:
    """Drop the constraint that pulls most; if none does, add the one that is violated most."""
    upper, lower = active.upper.copy(), active.lower.copy()
    worst = int(np.argmax(faults.pull))
    if faults.pull[worst] > 0.0:
        upper[worst] = lower[worst] = False
        return _Active(upper, lower)
    side, beyond = max(((upper, faults.above), (lower, faults.below)), key=lambda pair: float(pair[1].max()))
    worst = int(np.argmax(beyond))
    if side[worst]:
        return None
    side[worst] = True
    return _Active(upper, lower)
