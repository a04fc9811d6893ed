"""States of an obstacle, as a tracker reports them."""

from __future__ import annotations

from typing import Any

import numpy as np

import scp_planner as sp
from scp_planner.arrays import Array

POSITION, VELOCITY, ACCELERATION = (6.0, 5.0), (0.3, -0.8), (-0.1, 0.05)


def covariance(components: int) -> Array:
    """Covariance of a state with correlated components."""
    draw = np.random.default_rng(4).normal(size=(2 * components, 2 * components))
    scale = np.repeat([0.1, 0.15, 0.1][:components], 2)
    mixed = draw @ draw.T / (2 * components) + np.eye(2 * components)
    return scale[:, None] * mixed * scale


def estimate(components: int = 2, time: float = 0.0) -> sp.Estimate:
    return sp.Estimate(
        time=time,
        position=POSITION,
        velocity=VELOCITY,
        acceleration=ACCELERATION if components == 3 else None,
        covariance=covariance(components).tolist(),
    )


def obstacle(components: int = 2, **others: Any) -> dict[str, Any]:
    return {"id": "one", "shape": {"disc": 0.3}, "estimate": estimate(components), **others}
