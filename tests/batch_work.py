"""Work for the workers of tests of executors, in a module that loads nothing else."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

LONG = 3600.0  # s; nothing but an end by force is over sooner


def square(number: int) -> int:
    return number * number


def refuse_odd(number: int) -> int:
    if number % 2:
        raise ValueError(f"{number} is odd")
    return number


def threads_and_deafness(_: int) -> tuple[str, bool]:
    return os.environ["OMP_NUM_THREADS"], signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def die_once(item: tuple[int, str]) -> int:
    """Die at the number 3 unless that has happened before."""
    number, folder = item
    marker = Path(folder) / "died"
    if number == 3 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die_at_three(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def tell_and_die_at_three(item: tuple[int, str]) -> int:
    """Write down which process is at it, take a moment, and die at the number 3."""
    number, folder = item
    (Path(folder) / f"{number}-{os.getpid()}").touch()
    time.sleep(0.1)
    return die_at_three(number)


def sleep_long(folder: str) -> None:
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(LONG)
