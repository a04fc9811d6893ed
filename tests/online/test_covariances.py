"""Covariances as filters and simulators give them: rounded, singular, zero; and what is none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from replanning import begin, follow
from scenes import scene
from scipy import linalg

from scp_planner.online.planner import Planner

pytestmark = pytest.mark.numerics

Array = np.ndarray


def filtered(kind: Any, joseph: bool, steps: int, prior: float) -> Array:
    """The covariance of a Kalman filter of constant velocity after some steps, in a precision."""
    dt, turn = 0.1, 0.7
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    noise = (rotation @ np.diag([0.01, 0.04]) @ rotation.T).astype(kind)
    forward, seen = np.eye(4, dtype=kind), np.eye(2, 4, dtype=kind)
    forward[0, 2] = forward[1, 3] = dt
    driven = (0.05 * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(2))).astype(kind)
    covariance = np.diag([prior, prior, 4.0 * prior, 4.0 * prior]).astype(kind)
    for _ in range(steps):
        covariance = forward @ covariance @ forward.T + driven
        gain = (covariance @ seen.T @ np.linalg.inv(seen @ covariance @ seen.T + noise)).astype(kind)
        kept = np.eye(4, dtype=kind) - gain @ seen
        covariance = kept @ covariance @ kept.T + gain @ noise @ gain.T if joseph else kept @ covariance
    return covariance


def tracked(covariance: Array) -> Array:
    """The covariance of the state that a planner makes a zone of, at the time of the state, m^2."""
    planner = Planner(scene())
    planner.add_obstacle("p", {"disc": 0.4}, model={"order": 1})
    planner.update_obstacle("p", 0.0, (10.0, 5.0), (0.0, 0.0), covariance=covariance)
    begin(planner, planner.scenario)
    (zone,) = planner.zones
    return np.asarray(zone.covariance(0.0))


@pytest.mark.parametrize("joseph", [True, False])
@pytest.mark.parametrize("prior", [1.0, 100.0])
@pytest.mark.parametrize("steps", [1, 2, 5, 50])
def test_filters_in_single_precision_are_taken(joseph: bool, prior: float, steps: int) -> None:
    rounded, exact = filtered(np.float32, joseph, steps, prior), filtered(np.float64, joseph, steps, prior)
    assert np.abs(rounded - rounded.T).max() > 0.0 or steps == 1
    assert tracked(rounded) == pytest.approx(tracked(exact), rel=2e-2, abs=1e-4 * float(np.abs(tracked(exact)).max()))


def rotated(values: list[float]) -> Array:
    turn = linalg.expm(np.array([[0, 1, 2, 0.5], [-1, 0, 0.3, 1], [-2, -0.3, 0, 1], [-0.5, -1, -1, 0]]))
    found: Array = turn @ np.diag(values) @ turn.T
    return found


@pytest.mark.parametrize(
    "covariance",
    [
        rotated([0.04, 0.02, 0.01, 0.0]),
        rotated([0.04, 0.02, 0.01, -1e-9]),
        np.kron([[0.01, 0.02], [0.02, 0.04]], np.eye(2)),
        np.diag([0.01, 0.01, 0.0, 0.0]),
        np.zeros((4, 4)),
        1e-30 * np.eye(4),
        1e11 * np.eye(4),
    ],
)
def test_what_rounding_or_a_simulator_makes_singular_is_taken(covariance: Array) -> None:
    planner = Planner(scene())
    planner.add_obstacle("p", {"disc": 0.4}, model="pedestrian")
    begin(planner, planner.scenario)
    for k in range(1, 15):
        planner.update_obstacle("p", 0.1 * k, (8.0, 5.0), (0.0, 0.0), covariance=covariance)
        plan = follow(planner, 0.1 * k)
        assert np.isfinite(plan.position(0.1 * k + 0.1)).all()
        values = np.linalg.eigvalsh(planner.zones[0].covariance(0.1 * k + 0.5))
        assert values[0] > 0.0 and np.isfinite(values).all()


@pytest.mark.parametrize("covariance", [np.zeros((2, 2)), 1e-30 * np.eye(2), np.ones((2, 2)), 1e11 * np.eye(2)])
@pytest.mark.parametrize("model", [{"order": 0}, {"order": 2}, "car"])
def test_observations_without_noise_are_taken(covariance: Array, model: object) -> None:
    planner = Planner(scene())
    planner.add_obstacle("p", {"disc": 0.4}, model=model, covariance=covariance)  # type: ignore[arg-type]
    begin(planner, planner.scenario)
    for k in range(1, 25):
        planner.observe("p", 0.1 * k, (8.0, 5.0), covariance if k % 3 == 0 else None)
        plan = follow(planner, 0.1 * k)
        assert np.isfinite(plan.position(0.1 * k + 0.1)).all()
        assert planner.zones[0].signed_distance(0.1 * k, np.array([8.0, 5.0])) < 0.0


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        ([[0.01, 0.005], [0.0, 0.01]], r"is not symmetric: its entries \[0\]\[1\] = 0.005 and \[1\]\[0\] = 0.0"),
        ([[0.01, 0.02], [0.02, 0.01]], "is not positive definite"),
        ([[-0.01, 0.0], [0.0, -0.01]], "is not positive definite"),
        ([[0.01, 0.0], [0.0, -0.001]], "is not positive definite"),
        ([[0.01, np.nan], [np.nan, 0.01]], "is not finite"),
        (np.eye(3), r"its shape is \(3, 3\); it must have 2 rows of 2 numbers"),
        ("large", "it is not an array of numbers"),
    ],
)
def test_what_is_no_covariance_is_refused(covariance: object, message: str) -> None:
    planner = Planner(scene())
    planner.add_obstacle("p", {"disc": 0.4})
    with pytest.raises(ValueError, match=f"covariance: .*{message}"):
        planner.observe("p", 0.0, (8.0, 5.0), covariance)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="covariance: "):
        planner.update_obstacle("p", 0.0, (8.0, 5.0), (0.0, 0.0), covariance=covariance)  # type: ignore[arg-type]
