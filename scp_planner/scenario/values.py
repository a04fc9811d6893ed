"""Numbers and texts of a scenario file, each with its range."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from scp_planner.files import LARGEST_COORDINATE
from scp_planner.scenario.validation import Pair, Row

Number = Annotated[float, Field(strict=True, ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE)]
Positive = Annotated[float, Field(strict=True, gt=0)]
NotNegative = Annotated[float, Field(strict=True, ge=0)]
Text = Annotated[str, Field(strict=True, min_length=1)]
Vector = tuple[Number, Number]
# Squares and cubes of what is beyond it come near to the largest double.
RateNumber = Annotated[float, Field(strict=True, ge=-1e30, le=1e30)]
Rate = tuple[RateNumber, RateNumber]
Matrix = Pair[Pair[Number]]
Polygon = Annotated[Row[Vector], Field(min_length=3)]
Polyline = Annotated[Row[Vector], Field(min_length=2)]
