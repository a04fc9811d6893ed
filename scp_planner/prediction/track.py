"""One obstacle that is observed: what was seen of it, and what was made of that."""

from __future__ import annotations

import logging
import math
from bisect import bisect, bisect_left
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from operator import attrgetter

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.errors import EstimationError
from scp_planner.scenario.estimates import Estimate
from scp_planner.scenario.models import Model, Observations
from scp_planner.scenario.motions import GivenMotion, is_uncertain
from scp_planner.scenario.shapes import Shape
from scp_planner.settings.online import SceneNewcomers
from scp_planner.threat_zones.of_scenario import Body, covering_radius
from scp_planner.threat_zones.reach import NO_BOUNDS
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.tracking.estimate import given_prior, tracked_motion
from scp_planner.tracking.estimators import TrackEstimator
from scp_planner.tracking.maximum_likelihood import MotionPrior, estimate_motion
from scp_planner.tracking.motion_estimate import MotionEstimate
from scp_planner.tracking.predictions import KEPT, Prediction
from scp_planner.tracking.process_estimate import ProcessEstimate
from scp_planner.tracking.standing import Stand


@dataclass(frozen=True)
class GivenZones:
    """Zones of a motion that is given, and what they were made of: many replans ask for the same ones."""

    motion: GivenMotion
    uncertain: int
    zones: tuple[ThreatZone, ...]


logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrackParameters:
    # Units of time. From this span of observations on, a newcomer's motion is estimated without the prior for them
    learnt: float = 1.0
    # Improbable measurements in a row after which the obstacle moves otherwise than estimated, and is learnt anew
    most_suspects: int = 3
    interpolated: float = 0.01  # Share of a variance that interpolation between the times of zones loses, at most
    # Shapes whose headings are estimated, one by one; where there are more, all are discs, which are made together
    most_turning: int = 12
    sway: float = 0.2  # Of its radius, by which what stands moves


TRACKS = TrackParameters()


def prior_of(newcomers: SceneNewcomers, order: int) -> MotionPrior:
    """Return what is taken for granted of a newcomer whose motion is a polynomial of an order."""
    return MotionPrior(
        (0.0, 0.0),
        newcomers.velocity_deviation if order >= 1 else math.inf,
        (0.0, 0.0),
        newcomers.acceleration_deviation if order >= 2 else math.inf,
    )


@dataclass(frozen=True, slots=True)
class Seen:
    time: float  # s
    position: tuple[float, float]  # m
    covariance: Array | None = None  # (2, 2) m^2; None: that of the obstacle's others


EstimatorMaker = Callable[["ObstacleTrack"], TrackEstimator]
"""Makes the estimator of a track, which has seen nothing."""


