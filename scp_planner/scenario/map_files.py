"""Maps from files: grids as ROS writes them, with their PGM or PNG picture, and polygons in GeoJSON."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field

from scp_planner import files
from scp_planner.arrays import Mask
from scp_planner.errors import MISSING, Fault, ScenarioError, below
from scp_planner.mathematics.occupancy import OccupancyMap
from scp_planner.scenario.checks import polygon_faults
from scp_planner.scenario.validation import Part, part_of_file
from scp_planner.scenario.values import Number, Text
from scp_planner.units import Point

UNKNOWN = ("occupied", "free")
GEOJSON = (".geojson", ".json")
LARGEST_PICTURE = 2**26
"""Bytes of the values of a picture at most."""


Share = Annotated[float, Field(strict=True, ge=0, le=1)]


class MapKeys(Part):
    """Keys of a map's file that are looked at."""

    model_config = ConfigDict(extra="ignore")

    image: Text = Field(description="name of a PGM or PNG file")
    resolution: Annotated[Number, Field(gt=0)] = Field(description="edge of a cell")
    origin: tuple[Number, Number, Number] = Field(description="[x, y, yaw] of the corner")
    occupied_thresh: Share = 0.65
    free_thresh: Share = 0.25
    mode: Literal["trinary", "scale", "raw"] = "trinary"
    negate: Literal[0, 1] = 0


def load_map(path: str | PathLike[str], unknown: str = "occupied") -> OccupancyMap:
    """Read a map as ``map_server`` of ROS writes it.

    Parameters
    ----------
    path
        A YAML file with ``image`` (PGM or PNG), ``resolution``, m, ``origin``, [x, y, yaw], and optionally ``negate``,
        ``occupied_thresh``, ``free_thresh`` and ``mode``.
    unknown : {"occupied", "free"}
        What cells between the thresholds, and what lies beyond the picture, count as.

    Returns
    -------
    OccupancyMap

    Raises
    ------
    ValueError
        If ``unknown`` is another word.
    ScenarioError
        With every fault of the file, or what is wrong with its picture.
    OSError
        If a file cannot be read.
    """
    if unknown not in UNKNOWN:
        raise ValueError(f"unknown: {unknown!r} must be one of {', '.join(UNKNOWN)}")
    data, faults = files.read(path)
    keys = part_of_file(MapKeys, path, data, ScenarioError, faults=faults)
    try:
        values, largest = read_picture(files.read_bytes(Path(path).parent / keys.image))
    except ValueError as error:
        raise ScenarioError(str(path), [Fault("image", keys.image, str(error))]) from None
    x, y, yaw = keys.origin
    occupied = _occupied(np.flipud(values), largest, keys, unknown == "occupied")
    return OccupancyMap(occupied, keys.resolution, (x, y), yaw, unknown == "occupied", str(Path(path).absolute()))


