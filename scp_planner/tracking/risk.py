"""Division of an obstacle's probability of leaving its zones among its possible futures."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.tracking.tolerances import LEAST_RISK_SHARE


def alpha_of_mixture(level: str, alpha: float, obstacles: int) -> float:
    """Give the probability that an obstacle of several futures may be outside with; see the head of this module."""
    return alpha * (1.0 - alpha) ** (obstacles - 1) if level == "joint" else alpha


def sizes_of(spreads: Array, scales: Array, radius: float) -> Array:
    """Give what the areas of zones of futures gain by a little more of the budget, up to a common factor."""
    return spreads * (spreads + radius / np.sqrt(scales))


def shared_risk(weights: Array, sizes: Array, alpha: float) -> Array:
    """Give the probability with which each future may be outside its zone; see the head of this module."""
    if not 0.0 < alpha < 1.0:
        raise EstimationError(f"alpha: {alpha!r} is not between 0 and 1")
    for name, values in (("weights", weights), ("sizes", sizes)):
        if not np.all((values >= 0.0) & np.isfinite(values)):
            raise EstimationError(f"{name}: {values!r} are not all numbers >= 0")
    risk = np.where(weights > 0.0, 0.0, 1.0)
    shares = np.where(sizes > 0.0, np.maximum(sizes, LEAST_RISK_SHARE * sizes.max(initial=0.0)), 0.0)
    sharing = np.flatnonzero((weights > 0.0) & (sizes > 0.0))
    budget = alpha
    while len(sharing):
        paid = budget * shares[sharing] / shares[sharing].sum()
        out = paid >= weights[sharing]
        if not out.any():
            risk[sharing] = paid / weights[sharing]
            break
        risk[sharing[out]] = 1.0
        budget -= float(weights[sharing[out]].sum())
        sharing = sharing[~out]
    return risk
