"""One obstacle as it is seen."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from scp_planner.arrays import Array
from scp_planner.estimation.error_laws import ErrorLaw
from scp_planner.estimation.motion_filter import MotionFilter
from scp_planner.estimation.recursive import RecursiveEstimator
from scp_planner.scenario.models import Course, KnownMotion, Model, Shape
from scp_planner.threat_zones.of_scenario import Body

MOST_LATE = 64
"""Later observations that one may come after, where a process model is learnt from them in order: then these are learnt
again. What comes later still is left out; by then such a model has forgotten most of what it could tell."""
LEARNT = 1.0
"""Units of time. From this span of observations on, a newcomer's motion is estimated without the prior for them."""


@dataclass
class Track:
    """One obstacle, and all that was seen of it.

    Attributes
    ----------
    id : str
    shape, model, margin
        As in the scenario; ``margin`` holds the planner's margin too.
    body : Body
        Of the shape, as long as the motion is estimated.
    fixed : Motion, Course or None
        The motion of an obstacle whose motion is known.
    covariance : (2, 2) array or None
        Of one observation, if it is the same for all.
    varying : bool
        Each observation has a covariance of its own.
    times, positions, covariances : lists
        What was seen, in order of time.
    suspects : list of (time, position, covariance)
        The newest observations, if the gate left them out.
    filters : deque of MotionFilter
        Where the motion is a process: the filter before each of the newest observations.
    """

    id: str
    shape: Shape
    model: Model
    margin: float
    body: Body
    fixed: KnownMotion | None = None
    covariance: Array | None = None
    varying: bool = False
    newcomer: bool = False
    times: list[float] = field(default_factory=list)
    positions: list[tuple[float, float]] = field(default_factory=list)
    covariances: list[Array | None] = field(default_factory=list)
    suspects: list[tuple[float, tuple[float, float], Array | None]] = field(default_factory=list)
    estimator: RecursiveEstimator | MotionFilter | None = None
    predicted: Prediction | None = None
    filters: deque[MotionFilter] = field(default_factory=lambda: deque(maxlen=MOST_LATE))

    @property
    def seen(self) -> bool:
        """Whether there is anything to say of where it is."""
        return self.fixed is not None or bool(self.times)

    @property
    def uncertain(self) -> bool:
        """Whether where it is is not known exactly."""
        return self.fixed is None or (isinstance(self.fixed, Course) and self.fixed.covariance is not None)

    @property
    def distinct(self) -> int:
        """Number of distinct times of observation, counted up to three."""
        times = self.times
        if len(times) < 3:
            return len(set(times))
        return len({times[0], times[len(times) // 2], times[-1]})

    @property
    def settled(self) -> bool:
        """Whether its motion shows in the observations alone."""
        least = self.model.order + 1
        if self.covariance is None and not self.varying and len(self.times) < least + 2:
            return False
        if self.newcomer and self.times[-1] - self.times[0] < LEARNT:
            return False
        return self.distinct >= least

    @property
    def simple(self) -> bool:
        """Whether its zone can be made together with others: one known covariance, no prior, no process noise."""
        return (
            self.model.process is None and self.model.prior is None and self.covariance is not None and not self.varying
        )


@dataclass(frozen=True)
class Prediction:
    """An estimate as one polynomial each of time since an origin, to gate observations with.

    Attributes
    ----------
    origin : float
        s.
    center : (P, 2) array
    covariance : (P, 3) array
        Not scaled.
    errors : ErrorLaw
    """

    origin: float
    center: Array
    covariance: Array
    errors: ErrorLaw

    def exceedance(self, time: float, position: tuple[float, float], noise: Array) -> float:
        """Probability to see something as far away as a position, or farther, at a time."""
        lag = time - self.origin
        powers = lag ** np.arange(max(len(self.center), len(self.covariance)))
        x, y = np.asarray(position) - powers[: len(self.center)] @ self.center
        xx, xy, yy = powers[: len(self.covariance)] @ self.covariance + noise[[0, 0, 1], [0, 1, 1]]
        determinant = xx * yy - xy * xy
        if determinant <= 0.0 or xx <= 0.0:
            return 1.0  # far from its origin, as for what comes very late, the polynomial is no covariance
        return self.errors.exceedance(float((yy * x * x - 2.0 * xy * x * y + xx * y * y) / determinant))
