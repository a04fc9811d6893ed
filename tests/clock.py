"""A clock that tests move, so that no deadline in them depends on how busy the machine is; and how long they wait."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from itertools import count
from typing import Any

import pytest

import scp_planner

PATIENCE = 600.0  # s; only a test that hangs waits so long


class FakeClock:
    """A clock that goes on by one tick whenever it is looked at; it stands still with a tick of 0 s."""

    def __init__(self, tick: float = 1e-3) -> None:
        self.tick = tick
        self.looks = count()

    def __call__(self) -> float:
        return self.tick * next(self.looks)

    def rule(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Put it in the place of `perf_counter` in every module that public names need and that looks at that."""
        for name in scp_planner.__all__:
            getattr(scp_planner, name)  # which loads its module
        ruled = [
            module
            for name, module in list(sys.modules.items())
            if name.partition(".")[0] == "scp_planner" and "perf_counter" in vars(module)
        ]
        assert ruled, "nothing looks at a clock"
        for module in ruled:
            monkeypatch.setattr(module, "perf_counter", self)


def eventually(happened: Callable[[], Any], patience: float = PATIENCE) -> Any:
    """Wait until something is true, and return it."""
    until = time.monotonic() + patience
    while not (found := happened()):
        assert time.monotonic() < until, "it never happened"
        time.sleep(0.01)
    return found
