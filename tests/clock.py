"""A clock that tests move, so that no deadline in them depends on how busy the machine is."""

from __future__ import annotations

import sys
from itertools import count

import pytest

import scp_planner


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
