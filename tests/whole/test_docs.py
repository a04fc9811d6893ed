"""The documentation: the site builds without a warning, every block of code in it runs, and nothing public is missing.

A page's blocks run in order, in one namespace and one empty folder:

- ``python`` blocks are executed; a ``text`` block right after one is what it prints;
- blocks with a ``title`` are written to a file of that name;
- ``console`` blocks are run line by line (``$ command``) and what is printed is compared; ``echo $?`` shows the exit
  code of the command before, which is 0 otherwise.

In what is printed ``...`` stands for anything, and white space does not matter. A block after a comment
``<!-- not run: why -->`` is not run; what may stand in those is listed in ``NOT_RUN``."""

from __future__ import annotations

import contextlib
import doctest
import importlib.util
import io
import os
import pkgutil
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import typer.main
from scenes import scene
from scripts import load
from typer.testing import CliRunner

import scp_planner as sp
from scp_planner.cli import app
from scp_planner.cli.application import COMMANDS
from scp_planner.settings.knobs import knobs
from scp_planner.settings.online import Newcomers, OnlineSettings
from scp_planner.settings.planning import Settings

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
FENCE = re.compile(
    r"^(?P<indent>[ ]*)```(?P<language>\w*)(?P<options>[^\n]*)\n(?P<text>.*?)^(?P=indent)```[ ]*$", re.M | re.S
)
MARK = re.compile(r"<!-- not run: [^>]+ -->\n\s*\Z")
NOT_RUN = (  # commands that need the network, minutes, or the checkout's own tools
    r"git clone \S+ \S+",
    r"cd \S+",
    r"python3? -m venv \S+",
    r"\. \S+/bin/activate",
    r"pip install \S+",
    r"make \w+",
    r"python -m (benchmarks|docs|scp_planner\.studies)\.\w+( .*)?",
    r"python examples/\w+\.py( .*)?",  # tests/whole/test_examples.py runs them all
    r"scp-planner (study|compare) .*",
    r"scp-planner export \S+ -o \S+\.mcap .*",
    r"scp-planner batch .* --dask .*",
    r"scp-planner plan \S+\.xml .*",
    r"scp-planner replay .*",
)
LANGUAGES_WITHOUT_CODE = {"text", "yaml", "json", "math"}


@dataclass(frozen=True)
class Block:
    """A fenced block of code."""

    language: str
    options: str
    text: str
    line: int
    run: bool
    follows: bool  # whether nothing but white space is between it and the block before

    @property
    def title(self) -> str | None:
        found = re.search(r'title="([^"]+)"', self.options)
        return found.group(1) if found else None


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path) -> Iterator[Block]:
    text, end = page.read_text(encoding="utf-8"), 0
    for found in FENCE.finditer(text):
        indent = len(found["indent"])
        body = "".join(line[indent:] or "\n" for line in found["text"].splitlines(keepends=True))
        line = text.count("\n", 0, found.start()) + 1
        run = MARK.search(text[: found.start()]) is None
        yield Block(found["language"], found["options"], body, line, run, not text[end : found.start()].strip())
        end = found.end()


def assert_printed(expected: str, printed: str, where: str) -> None:
    same = doctest.OutputChecker().check_output(
        expected.strip() + "\n", printed.strip() + "\n", doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    )
    assert same, f"{where} prints\n{printed}\nand not\n{expected}"


def run_command(command: str) -> subprocess.CompletedProcess[str]:
    """Run a command; this program's own in this process, as it takes long to load."""
    words = shlex.split(command)
    if words[0] == "scp-planner":
        told = CliRunner().invoke(app, words[1:])
        return subprocess.CompletedProcess(words, told.exit_code, told.output)
    programs = {"python": [sys.executable]}
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "PYTHONUNBUFFERED": "1", "MPLBACKEND": "Agg"}
    return subprocess.run(
        [*programs.get(words[0], [words[0]]), *words[1:]],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=1800,  # s; only what hangs takes so long
    )


def commands_of(block: Block) -> list[tuple[str, str]]:
    """The commands of a console block, each with what it prints."""
    parts = re.split(r"^\$ ", block.text, flags=re.M)
    assert not parts[0].strip(), f"line {block.line}: a console block begins with a command"
    pairs = (part.partition("\n") for part in parts[1:])
    return [(command.strip(), printed) for command, _, printed in pairs]


