"""Targets of writing: only regular files, through links, whole or not at all."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from command import run

from scp_planner.batch.local import LocalExecutor
from scp_planner.batch.runner import run_batch, scenario_files
from scp_planner.batch.table import opened
from scp_planner.files import write_text
from scp_planner.studies.consistency import ResultFile

needs_posix = pytest.mark.skipif(os.name != "posix", reason="pipes and devices that have names")
KINDS = ("a folder", "a device", "a pipe", "a socket")


@pytest.fixture
def special(tmp_path: Path) -> Iterator[dict[str, Path]]:
    """Give what is no regular file, by what messages call it; a terminal of our own is the device."""
    places = {kind: tmp_path / f"{kind.split()[-1]}.json" for kind in KINDS}
    places["a folder"].mkdir()
    os.mkfifo(places["a pipe"])
    controller, terminal = os.openpty()
    places["a device"] = Path(os.ttyname(terminal))
    listener = socket.socket(socket.AF_UNIX)
    here = os.getcwd()
    os.chdir(tmp_path)  # names of sockets are short
    try:
        listener.bind(places["a socket"].name)
    finally:
        os.chdir(here)
    yield places
    listener.close()
    os.close(controller)
    os.close(terminal)


@pytest.fixture
def easy(scenario_data: dict[str, Any], tmp_path: Path) -> Path:
    """A folder with a scenario without obstacles."""
    folder = tmp_path / "scenarios"
    folder.mkdir()
    data = scenario_data | {"guide": None, "bounds": None, "obstacles": []}
    (folder / "easy.yaml").write_text(yaml.safe_dump(data))
    return folder


def kind_of(path: Path) -> int:
    return os.stat(path).st_mode


def never(*_: object, **__: object) -> None:
    raise AssertionError("work was done for what cannot be written")


@needs_posix
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("is_linked", [False, True])
def test_only_regular_files_are_written(special: dict[str, Path], kind: str, is_linked: bool, tmp_path: Path) -> None:
    place = special[kind]
    before = kind_of(place)
    target = place
    if is_linked:
        (target := tmp_path / "link.json").symlink_to(place)
    with pytest.raises(OSError, match=f"must not be {kind}") as caught:
        write_text(target, "text")
    assert caught.value.filename == str(target)
    assert kind_of(place) == before
    assert target.is_symlink() == is_linked


def test_a_link_stays_a_link_and_its_file_is_written(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    file, link, second = tmp_path / "there" / "file.json", tmp_path / "link.json", tmp_path / "second.json"
    link.symlink_to(Path("there") / "file.json")
    second.symlink_to(link)
    for text in ("made", "replaced"):  # first the link is to what is not there yet
        write_text(second, text)
        assert second.is_symlink() and link.is_symlink() and not file.is_symlink()
        assert file.read_text() == text
    assert [path.name for path in file.parent.iterdir()] == ["file.json"]


@needs_posix
def test_a_link_to_what_has_no_name_is_told_by_its_kind(tmp_path: Path) -> None:
    if not os.path.isdir("/dev/fd"):
        pytest.skip("no names of what is open")
    read, write = os.pipe()
    try:
        (link := tmp_path / "link.json").symlink_to(f"/dev/fd/{write}")
        with pytest.raises(OSError, match="a pipe"):
            write_text(link, "text")
    finally:
        os.close(read)
        os.close(write)


def test_links_in_a_circle_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(OSError, match="symbolic links"):
        write_text(tmp_path / "a", "text")
    assert (tmp_path / "a").is_symlink()


def test_the_longest_names_can_be_written(tmp_path: Path) -> None:
    longest = os.pathconf(tmp_path, "PC_NAME_MAX") if hasattr(os, "pathconf") else 255
    for name in ("n" * longest, "ö" * ((longest - 5) // 2) + ".json", "n." + "s" * (longest - 2)):
        write_text(tmp_path / name, "text")
        assert (tmp_path / name).read_text() == "text"


@needs_posix
@pytest.mark.parametrize("kind", KINDS[:3])
@pytest.mark.parametrize(
    "arguments",
    [
        ["plan", "builtin:crossing", "-o", "{}"],
        ["simulate", "builtin:crossing", "-o", "{}"],
        ["compare", "builtin:crossing", "-o", "{}"],
        ["batch", "scenarios", "-o", "{}"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_commands_refuse_before_they_work(
    arguments: list[str], kind: str, special: dict[str, Path], easy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(easy.parent)
    before = kind_of(special[kind])
    done = run(*(argument.format(special[kind]) for argument in arguments), "--verbose")
    said = done.stderr
    assert done.exit_code == 2 and "DEBUG" not in said, "nothing is done before"
    assert "--output" in said and str(special[kind]) in said and kind in said
    assert kind_of(special[kind]) == before


@needs_posix
def test_files_in_a_folder_are_looked_at_before_the_work(tmp_path: Path) -> None:
    for arguments, file in (
        (["demo", "crossing"], "run.gif"),
        (["study", "coverage"], "coverage.csv"),
        (["study", "consistency"], "results.jsonl"),
    ):
        folder = tmp_path / arguments[-1]
        folder.mkdir()
        os.mkfifo(folder / file)
        done = run(*arguments, "-o", folder, "--verbose")
        said = done.stderr
        assert done.exit_code == 2 and "DEBUG" not in said and f"{folder / file}: must not be a pipe" in said
        assert [path.name for path in folder.iterdir()] == [file]


@needs_posix
def test_a_batch_writes_tables_and_plans_to_regular_files_only(easy: Path, tmp_path: Path) -> None:
    files, table = scenario_files(easy), tmp_path / "results.csv"
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(OSError, match="a pipe"), opened(tmp_path / "pipe.csv", ("file",)):
        never()
    (tmp_path / "plans").mkdir()
    os.mkfifo(tmp_path / "plans" / "easy.yaml.plan.json")
    with pytest.raises(OSError, match="a pipe"):
        run_batch(files, table, LocalExecutor(1), plans=tmp_path / "plans", progress=never)
    assert not table.exists()
    table.symlink_to(tmp_path / "real.csv")
    with opened(table, ("file", "status")) as rows:
        rows.add({"file": "easy.yaml", "status": "certified"})
    assert table.is_symlink()
    assert (tmp_path / "real.csv").read_text() == "file,status\neasy.yaml,certified\n"


@needs_posix
def test_a_study_goes_on_in_regular_files_only(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "results.jsonl")
    with pytest.raises(OSError, match="a pipe"):
        ResultFile(tmp_path / "results.jsonl", "fingerprint")
