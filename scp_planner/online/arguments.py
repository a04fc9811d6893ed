"""Arguments of a planner, checked before anything is done with them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.files import LARGEST_COORDINATE
from scp_planner.scenario.estimates import Estimate
from scp_planner.scenario.models import Obstacle
from scp_planner.scenario.motions import GivenMotion


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


def _covariance(value: ArrayLike) -> Array:
    from scp_planner.estimation.observations import check_covariance

    covariance = np.asarray(check_covariance(value, 1).reshape(2, 2), dtype=float)
    for entry in covariance.ravel():
        check_number("covariance", entry)
    return covariance


def checked_estimate(
    time: float, position: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike | None, covariance: ArrayLike
) -> Estimate:
    """Make what a tracker says of its parts, in SI units.

    Parameters
    ----------
    time : float
        s.
    position, velocity, acceleration : (2,)
        m, m/s, m/s2.
    covariance : (4, 4) or (6, 6)
        Of the state.

    Returns
    -------
    Estimate

    Raises
    ------
    ValueError
        Naming what is wrong.
    """
    check_number("time", time)
    return Estimate(
        time=float(time),
        position=_point("position", position),
        velocity=_point("velocity", velocity),
        acceleration=None if acceleration is None else _point("acceleration", acceleration),
        covariance=np.asarray(covariance, dtype=float).tolist(),
    )


def checked_motion(name: str, motion: GivenMotion | Mapping[str, Any]) -> GivenMotion:
    """Make what a predictor says of an obstacle a motion, in SI units.

    Parameters
    ----------
    name : str
        Id of the obstacle.
    motion : Motion, Course, Futures or mapping

    Returns
    -------
    Motion, Course or Futures

    Raises
    ------
    ScenarioError
        Naming what is wrong.
    """
    anybody = {"id": name, "shape": {"disc": 1.0}, "motion": motion}
    checked = Obstacle(**anybody).motion
    assert checked is not None, "it is given"
    return checked


def check_number(name: str, value: float, least: float = -math.inf) -> None:
    """Refuse what is no finite number, too small, or beyond what scenarios may hold.

    Parameters
    ----------
    name : str
        What the message calls it.
    value : float
    least : float

    Raises
    ------
    OutOfRangeError
        If it is beyond what scenarios may hold.
    ValueError
        Naming the value.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise ValueError(f"{name}: {value!r} is not a finite number")
    if value != value or value in (math.inf, -math.inf):
        raise ValueError(f"{name}: {value!r} is not a finite number")
    if abs(value) > LARGEST_COORDINATE:
        raise OutOfRangeError(f"{name}: {value!r} is beyond {LARGEST_COORDINATE:g}")
    if value < least:
        raise ValueError(f"{name}: {value!r} is less than {least:g}")
