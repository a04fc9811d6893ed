"""Rectangles and ellipses whose heading is estimated: at the expected heading, widened by what that may be off."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from scp_planner.arrays import Array, cross
from scp_planner.mathematics.outlines import Outline
from scp_planner.mathematics.polynomials import PiecewisePolynomials, shift_matrices
from scp_planner.scenario.models import Confidence, ConfidenceLevel
from scp_planner.tracking.confidence import outside_probability, shared_alpha, uniform_scale
from scp_planner.tracking.dynamics import RandomWalk
from scp_planner.tracking.motion_estimate import MotionEstimate, PolynomialEstimate, region_scale
from scp_planner.tracking.process_estimate import ProcessEstimate


@dataclass(frozen=True)
class HeadingWidening:
    """Widening by an uncertain heading."""

    heading_share: float = 0.1  # Share of a zone's error probability that is spent on the heading
    worth_it: float = 0.5  # Share of the widening that holds for every heading, above which the heading is ignored
    # At which the widening is computed, between a share of the horizon and all of it, besides the beginning
    leads: int = 12
    least_ratio: float = 1e-3  # Least ratio of a widening to an uncertainty
    first_lead: float = 1e-3  # First lead, as a share of the horizon
    # The first stretches between leads, in which the heading of a velocity that does a random walk is bounded, each
    # with an equal part of the probability; later its position is so uncertain that its heading does not matter
    early: int = 6


HEADINGS = HeadingWidening()


_SHARES = np.concatenate([[0.0], np.geomspace(HEADINGS.first_lead, 1.0, HEADINGS.leads)])


@dataclass(frozen=True)
class Split:
    """Error probability of one obstacle, to be divided between its position, its velocity and its heading."""

    level: str
    alpha: float

    @classmethod
    def of(cls, confidence: Confidence, obstacles: int) -> Split:
        """Split what a confidence leaves to each of the obstacles that are not known exactly."""
        alpha, level = outside_probability(confidence.probability), confidence.level
        if level is ConfidenceLevel.JOINT:
            alpha, level = shared_alpha(alpha, obstacles), ConfidenceLevel.PER_OBSTACLE
        return cls(str(level), alpha)

    def spending(self, share: float) -> float:
        """Return the probability with which something holds that a share is spent on."""
        return 1.0 - share * self.alpha


@dataclass(frozen=True)
class Widening:
    """Widening of a shape at a fixed heading, from a time on."""

    heading: float  # rad
    leads: Array  # (L,) After that time, s, the first 0
    squares: Array  # (L, 2)


def widening_of(
    outline: Outline, estimate: MotionEstimate, probability: float, start: float, span: float
) -> Widening | None:
    """Find how far a shape that heads along its motion has to be widened."""
    leads = span * _SHARES
    errors = _speed_errors(estimate, probability, start + leads)
    if errors is None:
        return None
    velocity = _velocity(estimate, start + leads)
    beginning = math.atan2(velocity[0, 1], velocity[0, 0])
    turn = _turns(velocity)
    slowest = _distance_of_origin(velocity[:-1], velocity[1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.arcsin(np.minimum(errors / slowest, 1.0))
    off = np.where((slowest > errors) & (slowest > 0.0), np.maximum(turn[:-1], turn[1:]) + off, np.pi)
    reach, half = outline.reach, _half_sides(outline)
    moved = np.maximum.accumulate(2.0 * reach * np.sin(0.5 * np.minimum(off, np.pi)))
    every = reach - half
    if moved[0] > HEADINGS.worth_it * every[1]:
        return None
    known = int(np.searchsorted(moved, HEADINGS.worth_it * every[1], "right"))
    # at a lead what is needed from the one before to the next one, which grows until the heading is not known any more
    squares = np.empty((len(leads), 2))
    squares[:known] = moved[:known, None] ** 2
    squares[known:] = every**2
    if known < len(leads):
        squares[known, 0] = max(moved[known - 1], every[0]) ** 2
    return Widening(beginning, leads, squares)


def _speed_errors(estimate: MotionEstimate, probability: float, times: Array) -> Array | None:
    """Bounds of the size of the velocity's error between times (L,), (L - 1,) m/s; None if none is known."""
    if isinstance(estimate, PolynomialEstimate) and estimate.order > 0:
        velocity = _derivative(estimate)
        if velocity.regressors is None:
            scale = region_scale("per_obstacle", probability, velocity, start=float(times[0]), stop=float(times[-1]))
        else:  # for all regressors, those of times too: a little more than is needed, and the same for all obstacles
            scale = uniform_scale(outside_probability(probability), math.inf, velocity.errors, velocity.regressors)
        # largest variances are convex functions of time, largest at ends
        size = np.sqrt(scale * np.linalg.eigvalsh(velocity.covariance(times))[:, -1])
        return np.maximum(size[:-1], size[1:])
    if isinstance(estimate, ProcessEstimate) and isinstance(estimate.dynamics, RandomWalk):
        # Lévy: a sum of independent symmetric terms was once beyond a size with at most twice the chance that it is now
        chance = 0.5 * outside_probability(probability) / HEADINGS.early
        scale = estimate.errors.pointwise_scale(chance)
        leads = times[1:] - estimate.reference_time
        variance = np.linalg.eigvalsh(estimate.state_covariance[2:, 2:])[-1] + estimate.dynamics.diffusion * leads
        tails = estimate.tails
        inflation = 1.0 if tails is None else max(tails.inflation)
        size = np.sqrt(scale * inflation * variance)
        size[HEADINGS.early :] = np.inf
        return np.asarray(size)
    return None


