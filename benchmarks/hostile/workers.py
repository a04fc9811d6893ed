"""Processes that try cases, watched from outside: whatever takes too much time or memory is ended, and told."""

from __future__ import annotations

import multiprocessing
import os
import resource
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path

from benchmarks.hostile import cases
from benchmarks.hostile.cases import PLAN_TIME, Case, Kind, make
from benchmarks.hostile.outcome import Fault, Outcome

LOOK = 0.2
"""s between two looks at how workers are."""
WALL = 12.0
"""Times the limit of processor time: a worker that waits for nothing is ended after so long by the clock."""
SPARE = 4.0
"""Times the limit of memory: the address space that a worker may have, so that none takes the machine down."""
FILLED = 0.5
"""Share of the limit of memory, after which a worker is not given another case."""
_TICK = os.sysconf("SC_CLK_TCK")


def serve(link: Connection, memory: int, plan_time: float, carry_out: Callable[[Case], Outcome]) -> None:
    """Try what is asked for until nothing more is; this runs in a worker, which leads all processes that it starts."""
    os.setsid()
    resource.setrlimit(resource.RLIMIT_AS, (int(SPARE * memory), resource.RLIM_INFINITY))
    cases.carry_out(make(Kind.COMBINED, 0))  # what is loaded once is no part of any case
    link.send(None)
    while (asked := link.recv()) is not None:
        kind, seed = asked
        case = make(kind, seed, plan_time)
        link.send("made")
        try:
            outcome = carry_out(case)
        except BaseException as error:  # an exit, or an interrupt, that none of our code may raise
            outcome = Outcome("raised", Fault.DIED, repr(error))
        link.send(outcome)


class Worker:
    """One process, and what it is at."""

    def __init__(self, memory: int, plan_time: float, carry_out: Callable[[Case], Outcome]) -> None:
        context = multiprocessing.get_context("spawn")
        self.link, other = context.Pipe()
        self.process = context.Process(target=serve, args=(other, memory, plan_time, carry_out))
        self.process.start()
        other.close()
        self.job: tuple[Kind, int] | None = None
        self.ready = False
        self.began, self.used = 0.0, 0.0

    def give(self, kind: Kind, seed: int) -> None:
        """Give it a case."""
        self.job = (kind, seed)
        self._start_clock()
        self.link.send(self.job)

    def _start_clock(self) -> None:
        self.began, self.used = time.monotonic(), self.processor_time()

    def take(self) -> Outcome | None:
        """Take what it says; None if that is not yet what came of its case."""
        try:
            said = self.link.recv()
        except EOFError:
            return Outcome("died", Fault.DIED, f"exit code {self.process.exitcode}")
        if isinstance(said, Outcome):
            return said
        self.ready = True
        self._start_clock()
        return None

    def excess(self, seconds: float, memory: int) -> Outcome | None:
        """Tell if it takes too much."""
        try:
            peak = self.peak_memory()
            used, waited = self.processor_time() - self.used, time.monotonic() - self.began
        except (OSError, ValueError):
            return None  # it has just died, which its link tells
        if peak > memory:
            return Outcome("too large", Fault.MEMORY, f"{peak / 1e6:.0f} MB")
        if used > seconds or waited > WALL * seconds:
            return Outcome("too long", Fault.HANG, f"{used:.1f} s of the processor, {waited:.1f} s by the clock")
        return None

    def is_filled(self, memory: int) -> bool:
        """True if it has had so much memory that it would be in the way of the next case."""
        try:
            return self.peak_memory() > FILLED * memory
        except OSError:
            return True

    def peak_memory(self) -> int:
        """Bytes that it has had at most."""
        for line in Path(f"/proc/{self.process.pid}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
        return 0

    def processor_time(self) -> float:
        """Seconds that it has worked."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / _TICK

    def end(self) -> None:
        """End it, whatever it is at, and all that it has started."""
        self.process.kill()
        if self.process.pid is not None:
            with suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self.process.join()
        self.link.close()


def tried(
    jobs: Iterator[tuple[Kind, int]],
    workers: int,
    seconds: float,
    memory: int,
    plan_time: float = PLAN_TIME,
    carry_out: Callable[[Case], Outcome] = cases.carry_out,
) -> Iterator[tuple[Kind, int, Outcome]]:
    """Try cases in several processes.

    Parameters
    ----------
    jobs : iterator of kind and seed
        Taken as there are workers for them.
    workers : int
    seconds : float
        Of the processor, that a case may take.
    memory : int
        Bytes that a process may have.
    plan_time : float
        s that a plan may take.
    carry_out : callable
        Tries a case.

    Yields
    ------
    kind, seed, outcome
        As they come.
    """
    crew = [Worker(memory, plan_time, carry_out) for _ in range(workers)]
    try:
        while crew:
            wait([worker.link for worker in crew], LOOK)
            for worker in list(crew):
                outcome = worker.take() if worker.link.poll() else None
                if worker.job is not None and (outcome is None or outcome.fault is None):
                    outcome = worker.excess(seconds, memory) or outcome
                if outcome is not None and worker.job is None:
                    raise RuntimeError(f"a worker died before it could try anything: {outcome.detail}")
                if outcome is not None and worker.job is not None:
                    yield *worker.job, outcome
                    worker.job = None
                    # What cases before left is no part of any case
                    if outcome.fault in (Fault.DIED, Fault.HANG, Fault.MEMORY) or worker.is_filled(memory):
                        worker.end()
                        crew.remove(worker)
                        crew.append(Worker(memory, plan_time, carry_out))
                        continue
                if worker.ready and worker.job is None:
                    job = next(jobs, None)
                    if job is None:
                        worker.end()
                        crew.remove(worker)
                    else:
                        worker.give(*job)
    finally:
        for worker in crew:
            worker.end()