def run_console(block: Block, where: str) -> None:
    commands = commands_of(block)
    code = 0
    for number, (command, printed) in enumerate(commands):
        if command == "echo $?":
            assert_printed(printed, str(code), where)
            continue
        done = run_command(command)
        code = done.returncode
        is_shown = number + 1 < len(commands) and commands[number + 1][0] == "echo $?"
        assert code == 0 or is_shown, f"{where}: {command}: exit code {code}\n{done.stdout}"
        if printed.strip():
            assert_printed(printed, done.stdout, f"{where}: {command}")


def record_tracks() -> None:
    """Two dozen people who wander about, for the page that fits a motion to recordings."""
    rng = np.random.default_rng(0)
    folder = Path("recordings")
    folder.mkdir()
    lines = ["id,time,x,y"]
    for person in range(24):
        velocity = rng.normal(0.0, 1.0, 2) + np.cumsum(rng.normal(0.0, 0.1, (20, 2)), axis=0)
        places = rng.uniform(-5.0, 5.0, 2) + np.cumsum(0.4 * velocity, axis=0)
        lines += [f"{person},{0.4 * step:.1f},{x:.3f},{y:.3f}" for step, (x, y) in enumerate(places)]
    (folder / "walkers.csv").write_text("\n".join(lines) + "\n")


PREPARATIONS: dict[str, Callable[[], None]] = {"docs/explanation/zones.md": record_tracks}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_block_of_code_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    PREPARATIONS.get(name_of(page), lambda: None)()
    namespace: dict[str, Any] = {"__name__": "__main__"}
    printed: str | None = None
    for block in blocks(page):
        where = f"{name_of(page)}, line {block.line}"
        if block.language == "text" and block.follows and printed is not None:
            assert_printed(block.text, printed, where)
        printed = None
        if not block.run:
            assert block.language == "console", f"{where}: only console blocks may be left out"
            for command, _ in commands_of(block):
                assert any(re.fullmatch(known, command.split("  #")[0].strip()) for known in NOT_RUN), (
                    f"{where}: {command}"
                )
        elif block.title is not None:
            Path(block.title).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile("\n" * block.line + block.text, str(page), "exec"), namespace)
            printed = out.getvalue()
        elif block.language == "console":
            run_console(block, where)
        else:
            assert block.language in LANGUAGES_WITHOUT_CODE, f"{where}: what is {block.language!r}?"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_code_is_fenced(page: Path) -> None:
    """Code that is only indented would not be run."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    indented = re.findall(r"\n\n    ((?:scp-planner|python|import|from|pip|make) .*)", text)
    assert indented == []


def test_examples_that_pages_name_exist() -> None:
    named = {name for page in PAGES for name in re.findall(r"examples/\w+\.py", page.read_text(encoding="utf-8"))}
    assert named
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []


def test_the_gallery_shows_every_example() -> None:
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    for example in (ROOT / "examples").glob("*.py"):
        assert f"examples/{example.name}" in text
        if "--output" not in example.read_text(encoding="utf-8"):
            continue  # it draws nothing
        assert re.search(rf"\(figures/gallery/{example.stem}\.\w+\)", text), f"no figure of {example.name}"


def test_links_of_the_readme_lead_somewhere() -> None:
    links = re.findall(r"\]\(([^)#]+)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert [link for link in links if "://" not in link and not (ROOT / link).exists()] == []


def keys_of(schema: Any) -> set[str]:
    """Names of all properties anywhere in a JSON schema."""
    if isinstance(schema, dict):
        own = set(schema["properties"]) if isinstance(schema.get("properties"), dict) else set()
        return own.union(*(keys_of(part) for part in schema.values()))
    return set().union(*(keys_of(part) for part in schema)) if isinstance(schema, list) else set()


def test_the_reference_of_the_scenario_file_has_every_key() -> None:
    from docs.hooks import TABLES, tables

    assert TABLES in (DOCS / "reference" / "scenario-file.md").read_text(encoding="utf-8")
    keys = set(re.findall(r"^\| `(\w+)` \|", tables(), flags=re.M))
    assert keys == keys_of(sp.Scenario.json_schema())


def test_the_reference_of_the_plan_file_has_every_key(tmp_path: Path) -> None:
    from scp_planner import builtin

    text = (DOCS / "reference" / "plan-file.md").read_text(encoding="utf-8")
    words = set(re.findall(r"\w+", text))
    data = sp.plan(builtin.load("headon")).to_dict(samples=2)
    inner = {key for value in data.values() if isinstance(value, dict) for key in value}
    assert (set(data) | inner) - words == set()


def _formula(source: str) -> Any:
    from docs.hooks import to_mathml

    return ElementTree.fromstring(re.sub(r' xmlns="[^"]*"', "", to_mathml(source)))


def test_formulas_are_set() -> None:
    (division,) = _formula(r"a = \frac{-2 L}{v_0 + \sqrt{v_0^2 + 4}}").iter("mfrac")
    above, below = ("".join(part.itertext()) for part in division)
    assert (above, below) == ("\N{MINUS SIGN}2L", "v0+v02+4")
    (root,) = division.iter("msqrt")
    assert [[part.text for part in both] for both in root.iter("msubsup")] == [["v", "0", "2"]]
    (sum_,) = _formula(r"\sum_i p_i").iter("munder")
    assert [part.text for part in sum_] == ["\N{N-ARY SUMMATION}", "i"]
    lines = _formula(r"\begin{aligned} a & \le \text{a few} \\ b & \le 1 \end{aligned}").findall(".//mtr")
    assert ["".join(line.itertext()).replace("\xa0", " ") for line in lines] == ["a≤a few", "b≤1"]


def test_every_formula_of_the_pages_is_known() -> None:
    texts = {str(page): page.read_text(encoding="utf-8") for page in PAGES}
    formulas = [each for text in texts.values() for each in re.findall(r"^```math\n(.*?)^```", text, re.M | re.S)]
    assert len(formulas) >= 5
    assert {_formula(formula).tag for formula in formulas} == {"math"}
    # None is left as a line that is only indented.
    assert [page for page, text in texts.items() if re.search(r"\n\n {4}[^\n`]* = [^\n]*[Στ√]", text)] == []


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site's folder."""
    if importlib.util.find_spec("mkdocs") is None:
        locked = "\nmkdocs-material==" in (ROOT / "requirements-lock.txt").read_text()
        assert not (locked and os.environ.get("CI") == "true"), "the lock pins MkDocs, which is not installed"
        pytest.skip("needs MkDocs: pip install '.[docs]'")
    site = tmp_path_factory.mktemp("docs") / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(site)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr + done.stdout
    return site


