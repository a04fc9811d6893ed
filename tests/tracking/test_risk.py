"""The budget of several futures is kept, spent, and spent well."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from scp_planner.errors import EstimationError
from scp_planner.tracking.confidence import alpha_of_mixture, shared_risk, sizes_of

SIZES = st.floats(1e-6, 1e6) | st.just(0.0)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.0, 1.0), SIZES), min_size=1, max_size=8).filter(
        lambda some: sum(one[0] for one in some) > 0.1
    ),
    st.floats(1e-6, 0.5),
)
def test_the_budget_is_kept_and_all_of_it_is_spent(some: list[tuple[float, float]], alpha: float) -> None:
    weights, sizes = (np.array(column) for column in zip(*some, strict=True))
    weights /= weights.sum()
    risk = shared_risk(weights, sizes, alpha)
    assert np.all((risk >= 0.0) & (risk <= 1.0))
    spent = float(weights @ risk)
    assert spent <= alpha * (1.0 + 1e-12)
    shared = (risk > 0.0) & (risk < 1.0)
    if shared.any():
        assert spent == pytest.approx(alpha, rel=1e-9)
    # What is known exactly is left out only if it cannot be.
    assert np.all((risk == 0.0) == ((sizes == 0.0) & (weights > 0.0)))


def test_equal_futures_share_equally_and_an_improbable_one_may_be_left_out() -> None:
    alike = np.ones(2)
    assert shared_risk(np.array([0.5, 0.5]), alike, 0.05) == pytest.approx([0.05, 0.05], rel=1e-12)
    assert shared_risk(np.array([0.9, 0.1]), alike, 0.05) == pytest.approx([0.025 / 0.9, 0.25], rel=1e-12)
    # 0.02 is no more than half of 0.05: it pays 0.02, and 0.03 are left for the other.
    assert shared_risk(np.array([0.98, 0.02]), alike, 0.05) == pytest.approx([0.03 / 0.98, 1.0], rel=1e-12)
    assert shared_risk(np.array([0.98, 0.02]), np.array([1.0, 0.0]), 0.05) == pytest.approx([0.05 / 0.98, 0.0])
    assert list(shared_risk(np.array([1.0, 0.0]), np.zeros(2), 0.05)) == [0.0, 1.0]


def areas(risk: np.ndarray, spreads: np.ndarray, radius: float) -> float:
    """Area of discs grown by regions at one time; of those that are left out none."""
    grown = radius + spreads * np.sqrt(np.maximum(-2.0 * np.log(np.minimum(risk, 1.0)), 0.0))
    return float(np.pi * (grown[risk < 1.0] ** 2).sum())


@pytest.mark.parametrize("seed", range(6))
def test_no_other_way_to_share_makes_the_zones_much_smaller(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count, radius, alpha = 3, 0.4, 0.05
    weights = np.full(count, 0.15) + 0.55 * rng.dirichlet(np.ones(count))
    spreads = np.exp(rng.normal(-1.5, 0.8, count))
    scales = np.full(count, -2.0 * np.log(alpha))
    risk = shared_risk(weights, sizes_of(spreads, scales, radius), alpha)

    def area(free: np.ndarray) -> float:
        share = np.exp(free - free.max())
        other = alpha * share / share.sum() / weights
        return areas(np.minimum(other, 1.0 - 1e-12), spreads, radius)

    best = min(minimize(area, start, method="Nelder-Mead").fun for start in (np.zeros(count), rng.normal(size=count)))
    assert areas(risk, spreads, radius) <= 1.02 * best
    assert areas(risk, spreads, radius) <= areas(np.full(count, alpha), spreads, radius)


@pytest.mark.parametrize(("normal", "others"), [(0, 1), (0, 4), (3, 1), (3, 4), (40, 2)])
def test_mixtures_beside_others_keep_the_joint_level_whatever_depends_on_what(normal: int, others: int) -> None:
    everybody, level = normal + others, 0.95
    alone = 1.0 - level ** (1.0 / everybody)
    mixture = alpha_of_mixture("joint", alone, everybody)
    # Normal errors as Royen's inequality bounds them, the others by Boole's.
    assert (1.0 - alone) ** normal - others * mixture >= level - 1e-12
    assert 0.9 * alone <= mixture <= alone
    assert alpha_of_mixture("per_obstacle", alone, everybody) == alone


@pytest.mark.parametrize(
    ("weights", "sizes", "alpha", "named"),
    [([0.5, np.nan], [1, 1], 0.05, "weights"), ([0.5, 0.5], [1, -1], 0.05, "sizes"), ([1.0], [1], 1.0, "alpha")],
)
def test_what_is_no_budget_is_refused(weights: list[float], sizes: list[float], alpha: float, named: str) -> None:
    with pytest.raises(EstimationError, match=named):
        shared_risk(np.array(weights), np.array(sizes, dtype=float), alpha)
