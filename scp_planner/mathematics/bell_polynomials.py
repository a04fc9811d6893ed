"""Bell polynomials: what derivatives of an exponential are made of."""

from __future__ import annotations

from math import comb

import numpy as np

from scp_planner.arrays import Array


def complete_bell_polynomials(first: Array, second: Array, third: Array, count: int) -> list[Array]:
    """Return the complete Bell polynomials B_0 to B_count of x1, x2, x3, and no further x.

    The derivative of order n of exp(h) is B_n exp(h) where h is a cubic and x1, x2, x3 are its derivatives; with the
    absolute values of those of phi they bound the derivatives of exp(i phi).

    Parameters
    ----------
    first, second, third : (n,) arrays
        x1, x2 and x3.
    count : int

    Returns
    -------
    list of (n,) arrays
        B_0 to B_count, by B_(m + 1) = sum_k binomial(m, k) x_(k + 1) B_(m - k).
    """
    bells = [np.ones_like(first)]
    for m in range(count):
        terms = zip((first, second, third), range(min(m, 2) + 1), strict=False)
        bells.append(sum((comb(m, k) * x * bells[m - k] for x, k in terms), np.zeros_like(first)))
    return bells
