"""Changes of acceleration that are likely by now, but not sure: what zones allow for before there is an alarm."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.polynomials import shift_matrices
from scp_planner.tracking.filters import Mixture
from scp_planner.tracking.motion_estimate import least_variances
from scp_planner.tracking.recursive import SquareRoots


@dataclass(frozen=True)
class ChangeHypothesisParameters:
    # Ages of a change that are considered, in measurements
    onsets: tuple[int, ...] = (3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 14, 16, 20, 24, 31)
    left_out: float = 0.1  # Share of what the level leaves open, that changes which are left out may have
    # Evidence from which on an onset counts: with less there would be too many. For what nothing speaks for yet, zones
    # allow as ``manoeuvre`` says
    speaks: float = math.log(20.0)
    # Squared trend of the innovations from which on changes are put to the test. That an onset is spoken for takes a
    # squared signal T with T x / (1 + x) / 2 - log(1 + x) > `speaks`, x what it tells beside what was known of the
    # change: at least 11.5. What windows see of it may be a little less
    looked_at: float = 9.0
    most_evidence: float = 500.0  # Logarithm of a ratio of likelihoods; beyond it, exponentials would overflow
    # Standard deviations to which residuals are cut: what the gate lets pass may be an outlier, or late in a change
    wild: float = 8.0


# 12 observations after a change of 0.5 m/s^2 (`benchmarks.online answers`, 160 obstacles) 88 % of the regions hold a
# second later, and 32 % without changes that are likely only; 15 after it 99 %, and 91 % without them after an alarm.
CHANGE_HYPOTHESES = ChangeHypothesisParameters()


@dataclass(frozen=True)
class ChangeHypotheses:
    probability: Array  # (K,)
    shift: Array  # (K, 3, 2)
    spread: Array  # (K, 3, 3)

    def among(self, some: Index, count: int, least: float) -> ChangeHypotheses:
        """Hypotheses of ``count`` obstacles, of which these are some; none that is not more probable than ``least``."""
        likely = self.probability > least
        found = ChangeHypotheses(np.zeros(count), np.zeros((count, 3, 2)), np.zeros((count, 3, 3)))
        for name, values in vars(self).items():
            getattr(found, name)[some[likely]] = values[likely]
        return found


@dataclass(frozen=True)
class Changes:
    """Changes of acceleration of K obstacles after each of H onsets, if that is when they were."""

    gap: Array  # (K, H) Time from each onset to the next, s; 0 where nothing was seen before it
    evidence: Array  # (K, H) Logarithm of how many times as likely what was seen is with the change as without it
    change: Array  # (K, H, 2) Expected, m/s^2, along the axes along which the noise has variance 1
    variance: Array  # (K, H)
    course: Array  # (K, H, 3)
    root: Array  # (K, 2, 2)

    def change_hypotheses(self, often: float) -> ChangeHypotheses:
        weight = often * self.gap * np.exp(np.minimum(self.evidence, CHANGE_HYPOTHESES.most_evidence))
        weight /= 1.0 + weight.sum(axis=1, keepdims=True)
        return self._mixed(np.where(self.evidence > CHANGE_HYPOTHESES.speaks, weight, 0.0))

    def sure(self) -> ChangeHypotheses:
        weight = self.gap * np.exp(self.evidence - self.evidence.max(axis=1, keepdims=True))
        return self._mixed(weight / weight.sum(axis=1, keepdims=True))

    @property
    def total(self) -> Array:
        """Logarithm of how many times as likely what was seen is with any of the changes as without, (K,)."""
        most = self.evidence.max(axis=1, keepdims=True)
        mean = (self.gap * np.exp(self.evidence - most)).sum(axis=1) / self.gap.sum(axis=1)
        return np.asarray(np.log(mean) + most[:, 0])

    def _mixed(self, weight: Array) -> ChangeHypotheses:
        """The moments of the mixture with weights (K, H), and no change with the rest."""
        moved = self.course[..., None] * self.change[:, :, None]  # (K, H, 3, 2), in units of the noise
        mean = (weight[..., None, None] * moved).sum(axis=1)
        apart = moved - mean[:, None]
        changed = weight.sum(axis=1)
        onsets_last = self.course.transpose(0, 2, 1)
        spread = (onsets_last * (weight * self.variance)[:, None]) @ self.course
        for side in (apart[..., 0], apart[..., 1]):
            spread += (side * weight[..., None]).transpose(0, 2, 1) @ side
        spread += (1.0 - changed)[:, None, None] * (mean @ mean.transpose(0, 2, 1))
        return ChangeHypotheses(changed, mean @ self.root.transpose(0, 2, 1), spread)


def changes_of(roots: SquareRoots, looks: Array, noise: Array, deviation: float) -> Changes:
    """Judge how likely it is that accelerations have changed, from times and positions (3, R, K) as of `Bank.looks`."""
    p, back = roots.factor.shape[1], [-1 - number for number in CHANGE_HYPOTHESES.onsets]
    inverse = np.linalg.inv(roots.factor)
    root = np.linalg.cholesky(noise)
    there = np.isfinite(looks[0].T)  # (K, R)
    clock = np.where(there, looks[0].T - roots.center[:, None], 0.0)
    powers = clock[:, :, None] ** np.arange(p)
    offset = looks[1:].transpose(2, 1, 0) - roots.origin[:, None] - powers @ (inverse @ roots.right)
    residual = (np.linalg.inv(root)[:, None] @ offset[..., None])[..., 0]
    size = np.sqrt((residual * residual).sum(axis=-1))
    residual *= np.where(there, CHANGE_HYPOTHESES.wild / np.maximum(size, CHANGE_HYPOTHESES.wild), 0.0)[..., None]

    onset = clock[:, back]
    path = 0.5 * np.maximum(clock[:, None] - onset[:, :, None], 0.0) ** 2 * there[:, None]  # (K, H, R)
    known = (path @ powers) @ inverse  # what the polynomial takes for its own, by Frisch, Waugh and Lovell
    information = np.maximum((path * path).sum(axis=-1) - (known * known).sum(axis=-1), 0.0)
    gradient = path @ residual  # (K, H, 2)
    prior = (deviation**2 / least_variances(noise))[:, None]  # variance of a change, over that of the noise
    variance = prior / (1.0 + prior * information)
    change = gradient * variance[..., None]
    course = np.zeros((*onset.shape, 3))
    course[:, :, 0], course[:, :, 1], course[:, :, 2] = 0.5 * onset * onset, -onset, 0.5
    course[:, :, :p] -= known @ inverse.transpose(0, 2, 1)
    gap = clock[:, [-1, *back[:-1]]] - onset
    gap *= there[:, back]
    evidence = 0.5 * (gradient * change).sum(axis=-1) + np.log(variance / prior)
    evidence = np.where(gap > 0.0, evidence, -CHANGE_HYPOTHESES.most_evidence)
    return Changes(gap, evidence, change, variance, course, np.asarray(root, dtype=float))


def changed_motions(roots: SquareRoots, surely: ChangeHypotheses, noise: Array, start: float) -> Mixture:
    """The motions of K obstacles that have surely changed their accelerations once, at a time, s."""
    inverse = np.linalg.inv(roots.factor)
    p, count = inverse.shape[1], len(inverse)
    coefficients, spread = surely.shift.copy(), surely.spread.copy()
    coefficients[:, :p] += inverse @ roots.right
    spread[:, :p, :p] += inverse @ inverse.transpose(0, 2, 1)
    here = np.array([1.0, 1.0, 2.0])[:, None] * shift_matrices(3, start - roots.center)
    mean = here @ coefficients
    mean[:, 0] += roots.origin
    covariance = np.einsum("kij,kab->kiajb", here @ spread @ here.transpose(0, 2, 1), noise)
    return Mixture(mean, covariance, np.zeros((count, 2)), noise)
