"""Terms of an evasive manoeuvre's worth: way gained, nearness to zones, zones entered."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array
from scp_planner.online.braking import time_from_a_stand
from scp_planner.scenario.models import Vehicle

MOMENT_WIDTHS = 0.8
"""Widths that the vehicle drives in a moment, from a stand: so one that starts slowly looks ahead for longer."""
GAIN = 3.5
"""Moments, at which the way to the goal is taken that a dodge gains: what comes later is decided by later replans. With
half as many a vehicle goes along with who crosses its way rather than let them pass."""
NEARNESS = 4.0
"""Widths of way that a moment of touching a zone is worth, if it were now."""
CLOSE, CLOSER = 1.0 / 4.0, 1.0 / 20.0
"""Widths, and widths a moment: by so much more clearance nearness falls to 1 / e, now, and how this grows with time."""
FADING = 0.9
"""A moment: how soon nearness that is to come counts less, since there will be replans until then."""
OUTLOOK = 5.0
"""Moments for which nearness counts."""
GROWING = 1.0
"""Moments for which zones grow, where nearness to them and harm are judged: of what is farther ahead the vehicle will
know as much by when it is there. Zones that grow on fill a crowd, and drive the vehicle away to where nobody is."""
EXACT = 2.0
"""Widths within which distances of what is driven are exact: what is farther away hardly counts."""
HARM = 50.0
"""Widths of way that a width of depth in a zone is worth, if it were now..."""
HARM_AT_ALL = 1.0 / 6.0
"""...and widths that count for any depth."""


def a_moment(vehicle: Vehicle) -> float:
    """The time in which a vehicle drives `MOMENT_WIDTHS` of its width from a stand, s."""
    return time_from_a_stand(vehicle, MOMENT_WIDTHS * 2.0 * vehicle.radius)


def nearness(time: Array, clearance: Array) -> Array:
    weight = np.where(time <= OUTLOOK, time[1] - time[0], 0.0) / (1.0 + FADING * time)
    # How deep it is inside of a zone is not judged here.
    near: Array = np.exp(-np.maximum(clearance, -CLOSE) / (CLOSE + CLOSER * time)) @ weight
    return near


def harm(time: Array, clearance: Array) -> Array:
    depth = np.where(clearance < 0.0, HARM_AT_ALL - clearance, 0.0)
    worst: Array = HARM * (depth / (1.0 + FADING * time)).max(axis=1)
    return worst


def value_at(time: float, times: Array, values: Array) -> Array:
    """Return values (C, ...) at a time, of those (C, J, ...) at times (J,)."""
    after = int(np.searchsorted(times, time).clip(1, len(times) - 1))
    share = min((time - times[after - 1]) / (times[after] - times[after - 1]), 1.0)
    return np.asarray(values[:, after - 1] + share * (values[:, after] - values[:, after - 1]))
