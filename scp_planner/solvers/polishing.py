"""From an approximate answer to an exact one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from time import perf_counter

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, lu_factor, lu_solve
from scipy.sparse import csr_array

from scp_planner.arrays import Array, Index
from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus


@dataclass(frozen=True)
class Polishing:
    """Work and tolerances of polishing."""

    max_pivots: int = 400
    passes: int = 4  # of pivots and an exact solution; the second one mends what rounding hid from the first
    tolerance: float = 1e-10  # of bounds, relative to their sizes
    pull_tolerance: float = 1e-13  # of multipliers, to the largest: a weak Hessian turns small ones into long ways
    regularisation: float = 1e-10  # lets active rows depend on each other
    refinements: int = 4
    # Sides that an answer may touch which has fewer variables: a system as large as all of them together is solved
    most_touched: int = 1000


POLISHING = Polishing()


def polish(program: QuadraticProgram, guess: Solution, deadline: float = np.inf) -> Solution | None:
    """Solve a program from an approximate answer.

    Parameters
    ----------
    program : QuadraticProgram
        Its matrix may be a sparse one.
        Well scaled: a constraint is first taken as active where its multiplier is larger than what is left of it.
    guess : Solution
        Optimal or not; one that is not, and touches more sides than there are variables, is too far off; one that
        touches over `MOST_TOUCHED`, most of them over again, takes more memory and time than it is worth.
    deadline : float
        Of the clock of :func:`time.perf_counter`, s, at which it is given up.

    Returns
    -------
    Solution or None
        Optimal within rounding: feasible, stationary and complementary. None if the guess led nowhere, or rounding
        has made the Hessian indefinite.
    """
    sides = _Sides(program)
    active = sides.touched(guess)
    most = len(program.gradient)
    if guess.status is SolverStatus.OPTIMAL:
        most = max(most, POLISHING.most_touched)
    astray = len(active) > most
    if astray or perf_counter() > deadline:
        return None
    try:
        pivots = _Pivots(sides, deadline)
    except LinAlgError:
        return None
    # Where the guess tells all active sides, pivots would only lose them: they go by way of the minimiser without
    # constraints, which a weak Hessian has far away, and rounding with it.
    x, prices = sides.solve(active)
    if sides.optimal(active, x, prices):
        return sides.solution(active, x, prices)
    for _ in range(POLISHING.passes):
        mended = pivots.mended(active)
        if mended is None:
            return None
        active = mended
        x, prices = sides.solve(active)
        if sides.optimal(active, x, prices):
            return sides.solution(active, x, prices)
    return None


def violation(program: QuadraticProgram, x: Array) -> float:
    """Largest excess of x over the bounds and rows of a program, in their units."""
    sides = _Sides(program)
    over = sides.along(x) - sides.bounds
    return float(np.maximum(over, np.where(sides.equal, -over, 0.0)).max(initial=0.0))


class _Sides:
    """Bounds and rows of a program alike: normals x <= bounds, some of them with equality."""

    def __init__(self, program: QuadraticProgram) -> None:
        size, rows, equalities = len(program.gradient), len(program.bound), program.equalities
        fixed = program.lower == program.upper
        uppers = np.flatnonzero(np.isfinite(program.upper))
        lowers = np.flatnonzero(np.isfinite(program.lower) & ~fixed)
        kept = np.flatnonzero(np.isfinite(program.bound) | (np.arange(rows) < equalities))
        self.program = program
        self._uppers, self._lowers, self._kept = uppers, lowers, kept
        self.bounds = np.concatenate([program.upper[uppers], -program.lower[lowers], program.bound[kept]])
        self.equal = np.concatenate([fixed[uppers], np.zeros(len(lowers), dtype=bool), kept < equalities])
        self.source = np.concatenate([uppers, lowers, size + kept])
        self.sign = np.ones(len(self.bounds))
        self.sign[len(uppers) : len(uppers) + len(lowers)] = -1.0
        self._rows: csr_array = csr_array(program.matrix)  # of a sparse one no copy is made
        lengths = np.sqrt(self._rows.multiply(self._rows).sum(axis=1))[kept]
        self.lengths = np.concatenate([np.ones(len(uppers) + len(lowers)), np.maximum(lengths, 1e-12)])

    def along(self, x: Array) -> Array:
        """The product of each normal with a vector."""
        return np.concatenate([x[self._uppers], -x[self._lowers], (self._rows @ x)[self._kept]])

    def normals(self, chosen: Index) -> Array:
        """Normals of some sides, (sides, size)."""
        normals = np.zeros((len(chosen), len(self.program.gradient)))
        box = len(self._uppers) + len(self._lowers)
        bound, row = np.flatnonzero(chosen < box), np.flatnonzero(chosen >= box)
        normals[bound, self.source[chosen[bound]]] = self.sign[chosen[bound]]
        normals[row] = self._rows[self._kept[chosen[row] - box]].toarray()
        return normals

    def touched(self, guess: Solution) -> Index:
        """Sides whose multiplier is larger than what is left of them."""
        left = self.bounds - self.along(guess.x)
        return np.flatnonzero(self.equal | (self.sign * guess.multipliers[self.source] > left))

    def excess(self, x: Array) -> Array:
        """Distance beyond each side where it is more than rounding, else 0."""
        over = self.along(x) - self.bounds
        over = np.where(self.equal, np.abs(over), over)
        return np.where(over > POLISHING.tolerance * (1.0 + np.abs(self.bounds)), over / self.lengths, 0.0)

    def pull(self, active: Index, prices: Array) -> Array:
        """Amount by which each active side pulls instead of pushing, beyond rounding; else 0."""
        wrong = np.where(self.equal[active], 0.0, -prices * self.lengths[active])
        return np.where(wrong > POLISHING.pull_tolerance * (1.0 + np.abs(prices).max(initial=0.0)), wrong, 0.0)

    def solve(self, active: Index) -> tuple[Array, Array]:
        """Minimiser on the active sides, and their multipliers."""
        normals, hessian = self.normals(active), self.program.hessian
        size, count = len(self.program.gradient), len(active)
        system = np.zeros((size + count, size + count), order="F")  # as LAPACK wants it: factorised where it stands
        system[:size, :size] = hessian
        system[:size, size:] = normals.T
        system[size:, :size] = normals
        system[np.arange(size, size + count), np.arange(size, size + count)] = -POLISHING.regularisation
        right = np.concatenate([-self.program.gradient, self.bounds[active]])
        factors = lu_factor(system, overwrite_a=True, check_finite=False)
        solved = lu_solve(factors, right, check_finite=False)
        for _ in range(POLISHING.refinements):
            x, prices = solved[:size], solved[size:]
            left = right - np.concatenate([hessian @ x + prices @ normals, normals @ x])
            solved += lu_solve(factors, left, check_finite=False)
        return solved[:size], solved[size:]

    def optimal(self, active: Index, x: Array, prices: Array) -> bool:
        """True if a minimiser on active sides is the minimiser of the program."""
        return not (self.excess(x).any() or self.pull(active, prices).any())

    def solution(self, active: Index, x: Array, prices: Array) -> Solution:
        """The minimiser as an answer to the program."""
        multipliers = np.zeros(len(x) + len(self.program.bound))
        prices = np.where(self.equal[active], prices, np.maximum(prices, 0.0))
        np.add.at(multipliers, self.source[active], self.sign[active] * prices)
        return Solution(SolverStatus.OPTIMAL, x, multipliers)


class _Pivots:
    """A dual active-set method from any active set (Goldfarb and Idnani, Mathematical Programming 27, 1983)."""

    def __init__(self, sides: _Sides, deadline: float) -> None:
        self.sides = sides
        self.deadline = deadline
        self._factor = cho_factor(sides.program.hessian, check_finite=False)
        self._ways = np.zeros((len(sides.program.gradient), 0))
        self._place = np.full(len(sides.bounds), -1)  # of each side in these

    @cached_property
    def free(self) -> Array:
        """The minimiser without constraints."""
        free: Array = -cho_solve(self._factor, self.sides.program.gradient, check_finite=False)
        return free

    def ways(self, chosen: Index) -> Array:
        """H^-1 normals', (size, sides), of some sides; computed for those that are asked for, once."""
        new = chosen[self._place[chosen] < 0]
        if len(new):
            found = cho_solve(self._factor, self.sides.normals(new).T, check_finite=False)
            self._place[new] = self._ways.shape[1] + np.arange(len(new))
            self._ways = np.concatenate([self._ways, found], axis=1)
        return self._ways[:, self._place[chosen]]

    def mended(self, active: Index) -> Index | None:
        """Return the active set of the minimiser; None if there is none, or it is too far."""
        active, prices = self._pushing(active)
        x = self.free - self.ways(active) @ prices
        pivots = 0
        while pivots < POLISHING.max_pivots and perf_counter() < self.deadline:
            excess = self.sides.excess(x)
            excess[active] = 0.0
            entering = int(np.argmax(excess))
            if excess[entering] == 0.0:
                return active
            price = 0.0
            while True:
                pivots += 1
                step, leaving, against, direction = self._ratios(active, prices, entering, x)
                if not np.isfinite(step) or pivots > POLISHING.max_pivots or perf_counter() > self.deadline:
                    return None
                x = x - step * direction
                prices = prices - step * against
                price += step
                if leaving is None:
                    active, prices = np.append(active, entering), np.append(prices, price)
                    break
                active, prices = np.delete(active, leaving), np.delete(prices, leaving)
        return None

    def _pushing(self, active: Index) -> tuple[Index, Array]:
        """Drop active sides, the worst first, until all push."""
        while True:
            prices = self._on_active(active, self.sides.along(self.free)[active] - self.sides.bounds[active])
            pull = self.sides.pull(active, prices)
            if not pull.any() or perf_counter() > self.deadline:
                return active, prices
            active = np.delete(active, np.argmax(pull))

    def _on_active(self, active: Index, right: Array) -> Array:
        """Prices of active sides, (normals H^-1 normals') p = right."""
        if not len(active):
            return np.zeros(0)
        system: Array = self.sides.normals(active) @ self.ways(active)
        system.flat[:: len(active) + 1] += 1e-14 * float(np.trace(system))
        solved: Array = np.asarray(np.linalg.solve(system, right), dtype=float)
        return solved

    def _ratios(self, active: Index, prices: Array, entering: int, x: Array) -> tuple[float, int | None, Array, Array]:
        """Largest price of an entering side, the side that leaves then; rates of prices and of x."""
        normal, way = self.sides.normals(np.array([entering]))[0], self.ways(np.array([entering]))[:, 0]
        against = self._on_active(active, self.sides.along(way)[active])
        direction: Array = way - self.ways(active) @ against
        blocking = np.flatnonzero((against > 1e-12) & ~self.sides.equal[active])
        ratios = np.maximum(prices[blocking] / against[blocking], 0.0)
        partial = float(ratios.min(initial=np.inf))
        curvature = float(normal @ direction)
        if curvature > 1e-12 * float(normal @ way):
            full = float(normal @ x - self.sides.bounds[entering]) / curvature
            if full <= partial:
                return full, None, against, direction
        else:
            direction = np.zeros_like(x)  # depends on the active sides: no step, only an exchange
        return partial, int(blocking[np.argmin(ratios)]) if len(blocking) else None, against, direction
