"""Lower bounds of the distance to a zone, cheap enough for thousands of obstacles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.threat_zones.batch import ZoneBatch


@dataclass(frozen=True)
class Nearness:
    """Zones that are looked at closely."""

    few_zones: int = 8  # up to this many zones are all looked at
    near: float = 1.0  # units of length; zones nearer than this to a trip are looked at closely
    # of that for what stands: walls farther ahead than this are met where a trip comes abreast of them
    abreast: float = 0.5
    looks: tuple[int, int] = (4, 32)  # intervals of time: few first, more only for the zones that are not far then


NEARNESS = Nearness()


@dataclass(frozen=True)
class SweptBoxes:
    """Intervals of time, and where the vehicle is on them."""

    middle: Array  # (K,) Middles on the planning clock, s
    half: float  # Half width, s
    lower: Array  # (K, 2) Corners of boxes that contain the vehicle's reference point, m
    upper: Array  # (K, 2) Corners of boxes that contain the vehicle's reference point, m


def nearness_of_samples(batch: ZoneBatch, near: float) -> Array:
    """Return how near to each zone samples of a trip are linearised besides its minima, (L,) m."""
    below = np.full(batch.size, near)
    if batch.ground is not None:
        below[batch.ground.zones] = NEARNESS.abreast * near
    return below


def least_clearances(batch: ZoneBatch, boxes: SweptBoxes) -> Array:
    """Lower bounds of the clearance of each zone over all boxes, (L,) m."""
    unknown = batch.slot >= 0
    if batch.centers.coefficients.shape[1] > 1:
        unknown |= np.isfinite(batch.centers.breakpoints[:, 1])
    if unknown.all():
        return np.full(batch.size, -np.inf)
    distance = _distance_to_boxes(batch.centers.grid(boxes.middle), boxes)
    polynomials, factor = batch.velocities, boxes.half
    for order in range(2, batch.centers.coefficients.shape[2] + 1):
        moved = polynomials.grid(boxes.middle)
        distance -= factor * np.sqrt(np.einsum("kld,kld->kl", moved, moved))
        polynomials, factor = polynomials.derivative, factor * boxes.half / order
    bounds: Array = distance.min(axis=0) - batch.radius - batch.extent
    bounds[unknown] = -np.inf
    return bounds


def _distance_to_boxes(points: Array, boxes: SweptBoxes) -> Array:
    """Distances of (K, L, 2) points to the K boxes."""
    x = np.maximum(boxes.lower[:, None, 0] - points[:, :, 0], points[:, :, 0] - boxes.upper[:, None, 0])
    y = np.maximum(boxes.lower[:, None, 1] - points[:, :, 1], points[:, :, 1] - boxes.upper[:, None, 1])
    np.maximum(x, 0.0, out=x)
    np.maximum(y, 0.0, out=y)
    # not np.hypot, which takes four times as long
    return np.sqrt(x * x + y * y)
