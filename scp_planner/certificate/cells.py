"""Clearance of the vehicle's discs from the occupied cells of a map, at all times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.checked_trip import PIECES, Checked, EnclosedT
from scp_planner.certificate.clearance import EFFORT, Kept, least_clearance
from scp_planner.certificate.enclosures import Pieces, VehicleDisc
from scp_planner.certificate.verdict import Clearance, Violation
from scp_planner.mathematics.occupancy import NAME, OccupancyMap
from scp_planner.threat_zones.bounds import MovingPoint

SLACK = 0.5**0.5  # cells, from the centre of one to its farthest point
NEIGHBOURS = 16  # of which the nearest square is looked for
SIGHT = 4.0  # radii, within which cells are looked for: others are that far away at least
FEWEST = 16  # cells, within which they are looked for at least


@dataclass(frozen=True, eq=False)
class NearCells:
    """The occupied cells near a trip, by their centres, in cells; none other is nearer than a distance, in cells."""

    ground: OccupancyMap
    centres: Array  # (n, 2)
    beyond: float

    @classmethod
    def of(cls, ground: OccupancyMap, low: Array, high: Array, sight: int) -> NearCells:
        """Return the cells at the border of what is occupied within a sight of boxes (k, 2), all in cells."""
        blocks: set[tuple[int, int]] = set()
        for first, last in zip(
            np.floor(low / sight).astype(np.intp) - 1, np.floor(high / sight).astype(np.intp) + 1, strict=True
        ):
            blocks.update((x, y) for x in range(first[0], last[0] + 1) for y in range(first[1], last[1] + 1))
        found: list[Array] = [np.zeros((0, 2))]
        for block in sorted(blocks):
            corner = sight * np.array(block)
            first = ground.clipped(corner - 1, 2)
            cells = ground.window(first, ground.clipped(corner + sight, 2))
            inner = cells[:-2, 1:-1] & cells[2:, 1:-1] & cells[1:-1, :-2] & cells[1:-1, 2:]
            rows, columns = np.nonzero(cells[1:-1, 1:-1] & ~inner)
            found.append((np.stack([columns, rows], axis=1) + first).astype(np.float64) + 1.5)
        return cls(ground, np.concatenate(found), float(sight))

    @cached_property
    def tree(self) -> object:
        """The centres, to be asked for the nearest."""
        from scipy.spatial import cKDTree

        return cKDTree(self.centres)

    def distances(self, places: Array) -> tuple[Array, Array]:
        """Distances of places (n, 2) in cells from the nearest cell that was seen, and lower bounds of those from any.

        Less than nothing inside of a cell.
        """
        value = np.full(len(places), self.beyond)
        lower = value.copy()
        count = min(NEIGHBOURS, len(self.centres))
        if count:
            away, which = self.tree.query(places, k=np.arange(1, count + 1), distance_upper_bound=self.beyond)  # type: ignore[attr-defined]
            centres = np.concatenate([self.centres, [[np.inf, np.inf]]])[which]
            outside = np.maximum(np.abs(places[:, None] - centres) - 0.5, 0.0)
            nearest = np.hypot(outside[..., 0], outside[..., 1]).min(axis=1)
            value = np.minimum(value, nearest)
            rest = away[:, -1] - SLACK if count < len(self.centres) else np.inf  # those that were not looked at
            lower = np.minimum(value, np.minimum(rest, self.beyond - SLACK))
        inside = self.ground.at(self.ground.clipped(places))
        return np.where(inside, -1.0, value), np.where(inside, -1.0, lower)


class CellsRound:
    """The occupied cells round a disc on its way."""

    def __init__(self, ground: OccupancyMap, radius: float) -> None:
        self._ground, self._sight = ground, max(SIGHT * radius, FEWEST * ground.resolution)
        self._near: NearCells | None = None

    def distances(self, disc: MovingPoint) -> tuple[Array, Array]:
        """Distances of the disc's centre in the middle of pieces, m in the world, and lower bounds of those on each."""
        size, places, away = self._ground.resolution, self._ground.local(disc.position), reach(disc)
        long = ~(away <= self._sight)  # of these the parts are looked at
        if self._near is None:
            far = away[~long, None] / size
            near = NearCells.of(
                self._ground, places[~long] - far, places[~long] + far, max(round(self._sight / size), FEWEST)
            )
            self._near = None if long.any() else near
        else:
            near = self._near
        value, lower = near.distances(places)
        return size * value, np.where(long, -np.inf, size * lower - away)


def clearance_kept(checked: Checked[EnclosedT], pieces: Pieces, discs: Sequence[VehicleDisc], precision: float) -> Kept:
    """Bound the clearance of a vehicle, whose discs are in its order, from zones and from the cells of a map."""
    kept, ground = least_clearance(checked, pieces, discs, precision), checked.scenario.ground
    if ground is None:
        return kept
    offsets = zip(checked.scenario.vehicle.discs, discs, strict=True)
    return Kept.of_all([kept, *(_clear_of_cells(checked, ground.map, pieces, *one, precision) for one in offsets)])


def _clear_of_cells(
    checked: Checked[EnclosedT],
    ground: OccupancyMap,
    pieces: Pieces,
    offset: float,
    disc: VehicleDisc,
    precision: float,
) -> Kept:
    """Bound the clearance of a disc, so far ahead of the reference point, m, from all occupied cells."""
    radius = checked.scenario.vehicle.radius
    near = CellsRound(ground, radius)
    certified, least, at = np.inf, np.inf, 0.0
    for _ in range(PIECES.max_halvings // 2):
        checked.go_on()
        value, lower = near.distances(replace(disc, position=checked.frame.to_world(disc.position)))
        value, lower = value - radius - disc.off, lower - radius - disc.most_off
        worst = int(np.argmin(value))
        if value[worst] < least:
            least, at = float(value[worst]), float(pieces.middle[worst])
        if not least >= -checked.slack:
            break
        done = (lower >= 0.0) & (lower >= least - precision)
        certified = min(certified, float(lower[done].min(initial=np.inf)))
        if done.all():
            return Kept(Clearance(certified, NAME, checked.absolute(at)))
        if int((~done).sum()) > EFFORT.most_pieces:
            break
        pieces = pieces.cut(~done, 4)
        disc = checked.enclosed(pieces).disc(offset)
    touched = Violation("clearance", least, 0.0, checked.absolute(at), NAME, checked.slack)
    return Kept(Clearance(least, NAME, checked.absolute(at)), (touched,))


def reach(disc: MovingPoint) -> Array:
    """Distance that a disc gets from its place in the middle of each piece at most, m."""
    found: Array = np.hypot(*disc.velocity.T) * disc.half + 0.5 * disc.acceleration * disc.half * disc.half
    return found
