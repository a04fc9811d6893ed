"""The methods that are compared."""

from __future__ import annotations

from enum import StrEnum


class Method(StrEnum):
    """Sequential convex programming, and the variants of penalty descent."""

    SCP = "scp"
    LBFGS = "l-bfgs"
    GRADIENT = "gradient-descent"
    MONTE_CARLO = "monte-carlo"
