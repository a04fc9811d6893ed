"""Settings of the planner: all knobs in one frozen place, with defaults that need no tuning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from scp_planner.settings.knobs import Choice, Knobs, Range


def solver_names() -> tuple[str, ...]:
    """Give the names of the solvers, those of users included."""
    from scp_planner.solvers.interface import SOLVERS

    return tuple(SOLVERS)


@dataclass(frozen=True)
class Settings(Knobs):
    """Settings of :func:`scp_planner.plan`.

    Every value has a range; see the reference of the settings, or ``scp-planner settings``.

    Attributes
    ----------
    solver : str
        Solver of the subproblem. All give the same plan; ``daqp`` is the fastest, ``cvxpy`` the one to read and extend.
    path_degree : int
        Degree of the offset's B-spline. Higher: smoother curvature, and wider turns between obstacles.
    path_span : float
        Wanted length of a span of the offset's B-spline. Smaller: tighter bends fit, and every step takes longer. They
        get longer where there would be more than ``max_path_spans``.
    max_path_spans : int
        Spans over a straight guide, at most. More: narrower gaps fit on long trips, and every step takes longer.
    acceleration_degree : int
        Degree of the acceleration's B-spline. 0, piecewise constant, is the fastest trip; from 1 on the acceleration
        has no jumps.
    acceleration_spans : int
        Number of equal spans of the acceleration in normalised time; switching times of the trip without
        obstacles are added as breakpoints. More: finer changes of speed, and every step takes longer.
    samples : int
        Times at which constraints are sampled; minima between them are refined. More: fewer repeats for what the
        certificate finds between samples, and every step takes longer.
    clearance_margin : float
        Planned clearance beyond every zone, which absorbs what is linearised. Larger: plans are certified at once
        more often, and pass obstacles at a larger distance.
    limit_margin : float
        Relative distance kept from every limit of the vehicle. Larger: slower trips, and plans that are certified at
        once more often.
    box_margin : float
        Planned distance to the sides of the workspace box.
    max_offset : float
        Largest offset of the path from the guide. Larger: wider detours are looked at.
    searches : int
        Sweeps of the search for ways round, at most. More: better odds of the best way among many obstacles.
    max_runs : int
        Ways that the loop is started from, at most. More: slower, and better odds of the best way.
    max_iterations : int
        Iterations of one run of the loop, at most.
    tolerance : float
        A run has converged when a step promises less than this. Smaller: more iterations for the last bit.
    """

    solver: Annotated[str, Choice(solver_names)] = "daqp"
    path_degree: Annotated[int, Range(3, 5)] = 3
    path_span: Annotated[float, Range(0.1, 1000.0, "m")] = 1.5
    max_path_spans: Annotated[int, Range(4, 5000)] = 100
    acceleration_degree: Annotated[int, Range(0, 2)] = 0
    acceleration_spans: Annotated[int, Range(1, 200)] = 20
    samples: Annotated[int, Range(10, 5000)] = 160
    clearance_margin: Annotated[float, Range(0.0, 10.0, "m")] = 1e-3
    limit_margin: Annotated[float, Range(0.0, 0.5)] = 1e-4
    box_margin: Annotated[float, Range(0.0, 10.0, "m")] = 5e-3
    max_offset: Annotated[float, Range(0.01, 1000.0, "m")] = 8.0
    searches: Annotated[int, Range(1, 1000)] = 24
    max_runs: Annotated[int, Range(1, 1000)] = 8
    max_iterations: Annotated[int, Range(1, 1000)] = 60
    tolerance: Annotated[float, Range(1e-8, 1.0, "s")] = 3e-4
