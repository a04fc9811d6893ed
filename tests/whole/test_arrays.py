"""The product of vectors in the plane."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import cross


def test_cross_product_is_the_determinant() -> None:
    one, two = np.random.default_rng(3).normal(size=(2, 4, 5, 2))
    assert np.allclose(cross(one, two), np.linalg.det(np.stack([one, two], axis=-1)), rtol=0.0, atol=1e-12)
    assert cross(np.array([1.0, 0.0]), np.array([0.0, 2.0])) == 2.0
