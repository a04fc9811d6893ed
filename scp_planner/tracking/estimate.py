"""Maximum likelihood of an obstacle's motion from noisy observations of its position."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from scp_planner.errors import EstimationError
from scp_planner.settings.knobs import word_of
from scp_planner.tracking import robust
from scp_planner.tracking.least_squares import MotionPrior, MotionProblem, Noise, fit_motion
from scp_planner.tracking.motion_estimate import MotionEstimate, PolynomialEstimate
from scp_planner.tracking.observations import Outliers, Screening, check_observations

if TYPE_CHECKING:
    from scp_planner.scenario.models import Obstacle, Prior

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
    seen, model = obstacle.observations, obstacle.model
    if obstacle.estimate is not None:
        from scp_planner.tracking.tracked import tracked_motion

        return tracked_motion(obstacle.estimate, model)
    if seen is None:
        raise EstimationError(f"obstacle {obstacle.id!r}: it has no observations; its motion is given")
    try:
        if model.process is not None:
            from scp_planner.tracking.motion_filter import estimate_process

            return estimate_process(seen.time, seen.position, model.process, seen.covariance)
        estimate = estimate_motion(seen.time, seen.position, seen.covariance, model.order, given_prior(model.prior))
        return estimate.with_manoeuvre(model.manoeuvre)
    except EstimationError as error:
        raise EstimationError(f"obstacle {obstacle.id!r}: {error}") from error


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
