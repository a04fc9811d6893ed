"""Docstrings: the linter, which `make lint` runs, asks for those that users reach, and finds what it is for."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def linter() -> ModuleType:
    if os.environ.get("CI") != "true":
        pytest.importorskip("griffe", reason="needs the extra docs")
    spec = importlib.util.spec_from_file_location("check_docstrings", ROOT / "docs" / "check_docstrings.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_public_name_is_shown(linter: ModuleType) -> None:
    shown = linter.shown_names()
    assert {
        "scp_planner.planning.offline.plan",
        "scp_planner.planning.plan.Plan",
        "scp_planner.threat_zones.of_scenario.zones",
    } <= shown, "exported"
    assert {"scp_planner.threat_zones.zone.ThreatZone", "scp_planner.plotting.views.draw_plan"} <= shown, (
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
