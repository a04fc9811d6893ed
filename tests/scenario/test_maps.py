"""Maps of the ground: files of ROS and GeoJSON, scenarios over them, and trips that never touch a cell."""

from __future__ import annotations

import json
import os
import struct
import tracemalloc
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import scene
from scipy.spatial import cKDTree
from shapely import MultiPolygon, Point, Polygon, box, union_all
from shapely.affinity import affine_transform

import scp_planner as sp
from scp_planner.plotting.recording import record_plan
from scp_planner.scenario.map_files import read_picture

VEHICLE = {"radius": 0.3, "max_speed": 2.0, "max_acceleration": 1.5, "max_deceleration": 2.0, "max_curvature": 2.0}


def room() -> np.ndarray[Any, Any]:
    """Eight by six metres with two walls, each with a door, at 0.1 m."""
    cells = np.zeros((60, 80), dtype=bool)
    cells[:, 25:28] = cells[:, 52:55] = True
    cells[8:20, 25:28] = cells[40:52, 52:55] = False
    return cells


def over(ground: Any, ends: tuple[Any, Any], **more: Any) -> sp.Scenario:
    start = {"time": 0.0, "position": ends[0], "speed": 0.0, **more.pop("start", {})}
    vehicle = {**VEHICLE, **more.pop("vehicle", {})}
    return sp.Scenario(
        **{"vehicle": vehicle, "start": start, "goal": {"position": ends[1]}, "obstacles": [], "ground": ground, **more}
    )


def ends_in(ground: sp.OccupancyMap) -> tuple[Any, Any]:
    return ground.world(np.array([10.0, 40.0])).tolist(), ground.world(np.array([70.0, 15.0])).tolist()


