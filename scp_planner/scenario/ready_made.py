"""Motion models that come with the package: of people, cyclists, cars, ships and drones."""

from __future__ import annotations

from functools import lru_cache
from importlib.resources import as_file, files
from typing import Any

from pydantic_core import PydanticCustomError

from scp_planner.errors import nearest
from scp_planner.scenario.process_model import ProcessModel

NAMES = ("pedestrian", "cyclist", "car", "ship", "drone")

_FOLDER, _SUFFIX = "motion_models", ".yaml"


@lru_cache(maxsize=len(NAMES))
def ready_made(name: str) -> ProcessModel:
    """Give a motion model that comes with the package."""
    if name not in NAMES:
        raise ValueError(unknown(name))
    with as_file(files("scp_planner.scenario") / _FOLDER / f"{name}{_SUFFIX}") as path:
        return ProcessModel.load(path)


def unknown(name: str, besides: str = "") -> str:
    """Say that there is no such model, and which there are, besides something else that would do."""
    near = nearest(name, NAMES)
    hint = f"; did you mean {near!r}?" if near else ""
    return f"must be {besides}one of {', '.join(NAMES)}{hint}"


def process_by_name(data: Any) -> Any:
    """Give the process of a ready-made model by its name; others as they are."""
    if not isinstance(data, str):
        return data
    if data not in NAMES:
        raise PydanticCustomError("ready_made", "{message}", {"message": unknown(data, "a mapping or ")})
    return ready_made(data)


def model_by_name(data: Any) -> Any:
    """Give a ready-made model by its name; others as they are."""
    return {"process": process_by_name(data)} if isinstance(data, str) else data


def or_its_name(schema: dict[str, Any]) -> None:
    """Let a JSON schema allow the name of a ready-made model."""
    whole = schema.pop("$ref", None)
    schema["anyOf"] = [*([{"$ref": whole}] if whole else []), {"enum": list(NAMES)}]
