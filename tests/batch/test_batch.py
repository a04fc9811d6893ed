"""Batches: the table that nothing breaks, executors whose workers die, and both together."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import batch_work
import pytest
import yaml
from typer.testing import CliRunner, Result

from scp_planner import builtin, files
from scp_planner.batch import dask_cluster, runner
from scp_planner.batch.dask_cluster import DaskExecutor
from scp_planner.batch.executor import Answer, ExecutorError, Fate
from scp_planner.batch.jobs import Options, PlanningMethod, TableRow
from scp_planner.batch.local import LocalExecutor
from scp_planner.batch.runner import run_batch, scenario_files
from scp_planner.batch.table import TableError, opened
from scp_planner.cli import app
from scp_planner.planning.plan import Plan
from scp_planner.settings.planning import Settings

T = TypeVar("T")
R = TypeVar("R")

COLUMNS = ("file", "status", "reason")
SLOW = Options(
    PlanningMethod.PENALTY_DESCENT, Settings(path_span=2.5, acceleration_spans=8, samples=80, max_runs=1)
)  # a good part of a second for each scenario, so that there is a middle to interrupt
SLOW_OPTIONS = [option for text in str(SLOW).split()[1:] for option in ("--set", text)]


def row(file: str, status: str = "certified", reason: str = "") -> dict[str, str]:
    return {"file": file, "status": status, "reason": reason}


PATIENCE = 600.0  # s; only a test that hangs waits so long


def eventually(happened: Callable[[], Any], patience: float = PATIENCE) -> Any:
    """Wait until something is true, and return it."""
    until = time.monotonic() + patience
    while not (found := happened()):
        assert time.monotonic() < until, "it never happened"
        time.sleep(0.01)
    return found


# the table


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


# local processes


def results_of(executor: Any, function: Callable[[T], R], items: Iterable[T]) -> dict[T, Answer[T, R]]:
    with closing(executor.run(function, items)) as answers:
        return {answer.item: answer for answer in answers}


def test_local_workers_answer_every_item() -> None:
    answers = results_of(LocalExecutor(2), batch_work.refuse_odd, range(7))
    assert {item: answer.result for item, answer in answers.items()} == dict(
        zip(range(7), [0, None, 2, None, 4, None, 6], strict=True)
    )
    assert answers[3] == Answer(3, Fate.ERROR, None, "ValueError: 3 is odd")
    assert results_of(LocalExecutor(2), batch_work.square, []) == {}


def test_local_workers_have_one_thread_and_leave_interrupts_to_us(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    assert results_of(LocalExecutor(1), batch_work.threads_and_deafness, [0])[0].result == ("1", True)


def test_what_a_dead_worker_was_at_is_done_by_another(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    items = [(number, str(tmp_path)) for number in range(8)]
    answers = results_of(LocalExecutor(2), batch_work.die_once, items)
    assert (tmp_path / "died").exists()
    assert [answers[item].result for item in items] == list(range(8))
    assert len([text for text in caplog.messages if "its work is tried again" in text]) == 1


def test_what_kills_every_worker_is_given_up_and_told(tmp_path: Path) -> None:
    answers = results_of(LocalExecutor(2), batch_work.die_at_three, range(6))
    lost = answers.pop(3)
    assert (lost.fate, lost.result) == (Fate.LOST, None)
    assert "3 workers died at it" in lost.reason and "exit code -9" in lost.reason
    assert sorted(answer.result for answer in answers.values() if answer.result is not None) == [0, 1, 2, 4, 5]


def test_items_are_taken_only_when_there_is_a_worker_for_them() -> None:
    taken: list[int] = []

    def items() -> Iterator[int]:
        for number in range(100):
            taken.append(number)
            yield number

    with closing(LocalExecutor(1).run(batch_work.square, items())) as answers:
        assert next(answers).result == 0
        assert len(taken) <= 2


def test_closing_ends_the_workers_at_once(tmp_path: Path) -> None:
    answers = LocalExecutor(1).run(batch_work.sleep_long, [str(tmp_path)])
    import threading

    worker: list[int] = []

    def interrupt() -> None:
        worker.append(int(eventually(lambda: list(tmp_path.iterdir()))[0].name))
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt), closing(answers):
        next(answers)
    assert time.monotonic() - began < batch_work.LONG
    with pytest.raises(ProcessLookupError):
        os.kill(worker[0], 0)


# batches, with an executor that does the work here and now


@dataclass
class Here:
    """Does all items in this process, the last first, and notes them."""

    fate: Fate = Fate.DONE
    done: list[str] = field(default_factory=list)
    most: int = 1000

    def run(self, function: Callable[[T], R], items: Iterable[T]) -> Generator[Answer[T, R], None, None]:
        for item in list(items)[::-1]:
            if len(self.done) >= self.most:
                raise KeyboardInterrupt
            self.done.append(getattr(item, "file", ""))
            if self.fate is Fate.DONE:
                yield Answer(item, Fate.DONE, function(item))
            else:
                yield Answer(item, self.fate, None, "a reason,\nof two lines")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Four scenarios, one of them no good."""
    target = tmp_path / "scenarios"
    target.mkdir()
    for name in ("crossing", "headon"):
        builtin.load(name).save(target / f"{name}.yaml")
    builtin.load("overtaking").save(target / "overtaking.json")
    (target / "broken.yaml").write_text("schema: 1\nspeed: 3\n")
    (target / "notes.txt").write_text("no scenario")
    return target


