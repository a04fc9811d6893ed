"""The bases against scipy's splines, at random breakpoints and parameters."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import BSpline

from scp_planner.mathematics.splines import antiderivative_control_points, clamped_basis, clamped_knots, evaluate

pytestmark = pytest.mark.numerics

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
