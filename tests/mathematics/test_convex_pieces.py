"""Concave polygons as unions of convex ones, against areas and distances of shapely."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import Point, Polygon
from shapely.ops import unary_union

from scp_planner.mathematics.convex_pieces import convex_pieces
from scp_planner.mathematics.outlines import Outlines

if TYPE_CHECKING:
    from scp_planner.arrays import Array

pytestmark = pytest.mark.numerics


def star(rng: np.random.Generator, corners: int) -> Array:
    """A simple polygon, mostly concave."""
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners))
    angle = angle + np.linspace(0.0, 1e-3, corners)
    return (rng.uniform(0.3, 2.0, corners) * np.stack([np.cos(angle), np.sin(angle)])).T


@given(st.integers(3, 40), st.integers(0, 10_000))
def test_convex_pieces_are_convex_and_make_up_the_polygon(corners: int, seed: int) -> None:
    vertices = star(np.random.default_rng(seed), corners)
    whole = Polygon(vertices)
    if not whole.is_valid:
        return
    pieces = convex_pieces(tuple(map(tuple, vertices)))
    parts = [Polygon(piece.vertices) for piece in pieces]
    assert all(part.convex_hull.area == pytest.approx(part.area, rel=1e-9) for part in parts)
    assert sum(part.area for part in parts) == pytest.approx(whole.area, rel=1e-9)
    assert unary_union([part.buffer(1e-9) for part in parts]).symmetric_difference(whole).area < 1e-6
    before, after = vertices - np.roll(vertices, 1, axis=0), np.roll(vertices, -1, axis=0) - vertices
    reflex = int(np.sum(before[:, 0] * after[:, 1] < before[:, 1] * after[:, 0]))
    assert len(pieces) <= 2 * reflex + 1


def test_named_concave_polygons() -> None:
    ell = ((0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0))
    assert len(convex_pieces(ell)) == 2
    comb = [(0.0, 0.0)]
    for k in range(40):
        comb += [(k + 0.2, -2.0), (k + 1.0, 0.0)]
    comb += [(40.0, 1.0), (0.0, 1.0)]
    pieces = convex_pieces(tuple(comb))
    assert sum(Polygon(piece.vertices).area for piece in pieces) == pytest.approx(Polygon(comb).area)
    assert len(pieces) <= 80
    place = np.random.default_rng(0).uniform([-2, -4], [42, 3], (3000, 2))
    outlines = Outlines(pieces)
    each = outlines.contacts(
        np.tile(np.arange(len(pieces)), len(place)), np.repeat(place, len(pieces), axis=0)
    ).distance.reshape(len(place), -1)
    expected = np.array([Polygon(comb).distance(Point(p)) for p in place])
    np.testing.assert_allclose(np.maximum(each.min(axis=1), 0.0), expected, atol=1e-12)
