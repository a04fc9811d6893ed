"""Where the next observations of obstacles are expected: polynomials of the time since a moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.estimation.error_laws import ErrorLaw
from scp_planner.estimation.motion_estimate import POLYNOMIAL_TERMS
from scp_planner.mathematics.polynomials import PiecewisePolynomials

_CENTER_TERMS, _COVARIANCE_TERMS = POLYNOMIAL_TERMS, POLYNOMIAL_TERMS + 1  # random walks have one more


@dataclass(frozen=True)
class Later:
    """What is predicted of times that are not near, where one polynomial does not do, of absolute time.

    Attributes
    ----------
    centers, covariances : PiecewisePolynomials
        Of one obstacle.
    """

    centers: PiecewisePolynomials
    covariances: PiecewisePolynomials


@dataclass(frozen=True)
class Prediction:
    """An estimate as one polynomial each of time since an origin, to gate observations with.

    Attributes
    ----------
    origin : float
        s.
    center : (P, 2) array
    covariance : (P, 3) array
        Not scaled.
    errors : ErrorLaw
    later : Later or None
        For predictions of times far ahead, where the polynomials are only for what is seen next.
    """

    origin: float
    center: Array
    covariance: Array
    errors: ErrorLaw
    later: Later | None = None

    def at(self, time: float) -> tuple[Array, Array]:
        """Where it is expected at a time from the origin on, (2,) m, and the covariance's elements, (3,) m^2."""
        if self.later is not None:
            return self.later.centers.grid(np.array([time]))[0, 0], self.later.covariances.grid(np.array([time]))[0, 0]
        return self._soon(time)

    def _soon(self, time: float) -> tuple[Array, Array]:
        """The same by the polynomials."""
        powers = (time - self.origin) ** np.arange(max(len(self.center), len(self.covariance)))
        return powers[: len(self.center)] @ self.center, powers[: len(self.covariance)] @ self.covariance

    def exceedance(self, time: float, position: tuple[float, float], noise: Array) -> float:
        """Probability to see something as far away as a position, or farther, at a time."""
        square = self.square(time, position, noise)
        return 1.0 if square is None else self.errors.exceedance(square)

    def square(self, time: float, position: tuple[float, float], noise: Array) -> float | None:
        """Squared standardised error of a position that is seen at a time with noise (2, 2), m^2."""
        center, covariance = self._soon(time)
        x, y = np.asarray(position) - center
        xx, xy, yy = covariance + noise[[0, 0, 1], [0, 1, 1]]
        determinant = xx * yy - xy * xy
        if determinant <= 0.0 or xx <= 0.0:
            return None  # far from its origin, as for what comes very late, the polynomial is no covariance
        return float((yy * x * x - 2.0 * xy * x * y + xx * y * y) / determinant)


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
        self._center = np.zeros((_CENTER_TERMS, 2, 0))
        self._covariance = np.zeros((_COVARIANCE_TERMS, 3, 0))

    def grow(self, size: int) -> None:
        """Make room for so many in all."""
        for name, value in vars(self).items():
            setattr(self, name, longer(value, size, -1))

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
            held[..., slots] = 0.0
            held[: given.shape[1], :, slots] = given.transpose(1, 2, 0)

    def squares(self, slots: Index | slice, times: Array, positions: Array, noise: Array) -> Array:
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
        lag = times - self._origin[slots]
        x, y = positions.T - _at(self._center[..., slots], lag)
        xx, xy, yy = _at(self._covariance[..., slots], lag) + noise[:, [0, 0, 1], [0, 1, 1]].T
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
    """Values of polynomials (terms, sides, n) at times (n,), (sides, n)."""
    terms = len(coefficients)
    if len(lag) and (lag == lag[0]).all():  # as in a frame: one product of matrices then does it
        powers = lag[0] ** np.arange(terms)
        return np.asarray((powers @ coefficients.reshape(terms, -1)).reshape(coefficients.shape[1:]))
    values = coefficients[-1].copy()
    for part in coefficients[-2::-1]:
        values *= lag
        values += part
    return values
