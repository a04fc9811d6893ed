"""Shapes of obstacles about their centres: discs, rectangles, polygons, ellipses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Discriminator, Field, Tag

from scp_planner.errors import nearest
from scp_planner.mathematics import planar
from scp_planner.scenario import checks
from scp_planner.scenario.validation import OfNumbers, Part, Rule, variant
from scp_planner.scenario.values import Number, Polygon, Positive


class Disc(Part):
    """A disc about the obstacle's centre."""

    disc: Positive = Field(description="radius, m")

    def distance(self, point: planar.Point, heading: float) -> float:  # noqa: ARG002 - the same in all directions
        """Compute the distance in m to a point relative to the centre; 0 inside. `heading` in rad."""
        return max(0.0, math.hypot(*point) - self.disc)


class Rectangle(Part):
    """A rectangle about the obstacle's centre, its length along the obstacle's heading."""

    rectangle: OfNumbers[tuple[Positive, Positive]] = Field(description="[length, width], m")
    heading: Number | None = Field(
        default=None, description="rad; null: along the velocity, standing as last known, or 0"
    )

    rules: ClassVar[tuple[Rule, ...]] = (checks.heading_is_in_radians,)

    def distance(self, point: planar.Point, heading: float) -> float:
        """Compute the distance in m to a point relative to the centre; 0 inside. `heading` of the motion in rad."""
        turned = planar.turned(point, -(heading if self.heading is None else self.heading))
        beyond = [max(0.0, abs(x) - 0.5 * side) for x, side in zip(turned, self.rectangle, strict=True)]
        return math.hypot(*beyond)


class PolygonShape(Part):
    """A simple polygon, its vertices relative to the obstacle's centre; it does not turn with the heading."""

    rules: ClassVar[tuple[Rule, ...]] = (checks.polygon_is_simple,)

    polygon: OfNumbers[Polygon] = Field(description="vertices [[x, y], ...], m")

    def distance(self, point: planar.Point, heading: float) -> float:  # noqa: ARG002 - it does not turn
        """Compute the distance in m to a point relative to the centre; 0 inside. `heading` in rad."""
        return planar.distance_to_polygon(point, self.polygon)


class Ellipse(Part):
    """An ellipse about the obstacle's centre, its first semi-axis along the obstacle's heading."""

    ellipse: OfNumbers[tuple[Positive, Positive]] = Field(description="semi-axes [along, across], m")
    heading: Number | None = Field(
        default=None, description="rad; null: along the velocity, standing as last known, or 0"
    )

    rules: ClassVar[tuple[Rule, ...]] = (checks.heading_is_in_radians,)

    def distance(self, point: planar.Point, heading: float) -> float:
        """Compute the distance in m to a point relative to the centre; 0 inside. `heading` of the motion in rad."""
        own = heading if self.heading is None else self.heading
        return planar.distance_to_ellipse(planar.turned(point, -own), *self.ellipse)


SHAPE_KEYS: dict[str, type[Part]] = {"disc": Disc, "rectangle": Rectangle, "polygon": PolygonShape, "ellipse": Ellipse}


def _shape_case(data: Any) -> str | None:
    """Tell which shape is meant: the one with the given key, or else with a key spelt nearly so."""
    if isinstance(data, Part):
        return next((variant(key) for key, kind in SHAPE_KEYS.items() if isinstance(data, kind)), None)
    if not isinstance(data, Mapping):
        return None
    known = [key for key in data if key in SHAPE_KEYS]
    keys = known or [near for key in data if (near := nearest(key, SHAPE_KEYS))]
    return variant(keys[0]) if len(keys) == 1 else None


Shape = Annotated[
    Annotated[Disc, Tag(variant("disc"))]
    | Annotated[Rectangle, Tag(variant("rectangle"))]
    | Annotated[PolygonShape, Tag(variant("polygon"))]
    | Annotated[Ellipse, Tag(variant("ellipse"))],
    Discriminator(
        _shape_case,
        custom_error_type="shape",
        custom_error_message=f"must be a mapping with exactly one of the keys {', '.join(SHAPE_KEYS)}",
    ),
]
