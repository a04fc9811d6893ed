"""The package as a whole: its public names, how quickly it is imported, and its metadata."""

from __future__ import annotations

import ast
import json
import pkgutil
import subprocess
import sys
import tomllib
from collections.abc import Collection, Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import scp_planner

ROOT = Path(__file__).resolve().parents[2]
NOT_TO_PLAN = {"cvxpy", "clarabel", "osqp", "tqdm", "typer", "matplotlib", "PIL", "dask", "distributed", "pandas"}
STAGES = """
import json, sys
loaded, before = {}, set(sys.modules)
def stage(name):
    loaded[name] = sorted(set(sys.modules) - before)
    before.update(sys.modules)
import scp_planner as sp
stage("import")
sp.Plan, sp.Run
import scp_planner.plotting, scp_planner.plotting.viewer
stage("names")
from scp_planner import builtin
scenario = builtin.load("crossing")
plan = sp.plan(scenario, solver="daqp")
assert plan.certified
stage("plan")
start, planner = scenario.start, sp.Planner(scenario)
stage("planner")
planner.replan(start.time, start.position, start.heading, start.speed)
stage("replan")
scp_planner.plotting.plot_profiles(plan, scenario)
stage("figure")
print(json.dumps(loaded))
"""


def in_a_new_interpreter(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return done.stdout


@pytest.mark.parametrize("name", scp_planner.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(scp_planner, name) is not None
    assert name in dir(scp_planner)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'plann'"):
        scp_planner.plann  # noqa: B018


def test_no_module_has_the_name_of_something_public() -> None:
    """An import of the module would hide it."""
    modules = {entry.name for entry in pkgutil.iter_modules(scp_planner.__path__)}
    assert "planning" in modules
    assert modules.isdisjoint(scp_planner.__all__)


def test_nothing_is_loaded_before_it_is_needed() -> None:
    """By one module of the package for the import, and by nothing at all for a replan: it would miss its deadline."""
    loaded = {name: set(some) for name, some in json.loads(in_a_new_interpreter(STAGES)).items()}
    packages = {name: {module.partition(".")[0] for module in some} for name, some in loaded.items()}
    assert packages["import"] - {"scp_planner"} <= sys.stdlib_module_names
    assert [name for name in loaded["import"] if name.startswith("scp_planner")] == ["scp_planner"]
    assert len(loaded["import"]) <= 30  # 15 in Python 3.11; numpy alone would be 150
    assert "scp_planner.simulation.run" in loaded["names"]
    assert {"daqp"} <= packages["plan"] and not NOT_TO_PLAN & (packages["names"] | packages["plan"])
    assert not loaded["replan"]
    assert "matplotlib" in packages["figure"] and "matplotlib.pyplot" not in loaded["figure"]


@pytest.mark.slow
def test_import_takes_less_than_a_fifth_of_a_second() -> None:
    """Needs a machine that is not busy."""
    code = "import time; t = time.perf_counter(); import scp_planner; print(time.perf_counter() - t)"
    assert min(float(in_a_new_interpreter(code)) for _ in range(3)) < 0.2


@cache
def parsed(file: Path) -> ast.Module:
    return ast.parse(file.read_text())


def test_no_module_prints_but_the_command_line() -> None:
    """Results go to the caller, messages to logging."""
    printing = []
    for file in sorted((ROOT / "scp_planner").rglob("*.py")):
        calls = (node for node in ast.walk(parsed(file)) if isinstance(node, ast.Call))
        if any(isinstance(call.func, ast.Name) and call.func.id == "print" for call in calls):
            printing.append(file.name)
    assert printing == []


def test_the_lock_pins_every_dependency_with_hashes_and_no_address() -> None:
    lock = (ROOT / "requirements-lock.txt").read_text()
    assert "://" not in lock
    pinned = {line.split("==")[0] for line in lock.splitlines() if "==" in line}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["plot"], *extras["docs"], *extras["dev"]]
    assert {name.split(">=")[0].split("[")[0] for name in wanted} <= pinned
    blocks = lock.replace("\\\n", " ").splitlines()
    assert all("--hash=sha256:" in line for line in blocks if "==" in line)


def test_imports_go_round_in_no_circle() -> None:
    """Whatever is imported first, those in functions and for types too: each module needs only such as need it not."""
    files = sorted((ROOT / "scp_planner").rglob("*.py"))
    modules = {".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): file for file in files}
    assert len(modules) > 15
    needs = {name: {need for need in _imported(file, modules) if need != name} for name, file in modules.items()}
    found = {"scp_planner.scp.loop", "scp_planner.scp.given"}
    assert found <= needs["scp_planner.planning.runs"], "at its top, and in a function"
    assert len(list(TopologicalSorter(needs).static_order())) == len(modules)  # an error would name the circle


def _imported(file: Path, modules: Collection[str]) -> Iterator[str]:
    """Modules of the package that a file imports."""
    todo: list[ast.AST] = [parsed(file)]
    while todo:
        node = todo.pop()
        todo += ast.iter_child_nodes(node)
        if isinstance(node, ast.ImportFrom):
            for name in node.names:
                full = f"{node.module}.{name.name}"
                yield from {full if full in modules else str(node.module)}.intersection(modules)
        elif isinstance(node, ast.Import):
            yield from {name.name for name in node.names}.intersection(modules)
