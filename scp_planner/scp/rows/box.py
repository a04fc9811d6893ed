"""The workspace box: the vehicle's disc stays inside, at the fixed stations of the path.

At a fixed station the position g(s) + f(s) n(s) is linear in the offset, so these rows are exact.
"""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array
from scp_planner.problem.problem import Problem
from scp_planner.scp.rows.base import Rows


def box_rows(problem: Problem, gaps: Array, group: int, near: float) -> Rows:
    """Return the rows of staying inside where the gaps to the sides, (M, S) m, are below ``near``."""
    station, side = np.nonzero(gaps < near)
    tables, frame = problem.space.tables, problem.space.station_frame
    normal = np.array([[0.0, 1.0]]) if frame is None else frame.normal[station]
    outward = np.einsum("ij,ij->i", np.broadcast_to(normal, (len(station), 2)), problem.box.normals[side])
    theta = (outward[:, None] * tables.station_rows[station])[:, problem.ends.free]
    zeros = np.zeros((len(station), problem.space.acceleration_size + 1))
    return Rows(
        np.concatenate([theta, zeros], axis=1),
        gaps[station, side],
        np.full(len(station), group, dtype=np.intp),
        station * gaps.shape[1] + side,
    )
