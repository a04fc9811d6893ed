"""The workspace box: the vehicle's disc stays inside, at the fixed stations of the path.

At a fixed station the position g(s) + f(s) n(s) is linear in the offset, so these rows are exact.
"""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.problem.problem import Problem
from scp_planner.scp.rows.base import Rows

_NONE: Index = np.zeros(0, dtype=np.intp)


def box_rows(problem: Problem, gaps: Array, group: int, near: float) -> Rows:
    """Return the rows of staying inside, where the sides are near.

    Parameters
    ----------
    problem : Problem
    gaps : (K, M, S) array
        See :func:`box_gaps`; of K trips.
    group : int
        Index of the violation in the merit.
    near : float
        Gaps above this are no rows, m.

    Returns
    -------
    Rows
    """
    owner, station, side = np.nonzero(gaps < near) if gaps.size else (_NONE, _NONE, _NONE)
    if len(owner) == 0:
        return Rows.none(problem.step_size)
    tables, frame = problem.space.tables, problem.space.station_frame
    normal = np.array([[0.0, 1.0]]) if frame is None else frame.normal[station]
    outward = np.einsum("ij,ij->i", np.broadcast_to(normal, (len(owner), 2)), problem.box.normals[side])
    theta = (outward[:, None] * tables.station_rows[station])[:, problem.ends.free]
    zeros = np.zeros((len(owner), problem.space.acceleration_size + 1))
    return Rows(
        np.concatenate([theta, zeros], axis=1),
        gaps[owner, station, side],
        np.full(len(owner), group, dtype=np.intp),
        station * gaps.shape[2] + side,
        owner,
    )
