"""Estimates of a tracker: motions that go on from a state and its covariance."""

from __future__ import annotations

from typing import Any

import jsonschema
import numpy as np
import pytest
from scenes import scene
from tracked_states import ACCELERATION, POSITION, VELOCITY, covariance, estimate, obstacle

import scp_planner as sp
from scp_planner.arrays import Array
from scp_planner.scenario.process_model import ProcessModel
from scp_planner.tracking.estimate import tracked_motion
from scp_planner.tracking.kalman import estimate_process, estimate_processes
from scp_planner.tracking.maximum_likelihood import check_observations, estimate_motion

pytestmark = pytest.mark.numerics

RUNS = 4000
PROCESSES: dict[str, dict[str, Any]] = {
    "random_walk": {"diffusion": 0.2},
    "mean_reverting": {"diffusion": 0.3, "time_constant": 2.0},
    "singer": {"deviation": 0.6, "time_constant": 1.5},
    "random_walk_acceleration": {"diffusion": 0.1, "acceleration_deviation": 0.5},
}


def process(kind: str) -> ProcessModel:
    return ProcessModel(process={"kind": kind, **PROCESSES[kind]}, velocity_deviation=1.3, noise_deviation=0.1)


@pytest.mark.parametrize("components", [2, 3])
def test_a_polynomial_goes_on_with_what_the_state_has(components: int) -> None:
    motion = tracked_motion(estimate(components, time=2.0), sp.Model())
    lead = np.array([0.0, 1.0, 4.0])
    rows = np.stack([np.ones(3), lead, 0.5 * lead**2], axis=1)[:, :components]
    state = np.array([POSITION, VELOCITY, ACCELERATION])[:components]
    np.testing.assert_allclose(motion.position(2.0 + lead), rows @ state)
    for row, found in zip(rows, motion.covariance(2.0 + lead), strict=True):
        whole = np.kron(row, np.eye(2))
        np.testing.assert_allclose(found, whole @ covariance(components) @ whole.T, rtol=1e-12)


