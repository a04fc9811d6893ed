"""The executor of processes on this machine, whose workers die."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import batch_work
import pytest
from batches import results_of
from clock import eventually

from scp_planner.batch.executor import Answer, Fate
from scp_planner.batch.local import LocalExecutor


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
