"""Numbers and texts of a scenario file, each with its range."""

from __future__ import annotations

from math import inf, isfinite
from typing import Annotated

from pydantic import Field

from scp_planner.files import LARGEST_COORDINATE
from scp_planner.scenario.validation import FiledAs, Pair, Row


def finite(value: float) -> float | None:
    return value if isfinite(value) else None


def endless(value: float | None) -> float:
    return inf if value is None else value


Number = Annotated[float, Field(strict=True, ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE)]
Positive = Annotated[float, Field(strict=True, gt=0)]
NotNegative = Annotated[float, Field(strict=True, ge=0)]
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole = Annotated[int, Field(strict=True)]
Count = Annotated[int, Field(strict=True, ge=0)]
Flag = Annotated[bool, Field(strict=True)]
Name = Annotated[str, Field(strict=True)]
Text = Annotated[str, Field(strict=True, min_length=1)]
Vector = tuple[Number, Number]
# Squares and cubes of what is beyond it come near to the largest double.
RateNumber = Annotated[float, Field(strict=True, ge=-1e30, le=1e30)]
Endless = Annotated[float, FiledAs(RateNumber | None, endless, finite)]
"""A number that is null in files where it is infinite."""
Rate = tuple[RateNumber, RateNumber]
Matrix = Pair[Pair[Number]]
Polygon = Annotated[Row[Vector], Field(min_length=3)]
Polyline = Annotated[Row[Vector], Field(min_length=2)]
