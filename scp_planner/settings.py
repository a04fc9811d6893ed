"""Settings of the planner: all knobs in one frozen place, with defaults that need no tuning."""

from __future__ import annotations

from dataclasses import dataclass, fields
from difflib import get_close_matches
from typing import Any


@dataclass(frozen=True)
class Settings:
    """Settings of :func:`scp_planner.plan`.

    Attributes
    ----------
    solver : str
        Solver of the subproblem: ``daqp``, ``clarabel``, ``osqp`` or ``cvxpy``.
    path_degree : int
        Degree of the offset's B-spline, 3 to 5.
    path_span : float
        Wanted length of a span of the offset's B-spline, m.
    acceleration_degree : int
        Degree of the acceleration's B-spline, 0 (piecewise constant) to 2.
    acceleration_spans : int
        Number of equal spans of the acceleration in normalised time; switching times of the trip without
        obstacles are added as breakpoints.
    samples : int
        Times at which constraints are sampled; minima between them are refined.
    clearance_margin : float
        Planned clearance beyond every zone, m, that absorbs what is linearised.
    limit_margin : float
        Relative distance kept from every limit of the vehicle.
    box_margin : float
        Planned distance to the sides of the workspace box, m.
    max_offset : float
        Largest offset from the guide, m.
    searches : int
        Sweeps of the search for ways round, at most.
    max_runs : int
        Ways that the loop is started from, at most.
    max_iterations : int
        Iterations of one SCP run.
    tolerance : float
        A run has converged when a step promises less than this, s.
    """

    solver: str = "daqp"
    path_degree: int = 3
    path_span: float = 1.5
    acceleration_degree: int = 0
    acceleration_spans: int = 20
    samples: int = 160
    clearance_margin: float = 1e-3
    limit_margin: float = 1e-4
    box_margin: float = 5e-3
    max_offset: float = 8.0
    searches: int = 24
    max_runs: int = 8
    max_iterations: int = 60
    tolerance: float = 3e-4

    @classmethod
    def from_names(cls, **values: Any) -> Settings:
        """Build settings from names, refusing unknown ones with the nearest name.

        Raises
        ------
        ValueError
            Naming the unknown setting.
        """
        known = [field.name for field in fields(cls)]
        for name in values:
            if name not in known:
                near = get_close_matches(name, known, n=1)
                hint = f"; did you mean {near[0]!r}?" if near else ""
                raise ValueError(f"settings: unknown setting {name!r}{hint}")
        return cls(**values)
