"""Scenarios that come with the package, for the demo, the examples and a first try.

May import scenarios and all below.
"""

from __future__ import annotations

from importlib.resources import as_file, files
from typing import TYPE_CHECKING

from scp_planner.errors import Fault, ScenarioError

if TYPE_CHECKING:
    from scp_planner.scenario.models import Scenario

_SUFFIX = ".yaml"


def names() -> tuple[str, ...]:
    """Give the names of the built-in scenarios in alphabetical order."""
    entries = (entry.name for entry in files(__name__).iterdir())
    return tuple(sorted(name.removesuffix(_SUFFIX) for name in entries if name.endswith(_SUFFIX)))


def load(name: str) -> Scenario:
    """Load a built-in scenario."""
    from scp_planner.errors import nearest
    from scp_planner.scenario.models import Scenario

    if name not in names():
        near = nearest(name, names())
        hint = f"; did you mean {near!r}?" if near else ""
        fault = Fault("name", name, f"must be one of {', '.join(names())}{hint}")
        raise ScenarioError("built-in scenarios", [fault])
    with as_file(files(__name__) / f"{name}{_SUFFIX}") as path:
        return Scenario.load(path)
