"""Many zones at once, in the planning frame: distances, contacts, and bounds on intervals of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array, Index, Mask, cross, rows_of
from scp_planner.mathematics.ellipse import Contact, ellipse_contact, support, support_point
from scp_planner.mathematics.frames import PlanningFrame, covariance_turned_back, directions_of, turned_back
from scp_planner.mathematics.outlines import Outlines
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.mathematics.tolerances import DECIMALS
from scp_planner.threat_zones.contacts import ZoneContacts, distinct, leading
from scp_planner.threat_zones.convex_parts import ConvexPart
from scp_planner.threat_zones.ground import Ground
from scp_planner.threat_zones.sorted_zones import KnownDiscs, SortedZones
from scp_planner.threat_zones.tolerances import DIRECTION_DECIMALS
from scp_planner.threat_zones.zone import ThreatZone


@dataclass(frozen=True)
class BatchChunks:
    """Work that is done at a time."""

    few_edges: int = 2**12  # that stand: those of a corridor of some hundred polygons are all looked at
    # an edge of a polygon that a point is near to, in edges of which the line is looked at, at all points
    pair_cost: int = 10
    together: int = 40_000  # distances that are computed together


CHUNKS = BatchChunks()
_ALL = slice(None)
_NO_DISCS = KnownDiscs(np.zeros(0, dtype=np.intp), [], np.zeros(0), np.zeros((0, 3, 2)))


@dataclass(frozen=True, eq=False)
class ZoneBatch:
    """All zones of a plan, in the planning frame, for evaluation at many times at once."""

    ids: tuple[str, ...]
    radius: Array  # (L,) m, with the vehicle's disc and the planner's own margin
    centers: PiecewisePolynomials  # m, of the planning clock
    uncertain: Index  # (u,)
    covariances: PiecewisePolynomials | None  # (xx, xy, yy) of their scaled covariances, m^2; None without such zones
    shaped: Index  # (s,)
    outlines: Outlines | None
    own_directions: PiecewisePolynomials | None = None
    expected: PiecewisePolynomials | None = None  # predicted means, m; None where all are the centres

    @classmethod
    def of(cls, zones: Sequence[ThreatZone], frame: PlanningFrame, inflation: float) -> ZoneBatch:
        """Return the batch of zones in world coordinates."""
        discs = zones.discs if isinstance(zones, SortedZones) else _NO_DISCS
        others = zones.others if isinstance(zones, SortedZones) else range(len(zones))
        numbered = [(k, part) for k in others for part in ConvexPart.all_of(zones[k])]
        parts = [part for _, part in numbered]
        ids = [*discs.ids, *(part.id for part in parts)]
        radius = np.array([part.radius for part in parts])
        known = [discs.centers] if len(discs.index) else []

        def sorted_points(paths: Sequence[PiecewisePolynomials]) -> PiecewisePolynomials:
            points = frame.points_batch([*known, *paths])
            return rows_of(points, order) if known and parts else points

        place = order = np.arange(len(parts))
        if known:  # discs first, then all in the order of the zones
            still_to_sort = np.concatenate([discs.index, np.array([k for k, _ in numbered], dtype=np.intp)])
            order = np.argsort(still_to_sort, kind="stable")
            place = np.empty(len(order), dtype=np.intp)
            place[order] = np.arange(len(order))
            place = place[len(discs.index) :]
            ids, radius = [ids[k] for k in order.tolist()], np.concatenate([discs.radius, radius])[order]
        uncertain = [
            (k, part.covariances) for k, part in zip(place, parts, strict=True) if part.covariances is not None
        ]
        shaped = [(k, part.outline) for k, part in zip(place, parts, strict=True) if part.outline is not None]
        directions = expected = None
        if any(part.pointing is not None for part in parts):
            # Of those without: along the motion. Discs have none, whatever theirs is.
            paths = [part.centers if part.pointing is None else part.pointing for part in parts]
            directions = sorted_points(paths).derivative
        if any(part.expected is not None for part in parts):
            expected = sorted_points([part.centers if part.expected is None else part.expected for part in parts])
        return cls(
            ids=tuple(ids),
            radius=radius + inflation,
            centers=sorted_points([part.centers for part in parts]),
            uncertain=np.array([k for k, _ in uncertain], dtype=np.intp),
            covariances=frame.covariances_batch([one for _, one in uncertain]) if uncertain else None,
            shaped=np.array([k for k, _ in shaped], dtype=np.intp),
            outlines=Outlines([outline for _, outline in shaped]).turned(-frame.heading) if shaped else None,
            own_directions=directions,
            expected=expected,
        )

    @cached_property
    def size(self) -> int:
        """Number of zones, L."""
        return len(self.ids)

    @cached_property
    def whole(self) -> Index | None:
        """The first part of the zone that each is a part of, (L,); None where no zone has several."""
        first: dict[str, int] = {}
        found = [first.setdefault(name, place) for place, name in enumerate(self.ids)]
        return None if len(first) == self.size else np.array(found, dtype=np.intp)

    def singles(self, place: Index, zone: Index, contacts: ZoneContacts) -> Index:
        """Contacts, (n,), without those of a part that another one has in common."""
        assert self.whole is not None, "otherwise all are"
        return distinct(np.stack([place, self.whole[zone]]), zone, contacts)

    def leaders(self, place: Index, zone: Index, contacts: ZoneContacts, move: float) -> Index:
        """Contacts, (n,), that no other one of the same zone implies for moves up to a length, m."""
        if self.whole is None:
            return np.arange(len(zone))
        return leading(place * self.size + self.whole[zone], contacts, move)

    @cached_property
    def velocities(self) -> PiecewisePolynomials:
        """Velocities of the centres, m/s."""
        return self.centers.derivative

    @property
    def directions(self) -> PiecewisePolynomials:
        """Vectors that turning outlines head along."""
        return self.velocities if self.own_directions is None else self.own_directions

    @cached_property
    def slot(self) -> Index:
        """Place of each zone among the uncertain ones, (L,); -1 for those that are not."""
        return _slots(self.uncertain, self.size)

    @cached_property
    def outline_slot(self) -> Index:
        """Place of each zone among those with an outline, (L,); -1 for discs."""
        return _slots(self.shaped, self.size)

    @cached_property
    def extent(self) -> Array:
        """Radius of the disc around the centre that covers each outline, (L,) m."""
        extent = np.zeros(self.size)
        if self.outlines is not None:
            extent[self.shaped] = self.outlines.reach
        return extent

    @cached_property
    def turning(self) -> Mask:
        """True if each zone turns with its motion, (L,)."""
        turning = np.zeros(self.size, dtype=bool)
        if self.outlines is not None:
            turning[self.shaped] = self.outlines.turning
        return turning

    @cached_property
    def any_turning(self) -> bool:
        """True if any zone turns."""
        return bool(self.turning.any())

    @cached_property
    def typical_radius(self) -> float | None:
        """Median radius, without what is uncertain, m; None without zones."""
        return None if self.size == 0 else float(np.median(self.radius + self.extent))

    def subset(self, index: Index) -> ZoneBatch:
        """Return the batch of some of the zones."""
        uncertain, shaped = self.slot[index], self.outline_slot[index]
        covariances, outlines = None, None
        if self.covariances is not None and np.any(uncertain >= 0):
            covariances = rows_of(self.covariances, uncertain[uncertain >= 0])
        if self.outlines is not None and np.any(shaped >= 0):
            outlines = self.outlines.take(shaped[shaped >= 0])
        return ZoneBatch(
            ids=tuple(self.ids[i] for i in index),
            radius=self.radius[index],
            centers=rows_of(self.centers, index),
            uncertain=np.flatnonzero(uncertain >= 0),
            covariances=covariances,
            shaped=np.flatnonzero(shaped >= 0),
            outlines=outlines,
            own_directions=None if self.own_directions is None else rows_of(self.own_directions, index),
            expected=None if self.expected is None else rows_of(self.expected, index),
        )

    @cached_property
    def standing(self) -> Index:
        """Zones that neither move nor grow."""
        still = ~np.any(self.velocities.coefficients, axis=(1, 2, 3))
        if self.own_directions is not None:
            still &= ~(self.turning & np.any(self.own_directions.derivative.coefficients, axis=(1, 2, 3)))
        if self.covariances is not None:
            still[self.uncertain] &= ~np.any(self.covariances.derivative.coefficients, axis=(1, 2, 3))
        return np.flatnonzero(still)

    @cached_property
    def moving(self) -> Index:
        """The other zones."""
        return np.setdiff1d(np.arange(self.size), self.standing)

    def rounded(self) -> ZoneBatch:
        """Return the batch with rounded coefficients and vertices, in m, m/s and so on, to ``DECIMALS`` and finer."""
        covariances, outlines = self.covariances, self.outlines
        if covariances is not None:
            covariances = covariances.rounded(DECIMALS + 3, DECIMALS + 3)
        if outlines is not None:
            outlines = outlines.rounded(DECIMALS + 2)
        centers = self.centers.rounded(DECIMALS, DECIMALS + 3)
        directions = self.own_directions
        if directions is not None:
            directions = directions.rounded(DIRECTION_DECIMALS, DIRECTION_DECIMALS)
        radius = np.round(self.radius, DECIMALS + 3)
        return replace(
            self, centers=centers, radius=radius, covariances=covariances, outlines=outlines, own_directions=directions
        )

    def inflated(self, extra: Array) -> ZoneBatch:
        """Return the batch with every zone larger by ``extra``, (L,) m."""
        return replace(self, radius=self.radius + extra)

    def distances(self, times: Array, points: Array, exact_below: float = np.inf) -> Array:
        """Signed distances of one moving point to all zones."""
        if self.ground is None or not self._ground_pays(points, exact_below):
            return self._distances(times, points, exact_below)
        distance = np.empty((self.size, len(times))).T  # as that of polygons comes
        distance[:, self.ground.zones] = self.ground.distances(points) - self.radius[self.ground.zones]
        if len(self._besides_ground):
            distance[:, self._besides_ground] = self._without_ground.distances(times, points, exact_below)
        return distance

    @cached_property
    def _besides_ground(self) -> Index:
        """Zones that are no polygons that stand and are known."""
        assert self.ground is not None
        return np.setdiff1d(np.arange(self.size), self.ground.zones)

    @cached_property
    def _on_ground(self) -> Mask:
        """True if each zone is one of the others, (L,)."""
        return ~np.isin(np.arange(self.size), self._besides_ground)

    @cached_property
    def _places(self) -> Array:
        """Centres before anything moves, (L, 2) m: where those that stand stay."""
        places: Array = self.centers.grid(np.zeros(1))[0]
        return places

    @cached_property
    def _without_ground(self) -> ZoneBatch:
        """The batch of those."""
        return self.subset(self._besides_ground)

    def _distances(self, times: Array, points: Array, exact_below: float) -> Array:
        """Signed distances to zones among which there are no polygons that stand and are known."""
        rows = max(CHUNKS.together // max(self.size, 1), 1)
        if len(times) <= rows:
            return self._distances_of_few(times, points, exact_below)
        distance = np.empty((len(times), self.size))
        for first in range(0, len(times), rows):
            some = slice(first, first + rows)
            distance[some] = self._distances_of_few(times[some], points[some], exact_below)
        return distance

    def _distances_of_few(self, times: Array, points: Array, exact_below: float) -> Array:
        """Distances of one cache-sized chunk."""
        centers = self.centers.grid(times)
        dx = points[:, 0, None] - centers[:, :, 0]
        dy = points[:, 1, None] - centers[:, :, 1]
        squared = dx * dx
        squared += dy * dy
        distance = np.sqrt(squared)
        if self.covariances is not None:
            columns = self.uncertain if len(self.uncertain) < self.size else _ALL
            covariance = self.covariances.grid(times)
            # The support in the direction of the centre gives a lower bound; exact only where that is close.
            x, y = dx[:, columns], dy[:, columns]
            quadratic = covariance[..., 0] * x * x
            quadratic += (2.0 * covariance[..., 1]) * x * y
            quadratic += covariance[..., 2] * y * y
            quadratic /= np.maximum(squared[:, columns], 1e-300)
            bound = distance[:, columns] - np.sqrt(np.maximum(quadratic, 0.0, out=quadratic))
            near = bound < exact_below + self.radius[columns]
            if self.outlines is not None:
                near[:, self.outline_slot[columns] >= 0] = False
            row, column = np.nonzero(near)
            if len(row):
                offset = np.stack([x[row, column], y[row, column]], axis=1)
                bound[row, column] = ellipse_contact(offset, covariance[row, column]).distance
            distance[:, columns] = bound
        distance -= self.radius
        if self.outlines is not None:
            self._tell_outlines(distance, times, points, exact_below)
        return distance

    def _tell_outlines(self, distance: Array, times: Array, points: Array, exact_below: float) -> None:
        """Put the distances to outlines into the array, (n, L) m, of those to their centres."""
        distance[:, self.shaped] -= self.extent[self.shaped]
        near = distance[:, self.shaped] < exact_below
        row, column = np.nonzero(near)
        if len(row):
            index = self.shaped[column]
            offset = points[row] - self.centers.at(index, times[row])
            exact = self._outline_contacts(index, times[row], offset).distance
            distance[row, index] = exact - self.radius[index]

    def _ground_pays(self, points: Array, exact_below: float) -> bool:
        """True if the lines of all edges that stand are looked at faster than the polygons that points are near to."""
        assert self.ground is not None and self.outlines is not None
        edges = len(self.ground.across)
        if edges <= CHUNKS.few_edges:
            return True
        zones = self.ground.zones
        dx, dy = (points[:, axis, None] - self._places[zones, axis] for axis in (0, 1))
        apart = np.sqrt(dx * dx + dy * dy)
        near = np.count_nonzero(apart < exact_below + (self.radius + self.extent)[zones], axis=0)
        return bool(CHUNKS.pair_cost * (near @ self.outlines.counts[self.outline_slot[zones]]) > len(points) * edges)

    @cached_property
    def ground(self) -> Ground | None:
        """Polygons that stand and are known; None without any."""
        if self.outlines is None:
            return None
        known = self.standing[(self.outline_slot[self.standing] >= 0) & (self.slot[self.standing] < 0)]
        zones = known[(self.outlines.counts[self.outline_slot[known]] > 0) & ~self.turning[known]]
        if len(zones) == 0:
            return None
        return Ground.of(zones, self.outlines, self.outline_slot[zones], self._places[zones])

    def reach(self, times: Array) -> Array:
        """Radius of a disc around the centre that covers each zone at each time, (n, L) m."""
        radius = np.broadcast_to(self.radius + self.extent, (len(times), self.size))
        if self.covariances is None:
            return radius
        covariance = self.covariances.grid(times)
        mean = 0.5 * (covariance[..., 0] + covariance[..., 2])
        spread = np.hypot(0.5 * (covariance[..., 0] - covariance[..., 2]), covariance[..., 1])
        radius = radius.copy()
        radius[:, self.uncertain] += np.sqrt(np.maximum(mean + spread, 0.0))
        return radius

    def uncertain_among(self, index: Index) -> Index | slice:
        """Places of uncertain zones among some, (n,): a slice of all if all zones are."""
        return _ALL if len(self.uncertain) == self.size else (self.slot[index] >= 0).nonzero()[0]

    def contacts(self, index: Index, times: Array, points: Array) -> ZoneContacts:
        """Exact contacts of points with chosen zones."""
        if self.ground is not None and self.outlines is not None and self._on_ground[index].all():
            standing = self.outlines.contacts(self.outline_slot[index], points - self._places[index])
            return ZoneContacts(standing.distance - self.radius[index], standing.normal, np.zeros(len(index)))
        center, velocity = self.centers.at_with_rate(index, times)
        offset = points - center
        rows = None if self.covariances is None else self.uncertain_among(index)
        if rows is not _ALL:
            distance = np.sqrt(offset[:, 0] ** 2 + offset[:, 1] ** 2)
            normal = offset / np.maximum(distance, 1e-12)[:, None]
            growth = np.zeros_like(distance)
        else:
            distance, normal, growth = np.empty(len(offset)), np.empty_like(offset), np.empty(len(offset))
        if self.covariances is not None and rows is not None:
            covariance, change = self.covariances.at_with_rate(self.slot[index[rows]], times[rows])
            exact = ellipse_contact(offset[rows], covariance)
            normal[rows], distance[rows] = exact.normal, exact.distance
            growth[rows] = _support_rate(covariance, change, exact.normal)
        rate = -(normal[:, 0] * velocity[:, 0] + normal[:, 1] * velocity[:, 1]) - growth
        if self.outlines is not None:
            (with_outline,) = (self.outline_slot[index] >= 0).nonzero()
            if len(with_outline):
                those, when, away = index[with_outline], times[with_outline], offset[with_outline]
                shaped = self._outline_contacts(those, when, away)
                normal[with_outline], distance[with_outline] = shaped.normal, shaped.distance
                rate[with_outline] = self._outline_rate(those, when, away, shaped.normal)
        return ZoneContacts(distance - self.radius[index], normal, rate)

    def _outline_contacts(self, index: Index, times: Array, offset: Array) -> Contact:
        """Contacts with outlines and their uncertainty, without the radius."""
        assert self.outlines is not None
        slot, (turning,) = self.outline_slot[index], self.turning[index].nonzero()
        headings = np.zeros((0, 2))
        if len(turning):
            headings = np.tile([1.0, 0.0], (len(index), 1))
            headings[turning] = directions_of(self.directions.at(index[turning], times[turning]))
            offset = turned_back(offset, headings)
        distance, normal = np.empty(len(index)), np.empty((len(index), 2))
        blurred = self.slot[index] >= 0
        for rows in (np.flatnonzero(blurred), np.flatnonzero(~blurred)):
            if len(rows) == 0:
                continue
            covariance = None
            if self.covariances is not None and blurred[rows[0]]:
                covariance = self.covariances.at(self.slot[index[rows]], times[rows])
                if len(headings):
                    covariance = covariance_turned_back(covariance, headings[rows])
            contact = self.outlines.contacts(slot[rows], offset[rows], covariance)
            distance[rows], normal[rows] = contact.distance, contact.normal
        if len(headings):
            normal = turned_back(normal, headings * [1.0, -1.0])
        return Contact(distance, normal)

    def _outline_rate(self, index: Index, times: Array, offset: Array, normal: Array) -> Array:
        """Time derivative of the distance at fixed points: the contact moves with the centre, grows, and turns."""
        velocity = self.velocities.at(index, times)
        rate = -np.einsum("ij,ij->i", normal, velocity)
        lever = offset
        (blurred,) = (self.slot[index] >= 0).nonzero()
        if self.covariances is not None and len(blurred):
            slot, nu = self.slot[index[blurred]], normal[blurred]
            covariance = self.covariances.at(slot, times[blurred])
            rate[blurred] -= _support_rate(covariance, self.covariances.derivative.at(slot, times[blurred]), nu)
            # The uncertainty does not turn with the shape.
            lever = offset.copy()
            lever[blurred] -= support_point(covariance, nu)
        (rows,) = self.turning[index].nonzero()
        if len(rows):
            pointing = self.directions.at(index[rows], times[rows])
            change = self.directions.derivative.at(index[rows], times[rows])
            spin = cross(pointing, change) / np.maximum((pointing**2).sum(axis=1), 1e-300)
            rate[rows] += spin * cross(normal[rows], lever[rows])
        return rate


def _slots(index: Index, size: int) -> Index:
    """Place of each of ``size`` items in a list of some of them; -1 where it is not there."""
    slot = np.full(size, -1, dtype=np.intp)
    slot[index] = np.arange(len(index))
    return slot


def _support_rate(covariance: Array, covariance_rate: Array, normal: Array) -> Array:
    """Time derivative of sqrt(nu' C nu) at a fixed nu."""
    x, y = normal[:, 0], normal[:, 1]
    quadratic_rate = covariance_rate[:, 0] * x * x + 2.0 * covariance_rate[:, 1] * x * y + covariance_rate[:, 2] * y * y
    return quadratic_rate / np.maximum(2.0 * support(covariance, normal), 1e-300)