def test_a_batch_has_a_row_for_each_scenario(folder: Path, tmp_path: Path) -> None:
    table, plans, heard = tmp_path / "t.csv", tmp_path / "plans", []
    executor = Here()
    files = scenario_files(folder)
    result = run_batch(files, table, executor, plans=plans, progress=lambda done, status: heard.append((done, status)))
    assert executor.done == ["overtaking.json", "headon.yaml", "crossing.yaml"]
    assert heard == [(1, "bad_input"), *((done, "certified") for done in (2, 3, 4))]
    assert (result.counts, result.done_before, result.all_certified) == ({"certified": 3, "bad_input": 1}, 0, False)
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


STRANGE_NAMES = (
    b"two  blanks.yaml",
    b" before.yaml",
    b"a new\nline.yaml",
    b"a new\\nline.yaml",
    b"no\xffUTF-8.yaml",
    b"no\\udcffUTF-8.yaml",
    "gr\u00f6\u00dfe\u2028.yaml".encode(),
    b'"quoted", and more.yaml',
)


@pytest.fixture
def strange(folder: Path) -> Path:
    """A folder of scenarios whose files have names that few would give."""
    text = (folder / "crossing.yaml").read_bytes()
    shutil.rmtree(folder)
    folder.mkdir()
    try:
        for name in STRANGE_NAMES:
            (folder / os.fsdecode(name)).write_bytes(text)
    except OSError:
        pytest.skip("a file system that takes no such names")
    return folder


def test_strange_names_of_files_are_planned_and_found_again(strange: Path, tmp_path: Path) -> None:
    files = scenario_files(strange)
    result = run_batch(files, tmp_path / "t.csv", Here(), plans=tmp_path / "plans")
    assert result.all_certified and result.done_before == 0
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


def test_the_command_tells_of_strange_names(strange: Path, tmp_path: Path) -> None:
    for path in strange.iterdir():
        path.write_text("{}")
    result = run("batch", strange, "-o", tmp_path / "t.csv", "--workers", "1")
    assert result.exit_code == 3
    assert [line for line in result.stderr.splitlines() if line.startswith(r"no\udcffUTF-8.yaml: bad_input")]
    assert len(result.stderr.splitlines()) == len(STRANGE_NAMES)


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


def test_a_folder_with_too_much_in_it_is_not_looked_through(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "sub").mkdir()
    monkeypatch.setattr(files, "MOST_ENTRIES", len(list(folder.rglob("*"))))
    assert len(scenario_files(folder, "**/*")) == 4
    (folder / "sub" / "one_more.txt").touch()
    with pytest.raises(ValueError, match=r"pattern '\*\*/\*': .* holds over [0-9]+ files, with those in its folders"):
        scenario_files(folder, "**/*")
    assert len(scenario_files(folder)) == 4  # of the folder alone


