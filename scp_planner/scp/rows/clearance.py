"""Clearance from threat zones, linearised.

With c = nu . (r(u) - eta(t)) - h(nu, t), t = tau sigma, and nu_t = nu . r' / |r'|,

    dc = (nu . n) B(u) dtheta + nu_t (dD - dS/dtheta dtheta) + sigma (dc/dt at a fixed point) dtau,
    dD = v0 sigma dtau + C2(sigma) db.

The envelope theorem makes this exact to first order for minima over time and normals. dc/dt contains the growth
of the zone.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.problem.problem import Problem
from scp_planner.scp.rows.base import Rows, join_blocks
from scp_planner.threat_zones.contacts import ZoneContacts
from scp_planner.trips.trajectory import Trajectory, TripPoints

MOST_SAMPLES = 100_000


@dataclass(frozen=True)
class ClearanceSites:
    """What clearance rows need to know of m places in time and zones.

    Attributes
    ----------
    zone, sample : (m,) arrays of int
        Which zone each row is about; number of the sample, or 0 for a minimum between samples, for the row's key.
    span, local, parameter : (m,) arrays
        Where the vehicle is on the path.
    sigma : (m,) array
        When.
    distance_rows : (m, K2) array
        C2 there.
    sideways, along : (m,) arrays
        nu . n and nu . r' / |r'|.
    rate : (m,) array
        dc/dt at a fixed point, m/s.
    clearance : (m,) array
        m.
    """

    zone: Index
    sample: Index
    span: Index
    local: Array
    parameter: Array
    sigma: Array
    distance_rows: Array
    sideways: Array
    along: Array
    rate: Array
    clearance: Array

    @classmethod
    def of(cls, zone: Index, sample: Index, points: TripPoints, contacts: ZoneContacts) -> ClearanceSites:
        """Return the sites of contacts with zones, (m,), at points of a trip."""
        path, normal = points.path, contacts.normal
        x, y = normal[:, 0], normal[:, 1]
        along = (x * path.direction[:, 0] + y * path.direction[:, 1]) / path.speed
        sideways = x * path.normal[:, 0] + y * path.normal[:, 1]
        return cls(
            zone,
            sample,
            path.span,
            path.local,
            points.parameter,
            points.table.sigma,
            points.table.distance,
            sideways,
            along,
            contacts.rate,
            contacts.distance,
        )

    def joined(self, other: ClearanceSites) -> ClearanceSites:
        """Return both sets of sites."""
        return ClearanceSites(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in _SITE_FIELDS))


_SITE_FIELDS = tuple(field.name for field in fields(ClearanceSites))


def clearance_rows(problem: Problem, trip: Trajectory, sites: ClearanceSites) -> Rows:
    """Return the rows -dc z <= c at places near zones."""
    free, v0, along, tau = problem.ends.free, problem.space.start_speed, sites.along, trip.travel_time
    theta = trip.path.arc_length_gradient(sites.parameter)
    theta *= along[:, None]
    theta -= sites.sideways[:, None] * problem.space.path.rows_at(sites.span, sites.local)
    matrix = join_blocks(
        theta[:, free],
        (-tau * tau * along)[:, None] * sites.distance_rows,
        -tau * sites.sigma * (along * v0 + sites.rate),
    )
    whole = problem.zones.whole
    group = sites.zone if whole is None else whole[sites.zone]
    return Rows(matrix, sites.clearance, group, sites.zone * MOST_SAMPLES + sites.sample)