def _derivative(estimate: PolynomialEstimate) -> PolynomialEstimate:
    """The velocity of a polynomial motion, as a polynomial motion."""
    factors = np.arange(1, estimate.order + 1) / estimate.time_scale
    return replace(
        estimate,
        order=estimate.order - 1,
        regressors=None if estimate.regressors is None else estimate.regressors - 1,
        coefficients=factors[:, None] * estimate.coefficients[1:],
        coefficient_covariance=factors[:, None, None, None]
        * factors[:, None]
        * estimate.coefficient_covariance[1:, :, 1:],
    )


def _velocity(estimate: MotionEstimate, times: Array) -> Array:
    """Expected velocities (L, 2) m/s."""
    if isinstance(estimate, PolynomialEstimate):
        return _derivative(estimate).position(times)
    return np.broadcast_to(estimate.velocity, (len(times), 2))  # a random walk keeps it


def _turns(velocity: Array) -> Array:
    """By how much velocities (L, 2), which change straight from one to the next, have turned since the first, rad."""
    before, after = velocity[:-1], velocity[1:]
    turns = np.arctan2(cross(before, after), np.einsum("na,na->n", before, after))
    return np.asarray(np.abs(np.concatenate([[0.0], np.cumsum(turns)])))


def _distance_of_origin(first: Array, last: Array) -> Array:
    """Least size of vectors on segments from one (n, 2) to another."""
    way = last - first
    square = np.einsum("na,na->n", way, way)
    share = np.divide(-np.einsum("na,na->n", first, way), square, out=np.zeros_like(square), where=square > 0.0)
    nearest = first + np.clip(share, 0.0, 1.0)[:, None] * way
    return np.asarray(np.hypot(nearest[:, 0], nearest[:, 1]))


def _half_sides(outline: Outline) -> Array:
    """Half length and half width of a rectangle or an ellipse along its axes, m."""
    return outline.support(np.eye(2))


def widened(covariances: PiecewisePolynomials, widening: Widening) -> PiecewisePolynomials:
    """Add a widening to the scaled covariances of one zone, from their beginning on; see the head of this module."""
    breaks, whole = covariances.breakpoints[0], covariances.coefficients[0]
    leads = widening.leads[breaks[0] + widening.leads < breaks[-1]]
    edges = np.unique(np.concatenate([breaks, breaks[0] + leads]))
    squares = np.stack([np.interp(edges - breaks[0], widening.leads, each) for each in widening.squares.T], axis=1)
    packed = covariances.at(np.zeros(len(edges), dtype=np.intp), edges)
    ratio = np.maximum(np.sqrt(squares.sum(axis=1) / (packed[:, 0] + packed[:, 2])), HEADINGS.least_ratio)
    begins, steps = edges[:-1], np.diff(edges)
    piece = np.clip(np.searchsorted(breaks, begins, "right") - 1, 0, len(whole) - 1)
    powers = whole.shape[1]
    shifted = shift_matrices(powers, begins - breaks[piece]) @ whole[piece]
    product = np.zeros((len(begins), max(powers + 1, 3), 3))
    product[:, :powers] = (1.0 + ratio[:-1, None, None]) * shifted
    product[:, 1 : powers + 1] += (np.diff(ratio) / steps)[:, None, None] * shifted
    c, s = math.cos(widening.heading), math.sin(widening.heading)
    own = squares @ np.array([[c * c, c * s, s * s], [s * s, -c * s, c * c]])
    slopes, factor = np.diff(own, axis=0) / steps[:, None], 1.0 + 1.0 / ratio
    growth = (np.diff(factor) / steps)[:, None]
    product[:, 0] += factor[:-1, None] * own[:-1]
    product[:, 1] += factor[:-1, None] * slopes + growth * own[:-1]
    product[:, 2] += growth * slopes
    return PiecewisePolynomials(edges[None], product[None])
