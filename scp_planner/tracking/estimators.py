"""Estimators of one obstacle's motion, updated with each of its measurements."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from scp_planner.arrays import Array, rows_of
from scp_planner.scenario.process_model import ProcessModel
from scp_planner.tracking.dynamics import dynamics_of
from scp_planner.tracking.kalman import FilterState, first_state, update_state
from scp_planner.tracking.maximum_likelihood import MotionPrior
from scp_planner.tracking.motion_estimate import MotionEstimate
from scp_planner.tracking.noticing import Bank
from scp_planner.tracking.process_estimate import ProcessEstimate
from scp_planner.tracking.recursive import RecursiveEstimator, SquareRoots
from scp_planner.tracking.tolerances import LEAST_DEVIATION

MOST_LATE = 64
"""Later measurements that one may come after, where a process model is learnt from them in order: these are then
learnt again. After so many, such a model has forgotten most of what an older one could tell."""


class TrackEstimator(ABC):
    bank: Bank | None = None
    slot: int = 0  # in the bank
    depth: float = math.inf  # Later measurements after which one can still be taken in
    in_order: bool = False
    alarmed: bool = False  # True while its motion is not the predicted one

    @abstractmethod
    def update(self, time: float, position: tuple[float, float], noise: Array) -> None:
        """Take in a measurement and its covariance (2, 2), m^2."""

    @abstractmethod
    def estimate(self, prior: MotionPrior | None) -> MotionEstimate:
        """Give the estimate, with what is known beforehand of a polynomial motion."""

    @property
    def roots(self) -> SquareRoots | None:
        return None

    def go_back(self, later: int) -> None:
        """Restore the state before the last so many measurements."""
        raise NotImplementedError("measurements may come in any order")

    def close(self) -> None:  # noqa: B027 - most hold nothing that others could use
        """Leave its slot to others."""


class PolynomialTrack(TrackEstimator):
    def __init__(self, order: int, covariance: Array | None, varying: bool) -> None:
        self._varying = varying
        self._recursive = RecursiveEstimator(1, order, None if varying else covariance, varying=varying)
        self._recursive.least_deviation = LEAST_DEVIATION

    def update(self, time: float, position: tuple[float, float], noise: Array) -> None:
        self._recursive.update(time, np.array([position]), noise if self._varying else None)

    def estimate(self, prior: MotionPrior | None) -> MotionEstimate:
        return self._recursive.estimate(0, prior)

    @property
    def roots(self) -> SquareRoots:
        return self._recursive.roots


class NoticingTrack(TrackEstimator):
    """A polynomial motion that is believed as long as its predictions hold; see `scp_planner.tracking.noticing`."""

    bank: Bank

    def __init__(self, bank: Bank, covariance: Array) -> None:
        self.bank, self.slot = bank, bank.take(covariance)

    def update(self, time: float, position: tuple[float, float], noise: Array) -> None:  # noqa: ARG002 - as declared
        if time < self.bank.last[self.slot]:
            self.bank.take_in_late(self.slot, time, np.array(position))
        else:
            self.bank.update(np.array([self.slot]), np.array([time]), np.array([position]))

    def estimate(self, prior: MotionPrior | None) -> MotionEstimate:
        return self.bank.polynomials.estimate(self.slot, prior)

    @property
    def roots(self) -> SquareRoots:
        return rows_of(self.bank.polynomials.roots, np.array([self.slot]))

    @property
    def alarmed(self) -> bool:  # type: ignore[override]
        return bool(self.bank.alarmed[self.slot])

    def close(self) -> None:
        self.bank.give_back(self.slot)


@dataclass(frozen=True)
class _Filtered:
    state: FilterState
    count: int  # Measurements
    noise: Array  # Sum of their covariances, (2, 2) m^2


class ProcessTrack(TrackEstimator):
    in_order = True

    def __init__(self, model: ProcessModel) -> None:
        self._model, self._dynamics = model, dynamics_of(model)
        self._filtered: _Filtered | None = None
        self._before: deque[_Filtered | None] = deque(maxlen=MOST_LATE)

    def update(self, time: float, position: tuple[float, float], noise: Array) -> None:
        last, seen = self._filtered, (np.array([time]), np.array([position]), noise[None])
        self._before.append(last)
        if last is None:
            self._filtered = _Filtered(first_state(self._dynamics, self._model.velocity_deviation**2, *seen), 1, noise)
            return
        state = replace(last.state)
        update_state(self._dynamics, state, *seen)
        self._filtered = _Filtered(state, last.count + 1, last.noise + noise)

    @property
    def depth(self) -> int:  # type: ignore[override]
        return len(self._before)

    def go_back(self, later: int) -> None:
        for _ in range(later):
            self._filtered = self._before.pop()

    def estimate(self, prior: MotionPrior | None) -> ProcessEstimate:  # noqa: ARG002 - its model has one
        last = self._filtered
        assert last is not None, "it has been seen"
        return last.state.estimate(0, self._model, last.count, last.noise / last.count)
