"""Distances of points to nearby zones, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.threat_zones.tolerances import SAME_CONTACT

MOST_LEADERS = 6  # of one place; what is left then all counts


@dataclass(frozen=True)
class ZoneContacts:
    """Signed distances of points to chosen zones, and how they change."""

    distance: Array  # (n,) m, negative inside
    normal: Array  # (n, 2) Unit normal nu of the supporting line, from the zone towards the point
    rate: Array  # (n,) Time derivative of the distance at a fixed point, m/s


def distinct(places: Index, zone: Index, contacts: ZoneContacts) -> Index:
    """Return which contacts are not, but for rounding, those of a zone of a lower number in the same place."""
    distance, normal = (np.round(each / SAME_CONTACT) for each in (contacts.distance, contacts.normal))
    keys = np.stack([*places, distance, *normal.T])
    order = np.lexsort((zone, *keys))
    same = np.all(keys[:, order[1:]] == keys[:, order[:-1]], axis=0)
    return np.sort(np.delete(order, np.flatnonzero(same) + 1))


def leading(place: Index, contacts: ZoneContacts, move: float) -> Index:
    """Return which contacts are not implied by others of the same place, in order."""
    distance, normal = contacts.distance, contacts.normal
    left = np.lexsort((np.round(distance / SAME_CONTACT), place))
    kept = []
    for _ in range(MOST_LEADERS):
        if len(left) == 0:
            break
        first = np.concatenate([[True], np.diff(place[left]) != 0])
        kept.append(left[first])
        leader = left[first][np.cumsum(first) - 1]
        turn = normal[left] - normal[leader]
        reached = move * np.hypot(turn[:, 0], turn[:, 1])
        left = left[~first & (reached > distance[left] - distance[leader] + SAME_CONTACT)]
    return np.sort(np.concatenate([*kept, left]))
