from __future__ import annotations

from math import inf
from time import perf_counter

import pytest

from scp_planner.online.pace import PACE, Pace


class TestPace:
    def test_expects_of_stages_what_they_took(self) -> None:
        pace = Pace()
        pace.took("problem", 0.002)
        pace.took("scp", 0.003)
        assert pace.of("problem", "scp", "search") == pytest.approx(0.005)

    def test_expects_ever_less_where_a_stage_takes_less(self) -> None:
        pace = Pace()
        for lasted in (0.1, 0.0, 0.0):
            pace.took("scp", lasted)
        assert pace.of("scp") == pytest.approx(0.1 * PACE.kept**2)

    def test_has_all_the_time_without_a_deadline(self) -> None:
        pace = Pace()
        pace.took("scp", 1e9)
        assert pace.allows(inf, "improvement", "scp")

    def test_begins_what_ends_in_time(self) -> None:
        pace = Pace()
        pace.took("scp", 100.0)
        assert pace.allows(perf_counter() + 1000.0, "improvement", "scp")
        assert not pace.allows(perf_counter() + 50.0, "improvement", "scp")

    def test_begins_what_never_has_time_once_in_a_while(self) -> None:
        """Each part has its own turn."""
        pace = Pace()
        pace.took("scp", 100.0)
        turns = [pace.allows(perf_counter(), "improvement", "scp") for _ in range(2 * PACE.starved)]
        others = [pace.allows(perf_counter(), "look", "scp") for _ in range(PACE.starved)]
        rest = [False] * (PACE.starved - 1)
        assert turns == [*rest, True, *rest, True]
        assert others == [*rest, True]
