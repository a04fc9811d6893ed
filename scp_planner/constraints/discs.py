"""A long vehicle: further discs on its axis keep clear of zones, and inside the workspace box."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from scp_planner.arrays import Array, Index, rows_of
from scp_planner.constraints.box import DiscInBox
from scp_planner.constraints.clearance import entry_gradient
from scp_planner.constraints.constraint import Constraint, LastTrip
from scp_planner.constraints.setup import Setup
from scp_planner.constraints.swing import disc_positions
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.contacts import ZoneContacts
from scp_planner.threat_zones.nearness import NEARNESS, nearness_of_samples
from scp_planner.trips.trajectory import Trajectory

AS_NEAR = 1e-9  # units of length, by which clearances differ that are one: rounding is to tell no minima
STRIDE = 3  # every third sample near a zone counts, besides those around minima of clearance


@dataclass(frozen=True)
class DiscClearance(Constraint):
    """Entry of a disc, so many m ahead, into zones, m: at samples around minima of its clearance and some others."""

    name: ClassVar[str] = "discs"
    near: ClassVar[float] = NEARNESS.near

    zones: ZoneBatch
    ahead: float
    _last: LastTrip[Array] = field(default_factory=LastTrip, init=False, repr=False, compare=False)

    def among(self, zones: ZoneBatch) -> DiscClearance:
        return replace(self, zones=zones)

    @cached_property
    def _order(self) -> Index:
        return np.argsort(self.setup.samples.sigma, kind="stable")

    def excess(self, trip: Trajectory) -> Array:
        """Return the depths, (n L,) m: of each sample and zone; -inf where they do not count."""
        return self._last.of(trip, self._depths).ravel()

    def _depths(self, trip: Trajectory) -> Array:
        points = trip.kept_at(self.setup.samples)
        clearance = self.zones.distances(points.time, disc_positions(points.path, self.ahead), NEARNESS.near)
        in_order = clearance[self._order]
        lower = np.ones(clearance.shape, dtype=bool)
        rise = np.diff(in_order, axis=0)
        lower[1:] &= rise <= AS_NEAR
        lower[:-1] &= rise >= -AS_NEAR
        beside = lower.copy()
        beside[1:] |= lower[:-1]
        beside[:-1] |= lower[1:]
        beside[::STRIDE] |= in_order[::STRIDE] < nearness_of_samples(self.zones, NEARNESS.near)
        counts = np.empty_like(beside)
        counts[self._order] = beside
        return np.where(counts, -clearance, -np.inf)

    def places(self, trip: Trajectory, excess: Array) -> Index:
        """Return the depths that are looked at in a step, without those that others imply."""
        index = super().places(trip, excess)
        if self.zones.whole is None:
            return index
        sample, zone = np.divmod(index, self.zones.size)
        return index[
            self.zones.leaders(sample, zone, self._contacts(trip, sample, zone), NEARNESS.abreast * NEARNESS.near)
        ]

    def _contacts(self, trip: Trajectory, sample: Index, zone: Index) -> ZoneContacts:
        points = trip.kept_at(self.setup.samples)
        return self.zones.contacts(zone, points.time[sample], disc_positions(rows_of(points.path, sample), self.ahead))

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        sample, zone = np.divmod(index, max(self.zones.size, 1))
        points, contacts = trip.kept_at(self.setup.samples).take(sample), self._contacts(trip, sample, zone)
        return entry_gradient(self.setup, trip, points, contacts, ahead=self.ahead)

    def touched(self, trip: Trajectory, near: float) -> dict[int, int]:
        """Zones that the disc is nearer to than so much, m, and its side of them: 1 to the left, or -1."""
        depths = self._last.of(trip, self._depths)
        zone = np.flatnonzero(depths.max(axis=0, initial=-np.inf) > -near)
        sample = depths[:, zone].argmax(axis=0)
        normal = self._contacts(trip, sample, zone).normal
        sides = (normal * rows_of(trip.kept_at(self.setup.samples).path, sample).normal).sum(axis=1)
        return dict(zip(zone.tolist(), np.where(sides > 0.0, 1, -1).tolist(), strict=True))


def discs(setup: Setup) -> Iterator[Constraint]:
    """Make what keeps the further discs of a long vehicle clear of zones, and inside the box."""
    for ahead in setup.vehicle.discs:
        if ahead != 0.0:
            yield DiscClearance(setup, setup.zones, ahead)
            if len(setup.box.offsets):
                yield DiscInBox(setup, setup.box, ahead)
