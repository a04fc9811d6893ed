"""Where the next observations of many obstacles are expected: polynomials of the time since a moment."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.estimation.motion_estimate import POLYNOMIAL_TERMS

_CENTER_TERMS, _COVARIANCE_TERMS = POLYNOMIAL_TERMS, POLYNOMIAL_TERMS + 1  # random walks have one more


class Foretold:
    """Predictions of K obstacles, each in a slot of its own.

    Attributes
    ----------
    known : (K,) bool
        Of whom there is one.
    """

    def __init__(self) -> None:
        self.known = np.zeros(0, dtype=bool)
        self._origin = np.zeros(0)
        self._center = np.zeros((0, _CENTER_TERMS, 2))
        self._covariance = np.zeros((0, _COVARIANCE_TERMS, 3))

    def grow(self, size: int) -> None:
        """Make room for so many in all."""
        for name, value in vars(self).items():
            setattr(self, name, longer(value, size))

    def put(self, slots: Index, origin: float, center: Array, covariance: Array) -> None:
        """Take in predictions.

        Parameters
        ----------
        slots : (n,)
        origin : float
            s.
        center : (n, P, 2) m
        covariance : (n, Q, 3) m^2
            Elements xx, xy, yy. Not scaled, and without the noise of what is seen.
        """
        self.known[slots], self._origin[slots] = True, origin
        for held, given in ((self._center, center), (self._covariance, covariance)):
            held[slots] = 0.0
            held[slots, : given.shape[1]] = given

    def squares(self, slots: Index, times: Array, positions: Array, noise: Array) -> Array:
        """Squared standardised errors of what is seen, (n,).

        Parameters
        ----------
        slots : (n,)
        times : (n,) s
        positions : (n, 2) m
        noise : (n, 2, 2) m^2

        Returns
        -------
        (n,)
            0 where there is no prediction, or where the polynomial is no covariance, far from its origin.
        """
        lag = (times - self._origin[slots])[:, None]
        x, y = (positions - _at(self._center[slots], lag)).T
        xx, xy, yy = (_at(self._covariance[slots], lag) + noise[:, [0, 0, 1], [0, 1, 1]]).T
        determinant = xx * yy - xy * xy
        sound = self.known[slots] & (determinant > 0.0) & (xx > 0.0)
        squares = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / np.where(sound, determinant, 1.0)
        return np.where(sound, squares, 0.0)


def longer(array: Array, size: int, axis: int = 0) -> Array:
    """A copy of an array that has a size along an axis, with zeros at the end."""
    shape = list(array.shape)
    old, shape[axis] = shape[axis], size
    grown = np.zeros(shape, dtype=array.dtype)
    np.moveaxis(grown, axis, 0)[:old] = np.moveaxis(array, axis, 0)
    return grown


def _at(coefficients: Array, lag: Array) -> Array:
    """Values of polynomials (n, terms, sides) at times (n, 1), (n, sides)."""
    value = coefficients[:, -1]
    for power in range(coefficients.shape[1] - 2, -1, -1):
        value = value * lag + coefficients[:, power]
    return value
