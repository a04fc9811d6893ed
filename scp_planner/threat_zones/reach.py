"""Zones cut to what an obstacle can reach with its top speed and its largest acceleration."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.polynomials import PiecewisePolynomials, expanded
from scp_planner.threat_zones.zone import ThreatZone

if TYPE_CHECKING:
    from scp_planner.tracking.motion_estimate import MotionEstimate

NO_BOUNDS = (math.inf, math.inf)
"""Speed, m/s, and acceleration, m/s^2, without limits."""
VELOCITY_SHARE = 0.05  # of a zone's error probability, that is spent on the velocity where the motion has bounds
_LEADS = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 200)])  # shares of a horizon at which regions are compared


@dataclass(frozen=True)
class Reach:
    """Positions that an obstacle can be at, by a region of its position and its velocity at a time.

    The velocity is at most ``speed_error + max_acceleration * lead`` from the estimated one and at most ``max_speed``
    from zero. Whichever ball is the smaller one is integrated: after a lead the position is in the region that it
    began in, plus a ball of the radius that this gives, about a centre that moves on until the second ball is smaller.
    """

    start: float  # s
    position: Array  # (2,) m
    velocity: Array  # (2,) m/s
    region: Array  # (3,) xx, xy, yy of the scaled covariance of the position, m^2
    speed_error: float  # m/s
    max_speed: float  # m/s; inf: none
    max_acceleration: float  # m/s^2; inf: none

    @classmethod
    def of(
        cls, estimate: MotionEstimate, start: float, scale: float, probability: float, bounds: tuple[float, float]
    ) -> Reach:
        """Begin at a time, s, with the region of a scale and a velocity that is known with a probability."""
        velocity, covariance = estimate.rate(start)
        error = math.sqrt(estimate.errors.pointwise_scale(1.0 - probability) * np.linalg.eigvalsh(covariance)[-1])
        region = scale * estimate.covariance(start)[[0, 0, 1], [0, 1, 1]]
        return cls(start, estimate.position(start), velocity, region, error, *bounds)

    @property
    def straight(self) -> float:
        """Lead up to which the ball about the estimated velocity is the smaller one, s."""
        speed = math.inf if float(np.hypot(*self.velocity)) - self.speed_error > self.max_speed else self.max_speed
        # the top speed of what is seen to be faster is not known
        if math.isinf(self.max_acceleration):
            return 0.0 if math.isfinite(speed) else math.inf
        return max(speed - self.speed_error, 0.0) / self.max_acceleration

    def pieces(self, stop: float) -> tuple[Array, Array, Array]:
        """Begins (S,), s, and coefficients (S, 2, 2) and (S, 5, 3) of centres and scaled covariances up to a time."""
        turn = self.straight
        begins = np.array([0.0, *([turn] if 0.0 < turn < stop - self.start else [])])
        centers, radii = np.zeros((len(begins), 2, 2)), np.zeros((len(begins), 3))
        centers[0] = self.position, self.velocity
        radii[0, 1:] = self.speed_error, 0.5 * self.max_acceleration
        if turn < stop - self.start:
            centers[-1] = self.position + turn * self.velocity, np.zeros(2)
            grown = 0.0 if turn == 0.0 else turn * (self.speed_error + 0.5 * self.max_acceleration * turn)
            radii[-1] = grown, self.max_speed, 0.0
        # E(Q) + ball(R) is in E((1 + R / s) Q + (R^2 + s R) I), where s^2 is the largest eigenvalue of Q
        (xx, xy, yy), unit = self.region, np.array([1.0, 0.0, 1.0])
        size = math.sqrt(0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy))
        covariances = np.zeros((len(begins), 5, 3))
        covariances[:, 0] = self.region
        covariances[:, :3] += radii[:, :, None] * (self.region / size + size * unit)
        for row, radius in zip(covariances, radii, strict=True):
            row += np.convolve(radius, radius)[:, None] * unit
        return self.start + begins, centers, covariances


def within_reach(zone: ThreatZone, reach: Reach) -> ThreatZone:
    """Cut a zone: from when it stays larger than what can be reached, it is that.

    Each of the two holds the level: at all times both do if the position at ``reach.start`` and the velocity do.
    """
    assert zone.covariances is not None, "its motion is estimated"
    if math.isinf(reach.max_acceleration) and reach.straight > 0.0:
        return zone  # seen to be faster than its top speed
    breaks = zone.covariances.breakpoints[0]
    begins, *parts = reach.pieces(breaks[-1])
    ends = np.append(begins, breaks[-1])[None]
    centers, covariances = (PiecewisePolynomials(ends, part[None]) for part in parts)
    times = breaks[0] + (breaks[-1] - breaks[0]) * _LEADS
    own, most = (each.grid(times)[:, 0] for each in (zone.covariances, covariances))
    larger = own[:, 0] + own[:, 2] > most[:, 0] + most[:, 2]
    first = len(times) - int(np.logical_and.accumulate(larger[::-1]).sum())
    if first == len(times):
        return zone
    since = float(times[first])
    return replace(
        zone,
        centers=followed(zone.centers, centers, since),
        covariances=followed(zone.covariances, covariances, since),
        expected=zone.centers,
    )


def followed(first: PiecewisePolynomials, second: PiecewisePolynomials, since: float) -> PiecewisePolynomials:
    """One piecewise polynomial up to a time, s, and another one from there."""
    (before,), (after,) = first.breakpoints[:, :-1], second.breakpoints[:, :-1]
    kept, now = before[before < since], int(np.searchsorted(after, since, "right")) - 1
    begins = np.concatenate([kept, np.maximum(after[now:], since)])
    (_, _, terms, width), others = first.coefficients.shape, second.coefficients.shape[2]
    coefficients = np.zeros((1, len(begins), max(terms, others), width))
    coefficients[0, : len(kept), :terms] = first.coefficients[0, : len(kept)]
    coefficients[0, len(kept) :, :others] = expanded(second.coefficients[0, now:], np.maximum(since - after[now:], 0.0))
    return PiecewisePolynomials(np.append(begins, second.breakpoints[0, -1])[None], coefficients)
