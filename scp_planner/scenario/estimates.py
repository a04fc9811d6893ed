"""State of an obstacle at a time and its covariance, from a tracker."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, ClassVar

from pydantic import Field

from scp_planner.scenario.tolerances import INDEPENDENT, SYMMETRY
from scp_planner.scenario.validation import Numbers, Objection, OfNumbers, Part, Rule, TakenAs, by_default
from scp_planner.scenario.values import Number, Rate, RateNumber, Vector


def _covariance_is_of_the_state(estimate: Any) -> Iterator[Objection]:
    """The covariance has a row for each component, is symmetric and positive definite."""
    matrix, accelerates = estimate.covariance, estimate.acceleration is not None
    size, names = (6, "position, velocity and acceleration") if accelerates else (4, "position and velocity")
    if len(matrix) != size or any(len(row) != size for row in matrix):
        order = "x, y, vx, vy, ax, ay" if accelerates else "x, y, vx, vy"
        text = f"must have {size} rows of {size} numbers: of {names}, in the order {order}"
        yield Objection(("covariance",), matrix, text)
        return
    scale = [math.sqrt(max(matrix[k][k], 0.0)) for k in range(size)]
    for i in range(size):
        for j in range(i):
            if abs(matrix[i][j] - matrix[j][i]) > SYMMETRY * scale[i] * scale[j]:
                yield Objection(
                    ("covariance", i, j),
                    matrix[i][j],
                    f"must be the same as that beyond the diagonal, {matrix[j][i]!r}",
                )
                return
    if not _is_definite(matrix, scale):
        yield Objection(("covariance",), matrix, "must be positive definite")


def _is_definite(matrix: Any, scale: list[float]) -> bool:
    """True if Cholesky's factors of a matrix exist, beyond the rounding of correlations."""
    if min(scale) == 0.0:
        return False
    factor: list[list[float]] = []
    for i, row in enumerate(matrix):
        own = [0.5 * (row[j] + matrix[j][i]) / (scale[i] * scale[j]) for j in range(i + 1)]
        for j in range(i):
            own[j] = (own[j] - sum(own[k] * factor[j][k] for k in range(j))) / factor[j][j]
        left = own[i] - sum(value * value for value in own[:i])
        if not left > INDEPENDENT:
            return False
        own[i] = math.sqrt(left)
        factor.append(own)
    return True


class Estimate(Part):
    """State of an obstacle at a time, as a tracker gives it, and the covariance of the state's error.

    The obstacle's ``model`` says how it goes on from there: with process noise, or as a polynomial of its order.
    """

    rules: ClassVar[tuple[Rule, ...]] = (_covariance_is_of_the_state,)

    time: Number = Field(description="s, on the clock of start.time")
    position: OfNumbers[Vector] = Field(description="[x, y], m")
    velocity: OfNumbers[Rate] = Field(description="[x, y], m/s")
    acceleration: TakenAs[Rate | None, Numbers | None] = by_default(
        None, description="[x, y], m/s2; null: the tracker has none"
    )
    covariance: OfNumbers[tuple[tuple[RateNumber, ...], ...]] = Field(
        description="of x, y, vx, vy (4 rows of 4) or of x, y, vx, vy, ax, ay (6 of 6), in m and s"
    )
