"""The command line as a process: interrupts, a terminal, a shell that completes, and its own help."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main
from clock import PATIENCE, eventually
from command import run
from typer.testing import CliRunner

import scp_planner as sp
from scp_planner import builtin
from scp_planner.cli import app
from scp_planner.cli.application import COMMANDS, COMPLETE_VARIABLE, main

PROGRAM = [sys.executable, "-m", "scp_planner"]


# interrupts


@pytest.mark.parametrize(
    "command",
    [
        ["plan", "builtin:overtaking", "--method", "penalty-descent", "-o", "out.json", "--plot", "out.html"],
        pytest.param(
            ["simulate", "builtin:crossing", "--rate", "200", "-o", "out.json", "--animate", "out.html"],
            marks=pytest.mark.slow,
        ),
        pytest.param(["compare", "builtin:crossing", "builtin:overtaking", "-o", "out.csv"], marks=pytest.mark.slow),
    ],
    ids=lambda command: command[0],
)
def test_an_interrupt_while_planning_leaves_nothing(command: list[str], tmp_path: Path) -> None:
    arguments = [*PROGRAM, *command, "--verbose"]
    with subprocess.Popen(
        arguments, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("DEBUG scp_planner."), "planning has begun"
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, output) == (130, "")
    assert errors.endswith("interrupted\n") and "Traceback" not in errors
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_while_a_film_is_written_leaves_the_old_one(tmp_path: Path) -> None:
    film = tmp_path / "plan.gif"
    film.write_text("the old one")
    arguments = [*PROGRAM, "plan", "builtin:headon", "--plot", str(film)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        eventually(lambda: len(list(tmp_path.iterdir())) > 1)
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, output, errors) == (130, "", "interrupted\n")
    assert list(tmp_path.iterdir()) == [film]
    assert film.read_text() == "the old one"


# a terminal


def terminal() -> tuple[int, int]:
    """Open a terminal of 80 columns: our end and the program's."""
    pty = pytest.importorskip("pty", reason="needs a pseudo-terminal")
    import termios

    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    return ours, theirs


