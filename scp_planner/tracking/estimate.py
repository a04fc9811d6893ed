"""Estimated motions of obstacles of a scenario."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from scp_planner.arrays import kronecker
from scp_planner.errors import EstimationError
from scp_planner.pauses import GoOn, with_pauses
from scp_planner.tracking.confidence import NormalErrors
from scp_planner.tracking.dynamics import dynamics_of
from scp_planner.tracking.kalman import estimate_processes
from scp_planner.tracking.maximum_likelihood import (
    CheckedObservations,
    MotionPrior,
    check_observations,
    estimate_motion,
)
from scp_planner.tracking.motion_estimate import MotionEstimate, PolynomialEstimate
from scp_planner.tracking.process_estimate import ProcessEstimate, predicted_together

if TYPE_CHECKING:
    from scp_planner.scenario.estimates import Estimate
    from scp_planner.scenario.models import Model, Obstacle, Prior
    from scp_planner.scenario.process_model import ProcessModel


def estimate_obstacle(obstacle: Obstacle) -> MotionEstimate:
    """Estimate the motion of a scenario's obstacle from its ``observations`` or ``estimate``, as its ``model`` says."""
    return estimate_obstacles([obstacle])[0]


def estimate_obstacles(obstacles: Sequence[Obstacle], go_on: GoOn | None = None) -> list[MotionEstimate]:
    """Estimate the motions of obstacles of a scenario; those with process noise that follow one model together."""
    found: dict[int, MotionEstimate] = {}
    alike: dict[ProcessModel, dict[int, CheckedObservations]] = {}
    for place, obstacle in with_pauses(list(enumerate(obstacles)), go_on):
        seen, model = obstacle.observations, obstacle.model
        if obstacle.estimate is not None:
            found[place] = tracked_motion(obstacle.estimate, model)
            continue
        if seen is None:
            raise EstimationError(f"obstacle {obstacle.id!r}: it has no observations; its motion is given")
        given = seen.time, seen.position, seen.covariance
        try:
            if model.process is None:
                found[place] = estimate_motion(*given, model.order, given_prior(model.prior)).with_manoeuvre(
                    model.manoeuvre
                )
            else:
                alike.setdefault(model.process, {})[place] = check_observations(*given)
        except EstimationError as error:
            raise EstimationError(f"obstacle {obstacle.id!r}: {error}") from error
    for process, records in with_pauses(list(alike.items()), go_on):
        found.update(zip(records, estimate_processes(process, list(records.values())), strict=True))
    return predicted_together([found[place] for place in range(len(obstacles))])


def given_prior(given: Prior | None) -> MotionPrior | None:
    """Turn the prior of a scenario into numbers; what it leaves open has no finite deviation."""
    if given is None:
        return None
    velocity, acceleration = given.velocity_deviation, given.acceleration_deviation
    return MotionPrior(
        given.velocity,
        math.inf if velocity is None else velocity,
        given.acceleration,
        math.inf if acceleration is None else acceleration,
    )


def tracked_motion(given: Estimate, model: Model) -> MotionEstimate:
    """Go on from what a tracker reports."""
    state = [given.position, given.velocity, *([] if given.acceleration is None else [given.acceleration])]
    mean, covariance = np.array(state), np.array(given.covariance)
    covariance = 0.5 * (covariance + covariance.T)
    noise = covariance[:2, :2]
    if model.process is None:
        terms = min(model.order + 1, len(mean))
        powers = np.array([1.0, 1.0, 0.5])[:terms]
        blocks = covariance.reshape(len(mean), 2, len(mean), 2)[:terms, :, :terms]
        return PolynomialEstimate(
            reference_time=given.time,
            order=terms - 1,
            observations=1,
            noise_covariance=noise,
            errors=NormalErrors(),
            regressors=None,
            center_time=given.time,
            time_scale=1.0,
            coefficients=powers[:, None] * mean[:terms],
            coefficient_covariance=powers[:, None, None, None] * powers[:, None] * blocks,
        ).with_manoeuvre(model.manoeuvre)
    dynamics = dynamics_of(model.process)
    matrix, variance = dynamics.from_kinematics(len(mean), model.process.velocity_deviation**2)
    both = kronecker(matrix, np.eye(2))
    return ProcessEstimate(
        reference_time=given.time,
        observations=1,
        noise_covariance=noise,
        dynamics=dynamics,
        mean=matrix @ mean,
        state_covariance=both @ covariance @ both.T + kronecker(np.diag(variance), np.eye(2)),
        tails=model.process.tails,
    )
