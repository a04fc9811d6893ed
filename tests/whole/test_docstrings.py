"""Docstrings: the linter, which `make lint` runs, asks for those that users reach, and finds what it is for."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from scripts import load


@pytest.fixture(scope="module")
def linter() -> ModuleType:
    if os.environ.get("CI") != "true":
        pytest.importorskip("griffe", reason="needs the extra docs")
    return load("docs/check_docstrings.py")


def test_every_public_name_is_shown(linter: ModuleType) -> None:
    shown = linter.shown_names()
    assert {
        "scp_planner.planning.plan_search.plan",
        "scp_planner.planning.plan.Plan",
        "scp_planner.threat_zones.of_scenario.zones",
    } <= shown, "exported"
    assert {"scp_planner.threat_zones.zone.ThreatZone", "scp_planner.plotting.figures.plot_plan"} <= shown, (
        "in the reference alone"
    )
    assert "scp_planner.scenario.validation.Part" in shown, "a base, whose methods are reached"


@pytest.fixture
def faults_of(linter: ModuleType, tmp_path: Path) -> Callable[[str], list[str]]:
    def check(source: str) -> list[str]:
        (tmp_path / "some").mkdir()
        (tmp_path / "some" / "__init__.py").write_text("")
        (tmp_path / "some" / "things.py").write_text(source)
        found = linter.faults("some", tmp_path, {"some.things.shown", "some.things.Shown", "some.things.Base"})
        return [fault.split(": ", 2)[2] for fault in found]

    return check


SECTIONS = '''
def shown(a: int, b: int) -> int:
    """Do it.

    Parameters
    ----------
    {parameters}

    Raises
    ------
    KeyError
    """
    raise ValueError("no")
'''


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("def hidden(a: int) -> int:\n    return a\n", []),
        ('def hidden(a: int) -> int:\n    """Do it.\n\n    Returns\n    -------\n    int\n    """\n    return a\n', []),
        ("def shown() -> None:\n    pass\n", ["has no docstring"]),
        ("class Base:\n    def inherited(self) -> None:\n        pass\n", ["has no docstring"] * 2),
        ('def hidden() -> None:\n    """Whether it is so."""\n', ["begins with 'Whether'"]),
        ('class Hidden:\n    a: int\n    """The same in order."""\n', ["begins with 'The same'"]),
        ('"""Of things."""\n', ["begins with 'Of'"]),
        ('def hidden() -> None:\n    """Offset, m."""\n', []),
        (
            SECTIONS.format(parameters="a : int\n        A number."),
            [
                "parameters not documented: b",
                "what it returns is not documented",
                "what it raises is not documented: ValueError",
            ],
        ),
        (
            SECTIONS.format(parameters="a, b, c : int\n        A number.").replace("KeyError", "ValueError"),
            ["no such parameters: c", "what it returns is not documented"],
        ),
        (
            SECTIONS.format(parameters="b, a : int\n        A number.")
            .replace("KeyError", "ValueError")
            .replace("-> int", "-> None"),
            ["parameters are documented in another order"],
        ),
        (
            'def shown(speed: float) -> Array:\n    """Do it at a speed."""\n',
            ["speed: no unit is given", "what it returns: no shape is given", "what it returns: no unit is given"],
        ),
        ('def shown(speed: float) -> Array:\n    """Do it at a speed, m/s, and give (n, 2) m."""\n', []),
        ('def shown() -> Array:\n    """Give an array (m, 2)."""\n', ["what it returns: no unit is given"]),
        (
            '@dataclass\nclass Shown:\n    """A thing.\n\n    Attributes\n    ----------\n    length : float\n'
            "        Of it.\n"
            '    """\n\n    length: float\n    width: float\n',
            ["attribute length: no unit is given", "attribute width is not documented"],
        ),
    ],
)
def test_the_linter_finds(source: str, said: list[str], faults_of: Callable[[str], list[str]]) -> None:
    assert faults_of(source) == said


# The runs of the tests as on other machines: which there are, what they set, and what their table says


@pytest.fixture(scope="module")
def machines() -> ModuleType:
    return load("tools/machines.py")


def test_all_kinds_of_machines_are_among_the_variants(machines: ModuleType) -> None:
    names = [variant.name for variant in machines.chosen([])]
    assert names == [
        *("own", "kernel-haswell", "kernel-sandybridge", "kernel-prescott", "kernel-skylakex"),
        *("numpy-baseline", "load", "oldest", "newest", "python3.11", "python3.12", "python3.13", "python3.14"),
    ]
    (load,) = machines.chosen(["load"])
    assert load.load == 2
    assert [variant.name for variant in machines.chosen(["newest", "own"])] == ["newest", "own"]


@pytest.mark.parametrize(("features", "can"), [({"sse2", "avx"}, True), ({"sse2"}, False), (set(), False)])
def test_a_kernel_is_asked_for_where_the_processor_can_run_it(
    machines: ModuleType, features: set[str], can: bool
) -> None:
    (kernel,) = (each for each in machines.KERNELS if each.name == "Sandybridge")
    if can:
        assert machines.kernel_settings(kernel, frozenset(features), {}) == {"OPENBLAS_CORETYPE": "Sandybridge"}
    else:
        with pytest.raises(machines.Skipped, match="has no avx"):
            machines.kernel_settings(kernel, frozenset(features), {})


def test_numpy_does_without_the_features_that_it_has(machines: ModuleType) -> None:
    """Names that this numpy has for what this processor has: of others it would warn."""
    try:
        settings = machines.without_extra_features(Path(sys.executable))
    except machines.Skipped as reason:
        pytest.skip(str(reason))
    code = "from numpy._core._multiarray_umath import __cpu_features__ as f; print(*(n for n in {!r}.split() if f[n]))"
    words = settings["NPY_DISABLE_CPU_FEATURES"]
    command = [sys.executable, "-W", "error", "-c", code.format(words)]
    with_all = subprocess.run(command, capture_output=True, text=True, check=True)
    without = subprocess.run(command, capture_output=True, text=True, check=True, env=settings)
    assert with_all.stdout.split() == words.split()
    assert without.stdout.split() == []
