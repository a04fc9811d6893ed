"""Write the reference pages of the command line and of the settings from the code.

Run it by ``python docs/make_reference.py`` after a change of a command, an option, a setting or its docstring.
"""

from __future__ import annotations

import inspect
import typing
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Any

from typer.models import ArgumentInfo

from scp_planner.cli.application import COMMANDS, Command, ExitCode
from scp_planner.settings.knobs import Knob, Knobs, Range, knobs
from scp_planner.settings.online import Newcomers, OnlineSettings
from scp_planner.settings.planning import Settings

FOLDER = Path(__file__).resolve().parent / "reference"
REMADE = "<!-- Written by docs/make_reference.py; a change here is lost. -->"
EXIT_CODES = {
    ExitCode.CERTIFIED: "done, and certified",
    ExitCode.BAD_INPUT: "bad input; nothing has been written",
    ExitCode.NOT_CERTIFIED: "no certified plan exists or was found; the best attempt has been written, with its status "
    "and the reason",
    ExitCode.CUT_SHORT: "the workers of a batch, or the scheduler of its cluster, are gone; finished rows are "
    "kept, and the same command resumes",
    ExitCode.INTERRUPTED: "interrupted; no file is incomplete",
}


def pages() -> dict[Path, str]:
    """Give the text of each page."""
    return {
        FOLDER / "cli.md": "\n".join(_cli_page()),
        FOLDER / "settings.md": "\n".join(_settings_page()),
    }


def _cli_page() -> Iterator[str]:
    yield from ("# Command line", "", REMADE, "")
    yield "Results go to files and stdout, messages and progress bars to stderr; bars are shown on a terminal only."
    yield "A file is written under a temporary name and renamed when it is complete."
    yield "Existing files are replaced; symbolic links are followed; devices, pipes and folders are refused."
    yield "`scp-planner --install-completion` makes the shell complete commands, options, built-in scenarios and names"
    yield "of settings. `SCENARIO` is a file, YAML or JSON, or a built-in scenario such as `builtin:crossing`."
    yield from ("", "| exit code | means |", "| --- | --- |")
    yield from (f"| {code.value} | {EXIT_CODES[code]} |" for code in ExitCode)
    for name, command in COMMANDS.items():
        yield from ("", f"## {name}", "", inspect.cleandoc(command.function.__doc__ or ""), "")
        yield from ("```text", *command.examples, "```")
        rows = list(_parameters(command))
        if rows:
            yield from ("", "| argument or option | default | |", "| --- | --- | --- |", *rows)
    yield ""


def _parameters(command: Command) -> Iterator[str]:
    hints = typing.get_type_hints(command.function, include_extras=True)
    for name, parameter in inspect.signature(command.function).parameters.items():
        hint = hints[name]
        info = hint.__metadata__[0]
        kind = hint.__origin__
        words = ", ".join(f"`{word}`" for word in _words(info, kind))
        if parameter.default is inspect.Parameter.empty:
            default = "required"
        else:
            default = _default(parameter.default)
        yield f"| {words} | {default} | {_choices(kind)}{_cell(info.help)} |"


def _words(info: Any, kind: Any) -> list[str]:
    """Give the ways to write a parameter: the name in capitals of an argument, an option with its value."""
    if isinstance(info, ArgumentInfo):
        several = "..." if str(kind).startswith(("list", "typing.List")) or "list[" in str(kind) else ""
        return [f"{info.metavar}{several}"]
    declared = [
        info.default,
        *(info.param_decls or ()),
    ]  # in an annotation the first name stands in the default's place
    value = "" if kind is bool else f" {info.metavar or _value_name(kind)}"
    return [f"{word}{value}" for word in declared]


def _value_name(kind: Any) -> str:
    kinds = [each for each in typing.get_args(kind) if each is not type(None)] or [kind]
    return {Path: "FILE", int: "N", float: "X", str: "TEXT"}.get(kinds[0], "NAME")


def _choices(kind: Any) -> str:
    for each in (kind, *typing.get_args(kind), *(a for k in typing.get_args(kind) for a in typing.get_args(k))):
        if isinstance(each, type) and issubclass(each, Enum):
            return " or ".join(f"`{member.value}`" for member in each) + ". "
    return ""


def _default(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return "yes" if value else ""
    return f"`{value.value if isinstance(value, Enum) else value}`"


def _settings_page() -> Iterator[str]:
    yield from ("# Settings", "", REMADE, "")
    yield "The defaults need no tuning. `--set NAME=VALUE` changes a setting on the command line,"
    yield "`scp_planner.Settings(name=value)` in Python. Values out of range are refused, and unknown names with the"
    yield "nearest known one. `scp-planner settings` prints this list."
    titles: dict[str, tuple[type[Knobs], str]] = {
        "Settings of plans": (Settings, "`scp_planner.Settings`, for `plan`, `penalty_descent` and `Planner`."),
        "Settings of the closed loop": (
            OnlineSettings,
            "`scp_planner.OnlineSettings`, for `Planner` and `simulate`; on the command line for `simulate`, where"
            " `--rate` gives the period.",
        ),
        "Tentative tracks": (Newcomers, "`scp_planner.settings.online.Newcomers`, in `OnlineSettings(newcomers=...)`."),
    }
    for title, (settings, text) in titles.items():
        yield from ("", f"## {title}", "", text, "", "| name | default | unit | range | effect |")
        yield "| --- | --- | --- | --- | --- |"
        yield from (_setting(knob) for knob in knobs(settings).values())
    yield ""


def _setting(knob: Knob) -> str:
    default = "see below" if knob.allowed is None else f"`{knob.default_text}`"
    allowed = "" if knob.allowed is None else _without_unit(knob)
    return f"| `{knob.name}` | {default} | {knob.unit} | {allowed} | {_cell(knob.effect)} |"


def _without_unit(knob: Knob) -> str:
    text = knob.allowed_text
    if isinstance(knob.allowed, Range) and knob.unit:
        text = text.replace(f" {knob.unit}", "", 1)
    return text.removeprefix("a number, ").removeprefix("a ").removeprefix("one of ")


def _cell(text: str | None) -> str:
    return " ".join((text or "").replace("``", "`").split()).replace("|", "\\|")


def main() -> None:
    """Write the pages."""
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
