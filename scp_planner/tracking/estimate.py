"""Maximum likelihood of an obstacle's motion from noisy observations of its position."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.errors import EstimationError
from scp_planner.pauses import GoOn, with_pauses
from scp_planner.settings.knobs import word_of
from scp_planner.tracking import robust
from scp_planner.tracking.dynamics import dynamics_of
from scp_planner.tracking.error_laws import NormalErrors
from scp_planner.tracking.kalman import estimate_processes
from scp_planner.tracking.least_squares import MotionPrior, MotionProblem, Noise, fit_motion
from scp_planner.tracking.motion_estimate import MotionEstimate, PolynomialEstimate
from scp_planner.tracking.observations import CheckedObservations, Outliers, Screening, check_observations
from scp_planner.tracking.process_estimate import ProcessEstimate, predicted_together

if TYPE_CHECKING:
    from scp_planner.scenario.estimates import Estimate
    from scp_planner.scenario.models import Model, Obstacle, Prior
    from scp_planner.scenario.process_model import ProcessModel

HIGHEST_ORDER = 2


def estimate_motion(
    times: ArrayLike,
    positions: ArrayLike,
    covariance: ArrayLike | None = None,
    order: int = 2,
    prior: MotionPrior | None = None,
    *,
    noise: Noise | str = Noise.GENERAL,
    forgetting: float = 1.0,
    screening: Screening | None = None,
) -> PolynomialEstimate:
    """Estimate position, velocity and acceleration by maximum likelihood; with a prior, maximum a posteriori.

    Parameters
    ----------
    times : (n,) s
        In any order and spacing, on any clock.
    positions : (n, 2) m
    covariance : (2, 2) or (n, 2, 2) m^2, or None
        Of one observation, common or for each; None: estimated from the residuals.
    order : 0, 1 or 2
        Standing, constant velocity, constant acceleration.
    prior : MotionPrior, optional
        With one, and a known covariance, fewer observations than order + 1 can be enough.
    noise : Noise
        The form of a covariance that is to be estimated.
    forgetting : float
        Each observation weighs this many times what the next one does, 0 < forgetting <= 1: the estimate
        follows an obstacle that manoeuvres. The covariance stays that of the estimate for a motion that does
        not. With a covariance that is estimated, its degrees of freedom are Satterthwaite's, an
        approximation.
    screening : Screening, optional
        What may be wrong with the observations and what to do about it; the default refuses missing and
        repeated ones and believes all others. With Huber weights the covariance is the asymptotic one.

    Returns
    -------
    PolynomialEstimate

    Raises
    ------
    EstimationError
        For what is not finite, there twice, of the wrong shape, not a covariance, or not enough to determine
        the motion.
    """
    if order not in range(HIGHEST_ORDER + 1):
        raise EstimationError(f"order: {order!r} is not 0, 1 or 2")
    if not 0.0 < forgetting <= 1.0:
        raise EstimationError(f"forgetting: {forgetting!r} is not in (0, 1]")
    screening = screening or Screening()
    if forgetting < 1.0 and covariance is None and screening.outliers is not Outliers.KEEP:
        raise EstimationError(f"forgetting: with outliers {screening.outliers.value!r} the covariance must be given")
    seen = check_observations(times, positions, covariance, screening)
    problem = MotionProblem(int(order), prior, word_of(Noise, noise, "noise"), forgetting)
    if screening.outliers is Outliers.GATE:
        return robust.gated(problem, seen, screening.gate_probability)
    if screening.outliers is Outliers.HUBER:
        return robust.huber(problem, seen)
    return fit_motion(problem, seen).estimate()


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
                alike.setdefault(model.process, {})[place] = check_observations(*given, Screening())
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
