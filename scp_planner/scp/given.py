"""Convex constraints that a user gives in CVXPY: what they are written in, and whether a trip keeps them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import cvxpy as cp
import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.certificate.verdict import Certificate, Violation
from scp_planner.problem.problem import Problem
from scp_planner.scenario.units import NaturalUnits
from scp_planner.solvers import QpSolver
from scp_planner.solvers.cvxpy_solver import CvxpySolver
from scp_planner.trips.trajectory import Trajectory

ALLOWED = 2e-4  # units of length; largest violation of a given constraint: that of every sampled constraint


class TripVariables:
    """A trip as CVXPY expressions, affine in what is optimised: what one's own constraints are written in.

    Stations are arc lengths of the guide in m, from 0 at the start to ``length`` at the goal. Without a ``guide`` in
    the scenario the guide is the straight line from start to goal, unless the headings at its ends do not allow that.
    Normalised times go from 0 at the start to 1 on arrival.

    Parameters
    ----------
    problem : Problem
    values : cvxpy.Variable
        The free control points of the offset, b = tau^2 beta, and the travel time tau, in the units of the scene.
    units : NaturalUnits, optional
        Of the scene.
    """

    def __init__(self, problem: Problem, values: Any, units: NaturalUnits | None = None) -> None:
        self._units = units = units or NaturalUnits()
        ends, space = problem.ends, problem.space
        free = np.eye(space.path_size)[:, ends.free]
        fixed = ends.theta.copy()
        fixed[ends.free] = 0.0
        count = free.shape[1]
        self._problem = problem
        self._drive = values[count:-1] * units.length
        self.offset_control_points = (free * units.length) @ values[:count] + fixed * units.length
        """Control points of the offset, (K1,) m: a bound on them holds at all stations, as the offset is their mean."""
        self.travel_time = values[-1] * units.time
        """s."""
        self.arrival_time = self.travel_time + units.absolute(problem.scenario.start.time)
        """Absolute, s."""

    @property
    def length(self) -> float:
        """Length of the guide, m."""
        return float(self._problem.space.length) * self._units.length

    @property
    def stations(self) -> Array:
        """Equidistant stations from start to goal, close enough for constraints of a whole path, (n,) m."""
        return self.length * self._problem.space.tables.station_parameters

    def offset(self, stations: ArrayLike) -> Any:
        """Offset from the guide at stations, (n,) m to an expression (n,) m, positive to the left."""
        return self._rows(stations) @ self.offset_control_points

    def position(self, stations: ArrayLike) -> Any:
        """Positions of the path at stations, (n,) m to an expression (n, 2) m, in world coordinates."""
        frame, units = self._problem.frame, self._units
        guide = self._problem.space.guide.frame(_at_least_1d(stations) / units.length)
        offset = self.offset(stations)
        normal = frame.vectors_to_world(guide.normal)
        points = frame.to_world(guide.position) * units.length + units.origin
        columns = [points[:, axis] + np.diag(normal[:, axis]) @ offset for axis in (0, 1)]
        return cp.vstack(columns).T  # type: ignore[attr-defined]

    def distance(self, times: ArrayLike) -> Any:
        """Distance driven along the path at normalised times, (n,) to an expression (n,) m."""
        table = self._problem.space.time_table(_at_least_1d(times))
        return self._start_speed * table.sigma * self.travel_time + table.distance @ self._drive

    def speed_times_travel_time(self, times: ArrayLike) -> Any:
        """Speed at normalised times, times the travel time: (n,) to an expression (n,) m.

        The speed itself is not affine. A bound c m/s on it reads ``speed_times_travel_time(t) <= c * travel_time``.
        """
        table = self._problem.space.time_table(_at_least_1d(times))
        return self._start_speed * self.travel_time + table.speed @ self._drive

    @property
    def _start_speed(self) -> float:
        return self._problem.space.start_speed * self._units.speed

    def _rows(self, stations: ArrayLike) -> Array:
        return self._problem.space.path.rows(_at_least_1d(stations) / self.length)


UserConstraints = Callable[[TripVariables], Sequence[Any]]
"""Gives convex CVXPY constraints on a trip."""


class GivenConstraints:
    """A user's constraints on the trips of one problem."""

    def __init__(self, problem: Problem, function: UserConstraints, units: NaturalUnits | None = None) -> None:
        self._units = units or NaturalUnits()
        self._problem = problem
        self._function = function
        self._values = cp.Variable(problem.step_size)
        self._constraints = self.on(self._values)
        for number, constraint in enumerate(self._constraints, 1):
            if not isinstance(constraint, cp.Constraint):
                raise TypeError(f"constraints: number {number} must be a constraint of cvxpy, not {constraint!r}")
            if not constraint.is_dcp():
                raise ValueError(f"constraints: number {number} is not convex by the rules of cvxpy: {constraint}")

    def on(self, values: Any) -> list[Any]:
        """Return the constraints on a CVXPY variable that holds what :class:`TripVariables` says."""
        return list(self._function(TripVariables(self._problem, values, self._units)))

    def violations(self, trajectory: Trajectory) -> Array:
        tau = trajectory.travel_time
        free = trajectory.theta[self._problem.ends.free]
        self._values.value = np.concatenate([free, tau**2 * trajectory.beta, [tau]])
        return np.array([float(np.max(each.violation())) for each in self._constraints]) / self._units.length

    def worst(self, trajectory: Trajectory) -> float:
        """Return the largest of the violations; 0 without constraints."""
        return float(self.violations(trajectory).max(initial=0.0))

    def judged(self, certificate: Certificate, trajectory: Trajectory) -> Certificate:
        """Return a certificate that holds only if the constraints are kept too."""
        found = tuple(
            Violation(f"excess over given constraint {number}", float(excess), ALLOWED, self._problem.frame.time)
            for number, excess in enumerate(self.violations(trajectory), 1)
            if not excess <= ALLOWED
        )
        if not found:
            return certificate
        return replace(certificate, holds=False, violations=(*certificate.violations, *found))


def _at_least_1d(values: ArrayLike) -> Array:
    return np.atleast_1d(np.asarray(values, dtype=float))


def problem_with(
    problem: Problem, function: UserConstraints, units: NaturalUnits, solver: QpSolver
) -> tuple[Problem, QpSolver]:
    """Return a problem with a user's own constraints, and the solver that keeps them."""
    if not isinstance(solver, CvxpySolver):
        raise ValueError(f"solver: {solver.name!r} cannot take constraints of one's own; cvxpy can")
    given = GivenConstraints(problem, function, units)
    return replace(problem, given=given), solver.keeping(given.on)
