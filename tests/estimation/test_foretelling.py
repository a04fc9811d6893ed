from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from scp_planner.estimation import motion_estimate, process_estimate
from scp_planner.estimation.estimate import estimate_obstacle
from scp_planner.estimation.foretelling import foretell
from scp_planner.estimation.motion_estimate import MotionEstimate, PolynomialEstimate
from scp_planner.estimation.motion_filter import estimate_process
from scp_planner.estimation.process_estimate import ProcessEstimate, spans_of
from scp_planner.scenario.models import Obstacle
from scp_planner.scenario.process_model import ProcessModel, Tails

pytestmark = pytest.mark.numerics

TAILS = Tails(degrees_of_freedom=4.0, lead_time=(0.4, 1.2, 2.4), inflation=(0.8, 0.6, 0.5))
KINDS = {
    "random_walk": {"diffusion": 0.2},
    "mean_reverting": {"diffusion": 0.2, "time_constant": 1.5},
    "singer": {"deviation": 0.6, "time_constant": 0.8},
    "random_walk_acceleration": {"diffusion": 0.2, "acceleration_deviation": 0.4},
}
SPAN = 40.0


def seen(kind: str, seed: int, tails: Tails | None = None) -> ProcessEstimate:
    """A motion that was seen some times, with noise of any shape and of very different sizes."""
    rng = np.random.default_rng(seed)
    process = {"kind": kind, **KINDS[kind]}
    model = ProcessModel(process=process, velocity_deviation=1.3, noise_deviation=0.1, tails=tails)
    root = rng.normal(size=(2, 2)) * 10.0 ** rng.uniform(-2.0, 1.0)
    return estimate_process(np.arange(5) * 0.3, rng.normal(size=(5, 2)), model, (root @ root.T).tolist())


@pytest.mark.parametrize("tails", [None, TAILS])
@pytest.mark.parametrize("kind", list(KINDS))
def test_many_at_once_are_what_each_is_alone(kind: str, tails: Tails | None) -> None:
    start = 1.5
    alone, together = ([seen(kind, seed, tails) for seed in range(7)] for _ in range(2))
    foretell(together, start, SPAN)
    for one, among in zip(alone, together, strict=True):
        length = one.standardised_length(start, start + SPAN)
        assert among.standardised_length(start, start + SPAN) == pytest.approx(length, rel=1e-9)
        single, shared = one.polynomials(start, start + SPAN), among.polynomials(start, start + SPAN)
        np.testing.assert_array_equal(single.breakpoints, shared.breakpoints)
        np.testing.assert_allclose(single.center, shared.center, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(single.covariance, shared.covariance, rtol=1e-9, atol=1e-12)
        assert shared.covariance_error == pytest.approx(single.covariance_error, rel=1e-6, abs=1e-15)


def tracked(seed: int, accelerations: bool) -> MotionEstimate:
    """What a tracker says of an obstacle, with a covariance of any shape."""
    rng = np.random.default_rng(seed)
    size = 6 if accelerations else 4
    root = rng.normal(size=(size, size)) * 10.0 ** rng.uniform(-2.0, 1.0, size)
    given: dict[str, Any] = {
        "time": 1.0,
        "position": rng.normal(size=2).tolist(),
        "velocity": rng.normal(size=2).tolist(),
        "covariance": (root @ root.T).tolist(),
    }
    if accelerations:
        given["acceleration"] = rng.normal(size=2).tolist()
    obstacle = {"id": "one", "shape": {"disc": 0.3}, "estimate": given, "model": {"manoeuvre": 0.5 * (seed % 2)}}
    return estimate_obstacle(Obstacle.model_validate(obstacle))


@pytest.mark.parametrize("accelerations", [False, True])
def test_many_of_a_tracker_at_once_are_what_each_is_alone(accelerations: bool) -> None:
    alone, together = ([tracked(seed, accelerations) for seed in range(9)] for _ in range(2))
    foretell([*together, seen("singer", 1)], 1.5, SPAN)
    lengths = [one.standardised_length(1.5, 1.5 + SPAN) for one in alone]
    assert [one.standardised_length(1.5, 1.5 + SPAN) for one in together] == pytest.approx(lengths, rel=1e-9)
    for one, length in zip(alone[:2], lengths, strict=False):
        assert isinstance(one, PolynomialEstimate)
        assert length == pytest.approx(length_by_sums(one, 1.5, 1.5 + SPAN), rel=1e-4)


def length_by_sums(one: PolynomialEstimate, start: float, stop: float) -> float:
    """The definition: the mean of (u' Lambda u)^1/2 over directions u, summed over time, with LAPACK's factors."""
    angles = (np.arange(200) + 0.5) * np.pi / 200
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    edges = one.center_time + np.geomspace(start - one.center_time, stop - one.center_time, 1501)
    total = 0.0
    for time, width in zip(0.5 * (edges[1:] + edges[:-1]), np.diff(edges), strict=True):
        powers = np.arange(one.order + 1)
        row = (time - one.center_time) ** powers
        slope = powers * (time - one.center_time) ** np.maximum(powers - 1, 0)
        error, cross, rate = (
            np.einsum("j,jakb,k->ab", left, one.coefficient_covariance, right)
            for left, right in ((row, row), (row, slope), (slope, slope))
        )
        inverse = np.linalg.inv(np.linalg.cholesky(error))
        given = inverse @ (rate - cross.T @ np.linalg.solve(error, cross)) @ inverse.T
        squares = np.einsum("na,ab,nb->n", directions, given, directions)
        total += width * float(np.mean(np.sqrt(np.maximum(squares, 0.0))))
    return total


def test_what_was_foretold_is_not_computed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    some = [*(seen("singer", seed) for seed in range(3)), *(seen("mean_reverting", seed, TAILS) for seed in range(2))]
    start = some[0].earliest
    foretell(some, 0.0, SPAN)  # before the last observation nothing is predicted: from there on

    def never(_: object) -> None:
        raise AssertionError("was known")

    monkeypatch.setattr(process_estimate, "spans_of", never)
    monkeypatch.setattr(motion_estimate, "lengths_together", never)
    for one in some:
        assert one.standardised_length(start, start + SPAN) > 0.0
        assert one.polynomials(start, start + SPAN).breakpoints[-1] == start + SPAN


def test_what_the_model_alone_decides_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    counted: list[int] = []
    kind = type(seen("mean_reverting", 0).dynamics)
    transition: Callable[..., np.ndarray] = kind.transition

    def counting(self: object, lag: np.ndarray) -> np.ndarray:
        counted.append(1)
        return transition(self, lag)

    some = [seen("mean_reverting", seed) for seed in range(30)]
    spans_of(some[:1]).pieces(0.01, 7.77)
    monkeypatch.setattr(kind, "transition", counting)
    spans_of(some).pieces(0.01, 7.77)
    assert not counted
