"""Arguments of a planner, checked before anything is done with them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array


def _point(name: str, value: ArrayLike) -> tuple[float, float]:
    try:
        point = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: {value!r} is not a point [x, y]") from None
    if point.shape != (2,) or not np.isfinite(point).all():
        raise ValueError(f"{name}: {value!r} is not a point [x, y] of finite numbers")
    return float(point[0]), float(point[1])


def _covariance(value: ArrayLike) -> Array:
    from scp_planner.estimation.observations import check_covariance

    return np.asarray(check_covariance(value, 1).reshape(2, 2), dtype=float)


def check_number(name: str, value: float, least: float = -math.inf) -> None:
    """Refuse what is no finite number, or too small.

    Parameters
    ----------
    name : str
        What the message calls it.
    value : float
    least : float

    Raises
    ------
    ValueError
        Naming the value.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
        raise ValueError(f"{name}: {value!r} is not a finite number")
    if value < least:
        raise ValueError(f"{name}: {value!r} is less than {least:g}")
