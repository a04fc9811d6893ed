"""Clearance from threat zones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from scp_planner.arrays import Array, Index, Mask, joined, rows_of
from scp_planner.constraints.constraint import Constraint, LastTrip
from scp_planner.constraints.rows import Rows
from scp_planner.constraints.settling import settle_minima
from scp_planner.constraints.setup import Setup
from scp_planner.constraints.swing import Swing
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.contacts import ZoneContacts
from scp_planner.threat_zones.nearness import NEARNESS, nearness_of_samples
from scp_planner.trips.space import TimeTable
from scp_planner.trips.trajectory import Trajectory, TripPoints

SAMPLE_STRIDE = 3  # every third sample near a zone is a row, besides the minima of clearance
MOST_SAMPLES = 100_000


@dataclass(frozen=True)
class _Look:
    """A trip among zones: distances at samples, (n, L) m, and refined minima over time, with their zones, (m,)."""

    clearance: Array
    minima: TripPoints
    zone: Index
    contacts: ZoneContacts


@dataclass(frozen=True)
class Clearance(Constraint):
    """Entry into each zone, m: at refined minima of the distance over time, then at all samples."""

    name: ClassVar[str] = "clearance"
    near: ClassVar[float] = NEARNESS.near

    zones: ZoneBatch
    _last: LastTrip[_Look] = field(default_factory=LastTrip, init=False, repr=False, compare=False)

    @property
    def size(self) -> int:
        return self.zones.size

    def among(self, zones: ZoneBatch) -> Clearance:
        return Clearance(self.setup, zones)

    def smooth(self, times: TimeTable) -> Constraint:
        return SampledClearance(self.setup, self.zones, times)

    def excess(self, trip: Trajectory) -> Array:
        """Return the entries, (m + n L,) m: at minima, then at samples; farther than `NEAR` they are bounds."""
        look = self._last.of(trip, self._look)
        return np.concatenate([-look.contacts.distance, -look.clearance.ravel()])

    def _look(self, trip: Trajectory) -> _Look:
        setup, zones, points = self.setup, self.zones, trip.kept_at(self.setup.samples)
        clearance = zones.distances(points.time, points.path.position, NEARNESS.near)
        equidistant = clearance[: setup.grid]
        sample, zone = local_minima(equidistant, NEARNESS.near)
        if zones.whole is not None:
            touched = zones.contacts(zone, points.time[sample], points.path.position[sample])
            single = zones.singles(sample, zone, touched)
            sample, zone = sample[single], zone[single]
        sigma = refine_minima(setup.equidistant, equidistant, sample, zone)
        step = setup.limits.speed * trip.travel_time / (setup.grid - 1)
        settle_minima(zones, step, points, sample, zone, sigma, equidistant[sample, zone])
        minima = trip.at(setup.space.time_table(sigma))
        return _Look(clearance, minima, zone, zones.contacts(zone, minima.time, minima.path.position))

    def worst(self, trip: Trajectory, excess: Array) -> Array:
        """Return the deepest entry into each part of a zone, (L,) m."""
        look = self._last.of(trip, self._look)
        deepest: Array = -look.clearance.min(axis=0)
        np.maximum.at(deepest, look.zone, excess[: len(look.zone)])
        return deepest

    def violations(self, worst: Array) -> Array:
        """Return the entries, (L,) m: that of a zone of several parts is its first one's, and the others' are 0."""
        found = np.maximum(worst, 0.0)
        if self.zones.whole is None:
            return found
        together = np.zeros_like(found)
        np.maximum.at(together, self.zones.whole, found)
        return together

    def places(self, trip: Trajectory, excess: Array) -> Index:
        """Return all minima, and some of the samples that are near."""
        del excess  # distances tell more
        look, zones = self._last.of(trip, self._look), self.zones
        strided = look.clearance[: self.setup.grid : SAMPLE_STRIDE]
        sample, zone = np.nonzero(strided < nearness_of_samples(zones, NEARNESS.near))
        sample *= SAMPLE_STRIDE
        if zones.whole is not None:
            points = trip.kept_at(self.setup.samples)
            contacts = zones.contacts(zone, points.time[sample], points.path.position[sample])
            some = zones.leaders(sample, zone, contacts, NEARNESS.abreast * NEARNESS.near)
            sample, zone = sample[some], zone[some]
        return np.concatenate([np.arange(len(look.zone)), len(look.zone) + sample * zones.size + zone])

    def _sample_and_zone(self, look: _Look, index: Index) -> tuple[Index, Index]:
        count = len(look.zone)
        sample, zone = np.divmod(index - count, max(self.zones.size, 1))
        zone[index < count] = look.zone[index[index < count]]
        return np.maximum(sample, 0), zone

    def _met(self, trip: Trajectory, index: Index) -> tuple[TripPoints, ZoneContacts]:
        look = self._last.of(trip, self._look)
        count = np.count_nonzero(index < len(look.zone))
        sample, zone = self._sample_and_zone(look, index[count:])
        points = trip.kept_at(self.setup.samples).take(sample)
        contacts = self.zones.contacts(zone, points.time, points.path.position)
        minima, touched = look.minima, look.contacts
        if count < len(look.zone):
            minima, touched = rows_of(minima, index[:count]), rows_of(touched, index[:count])
        return joined([minima, points]), joined([touched, contacts])

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        return entry_gradient(self.setup, trip, *self._met(trip, index))

    def rows(self, trip: Trajectory, excess: Array) -> Rows:
        """Return the rows -dc z <= c; those of several parts of a zone are about one violation."""
        index = self.places(trip, excess)
        sample, zone = self._sample_and_zone(self._last.of(trip, self._look), index)
        group = zone if self.zones.whole is None else self.zones.whole[zone]
        points, contacts = self._met(trip, index)
        matrix = entry_gradient(self.setup, trip, points, contacts)
        return Rows(matrix, contacts.distance, group, zone * MOST_SAMPLES + sample)

    def touched(self, trip: Trajectory, near: float) -> dict[int, int]:
        """Zones that a trip is nearer to than so much, m, the deepest last, and its side: 1 to the left, or -1."""
        look = self._last.of(trip, self._look)
        distance, normal = look.contacts.distance, look.contacts.normal
        some = np.flatnonzero(distance < near)
        order = some[np.argsort(distance[some], kind="stable")]
        side = np.einsum("ij,ij->i", normal, np.broadcast_to(look.minima.path.normal, normal.shape))
        return {int(look.zone[k]): 1 if side[k] > 0.0 else -1 for k in order[::-1]}


@dataclass(frozen=True)
class SampledClearance(Constraint):
    """Entry into each part of a zone, m, at given times."""

    name: ClassVar[str] = "clearance"

    zones: ZoneBatch
    times: TimeTable

    @property
    def size(self) -> int:
        return self.zones.size

    def excess(self, trip: Trajectory) -> Array:
        """Return the entries, (n L,) m."""
        points = trip.kept_at(self.times)
        return -self.zones.distances(points.time, points.path.position).ravel()

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        sample, zone = np.divmod(index, max(self.zones.size, 1))
        return self._gradient(trip, sample, self._contacts(trip, sample, zone))

    def slope(self, trip: Trajectory, index: Index, prices: Array) -> Array:
        """Return the gradient of the sum of some entries, each at its price: contacts of one sample are added first."""
        sample, zone = np.divmod(index, max(self.zones.size, 1))
        contacts = self._contacts(trip, sample, zone)
        some, place = np.unique(sample, return_inverse=True)
        sums = np.zeros((len(some), 3))
        np.add.at(sums, place, prices[:, None] * np.column_stack([contacts.normal, contacts.rate]))
        summed = ZoneContacts(np.zeros(len(some)), sums[:, :2], sums[:, 2])
        total: Array = self._gradient(trip, some, summed).sum(axis=0)
        return total

    def _contacts(self, trip: Trajectory, sample: Index, zone: Index) -> ZoneContacts:
        points = trip.kept_at(self.times)
        return self.zones.contacts(zone, points.time[sample], points.path.position[sample])

    def _gradient(self, trip: Trajectory, sample: Index, contacts: ZoneContacts) -> Array:
        """Gradient of entries: the vehicle stands before it sets off and after it has arrived."""
        points = trip.kept_at(self.times).take(sample)
        stands = (points.distance < 0.0) | (points.distance > trip.path.arc_length)
        return entry_gradient(self.setup, trip, points, contacts, stands)


def entry_gradient(
    setup: Setup,
    trip: Trajectory,
    points: TripPoints,
    contacts: ZoneContacts,
    stands: Mask | None = None,
    ahead: float = 0.0,
) -> Array:
    """Gradient of entries, (m, step), at points of a trip, or of a disc so many m ahead of them."""
    path, tau, normal = points.path, trip.travel_time, contacts.normal
    x, y = normal[:, 0], normal[:, 1]
    along = (x * path.direction[:, 0] + y * path.direction[:, 1]) / path.speed
    if stands is not None:
        along[stands] = 0.0
    if ahead == 0.0:
        sideways = x * path.normal[:, 0] + y * path.normal[:, 1]
        rows = sideways[:, None] * setup.space.path.rows_at(path.span, path.local)
    else:
        swing = Swing.of(path)
        along += ahead * trip.path.bend(path).curvature * (x * swing.across[:, 0] + y * swing.across[:, 1])
        rows = swing.rows(trip.path, path, normal, ahead)
    theta = trip.path.arc_length_gradient(points.parameter)
    theta *= along[:, None]
    theta -= rows
    beta = (-tau * tau * along)[:, None] * points.table.distance
    return setup.of_all(theta, beta, -tau * points.table.sigma * (along * setup.space.start_speed + contacts.rate))


def local_minima(values: Array, below: float) -> tuple[Index, Index]:
    low = values < below
    low[1:] &= values[1:] <= values[:-1]
    low[:-1] &= values[:-1] < values[1:]
    row, column = np.nonzero(low)
    return row, column


def refine_minima(grid: Array, values: Array, row: Index, column: Index) -> Array:
    """Abscissae of the minima of parabolas through a sample and its two neighbours, on an equidistant grid."""
    last = len(grid) - 1
    inner = np.minimum(np.maximum(row, 1), last - 1)
    before, here, after = (values[inner + k, column] for k in (-1, 0, 1))
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / np.where(bend > 0.0, bend, np.inf)
    shift = np.where((row > 0) & (row < last), np.minimum(np.maximum(shift, -1.0), 1.0), row - inner)
    return grid[inner] + shift * (grid[1] - grid[0])


def clearance(setup: Setup) -> Iterator[Constraint]:
    """Make the clearance from all zones."""
    yield Clearance(setup, setup.zones)
