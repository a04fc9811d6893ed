"""The executor of workers on a Dask cluster."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import batch_work
import pytest
from batches import Here, results_of, rows_in
from command import run

from scp_planner.batch.dask_cluster import DaskExecutor
from scp_planner.batch.executor import Answer, ExecutorError, Fate
from scp_planner.batch.runner import run_batch, scenario_files


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
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(ExecutorError, match=f"no Dask scheduler answers at {address}: "):
        DaskExecutor(address)


def test_a_scheduler_that_goes_away_is_told_and_the_rows_are_kept(cluster: Any, folder: Path, tmp_path: Path) -> None:
    from distributed import LocalCluster

    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0") as other:  # type: ignore[no-untyped-call]
        executor = DaskExecutor(other.scheduler_address)

        def go(done: int, _: str) -> None:
            if done == 2:
                other.close()

        with pytest.raises(ExecutorError, match="has gone"), closing(executor):
            run_batch(scenario_files(folder), tmp_path / "t.csv", executor, progress=go)
    assert rows_in(tmp_path / "t.csv") == 2


def test_a_batch_on_dask_is_the_same_as_here(cluster: Any, folder: Path, tmp_path: Path) -> None:
    result = run("batch", folder, "--dask", cluster.scheduler_address, "-o", tmp_path / "dask.csv", "-q")
    assert result.exit_code == 3, result.output
    run_batch(scenario_files(folder), tmp_path / "here.csv", Here())
    assert (tmp_path / "dask.csv").read_bytes() == (tmp_path / "here.csv").read_bytes()


def test_a_cluster_without_workers_is_not_waited_for_for_ever(cluster: Any) -> None:
    from distributed import LocalCluster

    with LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as empty:  # type: ignore[no-untyped-call]
        with closing(DaskExecutor(empty.scheduler_address, patience=0.2)) as executor:
            with pytest.raises(ExecutorError, match="has had no workers for"):
                results_of(executor, batch_work.square, range(3))


def test_dask_that_is_not_installed_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ExecutorError, match=r"pip install 'scp-planner\[dask\]'"):
        DaskExecutor("tcp://127.0.0.1:1")


def test_a_dask_worker_that_is_killed_takes_only_what_kills_every_worker(cluster: Any, tmp_path: Path) -> None:
    """Other workers do the rest of its work."""
    items = [(number, str(tmp_path)) for number in range(12)]
    with closing(DaskExecutor(cluster.scheduler_address)) as executor:
        answers = results_of(executor, batch_work.tell_and_die_at_three, items)
    lost = answers.pop(items[3])
    assert (lost.fate, lost.reason) == (Fate.LOST, "1 worker died at it")
    assert {number: answer.result for (number, _), answer in answers.items()} == {n: n for n in range(12) if n != 3}
    tried = {int(path.name.split("-")[1]) for path in tmp_path.glob("3-*")}
    assert len(tried) >= 2, "it is tried again, alone"
