"""How much of what is not known of obstacles dodges keep clear of, where none keeps clear of all of it.

A dodge is certified against zones that stop to grow when the vehicle stands, since it sees them come then. Where
nothing is safe that is no measure: it would have the vehicle stand and be hit, among zones that are small because it
stands, rather than leave among zones that grow meanwhile. So zones are looked at here that grow for the same while for
all dodges, and of each dodge the share of their extents is told that it keeps clear of.
"""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array
from scp_planner.online.dodge_worth import FADING, GAIN, a_moment
from scp_planner.online.dodges import Dodges, in_parts
from scp_planner.online.foresight import foreseen
from scp_planner.online.vetting import Moment, Stop
from scp_planner.scenario.limits import Box
from scp_planner.scenario.models import Vehicle
from scp_planner.threat_zones.batch import ZoneBatch

PART = 0.1
"""Share of the zones' extents at which distances are looked at besides, to tell from both how far they reach."""
STEADY = 0.1
"""Share by which a dodge must do better than what is being driven: who always takes the best drives to and fro."""


def odds(moment: Moment, dodges: Dodges, box: Box) -> Array:
    """Return which share of the zones' extents dodges keep clear of, (C,), at most 1.

    Below 0 of those that come over where an obstacle is expected: widths by which they do, and less the later; of a
    vehicle where one is expected already, the mean over the times. Who moves is hit harder, so that it must be worth
    it: `STEADY` less of those that drive a width or more.

    Parameters
    ----------
    moment : Moment
    dodges : Dodges
    box : Box
        The workspace in the planning frame.

    Returns
    -------
    (C,) array
    """
    vehicle, times = moment.scenario.vehicle, dodges.times
    whole = _grown(moment.batch, vehicle)
    near, least = dodges.within_reach(whole, vehicle), np.ones(dodges.heading.shape)
    for some in in_parts(max(len(near), 1), least.size):  # the border is one more, also where no zone is near
        each, less = dodges.rooms(whole, box, vehicle, np.inf, near[some], (1.0, PART))
        np.minimum(least, _shares(each.each, less.each, times, vehicle), out=least)
    return _over_time(least) - _moves(dodges.position, times, vehicle)


def odds_of_stop(moment: Moment, stop: Stop, times: Array) -> float:
    """Return the same of a stop that is being driven, at times (J,), s from now.

    Parameters
    ----------
    moment : Moment
    stop : Stop
    times : (J,) array

    Returns
    -------
    float
    """
    vehicle = moment.scenario.vehicle
    points, _ = stop.trip.at(moment.state.time + times)
    place = moment.frame.to_frame(stop.trip.frame.to_world(points.path.position))
    whole, less = (
        _grown(one.batch, vehicle).distances(times, place).T[:, None]
        for one in (moment, moment.with_smaller_zones(PART))
    )
    return float((_over_time(_shares(whole, less, times, vehicle)) - _moves(place[None], times, vehicle))[0])


def _grown(batch: ZoneBatch, vehicle: Vehicle) -> ZoneBatch:
    """Zones that grow for the same while, whatever the vehicle does."""
    return foreseen(batch, GAIN * a_moment(vehicle), {})


def _moves(place: Array, times: Array, vehicle: Vehicle) -> Array:
    """What moving to places (C, J, 2), m, at times (J,), s, costs, (C,)."""
    soon = int(np.searchsorted(times, GAIN * a_moment(vehicle), "right"))
    way = np.hypot(*np.moveaxis(np.diff(place[:, : soon + 1], axis=1), -1, 0)).sum(axis=1)
    cost: Array = STEADY * np.minimum(way / (2.0 * vehicle.radius), 1.0)
    return cost


def _shares(whole: Array, less: Array, times: Array, vehicle: Vehicle) -> Array:
    """Of distances (L, C, J) to zones, m, and to those whose extents are `PART` of theirs: the least shares, (C, J)."""
    extent = np.maximum(less - whole, 0.0) / (1.0 - PART)
    gap = whole + extent
    over = gap / (2.0 * vehicle.radius * (1.0 + FADING * times / a_moment(vehicle)))
    share = np.where(gap > 0.0, 1.0, over)
    np.divide(gap, extent, out=share, where=(gap > 0.0) & (extent > gap))
    least: Array = share.min(axis=0, initial=1.0)
    return least


def _over_time(least: Array) -> Array:
    """What shares (C, J) come to, (C,)."""
    # Who is touched now is no better off by what it was: it gets away the sooner, the better.
    found: Array = np.where(least[:, 0] < 0.0, least.mean(axis=1), least.min(axis=1))
    return found
