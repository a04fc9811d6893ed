"""Arguments of a planner, checked before anything is done with them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.files import LARGEST_COORDINATE
from scp_planner.online.covariances import repaired, square_matrix
from scp_planner.online.tolerances import RELATIVE
from scp_planner.scenario.estimates import Estimate
from scp_planner.scenario.models import Obstacle
from scp_planner.scenario.motions import GivenMotion
from scp_planner.units import Units


class OutOfRangeError(ValueError):
    """A finite number beyond what scenarios may hold: no misuse, but what a faulty sensor may say."""


def _point(name: str, value: ArrayLike) -> tuple[float, float]:
    try:
        point = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: {value!r} is not a point [x, y]") from None
    if point.shape != (2,) or not np.isfinite(point).all():
        raise ValueError(f"{name}: {value!r} is not a point [x, y] of finite numbers")
    x, y = float(point[0]), float(point[1])
    check_number(name, x)
    check_number(name, y)
    return x, y


def checked_covariance(value: ArrayLike, units: Units, rates: int = 0) -> Array:
    """Check and repair a covariance, in SI units, of a position and of so many of its derivatives in time."""
    matrix = square_matrix(value, 2 * (rates + 1))
    for entry in matrix.ravel().tolist():
        check_number("covariance", entry)
    return repaired(matrix, (units.length, units.speed, units.acceleration)[: rates + 1])


def checked_estimate(
    time: float,
    position: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike | None,
    covariance: ArrayLike,
    units: Units,
) -> Estimate:
    """Make what a tracker says of its parts, in SI units."""
    check_number("time", time)
    rates = [_point("velocity", velocity)]
    if acceleration is not None:
        rates.append(_point("acceleration", acceleration))
    return Estimate(
        time=float(time),
        position=_point("position", position),
        velocity=rates[0],
        acceleration=None if acceleration is None else rates[1],
        covariance=checked_covariance(covariance, units, len(rates)).tolist(),
    )


def checked_motion(name: str, motion: GivenMotion | Mapping[str, Any]) -> GivenMotion:
    """Make what a predictor says of an obstacle a motion, in SI units."""
    anybody = {"id": name, "shape": {"disc": 1.0}, "motion": motion}
    checked = Obstacle(**anybody).motion
    assert checked is not None, "it is given"
    return checked


def speeding(speed: float, limit: float) -> str | None:
    """Report a speed of the vehicle above its limit, m/s: it is planned from as it is, and brakes at first."""
    if speed <= limit * (1.0 + RELATIVE):
        return None
    return f"the vehicle drives at {speed:.4g} m/s, {100.0 * (speed / limit - 1.0):.2g} % above its limit"


def check_number(name: str, value: float, least: float = -math.inf) -> None:
    """Refuse what is no finite number, too small, or beyond what scenarios may hold."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise ValueError(f"{name}: {value!r} is not a finite number")
    if value != value or value in (math.inf, -math.inf):
        raise ValueError(f"{name}: {value!r} is not a finite number")
    if abs(value) > LARGEST_COORDINATE:
        raise OutOfRangeError(f"{name}: {value!r} is beyond {LARGEST_COORDINATE:g}")
    if value < least:
        raise ValueError(f"{name}: {value!r} is less than {least:g}")
