"""Batches, with an executor that does the work here and now."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest
import yaml
from batches import STRANGE_NAMES, Here

from scp_planner.batch import runner
from scp_planner.batch.executor import Fate
from scp_planner.batch.jobs import Options, TableRow
from scp_planner.batch.runner import run_batch, scenario_files
from scp_planner.batch.table import TableError, opened
from scp_planner.planning.plan import Plan
from scp_planner.settings.planning import Settings


def test_a_batch_has_a_row_for_each_scenario(folder: Path, tmp_path: Path) -> None:
    table, plans, heard = tmp_path / "t.csv", tmp_path / "plans", []
    executor = Here()
    files = scenario_files(folder)
    result = run_batch(files, table, executor, plans=plans, progress=lambda done, status: heard.append((done, status)))
    assert executor.done == ["overtaking.json", "headon.yaml", "crossing.yaml"]
    assert heard == [(1, "bad_input"), *((done, "certified") for done in (2, 3, 4))]
    assert (result.counts, result.done_before) == ({"certified": 3, "bad_input": 1}, 0)
    assert [row["file"] for row in result.rows] == list(files)
    broken, crossing = result.rows[:2]
    assert "speed = 3: unknown key" in broken["reason"] and "vehicle: missing" in broken["reason"]
    plan = Plan.load(plans / "crossing.yaml.plan.json")
    assert float(crossing["travel_time"]) == plan.travel_time
    assert int(crossing["iterations"]) == plan.iterations
    assert crossing["nearest_obstacle"] == plan.clearance.obstacle
    assert len(table.read_text().splitlines()) == 5


def test_rows_that_are_there_are_not_done_again(folder: Path, tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    files = scenario_files(folder)
    run_batch(files, table, Here())
    before = table.read_bytes()
    again = Here()
    result = run_batch(files, table, again)
    assert (again.done, result.done_before) == ([], 4)
    assert table.read_bytes() == before


def test_an_interrupted_batch_ends_like_one_that_was_not(folder: Path, tmp_path: Path) -> None:
    files = scenario_files(folder)
    run_batch(files, tmp_path / "whole.csv", Here())
    with pytest.raises(KeyboardInterrupt):
        run_batch(files, tmp_path / "t.csv", Here(most=1))
    assert len((tmp_path / "t.csv").read_text().splitlines()) == 3  # header, the broken one, and one plan
    rest = Here()
    run_batch(files, tmp_path / "t.csv", rest)
    assert len(rest.done) == 2
    assert (tmp_path / "t.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()


def test_a_scenario_that_has_changed_is_done_again(folder: Path, tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    run_batch(scenario_files(folder), table, Here())
    data = yaml.safe_load((folder / "headon.yaml").read_text())
    (folder / "headon.yaml").write_text(yaml.safe_dump(data))  # other text, same scenario
    data["vehicle"]["max_speed"] = 2.0
    (folder / "crossing.yaml").write_text(yaml.safe_dump(data))
    (folder / "broken.yaml").write_text(yaml.safe_dump({**data, "name": "mended"}))
    again = Here()
    result = run_batch(scenario_files(folder), table, again)
    assert again.done == ["crossing.yaml", "broken.yaml"]
    assert [row["name"] for row in result.rows] == ["mended", "headon", "headon", "overtaking"]
    assert len(table.read_text().splitlines()) == 5


def test_work_that_came_to_nothing_is_done_again_only_if_that_is_asked_for(folder: Path, tmp_path: Path) -> None:
    table, files = tmp_path / "t.csv", scenario_files(folder)
    lost = run_batch(files, table, Here(Fate.LOST))
    assert lost.counts == {"lost": 3, "bad_input": 1}
    assert lost.rows[1]["reason"] == "a reason, of two lines"
    assert run_batch(files, table, Here()).counts == lost.counts
    assert run_batch(files, table, Here(), retry=True).counts == {"certified": 3, "bad_input": 1}
    assert len(table.read_text().splitlines()) == 5


def test_what_is_no_scenario_at_all_has_a_short_reason(tmp_path: Path) -> None:
    folder = tmp_path / "plans"
    folder.mkdir()
    (folder / "plan.json").write_text(json.dumps({f"key{number}": number for number in range(50)}))
    (only,) = run_batch(scenario_files(folder), tmp_path / "t.csv", Here()).rows
    assert only["reason"].endswith("and 48 more faults") and len(only["reason"]) < 1000


def test_strange_names_of_files_are_planned_and_found_again(strange: Path, tmp_path: Path) -> None:
    files = scenario_files(strange)
    result = run_batch(files, tmp_path / "t.csv", Here(), plans=tmp_path / "plans")
    assert set(result.counts) == {"certified"} and result.done_before == 0
    lines = (tmp_path / "t.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 1 + len(files) == 1 + len(STRANGE_NAMES)
    cells = [row["file"] for row in result.rows]
    assert len(set(cells)) == len(STRANGE_NAMES)
    assert {"two  blanks.yaml", " before.yaml", r"a new\nline.yaml", r"a new\\nline.yaml"} < set(cells)
    assert {os.fsencode(path.name) for path in (tmp_path / "plans").iterdir()} == {
        name + b".plan.json" for name in STRANGE_NAMES
    }
    again = run_batch(files, tmp_path / "t.csv", Here(), plans=tmp_path / "plans")
    assert again.done_before == len(STRANGE_NAMES) and again.rows == result.rows
    assert runner.rows_done(files, tmp_path / "t.csv") == len(STRANGE_NAMES)


def test_text_that_is_no_unicode_has_a_cell() -> None:
    made = TableRow("a.yaml", name="\ud800", reason="one\ntwo  three").texts()
    assert (made["name"], made["reason"]) == (r"\ud800", "one two three")


def test_plans_that_are_asked_for_later_are_made(folder: Path, tmp_path: Path) -> None:
    table, files, again = tmp_path / "t.csv", scenario_files(folder), Here()
    run_batch(files, table, Here())
    run_batch(files, table, again, plans=tmp_path / "plans")
    assert len(again.done) == len(list((tmp_path / "plans").iterdir())) == 3


def test_rows_of_other_options_are_not_mixed(folder: Path, tmp_path: Path) -> None:
    table, files = tmp_path / "t.csv", scenario_files(folder)
    run_batch(files, table, Here(), Options(settings=Settings(path_span=2.0)))
    before = table.read_bytes()
    with pytest.raises(TableError, match=r"other options: .*path_span=2.0, not method=scp;"):
        run_batch(files, table, Here())
    with pytest.raises(TableError, match="its columns are"):
        run_batch(files, table, Here(), timings=True)
    assert table.read_bytes() == before


def test_scenarios_are_found_by_pattern_and_results_left_out(folder: Path) -> None:
    (folder / "sub").mkdir()
    shutil.copy(folder / "headon.yaml", folder / "sub" / "headon.yml")
    (folder / "plans").mkdir()
    (folder / "plans" / "headon.yaml.plan.json").write_text("{}")
    (folder / ".crossing.yaml.part.yaml").write_text("half a file")
    assert list(scenario_files(folder)) == ["broken.yaml", "crossing.yaml", "headon.yaml", "overtaking.json"]
    found = scenario_files(folder, "**/*", [folder / "plans", folder / "broken.yaml"])
    assert list(found) == ["crossing.yaml", "headon.yaml", "overtaking.json", "sub/headon.yml"]
    assert list(scenario_files(folder, "head*")) == ["headon.yaml"]


# The table of a batch, that nothing breaks

COLUMNS = ("file", "status", "reason")


def row(file: str, status: str = "certified", reason: str = "") -> dict[str, str]:
    return {"file": file, "status": status, "reason": reason}


def test_rows_are_on_disk_at_once_and_sorted_in_the_end(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    with opened(path, COLUMNS) as table:
        table.add(row("b"))
        assert path.read_text() == "file,status,reason\nb,certified,\n"
        table.add(row("a", reason='one, "two"'))
    assert path.read_text() == 'file,status,reason\na,certified,"one, ""two"""\nb,certified,\n'
    with opened(path, COLUMNS) as table:
        assert table.rows == {"a": row("a", reason='one, "two"'), "b": row("b")}


