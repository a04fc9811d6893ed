"""Forecasts of the independent check: against closed forms, and against the package's filter, which shares nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import scp_planner as sp
from scp_planner.tracking.estimate import estimate_obstacle
from verification.forecasts import predicted, system_of

PROCESSES: list[dict[str, Any]] = [
    {"kind": "random_walk", "diffusion": 0.02},
    {"kind": "mean_reverting", "diffusion": 0.05, "time_constant": 1.5},
    {"kind": "singer", "deviation": 0.3, "time_constant": 2.0},
    {"kind": "random_walk_acceleration", "diffusion": 0.01, "acceleration_deviation": 0.2},
]
TAILS = {"degrees_of_freedom": 5.0, "lead_time": [0.5, 2.0], "inflation": [1.0, 1.5]}


def _model(process: dict[str, Any], tails: dict[str, Any] | None = None) -> dict[str, Any]:
    return {"process": process, "velocity_deviation": 0.8, "noise_deviation": 0.05, "tails": tails}


def _agrees(obstacle: dict[str, Any]) -> None:
    """Centres and covariances are those of the package."""
    times = np.linspace(0.0, 6.0, 40)
    found = predicted(obstacle, times)
    estimate = estimate_obstacle(sp.Obstacle(**obstacle))
    assert found.centres == pytest.approx(estimate.position(times), abs=1e-8)
    assert found.errors == pytest.approx(estimate.covariance(times), rel=1e-6, abs=1e-10)


@pytest.mark.parametrize("tails", [None, TAILS], ids=["normal", "tails"])
@pytest.mark.parametrize("process", PROCESSES, ids=lambda one: one["kind"])
def test_observed_with_process_noise_against_the_filter(process: dict[str, Any], tails: dict[str, Any] | None) -> None:
    rng = np.random.default_rng(5)
    times = np.cumsum(rng.uniform(0.05, 0.4, 20))
    times -= times[-1]
    root = rng.normal(0.0, 0.05, (20, 2, 2))
    noise = root @ np.swapaxes(root, 1, 2) + 1e-4 * np.eye(2)
    seen = np.stack([times, 0.3 * times**2], axis=1) + rng.normal(0.0, 0.05, (20, 2))
    _agrees(
        {
            "id": "o",
            "shape": {"disc": 0.3},
            "observations": {"time": times.tolist(), "position": seen.tolist(), "covariance": noise.tolist()},
            "model": {"process": _model(process, tails)},
        }
    )


@pytest.mark.parametrize("known", [2, 3], ids=["with velocity", "with acceleration"])
@pytest.mark.parametrize("model", [*(_model(one) for one in PROCESSES), 1, 2], ids=str)
def test_said_by_a_tracker_against_the_package(model: dict[str, Any] | int, known: int) -> None:
    rng = np.random.default_rng(6)
    root = 0.1 * (np.eye(2 * known) + 0.3 * rng.normal(size=(2 * known, 2 * known)))
    said = {"time": -0.2, "position": [3.0, 1.0], "velocity": [-0.5, 0.2], "covariance": (root @ root.T).tolist()}
    if known == 3:
        said["acceleration"] = [0.1, -0.05]
    how = {"process": model} if isinstance(model, dict) else {"order": model, "manoeuvre": 0.1}
    _agrees({"id": "o", "shape": {"disc": 0.3}, "estimate": said, "model": how})


def test_a_step_of_brownian_velocity_has_its_closed_form() -> None:
    move, noise = system_of(_model(PROCESSES[0])).step(1.5)
    assert move == pytest.approx(np.array([[1.0, 1.5], [0.0, 1.0]]))
    assert noise == pytest.approx(0.02 * np.array([[1.5**3 / 3.0, 1.5**2 / 2.0], [1.5**2 / 2.0, 1.5]]))


def test_two_observations_of_a_known_speed_are_averaged() -> None:
    """Hardly any process noise and hardly any spread of the speed: the mean of two places, at half the variance."""
    process = {"kind": "random_walk", "diffusion": 1e-12}
    seen = {"time": [-1.0, 0.0], "position": [[0.0, 0.0], [0.2, 0.0]], "covariance": [[0.04, 0.0], [0.0, 0.04]]}
    model = {"process": {**_model(process), "velocity_deviation": 1e-6}}
    found = predicted({"id": "o", "shape": {"disc": 0.3}, "observations": seen, "model": model}, np.array([0.0, 2.0]))
    assert found.centres == pytest.approx(np.array([[0.1, 0.0], [0.1, 0.0]]), abs=1e-6)
    assert found.errors == pytest.approx(np.array([0.02 * np.eye(2)] * 2), abs=1e-6)
