"""Bell polynomials: what derivatives of an exponential are made of."""

from __future__ import annotations

from math import comb

import numpy as np

from scp_planner.arrays import Array


def complete_bell_polynomials(first: Array, second: Array, third: Array, count: int) -> list[Array]:
    """Return the complete Bell polynomials B_0 to B_count of x1, x2, x3, and no further x."""
    bells = [np.ones_like(first)]
    for m in range(count):
        terms = zip((first, second, third), range(min(m, 2) + 1), strict=False)
        bells.append(sum((comb(m, k) * x * bells[m - k] for x, k in terms), np.zeros_like(first)))
    return bells