@pytest.mark.parametrize("kept", range(1, 16))
def test_a_row_cut_short_is_taken_away_and_no_other(kept: int, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    with opened(path, COLUMNS) as table:
        table.add(row("a"))
    whole = path.read_bytes()
    path.write_bytes(whole + b'b,certified,"x"\n'[:kept])
    with opened(path, COLUMNS) as table:
        table.add(row("c"))
    there = {"a": "a,certified,\n", "b": "b,certified,x\n", "c": "c,certified,\n"}
    if kept < 16:
        del there["b"]
    assert path.read_text() == "file,status,reason\n" + "".join(there.values())


def test_a_row_that_is_done_again_takes_the_place_of_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    with opened(path, COLUMNS) as table:
        table.add(row("a", "lost"))
        table.add(row("b"))
        table.add(row("a"))
        assert path.read_text() == "file,status,reason\na,certified,\nb,certified,\n"
    assert path.read_text() == "file,status,reason\na,certified,\nb,certified,\n"


def test_a_new_table_without_rows_is_taken_away(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), opened(tmp_path / "t.csv", COLUMNS):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_an_exception_leaves_the_rows_that_are_done(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    with pytest.raises(KeyboardInterrupt), opened(path, COLUMNS) as table:
        table.add(row("b"))
        table.add(row("a"))
        raise KeyboardInterrupt
    assert path.read_text() == "file,status,reason\na,certified,\nb,certified,\n"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mine\n", "its columns are 'mine', not 'file,status,reason'"),
        ("mine", "its columns are ''"),
        ("file,status,reason\na,certified\n", "line 2 has 2 cells, not 3"),
        ('file,status,reason\na,"cert"ified,x\n', "is no table of this batch"),
    ],
)
def test_a_file_of_something_else_is_left_alone(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(TableError, match=said), opened(path, COLUMNS):
        pass
    assert path.read_text() == text


def test_two_batches_do_not_write_to_one_table(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    with opened(path, COLUMNS) as table:
        table.add(row("b"))
        table.add(row("a"))
        with pytest.raises(TableError, match="another batch is writing to it"), opened(path, COLUMNS):
            pass
    with opened(path, COLUMNS) as table:
        assert list(table.rows) == ["a", "b"]
