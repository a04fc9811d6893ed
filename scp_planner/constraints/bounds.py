"""The workspace box: the vehicle's disc stays inside, at the fixed stations of the path.

At a fixed station the position g(s) + f(s) n(s) is linear in the offset, so these rows are exact.
"""

from __future__ import annotations

import numpy as np

from scp_planner.constraints import Rows
from scp_planner.problem import Problem
from scp_planner.trajectory import Array, Index, Path


def box_gaps(problem: Problem, path: Path) -> Array:
    """Distances of the vehicle's disc to the sides of the box, inside, at the fixed stations.

    Parameters
    ----------
    problem : Problem
    path : Path

    Returns
    -------
    (M, S) array
        m, negative outside; S is 0 without a box.
    """
    box = problem.box
    return box.offsets - path.station_positions @ box.normals.T


def box_rows(problem: Problem, gaps: Array, index: Index, group: int) -> Rows:
    """Return the rows of staying inside, at some stations.

    Parameters
    ----------
    problem : Problem
    gaps : (M, S) array
        See :func:`box_gaps`.
    index : (m,) array of int
        Into the flattened gaps.
    group : int
        Index of the violation in the merit.
    """
    if len(index) == 0:
        return Rows.none(problem.step_size)
    station, side = np.divmod(index, gaps.shape[1])
    tables, frame = problem.space.tables, problem.space.station_frame
    normal = np.array([[0.0, 1.0]]) if frame is None else frame.normal[station]
    outward = np.einsum("ij,ij->i", np.broadcast_to(normal, (len(index), 2)), problem.box.normals[side])
    theta = (outward[:, None] * tables.station_rows[station])[:, problem.ends.free]
    zeros = np.zeros((len(index), problem.space.acceleration_size + 1))
    return Rows(
        np.concatenate([theta, zeros], axis=1),
        gaps.ravel()[index],
        np.full(len(index), group, dtype=np.intp),
        index,
    )
