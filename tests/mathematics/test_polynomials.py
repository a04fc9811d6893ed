"""Batches of piecewise polynomials against their pieces."""

from __future__ import annotations

import math
from decimal import Context, Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_trips import (
    Array,
)
from scipy.integrate import quad
from scipy.interpolate import BSpline

from scp_planner.mathematics.bell_polynomials import complete_bell_polynomials
from scp_planner.mathematics.intervals import Interval
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.mathematics.quadrature import gauss_rule
from scp_planner.mathematics.refinement import highest
from scp_planner.mathematics.splines import antiderivative_control_points, clamped_basis, clamped_knots, evaluate
from scp_planner.mathematics.tolerances import DIGITS, to_digits

pytestmark = pytest.mark.numerics

RNG = np.random.default_rng(5)
LINE = PiecewisePolynomials(np.array([[0.0, 12.0]]), RNG.normal(size=(1, 1, 2, 2)))
CURVE = PiecewisePolynomials(np.array([[1.0, 3.0, 4.0, 12.0]]), RNG.normal(size=(1, 3, 4, 2)))


def test_stacking_changes_no_function_at_any_time() -> None:
    """Also before the first breakpoint and after the last one, whatever the number of pieces of the others."""
    both = PiecewisePolynomials.stack([LINE, CURVE])
    times = np.array([-3.0, 0.0, 0.5, 2.9, 3.0, 3.5, 4.0, 11.0, 12.0, 50.0])
    for index, single in enumerate((LINE, CURVE)):
        expected = single.at(np.zeros(len(times), dtype=int), times)
        np.testing.assert_array_equal(both.at(np.full(len(times), index), times), expected)
        np.testing.assert_allclose(both.grid(times)[:, index], expected, rtol=1e-13)


def test_another_clock_and_another_origin_show_the_same_motion() -> None:
    times = np.array([-2.0, 1.5, 8.0])
    index = np.zeros(3, dtype=int)
    np.testing.assert_allclose(LINE.shifted(5.0).at(index, times - 5.0), LINE.at(index, times), rtol=1e-13)
    np.testing.assert_allclose(LINE.rebased(4.0).at(index, times), LINE.at(index, times), rtol=1e-12)
    np.testing.assert_allclose(CURVE.rebased(4.0).at(index, times), CURVE.at(index, times), rtol=1e-12)


def test_grids_are_the_values_at_each_time_whether_breakpoints_are_shared_or_not() -> None:
    times = np.array([-1.0, 1.0, 2.9, 3.0, 3.5, 4.0, 30.0])
    alike = PiecewisePolynomials(np.repeat(CURVE.breakpoints, 3, axis=0), RNG.normal(size=(3, 3, 4, 2)))
    single = PiecewisePolynomials(np.array([[1.0, 5.0], [1.0, 9.0]]), RNG.normal(size=(2, 1, 3, 3)))
    for some in (alike, single, PiecewisePolynomials.stack([LINE, CURVE])):
        value, rate = some.grid_with_rate(times)
        np.testing.assert_allclose(some.grid(times), value, rtol=1e-12, atol=1e-12)
        for index in range(some.size):
            breaks = some.breakpoints[index, :-1]
            for row, time in enumerate(times):
                piece = max(int(np.sum(breaks <= time)) - 1, 0)
                polynomial = np.polynomial.Polynomial
                for axis, terms in enumerate(some.coefficients[index, piece].T):
                    expected = polynomial(terms)
                    elapsed = time - breaks[piece]
                    assert abs(value[row, index, axis] - expected(elapsed)) <= 1e-9 * (1.0 + abs(expected(elapsed)))
                    slope = expected.deriv()(elapsed)
                    assert abs(rate[row, index, axis] - slope) <= 1e-9 * (1.0 + abs(slope))


def test_taylor_coefficients_give_the_same_function() -> None:
    times, steps = np.array([1.2, 3.4, 8.0]), np.array([0.5, -0.2, 3.0])
    index = np.zeros(3, dtype=int)
    terms = CURVE.taylor(index, times)
    values = sum(terms[:, k] * steps[:, None] ** k for k in range(4))
    np.testing.assert_allclose(values, CURVE.at(index, times + steps), rtol=1e-10)


