"""Polygons that stand and are known: what may be told of all of them by the lines of their edges."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.mathematics.outlines import Outlines


@dataclass(frozen=True)
class GroundChunks:
    """Numbers and points at once."""

    at_once: int = 2**16  # numbers, half a megabyte
    # points at once, of however many edges: else it takes longer to ask for each number than to compute it
    fewest: int = 16


CHUNKS = GroundChunks()


@dataclass(frozen=True)
class Ground:
    """Polygons that stand, by the lines of their edges: the first edges of all, the second ones and so on."""

    zones: Index  # (s,)
    across: Array  # (E, 3) Outward unit normal n of each edge, and -n . p on its line, m
    along: Array  # (E, 3) Unit vector t along each edge, and -t . p in its middle, m
    halves: Array  # (E, 1) Half of the length of each edge, m
    owner: Index  # (E,)
    ends: tuple[int, ...]

    @classmethod
    def of(cls, zones: Index, outlines: Outlines, some: Index, places: Array) -> Ground:
        """Return the edges of some polygons about places, (s, 2) m."""
        order = np.argsort(-outlines.counts[some], kind="stable")
        zones, some, places = zones[order], some[order], places[order]
        first, own, owner = outlines.ragged(some)
        number = np.arange(len(own)) - first[owner]
        by_number = np.argsort(number, kind="stable")
        own, owner, edges = own[by_number], owner[by_number], outlines.edges
        normals, tangents, lengths = edges.normal[own], edges.tangent[own], edges.length[own]
        starts = edges.start[own] + places[owner]
        across = np.column_stack([normals, -np.einsum("ij,ij->i", normals, starts)])
        along = np.column_stack([tangents, -np.einsum("ij,ij->i", tangents, starts) - 0.5 * lengths])
        ends = tuple(np.cumsum(np.bincount(number)).tolist())
        return cls(zones, across, along, 0.5 * lengths[:, None], owner, ends)

    def only(self, keep: Mask) -> Ground:
        """Return some of the polygons, (s,)."""
        edges = keep[self.owner]
        kept = np.concatenate([[0], np.cumsum(edges)])[np.array((0, *self.ends))]
        ends = tuple(kept[1 : 1 + np.count_nonzero(np.diff(kept))].tolist())
        place = np.cumsum(keep) - 1
        return Ground(
            self.zones[keep],
            self.across[edges],
            self.along[edges],
            self.halves[edges],
            place[self.owner[edges]],
            ends,
        )

    def distances(self, points: Array) -> Array:
        """Return the signed distances of points, (n, 2) m, to each polygon, (n, s) m."""
        found = np.empty((len(self.zones), len(points)))
        homogeneous = np.vstack([points.T, np.ones(len(points))])
        for some in self._some_points(len(points)):
            heights = self.across @ homogeneous[:, some]
            highest = self._extreme(heights, np.maximum)
            beyond = self.along @ homogeneous[:, some]
            np.abs(beyond, out=beyond)
            beyond -= self.halves
            np.maximum(beyond, 0.0, out=beyond)
            beyond *= beyond
            heights *= heights
            beyond += heights
            nearest = np.sqrt(self._extreme(beyond, np.minimum))
            found[:, some] = np.where(highest > 0.0, nearest, highest)
        return found.T

    def least_heights(self, points: Array, moves: Array) -> Array:
        """Return what they are at least for points that move by no more than vectors, (n, 2) m, to either side."""
        least = np.empty((len(self.zones), len(points)))
        homogeneous, normals = np.vstack([points.T, np.ones(len(points))]), self.across[:, :2]
        for some in self._some_points(len(points)):
            heights = self.across @ homogeneous[:, some]
            heights -= np.abs(normals @ moves[some].T)
            least[:, some] = self._extreme(heights, np.maximum)
        return least.T

    def _some_points(self, count: int) -> Iterator[slice]:
        """Yield parts of so many points that take little memory: fetching more costs ten times as much as filling."""
        at_once = max(CHUNKS.fewest, CHUNKS.at_once // max(len(self.across), 1))
        for begin in range(0, count, at_once):
            yield slice(begin, min(begin + at_once, count))

    def _extreme(self, values: Array, extreme: np.ufunc) -> Array:
        """The largest or least of each polygon's values, (s, n), of those of all edges, (E, n)."""
        found: Array = values[: len(self.zones)].copy()
        for begin, end in pairwise((0, *self.ends)):  # edges of one number, of those polygons that have as many
            part = found[: end - begin]
            extreme(part, values[begin:end], out=part)
        return found
