"""Ground of any shape and size, against shapely: polygons and maps are taken as they are, or refused by name."""

from __future__ import annotations

import re
import tracemalloc
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scenes import scene
from shapely import Polygon, minimum_clearance, union_all

import scp_planner as sp
from scp_planner.arrays import Array
from scp_planner.mathematics.convex_pieces import convex_pieces
from scp_planner.scenario.shapes import PolygonShape

pytestmark = pytest.mark.numerics

Rng = np.random.Generator


def star(rng: Rng) -> Array:
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, rng.integers(3, 12)))
    return rng.uniform(0.2, 1.0, (len(angles), 1)) * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def scribble(rng: Rng) -> Array:
    return rng.uniform(-1.0, 1.0, (rng.integers(3, 7), 2))


def on_a_grid(rng: Rng) -> Array:
    return rng.integers(0, 4, (rng.integers(3, 8), 2)) / 2.0 - 0.7


def comb(rng: Rng) -> Array:
    """A square with slits from above, some as thin as rounding."""
    ring, teeth = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], int(rng.integers(1, 5))
    for x in np.arange(teeth, 0, -1) / (teeth + 1.0):
        wide, low = 10.0 ** rng.uniform(-15.0, -1.0), rng.uniform(0.1, 0.9)
        ring += [(x + wide, 1.0), (x + wide, low), (x - wide, low), (x - wide, 1.0)]
    return np.array([*ring, (0.0, 1.0)]) - 0.4


def spiral(rng: Rng) -> Array:
    angles = np.linspace(0.0, rng.uniform(3.0, 12.0), rng.integers(5, 14))[:, None]
    out = np.concatenate([np.cos(angles), np.sin(angles)], axis=1)
    size = 0.2 + 0.8 * angles / angles[-1]
    return np.concatenate([size * out, ((size - rng.uniform(0.01, 0.15)) * out)[::-1]])


def sliver(rng: Rng) -> Array:
    return star(rng) * [1.0, 10.0 ** rng.uniform(-10.0, 0.0)]


def edited(rng: Rng, ring: Array) -> Array:
    """Insert doubled and nearly doubled corners, some in line, out and back, or on another corner."""
    for _ in range(int(rng.integers(0, 3))):
        place, there = int(rng.integers(len(ring))), ring[int(rng.integers(len(ring)))]
        here, after = ring[place], ring[(place + 1) % len(ring)]
        share = [0.0, 0.5, rng.uniform(), rng.uniform(1.0, 1.3)][int(rng.integers(4))]
        near = here + rng.normal(0.0, 10.0 ** rng.uniform(-14.0, -2.0), 2)
        added = [here + share * (after - here), here + share * (after - here), near, there][int(rng.integers(4))]
        ring = np.insert(ring, place + 1, added, axis=0)
    return ring


def ring_of(rng: Rng) -> Array:
    """A ring, 1e-6 to 1e6 m large and as far as 1e6 m off."""
    kinds: list[Callable[[Rng], Array]] = [star, scribble, on_a_grid, comb, spiral, sliver]
    ring = edited(rng, kinds[int(rng.integers(len(kinds)))](rng))[:: int(rng.choice([1, -1]))]
    if rng.random() < 0.5:
        turn = rng.uniform(0.0, 6.0)
        ring = ring @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return 10.0 ** rng.uniform(-6.0, 6.0) * ring + rng.choice([0.0, 1.0]) * rng.uniform(-1e6, 1e6, 2)


@pytest.mark.parametrize("seed", range(4))
def test_polygons_of_obstacles_are_those_of_shapely_or_refused(seed: int) -> None:
    rng, taken, refused = np.random.default_rng([seed, 65]), 0, 0
    for _ in range(100):
        ring = ring_of(rng)
        shape, large, size = Polygon(ring), float(np.abs(ring).max()), float(np.hypot(*np.ptp(ring, axis=0)))
        doubled = np.flatnonzero((ring == np.roll(ring, 1, axis=0)).all(axis=1)).tolist()
        try:
            known = PolygonShape(polygon=ring.tolist())
        except sp.ScenarioError as error:
            refused += 1
            assert [fault.path for fault in error.faults] == [f"polygon[{place}]" for place in doubled] or ["polygon"]
            # Valid ones are refused if they are thin, or do not touch themselves by the last digits alone.
            is_thin = shape.area <= 1e-9 * size**2
            assert doubled or is_thin or not shape.is_valid or minimum_clearance(shape) <= 1e-14 * large
            continue
        taken += 1
        assert not doubled
        pieces = [Polygon(piece.vertices) for piece in convex_pieces(known.polygon)]
        rounding = 1e-15 * large * shape.length
        assert all(piece.convex_hull.area - piece.area <= rounding for piece in pieces)
        assert sum(piece.area for piece in pieces) == pytest.approx(shape.area, rel=0.0, abs=rounding)
        if shape.is_valid:  # else it touches itself, by the last digits
            assert union_all(pieces).symmetric_difference(shape).area <= rounding
    assert taken > 20 and refused > 20