@pytest.mark.slow
def test_the_site_is_whole_and_fetches_nothing(built: Path) -> None:
    page = (built / "index.html").read_text(encoding="utf-8")
    reference = "".join(page.read_text(encoding="utf-8") for page in (built / "reference").glob("*.html"))
    public = [(name, getattr(sp, name)) for name in sp.__all__ if name != "__version__"]
    assert [name for name, value in public if f'id="{value.__module__}.{name}"' not in reference] == []
    # Nothing is fetched from elsewhere.
    assert re.findall(r"<(?:script|link|img)[^>]*(?:src|href)=\"?https?://[^\s>]*", page) == []


# The page *From the paper to the code*: what it names is there

PAGE = Path(__file__).resolve().parents[2] / "docs" / "explanation" / "paper-to-code.md"


def named() -> list[str]:
    """Dotted names of modules and what is in them, in the table of symbols."""
    table = PAGE.read_text(encoding="utf-8").split("## Symbols")[1].split("## The objective")[0]
    return sorted(set(re.findall(r"`([a-z_]+\.[A-Za-z_.]+)`", table)))


@pytest.mark.parametrize("name", named())
def test_every_name_in_the_table_of_symbols_is_there(name: str) -> None:
    found = pkgutil.resolve_name(f"scp_planner.{name}")
    assert found is not None


def test_the_table_names_what_it_should() -> None:
    assert len(named()) >= 15


def test_pictures_and_pages_that_it_links_to_are_there() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", PAGE.read_text(encoding="utf-8"))
    assert links
    assert [link for link in links if not (PAGE.parent / link).is_file()] == []


def test_travel_time_is_written_as_the_page_says() -> None:
    """2 L / (v0 + sqrt(v0^2 + 4 A L)) is the root of v0 tau + A tau^2 = L, with all its digits where A is tiny."""
    from scp_planner.problem.build import build_problem

    space = build_problem(scene(), (), sp.Settings()).space
    for acceleration in (1.0, 1e-3, 1e-14, -1e-14, -0.02):
        beta = space.acceleration_size * [acceleration]
        tau = space.travel_time(20.0, beta)  # type: ignore[arg-type]
        assert tau + 0.5 * acceleration * tau**2 == pytest.approx(20.0, rel=1e-14)


# The reference pages that are written from the code: up to date, and complete


@pytest.fixture(scope="module")
def make_reference() -> ModuleType:
    return load("docs/make_reference.py")


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
