"""Clearance of the vehicle's discs from zones and from the sides of the workspace, at all times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.certificate.checked_trip import PIECES, CheckedTrip
from scp_planner.certificate.enclosures import Enclosure, Pieces
from scp_planner.certificate.tolerances import END_TOLERANCE, LENGTH_TOLERANCE
from scp_planner.certificate.verdict import Clearance, Violation
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.bounds import DistanceBounds, MovingPoint, ZoneBounds
from scp_planner.threat_zones.nearness import NEARNESS, SweptBoxes, least_clearances
from scp_planner.tracking.error_tube import TrackingTube


@dataclass(frozen=True)
class ClearanceEffort:
    """Most work that is done to bound a clearance."""

    most_pieces: int = 20_000  # still undecided: along a zone at exactly no distance, no halving decides
    many_zones: int = 32  # more than these are first searched for those that can matter
    pairs_at_once: int = 2**15  # of them whose distances are bounded closely
    first_pairs: int = 8  # of intervals and zones, with which the least clearance is looked for


EFFORT = ClearanceEffort()
_SIDES = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])  # normals of the workspace, to the inside


@dataclass(frozen=True)
class VehicleDisc:
    """A disc of the vehicle on pieces of time."""

    offset: float  # m
    center: MovingPoint  # On the pieces
    off: Array  # (n,) m
    most_off: Array  # (n,) m

    @classmethod
    def on(cls, enclosure: Enclosure, offset: float, tube: TrackingTube | None = None) -> VehicleDisc:
        """Return a disc that is so far ahead on the pieces of an enclosure, and how far it may be off there."""
        center = enclosure.disc(offset)
        if tube is None:
            nothing = np.zeros(len(enclosure.time))
            return cls(offset, center, nothing, nothing)
        fastest = enclosure.speed + enclosure.acceleration_bound * enclosure.half
        off = tube.standing + tube.per_speed * enclosure.speed + tube.per_lateral * np.abs(enclosure.lateral)
        most = tube.standing + tube.per_speed * fastest + tube.per_lateral * enclosure.lateral_bound
        return cls(offset, center, off, np.maximum(off, most))

    def part(self, index: slice | Mask) -> VehicleDisc:
        """Return the disc on some of the pieces."""
        return VehicleDisc(self.offset, self.center.take(index), self.off[index], self.most_off[index])

    def with_more(self, more: VehicleDisc) -> VehicleDisc:
        """Return the disc on these pieces and, after them, on others."""
        off, most_off = np.concatenate([self.off, more.off]), np.concatenate([self.most_off, more.most_off])
        return VehicleDisc(self.offset, self.center.with_more(more.center), off, most_off)


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


def least_clearance(checked: CheckedTrip, pieces: Pieces, discs: tuple[VehicleDisc, ...], precision: float) -> Kept:
    """Bound the clearance of a vehicle from all zones."""
    near = _near_batch(checked, max(float(disc.most_off.max(initial=0.0)) for disc in discs))
    return Kept.of_all([_Search(checked, near, disc, precision).kept(pieces) for disc in discs])


def _near_batch(checked: CheckedTrip, most_off: float) -> ZoneBatch:
    """The zones that could be the nearest one, or nearer than allowed, to a vehicle that is off by so much at most."""
    batch, trajectory = checked.batch, checked.trajectory
    # Of polygons that stand the bound to begin with is hardly dearer than these.
    standing = 0 if batch.ground is None else len(batch.ground.zones)
    if batch.size - standing <= EFFORT.many_zones:
        return batch
    top = max(float(trajectory.speed_control_points().max()), 0.0)
    ahead = max(map(abs, checked.scenario.vehicle.discs))
    for count in NEARNESS.looks:
        checked.go_on()
        # Only where it is checked: a zone says nothing of what lies before it was made.
        half = 0.5 * (checked.last - checked.first) / count
        middle = np.linspace(checked.first + half, checked.last - half, count)
        points = trajectory.driven(trajectory.space.time_table(middle))
        half *= trajectory.travel_time
        reach, position = half * top + ahead, points.path.position
        bounds = least_clearances(batch, SweptBoxes(points.time, half, position - reach, position + reach))
        if np.isneginf(bounds).all():
            return batch
        # The nearest zone comes at least as near as any zone is seen to be.
        seen = batch.subset(np.argsort(bounds)[: NEARNESS.few_zones])
        nearest = max(float(seen.distances(points.time, position).min()), 0.0)
        batch = batch.subset(np.flatnonzero(bounds <= nearest + most_off))
    return batch


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


class _Search:
    """The search for the least clearance of one disc."""

    def __init__(self, checked: CheckedTrip, batch: ZoneBatch, disc: VehicleDisc, precision: float) -> None:
        self.checked, self.batch = checked, batch
        self.disc, self.precision = disc, precision

    def kept(self, pieces: Pieces) -> Kept:
        """Return the clearance, and the violation if it is none."""
        if self.batch.size == 0:
            return Kept(Clearance(float("inf")))
        disc = self.disc
        crude = ZoneBounds(self.batch).crude(disc.center, self.checked.go_on) - disc.most_off[:, None]
        place, zone = divmod(int(np.argmin(crude)), self.batch.size)
        nearest, enough = _Nearest(np.inf, float(pieces.middle[place]), zone), 0.0
        if np.isfinite(self.precision):
            some = np.argsort(crude, axis=None)[: EFFORT.first_pairs]
            interval, zones = np.divmod(some, self.batch.size)
            value = ZoneBounds(self.batch).fine(zones, interval, disc.center).value - disc.off[interval]
            worst = int(np.argmin(value))
            nearest = _Nearest(float(value[worst]), float(pieces.middle[interval[worst]]), int(zones[worst]))
            enough = max(nearest.distance - self.precision, 0.0)
        far = crude >= enough
        interval, zones = np.nonzero(~far)
        return self._told(self._refined(pieces, _Open(interval, zones), float(crude[far].min(initial=np.inf)), nearest))

    def _refined(self, pieces: Pieces, left: _Open, certified: float, nearest: _Nearest) -> _Bound:
        """Quarter pieces on which a zone's bound does not decide, until all are decided or one is touched."""
        disc = self.disc
        for _ in range(PIECES.max_halvings // 2):
            if not len(left.interval):
                return _Bound(certified, nearest)
            bound = self._fine(left, disc)
            values, lower = bound.value - disc.off[left.interval], bound.lower - disc.most_off[left.interval]
            worst = int(np.argmin(values))
            value = float(values[worst])
            if value < nearest.distance:
                nearest = _Nearest(value, float(pieces.middle[left.interval[worst]]), int(left.zone[worst]))
            if not nearest.distance >= -LENGTH_TOLERANCE:
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
            pieces = pieces.quarters(keep)
            parts = np.arange(len(pieces.middle) // len(open_pieces))[:, None]
            left = _Open((inverse + len(open_pieces) * parts).ravel(), np.tile(left.zone[~done], len(parts)))
            disc = VehicleDisc.on(self.checked.enclosed(pieces), disc.offset, self.checked.tube)
        return _Bound(-np.inf, nearest)

    def _fine(self, left: _Open, disc: VehicleDisc) -> DistanceBounds:
        """Bound the distances of pairs, so many at a time as take little memory and time."""
        bounds, count = ZoneBounds(self.batch), len(left.zone)
        if count <= EFFORT.pairs_at_once:
            return bounds.fine(left.zone, left.interval, disc.center)
        value, lower = np.empty(count), np.empty(count)
        for begin in range(0, count, EFFORT.pairs_at_once):
            self.checked.go_on()
            some = slice(begin, begin + EFFORT.pairs_at_once)
            part = bounds.fine(left.zone[some], left.interval[some], disc.center)
            value[some], lower[some] = part.value, part.lower
        return DistanceBounds(value, lower)

    def _told(self, bound: _Bound) -> Kept:
        """Return what is said of a bound; one that is no number is none."""
        nearest = bound.nearest
        time, obstacle = self.checked.absolute(nearest.sigma), self.batch.ids[nearest.zone]
        if bound.certified >= 0.0:
            return Kept(Clearance(bound.certified, obstacle, time))
        touched = Violation("clearance", nearest.distance, 0.0, time, obstacle)
        return Kept(Clearance(nearest.distance, obstacle, time), (touched,))


def leaves_bounds(checked: CheckedTrip, pieces: Pieces, disc: VehicleDisc) -> Violation | None:
    """Return where a disc of the vehicle leaves the workspace box, by the same bound as for clearance."""
    box = checked.scenario.bounds
    if box is None:
        return None
    frame = checked.trip.frame
    radius = checked.scenario.vehicle.radius
    offsets = np.array([box.min[0], -box.max[0], box.min[1], -box.max[1]]) + radius
    at = 0.0
    for _ in range(PIECES.max_halvings):
        center = disc.center
        inside = frame.to_world(center.position) @ _SIDES.T - offsets - disc.off[:, None]
        slope = np.abs(frame.vectors_to_world(center.velocity) @ _SIDES.T)
        half = center.half[:, None]
        lower = inside - slope * half - 0.5 * center.acceleration[:, None] * half * half
        lower -= (disc.most_off - disc.off)[:, None]
        worst = np.unravel_index(np.argmin(inside), inside.shape)
        at = float(pieces.middle[worst[0]])
        if inside[worst] < -END_TOLERANCE:
            break
        undecided = ~(lower >= -END_TOLERANCE).all(axis=1)
        if not undecided.any():
            return None
        pieces = pieces.halves(undecided)
        disc = VehicleDisc.on(checked.enclosed(pieces), disc.offset, checked.tube)
    return checked.broken("workspace bounds", float(inside[worst]), 0.0, at)