@pytest.mark.parametrize(
    ("command", "shown"),
    [
        pytest.param(
            ["compare", "builtin:headon", "--starts", "1", "--method", "scp"],
            b"0/1 [00:00<?, ?trial/s]",
            marks=pytest.mark.slow,
        ),
        (["simulate", "builtin:headon", "--rate", "2"], b"driving: 0.0 s"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_progress_is_shown_on_a_terminal_alone(command: list[str], shown: bytes, tmp_path: Path) -> None:
    ours, theirs = terminal()
    with subprocess.Popen([*PROGRAM, *command], cwd=tmp_path, stdout=subprocess.PIPE, stderr=theirs) as process:
        os.close(theirs)
        seen = b""
        while True:
            try:
                part = os.read(ours, 4096)
            except OSError:  # how Linux says that the other end is closed
                break
            if not part:
                break
            seen += part
        assert process.stdout is not None
        output = process.stdout.read()
    os.close(ours)
    assert process.returncode == 0
    assert shown in seen
    assert shown not in output and b"\r" not in output
    assert len(output) > 100


# a shell


@pytest.fixture
def shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the program by its name on the path, and a few files."""
    program = tmp_path / "bin" / "scp-planner"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {shlex.join(PROGRAM)} "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    return tmp_path


COMPLETIONS = pytest.mark.parametrize(
    ("words", "completed"),
    [
        (["pl"], ["plan"]),
        (["s"], ["simulate", "schema", "settings", "study"]),
        (["study", "co"], ["consistency", "coverage"]),
        (["plan", "builtin:c"], ["builtin:crossing"]),
        (["plan", "x.yaml", "--solver", "c"], ["clarabel", "cvxpy"]),
        (["plan", "x.yaml", "--set", "path_"], ["path_degree=", "path_span="]),
        (["plan", "x.yaml", "--set", "foresi"], []),
        (["simulate", "x.yaml", "--set", "foresi"], ["foresight="]),
        (["settings", "path_"], ["path_degree", "path_span"]),
        (["plan", "x.yaml", "--method", "p"], ["penalty-descent"]),
        (["plan", "x.yaml", "--time"], ["--time-limit"]),
        (["demo", "over"], ["overtaking"]),
        # as bash splits "builtin:c", "builtin:", "--solver=c", and what follows "tcp://10.0.0.1:8786"
        (["plan", "builtin", ":", "c"], ["crossing"]),
        (["compare", "x.yaml", "builtin", ":"], ["crossing", "headon", "overtaking", "radar"]),
        (["plan", "x.yaml", "--solver", "=", "c"], ["clarabel", "cvxpy"]),
        (["batch", "x", "--dask", "tcp", ":", "//10.0.0.1", ":", "8786", "--patt"], ["--pattern"]),
        (["plan", "x.yaml", "--set", "path_span", "=", "1", "--time"], ["--time-limit"]),
        (["plan", "cros"], []),  # then the shell completes names of files
    ],
    ids=lambda value: " ".join(value),
)


@COMPLETIONS
def test_what_bash_asks_for_is_completed(
    words: list[str], completed: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(COMPLETE_VARIABLE, "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "\n".join(["scp-planner", *words]))
    monkeypatch.setenv("COMP_CWORD", str(len(words)))
    main()
    assert sorted(capsys.readouterr().out.split()) == sorted(completed)


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        pytest.param(["study", "co"], ["consistency", "coverage"], marks=pytest.mark.slow),
        (["compare", "x.yaml", "builtin", ":"], ["crossing", "headon", "overtaking", "radar"]),
    ],
    ids=lambda value: " ".join(value),
)
def test_bash_completes(words: list[str], completed: list[str], shell: Path) -> None:
    if shutil.which("bash") is None:
        pytest.skip("needs bash")
    typed = shlex.join(["scp-planner", *words])
    script = f"""
source <(scp-planner --show-completion bash)
complete -p scp-planner | grep -q -- '-o default' || exit 3
COMP_WORDS=({typed}); COMP_CWORD={len(words)}
_scp_planner_completion scp-planner
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
    done = subprocess.run(["bash", "-c", script], cwd=shell, capture_output=True, text=True, check=True)
    assert sorted(done.stdout.split()) == sorted(completed), done.stderr


# the help


EXAMPLES = {name: command.examples for name, command in COMMANDS.items()}


def commands() -> dict[str, Any]:
    """All commands by their full names."""
    found: dict[str, Any] = {}
    top = typer.main.get_command(app)
    for name, command in top.commands.items():  # type: ignore[attr-defined]
        if hasattr(command, "commands"):
            found |= {f"{name} {below}": each for below, each in command.commands.items()}
        else:
            found[name] = command
    return found


@pytest.mark.parametrize("name", commands())
def test_help_of_every_command_says_what_it_does_and_shows_an_example(name: str) -> None:
    result = CliRunner().invoke(app, [*name.split(), "--help"], env={"COLUMNS": "120"})
    assert result.exit_code == 0
    assert result.output.startswith(f"Usage: scp-planner {name} ") or f" {name} " in result.output.splitlines()[0]
    assert EXAMPLES[name]
    for example in EXAMPLES[name]:
        assert f"  {example}\n" in result.output
        assert example.startswith(f"scp-planner {name}")
    for option in commands()[name].params:
        assert option.help, f"{option.name} has no help"
    assert set(commands()) == set(COMMANDS)


@pytest.mark.parametrize("example", [example for each in EXAMPLES.values() for example in each])
def test_every_example_is_understood(example: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All options and arguments are known and have values that their types allow."""
    monkeypatch.chdir(tmp_path)
    for bag in ("drive", "drive.mcap"):  # recordings must exist
        Path(bag).touch()
    name = next(name for name in sorted(EXAMPLES, key=len)[::-1] if example.startswith(f"scp-planner {name}"))
    words = shlex.split(example.partition(">")[0])[1 + len(name.split()) :]
    context = commands()[name].make_context(name, words)
    assert not context.args


def _write_samples(plan: sp.Plan, *names: str) -> None:
    """Write a plan as any planner might write its trip."""
    times = np.unique(np.round(np.concatenate([np.linspace(0.0, plan.arrival_time, 401), plan.knot_times]), 9))
    rows = np.column_stack([times, plan.position(times), plan.heading(times), plan.speed(times)])
    for name in names:
        np.savetxt(name, rows, delimiter=",", header="t,x,y,heading,speed", comments="")


def test_examples_of_one_scenario_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    builtin.load("crossing").save("crossing.yaml")
    for name in ("plan", "check", "settings", "schema"):
        for example in EXAMPLES[name]:
            if name == "check":
                _write_samples(sp.Plan.load("plan.json"), "mine.csv", "theirs.csv")
            done = run(*shlex.split(example.partition(">")[0])[1:])
            assert done.exit_code == 0, done.output
    assert {path.name for path in tmp_path.iterdir()} >= {"crossing.yaml", "plan.json", "plan.html"}
