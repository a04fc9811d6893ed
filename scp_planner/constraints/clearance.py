"""Clearance from threat zones, linearised.

With c = nu . (r(u) - eta(t)) - h(nu, t), t = tau sigma, and nu_t = nu . r' / |r'|,

    dc = (nu . n) B(u) dtheta + nu_t (dD - dS/dtheta dtheta) + sigma (dc/dt at a fixed point) dtau,
    dD = v0 sigma dtau + C2(sigma) db.

The envelope theorem makes this exact to first order for minima over time and normals. dc/dt contains the growth
of the zone.
"""

from __future__ import annotations

import numpy as np

from scp_planner.constraints import Rows
from scp_planner.problem import Problem
from scp_planner.trajectory import Array, Index, Trajectory, TripPoints
from scp_planner.zones import ZoneContacts

MOST_SAMPLES = 100_000


def clearance_rows(
    problem: Problem,
    trajectory: Trajectory,
    zone: Index,
    sample: Index,
    points: TripPoints,
    contacts: ZoneContacts,
) -> Rows:
    """Return the rows -dc z <= c of contacts with zones.

    Parameters
    ----------
    problem : Problem
    trajectory : Trajectory
    zone : (m,) array of int
        Which zone each row is about.
    sample : (m,) array of int
        Number of the sample, or of the minimum, for the row's key.
    points : TripPoints
        The trip at the m times.
    contacts : ZoneContacts
        Signed distances there.
    """
    path, free = points.path, problem.ends.free
    tau, v0 = trajectory.travel_time, problem.space.start_speed
    normal = contacts.normal
    sideways = np.einsum("ij,ij->i", normal, np.broadcast_to(path.normal, normal.shape))
    along = np.einsum("ij,ij->i", normal, path.direction) / path.speed
    matrix = join_blocks(
        (along[:, None] * trajectory.path.arc_length_gradient(points.parameter))[:, free]
        - (sideways[:, None] * problem.space.path.rows_at(path.span, path.local))[:, free],
        (-tau * tau * along)[:, None] * points.table.distance,
        -tau * points.table.sigma * (along * v0 + contacts.rate),
    )
    return Rows(matrix, contacts.distance, zone, zone * MOST_SAMPLES + sample)


def join_blocks(theta: Array, beta: Array, rho: Array) -> Array:
    """Rows of the offset, of the acceleration and of rho side by side."""
    return np.concatenate([theta, beta, rho[:, None]], axis=1)
