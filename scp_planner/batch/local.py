"""Processes of this machine."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import connection, resource_tracker
from typing import Any, TypeVar

from scp_planner.batch.executor import Answer, ExecutorError, Fate

T = TypeVar("T")
R = TypeVar("R")
logger = logging.getLogger(__name__)

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Set to 1 in workers unless they are set already: there is a worker for each core."""

_READY = "ready"


class LocalExecutor:
    """Worker processes on this machine."""

    def __init__(self, workers: int | None = None, attempts: int = 3) -> None:
        self.workers = workers or os.cpu_count() or 1
        self.attempts = attempts

    def run(self, function: Callable[[T], R], items: Iterable[T]) -> Generator[Answer[T, R], None, None]:
        """Call a function for every item; see `Executor`."""
        waiting = iter(items)
        again: deque[tuple[T, int]] = deque()
        workers: list[_Worker] = []
        try:
            while True:
                self._hand_out(function, waiting, again, workers)
                busy = {worker.pipe: worker for worker in workers if not worker.idle}
                if not busy:
                    return
                ready = [busy[pipe] for pipe in connection.wait(list(busy))]  # type: ignore[index]
                answers: list[Answer[T, R] | None] = [self._answer_of(worker, workers, again) for worker in ready]
                yield from (answer for answer in answers if answer is not None)
        finally:
            for worker in workers:
                worker.end()

    def _hand_out(
        self, function: Callable[[T], R], waiting: Iterator[T], again: deque[tuple[T, int]], workers: list[_Worker]
    ) -> None:
        """Give every worker that has nothing to do an item, those of dead workers first."""
        while len(workers) < self.workers or any(worker.idle for worker in workers):
            task = again.popleft() if again else next(((item, 1) for item in waiting), None)
            if task is None:
                return
            worker = next((each for each in workers if each.idle), None)
            if worker is None:
                worker = _Worker()
                workers.append(worker)  # before it starts: an interrupt must find it here to end it
                worker.start()
            worker.give(function, task)

    def _answer_of(self, worker: _Worker, workers: list[_Worker], again: deque[tuple[T, int]]) -> Answer[T, R] | None:
        """Answer of a worker; None if it is only alive, or has died at an item that is tried again."""
        item, attempt = worker.task
        try:
            return worker.answer()
        except _WorkerDied as death:
            workers.remove(worker)
            self._check_start(worker, attempt)
            if attempt < self.attempts:
                logger.warning("%s; its work is tried again", death)
                again.append((item, attempt + 1))
                return None
            return Answer(item, Fate.LOST, None, f"{self.attempts} workers died at it; the last: {death}")

    def _check_start(self, worker: _Worker, attempt: int) -> None:
        if not worker.started and attempt >= self.attempts:
            raise ExecutorError(
                "worker processes die before they begin: what starts this batch may lack "
                'if __name__ == "__main__": around its own work'
            )


class _WorkerDied(Exception):
    """The process at the other end of the pipe is gone."""


class _Worker:
    """A process, what it is at, and the pipe to it."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, self._theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(self._theirs,), daemon=True)
        self.task: Any = None
        self.started = False

    def start(self) -> None:
        """Start the process."""
        with _interrupts_held():
            self.process.start()
            self._theirs.close()  # or this process would not hear of the other's end

    @property
    def idle(self) -> bool:
        return self.task is None

    def give(self, function: Callable[..., Any], task: tuple[Any, int]) -> None:
        """Hand over an item; that the worker is dead shows when its answer is asked for."""
        self.task = task
        with suppress(BrokenPipeError, ConnectionResetError):
            self.pipe.send((function, task[0]))

    def answer(self) -> Answer[Any, Any] | None:
        """Take what has come; None if it is only the word that the worker has started."""
        item = self.task[0]
        try:
            message = self.pipe.recv()
        except (EOFError, ConnectionResetError):
            self.end()
            raise _WorkerDied(f"worker {self.process.pid} died with exit code {self.process.exitcode}") from None
        if message == _READY:
            self.started = True
            return None
        self.task = None
        done, value = message
        return Answer(item, Fate.DONE, value) if done else Answer(item, Fate.ERROR, None, value)

    def end(self) -> None:
        """End the process, whatever it is at."""
        self.pipe.close()
        if self.process.pid is None:
            return
        if not (self.idle and self.started):
            self.process.kill()
        self.process.join()


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Start a process as a whole, and deaf to interrupts of the terminal, which go to all of its processes."""
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        yield
        return
    resource_tracker.ensure_running()  # its start would undo the mask
    came: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # which the new process inherits
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)


def _serve(pipe: connection.Connection) -> None:
    """Work until the other end of the pipe closes, also by the death of its process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        pipe.send(_READY)
        while True:
            function, item = pipe.recv()
            pipe.send(_called(function, item))


def _called(function: Callable[[Any], Any], item: Any) -> tuple[bool, Any]:
    try:
        return True, function(item)
    except Exception as error:
        return False, f"{type(error).__name__}: {error}"
