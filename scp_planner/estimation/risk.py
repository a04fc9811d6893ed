"""How several possible futures of one obstacle share the probability that it may be outside its zones.

A predictor says that an obstacle takes course i with the probability w_i, and how far it then is off. It is outside of
all its zones only if it is outside of that of the course that it takes: with zones that each miss their course with
probability eps_i, that has at most the probability

    sum_i w_i eps_i <= eps.

Any eps_i that keep this budget do. Those here make the zones small together: a region of a normal error at the scale
q = -2 ln eps_i about a body of radius r has about the area pi (r + g sqrt(q))^2, g^2 the root of the determinant of the
covariance. The sum of the areas is least where all futures give the same for a little more of the budget:

    eps_i = eps s_i / w_i,    s_i in proportion to g_i^2 + r g_i / sqrt(q_i),   sum_i s_i = 1,

taken at the q_i of the budget as a whole. So each future has a share s_i of the budget, an improbable one has a smaller
zone than a probable one, and one that is very uncertain has more of the budget than one that is known well. A future
whose weight is no more than its share needs no zone at all: it is left out, pays its weight, and what is left over of
its share goes to the others. A future that is known exactly costs nothing, and always has its zone, unless its weight
is 0.

*All obstacles together.* The level ``joint`` gives each of m obstacles the probability a = 1 - (1 - eps)^(1/m) to be
outside (`scp_planner.estimation.confidence`), which is safe for any dependence between normal errors. Which future an
obstacle takes is no normal error, and may well depend on what others do. So an obstacle of several futures gets

    b = a (1 - a)^(m - 1)

instead. With k obstacles of normal errors, all inside with probability at least (1 - a)^k, and f = m - k others, all
are inside with at least (1 - a)^k - f b, whatever depends on what. Since f a (1 - a)^(f - 1) <= 1 - (1 - a)^f, that is
at least (1 - a)^m = 1 - eps.
"""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError

LEAST_SHARE = 1e-9
"""Of the largest one. A future that is known far better than another still has a share that is a number."""


def alpha_of_mixture(level: str, alpha: float, obstacles: int) -> float:
    """Give the probability that an obstacle of several futures may be outside with; see the head of this module.

    Parameters
    ----------
    level : "per_time", "per_obstacle" or "joint"
    alpha : float
        Of an obstacle of one future: a.
    obstacles : int
        How many obstacles are not known exactly, m.

    Returns
    -------
    float
        b with ``joint``, else ``alpha``.
    """
    return alpha * (1.0 - alpha) ** (obstacles - 1) if level == "joint" else alpha


def sizes_of(spreads: Array, scales: Array, radius: float) -> Array:
    """Give what the areas of zones of futures gain by a little more of the budget, up to a common factor.

    Parameters
    ----------
    spreads : (n,) array
        Standard deviation g of each, m: the fourth root of the determinant of its covariance; 0 where known exactly.
    scales : (n,) array
        q of each with the budget as a whole.
    radius : float
        Of the body, m.

    Returns
    -------
    (n,) array
        m2.
    """
    return spreads * (spreads + radius / np.sqrt(scales))


def shared_risk(weights: Array, sizes: Array, alpha: float) -> Array:
    """Give the probability with which each future may be outside its zone; see the head of this module.

    Parameters
    ----------
    weights : (n,) array
        Probabilities of the futures; they add up to 1.
    sizes : (n,) array
        In proportion to which the budget is shared, see :func:`sizes_of`; 0 of a future that is known exactly.
    alpha : float
        The budget: the probability to be outside of all.

    Returns
    -------
    (n,) array
        eps_i: 0 where the future is known exactly, 1 where it is left out.

    Raises
    ------
    EstimationError
        If the budget is not between 0 and 1, or a number is negative or not finite.
    """
    if not 0.0 < alpha < 1.0:
        raise EstimationError(f"alpha: {alpha!r} is not between 0 and 1")
    for name, values in (("weights", weights), ("sizes", sizes)):
        if not np.all((values >= 0.0) & np.isfinite(values)):
            raise EstimationError(f"{name}: {values!r} are not all numbers >= 0")
    risk = np.where(weights > 0.0, 0.0, 1.0)
    shares = np.where(sizes > 0.0, np.maximum(sizes, LEAST_SHARE * sizes.max(initial=0.0)), 0.0)
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
