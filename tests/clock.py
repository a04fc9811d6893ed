"""A clock that tests move, so that no deadline in them depends on how busy the machine is; and how long they wait."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from importlib import import_module
from itertools import count
from pathlib import Path
from types import ModuleType
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
        """Put it in the place of `perf_counter` in every module that looks at that, loaded so far or not."""
        for module in _that_look_at_a_clock():
            monkeypatch.setattr(module, "perf_counter", self)


@cache
def _that_look_at_a_clock() -> tuple[ModuleType, ...]:
    root = Path(scp_planner.__file__).parent
    files = [path for path in sorted(root.rglob("*.py")) if "import perf_counter" in path.read_text(encoding="utf-8")]
    assert files, "nothing looks at a clock"
    names = [".".join(path.relative_to(root.parent).with_suffix("").parts) for path in files]
    return tuple(import_module(name.removesuffix(".__init__")) for name in names)


def eventually(happened: Callable[[], Any], patience: float = PATIENCE) -> Any:
    """Wait until something is true, and return it."""
    until = time.monotonic() + patience
    while not (found := happened()):
        assert time.monotonic() < until, "it never happened"
        time.sleep(0.01)
    return found
