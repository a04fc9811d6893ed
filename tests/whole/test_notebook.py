"""The notebook: what its cells do from top to bottom, as Jupyter would run them."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path
from typing import Any

import pytest

NOTEBOOK = Path(__file__).parents[2] / "examples" / "first_trip.ipynb"


def run_cell(source: str, names: dict[str, Any]) -> Any:
    """Run a cell; what its last line is worth, if it is an expression."""
    tree = ast.parse(source)
    last = tree.body[-1]
    if isinstance(last, ast.Expr):
        tree.body.pop()
    exec(compile(tree, "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names) if isinstance(last, ast.Expr) else None


def test_the_notebook_is_one_without_outputs() -> None:
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    ids = [cell["id"] for cell in notebook["cells"]]
    assert len(set(ids)) == len(ids)
    for cell in notebook["cells"]:
        assert cell["cell_type"] in ("markdown", "code")
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)


def test_the_notebook_runs_from_top_to_bottom(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    cells = [cell for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    names: dict[str, Any] = {}
    shown = [run_cell("".join(cell["source"]), names) for cell in cells]
    assert names["plan"].certified and names["run"].arrived and not names["run"].contact
    pictures = [value for value in shown if "image/png" in getattr(value, "_repr_html_", str)()]
    assert pictures == [names["plan"], names["run"]]
    near, far, later = map(float, re.findall(r"-?\d+\.\d+", capsys.readouterr().out.splitlines()[-1]))
    assert near < 0.05 and far >= 0.2 and later >= 0.0
    # Close to its limits all along: the interpolation between samples loses a little of them, and no clearance.
    samples = next(value for value in shown if repr(value).startswith("Certificate("))
    assert {violation.what for violation in samples.violations} <= {"acceleration", "speed", "lateral_acceleration"}