@dataclass(slots=True)
class ObstacleTrack:
    id: str
    shape: Shape  # As in the scenario; ``margin`` holds the planner's margin too
    model: Model  # As in the scenario; ``margin`` holds the planner's margin too
    margin: float  # As in the scenario; ``margin`` holds the planner's margin too
    body: Body
    newcomers: SceneNewcomers
    make: EstimatorMaker
    fixed: GivenMotion | None = None  # The motion of an obstacle whose motion is given
    given: Estimate | None = None
    covariance: Array | None = None  # (2, 2)
    varying: bool = False  # Each observation has a covariance of its own
    newcomer: bool = False
    history: list[Seen] = field(default_factory=list)  # In order of time
    suspects: list[Seen] = field(default_factory=list)  # The newest observations, if the gate left them out
    estimator: TrackEstimator | None = None
    noise_factor: float = 1.0  # Variance of the noise as a multiple of what is declared
    predicted: Prediction | None = None
    seen_noise: Array | None = None  # (2, 2) Noise with that, m^2, where it is estimated from what was seen
    predictions: deque[Prediction] = field(default_factory=lambda: deque(maxlen=KEPT))
    suspected: bool = False
    stand: Stand | None = None
    zone: ThreatZone | None = None  # The last one, as long as it is not what the estimate makes alone
    made: GivenZones | None = None

    @property
    def seen(self) -> bool:
        """True if there is anything to say of where it is."""
        return self.fixed is not None or bool(self.history)

    @property
    def times(self) -> list[float]:
        return [one.time for one in self.history]

    @property
    def oldest(self) -> float:
        return self.history[0].time if self.history else math.inf

    @property
    def newest(self) -> float:
        return self.history[-1].time if self.history else -math.inf

    @property
    def bounded(self) -> bool:
        """True if its model says how fast it may move, or change that."""
        return self.model.bounds != NO_BOUNDS

    @property
    def uncertain(self) -> bool:
        """True if where it is is not known exactly."""
        return is_uncertain(self.fixed)

    @property
    def distinct(self) -> int:
        """Number of distinct times of observation, counted up to three."""
        count = len(self.history)
        return len({self.history[place].time for place in (0, count // 2, count - 1) if count})

    @property
    def settled(self) -> bool:
        """True if its motion shows in the observations alone, or a tracker has told it."""
        if self.given is not None:
            return True
        least = self.model.order + 1
        if self.covariance is None and not self.varying and len(self.history) < least + 2:
            return False
        if self.newcomer and self.newest - self.oldest < TRACKS.learnt:
            return False
        return self.distinct >= least

    @property
    def estimates_noise(self) -> bool:
        """True if the noise is estimated together with its motion."""
        undeclared = self.covariance is None and not self.varying and self.model.process is None
        return undeclared and self.given is None and self.settled

    @property
    def alarmed(self) -> bool:
        """True if it has been noticed to move otherwise than predicted."""
        return self.estimator is not None and self.estimator.alarmed

    def keep_prediction(self) -> None:
        """Keep what is predicted of it, to see what comes of that."""
        told = self.predicted
        if told is not None:
            while self.predictions and self.predictions[-1].origin >= told.origin:
                self.predictions.pop()
            self.predictions.append(told)

    def prediction_before(self, time: float) -> Prediction | None:
        """The newest prediction that was kept by a time, s."""
        place = bisect(self.predictions, time, key=attrgetter("origin"))
        return self.predictions[place - 1] if place else None

    @property
    def simple(self) -> bool:
        """True if its zone can be made together with others: one known covariance, no prior, no process noise."""
        return (
            self.model.process is None and self.model.prior is None and self.covariance is not None and not self.varying
        )

    # what is made of it

    def noise_of(self, covariance: Array | None) -> Array:
        """Covariance (2, 2), m^2, of an observation that came with one, or without."""
        declared = self.covariance if covariance is None else covariance
        if declared is not None:
            return self.noise_factor * declared
        own = self.model.process.noise_deviation if self.model.process else self.newcomers.noise_deviation
        return own**2 * np.eye(2)

    @property
    def known_noise(self) -> Array:
        """Covariance (2, 2), m^2, of every observation, where it is the same for all."""
        assert self.covariance is not None, "it is known"
        return np.asarray(self.noise_factor * self.covariance)

    def insert(self, one: Seen) -> None:
        """Take in an observation, in its place in time."""
        place = bisect(self.history, one.time, key=_time)
        late = place < len(self.history)
        self.history.insert(place, one)
        if one.covariance is not None and not self.varying:
            if self.covariance is None and len(self.history) == 1:
                self.covariance = one.covariance
            if self.covariance is None or not np.array_equal(one.covariance, self.covariance):
                self.varying = True
                self.relearn()
                return
        if self.estimator is None:
            self.relearn()
        elif late and self.estimator.in_order:
            self.estimator.go_back(len(self.history) - 1 - place)
            self._learn(self.estimator, self.history[place:])
        else:
            self._learn(self.estimator, [one])

    def relearn(self) -> None:
        """Make the estimator anew from all that was seen."""
        self._learn(self.begin(), self.history)

    def _learn(self, estimator: TrackEstimator, seen: Sequence[Seen]) -> None:
        for one in seen:
            try:
                estimator.update(one.time, one.position, self.noise_of(one.covariance))
            except EstimationError as error:
                logger.info("obstacle %s: an observation is not used: %s", self.id, error)
            else:
                self._stand_on()

    def begin(self) -> TrackEstimator:
        """Begin with an estimator that has seen nothing."""
        if self.estimator is not None:
            self.estimator.close()
        self.estimator = self.make(self)
        if self.estimator.bank is not None:
            self.predictions.clear()
        return self.estimator

    def follow(self, given: Estimate) -> None:
        """Believe what a tracker says, and nothing else."""
        if self.estimator is not None:
            self.estimator.close()
        self.fixed = self.estimator = self.predicted = self.zone = None
        self.given, self.suspects = given, []
        self._stand_on()
        self.predictions.clear()
        self.history = [Seen(given.time, given.position)]  # so it is known when it was heard of last

    def forsake_tracker(self) -> None:
        """Begin to look for oneself, as at a newcomer."""
        self.given, self.predicted, self.newcomer, self.history = None, None, True, []

    def learn_anew(self, seen: Sequence[Seen]) -> None:
        """Forget all but some observations: it moves otherwise than estimated."""
        self.history = sorted(seen, key=_time)
        self.newcomer, self.predicted, self.suspects = True, None, []
        self.relearn()

    def begin_again(self, count: int) -> None:
        """Forget all but the newest observations, so many: no motion is estimated from all of them."""
        logger.info("obstacle %s: learnt anew from its newest %d observations", self.id, count)
        newest = self.history[-count:]
        self.given, self.varying = None, self.varying and any(one.covariance is not None for one in newest)
        self.learn_anew(newest)

    def came_already(self, one: Seen) -> bool:
        same = slice(bisect_left(self.history, one.time, key=_time), bisect(self.history, one.time, key=_time))
        known = (*self.history[same], *self.suspects)
        return any((one.time, one.position) == (other.time, other.position) for other in known)

    def comes_too_late(self, one: Seen) -> bool:
        """True if what was known when an observation was made is not kept any more."""
        later = len(self.history) - bisect(self.history, one.time, key=_time)
        return self.estimator is not None and later > self.estimator.depth

    def is_improbable(self, one: Seen, least: float) -> bool:
        """True if to see something as far away as this, or farther, is less probable than ``least``."""
        if self.predicted is None or least <= 0.0:
            return False
        noise = self.noise_of(one.covariance)
        if one.covariance is None and self.seen_noise is not None and np.trace(self.seen_noise) < np.trace(noise):
            noise = self.seen_noise
        return self.predicted.exceedance(one.time, one.position, noise) < least

    def estimate(self) -> MotionEstimate:
        if self.given is not None:
            return tracked_motion(self.given, self.model)
        assert self.estimator is not None, "it has been seen"
        try:
            return self.estimator.estimate(self._prior)
        except EstimationError:
            noise = np.array([self.noise_of(one.covariance) for one in self.history])
            prior, positions = prior_of(self.newcomers, self.model.order), [one.position for one in self.history]
            return estimate_motion(self.times, positions, noise, self.model.order, prior)

    def _stand_on(self) -> None:
        """Note whether an obstacle of a process model still stands where it has."""
        if self.model.process is None:
            return
        if self.given is not None:
            now = self.given.time, np.array(self.given.position), np.array(self.given.covariance)
        else:
            estimate = self.estimate()
            if not isinstance(estimate, ProcessEstimate):
                return
            now = estimate.reference_time, estimate.mean[0], estimate.state_covariance
        self.stand = Stand.after(self.stand, *now, TRACKS.sway * covering_radius(self.shape))

    @property
    def _prior(self) -> MotionPrior | None:
        given = given_prior(self.model.prior)
        if given is not None:
            return given
        return None if self.settled else prior_of(self.newcomers, self.model.order)

    def remember(self, seen: Observations) -> None:
        each: Sequence[Array | None] = [None] * len(seen.time)
        if seen.covariance is not None:
            given = np.array(seen.covariance)
            given = 0.5 * (given + given.swapaxes(-1, -2))  # but for rounding it is the same
            if given.ndim == 3:
                self.varying, each = True, list(given)
            else:
                self.covariance = given
        self.history = [Seen(*one) for one in zip(seen.time, seen.position, each, strict=True)]


_time = attrgetter("time")


def slots_of(tracks: Sequence[ObstacleTrack]) -> Index:
    return np.array([track.estimator.slot for track in tracks if track.estimator is not None], dtype=np.intp)
