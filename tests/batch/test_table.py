"""The table of a batch, that nothing breaks."""

from __future__ import annotations

from pathlib import Path

import pytest

from scp_planner.batch.table import TableError, opened

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