@pytest.mark.parametrize("seed", range(2))
def test_walls_are_convex_or_refused_by_their_index(seed: int) -> None:
    rng, taken, refused = np.random.default_rng([seed, 66]), 0, 0
    start, far = [3e9, 0.0], [4e9, 0.0]
    for _ in range(60):
        ring = ring_of(rng)
        ring = ring if rng.random() < 0.5 else np.array(Polygon(ring).convex_hull.exterior.coords)[:-1]
        shape, size = Polygon(ring), float(np.hypot(*np.ptp(ring, axis=0)))
        doubled = (ring == np.roll(ring, 1, axis=0)).all(axis=1).any()
        square = [[-5e7, -5e7], [-4e7, -5e7], [-4e7, -4e7]]
        try:
            found = scene(start={"position": start}, goal={"position": far}, walls=[square, ring.tolist()])
        except sp.ScenarioError as error:
            refused += 1
            assert all(fault.path.startswith("walls[1]") for fault in error.faults)
            is_thin = shape.area <= 1e-9 * size**2
            assert doubled or not shape.is_valid or is_thin or inward_turns(ring).max() > 1e-10
            continue
        taken += 1
        assert not doubled and inward_turns(ring).max() < 4e-9
        np.testing.assert_array_equal(found.walls[1], ring)
    assert taken > 10 and refused > 10


def inward_turns(ring: Array) -> Array:
    """Turns of the corners that point inwards, by exact arithmetic, relative to the lengths of their edges."""
    exact = [(Fraction(x), Fraction(y)) for x, y in ring.tolist()]
    corners = list(zip(exact[-1:] + exact[:-1], exact, exact[1:] + exact[:1], strict=True))
    turns = [(q[0] - p[0]) * (r[1] - q[1]) - (q[1] - p[1]) * (r[0] - q[0]) for p, q, r in corners]
    sign = 1 if Polygon(ring).exterior.is_ccw else -1
    sizes = [float(max(map(abs, (q[0] - p[0], q[1] - p[1])))) for p, q, _ in corners]
    sides = np.array(sizes) * np.roll(sizes, -1)
    return np.maximum(-sign * np.array([float(turn) for turn in turns]) / sides, 0.0)


FREE = np.zeros((4, 5), dtype=bool)
ODD: dict[str, tuple[dict[str, Any], str]] = {
    "no number": ({"occupied": np.where(FREE, 0.0, np.nan)}, "occupied[0][0]: nan"),
    "probabilities": ({"occupied": FREE + 0.3}, "occupied[0][0]: 0.3"),
    "unknown": ({"occupied": np.diag([0, -1, 100])}, "occupied[1][1]: -1"),
    "texts": ({"occupied": [["0", "1"]]}, "occupied[0][0]"),
    "things": ({"occupied": [[None, True]]}, "occupied[0][0]"),
    "complex": ({"occupied": FREE + 1j}, "occupied[0][0]"),
    "masked": ({"occupied": np.ma.array(FREE, mask=~FREE)}, "occupied: must have no masked cells"),
    "ragged": ({"occupied": [[0, 1], [0]]}, "occupied: must be a grid"),
    "layers": ({"occupied": FREE[None]}, "occupied: must be a grid"),
    "empty": ({"occupied": FREE[:0]}, "occupied: must be a grid"),
    "text resolution": ({"resolution": "0.1"}, "resolution: '0.1'"),
    "no resolution": ({"resolution": None}, "resolution: None"),
    "true resolution": ({"resolution": True}, "resolution: True"),
    "resolutions": ({"resolution": np.array([0.1, 0.1])}, "resolution: "),
    "endless resolution": ({"resolution": np.inf}, "resolution: inf"),
    "text origin": ({"origin": "ab"}, "origin: 'ab'"),
    "one coordinate": ({"origin": 1.0}, "origin: 1.0"),
    "nested origin": ({"origin": ((0, 0), (1, 1))}, "origin: "),
    "origin without number": ({"origin": (0.0, np.nan)}, "origin: "),
    "text yaw": ({"yaw": "0"}, "yaw: '0'"),
    "endless yaw": ({"yaw": np.inf}, "yaw: inf"),
    "text beyond": ({"beyond": "free"}, "beyond: 'free'"),
}


@pytest.mark.parametrize("name", ODD)
def test_maps_are_refused_by_name_and_index(name: str) -> None:
    changes, told = ODD[name]
    with pytest.raises(ValueError, match="^" + re.escape(told)):
        sp.OccupancyMap(**{"occupied": FREE, "resolution": 0.1, **changes})


@pytest.mark.parametrize("occupied", [FREE.astype(np.uint8), FREE.astype(float), FREE.tolist(), FREE.astype(int)])
def test_zeros_and_ones_are_cells(occupied: Any) -> None:
    assert sp.OccupancyMap(occupied, 0.1) == sp.OccupancyMap(FREE, 0.1)


@pytest.mark.parametrize("numbers", [(0.1, 1e13), (1e300, 0.0), (1e-300, 0.0)])
def test_maps_out_of_all_proportion_are_refused(numbers: tuple[float, float]) -> None:
    resolution, far = numbers
    with pytest.raises(sp.ScenarioError, match="must reach no farther"):
        sp.Ground(map=sp.OccupancyMap(FREE, resolution, (far, 0.0)))


@pytest.mark.parametrize(("resolution", "corner"), [(1e-9, 0.0), (1e-3, -1.9), (1e-6, 1e6), (0.1, 1e11), (1e5, -2e5)])
def test_no_map_takes_more_memory_than_its_cells(resolution: float, corner: float) -> None:
    """Cells as small, or as far off, as may be: the vehicle stands where nothing is occupied, or outside."""
    vehicle = {"max_curvature": None}
    for beyond in (False, True):
        planner = sp.Planner(scene(vehicle=vehicle, start={"speed": 0.0}))
        tracemalloc.start()
        planner.update_map(sp.OccupancyMap(FREE, resolution, (corner, corner), beyond=beyond))
        plan = planner.replan(0.0, [0.0, 0.0], 0.0, 0.0)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert most < 2e8
        inside = corner <= -0.3 and corner + 4.0 * resolution >= 0.3
        if beyond and not inside:
            assert not plan.safe and plan.clearance.minimum <= 0.0
