"""The reference pages that are written from the code: up to date, and complete."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer.main

from scp_planner.cli import app
from scp_planner.cli.application import COMMANDS
from scp_planner.settings.knobs import knobs
from scp_planner.settings.online import Newcomers, OnlineSettings
from scp_planner.settings.planning import Settings

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture(scope="module")
def make_reference() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_reference", DOCS / "make_reference.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_pages_are_what_the_code_says(make_reference: ModuleType) -> None:
    for path, text in make_reference.pages().items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name} is old: python docs/make_reference.py"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_and_option_is_in_the_docs(name: str) -> None:
    page = (DOCS / "reference" / "cli.md").read_text(encoding="utf-8")
    section = re.search(rf"^## {name}\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL)
    assert section is not None
    for example in COMMANDS[name].examples:
        assert f"\n{example}\n" in section[1]
    command: Any = typer.main.get_command(app)
    for word in name.split():
        command = command.commands[word]
    # The names that the parser goes by
    for option in command.params:
        for word in (*option.opts, *option.secondary_opts):
            if word.startswith("-"):
                assert re.search(rf"[`/]{re.escape(word)}[ `/]", section[1]), word
        assert " ".join(option.help.replace("|", "\\|").split()) in section[1]


@pytest.mark.parametrize("settings", [Settings, OnlineSettings, Newcomers])
def test_every_setting_is_in_the_docs_with_unit_effect_and_range(settings: type) -> None:
    page = (DOCS / "reference" / "settings.md").read_text(encoding="utf-8")
    for name, knob in knobs(settings).items():
        row = re.search(rf"^\| `{name}` \| (.*) \| (.*) \| (.*) \| (.*) \|$", page, re.MULTILINE)
        assert row is not None, name
        default, unit, allowed, effect = row.groups()
        assert effect == knob.effect.replace("``", "`")
        assert unit == knob.unit
        if knob.allowed is not None:
            assert default == f"`{knob.default_text}`"
            assert allowed
            assert set(re.findall(r"[\w.+-]+", allowed)) <= set(re.findall(r"[\w.+-]+", knob.allowed_text))
