from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import observed, scene
from scipy import integrate, optimize, stats

from scp_planner.errors import EstimationError
from scp_planner.tracking.confidence import (
    LEVELS,
    ErrorLaw,
    HotellingErrors,
    NormalErrors,
    StudentErrors,
    alpha_of_mixture,
    excursion_bound,
    shared_alpha,
    shared_risk,
    sizes_of,
    uniform_scale,
)
from scp_planner.tracking.estimate import estimate_obstacle
from scp_planner.tracking.maximum_likelihood import estimate_motion
from scp_planner.tracking.motion_estimate import MotionEstimate, region_scale

pytestmark = pytest.mark.numerics

LAWS: list[ErrorLaw] = [
    NormalErrors(),
    HotellingErrors(2),
    HotellingErrors(7),
    HotellingErrors(4.5),
    StudentErrors(3.3),
    StudentErrors(40),
]


def estimate(order: int = 2, known: bool = True, count: int = 12) -> MotionEstimate:
    rng = np.random.default_rng(3)
    times = 0.1 * np.arange(count)
    return estimate_motion(times, rng.normal(size=(count, 2)), np.eye(2) if known else None, order)


@pytest.mark.parametrize("alpha", [0.5, 0.1, 0.05, 1e-6])
def test_pointwise_scales_are_the_textbook_quantiles(alpha: float) -> None:
    assert NormalErrors().pointwise_scale(alpha) == pytest.approx(stats.chi2.isf(alpha, 2), rel=1e-12)
    for n, p in ((6, 3), (10, 3), (40, 2)):  # the form of the published method, with n observations
        quantile = 2 * (n - p) / (n - p - 1) * stats.f.isf(alpha, 2, n - p - 1)
        assert HotellingErrors(n - p).pointwise_scale(alpha) == pytest.approx(quantile, rel=1e-9)
    assert StudentErrors(5).pointwise_scale(alpha) == pytest.approx(2 * stats.f.isf(alpha, 2, 5), rel=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("alpha", [0.5, 0.05, 1e-4])
def test_exceedance_undoes_the_pointwise_scale(law: ErrorLaw, alpha: float) -> None:
    assert law.exceedance(law.pointwise_scale(alpha)) == pytest.approx(alpha, rel=1e-12)


@pytest.mark.parametrize("regressors", [1, 2, 3])
def test_largest_eigenvalue_of_a_wishart_matrix(regressors: int) -> None:
    """The joint density of the eigenvalues, integrated."""
    a = 0.5 * (regressors - 3)

    def tail(q: float) -> float:
        if regressors == 1:
            return float(stats.chi2.sf(q, 2))

        def density(small: float, large: float) -> float:
            # small = s^2: takes the root singularity at 0 out for two regressors
            return 2.0 * small * (small**2 * large) ** a * math.exp(-0.5 * (small**2 + large)) * (large - small**2)

        above = integrate.dblquad(density, q, 120.0, 0.0, lambda large: math.sqrt(large))[0]
        whole = integrate.dblquad(density, 0.0, 120.0, 0.0, lambda large: math.sqrt(large))[0]
        return above / whole

    for q in (0.7, 6.0, 15.0):
        assert NormalErrors().largest_root_exceedance(q, regressors) == pytest.approx(tail(q), rel=1e-6)


@pytest.mark.parametrize("regressors", [1, 2, 3])
@pytest.mark.parametrize("degrees", [3, 9])
def test_largest_root_of_roy_by_simulation(regressors: int, degrees: int) -> None:
    rng = np.random.default_rng([regressors, degrees])
    runs = 40_000
    h, e = rng.normal(size=(runs, regressors, 2)), rng.normal(size=(runs, degrees, 2))
    h, e = np.swapaxes(h, 1, 2) @ h, np.swapaxes(e, 1, 2) @ e
    roots = degrees * np.linalg.eigvals(np.linalg.solve(e, h)).real.max(axis=1)
    law = HotellingErrors(degrees)
    for level in (0.5, 0.9, 0.97):
        q = float(np.quantile(roots, level))
        error = math.sqrt(level * (1 - level) / runs)
        assert law.largest_root_exceedance(q, regressors) == pytest.approx(1 - level, abs=4 * error)


@cache
def smallest_roots(law: ErrorLaw) -> np.ndarray:
    """Simulated, of two regressors, (200,000,)."""
    rng = np.random.default_rng(5)
    runs = 200_000
    h = rng.normal(size=(runs, 2, 2))
    if isinstance(law, HotellingErrors):
        e = rng.normal(size=(runs, int(law.degrees_of_freedom), 2))
        root = np.linalg.cholesky(np.swapaxes(e, 1, 2) @ e / law.degrees_of_freedom)
        h = np.linalg.solve(root, h)
    return np.asarray(np.linalg.svd(h, compute_uv=False)[:, -1] ** 2)


@pytest.mark.parametrize("q", [2.0, 6.0, 25.0])
@pytest.mark.parametrize("law", [NormalErrors(), HotellingErrors(4), HotellingErrors(15)])
def test_exits_of_a_straight_line_make_up_the_largest_root(law: ErrorLaw, q: float) -> None:
    """Two regressors, all times: the level curve is crossed once upwards, except if it is exceeded everywhere.

    So P(largest root > q) = pi * exit rate + P(smallest root > q); the latter is simulated.
    """
    smallest = smallest_roots(law)
    runs = len(smallest)
    everywhere = float(np.mean(smallest > q))
    expected = math.pi * law.exit_rate(q) + everywhere
    error = math.sqrt(max(everywhere, 1 / runs) / runs)
    assert law.largest_root_exceedance(q, 2) == pytest.approx(expected, abs=4 * error)


@pytest.mark.parametrize("q", [1.0, 6.0, 30.0])
def test_student_laws_average_the_normal_one(q: float) -> None:
    nu = 4.2
    normal, student = NormalErrors(), StudentErrors(nu)
    for of in ("exceedance", "exit_rate"):
        average = integrate.quad(lambda s, of=of: getattr(normal, of)(q * s / nu) * stats.chi2.pdf(s, nu), 0, 200)[0]
        assert getattr(student, of)(q) == pytest.approx(average, rel=1e-7)


@given(st.floats(1e-9, 0.5), st.integers(1, 500))
def test_shares_of_alpha_multiply_to_the_whole(alpha: float, obstacles: int) -> None:
    each = shared_alpha(alpha, obstacles)
    assert alpha / obstacles <= each * (1 + 1e-12)  # never less than Bonferroni's
    assert -math.expm1(obstacles * math.log1p(-each)) == pytest.approx(alpha, rel=1e-9)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("probability", [5e-324, 1e-300, 1e-17, 1e-9])
def test_a_region_of_hardly_any_probability_is_small(level: str, probability: float) -> None:
    scenario = scene(observed("seen", 3))
    scale = region_scale(level, probability, estimate_obstacle(scenario.obstacles[0]), obstacles=4, start=0.0, stop=5.0)
    assert 0.0 < scale < region_scale(level, 0.5, estimate_obstacle(scenario.obstacles[0]), start=0.0, stop=5.0)


@given(st.sampled_from(LAWS), st.floats(1e-5, 0.4), st.floats(0.0, 20.0))
def test_uniform_scale_solves_its_equation(law: ErrorLaw, alpha: float, length: float) -> None:
    scale = uniform_scale(alpha, length, law)
    assert scale >= law.pointwise_scale(alpha)
    if length == 0.0:
        assert scale == law.pointwise_scale(alpha)
    elif scale > law.pointwise_scale(alpha):
        assert excursion_bound(scale, length, law) == pytest.approx(alpha, rel=1e-9)


def test_no_more_than_the_largest_root_is_asked_for() -> None:
    """A straight line over all times meets every regressor: the largest root is exact, and less than the bound."""
    law = NormalErrors()
    scale = uniform_scale(0.05, math.pi, law, regressors=2)
    assert scale < uniform_scale(0.05, math.pi, law)
    assert law.largest_root_exceedance(scale, 2) == pytest.approx(0.05, rel=1e-9)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_stronger_promises_need_larger_regions(order: int, known: bool) -> None:
    seen = estimate(order, known)
    scales = [region_scale(level, 0.95, seen, obstacles=5, start=1.1) for level in LEVELS]
    assert scales == sorted(scales)
    assert (scales[0] == scales[1]) is (order == 0)  # one and the same error at all times
    assert region_scale("joint", 0.95, seen, obstacles=1, start=1.1) == scales[1]
    assert region_scale("per_obstacle", 0.95, seen, start=1.1, stop=2.0) <= scales[1]
    assert region_scale("per_obstacle", 0.95, seen) >= scales[1]


def test_one_exact_case() -> None:
    """Figures that a reader can check: chi-square, and 5 obstacles by Sidak."""
    seen = estimate(0)
    assert region_scale("per_time", 0.95, seen) == pytest.approx(5.991464547, rel=1e-9)
    each = stats.chi2.ppf(0.95**0.2, 2)
    assert region_scale("joint", 0.95, seen, obstacles=5) == pytest.approx(each, rel=1e-9)


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

    best = min(
        optimize.minimize(area, start, method="Nelder-Mead").fun for start in (np.zeros(count), rng.normal(size=count))
    )
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
    ("call", "message"),
    [
        (
            lambda: region_scale("sometimes", 0.95, estimate()),
            "'sometimes' is not one of per_time, per_obstacle, joint",
        ),
        (lambda: region_scale("joint", 1.0, estimate()), "probability: 1.0 is not between 0 and 1"),
        (lambda: region_scale("joint", math.nan, estimate()), "probability: nan"),
        (lambda: region_scale("joint", 0.95, estimate(), obstacles=0), "obstacles: 0 is not a positive number"),
        (lambda: region_scale("joint", 0.95, estimate(), start=2, stop=1), "start 2 is after"),
        (lambda: HotellingErrors(1), "at least 2 are needed"),
        (lambda: StudentErrors(0), "degrees of freedom: 0"),
        (lambda: uniform_scale(0.05, math.nan, NormalErrors()), "length: nan"),
        (lambda: uniform_scale(0.05, math.inf, NormalErrors()), "unbounded"),
        (lambda: shared_risk(np.array([0.5, np.nan]), np.ones(2), 0.05), "weights"),
        (lambda: shared_risk(np.array([0.5, 0.5]), np.array([1.0, -1.0]), 0.05), "sizes"),
        (lambda: shared_risk(np.ones(1), np.ones(1), 1.0), "alpha"),
    ],
)
def test_misuse_is_named(call: Callable[[], object], message: str) -> None:
    with pytest.raises(EstimationError, match=message):
        call()
