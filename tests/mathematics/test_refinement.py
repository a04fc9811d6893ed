"""The highest value of a piecewise polynomial against the roots of its derivative."""

from __future__ import annotations

import numpy as np
import pytest

from scp_planner.mathematics.refinement import highest


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
