"""Which obstacles can matter: bounds on how near a zone comes, cheap enough for thousands of them.

On an interval of time with middle m and half width h the centre of a zone stays within sum_k |c^(k)(m)| h^k / k! of
c(m), since its motion is a polynomial there. So far zones are told from near ones by a few looks at each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scp_planner.problem import Problem
from scp_planner.zone_batch import ZoneBatch

Array = NDArray[np.float64]
Index = NDArray[np.intp]

FEW_ZONES = 8  # up to this many zones are all looked at
LOOKS = (4, 32)  # intervals of time: few first, more only for the zones that are not far then
GUIDE_LOOKS = 33
BEYOND = 1.0  # m, beyond the largest offset
LONGEST_TRIP = 4.0  # times the lower bound; obstacles that only a longer trip could meet are left out at first


@dataclass(frozen=True)
class Looks:
    """Intervals of time, and where the vehicle is on them.

    Attributes
    ----------
    middle : (K,) array
        Middles on the planning clock, s.
    half : float
        Half width, s.
    lower, upper : (K, 2) arrays
        Corners of boxes that contain the vehicle's reference point, m.
    """

    middle: Array
    half: float
    lower: Array
    upper: Array


def least_clearances(batch: ZoneBatch, looks: Looks) -> Array:
    """Lower bounds of the clearance of each zone over all looks, (L,) m.

    Rigorous for zones whose motion is known and one polynomial; -inf for the others, of which nothing is known so
    cheaply.
    """
    distance = _distance_to_boxes(batch.centers.grid(looks.middle), looks)
    polynomials, factor = batch.velocities, looks.half
    for order in range(2, batch.centers.coefficients.shape[2] + 1):
        moved = polynomials.grid(looks.middle)
        distance -= factor * np.sqrt(np.einsum("kld,kld->kl", moved, moved))
        polynomials, factor = polynomials.derivative, factor * looks.half / order
    bounds: Array = distance.min(axis=0) - batch.radius - batch.extent
    unknown = batch.slot >= 0
    if batch.centers.coefficients.shape[1] > 1:
        unknown |= np.isfinite(batch.centers.breakpoints[:, 1])
    bounds[unknown] = -np.inf
    return bounds


def without_far_zones(problem: Problem, longest: float) -> Problem:
    """Return a problem without the zones that no trip shorter than ``longest``, s, can meet.

    The trip is taken to stay within the largest offset of the guide.
    """
    if problem.zones.size <= FEW_ZONES:
        return problem
    guide = problem.space.guide
    line = guide.frame(np.linspace(0.0, guide.length, GUIDE_LOOKS)).position
    reach = problem.settings.max_offset + BEYOND + max(map(abs, problem.scenario.vehicle.discs))
    near: Index = np.arange(problem.zones.size)
    for count in LOOKS:
        half = 0.5 * longest / count
        looks = Looks(
            np.linspace(half, longest - half, count),
            half,
            np.broadcast_to(line.min(axis=0) - reach, (count, 2)),
            np.broadcast_to(line.max(axis=0) + reach, (count, 2)),
        )
        some = problem.zones if len(near) == problem.zones.size else problem.zones.subset(near)
        near = near[least_clearances(some, looks) < 0.0]
    return problem if len(near) == problem.zones.size else problem.among(problem.zones.subset(near))


def _distance_to_boxes(points: Array, looks: Looks) -> Array:
    """Distances of (K, L, 2) points to the K boxes."""
    x = np.maximum(looks.lower[:, None, 0] - points[:, :, 0], points[:, :, 0] - looks.upper[:, None, 0])
    y = np.maximum(looks.lower[:, None, 1] - points[:, :, 1], points[:, :, 1] - looks.upper[:, None, 1])
    np.maximum(x, 0.0, out=x)
    np.maximum(y, 0.0, out=y)
    # not np.hypot, which takes four times as long
    return np.sqrt(x * x + y * y)
