"""What planning takes is known before it is taken, and what is too much is refused at once."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.errors import TooLargeError
from scp_planner.planning import attempts, offline
from scp_planner.problem import memory
from scp_planner.problem.build import build_problem
from scp_planner.problem.memory import MOST_BYTES, check_memory, check_obstacles, plan_bytes
from scp_planner.scenario.models import Scenario
from scp_planner.search import blocked
from scp_planner.search.ways import WaySearch
from scp_planner.settings.planning import Settings

MEGABYTE = 1_000_000
QUICK: dict[str, Any] = {"max_runs": 1, "max_iterations": 2, "searches": 1}


def seen(count: int) -> list[dict[str, Any]]:
    """Obstacles that were seen through noise, all over the trip."""
    rng = np.random.default_rng(count)
    times = np.linspace(-1.0, 0.0, 5)
    found = []
    for k in range(count):
        place, velocity = rng.uniform((3.0, -5.0), (19.0, 5.0)), rng.uniform(-0.3, 0.3, 2)
        positions = place + times[:, None] * velocity + 0.01 * rng.normal(size=(5, 2))
        observations = {
            "time": times.tolist(),
            "position": positions.tolist(),
            "covariance": [[1e-4, 0.0], [0.0, 1e-4]],
        }
        found.append(
            {"id": f"o{k}", "shape": {"disc": 0.02}, "observations": observations, "model": {"order": 1}},
        )
    return found


def peak_of_a_plan(scenario: Scenario, settings: Settings) -> int:
    sp.plan(scene(*seen(1)), Settings(**QUICK))  # what is loaded once is no part of it
    tracemalloc.start()
    try:
        sp.plan(scenario, settings)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("spans", "samples", "count"), [(160, 30, 1), (12, 800, 10)])
def test_a_plan_takes_no_more_than_was_estimated_and_not_much_less(spans: int, samples: int, count: int) -> None:
    settings = Settings(path_span=20.0 / spans, max_path_spans=200, samples=samples, acceleration_spans=10, **QUICK)
    estimate = plan_bytes(spans, 12, samples, count)
    peak = peak_of_a_plan(scene(*seen(count)), settings)
    search = 25 * MEGABYTE  # which has limits of its own
    assert 0.15 * estimate < peak < estimate + search


def test_too_many_obstacles_are_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "MOST_BYTES", 2 * MEGABYTE)
    scenario = scene(*seen(60))
    with pytest.raises(TooLargeError, match=r"obstacles: 60 of them .* at 160 samples .* MB .* fewer samples"):
        sp.plan(scenario)
    far = [disc(f"far{k}", (10.0, 1e4 + k), radius=0.1) for k in range(60)]
    assert sp.plan(scene(*far)).certified  # those that are never met take nothing


def test_too_many_spans_are_refused_before_their_tables_are_made() -> None:
    tracemalloc.start()
    try:
        with pytest.raises(TooLargeError, match=r"path: 5000 spans .* larger path_span"):
            build_problem(scene(), (), Settings(), spans=5000)
        assert tracemalloc.get_traced_memory()[1] < 5 * MEGABYTE
    finally:
        tracemalloc.stop()


def test_what_needs_least_is_never_refused() -> None:
    check_memory(13, 24, 160, 300)
    check_memory(200, 200, 160, 10)
    assert plan_bytes(13, 24, 160, 300) < 0.1 * MOST_BYTES
    assert attempts.ReadyProblem.of(build_problem(scene(), (), Settings())).near.zones.size == 0


def test_cells_that_zones_block_do_not_depend_on_how_many_are_marked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = scene(disc("small", (8.0, 0.2), radius=0.3), disc("wide", (14.0, 1.0), (0.0, -0.4), radius=3.0))
    problem = build_problem(scenario, sp.zones(scenario), Settings())
    whole = WaySearch(problem)
    expected = blocked.Cells(problem, whole.grid).free
    monkeypatch.setattr(blocked, "CHUNKS", blocked.Chunks(most_marked=50))
    again = blocked.Cells(problem, whole.grid).free
    assert np.array_equal(expected, again)


def test_more_obstacles_than_can_be_made_ready_are_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two hundred thousand took 1.5 GB before what may be met of them was counted."""
    check_obstacles(80_000)
    with pytest.raises(TooLargeError, match=r"obstacles: 200000 of them would take 800 MB .* at most 83750"):
        check_obstacles(200_000)
    monkeypatch.setattr(memory, "_OBSTACLE_BYTES", MOST_BYTES)
    monkeypatch.setattr(offline, "ZonesOf", None)  # which is not come to
    with pytest.raises(TooLargeError, match="obstacles: 2 of them"):
        sp.plan(scene(disc("one", (5.0, 1.0)), disc("other", (9.0, 1.0))))
