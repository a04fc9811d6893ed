"""Batches of piecewise polynomials against their pieces."""

from __future__ import annotations

import numpy as np
import pytest

from scp_planner.mathematics.polynomials import PiecewisePolynomials

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


def test_values_are_those_of_the_piece_that_a_time_lies_in() -> None:
    for time, piece, begin in ((0.0, 0, 1.0), (2.0, 0, 1.0), (3.0, 1, 3.0), (3.9, 1, 3.0), (20.0, 2, 4.0)):
        powers = (time - begin) ** np.arange(4)
        np.testing.assert_allclose(
            CURVE.at(np.array([0]), np.array([time]))[0], powers @ CURVE.coefficients[0, piece], rtol=1e-12
        )


def test_derivatives_are_difference_quotients() -> None:
    times = np.array([0.2, 2.0, 3.3, 7.0])
    index = np.zeros(4, dtype=int)
    step = 1e-6
    quotient = (CURVE.at(index, times + step) - CURVE.at(index, times - step)) / (2 * step)
    np.testing.assert_allclose(CURVE.derivative.at(index, times), quotient, rtol=1e-6, atol=1e-6)
    constant = PiecewisePolynomials.single(0.0, np.array([[1.0, 2.0]]))
    assert not constant.derivative.at(index, times).any()


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
