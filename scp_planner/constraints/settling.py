from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.contacts import ZoneContacts
from scp_planner.trips.trajectory import TripPoints

SMALL = 2.0  # times the way from sample to sample at top speed: radius of a zone whose distance bends within that
TOUCHED = 2.0  # times that way: what stands farther away from a sample is not touched next to it
STRAIGHT = 1.0 - 1e-12  # cosine of the turn between normals that are one
ROUNDS = 2  # in each a bracket becomes as many times closer as there are shares, and once more: a call costs most
SHARES = np.linspace(0.0, 1.0, 9)[1:-1]  # of a bracket, at which a round looks


def settle_minima(
    zones: ZoneBatch, step: float, points: TripPoints, sample: Index, zone: Index, sigma: Array, least: Array
) -> None:
    """Move minima of the distances to outlines and to small zones, in place, to where their rates are zero."""
    rugged = (zones.outline_slot[zone] >= 0) | (zones.radius[zone] < SMALL * step)
    if zones.ground is not None:
        rugged &= (least < TOUCHED * step) | ~np.isin(zone, zones.ground.zones)
    rows = rugged.nonzero()[0]
    if len(rows) == 0:
        return
    which, place = zone[rows], sample[rows]
    # Before the first sample and after the last one there is nothing: there minima are on one side alone
    last = int(points.table.sigma.argmax())
    around = np.concatenate([np.maximum(place - 1, 0), place, np.minimum(place + 1, last)])
    touched = zones.contacts(np.tile(which, 3), points.time[around], points.path.position[around])
    slope = _closing(zones, np.tile(which, 3), _velocities(points, around), touched).reshape(3, -1)
    falling = slope[1] < 0.0
    below, above = np.where(falling, slope[1], slope[0]), np.where(falling, slope[2], slope[1])
    bracketed = (below < 0.0) & (above > 0.0)
    if zones.ground is not None:
        # Along an edge it is smooth
        before, after = touched.normal[: len(rows)], touched.normal[-len(rows) :]
        edge = np.einsum("ij,ij->i", before, after) > STRAIGHT
        bracketed &= ~(edge & np.isin(which, zones.ground.zones))
    if not bracketed.any():
        return
    rows, which, below, above = rows[bracketed], which[bracketed], below[bracketed], above[bracketed]
    begin = np.where(falling, place, place - 1)[bracketed]
    end = begin + 1
    _between_jumps(zones, which, points, (begin, end), (below, above), last)
    course = _Course.between(points, begin, end)
    sigma[rows] = course.begin + course.width * _zero(zones, which, course, below, above)


def _between_jumps(
    zones: ZoneBatch, which: Index, points: TripPoints, ends: tuple[Index, Index], rates: tuple[Array, Array], last: int
) -> None:
    """Narrow brackets, in place, to where the acceleration does not jump: a cubic is not the trip across a jump."""
    (begin, end), (below, above), sigma = ends, rates, points.table.sigma
    jumps = sigma[last + 1 :]
    between = (sigma[begin, None] < jumps) & (jumps < sigma[end, None])
    for jump in last + 1 + np.flatnonzero(between.any(axis=0)):
        rows = np.flatnonzero((sigma[begin] < sigma[jump]) & (sigma[jump] < sigma[end]))
        at = np.full(len(rows), jump)
        contacts = zones.contacts(which[rows], points.time[at], points.path.position[at])
        rate = _closing(zones, which[rows], _velocities(points, at), contacts)
        closes = rate < 0.0
        begin[rows[closes]], below[rows[closes]] = jump, rate[closes]
        end[rows[~closes]], above[rows[~closes]] = jump, rate[~closes]


def _zero(zones: ZoneBatch, which: Index, course: _Course, below: Array, above: Array) -> Array:
    every = np.arange(len(which))
    low, width = np.zeros(len(which)), 1.0
    zone = np.tile(which, len(SHARES))
    for _ in range(ROUNDS):
        shares = low + width * SHARES[:, None]
        position, velocity = course.at(shares)
        times = course.time + course.duration * shares
        contacts = zones.contacts(zone, times.ravel(), position.reshape(-1, 2))
        rates = _closing(zones, zone, velocity.reshape(-1, 2), contacts).reshape(shares.shape)
        rates = np.vstack([below, rates, above])
        # What is nearest closes at first, and goes away at last: between two in a row it turns.
        turn = (rates[1:] >= 0.0).argmax(axis=0)
        low, width = low + width * turn / (len(SHARES) + 1), width / (len(SHARES) + 1)
        below, above = rates[turn, every], rates[turn + 1, every]
    return low + width * below / (below - above)


@dataclass(frozen=True)
class _Course:
    """Ways from samples to the next ones: cubics that have the positions and velocities of the trip at both."""

    begin: Array
    width: Array
    time: Array
    duration: Array
    coefficients: Array

    @classmethod
    def between(cls, points: TripPoints, place: Index, end: Index) -> _Course:
        """Return the ways from samples to later ones, (m,) indices of points each."""
        here, there = points.path.position[place], points.path.position[end]
        time, begin = points.time[place], points.table.sigma[place]
        duration = points.time[end] - time
        leaving, coming = (_velocities(points, at) * duration[:, None] for at in (place, end))
        way = there - here
        coefficients = np.stack([here, leaving, 3.0 * way - 2.0 * leaving - coming, leaving + coming - 2.0 * way])
        width = points.table.sigma[end] - begin
        return cls(begin, width, time, duration, coefficients)

    def at(self, share: Array) -> tuple[Array, Array]:
        """Positions, m, and velocities, m/s, (..., m, 2), after shares of the ways, (..., m)."""
        x, (start, first, second, third) = share[..., None], self.coefficients
        position = start + x * (first + x * (second + x * third))
        velocity = (first + x * (2.0 * second + 3.0 * x * third)) / self.duration[:, None]
        return position, velocity


def _velocities(points: TripPoints, index: Index) -> Array:
    velocities: Array = (points.speed[index] / points.path.speed[index])[:, None] * points.path.direction[index]
    return velocities


def _closing(zones: ZoneBatch, which: Index, velocity: Array, contacts: ZoneContacts) -> Array:
    """Rate of the distances on the way, m/s; of discs times the distance of their centres: that changes evenly."""
    rate: Array = np.einsum("ij,ij->i", contacts.normal, velocity) + contacts.rate
    discs = np.flatnonzero((zones.outline_slot[which] < 0) & (zones.slot[which] < 0))
    rate[discs] *= contacts.distance[discs] + zones.radius[which[discs]]
    return rate
