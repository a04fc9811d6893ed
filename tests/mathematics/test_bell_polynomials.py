"""Bell polynomials against derivatives by hand."""

from __future__ import annotations

import numpy as np

from scp_planner.mathematics.bell_polynomials import complete_bell_polynomials


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
