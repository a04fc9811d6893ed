"""The commands that compare methods and measure claims."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command import COARSE, run


def test_compare_tables_writes_and_draws(easy: Path, tmp_path: Path) -> None:
    table, figure = tmp_path / "trials.csv", tmp_path / "comparison.png"
    result = run("compare", easy, "builtin:headon", "--starts", "1", "-o", table, "--plot", figure, *COARSE)
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    *rows, explained = result.stdout.splitlines()
    assert [line.split()[:2] for line in rows] == [["method", "trials"], ["scp", "2"], ["l-bfgs", "2"]]
    assert explained.startswith("excess: ")
    assert len(table.read_text().splitlines()) == 5
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_compare_as_json_with_chosen_methods(easy: Path) -> None:
    methods = ("--method", "l-bfgs", "--method", "scp")
    result = run("compare", easy, "--starts", "1", *methods, "--json", *COARSE)
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert [row["method"] for row in data["summary"]] == ["l-bfgs", "scp"]
    assert [trial["certified"] for trial in data["trials"]] == [True, True]


def test_compare_names_scenarios_that_no_method_solves(hopeless: Path, easy: Path) -> None:
    result = run("compare", hopeless, easy, "--starts", "1", "--method", "scp", *COARSE)
    assert result.exit_code == 3
    assert result.stderr == "no certified plan by any method: hopeless\n"
    assert "1 (50%)" in result.stdout
    assert run("compare", hopeless, "--starts", "1", "--method", "scp", "--quiet").stdout == ""


@pytest.mark.slow
def test_study_consistency_writes_tables_and_figures_and_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    options = ("study", "consistency", "--quick", "--repetitions", "2", "--workers", "1", "-o", folder)
    result = run(*options)
    assert result.exit_code == 0, result.output
    assert "Slopes over n" in result.stdout
    assert {file.name for file in folder.iterdir()} == {
        "results.jsonl",
        "summary.csv",
        "slopes.csv",
        "border.csv",
        "consistency.png",
        "border.png",
    }
    kept = (folder / "results.jsonl").read_bytes()
    again = run(*options, "--json")
    assert again.exit_code == 0
    assert {slope["kind"] for slope in json.loads(again.stdout)["slopes"]} == {"estimate", "region"}
    assert (folder / "results.jsonl").read_bytes() == kept


def test_study_consistency_refuses_a_folder_of_something_else(tmp_path: Path) -> None:
    (tmp_path / "results.jsonl").write_text("mine\n")
    result = run("study", "consistency", "--quick", "-o", tmp_path)
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{tmp_path / 'results.jsonl'}: line 1" in result.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["results.jsonl"]
