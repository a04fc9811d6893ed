"""Motions with process noise over a span of time: the same computation for one of them or for many at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.scenario.process_model import Tails
from scp_planner.tracking.dynamics import Dynamics, RandomWalk
from scp_planner.tracking.motion_estimate import (
    POLYNOMIAL_TERMS,
    MotionPolynomials,
    error_blocks,
    integrate,
    row_products,
    standardised_speed,
)


@dataclass(frozen=True)
class SpanSettings:
    """Precision of piecewise polynomials of a predicted motion."""

    # m; how far piecewise polynomials may lie from a predicted centre that is not polynomial
    center_tolerance: float = 1e-3
    # Relative; how much piecewise polynomials may exceed a covariance that is not polynomial
    covariance_tolerance: float = 1e-3
    most_halvings: int = 12
    # pieces of a motion that is not polynomial that are tried first, each twice as long as the one before
    halved: int = 7
    checks: int = 21  # points of a piece at which its error is measured
    kept: int = 256  # sets of lead times


SPANS = SpanSettings()
_EXPONENTS = np.arange(POLYNOMIAL_TERMS)
_NODES = 0.5 - 0.5 * np.cos(np.pi * _EXPONENTS / (POLYNOMIAL_TERMS - 1))  # Chebyshev-Lobatto: neighbours meet
_BETWEEN = np.linspace(0.0, 1.0, SPANS.checks)
_POWERS = _BETWEEN[:, None] ** _EXPONENTS
_SOLVE = np.linalg.inv(_NODES[:, None] ** _EXPONENTS)
_XX, _XY, _YY = 0, 1, 2  # entries of covariances


@dataclass(frozen=True)
class ProcessSpans:
    """Motions of one model with process noise, predicted from one time on, to be given over spans of time."""

    dynamics: Dynamics
    tails: Tails | None
    reference_time: float  # s
    mean: Array  # Expected states at the reference time
    covariance: Array

    def of(self, some: Sequence[int] | Index) -> ProcessSpans:
        """Some of them."""
        return ProcessSpans(self.dynamics, self.tails, self.reference_time, self.mean[some], self.covariance[some])

    def inflation(self, lead: Array) -> Array:
        """By how much covariances are larger than those of the model after lead times (...), s: (...)."""
        if self.tails is None:
            return np.ones_like(lead)
        return np.asarray(np.interp(lead, self.tails.lead_time, self.tails.inflation))

    def rates(self, lead: Array) -> tuple[Array, Array, Array]:
        """Covariances of the errors, of them with their rates, and of these, all before inflation."""
        d = self.dynamics.states
        products, noise = _rate_products(self.dynamics, lead.tobytes())
        blocks = error_blocks(products, self.covariance.reshape(-1, d, 2, d, 2))
        for block, more in zip(blocks, noise, strict=True):
            block[..., [0, 1], [0, 1]] += more[:, None]
        return blocks

    def lengths(self, first: float, last: float) -> Array:
        """Path length of each standardised error between two lead times in s, (n,)."""
        found = np.zeros(len(self.mean))
        if first == last:
            return found
        # errors turn on the scale of the time that the velocity needs to blur the position; then ever more
        # slowly. In powers of two, for which what is kept serves again.
        p = self.covariance
        times = np.sqrt((p[:, 0, 0] + p[:, 1, 1]) / (p[:, 2, 2] + p[:, 3, 3]))
        scales = np.exp2(np.round(np.log2(times)))
        for scale in np.unique(scales).tolist():
            alike = np.flatnonzero(scales == scale)
            found[alike] = _lengths(self.of(alike), first, last, scale)
        return found

    def pieces(self, first: float, last: float) -> list[MotionPolynomials]:
        """Centres and covariances over lead times, s: exact for a random walk, else within tolerances."""
        bends = () if self.tails is None else self.tails.lead_time
        leads = np.array([first, *(lead for lead in bends if first < lead < last), last])
        if not isinstance(self.dynamics, RandomWalk):  # hard to follow at first, easy later
            halved = first + (last - first) * 0.5 ** np.arange(SPANS.halved, 0, -1)
            leads = np.unique(np.concatenate([leads, halved]))
        fitted, missed = self.interpolated(leads)
        for number in np.flatnonzero(missed.any(axis=1)).tolist():
            fitted[number] = _halved(self.of([number]), leads, missed[number])
        return fitted

    def interpolated(self, leads: Array) -> tuple[list[MotionPolynomials], Mask]:
        """Interpolate between leads (S + 1,), s, and tell which pieces (n, S) are off by more than the tolerances."""
        widths = np.diff(leads)
        count, pieces = len(self.mean), len(widths)
        center, covariance = self._positions(leads)
        center_error, covariance_error = np.zeros((count, pieces)), np.zeros((count, pieces))
        true_center, true = center[:, :, len(_NODES) :], covariance[:, :, len(_NODES) :]
        center, covariance = _SOLVE @ center[:, :, : len(_NODES)], _SOLVE @ covariance[:, :, : len(_NODES)]
        if not isinstance(self.dynamics, RandomWalk):  # degree 3, times an inflation of degree 1
            off = _POWERS @ center - true_center
            center_error = np.max(np.hypot(off[..., 0], off[..., 1]), axis=2)
            missed = np.abs(_POWERS @ covariance - true)
            # no direction's variance is off by more than the sum of what the entries are off by
            spread = np.hypot(0.5 * (true[..., _XX] - true[..., _YY]), true[..., _XY])
            least = 0.5 * (true[..., _XX] + true[..., _YY]) - spread
            missing = np.maximum(missed[..., _XX], missed[..., _YY]) + missed[..., _XY]
            covariance_error = np.max(missing / least, axis=2)
            covariance = covariance * (1.0 + covariance_error.max(axis=1))[:, None, None, None]
        scales = widths[:, None, None] ** _EXPONENTS[:, None]
        center, covariance = center / scales, covariance / scales
        times = self.reference_time + leads
        worst = center_error.max(axis=1).tolist(), (2.0 * covariance_error.max(axis=1)).tolist()
        fitted = [MotionPolynomials(times, *each) for each in zip(center, covariance, *worst, strict=True)]
        return fitted, (center_error > SPANS.center_tolerance) | (covariance_error > SPANS.covariance_tolerance)

    def _positions(self, leads: Array) -> tuple[Array, Array]:
        """Centres (n, S, K, 2), and xx, xy, yy of covariances (n, S, K, 3), at nodes of pieces and between them."""
        response, pairs, noise, lead = _position_responses(self.dynamics, leads.tobytes())
        d = self.dynamics.states
        states = self.covariance.reshape(-1, d, 2, d, 2)
        entries = np.stack([states[:, :, 0, :, 0], states[:, :, 0, :, 1], states[:, :, 1, :, 1]], axis=-1)
        blocks = (pairs @ entries.reshape(-1, d * d, 3)).reshape(-1, *lead.shape, 3)
        blocks[..., [_XX, _YY]] += noise[..., None]
        blocks *= self.inflation(lead)[..., None]
        return (response @ self.mean).reshape(-1, *lead.shape, 2), blocks


def _lengths(spans: ProcessSpans, first: float, last: float, scale: float) -> Array:
    """Lengths between two lead times, s, by an integral over the logarithm of the time in units of a scale, s: (n,)."""

    def speeds(u: Array) -> Array:
        return scale * np.exp(u) * standardised_speed(*spans.rates(scale * np.expm1(u)))

    return integrate(speeds, math.log1p(first / scale), math.log1p(last / scale))


def _halved(single: ProcessSpans, leads: Array, missed: Mask) -> MotionPolynomials:
    """Halve the pieces of a single motion that are off by too much, until none is."""
    for _ in range(SPANS.most_halvings):
        leads = np.sort(np.concatenate([leads, 0.5 * (leads[1:] + leads[:-1])[missed]]))
        fitted, still = single.interpolated(leads)
        missed = still[0]
        if not np.any(missed):
            break
    return fitted[0]


@lru_cache(maxsize=SPANS.kept)
def _rate_products(dynamics: Dynamics, leads: bytes) -> tuple[Array, Array]:
    """Maps from pairs of states to covariances of position and velocity, (3 L, d d), and noise, (3, L)."""
    lead = np.frombuffer(leads)
    f, q = dynamics.transition(lead), dynamics.process_noise(lead)
    return row_products(f[:, 0], f[:, 1]), np.stack([q[:, 0, 0], q[:, 0, 1], q[:, 1, 1]])


@lru_cache(maxsize=SPANS.kept)
def _position_responses(dynamics: Dynamics, leads: bytes) -> tuple[Array, Array, Array, Array]:
    """Maps from states to positions, (S K, d), and from pairs of them, (S K, d d), noise (S, K), lead times, s."""
    ends = np.frombuffer(leads)
    lead = ends[:-1, None] + np.diff(ends)[:, None] * np.concatenate([_NODES, _BETWEEN])
    response = dynamics.transition(lead)[..., 0, :].reshape(lead.size, -1)
    pairs = (response[:, :, None] * response[:, None, :]).reshape(lead.size, -1)
    return response, pairs, dynamics.process_noise(lead)[..., 0, 0], lead
