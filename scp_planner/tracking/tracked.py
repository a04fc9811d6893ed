"""The motion of an obstacle from what a tracker says of it."""

from __future__ import annotations

import numpy as np

from scp_planner.scenario.estimates import Estimate
from scp_planner.scenario.models import Model
from scp_planner.tracking.dynamics import dynamics_of
from scp_planner.tracking.error_laws import NormalErrors
from scp_planner.tracking.motion_estimate import MotionEstimate, PolynomialEstimate
from scp_planner.tracking.process_estimate import ProcessEstimate


def tracked_motion(given: Estimate, model: Model) -> MotionEstimate:
    """Go on from what a tracker says."""
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
    start = dynamics.from_kinematics(len(mean), model.process.velocity_deviation**2)
    both = np.kron(start.matrix, np.eye(2))
    return ProcessEstimate(
        reference_time=given.time,
        observations=1,
        noise_covariance=noise,
        dynamics=dynamics,
        mean=start.matrix @ mean,
        state_covariance=both @ covariance @ both.T + np.kron(np.diag(start.variance), np.eye(2)),
        tails=model.process.tails,
    )
