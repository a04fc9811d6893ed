"""Predicted centres and covariances of many obstacles, as piecewise polynomials of time, and their sizes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.polynomials import PiecewisePolynomials, shift_matrices
from scp_planner.mathematics.quadrature import gauss_rule
from scp_planner.tracking.mixtures import Mixture, even
from scp_planner.tracking.motion_estimate import HORIZON, standardised_speed

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

    def among(self, some: Index) -> Sizing:
        return Sizing(self.leads[some], self.kinds[some], self.sizes[some])

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


def times_linear(
    covariances: PiecewisePolynomials, leads: Array, factors: Array, added: Array | None = None
) -> PiecewisePolynomials:
    """Multiply covariances by factors that are linear between leads after their start, and constant after the last."""
    breaks, whole = covariances.breakpoints[0], covariances.coefficients
    edges = np.unique(np.concatenate([breaks, breaks[0] + leads[breaks[0] + leads < breaks[-1]]]))
    begins, widths = edges[:-1], np.diff(edges)
    piece = np.searchsorted(breaks, begins, "right") - 1
    weights = np.array([np.interp(edges - breaks[0], leads, one) for one in np.eye(len(leads))])
    shifted = shift_matrices(whole.shape[2], begins - breaks[piece]) @ whole[:, piece]
    product = np.zeros((len(whole), len(begins), whole.shape[2] + 1, whole.shape[3]))
    at = factors @ weights
    product[:, :, :-1] = at[:, :-1, None, None] * shifted
    product[:, :, 1:] += (np.diff(at) / widths)[:, :, None, None] * shifted
    if added is not None:
        more = added @ weights
        product[:, :, 0, [0, 2]] += more[:, :-1, None]
        product[:, :, 1, [0, 2]] += (np.diff(more) / widths)[:, :, None]
    return PiecewisePolynomials(np.tile(edges, (len(whole), 1)), product)


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
        weights = np.array([np.interp(np.append(edges, np.inf), lead, one) for one in np.eye(len(lead))])
        at = sizes @ weights
        piece = np.searchsorted(future.breaks[:-1] - start, edges, "right") - 1
    ends = np.empty((count, begins.shape[1] + 1))
    ends[:, :-1], ends[:, -1] = begins, future.breaks[-1] - start
    whole = future.covariances[some][:, piece]
    powers, shift = whole.shape[2], begins - (future.breaks[piece] - start)
    shifted = (shift_matrices(powers, shift.ravel()) @ whole.reshape(-1, powers, 3)).reshape(whole.shape)
    pieces = np.zeros((count, len(piece), powers + 1, 3))
    parts, widths = np.empty((2, *at.shape)), ends[:, 1:] - ends[:, :-1]
    np.minimum(at, 1.0, out=parts[0])
    np.maximum(at - 1.0, 0.0, out=parts[1])
    # of what was seen twice at one time the first piece is empty
    steps = parts[:, :, 1:] - parts[:, :, :-1]
    slopes = np.divide(steps, widths, out=np.zeros_like(steps), where=widths > 0.0)
    factor, more = parts[:, :, :-1]
    pieces[:, :, :-1] = factor[:, :, None, None] * shifted
    pieces[:, :, 1:] += slopes[0][:, :, None, None] * shifted
    pieces[:, :, 0, [0, 2]] += more[:, :, None]
    pieces[:, :, 1, [0, 2]] += slopes[1][:, :, None]
    return start + ends, pieces


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
