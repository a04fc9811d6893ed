"""The ground of a scenario as a map."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, PlainSerializer, PlainValidator, WithJsonSchema, model_validator

from scp_planner.errors import Fault, ScenarioError
from scp_planner.files import LARGEST_COORDINATE
from scp_planner.mathematics.convex_pieces import convex_pieces
from scp_planner.mathematics.occupancy import OccupancyMap
from scp_planner.scenario.map_files import GEOJSON, load_map, read_polygons
from scp_planner.scenario.validation import Part, TakenAs, by_default, faults_of_named, wrong


def _map(value: Any) -> OccupancyMap:
    if not isinstance(value, OccupancyMap):
        raise wrong("must be the name of a file, or an OccupancyMap")
    farthest = max(map(abs, value.origin)) + value.resolution * sum(value.occupied.shape)
    if not 1.0 / LARGEST_COORDINATE <= value.resolution <= farthest <= LARGEST_COORDINATE:
        raise wrong(f"must reach no farther than {LARGEST_COORDINATE:g} m, with cells of {1 / LARGEST_COORDINATE:g} m")
    return value


def _named(ground: OccupancyMap) -> str:
    return ground.source or repr(ground)


Map = Annotated[
    OccupancyMap,
    PlainValidator(_map),
    PlainSerializer(_named, return_type=str),
    WithJsonSchema({"type": "string"}),
]


class Ground(Part):
    """Occupied cells of the ground: no disc of the vehicle touches one."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    map: TakenAs[Map, OccupancyMap | str | PathLike[str]] = Field(
        description="name of a map's YAML file as map_server of ROS writes it; in a scenario file relative to that, and"
        " there also of a GeoJSON file of polygons in m, which become walls"
    )
    unknown: TakenAs[Literal["occupied", "free"], str] = by_default(
        "occupied", description="what unknown cells, and what lies beyond the map, count as: occupied or free"
    )
    sha256: str | None = Field(
        default=None,
        description="digest of the cells that the scenario was made for: others are refused; null: any will do",
    )

    def check_file(self) -> None:
        """Raise a ScenarioError if the map is in no file that a scenario's file could name."""
        if self.map.source is None:
            text = "is in no file: save_map(map, path) makes one, which load_map reads"
            raise ScenarioError("scenario", [Fault("ground.map", self.map, text)])

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: Any) -> Any:
        """Read the map of a name; what is faulty is left to the checks."""
        name = data.get("map") if isinstance(data, Mapping) else None
        if not isinstance(name, (str, PathLike)):
            return data
        unknown = data.get("unknown", "occupied")
        try:
            ground = load_map(name, unknown if unknown in ("occupied", "free") else "occupied")
        except OSError as error:
            raise wrong(
                f"map: {fspath(name)!r} must be the name of a file that can be read ({error.strerror})"
            ) from None
        wanted = data.get("sha256")
        if wanted is not None and wanted != ground.sha256:
            raise wrong(f"map: {fspath(name)!r} has changed: its cells are not those that the scenario was made for")
        return {**data, "map": ground, "sha256": ground.sha256}


def read_ground(data: Any, folder: Path) -> list[Fault]:
    """Name the map of a scenario file by its whole path; polygons of a GeoJSON file go to the walls."""
    ground = data.get("ground") if isinstance(data, dict) else None
    name = ground.get("map") if isinstance(ground, dict) else None
    if not isinstance(ground, dict) or not isinstance(name, str):
        return []
    path = folder / name
    if path.suffix.lower() not in GEOJSON:
        ground["map"] = str(path)
        return []
    del data["ground"]
    try:
        rings = read_polygons(path)
        pieces = [piece.vertices for ring in rings for piece in convex_pieces(tuple(ring))]
    except (OSError, ScenarioError) as error:
        return faults_of_named("ground.map", name, error)
    walls = data.get("walls") or []
    if not isinstance(walls, list):
        return []  # a fault of its own
    data["walls"] = [*walls, *(piece.tolist() for piece in pieces if piece is not None)]
    return []
