"""Guides: the curves that a path is a normal offset of.

A guide g(s), s in [0, length], is parametrised by its own arc length, so g' = T is a unit tangent,
n = T turned by +90 degrees the normal, T' = k n and n' = -k T with k the signed curvature.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from scp_planner.intervals import Interval

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GuideFrame:
    """The moving frame of a guide at n stations.

    Attributes
    ----------
    position, tangent, normal : (n, 2) arrays
        Point in m; unit tangent; unit normal, to the left of the tangent.
    curvature : (n,) array
        Signed curvature k, 1/m, positive to the left.
    curvature_rate : (n,) array
        dk/ds, 1/m^2.
    """

    position: Array
    tangent: Array
    normal: Array
    curvature: Array
    curvature_rate: Array


class Guide(Protocol):
    """What the trajectory needs to know of a guide."""

    @property
    def length(self) -> float:
        """Arc length in m."""
        ...

    @property
    def straight(self) -> bool:
        """Whether the curvature is zero everywhere."""
        ...

    def frame(self, stations: Array) -> GuideFrame:
        """Return the moving frame at arc lengths ``stations``, (n,) m."""
        ...

    def curvature_ranges(self, stations: Array, width: Array) -> tuple[Interval, Interval, Interval]:
        """Enclose the curvature and its first two derivatives on [station - width, station + width]."""
        ...

    def to_dict(self) -> dict[str, Any]:
        """Return what :func:`guide_from_dict` needs to make the same guide."""
        ...


@dataclass(frozen=True)
class StraightGuide:
    """The x axis of the planning frame, from the start at 0 to the goal.

    Attributes
    ----------
    length : float
        m.
    """

    length: float

    straight = True

    def frame(self, stations: Array) -> GuideFrame:
        """Return the moving frame at arc lengths ``stations``, (n,) m."""
        zeros = np.zeros_like(stations)
        ones = np.ones_like(stations)
        return GuideFrame(
            np.stack([stations, zeros], axis=-1),
            np.stack([ones, zeros], axis=-1),
            np.stack([zeros, ones], axis=-1),
            zeros,
            zeros,
        )

    def curvature_ranges(self, stations: Array, width: Array) -> tuple[Interval, Interval, Interval]:
        """Enclose the curvature and its first two derivatives on intervals of the station: all zero."""
        zero = Interval(np.zeros_like(stations), np.zeros_like(stations))
        return zero, zero, zero

    def to_dict(self) -> dict[str, Any]:
        """Return what :func:`guide_from_dict` needs to make the same guide."""
        return {"kind": "straight", "length": self.length}


def guide_from_dict(data: dict[str, Any]) -> Guide:
    """Return the guide of a plan file.

    Raises
    ------
    KeyError, TypeError, ValueError
        If the dictionary does not describe a guide.
    """
    kind = data["kind"]
    if kind == "straight":
        length = float(data["length"])
        if not (0.0 < length < float("inf")):
            raise ValueError(f"length {length!r} is not a positive number")
        return StraightGuide(length)
    raise ValueError(f"kind {kind!r} is none of straight")
