"""Predicted centres and covariances of many obstacles, as piecewise polynomials of time, and their sizes.

Begin with `PolynomialMotions`, or with `future_of` for mixtures of filters.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.polynomials import PiecewisePolynomials, shift_matrices
from scp_planner.mathematics.quadrature import gauss_rule
from scp_planner.tracking.change_hypotheses import ChangeHypotheses
from scp_planner.tracking.filters import Mixture, even
from scp_planner.tracking.motion_estimate import (
    HORIZON,
    least_variances,
    standardised_speed,
    sums_of_powers,
    turning_rows,
)
from scp_planner.tracking.recursive import SquareRoots

PANELS, NODES = 4, 12  # of the quadrature of standardised lengths


@dataclass(frozen=True)
class Future:
    breaks: Array  # (S + 1,) Absolute times, s
    centers: Array  # (K, S, P, 2) m
    covariances: Array  # (K, S, Q, 3) Elements xx, xy, yy, not scaled, m^2
    rates: Array  # (K, 2, 2) Covariances of the velocities at the beginning, m^2/s^2


@dataclass(frozen=True)
class Sizing:
    leads: Array  # (n, H) Times ahead for which sizes are known, s; all but the first are the same for all
    kinds: Index  # (n,)
    sizes: Array  # (n, H) Linear between leads; see `scp_planner.tracking.conformal.region_score`

    @cached_property
    def others(self) -> Index:
        return np.flatnonzero((self.sizes != 1.0).any(axis=1))


def future_of(mixtures: Mixture, start: float) -> Future:
    center = mixtures.mean / np.array([1.0, 1.0, 2.0])[:, None]
    covariance = mixtures.errors[:, :, [0, 0, 1], [0, 1, 1]]
    return Future(
        np.array([start, start + HORIZON]), center[:, None], covariance[:, None], mixtures.covariance[:, 1, :, 1]
    )


def lengths_of(mixtures: Mixture) -> Array:
    """Standardised lengths over `HORIZON` of what K mixtures predict, (K,)."""
    p, (swerve, jerk) = mixtures.covariance, mixtures.noises
    # of the error with its rate, where the two parts of the mixed terms differ
    cross = np.stack(
        [
            p[:, 0, :, 1],
            p[:, 1, :, 1] + p[:, 0, :, 2],
            p[:, 1, :, 2] + 0.5 * p[:, 2, :, 1] + 0.5 * swerve,
            0.5 * p[:, 2, :, 2],
            jerk / 8.0,
        ],
        axis=1,
    )
    rate = np.stack([p[:, 1, :, 1], 2.0 * even(p[:, 1, :, 2]) + swerve, p[:, 2, :, 2], jerk / 3.0], axis=1)
    return lengths_of_polynomials(mixtures.errors, cross, rate)


def sized_covariances(
    covariances: PiecewisePolynomials, leads: Array, factors: Array, added: Array
) -> PiecewisePolynomials:
    """Multiply covariances by factors, and add to variances, linearly between leads after their start."""
    breaks, whole = covariances.breakpoints[0], covariances.coefficients
    edges = np.unique(np.concatenate([breaks, breaks[0] + leads[breaks[0] + leads < breaks[-1]]]))
    piece = np.searchsorted(breaks, edges[:-1], "right") - 1
    shifted = shift_matrices(whole.shape[2], edges[:-1] - breaks[piece]) @ whole[:, piece]
    factors, added = (_interpolated(each, leads, edges - breaks[0]) for each in (factors, added))
    return PiecewisePolynomials(np.tile(edges, (len(whole), 1)), _sized(shifted, np.diff(edges), factors, added))


def _interpolated(values: Array, leads: Array, times: Array) -> Array:
    """Values (n, L) at leads, linear in between and constant beyond, at times (m,): (n, m)."""
    return values @ np.array([np.interp(times, leads, one) for one in np.eye(len(leads))])


def _sized(covariances: Array, widths: Array, factors: Array, added: Array) -> Array:
    """Pieces (n, S, Q, 3) times factors, and more variance, (n, S + 1) each at the edges and linear in between."""
    pieces = np.zeros((*covariances.shape[:2], covariances.shape[2] + 1, 3))
    steps = np.diff([factors, added])
    # of what was seen twice at one time a piece is empty
    slopes = np.divide(steps, widths, out=np.zeros_like(steps), where=widths > 0.0)
    pieces[:, :, :-1] = factors[:, :-1, None, None] * covariances
    pieces[:, :, 1:] += slopes[0][..., None, None] * covariances
    pieces[:, :, 0, [0, 2]] += added[:, :-1, None]
    pieces[:, :, 1, [0, 2]] += slopes[1][..., None]
    return pieces


def sized_pieces(future: Future, some: Index, sizing: Sizing) -> tuple[Array, Array]:
    """Covariances of some obstacles, (n,), sized linearly in time between leads, and constantly after the last."""
    leads, sizes = sizing.leads[some], sizing.sizes[some]
    start, count = future.breaks[0], len(some)
    if len(future.breaks) == 2:
        begins, at = np.zeros((count, leads.shape[1] + 1)), np.empty((count, leads.shape[1] + 2))
        begins[:, 1:], at[:, 1:-1], at[:, 0], at[:, -1] = leads, sizes, sizes[:, 0], sizes[:, -1]
        # Where sizes stay as they are for all, one piece will do for several: each takes time wherever zones are asked.
        turns = (at[:, 1:] != at[:, :-1]).any(axis=0)
        needed = np.flatnonzero(np.append(True, turns[:-1] | turns[1:]))
        begins, at = begins[:, needed], at[:, np.append(needed, -1)]
        piece = np.zeros(len(needed), dtype=np.intp)
    else:
        lead = leads.mean(axis=0)
        edges = np.unique(np.append(future.breaks[:-1] - start, lead[-1]))
        begins = np.broadcast_to(edges, (count, len(edges)))
        at = _interpolated(sizes, lead, np.append(edges, np.inf))
        piece = np.searchsorted(future.breaks[:-1] - start, edges, "right") - 1
    ends = np.empty((count, begins.shape[1] + 1))
    ends[:, :-1], ends[:, -1] = begins, future.breaks[-1] - start
    whole = future.covariances[some][:, piece]
    powers, shift = whole.shape[2], begins - (future.breaks[piece] - start)
    shifted = (shift_matrices(powers, shift.ravel()) @ whole.reshape(-1, powers, 3)).reshape(whole.shape)
    return start + ends, _sized(shifted, np.diff(ends), np.minimum(at, 1.0), np.maximum(at - 1.0, 0.0))


def lengths_of_polynomials(error: Array, cross: Array, rate: Array) -> Array:
    """Standardised lengths over `HORIZON` of K motions, (K,)."""
    nodes, weights = length_rule()
    scale = np.sqrt(np.trace(error[:, 0], axis1=1, axis2=2) / np.trace(rate[:, 0], axis1=1, axis2=2))
    last = np.log1p(HORIZON / scale)
    grown = scale[:, None] * np.exp(last[:, None] * nodes)
    powers = (grown - scale[:, None])[:, :, None] ** np.arange(6)
    at = [np.einsum("knp,kpab->knab", powers[:, :, : part.shape[1]], part) for part in (error, cross, rate)]
    speed = standardised_speed(*at)
    return last * ((grown * speed) @ weights)


@cache
def length_rule() -> tuple[Array, Array]:
    """Nodes between 0 and 1, and weights, of the quadrature of standardised lengths."""
    rule = gauss_rule(NODES)
    edges = np.arange(PANELS) / PANELS
    points = (edges[:, None] + (0.5 + 0.5 * rule.nodes) / PANELS).ravel()
    return points, np.tile(0.5 * rule.weights / PANELS, PANELS)


@dataclass(frozen=True)
class PolynomialMotions:
    """K motions as they are estimated, in powers of the time since the middle of what was seen of each."""

    coefficients: Array  # (K, p, 2) Relative to their origins, m/s^k
    spread: Array  # (K, p, p) Covariance of each component of them, over that of the noise
    noise: Array  # (K, 3) Elements xx, xy, yy of the covariance of every observation, m^2
    roots: SquareRoots

    @classmethod
    def of(
        cls, roots: SquareRoots, sigma: Array, manoeuvre: float = 0.0, change_hypotheses: ChangeHypotheses | None = None
    ) -> PolynomialMotions:
        """Return motions of one order, as they are estimated from observations with covariances (K, 2, 2), m^2."""
        inverse = np.linalg.inv(roots.factor)
        spread, coefficients = inverse @ inverse.transpose(0, 2, 1), inverse @ roots.right
        if manoeuvre > 0.0:  # as in `PolynomialEstimate.with_manoeuvre`
            change, last = manoeuvre**2 / least_variances(sigma), roots.last - roots.center
            shift = np.stack([0.5 * (last * last), -last, np.full(len(last), 0.5)], axis=1)
            spread = _padded(spread, 3) + change[:, None, None] * shift[:, :, None] * shift[:, None]
            coefficients = _padded(coefficients, 2)
        if change_hypotheses is not None and change_hypotheses.probability.any():
            spread = _padded(spread, 3) + change_hypotheses.spread
            coefficients = _padded(coefficients, 2) + change_hypotheses.shift
        return cls(coefficients, spread, sigma[:, [0, 0, 1], [0, 1, 1]], roots)

    @property
    def terms(self) -> int:
        return int(self.coefficients.shape[1])

    def future(self, start: float) -> Future:
        """Predictions from a time on, s."""
        count, terms = self.coefficients.shape[:2]
        shift = shift_matrices(terms, start - self.roots.center)
        center = shift @ self.coefficients
        center[:, 0] += self.roots.origin
        local = shift @ self.spread @ shift.transpose(0, 2, 1)
        growth = local.reshape(count, -1) @ sums_of_powers(terms).T
        covariance = growth[:, :, None] * self.noise[:, None]
        rates = self.noise[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
        rates = local[:, 1:, 1:][:, :1, :1] * rates if terms > 1 else np.zeros((count, 2, 2))
        return Future(np.array([start, start + HORIZON]), center[:, None], covariance[:, None], rates)

    def lengths(self, start: float) -> Array:
        """Standardised lengths over `HORIZON` from a time on, s: (K,)."""
        clocks = np.stack([self.roots.first, self.roots.last, self.roots.center])
        # if all were seen at the same times
        alike = bool((clocks == clocks[:, :1]).all() and (self.spread == self.spread[0]).all())
        some = slice(1 if alike else None)
        (first, last, middle), spread = clocks[:, some], self.spread[some]
        half, about = np.where(last > first, 0.5 * (last - first), 1.0), 0.5 * (first + last)
        shift = shift_matrices(self.terms, about - middle)  # u = about + half s
        shift *= half[:, None, None] ** np.arange(self.terms)[:, None]
        local = shift @ spread @ shift.transpose(0, 2, 1)
        found = _lengths(local, (start - about) / half, (start + HORIZON - about) / half)
        return np.repeat(found, len(self.noise)) if alike else found


def _padded(values: Array, width: int) -> Array:
    """Values (K, p, ...) of motions of any order as those of order 2, (K, 3, width)."""
    count, terms, given = values.shape
    if terms == 3:
        return values
    padded = np.zeros((count, 3, width))
    padded[:, :terms, :given] = values
    return padded


def _lengths(spread: Array, start: Array, stop: Array) -> Array:
    """Standardised lengths of K polynomial motions over spans of normalised time, (K,)."""
    order = spread.shape[1] - 1
    if order == 0:
        return np.zeros(len(spread))
    nodes, weights = length_rule()
    low, high = np.arctan(start), np.arctan(stop)
    angles = low[:, None] + (high - low)[:, None] * nodes
    x, y = turning_rows(order, angles)
    weighted = x @ spread
    error, cross, rate = _summed(weighted * x), _summed(weighted * y), _summed((y @ spread) * y)
    speed = np.sqrt(np.maximum(rate * error - cross * cross, 0.0)) / error
    return (high - low) * (speed @ weights)


def _summed(terms: Array) -> Array:
    """Sums over the last axis of two or three: a sum of numpy over so short an axis takes several times as long."""
    total: Array = terms[..., 0] + terms[..., 1]
    for term in range(2, terms.shape[-1]):
        total += terms[..., term]
    return total
