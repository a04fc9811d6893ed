"""The wheel: what is in it, and how it behaves in an environment where nothing else is installed."""

from __future__ import annotations

import json
import os
import re
import statistics
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

import scp_planner

ROOT = Path(__file__).resolve().parents[2]
IMPORT_LIMIT = 0.35
"""s; measured in the new process, from before the import to after it."""
TIMED_IMPORT = "import time; t = time.perf_counter(); import scp_planner; print(time.perf_counter() - t)"
NOT_CORE = {"matplotlib", "PIL", "dask", "distributed", "casadi", "commonroad", "rosbags", "irsim", "pandas"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel, as `pip wheel` does, but with the backend that is installed."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (file,) = folder.glob("*.whl")
    return file


def environment(folder: Path, *, with_pip: bool) -> Path:
    """Make an environment without any packages; return its Python."""
    venv.create(folder, with_pip=with_pip)
    return folder / ("Scripts" if os.name == "nt" else "bin") / "python"


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., str]:
    """Run a program in an empty folder and with nothing of this environment; return what it prints."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}

    def call(*command: str | Path) -> str:
        done = subprocess.run([str(word) for word in command], cwd=tmp_path, env=clean, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return call


def test_the_wheel_has_the_package_and_its_data_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        metadata = archive.read(next(name for name in names if name.endswith("/METADATA"))).decode()
        entry_points = archive.read(next(name for name in names if name.endswith("/entry_points.txt"))).decode()
        about = archive.read(next(name for name in names if name.endswith("/WHEEL"))).decode()
    package = ROOT / "scp_planner"
    files = {
        path.relative_to(ROOT).as_posix()
        for path in package.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert {name for name in names if ".dist-info/" not in name} == files
    assert {
        "scp_planner/py.typed",
        "scp_planner/builtin/crossing.yaml",
        "scp_planner/plotting/assets/viewer.html",
    } <= files
    assert "Tag: py3-none-any" in about, "nothing in it is compiled"
    assert "scp-planner = scp_planner.__main__:main" in entry_points
    core = {line.split()[1] for line in metadata.splitlines() if re.match(r"Requires-Dist: [^;]*$", line)}
    assert not {re.split(r"\W", name)[0].lower() for name in core} & {name.lower() for name in NOT_CORE}


def test_the_page_of_the_package_has_no_link_that_leads_only_in_the_repository(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        name = next(name for name in archive.namelist() if name.endswith("/METADATA"))
        metadata = archive.read(name).decode()
    assert "Description-Content-Type: text/markdown" in metadata
    page = metadata.partition("\n\n")[2]
    assert "## Quick start" in page and "The tutorial goes from installation" in page
    links = re.findall(r"\]\(([^)]*)\)", re.sub(r"^```.*?^```", "", page, flags=re.MULTILINE | re.DOTALL))
    assert [link for link in links if not link.startswith(("https://", "#"))] == []
    assert "<!--" not in page


def test_the_source_distribution_has_all_that_the_tests_read(tmp_path: Path) -> None:
    """Whatever of the repository is not in it is named here."""
    command = [sys.executable, "-m", "hatchling", "build", "--target", "sdist", "--directory", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (source,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        inside = {Path(*Path(name).parts[1:]).as_posix() for name in archive.getnames()}
    folders = ("scp_planner", "tests", "verification", "benchmarks", "docs", "examples", "tools")
    wanted = {
        path.relative_to(ROOT).as_posix()
        for folder in folders
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    wanted |= {path.name for path in ROOT.glob("*.md")}
    wanted |= {
        "CITATION.cff",
        "LICENSE",
        "Makefile",
        "hatch_build.py",
        "mkdocs.yml",
        "pyproject.toml",
        "requirements-lock.txt",
    }
    assert wanted <= inside
    assert inside - wanted <= {"PKG-INFO", ".gitignore"}


def test_the_citation_is_of_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert citation["version"] == scp_planner.__version__
    assert (citation["license"], citation["abstract"]) == (project["license"], project["description"])
    assert citation["references"][0]["title"] in " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())


def test_importing_it_needs_and_loads_nothing_but_the_standard_library(
    wheel: Path, tmp_path: Path, run: Callable[..., str]
) -> None:
    """In an empty environment nothing can be loaded, and no extra is missed."""
    python = environment(tmp_path / "empty", with_pip=False)
    site = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_paths()['purelib'])").strip())
    assert list(site.iterdir()) == []
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    code = "import sys, scp_planner; print(scp_planner.__file__); print(scp_planner.__version__, *sys.modules)"
    place, loaded = run(python, "-c", code).splitlines()
    assert Path(place).is_relative_to(site)
    others = {name.partition(".")[0] for name in loaded.split()[1:]} - set(sys.stdlib_module_names)
    assert {name for name in others if not name.startswith("_")} == {"scp_planner"}


PLANNING = """
import json, sys
import scp_planner as sp
from scp_planner import builtin
plan = sp.plan(builtin.load("crossing"))
assert plan.certified
plan.save("plan.json")
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""


@pytest.mark.slow
def test_it_installs_where_there_is_no_compiler_and_plans(
    wheel: Path, tmp_path: Path, run: Callable[..., str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Into an empty environment, from wheels alone; needs a package index."""
    python = environment(tmp_path / "core", with_pip=True)
    run(python, "-m", "pip", "install", "--quiet", "--only-binary", ":all:", wheel)
    run(python, "-m", "pip", "check")
    installed = {entry["name"] for entry in json.loads(run(python, "-m", "pip", "list", "--format", "json"))}
    assert not installed & {name.lower() for name in NOT_CORE}
    times = [float(run(python, "-c", TIMED_IMPORT)) for _ in range(9)]
    assert statistics.median(times) < IMPORT_LIMIT, times
    with capsys.disabled():
        sys.stdout.write(
            f"\nimport scp_planner: median {statistics.median(times):.3f} s of 9, {max(times):.3f} s most\n"
        )
    loaded = set(json.loads(run(python, "-c", PLANNING)))
    assert not loaded & {"cvxpy", *NOT_CORE}
    program = python.with_name("scp-planner")
    assert json.loads(run(program, "check", "builtin:crossing", "plan.json", "--json"))["certified"] is True
    run(program, "plan", "builtin:headon", "--plot", "plan.html", "--quiet")
    run(program, "demo", "headon", "--quiet")
    run(program, "batch", "demo", "--pattern", "scenario.yaml", "--workers", "1", "--quiet")
    assert {path.name for path in tmp_path.iterdir()} >= {"plan.json", "plan.html", "demo", "results.csv"}