def save_map(ground: OccupancyMap, path: str | PathLike[str]) -> None:
    """Write a map as a YAML file and a PGM picture beside it, as ``map_server`` of ROS reads them.

    Parameters
    ----------
    ground : OccupancyMap
    path
        A file whose name ends in .yaml or .yml; the picture's ends in .pgm.
    """
    picture = Path(path).with_suffix(".pgm")
    rows, columns = ground.occupied.shape
    cells = np.where(np.flipud(ground.occupied), 0, 254).astype(np.uint8)
    picture.write_bytes(f"P5\n{columns} {rows}\n255\n".encode() + cells.tobytes())
    origin = [*ground.origin, ground.yaw]
    thresholds = {"negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.25}
    files.write(path, {"image": picture.name, "resolution": ground.resolution, "origin": origin, **thresholds})


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= files.LARGEST_COORDINATE


def _occupied(values: np.ndarray, largest: int, keys: MapKeys, unknown: bool) -> Mask:
    """Cells that are occupied, by the grey values of a picture from 0 to the largest."""
    steps = np.arange(largest + 1)
    if keys.mode == "raw":  # percent; what is beyond 100 is unknown
        chance = np.where(steps <= 100, steps / 100.0, np.nan)
    else:
        chance = steps / largest if keys.negate else (largest - steps) / largest
    certain, free = chance > keys.occupied_thresh, chance < keys.free_thresh
    table = certain | (~free if unknown else np.zeros_like(free))
    found: Mask = table[values]
    return found


def read_picture(raw: bytes) -> tuple[np.ndarray, int]:
    """Return the grey values (rows, columns) of a PGM or PNG picture, the highest row first, and the largest one.

    Colours are averaged. ValueError says what a picture is that cannot be read.
    """
    if raw.startswith(b"\x89PNG\r\n\x1a\n"):
        return _png(raw)
    if raw[:2] in (b"P5", b"P2"):
        return _pgm(raw)
    raise ValueError("must be a PGM (P2 or P5) or PNG picture")


def _pgm(raw: bytes) -> tuple[np.ndarray, int]:
    (width, height, largest), place = _pgm_header(raw)
    if not (width > 0 and height > 0 and 0 < largest < 65536):
        text = f"must have a width, a height and a largest value below 65536, not {[width, height, largest]}"
        raise ValueError(text)
    kind, plain = np.dtype(np.uint8 if largest < 256 else ">u2"), raw[:2] == b"P2"
    _check_size(width, height, _PLAIN.itemsize if plain else kind.itemsize)
    values: np.ndarray
    if plain:
        values = _plain_values(raw[place:])
    else:
        count = min(width * height, max(len(raw) - place - 1, 0) // kind.itemsize)
        values = np.frombuffer(raw[place + 1 :], kind, count)
    if len(values) < width * height:
        raise ValueError(f"must have {width} x {height} values, not {len(values)}")
    values = values[: width * height].reshape(height, width)
    if values.max() > largest:
        raise ValueError(f"must have no value above {largest}, its largest one")
    return values, largest


_PGM_NUMBER = re.compile(rb"(?:\s+|#[^\n]*\n)*+(\d{1,9})(?!\d)")


def _pgm_header(raw: bytes) -> tuple[list[int], int]:
    """Return width, height and largest value of a PGM, and where they end."""
    numbers, place = [], 2
    for _ in range(3):
        found = _PGM_NUMBER.match(raw, place)
        if found is None:
            raise ValueError(f"must begin with its width, height and largest value, of at most {_DIGITS} digits")
        numbers.append(int(found[1]))
        place = found.end()
    return numbers, place


_DIGITS = 9
_PLAIN = np.dtype(np.int32)
"""Kind of the numbers of a P2 picture."""


def _plain_values(text: bytes) -> np.ndarray:
    """Return the values of a P2 picture."""
    wrong = re.search(rb"[^\d\s]|\d{%d}" % (_DIGITS + 1), text)
    if wrong:
        raise ValueError(f"must have whole numbers of at most {_DIGITS} digits, not {wrong[0].decode('latin-1')!r}")
    return np.fromstring(text.decode("ascii"), dtype=_PLAIN, sep=" ")


def _check_size(width: int, height: int, each: int) -> None:
    """Refuse a picture that is too large to hold, by its header and the bytes of a cell."""
    if width * height * each > LARGEST_PICTURE:
        text = f"must take at most {LARGEST_PICTURE:,} bytes"
        raise ValueError(f"{text}, not {width} x {height} cells of {each}")


def _png(raw: bytes) -> tuple[np.ndarray, int]:
    header, packed = _png_chunks(raw)
    width, height, depth, colour, _, _, interlaced = header
    channels = {0: 1, 2: 3, 4: 2, 6: 4}.get(colour)  # grey, red to blue, both with transparency
    if depth not in (8, 16) or channels is None or interlaced:
        raise ValueError("must be a PNG picture of 8 or 16 bits, grey or in colours without a palette, not interlaced")
    pixel = channels * depth // 8
    _check_size(width, height, pixel)
    lines = _inflated(packed, height * (1 + width * pixel)).reshape(height, -1)
    values = _unfiltered(lines[:, 0], lines[:, 1:].copy(), pixel)
    if depth == 16:
        values = values.view(">u2")
    values = values.reshape(height, width, channels)
    if channels > 2:
        values = values[:, :, :3].mean(axis=2).astype(np.int64)[:, :, None]  # without the transparency
    return values[:, :, 0], 2**depth - 1


def _png_chunks(raw: bytes) -> tuple[tuple[int, ...], bytes]:
    """Return the numbers of the header of a PNG, and its packed lines."""
    place, packed, header = 8, [], None
    while place + 8 <= len(raw):
        (length,) = struct.unpack(">I", raw[place : place + 4])
        kind, body = raw[place + 4 : place + 8], raw[place + 8 : place + 8 + length]
        if kind == b"IHDR" and len(body) == 13:
            header = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            packed.append(body)
        place += 12 + length
    if header is None or 0 in header[:2]:
        raise ValueError("must be a whole PNG picture")
    return header, b"".join(packed)


def _inflated(packed: bytes, size: int) -> np.ndarray:
    """Inflate bytes, of which there must be as many as the header says: no more are made than one too many."""
    try:
        found = zlib.decompressobj().decompress(packed, size + 1)
    except zlib.error:
        found = b""
    if len(found) != size:
        raise ValueError("must be a whole PNG picture")
    return np.frombuffer(found, np.uint8)


def _unfiltered(kinds: np.ndarray, lines: np.ndarray, pixel: int) -> np.ndarray:
    """Undo the filters of a PNG's lines, (rows, bytes), a byte from that a pixel before and those above."""
    rows, count = lines.shape
    if (kinds > 4).any():
        raise ValueError("must be a whole PNG picture")
    if (kinds <= 2).all():
        for k, way in enumerate(kinds.tolist()):
            if way == 1:
                lines[k] = np.cumsum(lines[k].reshape(-1, pixel), axis=0, dtype=np.uint8).ravel()
            elif way == 2 and k:
                lines[k] += lines[k - 1]
        return lines
    wide = np.zeros((rows + 1, count // pixel + 1, pixel), dtype=np.int16)  # nothing above, nothing to the left
    wide[1:, 1:] = lines.reshape(rows, -1, pixel)
    columns = count // pixel
    for diagonal in range(rows + columns - 1):  # each byte of one depends on those before alone
        row = np.arange(max(0, diagonal - columns + 1), min(diagonal, rows - 1) + 1)
        column, kind = diagonal - row, kinds[row][:, None]
        left, above = wide[row + 1, column], wide[row, column + 1]
        corner = wide[row, column]
        by = np.abs(above - corner), np.abs(left - corner), np.abs(left + above - 2 * corner)
        nearest = np.where((by[0] <= by[1]) & (by[0] <= by[2]), left, np.where(by[1] <= by[2], above, corner))
        more = np.select([kind == 1, kind == 2, kind == 3, kind == 4], [left, above, (left + above) // 2, nearest], 0)
        wide[row + 1, column + 1] = (wide[row + 1, column + 1] + more) % 256
    return wide[1:, 1:].astype(np.uint8).reshape(rows, count)


def read_polygons(path: Path) -> list[list[Point]]:
    """Return the outer rings of the polygons of a GeoJSON file in metres, without their repeated last point.

    A ScenarioError names the place in the file of whatever is no simple polygon.
    """
    rings, faults = [], []
    for place, found in _polygons(files.read_json(path, ScenarioError), ""):
        wrong = [found] if isinstance(found, Fault) else list(_ring_faults(place, found))
        faults += wrong
        if not wrong:
            rings.append(_corners(found[0]))
    if faults:
        raise ScenarioError(str(path), faults[:MOST_FAULTS])
    return rings


MOST_FAULTS = 20
"""Faults of a GeoJSON file that are listed."""


def _polygons(data: Any, place: str) -> Iterator[tuple[str, Any]]:
    """Yield the polygons of a GeoJSON object with their places, or a fault; a feature may have no geometry."""
    kind = data.get("type") if isinstance(data, dict) else None
    parts = {"FeatureCollection": "features", "GeometryCollection": "geometries", "MultiPolygon": "coordinates"}
    if kind == "Feature" and "geometry" in data:
        if data["geometry"] is not None:
            yield from _polygons(data["geometry"], below(place, "geometry"))
    elif kind == "Polygon":
        yield below(place, "coordinates"), data.get("coordinates", MISSING)
    elif isinstance(kind, str) and kind in parts:
        key = parts[kind]
        each = data.get(key, MISSING)
        if not isinstance(each, list):
            yield place, Fault(below(place, key), each, "must be a list")
            return
        for number, one in enumerate(each):
            within = below(place, f"{key}[{number}]")
            yield from [(within, one)] if kind == "MultiPolygon" else _polygons(one, within)
    else:
        yield place, Fault(place, data, "must be GeoJSON that holds polygons alone")


def _ring_faults(place: str, polygon: Any) -> Iterator[Fault]:
    """Yield what makes a polygon of GeoJSON none with one simple ring."""
    if not isinstance(polygon, list) or len(polygon) != 1:
        holes = isinstance(polygon, list) and len(polygon) > 1
        yield Fault(place, polygon, "must be without holes: split it in two" if holes else "must be a list of one ring")
        return
    ring, place = polygon[0], f"{place}[0]"
    if not isinstance(ring, list):
        yield Fault(place, ring, "must be a list of points [x, y], m")
        return
    for number, point in enumerate(ring):
        if not (isinstance(point, list) and len(point) > 1 and all(_is_number(value) for value in point[:2])):
            text = f"must be [x, y], m, numbers of at most {files.LARGEST_COORDINATE:g} in size"
            yield Fault(f"{place}[{number}]", point, text)
            return
    corners = _corners(ring)
    if len(corners) < 3:
        yield Fault(place, ring, "must have at least 3 points that differ")
        return
    for objection in polygon_faults(corners):
        yield Fault(place, objection.value, objection.message)


def _corners(ring: list[list[float]]) -> list[Point]:
    """Return the points of a ring, none twice in a row."""
    points = [(float(point[0]), float(point[1])) for point in ring]
    return [point for number, point in enumerate(points) if point != points[number - 1]]