def test_size_bounds_hold_on_every_interval() -> None:
    rng = np.random.default_rng(2)
    breaks = np.array([[0.0, 1.0, 3.0, np.inf], [0.5, 2.0, np.inf, np.inf]])
    for width in (2, 3):
        coefficients = rng.normal(size=(2, 3, 4, width))
        coefficients[1, 2] = 0.0
        for some in (PiecewisePolynomials(breaks, coefficients), PiecewisePolynomials.single(0.3, coefficients[0, 0])):
            edges = np.linspace(0.2, 4.2, 41)  # all breakpoints are edges
            middle = 0.5 * (edges[1:] + edges[:-1])
            bounds = np.broadcast_to(some.of_pieces(some.size_bounds(0.2, 4.2), middle), (40, some.size))
            for share in (-0.999, -0.5, 0.0, 0.7, 0.999):
                values = some.grid(middle + share * 0.05)
                if width == 2:
                    sizes = np.hypot(values[..., 0], values[..., 1])
                else:
                    sizes = np.abs(np.linalg.eigvalsh(values[..., [0, 1, 1, 2]].reshape(40, -1, 2, 2))).max(axis=2)
                assert np.all(sizes <= bounds + 1e-12)


# Bell polynomials against derivatives by hand


def test_they_are_the_derivatives_of_an_exponential() -> None:
    x, y, z = np.array([0.7]), np.array([-1.3]), np.array([2.1])
    found = complete_bell_polynomials(x, y, z, 5)
    wanted = [
        1.0 + 0.0 * x,
        x,
        x**2 + y,
        x**3 + 3.0 * x * y + z,
        x**4 + 6.0 * x**2 * y + 4.0 * x * z + 3.0 * y**2,
        x**5 + 10.0 * x**3 * y + 10.0 * x**2 * z + 15.0 * x * y**2 + 10.0 * y * z,
    ]
    np.testing.assert_allclose(np.stack(found), np.stack(wanted), rtol=1e-14)


# The highest value of a piecewise polynomial against the roots of its derivative


def true_maximum(coefficients: np.ndarray) -> float:
    """The highest value at the ends of the pieces and where derivatives vanish, by numpy's roots."""
    found = []
    for piece in coefficients:
        polynomial = np.polynomial.Polynomial(piece)
        roots = polynomial.deriv().roots()
        inside = roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 0.0) & (roots.real < 1.0)]
        found.append(polynomial(np.concatenate([[0.0, 1.0], inside])).max())
    return float(max(found))


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_what_holds_by_a_millionth_is_found_to_hold(seed: int, size: int) -> None:
    coefficients = np.random.default_rng([seed, size]).normal(size=(7, size))
    top = true_maximum(coefficients)
    width = 1e-6 * max(abs(top), 1.0)
    kept, broken = highest(coefficients, top + width), highest(coefficients, top - width)
    assert kept.kept
    assert top - 1e-12 <= kept.value <= top + width
    assert not broken.kept
    assert broken.value == pytest.approx(top, abs=2.0 * width + 1e-3 * abs(top))
    value = np.polynomial.polynomial.polyval(broken.local, coefficients[broken.piece])
    assert value == pytest.approx(broken.value, abs=1e-9)
    assert value > top - width


def test_a_value_that_is_no_number_keeps_nothing() -> None:
    assert not highest(np.array([[0.0, np.nan]]), 1.0).kept


# Gauss' rules against integrals in closed form


@pytest.mark.parametrize("count", [1, 2, 6, 12])
def test_polynomials_are_integrated_exactly_up_to_twice_as_many_as_nodes(count: int) -> None:
    rule = gauss_rule(count)
    for power in range(2 * count):
        expected = 0.0 if power % 2 else 2.0 / (power + 1)
        assert rule.weights @ rule.nodes**power == pytest.approx(expected, abs=1e-13)
    beyond = 2 * count
    assert rule.weights @ rule.nodes**beyond < 2.0 / (beyond + 1) - 1e-9


# The bases against scipy's splines, at random breakpoints and parameters

UNEVEN = (0.0, 0.07, 0.31, 0.5, 0.86, 1.0)
EVEN = tuple(np.linspace(0.0, 1.0, 9).tolist())


@pytest.mark.parametrize("breaks", [UNEVEN, EVEN])
@pytest.mark.parametrize("degree", range(6))
def test_values_and_derivatives_are_those_of_scipy(degree: int, breaks: tuple[float, ...]) -> None:
    basis = clamped_basis(degree, breaks)
    reference = BSpline(clamped_knots(degree, np.array(breaks)), np.eye(basis.size), degree)
    x = np.random.default_rng(0).uniform(0.0, 1.0, 400)
    order = basis
    for derivative in range(degree + 1):
        scale = max(1.0, np.abs(reference(x, nu=derivative)).max())
        np.testing.assert_allclose(order.rows(x) / scale, reference(x, nu=derivative) / scale, atol=1e-12)
        order = order.derivative


