"""Terms of an evasive manoeuvre's worth: way gained, nearness to zones, and zones entered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.online.braking import time_from_a_stand
from scp_planner.scenario.models import Vehicle


@dataclass(frozen=True)
class WorthParameters:
    # Widths that the vehicle drives in a moment, from a stand: so one that starts slowly looks ahead for longer
    moment_widths: float = 0.8
    # Moments, at which the way to the goal is taken that a manoeuvre gains: what comes later is decided by later
    # replans. With half as many a vehicle goes along with who crosses its way rather than let them pass
    gain_time: float = 3.5
    nearness: float = 4.0  # Widths of way that a moment of touching a zone is worth, if it were now
    close: float = 1.0 / 4.0  # Widths of more clearance, by which nearness falls to 1 / e, now
    close_growth: float = 1.0 / 20.0  # Widths a moment, by which that grows with time
    # Per moment: how soon nearness that is to come counts less, since there will be replans until then
    fading: float = 0.9
    outlook: float = 5.0  # Moments for which nearness counts
    # Moments for which zones grow, where nearness to them and harm are judged: of what is farther ahead the vehicle
    # will know as much by when it is there. Zones that grow on fill a crowd, and drive the vehicle away to where nobody
    # is
    growing: float = 1.0
    # Widths within which distances of what is driven are exact: what is farther away hardly counts
    exact_widths: float = 2.0
    harm: float = 50.0  # Widths of way that a width of depth in a zone is worth, if it were now
    harm_at_all: float = 1.0 / 6.0  # Widths of depth that any entry into a zone counts besides
    patience: float = 10.0  # Moments without coming nearer to the goal, after which nearness and spare room count half
    # Widths of clearance, below which a place counts as within the zone of who moves as fast as the vehicle may: a
    # small turn takes as much. Of who is slower: in proportion
    spare: float = 1.0 / 24.0
    # Lengths of way that a length is worth by which a manoeuvre shortens what can be driven: it ends in a dead end
    lost: float = 4.0


WORTH = WorthParameters()


def a_moment(vehicle: Vehicle) -> float:
    """Time unit of evasion, s: a vehicle drives `moment_widths` of its width in it, from a stand."""
    return time_from_a_stand(vehicle, WORTH.moment_widths * 2.0 * vehicle.radius)


def nearness(time: Array, clearance: Array) -> Array:
    weight = np.where(time <= WORTH.outlook, time[1] - time[0], 0.0) / (1.0 + WORTH.fading * time)
    # How deep it is inside of a zone is not judged here.
    near: Array = np.exp(-np.maximum(clearance, -WORTH.close) / (WORTH.close + WORTH.close_growth * time)) @ weight
    return near


def harm(time: Array, clearance: Array) -> Array:
    depth = np.where(clearance < 0.0, WORTH.harm_at_all - clearance, 0.0)
    worst: Array = WORTH.harm * (depth / (1.0 + WORTH.fading * time)).max(axis=1)
    return worst


def value_at(time: float, times: Array, values: Array) -> Array:
    """Return values (C, ...) at a time, of those (C, J, ...) at times (J,)."""
    after = int(np.searchsorted(times, time).clip(1, len(times) - 1))
    share = min((time - times[after - 1]) / (times[after] - times[after - 1]), 1.0)
    return np.asarray(values[:, after - 1] + share * (values[:, after] - values[:, after - 1]))