def png(values: np.ndarray[Any, Any], kinds: list[int]) -> bytes:
    """A PNG of (rows, columns, channels), whose lines have filters."""
    rows, columns, channels = values.shape
    pixel = channels * values.dtype.itemsize
    raw = values.astype(values.dtype.newbyteorder(">")).view(np.uint8).reshape(rows, -1).astype(int)
    above = np.vstack([np.zeros_like(raw[:1]), raw[:-1]])
    left = np.hstack([np.zeros((rows, pixel), dtype=int), raw[:, :-pixel]])
    corner = np.hstack([np.zeros((rows, pixel), dtype=int), above[:, :-pixel]])
    packed = b""
    for k in range(rows):
        kind = kinds[k % len(kinds)]
        guess = left[k] + above[k] - corner[k]
        away = np.abs([guess - left[k], guess - above[k], guess - corner[k]])
        paeth = np.choose(np.argmin(away, axis=0), [left[k], above[k], corner[k]])
        less = [0, left[k], above[k], (left[k] + above[k]) // 2, paeth][kind]
        packed += bytes([kind]) + ((raw[k] - less) % 256).astype(np.uint8).tobytes()
    colour = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    header = struct.pack(">IIBBBBB", columns, rows, 8 * values.dtype.itemsize, colour, 0, 0, 0)
    found = b"\x89PNG\r\n\x1a\n"
    for name, body in ((b"IHDR", header), (b"IDAT", zlib.compress(packed)), (b"IEND", b"")):
        found += struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
    return found


@pytest.mark.parametrize("kinds", [[0], [1, 2], [4, 3, 1, 2, 0]])
@pytest.mark.parametrize(("kind", "channels"), [(np.uint8, 1), (np.uint16, 1), (np.uint8, 2), (np.uint8, 3)])
def test_pictures_are_read(kind: type, channels: int, kinds: list[int]) -> None:
    rng = np.random.default_rng(3)
    values = np.repeat(rng.integers(0, np.iinfo(kind).max + 1, (9, 7, 1), dtype=kind), channels, axis=2)
    read, largest = read_picture(png(values, kinds))
    assert largest == np.iinfo(kind).max
    assert np.array_equal(read, values[:, :, 0])
    if channels == 1:
        body = values.astype(values.dtype.newbyteorder(">")).tobytes()
        assert np.array_equal(read_picture(b"P5 # a\n7 9\n%d\n" % largest + body)[0], read)
        text = " ".join(map(str, values.ravel().tolist()))
        assert np.array_equal(read_picture(f"P2\n7 9 {largest}\n{text}".encode())[0], read)


@pytest.mark.parametrize(
    ("raw", "told"),
    [
        (b"GIF89a", "must be a PGM"),
        (b"P5\n2 2\n255\nab", "2 x 2 values"),
        (b"P5\n2 x", "must begin with"),
        (b"\x89PNG\r\n\x1a\nxx", "whole PNG"),
    ],
)
def test_a_picture_that_cannot_be_read_is_told(raw: bytes, told: str, tmp_path: Path) -> None:
    (tmp_path / "a.pgm").write_bytes(raw)
    (tmp_path / "a.yaml").write_text("{image: a.pgm, resolution: 0.1, origin: [0, 0, 0]}")
    with pytest.raises(sp.ScenarioError, match=told):
        sp.load_map(tmp_path / "a.yaml")


def test_thresholds_and_modes(tmp_path: Path) -> None:
    (tmp_path / "a.pgm").write_bytes(b"P5\n4 1\n255\n" + bytes([0, 100, 205, 254]))

    def read(unknown: str = "occupied", **keys: Any) -> list[bool]:
        keys = {"image": "a.pgm", "resolution": 0.1, "origin": [0, 0, 0], **keys}
        (tmp_path / "a.yaml").write_text(json.dumps(keys))
        cells: list[bool] = sp.load_map(tmp_path / "a.yaml", unknown).occupied[0].tolist()
        return cells

    limits: dict[str, Any] = {"occupied_thresh": 0.65, "free_thresh": 0.196}
    assert read(**limits) == [True, True, True, False]
    assert read("free", **limits) == [True, False, False, False]
    assert read("free", **limits, negate=1) == [False, False, True, True]
    assert read(**limits, mode="raw") == [False, True, True, True]
    assert read("free", **limits, mode="raw") == [False, True, False, False]
    with pytest.raises(sp.ScenarioError, match=r"(?s)resolution.*origin.*mode"):
        read(resolution=0, origin=[1], mode="x")


def test_a_scenario_names_its_map_and_notices_another(tmp_path: Path) -> None:
    ground = sp.OccupancyMap(room(), 0.1, (1.0, -2.0), 0.3)
    start, goal = ends_in(ground)
    sp.save_map(ground, tmp_path / "map.yaml")
    (tmp_path / "deep").mkdir()
    given = over({"map": tmp_path / "map.yaml"}, (start, goal))
    assert given.ground is not None
    assert given.ground.map == ground
    given.save(tmp_path / "deep" / "scene.yaml")
    assert "map: ../map.yaml" in (tmp_path / "deep" / "scene.yaml").read_text()
    assert sp.Scenario.load(tmp_path / "deep" / "scene.yaml") == given
    cells = room()
    cells[0, 0] = True
    sp.save_map(sp.OccupancyMap(cells, 0.1, (1.0, -2.0), 0.3), tmp_path / "map.yaml")
    with pytest.raises(sp.ScenarioError, match="has changed"):
        sp.Scenario.load(tmp_path / "deep" / "scene.yaml")
    with pytest.raises(sp.ScenarioError, match="in no file"):
        over({"map": ground}, (start, goal)).to_dict()
    with pytest.raises(sp.ScenarioError, match="can be read"):
        over({"map": "missing.yaml"}, (start, goal))
    with pytest.raises(sp.ScenarioError, match=r"goal.position.*from occupied cells"):
        over({"map": ground}, (start, ground.world(np.array([26.0, 40.0])).tolist()))


def test_polygons_become_walls(tmp_path: Path) -> None:
    ring = [[4.0, -9.0], [5.0, -9.0], [5.0, 3.0], [8.0, 3.0], [8.0, 4.0], [4.0, 4.0], [4.0, -9.0]]
    site = {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [ring]}}
    (tmp_path / "site.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [site]}))
    data = over(None, ([0.0, 0.0], [9.0, 0.0])).to_dict()
    (tmp_path / "scene.json").write_text(json.dumps({**data, "ground": {"map": "site.geojson"}}))
    read = sp.Scenario.load(tmp_path / "scene.json")
    assert MultiPolygon([(wall, []) for wall in read.walls]).area == pytest.approx(13.0 + 3.0)
    site["geometry"] = {"type": "Point", "coordinates": [0, 0]}
    (tmp_path / "site.geojson").write_text(json.dumps(site))
    with pytest.raises(sp.ScenarioError, match="polygons alone"):
        sp.Scenario.load(tmp_path / "scene.json")


@pytest.mark.parametrize("discs", [[0.0], [0.0, 0.5]])
def test_a_trip_over_a_map_touches_no_cell(discs: list[float]) -> None:
    ground = sp.OccupancyMap(room(), 0.1, (1.0, -2.0), 0.3)
    start = {"heading": 0.3} if len(discs) > 1 else {}
    walker = {"id": "walker", "shape": {"disc": 0.3}, "motion": {"position": [5.0, 3.0], "velocity": [0.2, -0.6]}}
    scenario = over(
        {"map": ground},
        ends_in(ground),
        vehicle={"discs": discs},
        start=start,
        obstacles=[walker],
        goal={"position": ends_in(ground)[1], "radius": 0.1},
    )
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    assert sp.certify(scenario, plan).holds
    rows, columns = np.nonzero(room())
    squares = MultiPolygon([box(x, y, x + 1, y + 1) for x, y in zip(columns, rows, strict=True)]).buffer(0)
    c, s = 0.1 * np.cos(0.3), 0.1 * np.sin(0.3)
    cells = affine_transform(squares, [c, -s, s, c, 1.0, -2.0])
    time = np.linspace(0.0, plan.travel_time, 150)
    heading = plan.heading(time)
    apart = min(
        cells.distance(Point(place)) - 0.3
        for disc in discs
        for place in plan.position(time) + disc * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    )
    assert plan.clearance.minimum <= apart + 1e-9
    assert apart >= 0.0
    assert [one.id for one in record_plan(plan, scenario, 3).obstacles] == ["walker"]  # a picture has the cells besides
    # The same trip where a cell is on its way
    x, y = np.floor(ground.local(plan.position(0.5 * plan.travel_time))).astype(int)
    blocked = room()
    blocked[y, x] = True
    other = scenario.model_copy(update={"ground": sp.Ground(map=sp.OccupancyMap(blocked, 0.1, (1.0, -2.0), 0.3))})
    found = sp.certify(other, plan)
    assert not found.holds
    assert found.violations[0].obstacle == "map"


def test_a_door_that_is_too_narrow_is_told() -> None:
    cells = room()
    cells[8:20, 25:28] = True
    cells[10:15, 25:28] = False
    ground = sp.OccupancyMap(cells, 0.1)
    plan = sp.plan(over({"map": ground}, ends_in(ground)))
    assert not plan.certified
    assert plan.reason is not None
    assert "the widest passage is about 0.5 m wide, 0.1 m less than it takes" in plan.reason


def test_a_vehicle_that_begins_with_its_back_to_the_goal_turns_where_there_is_room() -> None:
    """The shortest way leads through a lane behind it, in which it cannot turn."""
    cells = np.ones((120, 240), dtype=bool)
    cells[50:70, 5:235] = False  # a lane, 1 m wide
    cells[5:115, 140:235] = False  # and a hall ahead
    ground = sp.OccupancyMap(cells, 0.05)
    scenario = scene(
        vehicle={"max_speed": 2.0, "max_curvature": 1.5},
        start={"position": [6.0, 3.0], "speed": 0.0},
        goal={"position": [1.0, 3.0]},
        ground={"map": ground},
    )
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    places = plan.position(np.linspace(0.0, plan.travel_time, 2000))
    assert places[:, 0].max() > 7.3  # in the hall
    rows, columns = np.nonzero(cells)
    tree = cKDTree(0.05 * (np.stack([columns, rows], axis=1) + 0.5))
    assert tree.query(places)[0].min() > 0.3  # from the middle of any cell


def ring_of(rng: np.random.Generator) -> list[list[float]]:
    """A ring of random corners about a point; some crossing, slit, doubled or in line."""
    count = int(rng.integers(3, 9))
    angles = rng.uniform(0.0, 2.0 * np.pi, count)
    if rng.random() < 0.7:
        angles = np.sort(angles)
    ring = (rng.uniform(1.0, 5.0, (count, 1)) * np.stack([np.cos(angles), np.sin(angles)], axis=1)).tolist()
    place = int(rng.integers(count))
    match int(rng.integers(5)):
        case 0:
            ring.insert(place, ring[place])
        case 1:
            ring.insert(place, [0.5 * (a + b) for a, b in zip(ring[place - 1], ring[place], strict=True)])
        case 2:
            ring[place:place] = [ring[place], [0.1, 0.2]]  # out and back
        case 3:  # a hole, cut open along a line
            hole = [[0.2, 0.1], [0.1, 0.3], [-0.1, 0.2]]
            ring[place:place] = [ring[place], *hole, hole[0]]
    return [*ring, ring[0]]


def test_polygons_of_geojson_are_those_of_shapely_or_refused_by_their_index(tmp_path: Path) -> None:
    rng, taken, refused = np.random.default_rng(8), 0, 0
    ends = ([-30.0, -30.0], [30.0, -30.0])
    file = tmp_path / "scene.json"
    for _ in range(120):
        ring = ring_of(rng)
        shape = Polygon(ring)
        square = [[[20.0, 20.0], [21.0, 20.0], [21.0, 21.0], [20.0, 20.0]]]
        polygons = {"type": "MultiPolygon", "coordinates": [square, [ring]]}
        (tmp_path / "site.geojson").write_text(json.dumps(polygons))
        data = over(None, ends).to_dict() | {"ground": {"map": "site.geojson"}}
        file.write_text(json.dumps(data))
        if not shape.is_valid or shape.area < 1e-6:
            refused += 1
            with pytest.raises(sp.ScenarioError) as caught:
                sp.Scenario.load(file)
            assert all("coordinates[1]" in fault.path for fault in caught.value.faults)
            continue
        taken += 1
        walls = [Polygon(wall) for wall in sp.Scenario.load(file).walls]
        assert sum(wall.area for wall in walls) == pytest.approx(shape.area + 0.5, rel=1e-9)
        assert union_all(walls[1:]).symmetric_difference(shape).area <= 1e-9 * shape.area
    assert taken > 30 and refused > 30


@pytest.mark.parametrize(
    ("geojson", "place"),
    [
        ({"type": "GeometryCollection", "geometries": [5]}, "geometries[0] = 5"),
        ({"type": "Feature"}, "= {'type': 'Feature'}"),
        ({"type": "Polygon", "coordinates": [[[10**400, 0], [1, 0], [1, 1]]]}, "coordinates[0][0] = "),
        ({"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1]], [[0, 0]]]}, "without holes"),
        ({"type": "FeatureCollection", "features": {}}, "features = {}"),
        ({"type": "Point", "coordinates": [0, 0]}, "polygons alone"),
    ],
)
def test_faults_of_geojson_are_named_by_their_place(geojson: Any, place: str, tmp_path: Path) -> None:
    (tmp_path / "site.geojson").write_text(json.dumps(geojson))
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(over(None, ([0, 0], [9, 0])).to_dict() | {"ground": {"map": "site.geojson"}}))
    with pytest.raises(sp.ScenarioError) as caught:
        sp.Scenario.load(file)
    assert "ground.map (site.geojson)" in str(caught.value) and place in str(caught.value)


def test_a_feature_without_geometry_is_no_fault(tmp_path: Path) -> None:
    empty: dict[str, Any] = {"type": "Feature", "geometry": None, "properties": {}}
    (tmp_path / "site.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [empty]}))
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(over(None, ([0, 0], [9, 0])).to_dict() | {"ground": {"map": "site.geojson"}}))
    assert sp.Scenario.load(file).walls == ()


def bomb() -> bytes:
    """A PNG of 70 MB that says it has four cells, of one byte each."""
    found = b"\x89PNG\r\n\x1a\n"
    header = struct.pack(">IIBBBBB", 2, 2, 8, 0, 0, 0, 0)
    for name, body in ((b"IHDR", header), (b"IDAT", zlib.compress(bytes(70 * 10**6)))):
        found += struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
    return found


@pytest.mark.parametrize(
    "raw",
    [
        b"\x89PNG\r\n\x1a\n\0\0\0\x04IHDR\0\0\0\0\0\0\0\0",
        b"P2\n2 2\n255\n99999999999999999999999 0 0 0",
        b"P2 2 2 255 0 -1 0 0",
        b"P5 99999999999 2 255\n",
        b"P5 999999999 999999999 255\n\0\0",
        b"P5 2 2 255",
        bomb(),
    ],
    ids=["short header", "long number", "sign", "long width", "too large", "no values", "bomb"],
)
def test_pictures_are_refused_by_their_header(raw: bytes, tmp_path: Path) -> None:
    (tmp_path / "i.png").write_bytes(raw)
    file = tmp_path / "m.yaml"
    file.write_text("image: i.png\nresolution: 0.1\norigin: [0, 0, 0]\n")
    tracemalloc.start()
    with pytest.raises(sp.ScenarioError, match=r"image = 'i\.png': must"):
        sp.load_map(file)
    assert tracemalloc.get_traced_memory()[1] < 10**7
    tracemalloc.stop()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_what_is_no_regular_file_is_not_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "i.pgm")
    file = tmp_path / "m.yaml"
    for picture in ("i.pgm", "/dev/zero", "."):
        file.write_text(f"image: {picture}\nresolution: 0.1\norigin: [0, 0, 0]\n")
        with pytest.raises(OSError, match="only regular files are read"):
            sp.load_map(file)