@pytest.mark.parametrize("breaks", [UNEVEN, EVEN])
@pytest.mark.parametrize("degree", range(6))
def test_values_without_zeros_are_all_that_there_are(degree: int, breaks: tuple[float, ...]) -> None:
    basis = clamped_basis(degree, breaks)
    x = np.array([*breaks, *np.random.default_rng(1).uniform(0.0, 1.0, 50)])
    rows = np.zeros((len(x), basis.size))
    for index, value in basis.weights_at(*basis.locate(x)):
        rows[np.arange(len(x)), index] = value
    np.testing.assert_allclose(rows, basis.rows(x), rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("degree", range(3))
def test_antiderivatives_are_integrals(degree: int) -> None:
    basis = clamped_basis(degree, UNEVEN)
    weights = np.random.default_rng(1).normal(size=basis.size)
    for end in (0.2, 0.5, 0.77, 1.0):
        exact = quad(lambda s: basis.rows(np.array([s]))[0] @ weights, 0.0, end, points=UNEVEN[1:-1], limit=200)[0]
        assert basis.antiderivative.rows(np.array([end]))[0] @ weights == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize("degree", range(3))
def test_control_points_of_the_antiderivative_bound_it(degree: int) -> None:
    basis = clamped_basis(degree, UNEVEN)
    weights = np.random.default_rng(2).normal(size=basis.size)
    points = antiderivative_control_points(degree, UNEVEN) @ weights
    values = basis.antiderivative.rows(np.linspace(0.0, 1.0, 5001)) @ weights
    assert points.min() - 1e-12 <= values.min()
    assert values.max() <= points.max() + 1e-12
    raised = BSpline(clamped_knots(degree + 1, np.array(UNEVEN)), points, degree + 1)
    np.testing.assert_allclose(values, raised(np.linspace(0.0, 1.0, 5001)), atol=1e-12)


def test_a_combined_spline_is_the_weighted_sum() -> None:
    basis = clamped_basis(3, UNEVEN)
    weights = np.random.default_rng(3).normal(size=basis.size)
    x = np.linspace(0.0, 1.0, 101)
    span, local = basis.locate(x)
    np.testing.assert_allclose(evaluate(basis.combine(weights), span, local), basis.rows(x) @ weights, atol=1e-13)


# Limits with as many digits as count


def test_digits_are_those_of_decimal_arithmetic() -> None:
    rng = np.random.default_rng(8)
    for value in (rng.normal(size=50) * 10.0 ** rng.integers(-9, 9, 50)).tolist():
        assert to_digits(value) == float(Context(prec=DIGITS).create_decimal(Decimal(value)))
        assert to_digits(to_digits(value)) == to_digits(value)
    assert to_digits(math.inf) == math.inf and to_digits(0.0) == 0.0


# Interval arithmetic encloses what numbers give


@st.composite
def intervals(draw: st.DrawFn) -> tuple[Interval, Array]:
    """Intervals and points in them, both ends among them."""
    number = st.floats(-1e3, 1e3, allow_nan=False, width=32)
    ends = np.sort(np.array(draw(st.lists(st.tuples(number, number), min_size=3, max_size=3))), axis=1)
    share = np.array([0.0, 1.0, *draw(st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3))])
    inside = ends[:, :1] + share * (ends[:, 1:] - ends[:, :1])
    return Interval(ends[:, 0], ends[:, 1]), np.clip(inside, ends[:, :1], ends[:, 1:])


def encloses(interval: Interval, values: Array) -> bool:
    room = 1e-12 * (1.0 + np.abs(values))
    return bool(np.all(values >= interval.lower[:, None] - room) and np.all(values <= interval.upper[:, None] + room))


@given(intervals(), intervals(), st.floats(-100.0, 100.0))
def test_interval_arithmetic_encloses(
    first: tuple[Interval, Array], second: tuple[Interval, Array], factor: float
) -> None:
    (a, x), (b, y) = first, second
    for k in range(x.shape[1]):
        other = np.roll(y, k, axis=1)
        assert encloses(a + b, x + other)
        assert encloses(a - b, x - other)
        assert encloses(a * b, x * other)
    assert encloses(-a, -x)
    assert encloses(a.scaled(factor), factor * x)
    assert encloses(a.squared(), x * x)
    assert np.all(a.squared().lower >= 0.0)
    assert encloses(Interval(np.zeros(3), a.magnitude()), np.abs(x))
    around = Interval.around(0.5 * (a.lower + a.upper), 0.5 * (a.upper - a.lower))
    assert encloses(around, x)
    positive, z = Interval(np.abs(a.lower) + 0.1, np.abs(a.lower) + 0.1 + (a.upper - a.lower)), x - a.lower[:, None]
    for exponent in (-1.0, -3.0, -5.0):
        assert encloses(positive.power(exponent), (positive.lower[:, None] + z) ** exponent)
