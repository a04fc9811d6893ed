"""Commands that list what there is: schema, settings."""

from __future__ import annotations

import json
import textwrap
from dataclasses import dataclass
from typing import Annotated, Any

import typer

from scp_planner.cli.options import Json, known_settings
from scp_planner.cli.output import print_json


def schema() -> None:
    """Print the JSON schema of the scenario file."""
    from scp_planner.scenario.models import Scenario

    typer.echo(json.dumps(Scenario.json_schema(), indent=2))


def settings(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="NAME", help="Only these.", autocompletion=known_settings)
    ] = None,
    as_json: Json = False,
) -> None:
    """List the settings that --set changes.

    Default, range, unit, and what each does.
    """
    listed = setting_entries()
    if names:
        listed = [_found(name, listed) for name in names]
    if as_json:
        print_json([entry.as_dict() for entry in listed])
        return
    for heading in dict.fromkeys(entry.heading for entry in listed):
        typer.echo(f"{heading}\n")
        for entry in (each for each in listed if each.heading == heading):
            typer.echo(f"  {entry.name} = {entry.default}  ({entry.allowed})")
            typer.echo(textwrap.indent(textwrap.fill(entry.effect, 92), "      ") + "\n")


@dataclass(frozen=True)
class SettingEntry:
    """One setting as it is shown."""

    heading: str
    name: str
    default: str
    allowed: str
    effect: str

    def as_dict(self) -> dict[str, Any]:
        """Give what is printed as JSON."""
        return {"name": self.name, "default": self.default, "allowed": self.allowed, "effect": self.effect}


def setting_entries() -> list[SettingEntry]:
    """Give all settings that can be set by text, in order."""
    from scp_planner.settings.knobs import knobs
    from scp_planner.settings.online import OnlineSettings
    from scp_planner.settings.planning import Settings

    headings = {"Settings of plans": Settings, "Settings of the closed loop": OnlineSettings}
    return [
        SettingEntry(heading, knob.name, knob.default_text, knob.allowed_text, knob.effect.replace("``", ""))
        for heading, each in headings.items()
        for knob in knobs(each).values()
        if knob.allowed is not None
    ]


def _found(name: str, listed: list[SettingEntry]) -> SettingEntry:
    from scp_planner.errors import MISSING, SettingsError
    from scp_planner.settings.knobs import unknown_name

    for entry in listed:
        if entry.name == name:
            return entry
    raise SettingsError("settings", [unknown_name(name, MISSING, [entry.name for entry in listed])])
