"""Gauss' rules of integration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from scp_planner.arrays import Array


@dataclass(frozen=True)
class GaussRule:
    """A rule of Gauss and Legendre: exact for polynomials up to degree 2 n - 1 over [-1, 1]."""

    nodes: Array  # (n,) Ascending; read only, as all that use the rule share it
    weights: Array  # (n,) They sum up to 2


@cache
def gauss_rule(count: int) -> GaussRule:
    """Give the rule with so many nodes."""
    nodes, weights = (np.asarray(values, dtype=np.float64) for values in np.polynomial.legendre.leggauss(count))
    for values in (nodes, weights):
        values.setflags(write=False)
    return GaussRule(nodes, weights)
