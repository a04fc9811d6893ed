"""Motions that are observed through noise."""

from __future__ import annotations

import numpy as np

SIGMA = np.array([[0.04, 0.015], [0.015, 0.01]])
TRUTH = np.array([[3.0, -1.0], [1.2, 0.4], [-0.3, 0.25]])  # position, velocity, half the acceleration


def observe(rng: np.random.Generator, times: np.ndarray, order: int = 2, sigma: np.ndarray = SIGMA) -> np.ndarray:
    truth = (np.asarray(times)[:, None] ** np.arange(order + 1)) @ TRUTH[: order + 1]
    return truth + rng.multivariate_normal(np.zeros(2), sigma, len(times))


def irregular(rng: np.random.Generator, count: int = 15, end: float = 2.0) -> np.ndarray:
    return np.sort(rng.uniform(0.0, end, count))
