"""The command line, run in the process of the tests."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner, Result

from scp_planner.cli import app

COARSE = ("--set", "path_span=2.5", "--set", "acceleration_spans=8", "--set", "samples=80")


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])
