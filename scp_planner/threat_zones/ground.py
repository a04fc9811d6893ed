"""Polygons that stand and are known: what may be told of all of them by the lines of their edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.outlines import Outlines


@dataclass(frozen=True)
class Ground:
    """Polygons that stand, by the lines of their edges.

    Attributes
    ----------
    zones : (s,) array of int
        Which zones they are.
    normals : (E, 2) array
        Outward unit normals of all edges, those of a polygon together.
    offsets : (E,) array
        normal . p on the line of each edge, m.
    first : (s,) array of int
        Where the edges of each polygon begin.
    """

    zones: Index
    normals: Array
    offsets: Array
    first: Index

    @classmethod
    def of(cls, zones: Index, outlines: Outlines, some: Index, places: Array) -> Ground:
        """Return the edges of some polygons about places, (s, 2) m."""
        (first, own, _), counts, edges = outlines.ragged(some), outlines.counts[some], outlines.edges
        normals = edges.normal[own]
        offsets = np.einsum("ij,ij->i", normals, edges.start[own] + places.repeat(counts, axis=0))
        return cls(zones, normals, offsets, first)

    def heights(self, points: Array) -> Array:
        """Return how far points, (n, 2) m, are beyond the farthest edge, (n, s) m: outside at most the distance."""
        return np.maximum.reduceat(points @ self.normals.T - self.offsets, self.first, axis=1)

    def least_heights(self, points: Array, moves: Array) -> Array:
        """Return the same, at least, for points that move by no more than some vectors, (n, 2) m, to either side."""
        heights = points @ self.normals.T
        heights -= np.abs(moves @ self.normals.T)
        heights -= self.offsets
        return np.maximum.reduceat(heights, self.first, axis=1)
