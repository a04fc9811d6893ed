"""Coroutines: they go on where they were suspended, and end with their owners."""

from __future__ import annotations

import math
import os
import signal
import threading
from time import perf_counter

import pytest
from replanning import begun_since, threads, threads_end

from scp_planner.pauses import Coroutine, pause


def test_work_goes_on_where_it_was_left() -> None:
    done = list[int]()

    def count() -> int:
        for number in range(4):
            done.append(number)
            pause()
        return sum(done)

    work = Coroutine(count)
    for turn in range(4):
        assert not work.resume(-math.inf)
        assert done == list(range(turn + 1))
    assert work.resume(-math.inf) and work.result == 6
    assert Coroutine(count).resume(math.inf), "all of it where there is time"
    pause()  # elsewhere, nothing waits


def test_an_error_reaches_who_asked() -> None:
    begun = list[int]()

    def fail_at_first() -> int:
        begun.append(len(begun))
        return 1 // begun[-1]

    before = threads()
    work = Coroutine(fail_at_first)
    with pytest.raises(ZeroDivisionError):
        work.resume(perf_counter())
    assert work.resume(perf_counter()) and work.result == 1, "it is not waited for again, but begins anew"
    assert work.resume(perf_counter()), "what is done is not waited for, either"
    assert threads_end(before)


def test_work_that_nobody_wants_ends() -> None:
    left = list[bool]()

    def endless() -> None:
        try:
            while True:
                pause()
        finally:
            left.append(True)

    before = threads()
    work = Coroutine(endless)
    assert not work.resume(perf_counter()) and len(begun_since(before)) == 1
    del work
    assert threads_end(before) and left == [True]


def test_an_interrupt_ends_the_work_and_it_begins_anew() -> None:
    left, begun = threading.Event(), threading.Event()

    def endless_at_first() -> str:
        if begun.is_set():
            return "anew"
        try:
            while True:
                begun.set()
                pause()
        finally:
            left.set()

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    def later() -> None:
        begun.wait(10.0)
        os.kill(os.getpid(), signal.SIGINT)

    work = Coroutine(endless_at_first)
    before = signal.signal(signal.SIGINT, interrupt)
    try:
        threading.Thread(target=later).start()
        with pytest.raises(KeyboardInterrupt):
            work.resume(math.inf)
    finally:
        signal.signal(signal.SIGINT, before)
    assert left.wait(10.0) and work.resume(math.inf) and work.result == "anew"
