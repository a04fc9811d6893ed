"""Clearance of the vehicle's discs from zones and from the sides of the workspace, at all times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic

import numpy as np

from scp_planner.arrays import Index, rows_of
from scp_planner.certificate.bounding import Bounded, largest
from scp_planner.certificate.checked_trip import PIECES, Checked, EnclosedT
from scp_planner.certificate.enclosures import Pieces, VehicleDisc
from scp_planner.certificate.tolerances import END_TOLERANCE
from scp_planner.certificate.verdict import Clearance, Violation
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.bounds import DistanceBounds, ZoneBounds


@dataclass(frozen=True)
class ClearanceEffort:
    """Most work that is done to bound a clearance."""

    most_pieces: int = 20_000  # still undecided: along a zone at exactly no distance, no halving decides
    pairs_in_memory: int = 1_000_000  # of intervals and zones
    pairs_at_once: int = 2**15  # of them whose distances are bounded closely
    first_pairs: int = 8  # of intervals and zones, with which the least clearance is looked for


EFFORT = ClearanceEffort()
_SIDES = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])  # normals of the workspace, to the inside


@dataclass(frozen=True)
class Kept:
    """The least clearance of a vehicle, and what it touches."""

    clearance: Clearance
    violations: tuple[Violation, ...] = ()

    @classmethod
    def of_all(cls, found: Sequence[Kept]) -> Kept:
        """Return what is said of all at once."""
        least = min(found, key=lambda one: one.clearance.minimum).clearance
        return cls(least, tuple(violation for one in found for violation in one.violations))


def least_clearance(
    checked: Checked[EnclosedT], pieces: Pieces, discs: Sequence[VehicleDisc], precision: float
) -> Kept:
    """Bound the clearance of a vehicle, whose discs are in its order, from all zones."""
    near = checked.near(max(float(disc.most_off.max(initial=0.0)) for disc in discs))
    offsets = checked.scenario.vehicle.discs
    return Kept.of_all(
        [
            _Search(checked, near, offset, precision).kept(pieces, disc)
            for offset, disc in zip(offsets, discs, strict=True)
        ]
    )


@dataclass(frozen=True)
class _Nearest:
    """The least distance that was seen, m, at which normalised time, and to which zone of the batch."""

    distance: float
    sigma: float
    zone: int


@dataclass(frozen=True)
class _Bound:
    """A lower bound of the clearance, m, or less than 0 if there is none; and the nearest that was seen."""

    certified: float
    nearest: _Nearest


@dataclass(frozen=True)
class _Open:
    """Pairs of pieces and zones, (n,) each, that are not decided."""

    interval: Index
    zone: Index


class _Search(Generic[EnclosedT]):
    """The search for the least clearance of one disc, so far ahead of the reference point, m."""

    def __init__(self, checked: Checked[EnclosedT], batch: ZoneBatch, offset: float, precision: float) -> None:
        self.checked, self.batch = checked, batch
        self.offset, self.precision = offset, precision

    def kept(self, pieces: Pieces, disc: VehicleDisc) -> Kept:
        """Return the clearance, and the violation if it is none."""
        if self.batch.size == 0:
            return Kept(Clearance(float("inf")))
        at_once, least = max(EFFORT.pairs_in_memory // self.batch.size, 1), list[Kept]()
        for begin in range(0, len(pieces.middle), at_once):
            some = slice(begin, begin + at_once)
            least.append(self._on(rows_of(pieces, some), rows_of(disc, some)))
            if least[-1].violations:
                return least[-1]
        return min(least, key=lambda one: one.clearance.minimum)

    def _on(self, pieces: Pieces, disc: VehicleDisc) -> Kept:
        """Return the clearance on some of the pieces."""
        crude = ZoneBounds(self.batch).crude(disc, self.checked.go_on) - disc.most_off[:, None]
        place, zone = divmod(int(np.argmin(crude)), self.batch.size)
        nearest, enough = _Nearest(np.inf, float(pieces.middle[place]), zone), 0.0
        if np.isfinite(self.precision):
            some = np.argpartition(crude, min(EFFORT.first_pairs, crude.size) - 1, axis=None)[: EFFORT.first_pairs]
            interval, zones = np.divmod(some, self.batch.size)
            value = ZoneBounds(self.batch).fine(zones, interval, disc).value - disc.off[interval]
            worst = int(np.argmin(value))
            nearest = _Nearest(float(value[worst]), float(pieces.middle[interval[worst]]), int(zones[worst]))
            enough = max(nearest.distance - self.precision, 0.0)
        far = crude >= enough
        interval, zones = np.nonzero(~far)
        certified = float(crude[far].min(initial=np.inf))
        return self._told(self._refined(pieces, disc, _Open(interval, zones), certified, nearest))

    def _refined(self, pieces: Pieces, disc: VehicleDisc, left: _Open, certified: float, nearest: _Nearest) -> _Bound:
        """Quarter pieces on which a zone's bound does not decide, until all are decided or one is touched."""
        for _ in range(PIECES.max_halvings // 2):
            if not len(left.interval):
                return _Bound(certified, nearest)
            bound = self._fine(left, disc)
            values, lower = bound.value - disc.off[left.interval], bound.lower - disc.most_off[left.interval]
            worst = int(np.argmin(values))
            value = float(values[worst])
            if value < nearest.distance:
                nearest = _Nearest(value, float(pieces.middle[left.interval[worst]]), int(left.zone[worst]))
            if not nearest.distance >= -self.checked.slack:
                return _Bound(nearest.distance, nearest)
            if not np.isfinite(value):
                break
            # Good enough: certainly outside, and not far below the least value found.
            done = (lower >= 0.0) & (lower >= nearest.distance - self.precision)
            if done.any():
                certified = min(certified, float(lower[done].min()))
            if done.all():
                return _Bound(certified, nearest)
            open_pieces, inverse = np.unique(left.interval[~done], return_inverse=True)
            if len(open_pieces) > EFFORT.most_pieces:
                break
            keep = np.zeros(len(pieces.middle), dtype=bool)
            keep[open_pieces] = True
            pieces = pieces.cut(keep, 4)
            parts = np.arange(len(pieces.middle) // len(open_pieces))[:, None]
            left = _Open((inverse + len(open_pieces) * parts).ravel(), np.tile(left.zone[~done], len(parts)))
            disc = self.checked.enclosed(pieces).disc(self.offset)
        return _Bound(-np.inf, nearest)

    def _fine(self, left: _Open, disc: VehicleDisc) -> DistanceBounds:
        """Bound the distances of pairs, so many at a time as take little memory and time."""
        bounds, count = ZoneBounds(self.batch), len(left.zone)
        if count <= EFFORT.pairs_at_once:
            return bounds.fine(left.zone, left.interval, disc)
        value, lower = np.empty(count), np.empty(count)
        for begin in range(0, count, EFFORT.pairs_at_once):
            self.checked.go_on()
            some = slice(begin, begin + EFFORT.pairs_at_once)
            part = bounds.fine(left.zone[some], left.interval[some], disc)
            value[some], lower[some] = part.value, part.lower
        return DistanceBounds(value, lower)

    def _told(self, bound: _Bound) -> Kept:
        """Return what is said of a bound; one that is no number is none."""
        nearest = bound.nearest
        time, obstacle = self.checked.absolute(nearest.sigma), self.batch.ids[nearest.zone]
        if bound.certified >= 0.0:
            return Kept(Clearance(bound.certified, obstacle, time))
        touched = Violation("clearance", nearest.distance, 0.0, time, obstacle, self.checked.slack)
        return Kept(Clearance(nearest.distance, obstacle, time), (touched,))


def leaves_bounds(checked: Checked[EnclosedT], pieces: Pieces, enclosed: EnclosedT, offset: float) -> Violation | None:
    """Return where a disc of the vehicle leaves the workspace box, by the same bound as for clearance."""
    box, frame = checked.scenario.bounds, checked.frame
    if box is None:
        return None
    offsets = np.array([box.min[0], -box.max[0], box.min[1], -box.max[1]]) + checked.scenario.vehicle.radius

    def beyond(one: EnclosedT) -> Bounded:
        disc = one.disc(offset)
        half = disc.half[:, None]
        inside = frame.to_world(disc.position) @ _SIDES.T - offsets - disc.off[:, None]
        slope = np.abs(frame.vectors_to_world(disc.velocity) @ _SIDES.T)
        lower = inside - slope * half - 0.5 * disc.acceleration[:, None] * half * half
        lower -= (disc.most_off - disc.off)[:, None]
        return Bounded(-inside.min(axis=1), -lower.min(axis=1))

    found = largest(checked, pieces, enclosed, END_TOLERANCE * checked.unit.length, beyond, parts=2)
    return None if found.kept else checked.broken("workspace bounds", -found.value, 0.0, found.when)
