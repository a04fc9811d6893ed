"""The command that plans many scenarios."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from batches import STRANGE_NAMES, rows_in
from clock import PATIENCE, eventually
from command import run

from scp_planner import builtin
from scp_planner.batch.jobs import Options, PlanningMethod
from scp_planner.settings.planning import Settings

SLOW = Options(
    PlanningMethod.PENALTY_DESCENT, Settings(path_span=2.5, acceleration_spans=8, samples=80, max_runs=1)
)  # a good part of a second for each scenario, so that there is a middle to interrupt
SLOW_OPTIONS = [option for text in str(SLOW).split()[1:] for option in ("--set", text)]


def test_the_command_tells_of_strange_names(strange: Path, tmp_path: Path) -> None:
    for path in strange.iterdir():
        path.write_text("{}")
    result = run("batch", strange, "-o", tmp_path / "t.csv", "--workers", "1")
    assert result.exit_code == 3
    assert [line for line in result.stderr.splitlines() if line.startswith(r"no\udcffUTF-8.yaml: bad_input")]
    assert len(result.stderr.splitlines()) == len(STRANGE_NAMES)


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


def children_of(process: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def workers_of(process: int) -> list[int]:
    def is_worker(child: int) -> bool:
        try:
            return b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()
        except OSError:  # it has ended meanwhile
            return False

    return [child for child in children_of(process) if is_worker(child)]


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
    # That it has died is told before another one takes its place, and before the row of whoever does its work.
    eventually(lambda: len({*workers_of(process.pid)} - {killed, spared}) == 1)
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
    # By workers too: BLAS has one thread in each of them, and may sum in another order where it has more.
    assert run("batch", many, *options[:-1], str(whole)).exit_code == 0
    assert whole.read_text().count("certified") == rows_in(whole) == 4
    assert table.read_bytes() == whole.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t.csv", "whole.csv"]
