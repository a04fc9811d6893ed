"""Limits with as many digits as count."""

from __future__ import annotations

import math
from decimal import Context, Decimal

import numpy as np

from scp_planner.mathematics.tolerances import DIGITS, to_digits


def test_digits_are_those_of_decimal_arithmetic() -> None:
    rng = np.random.default_rng(8)
    for value in (rng.normal(size=50) * 10.0 ** rng.integers(-9, 9, 50)).tolist():
        assert to_digits(value) == float(Context(prec=DIGITS).create_decimal(Decimal(value)))
        assert to_digits(to_digits(value)) == to_digits(value)
    assert to_digits(math.inf) == math.inf and to_digits(0.0) == 0.0
