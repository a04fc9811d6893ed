"""Guides: the curves that a path is a normal offset of.

A guide g(s), s in [0, length], is parametrised by its own arc length, so g' = T is a unit tangent,
n = T turned by +90 degrees the normal, T' = k n and n' = -k T with k the signed curvature.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, sin
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

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


@dataclass(frozen=True)
class StraightGuide:
    """The straight line from a point along a heading.

    Attributes
    ----------
    origin : (x, y) in m
    heading : float
        rad.
    length : float
        m.
    """

    origin: tuple[float, float]
    heading: float
    length: float

    straight = True

    @classmethod
    def between(cls, start: tuple[float, float], goal: tuple[float, float]) -> StraightGuide:
        """Return the straight guide from one point to another, in m."""
        dx, dy = goal[0] - start[0], goal[1] - start[1]
        return cls(start, float(np.arctan2(dy, dx)), hypot(dx, dy))

    def frame(self, stations: Array) -> GuideFrame:
        """Return the moving frame at arc lengths ``stations``, (n,) m."""
        tangent = np.array([cos(self.heading), sin(self.heading)])
        normal = np.array([-tangent[1], tangent[0]])
        zeros = np.zeros_like(stations)
        return GuideFrame(
            np.asarray(self.origin) + stations[:, None] * tangent,
            np.broadcast_to(tangent, (*stations.shape, 2)),
            np.broadcast_to(normal, (*stations.shape, 2)),
            zeros,
            zeros,
        )
