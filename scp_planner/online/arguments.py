"""Arguments of a planner, checked before anything is done with them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.certificate.ends import can_reverse
from scp_planner.errors import Fault, ScenarioError
from scp_planner.files import LARGEST_COORDINATE
from scp_planner.online.stops import STOPS
from scp_planner.online.tolerances import EIGENVALUE, RELATIVE
from scp_planner.scenario.estimates import Estimate
from scp_planner.scenario.models import Ground, Obstacle, Scenario, Steering, Vehicle
from scp_planner.scenario.motions import GivenMotion
from scp_planner.scenario.tolerances import SYMMETRY
from scp_planner.scenario.units import changed
from scp_planner.tracking.tolerances import LEAST_DEVIATION, MOST_DEVIATION
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
    for entry in matrix[np.abs(matrix) > LARGEST_COORDINATE].tolist():
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
    """Make what a tracker says of its parts, in SI units, which leave nothing for the model to refuse."""
    check_number("time", time)
    rates = [_point("velocity", velocity)]
    if acceleration is not None:
        rates.append(_point("acceleration", acceleration))
    return Estimate.model_construct(
        time=float(time),
        position=_point("position", position),
        velocity=rates[0],
        acceleration=None if acceleration is None else rates[1],
        covariance=tuple(map(tuple, checked_covariance(covariance, units, len(rates)).tolist())),
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


def accelerating(acceleration: float, low: float, high: float) -> str | None:
    """Report an acceleration, m/s2, that the vehicle cannot have: it is planned from the nearest one that it can."""
    nearest = min(max(acceleration, low), high)
    if abs(acceleration - nearest) <= RELATIVE * max(abs(low), high):
        return None
    return f"the vehicle accelerates at {acceleration:.4g} m/s2, which it cannot: {nearest:.4g} m/s2 is taken"


def against_gear(speed: float, has_gear: bool) -> str:
    """Report a vehicle that rolls against its gear at a speed, m/s."""
    if has_gear:
        return f"the vehicle rolls against its gear at {speed:.4g} m/s: it stops first"
    return f"the vehicle rolls backwards at {speed:.4g} m/s, and has no reverse gear: nothing is certified"


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


def square_matrix(value: ArrayLike, size: int) -> Array:
    """Covariance as an array (size, size) of finite numbers; a `ValueError` names what is wrong."""
    try:
        matrix = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"covariance: it is not an array of numbers ({error})") from None
    if matrix.shape != (size, size):
        raise ValueError(f"covariance: its shape is {matrix.shape}; it must have {size} rows of {size} numbers")
    if not np.isfinite(matrix).all():
        raise ValueError(f"covariance: {matrix.tolist()} is not finite")
    return matrix


def repaired(matrix: Array, units: ArrayLike) -> Array:
    kinds = np.repeat(np.asarray(units, dtype=float), 2)
    least, most = LEAST_DEVIATION * kinds, MOST_DEVIATION * kinds
    found, unlike = 0.5 * (matrix + matrix.T), np.abs(matrix - matrix.T)
    if unlike.any():
        unlike /= _scales(matrix, least)
        if (unlike > SYMMETRY).any():
            i, j = np.unravel_index(int(np.argmax(unlike)), unlike.shape)
            pair = f"its entries [{i}][{j}] = {float(matrix[i, j])!r} and [{j}][{i}] = {float(matrix[j, i])!r}"
            raise ValueError(f"covariance: {matrix.tolist()} is not symmetric: {pair} must be the same")
    if not _is_definite(found, least):
        found = _definite(found, _scales(matrix, least), least)
    shrunk = np.minimum(1.0, most / np.sqrt(found.diagonal()))
    return found * (shrunk[:, None] * shrunk)


def _scales(matrix: Array, least: Array) -> Array:
    """Sizes that the rounding of entries is relative to: products of the largest deviations of their kinds."""
    kinds = len(matrix) // 2
    blocks = np.abs(matrix.reshape(kinds, 2, kinds, 2)[range(kinds), :, range(kinds)])
    largest = np.maximum(np.repeat(np.sqrt(blocks.reshape(kinds, 4).max(axis=1)), 2), least)
    return np.outer(largest, largest)


def _is_definite(matrix: Array, least: Array) -> bool:
    own = matrix.diagonal()
    if (own < least * least).any():
        return False
    return bool(np.linalg.eigvalsh(matrix / np.sqrt(own[:, None] * own))[0] > EIGENVALUE)


def _definite(matrix: Array, scales: Array, least: Array) -> Array:
    """Symmetric matrix with no eigenvalue of its correlations below the least; refused if that is no rounding."""
    values, vectors = np.linalg.eigh(matrix / scales)
    if values[0] < -SYMMETRY * max(float(values[-1]), 1.0):
        raise ValueError(f"covariance: {matrix.tolist()} is not positive definite")
    raised = np.maximum(values, max(2.0 * EIGENVALUE, -float(values[0])))
    found: Array = (vectors * raised) @ vectors.T * scales
    found = 0.5 * (found + found.T)
    return found + np.diag(np.maximum(least**2 - np.diag(found), 0.0))


def ground_given(call: str, given: Any, scenario: Scenario) -> Ground:
    try:
        if scenario.corridor is not None:
            raise ScenarioError(call, [Fault("map", given, "must not be given beside a corridor")])
        return given if isinstance(given, Ground) else Ground(**given if isinstance(given, Mapping) else {"map": given})
    except ScenarioError as error:
        raise ScenarioError(call, error.faults) from None


def own_ground(ground: Ground | None) -> Ground | None:
    """Copy the cells of a ground, which the caller may change in place."""
    return None if ground is None else changed(ground, map=replace(ground.map))


def can_turn(vehicle: Vehicle, speed: float) -> bool:
    return vehicle.steering is Steering.ANY or (vehicle.steering is Steering.ON_THE_SPOT and speed <= STOPS.standing)


def direction(
    vehicle: Vehicle, position: tuple[float, float], heading: float | None, speed: float, goal: tuple[float, float]
) -> float | None:
    """In which direction a vehicle sets out for its goal."""
    if heading is None or can_turn(vehicle, speed):
        return None
    towards = math.atan2(goal[1] - position[1], goal[0] - position[0])
    if can_reverse(vehicle, speed) and math.cos(heading - towards) < 0.0:
        return math.remainder(heading + math.pi, 2.0 * math.pi)
    return float(heading)
