"""The mutation run: each mutant is another program."""

from __future__ import annotations

import ast
import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCE = '''"""Doc."""
def limit(speed: float, allowed: int = 3) -> bool:
    """Return."""
    if not speed < 2.0:
        return True
    return min(speed - 1.5, 4) > 0 and allowed != 3


@cache(maxsize=8)
def far(ways: list[float]) -> float:
    if len(ways) < 5:
        raise ValueError("ways", 6, not ways)
    _log.debug("%d ways", 7)
    return [a / max(b, 1e-300) for a, b in zip(ways, ways, strict=True)]
'''


@pytest.fixture
def mutate(monkeypatch: pytest.MonkeyPatch) -> Any:
    spec = importlib.util.spec_from_file_location("mutate", ROOT / "tools" / "mutate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "mutate", module)
    spec.loader.exec_module(module)
    return module


def test_every_mutant_is_another_program(mutate: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mutate, "ROOT", tmp_path)
    file = tmp_path / "limit.py"
    file.write_text(SOURCE)
    mutants = list(mutate.find_mutants("certificate", file))
    made = {(*each.span, each.new) for each in mutants}
    assert len(made) == len(mutants) > 15
    whole = ast.dump(ast.parse(SOURCE))
    for begin, end, new in made:
        assert ast.dump(ast.parse(SOURCE[:begin] + new + SOURCE[end:])) != whole
    told = {(each.old, each.new) for each in mutants}
    assert {
        ("speed < 2.0", "(speed > 2.0)"),
        ("speed - 1.5", "(speed + 1.5)"),
        ("speed - 1.5", "(speed)"),
        ("1.5", "(2.25)"),
        ("not speed < 2.0", "(speed < 2.0)"),
        ("min(speed - 1.5, 4)", "(max(speed - 1.5, 4))"),
    } <= told
    assert ("len(ways) < 5", "(len(ways) <= 5)") in told
    assert not {"8", "6", "not ways", "7", "1e-300", "float", "'Doc.'"} & {old for old, _ in told}
    assert sum(each.old == "True" for each in mutants) == 1  # the one of `return True`
