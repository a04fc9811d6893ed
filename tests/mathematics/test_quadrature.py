"""Gauss' rules against integrals in closed form."""

from __future__ import annotations

import pytest

from scp_planner.mathematics.quadrature import gauss_rule

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize("count", [1, 2, 6, 12])
def test_polynomials_are_integrated_exactly_up_to_twice_as_many_as_nodes(count: int) -> None:
    rule = gauss_rule(count)
    for power in range(2 * count):
        expected = 0.0 if power % 2 else 2.0 / (power + 1)
        assert rule.weights @ rule.nodes**power == pytest.approx(expected, abs=1e-13)
    beyond = 2 * count
    assert rule.weights @ rule.nodes**beyond < 2.0 / (beyond + 1) - 1e-9
