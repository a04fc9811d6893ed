"""Quadratic programs of which most rows may be violated, each at the price of one of the last variables: its slack."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scp_planner.arrays import Array, Index
from scp_planner.solvers.interface import LONGEST_SOLVE, QuadraticProgram, StepOrigin


@dataclass(frozen=True)
class SlackedProgram:
    """A :class:`QuadraticProgram` with a matrix in parts: [[hard, 0], [soft, -1 in the column of its slack]]."""

    hessian: Array  # (n, n): positive definite
    gradient: Array  # (n,)
    lower: Array  # (n,)
    upper: Array  # (n,)
    hard: Array  # (h, s): rows of the first s variables
    soft: Array  # (k, s): the same of rows that have a slack
    slack: Index  # (k,): which variable it is of each, from s on
    bound: Array  # (h + k,)
    equalities: int  # number of leading rows that hold with equality
    active: NDArray[np.int8] | None = None  # (n + h + k,)
    origin: StepOrigin | None = None
    time_limit: float = LONGEST_SOLVE  # as in a :class:`QuadraticProgram`

    def of_rows(self, x: Array) -> Array:
        """Return what the rows are at a point, (h + k,)."""
        step = x[: self.soft.shape[1]]
        return np.concatenate([self.hard @ step, self.soft @ step - x[self.slack]])

    def reach_of_rows(self, half: Array) -> Array:
        """Return by how much each row may grow within so much of each variable, (h + k,)."""
        step = half[: self.soft.shape[1]]
        return np.concatenate([np.abs(self.hard) @ step, np.abs(self.soft) @ step + half[self.slack]])

    def whole(self) -> QuadraticProgram:
        """Return it with all rows."""
        return self._of(self._matrix(self.hard, self.soft, self.slack), self.bound, self.active, self.time_limit)

    def only(self, chosen: Index, active: NDArray[np.int8] | None, time_limit: float) -> QuadraticProgram:
        """Return it with some of its rows, increasing, another guess of what is active of all, and another limit."""
        size, hard = len(self.gradient), int(np.searchsorted(chosen, len(self.hard)))
        soft = chosen[hard:] - len(self.hard)
        guess = None if active is None else np.concatenate([active[:size], active[size + chosen]])
        matrix = self._matrix(self.hard[chosen[:hard]], self.soft[soft], self.slack[soft])
        return self._of(matrix, self.bound[chosen], guess, time_limit)

    def _matrix(self, hard: Array, soft: Array, slack: Index) -> Array:
        matrix = np.zeros((len(hard) + len(soft), len(self.gradient)))
        matrix[: len(hard), : hard.shape[1]] = hard
        matrix[len(hard) :, : soft.shape[1]] = soft
        matrix[np.arange(len(hard), len(matrix)), slack] = -1.0
        return matrix

    def _of(self, matrix: Array, bound: Array, active: NDArray[np.int8] | None, time_limit: float) -> QuadraticProgram:
        return QuadraticProgram(
            self.hessian,
            self.gradient,
            self.lower,
            self.upper,
            matrix,
            bound,
            self.equalities,
            active,
            self.origin,
            time_limit,
        )
