"""Batches of piecewise polynomials against their pieces."""

from __future__ import annotations

import numpy as np

from scp_planner.polynomials import PiecewisePolynomials

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