# the command


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_command_tells_counts_and_what_is_not_certified(folder: Path, tmp_path: Path) -> None:
    began = time.monotonic()
    result = run("batch", folder, "-o", tmp_path / "t.csv", "--workers", "1", "--timings", "--json")
    lasted = time.monotonic() - began
    assert result.exit_code == 3
    assert json.loads(result.stdout) == {
        "scenarios": 4,
        "certified": 3,
        "bad_input": 1,
        "done_before": 0,
        "results": str(tmp_path / "t.csv"),
    }
    assert result.stderr.startswith("broken.yaml: bad_input: vehicle: missing")
    times = [line.rsplit(",", 1)[1] for line in (tmp_path / "t.csv").read_text().splitlines()]
    assert times[:2] == ["wall_time", ""]
    taken = [float(text) for text in times[2:]]
    assert min(taken) > 0.0 and sum(taken) < lasted
    (folder / "broken.yaml").unlink()
    good = run("batch", folder, "-o", tmp_path / "t.csv", "--timings", "--quiet")
    assert (good.exit_code, good.output) == (0, "")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--workers", "0"], "0: must be at least 1"),
        (["--workers", "2", "--dask", "tcp://127.0.0.1:1"], "not with --dask"),
        (["--pattern", "*.yml"], "holds no scenario files like *.yml"),
        *((["--pattern", odd], "must be of paths within") for odd in ("/", "/x/*", "**x", "../*", ".", "./")),
        (["--set", "path_spam=2"], "did you mean 'path_span'?"),
        (["--solver", "gurobi"], "gurobi"),
        (["--dask", "nowhere"], "Dask"),
        (["-o", "no/such/t.csv"], "must exist"),
        (["--plans", "scenarios/headon.yaml"], "must be a folder"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_options_are_refused_and_nothing_is_written(
    options: list[str], said: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("batch", "scenarios", *options)
    assert (result.exit_code, result.stdout) == (2, "")
    assert said in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["scenarios"]
    assert run("batch", "nowhere").exit_code == 2


def children_of(process: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def workers_of(process: int) -> list[int]:
    def is_worker(child: int) -> bool:
        return b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()

    return [child for child in children_of(process) if is_worker(child)]


def rows_in(table: Path) -> int:
    return len(table.read_text().splitlines()) - 1 if table.exists() else 0


needs_proc = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc to find workers")


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scenarios that keep two workers busy for a while."""
    target = tmp_path_factory.mktemp("many")
    for number in range(4):
        builtin.load("headon").save(target / f"headon-{number}.json")
    return target


@needs_proc
def test_interrupt_and_a_killed_worker_change_nothing_in_the_end(many: Path, tmp_path: Path) -> None:
    """First a worker is killed, then the batch is interrupted; the same command ends it, as in one go elsewhere."""
    table, whole = tmp_path / "t.csv", tmp_path / "whole.csv"
    options = ["--method", SLOW.method, *SLOW_OPTIONS, "--workers", "2", "-o", str(table)]
    command = [sys.executable, "-m", "scp_planner", "batch", str(many), *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    eventually(lambda: rows_in(table) >= 1)
    killed, spared = workers_of(process.pid)
    os.kill(killed, signal.SIGKILL)
    eventually(lambda: rows_in(table) >= 2)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=PATIENCE)
    done = rows_in(table)
    assert (process.returncode, output) == (130, "")
    assert f"worker {killed} died with exit code -9; its work is tried again" in errors
    assert f"interrupted: {done} of 4 rows are in {table}; the same command goes on from there" in errors
    assert "Traceback" not in errors
    assert 2 <= done < 4
    assert not Path(f"/proc/{spared}").exists()
    ended = run("batch", many, *options, "--json")
    assert ended.exit_code == 0, ended.output
    assert json.loads(ended.stdout)["done_before"] == done
    assert run_batch(scenario_files(many), whole, Here(), SLOW).all_certified
    assert table.read_bytes() == whole.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t.csv", "whole.csv"]


# a Dask cluster


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two worker processes under nannies, as on a real cluster."""
    import dask
    from distributed import LocalCluster

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0") as own,  # type: ignore[no-untyped-call]
    ):
        yield own


def test_dask_workers_answer_every_item(cluster: Any) -> None:
    with closing(DaskExecutor(cluster.scheduler_address)) as executor:
        answers = results_of(executor, batch_work.refuse_odd, range(70))
    assert [answers[item].result for item in range(70)] == [None if item % 2 else item for item in range(70)]
    assert answers[3] == Answer(3, Fate.ERROR, None, "ValueError: 3 is odd")


def test_a_scheduler_that_does_not_answer_is_named(cluster: Any) -> None:
    with pytest.raises(ExecutorError, match="no Dask scheduler answers at nowhere: "):
        DaskExecutor("nowhere")
    with pytest.raises(ExecutorError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:1: "):
        DaskExecutor("tcp://127.0.0.1:1", connect_time=0.2)


@pytest.mark.parametrize("address", ["nowhere", "tcp://127.0.0.1", "carrier-pigeon://127.0.0.1:8786"])
def test_what_is_no_address_is_refused_before_a_client_is_made(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed", reason="needs dask.distributed, which is not installed")
    monkeypatch.setattr(distributed, "Client", None)  # one without a scheduler says so on stderr when it is collected
    with pytest.raises(ExecutorError, match=f"no Dask scheduler answers at {address}: "):
        DaskExecutor(address)


def test_a_scheduler_that_goes_away_is_told_and_the_rows_are_kept(
    cluster: Any, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from distributed import LocalCluster

    take = runner._Batch.take
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0") as other:  # type: ignore[no-untyped-call]

        def take_and_go(batch: Any, answer: Any) -> None:
            take(batch, answer)
            other.close()

        monkeypatch.setattr(runner._Batch, "take", take_and_go)
        result = run("batch", folder, "--dask", other.scheduler_address, "-o", tmp_path / "t.csv")
    assert (result.exit_code, result.stdout) == (4, "")
    assert "has gone: 2 of 4 rows are in" in result.stderr
    assert rows_in(tmp_path / "t.csv") == 2


def test_a_cluster_that_goes_before_the_first_row_is_no_bad_input(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def go(*_: object) -> Generator[Any, None, None]:
        raise ExecutorError("all workers have gone")
        yield  # type: ignore[unreachable]  # makes it a generator

    monkeypatch.setattr(LocalExecutor, "run", go)
    result = run("batch", folder, "-o", tmp_path / "t.csv")
    assert (result.exit_code, result.stdout) == (4, "")
    assert result.stderr.startswith("all workers have gone: 0 of 4 rows are in")
    assert not (tmp_path / "t.csv").exists()


def test_a_batch_on_dask_is_the_same_as_here(cluster: Any, folder: Path, tmp_path: Path) -> None:
    result = run("batch", folder, "--dask", cluster.scheduler_address, "-o", tmp_path / "dask.csv", "-q")
    assert result.exit_code == 3, result.output
    run_batch(scenario_files(folder), tmp_path / "here.csv", Here())
    assert (tmp_path / "dask.csv").read_bytes() == (tmp_path / "here.csv").read_bytes()


def test_a_cluster_without_workers_is_not_waited_for_for_ever(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import LocalCluster

    monkeypatch.setattr(dask_cluster, "LOOK_TIME", 0.05)
    with LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as empty:  # type: ignore[no-untyped-call]
        with closing(DaskExecutor(empty.scheduler_address, patience=0.2)) as executor:
            with pytest.raises(ExecutorError, match="has had no workers for"):
                results_of(executor, batch_work.square, range(3))


def test_dask_that_is_not_installed_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ExecutorError, match=r"pip install 'scp-planner\[dask\]'"):
        DaskExecutor("tcp://127.0.0.1:1")


def test_a_dask_worker_that_is_killed_takes_only_what_kills_every_worker(cluster: Any, tmp_path: Path) -> None:
    """What it had been given beside that is done by others."""
    items = [(number, str(tmp_path)) for number in range(12)]
    with closing(DaskExecutor(cluster.scheduler_address)) as executor:
        answers = results_of(executor, batch_work.tell_and_die_at_three, items)
    lost = answers.pop(items[3])
    assert (lost.fate, lost.reason) == (Fate.LOST, "1 worker died at it")
    assert {number: answer.result for (number, _), answer in answers.items()} == {n: n for n in range(12) if n != 3}
    tried = {int(path.name.split("-")[1]) for path in tmp_path.glob("3-*")}
    assert len(tried) >= 2, "it is tried again, alone"
