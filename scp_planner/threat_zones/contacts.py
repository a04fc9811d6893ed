"""What points have of zones that they are near: distances, and how these change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index


@dataclass(frozen=True)
class ZoneContacts:
    """Signed distances of points to chosen zones, and how they change.

    Attributes
    ----------
    distance : (n,) array
        m, negative inside.
    normal : (n, 2) array
        Unit normal nu of the supporting line, from the zone towards the point: the gradient of the distance.
    rate : (n,) array
        Time derivative of the distance at a fixed point, m/s: -(nu . centre velocity + growth of the support).
    """

    distance: Array
    normal: Array
    rate: Array

    def take(self, index: Index | slice) -> ZoneContacts:
        """Return some of the contacts."""
        return ZoneContacts(self.distance[index], self.normal[index], self.rate[index])

    @classmethod
    def joined(cls, parts: Sequence[ZoneContacts]) -> ZoneContacts:
        """Return several sets of contacts as one."""
        if len(parts) == 1:
            return parts[0]
        return cls(
            np.concatenate([part.distance for part in parts]),
            np.concatenate([part.normal for part in parts]),
            np.concatenate([part.rate for part in parts]),
        )
