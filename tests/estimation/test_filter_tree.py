"""Many observations put together at once, against the filter that takes them one after the other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scp_planner.estimation import filter_tree
from scp_planner.estimation.motion_filter import FEW, MotionFilter, estimate_process
from scp_planner.scenario.process_model import ProcessModel

KINDS: list[dict[str, Any]] = [
    {"kind": "random_walk", "diffusion": 0.1},
    {"kind": "mean_reverting", "diffusion": 0.3, "time_constant": 2.0},
    {"kind": "singer", "deviation": 0.5, "time_constant": 2.0},
    {"kind": "random_walk_acceleration", "diffusion": 0.1, "acceleration_deviation": 0.5},
]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: str(kind["kind"]))
@pytest.mark.parametrize("at_once", [40, 4096])
def test_is_the_filter_but_for_rounding(kind: dict[str, Any], at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(filter_tree, "MOST_AT_ONCE", at_once)
    rng, count = np.random.default_rng(0), FEW + 13
    model = ProcessModel.model_validate({"process": kind, "velocity_deviation": 1.0, "noise_deviation": 0.1})
    times = np.sort(rng.uniform(0.0, 5.0, count))
    times[7] = times[8]  # two at one time
    positions = 0.3 * rng.normal(size=(count, 2)).cumsum(axis=0)
    spread = rng.normal(0.0, 0.1, (count, 2, 2))
    noise = spread @ np.swapaxes(spread, 1, 2) + 1e-3 * np.eye(2)
    one_by_one = MotionFilter(model)
    for time, position, each in zip(times, positions, noise, strict=True):
        one_by_one.update(time, position[None], each)
    expected, found = one_by_one.estimate(), estimate_process(times, positions, model, noise)
    deviations = np.sqrt(np.diag(expected.state_covariance))
    assert found.mean == pytest.approx(expected.mean, rel=1e-9, abs=1e-10)
    relative = (found.state_covariance - expected.state_covariance) / np.outer(deviations, deviations)
    assert np.abs(relative).max() < 1e-11
    assert np.array_equal(found.state_covariance, found.state_covariance.T)
    assert (found.observations, found.reference_time) == (count, times[-1])
    assert found.noise_covariance == pytest.approx(expected.noise_covariance, rel=1e-12)


def test_a_filter_goes_on_from_there() -> None:
    rng = np.random.default_rng(1)
    model = ProcessModel.model_validate({"process": KINDS[2], "velocity_deviation": 1.0, "noise_deviation": 0.1})
    times, positions = np.linspace(0.0, 2.9, 30), 0.1 * rng.normal(size=(30, 2))
    noise = np.broadcast_to(0.01 * np.eye(2), (30, 2, 2))
    one, other = MotionFilter(model), MotionFilter(model)
    one.update(times[0], positions[:1])
    one.take_in(times[1:29, None], positions[1:29, None], noise[1:29, None])
    for place, tracker in ((29, one), *((k, other) for k in range(30))):
        tracker.update(times[place], positions[place : place + 1])
    assert one.estimate().mean == pytest.approx(other.estimate().mean, rel=1e-9, abs=1e-11)
    assert one.observations.tolist() == [30]
