"""Command lines: all commands, with names of files and numbers that few would give."""

from __future__ import annotations

import logging
import os
import traceback
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from scp_planner import builtin
from scp_planner.cli import ExitCode, app

KNOWN_CODES = frozenset(int(code) for code in ExitCode)
SCENARIOS = ("good.yaml", "builtin:crossing", "builtin:none", "damaged.yaml", "empty.json", "folder", "nowhere.yaml")
FILES = (
    *SCENARIOS,
    "plan.json",
    "",
    "-",
    ".",
    "/",
    "out.json",
    "out.csv",
    "out.npz",
    "out.mcap",
    "out.html",
    "out.xyz",
    "bag",
    "pipe.json",
    "link.json",
    "loop.json",
    "no/such/out.json",
    "good.yaml/out.json",
    "/proc/self/none.json",
    "n" * 300,
    "two  blanks.yaml",
    "a\nb.yaml",
    "grün ✓.yaml",
    os.fsdecode(b"no\xffutf8.yaml"),
)
READ = tuple(name for name in FILES if name != "pipe.json")
"""Without what nobody writes to: reading it waits, as it should."""
NUMBERS = ("0", "1", "2", "-1", "1e3", "nan", "inf", "1e400", "99999999999999999999", "", "x", "0.5", "٣", "1_0")
TEXTS = ("", "map", "scp", "daqp", "osqp", "clarabel", "penalty-descent", "magic", "é", os.fsdecode(b"\xff"))
ASSIGNMENTS = (
    "path_span=2",
    "max_runs=1",
    "samples=nan",
    "safety=trip",
    "period=1",
    "=",
    "x",
    "tolerance=",
    "searches=-3",
)
NEEDS = {
    "plan": ("scenario",),
    "check": ("scenario", "file"),
    "simulate": ("scenario",),
    "compare": ("scenario",),
    "batch": ("file",),
    "export": ("file",),
    "fit-motion": ("file",),
    "settings": (),
    "schema": (),
    "study coverage": (),
    "demo": (),
}
OPTIONS = {
    "--output": FILES,
    "--seed": NUMBERS,
    "--samples": NUMBERS,
    "--time-limit": NUMBERS,
    "--method": TEXTS,
    "--solver": TEXTS,
    "--set": ASSIGNMENTS,
    "--noise": NUMBERS,
    "--rate": NUMBERS,
    "--starts": NUMBERS,
    "--epoch": NUMBERS,
    "--frame": TEXTS,
    "--view": TEXTS,
    "--pattern": ("*", "**/*", "[", "", "*.yaml", "/", os.fsdecode(b"\xff*")),
    "--plans": FILES,
    "--workers": ("0", "-1", "x", "1"),
    "--window": NUMBERS,
    "--kind": TEXTS,
}
OF_EACH = {
    "plan": ("--output", "--seed", "--samples", "--time-limit", "--method", "--solver", "--set", "--view"),
    "check": (),
    "simulate": ("--output", "--noise", "--rate", "--seed", "--solver", "--set"),
    "compare": ("--output", "--starts", "--method", "--set", "--seed"),
    "batch": ("--output", "--seed", "--pattern", "--plans", "--workers", "--time-limit"),
    "export": ("--output", "--samples", "--epoch", "--frame"),
    "fit-motion": ("--output", "--kind", "--window"),
    "settings": (),
    "schema": (),
    "study coverage": ("--output", "--seed"),
    "demo": ("--output",),
}
FLAGS = ("--json", "--quiet", "--verbose", "--help", "--nonsense")
BOUNDED = {
    "plan": ["--time-limit", "3"],
    "compare": ["--starts", "1", "--set", "max_iterations=3"],
    "batch": ["--time-limit", "3", "--workers", "1"],
    # what works through has nothing to do with odd input: these are only asked for what they refuse
    "demo": ["--output", "good.yaml"],
    "study coverage": ["--output", "good.yaml"],
}
"""Options that keep the work small; they come last, and so hold."""


def draw(rng: np.random.Generator) -> list[bytes]:
    """Draw the arguments of one command line, as the bytes that a system hands over."""
    command = str(rng.choice(list(NEEDS)))
    words = command.split()
    for need in NEEDS[command]:
        if rng.random() < 0.95:
            names = SCENARIOS if need == "scenario" and rng.random() < 0.7 else READ
            words.append(names[int(rng.integers(len(names)))])
    for option in OF_EACH[command]:
        if rng.random() < 0.35:
            values = OPTIONS[option]
            words += [option, values[int(rng.integers(len(values)))]]
    if command == "export" and rng.random() < 0.8:
        words += ["--output", FILES[int(rng.integers(len(FILES)))]]
    words += [flag for flag in FLAGS if rng.random() < 0.1]
    return [os.fsencode(word) for word in [*words, *BOUNDED.get(command, [])]]


def lay_out() -> None:
    """Fill the folder that a command is run in."""
    near = builtin.load("crossing")
    goal = near.goal.model_copy(update={"position": (4.0, 0.0)})
    small = near.model_copy(update={"goal": goal, "obstacles": near.obstacles[:1], "name": "good"})
    small.save("good.yaml")
    for name in FILES:
        if name.endswith(".yaml") and name not in SCENARIOS:
            Path(name).write_bytes(Path("good.yaml").read_bytes())
    Path("damaged.yaml").write_text("schema: 1\nvehicle: [")
    Path("empty.json").write_text("")
    Path("folder").mkdir()
    Path("folder", "one.yaml").write_bytes(Path("good.yaml").read_bytes())
    Path("plan.json").write_text('{"schema": 1}')
    os.mkfifo("pipe.json")
    Path("link.json").symlink_to("out.json")
    Path("loop.json").symlink_to("loop.json")


def run(arguments: list[str]) -> tuple[int, str]:
    """Run a command line; return its exit code, and the traceback if there was one."""
    done = CliRunner().invoke(app, arguments)
    logging.getLogger().handlers.clear()  # one of --verbose writes to what the runner has closed
    logging.getLogger("scp_planner").setLevel(logging.NOTSET)
    error = done.exception
    if error is not None and not isinstance(error, SystemExit):
        return done.exit_code, "".join(traceback.format_exception(error))
    return done.exit_code, ""