def test_a_filter_that_is_interrupted_goes_on_as_if_it_was_not() -> None:
    """The state of the package's own filter, handed over as a tracker's, foretells the same."""
    for kind in ("random_walk", "singer", "random_walk_acceleration"):
        last = estimate_process(0.3 * np.arange(9), np.random.default_rng(1).normal(size=(9, 2)), process(kind))
        mean = last.mean
        told = sp.Estimate(
            time=last.reference_time,
            position=tuple(mean[0]),
            velocity=tuple(mean[1]),
            acceleration=tuple(mean[2]) if len(mean) == 3 else None,
            covariance=last.state_covariance.tolist(),
        )
        again = tracked_motion(told, sp.Model(process=process(kind)))
        times = last.reference_time + np.array([0.0, 0.7, 3.0])
        np.testing.assert_allclose(again.position(times), last.position(times), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(again.covariance(times), last.covariance(times), rtol=1e-9)


def states(model: ProcessModel | None, components: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """True states (RUNS, 3, 2) now and what a tracker says of them (RUNS, components, 2), of obstacles of a model."""
    true = np.zeros((RUNS, 3, 2))
    true[:, :2] = np.array([POSITION, VELOCITY])
    if components == 3:
        true[:, 2] = ACCELERATION
    said = rng.multivariate_normal(np.zeros(2 * components), covariance(components), RUNS).reshape(RUNS, components, 2)
    return true, true[:, :components] + said


@pytest.mark.parametrize(("components", "kind"), [(2, None), (3, None), (2, "random_walk"), (3, "singer")])
def test_zones_hold_what_they_promise(components: int, kind: str | None) -> None:
    """At all times: true motions drawn step by step from a state that a tracker tells with errors."""
    rng = np.random.default_rng(8)
    model = None if kind is None else process(kind)
    state, said = states(model, components, rng)
    given = scene(obstacle(components, model={} if model is None else {"process": model}))
    given = given.model_copy(update={"confidence": sp.Confidence(probability=0.9, level="per_obstacle")})
    (zone,) = sp.zones(given)
    inside, step = np.ones(RUNS, dtype=bool), 0.1
    for k in range(61):
        # errors do not hang on the state that was told: where the zone of each run would be
        expected = zone.center(step * k) + np.einsum(
            "p,npa->na", _row(model, components, step * k), said - said_mean(components)
        )
        offset = state[:, 0] - expected
        matrix = zone.covariance(step * k)
        inside &= np.einsum("na,ab,nb->n", offset, np.linalg.inv(matrix), offset) <= 1.0
        state = moved(state, model, step, rng)
    share = float(inside.mean())
    assert 0.9 - 3.0 * np.sqrt(0.09 / RUNS) <= share < 0.99


def said_mean(components: int) -> Array:
    return np.array([POSITION, VELOCITY, ACCELERATION])[:components]


def _row(model: ProcessModel | None, components: int, lead: float) -> Array:
    """Row that maps the state to a later position."""
    if model is not None and model.process.kind == "singer":
        tau = model.process.time_constant
        return np.array([1.0, lead, tau**2 * (lead / tau - 1.0 + np.exp(-lead / tau))])
    return np.array([1.0, lead, 0.5 * lead**2])[:components]


def moved(state: Array, model: ProcessModel | None, step: float, rng: np.random.Generator) -> Array:
    """States (RUNS, 3, 2) a short step later, by many shorter ones."""
    parts = 10 if model is not None else 1
    dt = step / parts
    for _ in range(parts):
        noise = np.sqrt(dt) * rng.normal(size=(len(state), 2)) if model is not None else 0.0
        new = state.copy()
        new[:, 0] += dt * state[:, 1] + 0.5 * dt**2 * state[:, 2]
        new[:, 1] += dt * state[:, 2]
        if model is not None and model.process.kind == "random_walk":
            new[:, 1] += np.sqrt(model.process.diffusion) * noise
        elif model is not None and model.process.kind == "singer":
            new[:, 2] += -dt / model.process.time_constant * state[:, 2]
            new[:, 2] += model.process.deviation * np.sqrt(2.0 / model.process.time_constant) * noise
        state = new
    return state


def test_what_a_tracker_does_not_tell_is_as_the_model_says() -> None:
    """The kept velocity, given the present one, by drawing both from the model's prior."""
    model = process("mean_reverting")
    rng = np.random.default_rng(2)
    kept = 1.3 * rng.normal(size=400_000)
    present = kept + np.sqrt(0.5 * 0.3 * 2.0) * rng.normal(size=len(kept))
    near = np.abs(present - 0.3) < 0.05
    sharp = sp.Estimate(time=0.0, position=(0, 0), velocity=(0.3, 0.3), covariance=(1e-8 * np.eye(4)).tolist())
    motion = tracked_motion(sharp, sp.Model(process=model))
    np.testing.assert_allclose(motion.mean[2], kept[near].mean(), atol=0.02)  # type: ignore[attr-defined]
    np.testing.assert_allclose(motion.state_covariance[4, 4], kept[near].var(), rtol=0.05)  # type: ignore[attr-defined]


def test_the_certificate_sees_the_same_zones() -> None:
    given = scene(obstacle(3, model="pedestrian"))
    plan = sp.plan(given)
    assert plan.certified, plan.reason
    certificate = sp.certify(given, plan)
    assert certificate.holds and certificate.clearance.obstacle == "one"
    times = given.start.time + np.linspace(0.0, plan.travel_time, 400)
    (zone,) = sp.zones(given)
    dense = float(zone.signed_distance(times, plan.position(times)).min()) - given.vehicle.radius
    assert certificate.clearance.minimum <= dense + 1e-9
    assert dense - certificate.clearance.minimum < 0.02


def test_a_file_holds_it_and_gives_it_back(tmp_path: Any, scenario_schema: jsonschema.Draft202012Validator) -> None:
    given = scene(obstacle(3), obstacle(2) | {"id": "two", "model": "car"})
    scenario_schema.validate(given.to_dict())
    given.save(tmp_path / "tracked.yaml")
    assert sp.Scenario.load(tmp_path / "tracked.yaml") == given


SKEW = np.eye(4)
SKEW[0, 3] = 0.5
FLAT = np.eye(4)
FLAT[2:, 2:] = 1.0


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"covariance": np.eye(2).tolist()}, "covariance = [[1.0, 0.0], [0.0, 1.0]]: must have 4 rows of 4 numbers"),
        ({"acceleration": (0.0, 0.0)}, "must have 6 rows of 6 numbers: of position, velocity and acceleration"),
        ({"covariance": SKEW.tolist()}, "covariance[3][0] = 0.0: must be the same as that beyond the diagonal, 0.5"),
        ({"covariance": FLAT.tolist()}, "must be positive definite"),
        ({"covariance": (-np.eye(4)).tolist()}, "must be positive definite"),
    ],
)
def test_a_covariance_that_is_none_is_refused(changes: dict[str, Any], fault: str) -> None:
    good = {"time": 0.0, "position": POSITION, "velocity": VELOCITY, "covariance": np.eye(4).tolist()}
    assert sp.Estimate(**good).acceleration is None
    with pytest.raises(sp.ScenarioError) as caught:
        sp.Estimate(**{**good, **changes})
    assert fault in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"motion": {"position": (1, 1)}}, "obstacles[0].estimate"),
        ({"model": {"prior": {"velocity_deviation": 1.0}}}, "obstacles[0].model.prior"),
        ({"estimate": estimate(time=0.5)}, "obstacles[0].estimate.time = 0.5: must not be later than start.time, 0 s"),
        ({"estimate": None}, "either motion or observations or an estimate must be given"),
    ],
)
def test_an_estimate_fits_its_obstacle(changes: dict[str, Any], fault: str) -> None:
    with pytest.raises(sp.ScenarioError) as caught:
        scene({**obstacle(), **changes})
    assert fault in str(caught.value)


def test_filtered_positions_are_no_independent_observations() -> None:
    """Why a tracker's output has a door of its own: taken for observations, it promises far too much."""
    rng, inside, runs, times = np.random.default_rng(5), 0, 100, 0.1 * np.arange(30)
    for _ in range(runs):
        seen = rng.normal(0.0, 0.3, (len(times), 2))  # of something that stands at the origin
        noise = 0.09 * np.eye(2)
        so_far = [check_observations(times[:k], seen[:k], noise) for k in range(1, 31)]
        states = estimate_processes(process("random_walk"), so_far)
        filtered, blurs = (np.array([one.mean[0] for one in states]), [one.state_covariance[:2, :2] for one in states])
        motion = estimate_motion(times, filtered, np.array(blurs), order=1)
        offset = motion.position(4.9)
        inside += float(offset @ np.linalg.solve(motion.covariance(4.9), offset)) <= -2.0 * np.log(0.05)
    assert inside / runs < 0.85
