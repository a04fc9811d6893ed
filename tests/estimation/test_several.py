"""Motions that are estimated together, against each alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from scp_planner.estimation import several
from scp_planner.estimation.estimate import estimate_obstacle
from scp_planner.estimation.motion_estimate import PolynomialEstimate
from scp_planner.estimation.motion_filter import FEW
from scp_planner.estimation.process_estimate import ProcessEstimate
from scp_planner.estimation.several import estimate_together
from scp_planner.scenario.models import Obstacle

pytestmark = pytest.mark.numerics

NOISE = {"common": [[0.02, 0.006], [0.006, 0.008]], "none": None}


def obstacle(number: int, count: int, model: Any, noise: str = "common") -> Obstacle:
    """A disc that was seen so often, at times of its own."""
    rng = np.random.default_rng(number)
    times = np.cumsum(rng.uniform(0.05, 0.4, count))
    positions = rng.normal(size=2) + times[:, None] * rng.normal(size=2) + rng.normal(0.0, 0.1, (count, 2))
    covariance: Any = NOISE.get(noise)
    if noise == "each":
        covariance = [[[size, 0.0], [0.0, 0.5 * size]] for size in rng.uniform(0.005, 0.05, count).tolist()]
    seen = {"time": times.tolist(), "position": positions.tolist(), "covariance": covariance}
    return Obstacle(id=f"o{number}", shape={"disc": 0.3}, observations=seen, model=model)


def mixed() -> list[Obstacle]:
    """Short histories of several lengths, long ones, three models, and covariances of all kinds."""
    found = [obstacle(k, 3 + 5 * k, "pedestrian", ("common", "each", "none")[k % 3]) for k in range(9)]
    found += [obstacle(10 + k, FEW + 9, "pedestrian", ("common", "each", "none")[k % 3]) for k in range(3)]
    found += [obstacle(20 + k, FEW + 20, "ship", "each") for k in range(2)]
    found += [obstacle(30 + k, 6, {"order": 1}) for k in range(3)]
    return [found[k] for k in np.random.default_rng(0).permutation(len(found))]


def assert_same(some: Sequence[Obstacle]) -> None:
    together = estimate_together(some)
    assert len(together) == len(some)
    for one, found in zip(some, together, strict=True):
        alone = estimate_obstacle(one)
        if isinstance(alone, PolynomialEstimate):
            assert isinstance(found, PolynomialEstimate)
            continue
        assert isinstance(alone, ProcessEstimate)
        assert isinstance(found, ProcessEstimate)
        assert (found.observations, found.reference_time) == (alone.observations, alone.reference_time)
        assert (found.dynamics, found.tails) == (alone.dynamics, alone.tails)
        assert found.mean == pytest.approx(alone.mean, rel=1e-9, abs=1e-9)
        deviations = np.sqrt(np.diag(alone.state_covariance))
        relative = (found.state_covariance - alone.state_covariance) / np.outer(deviations, deviations)
        assert np.abs(relative).max() < 1e-10
        assert found.noise_covariance == pytest.approx(alone.noise_covariance, rel=1e-12)


def test_many_together_are_what_each_is_alone() -> None:
    assert_same(mixed())


def test_so_they_are_in_small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(several, "AT_ONCE", 30)
    assert_same(mixed())


@pytest.mark.parametrize("model", ["pedestrian", {"order": 1}], ids=str)
def test_it_is_asked_now_and_then_whether_to_go_on(model: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(several, "AT_ONCE", 8 * FEW)

    def stop() -> None:
        raise TimeoutError

    assert len(estimate_together([obstacle(k, 4, model) for k in range(8)], stop)) == 8
    with pytest.raises(TimeoutError):
        estimate_together([obstacle(k, 4, model) for k in range(20)], stop)


def test_it_is_asked_so_in_a_long_history(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(several, "AT_ONCE", FEW)
    asked: list[None] = []
    estimate_together([obstacle(0, 4 * FEW + 1, "pedestrian")], lambda: asked.append(None))
    assert len(asked) == 3
