"""Zones that follow observations: what a replanning vehicle knows of its obstacles, and how far it can foresee.

Every obstacle has a recursive estimate, updated by each observation in time that does not grow with their number.
Zones of all obstacles are made together, with the level of confidence that the scenario asks for.

*Foreseen* zones are those that will be looked at when the vehicle gets there. The zone of an obstacle at a time t,
predicted now, grows with t; but by then newer observations will have been made. The planner never needs to know
more than where an obstacle will be within its *foresight*, about the time that it needs to stop. So beyond the
foresight the foreseen zone does not grow, about the centre that is expected now; it even shrinks, as an obstacle that
is seen for longer is known better.
"""

from __future__ import annotations

import logging
import math
from bisect import bisect, bisect_left
from typing import Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.estimation.confidence import region_scale, shared_alpha, uniform_scale
from scp_planner.estimation.estimate import estimate_motion
from scp_planner.estimation.least_squares import MotionPrior
from scp_planner.estimation.motion_estimate import MotionEstimate
from scp_planner.estimation.motion_filter import MotionFilter, ProcessEstimate
from scp_planner.estimation.recursive import RecursiveEstimator
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.online.foresight import Learning
from scp_planner.online.many_zones import _NORMAL, _ONE, _lengths, _products, _shift
from scp_planner.online.track import MOST_LATE, Prediction, Track
from scp_planner.scenario.models import (
    Confidence,
    ConfidenceLevel,
    Model,
    Observations,
    Obstacle,
    Prior,
    Shape,
    Vector,
)
from scp_planner.settings.online import GATE_PROBABILITY, SceneNewcomers
from scp_planner.threat_zones.of_scenario import HORIZON, estimated_body, known_zone
from scp_planner.threat_zones.zone import ThreatZone

logger = logging.getLogger(__name__)
MOST_SUSPECTS = 3
"""...unless this many come in a row: then the obstacle moves otherwise than estimated, and is learnt anew."""


class ObstacleTracks:
    """The obstacles that a planner knows of, in the natural units of its scene.

    Parameters
    ----------
    confidence : Confidence
        Level of the zones.
    margin : float
        Added to all zones, units of length.
    newcomers : SceneNewcomers
    gate_probability : float
        See GATE_PROBABILITY; 0 for no gate.
    """

    def __init__(
        self,
        confidence: Confidence,
        margin: float = 0.0,
        newcomers: SceneNewcomers | None = None,
        gate_probability: float = GATE_PROBABILITY,
    ) -> None:
        self.confidence = confidence
        self.margin = margin
        self.newcomers = newcomers or SceneNewcomers()
        self.gate_probability = gate_probability
        self.tracks: dict[str, Track] = {}

    def add(self, obstacle: Obstacle) -> None:
        """Take in an obstacle of a scenario, with its motion or its observations."""
        track = self._new_track(obstacle.id, obstacle.shape, obstacle.model, obstacle.margin)
        if obstacle.motion is not None:
            track.fixed = obstacle.motion
        elif obstacle.observations is not None:
            seen = obstacle.observations
            each: list[Array | None] = [None] * len(seen.time)
            if seen.covariance is not None:
                given = np.array(seen.covariance)
                if given.ndim == 3:
                    track.varying, each = True, list(given)
                else:
                    track.covariance = given
            track.times, track.positions, track.covariances = list(seen.time), list(seen.position), each
            self._relearn(track)
        self.tracks[track.id] = track

    def add_unseen(self, name: str, shape: Shape, model: Model, margin: float, covariance: Array | None) -> None:
        """Take in an obstacle that will be observed from now on."""
        track = self._new_track(name, shape, model, margin)
        track.covariance, track.newcomer = covariance, True
        self.tracks[name] = track

    def _new_track(self, name: str, shape: Shape, model: Model, margin: float) -> Track:
        margin += self.margin
        return Track(name, shape, model, margin, estimated_body(shape, model))

    def observe(
        self, name: str, time: float, position: tuple[float, float], covariance: Array | None = None
    ) -> str | None:
        """Take in one observation.

        Parameters
        ----------
        name : str
            Id of the obstacle.
        time : float
            When it was seen, s.
        position : (x, y)
            m.
        covariance : (2, 2) array or None
            Of the observation, m2; None: that of the obstacle's others.

        Returns
        -------
        str or None
            What is wrong with it, if it was not used.
        """
        track = self.tracks[name]
        if track.fixed is not None:
            track.fixed, track.newcomer = None, True  # it does not move as was known
        same = slice(bisect_left(track.times, time), bisect(track.times, time))
        if position in track.positions[same] or (time, position) in ((t, z) for t, z, _ in track.suspects):
            return "it came twice"
        if self._comes_too_late(track, time):
            return f"it came too late, after {MOST_LATE} that were seen after it"
        if self._improbable(track, time, position, covariance):
            track.suspects.append((time, position, covariance))
            if len(track.suspects) < MOST_SUSPECTS:
                return "it is improbable after what was seen before"
            logger.info("obstacle %s: learnt anew, it moves otherwise than estimated", name)
            suspects = sorted(track.suspects, key=lambda one: one[0])
            track.times = [t for t, _, _ in suspects]
            track.positions = [z for _, z, _ in suspects]
            track.covariances = [c for _, _, c in suspects]
            track.newcomer, track.predicted, track.suspects = True, None, []
            self._relearn(track)
            return None
        track.suspects = []
        self._insert(track, time, position, covariance)
        return None

    def _insert(self, track: Track, time: float, position: tuple[float, float], covariance: Array | None) -> None:
        place = bisect(track.times, time)
        late = place < len(track.times)
        track.times.insert(place, time)
        track.positions.insert(place, position)
        track.covariances.insert(place, covariance)
        if covariance is not None and not track.varying:
            if track.covariance is None and len(track.times) == 1:
                track.covariance = covariance
            if track.covariance is None or not np.array_equal(covariance, track.covariance):
                track.varying = True
                self._relearn(track)
                return
        if track.estimator is None:
            self._relearn(track)
        elif late and isinstance(track.estimator, MotionFilter):
            self._learn_again(track, place)
        else:
            self._update(track, time, position, self._noise_of(track, covariance))

    def _comes_too_late(self, track: Track, time: float) -> bool:
        """Whether the filter as it was when an observation was made is not kept any more."""
        after = len(track.times) - bisect(track.times, time)
        return isinstance(track.estimator, MotionFilter) and after > len(track.filters)

    def _learn_again(self, track: Track, place: int) -> None:
        """Go back to the filter before an observation that has just been put in its place, and learn on from there."""
        for _ in range(len(track.times) - 1 - place):
            track.estimator = track.filters.pop()
        for i in range(place, len(track.times)):
            self._update(track, track.times[i], track.positions[i], self._noise_of(track, track.covariances[i]))

    def _update(self, track: Track, time: float, position: tuple[float, float], noise: Array) -> None:
        estimator = track.estimator
        each = noise if track.varying or isinstance(estimator, MotionFilter) else None
        if isinstance(estimator, MotionFilter):
            track.filters.append(estimator.copy())
        try:
            if estimator is not None:
                estimator.update(time, np.array([position]), each)
        except EstimationError as error:
            logger.info("obstacle %s: an observation is not used: %s", track.id, error)

    def _relearn(self, track: Track) -> None:
        """Make the estimator anew from all that was seen."""
        track.filters.clear()
        if track.model.process is not None:
            track.estimator = MotionFilter(track.model.process)
        elif track.varying:
            track.estimator = RecursiveEstimator(1, track.model.order, varying=True)
        else:
            track.estimator = RecursiveEstimator(1, track.model.order, track.covariance)
        for time, position, covariance in zip(track.times, track.positions, track.covariances, strict=True):
            self._update(track, time, position, self._noise_of(track, covariance))

    def _noise_of(self, track: Track, covariance: Array | None) -> Array:
        if covariance is not None:
            return covariance
        if track.covariance is not None:
            return track.covariance
        own = track.model.process.noise_deviation if track.model.process else self.newcomers.noise_deviation
        return own**2 * np.eye(2)

    def _improbable(self, track: Track, time: float, position: tuple[float, float], covariance: Array | None) -> bool:
        if track.predicted is None or self.gate_probability <= 0.0:
            return False
        noise = self._noise_of(track, covariance)
        return track.predicted.exceedance(time, position, noise) < self.gate_probability

    def zones(self, start: float) -> tuple[ThreatZone, ...]:
        """Zones of all obstacles that have been seen, from a time on, s."""
        tracks = [track for track in self.tracks.values() if track.seen]
        estimated = sum(track.uncertain for track in tracks)
        made: dict[str, ThreatZone] = {}
        for order in range(3):
            group = [
                track
                for track in tracks
                if track.fixed is None and track.simple and track.model.order == order and track.settled
            ]
            if group:
                made.update(self._together(group, start, estimated))
        for track in tracks:
            if track.fixed is not None:
                made[track.id] = known_zone(
                    track.id, track.shape, track.margin, track.fixed, self.confidence, estimated
                )
            elif track.id not in made:
                made[track.id] = self._alone(track, start, estimated)
        return tuple(made[track.id] for track in tracks)

    def _alone(self, track: Track, start: float, estimated: int) -> ThreatZone:
        estimate = self._estimate(track)
        if isinstance(estimate, ProcessEstimate):
            start = max(start, estimate.reference_time)
        scale = region_scale(
            str(self.confidence.level),
            self.confidence.probability,
            estimate,
            obstacles=estimated,
            start=start,
            stop=start + HORIZON,
        )
        pieces = estimate.polynomials(start, start + HORIZON)
        track.predicted = Prediction(start, pieces.center[0], pieces.covariance[0], estimate.errors)
        return ThreatZone(
            track.id,
            track.body.radius + track.margin + pieces.center_error,
            PiecewisePolynomials(pieces.breakpoints[None], pieces.center[None]),
            PiecewisePolynomials(pieces.breakpoints[None], scale * pieces.covariance[None]),
            track.body.outlines,
        )

    def _estimate(self, track: Track) -> MotionEstimate:
        if isinstance(track.estimator, MotionFilter):
            return track.estimator.estimate()
        prior = self._prior(track)
        try:
            assert track.estimator is not None, "it has been seen"
            return track.estimator.estimate(0, prior)
        except EstimationError:
            noise = [self._noise_of(track, one) for one in track.covariances]
            return estimate_motion(
                track.times, track.positions, np.array(noise), track.model.order, self._newcomers_prior(track)
            )

    def _prior(self, track: Track) -> MotionPrior | None:
        given = track.model.prior
        if given is not None:
            velocity, acceleration = given.velocity_deviation, given.acceleration_deviation
            return MotionPrior(
                given.velocity,
                math.inf if velocity is None else velocity,
                given.acceleration,
                math.inf if acceleration is None else acceleration,
            )
        return None if track.settled else self._newcomers_prior(track)

    def _newcomers_prior(self, track: Track) -> MotionPrior:
        deviations = self.newcomers
        return MotionPrior(
            (0.0, 0.0),
            deviations.velocity_deviation if track.model.order >= 1 else math.inf,
            (0.0, 0.0),
            deviations.acceleration_deviation if track.model.order >= 2 else math.inf,
        )

    def _together(self, tracks: list[Track], start: float, estimated: int) -> dict[str, ThreatZone]:
        """Make zones of polynomial motions whose noise is known, all at once."""
        order = tracks[0].model.order
        roots = [track.estimator.roots for track in tracks if isinstance(track.estimator, RecursiveEstimator)]
        factor = np.concatenate([root.factor for root in roots])
        right = np.concatenate([root.right for root in roots])
        middle = np.concatenate([root.center for root in roots])
        origin = np.concatenate([root.origin for root in roots])
        first = np.array([track.times[0] for track in tracks])
        last = np.array([track.times[-1] for track in tracks])
        inverse = np.linalg.inv(factor)
        spread = inverse @ inverse.transpose(0, 2, 1)
        shift = _shift(order, start - middle, _ONE)
        count, terms = len(tracks), order + 1
        center = shift @ (inverse @ right)
        center[:, 0] += origin
        local = shift @ spread @ shift.transpose(0, 2, 1)
        growth = local.reshape(count, -1) @ _products(terms)
        noise = np.array([track.covariance for track in tracks])[:, [0, 0, 1], [0, 1, 1]]
        half = np.where(last > first, 0.5 * (last - first), 1.0)
        about = _shift(order, 0.5 * (first + last) - middle, half)
        lengths = _lengths(
            about @ spread @ about.transpose(0, 2, 1),
            (start - 0.5 * (first + last)) / half,
            (start + HORIZON - 0.5 * (first + last)) / half,
        )
        covariance = growth[:, :, None] * noise[:, None, :]
        scales = np.array([self._scale(float(length), terms, estimated) for length in lengths])
        scaled = scales[:, None, None] * covariance
        breaks = np.array([[start, start + HORIZON]])
        zones = {}
        for k, track in enumerate(tracks):
            track.predicted = Prediction(start, center[k], covariance[k], _NORMAL)
            zones[track.id] = ThreatZone(
                track.id,
                track.body.radius + track.margin,
                PiecewisePolynomials(breaks, center[k, None, None]),
                PiecewisePolynomials(breaks, scaled[k, None, None]),
                track.body.outlines,
            )
        return zones

    def _scale(self, length: float, terms: int, estimated: int) -> float:
        alpha = 1.0 - self.confidence.probability
        match self.confidence.level:
            case ConfidenceLevel.PER_TIME:
                return _NORMAL.pointwise_scale(alpha)
            case ConfidenceLevel.JOINT:
                alpha = shared_alpha(alpha, estimated)
        return uniform_scale(alpha, length, _NORMAL, terms)

    def learning(self) -> dict[str, Learning]:
        """How estimates will improve, by id: those of polynomial motions."""
        return {
            track.id: Learning(track.model.order, len(track.times), track.times[-1] - track.times[0])
            for track in self.tracks.values()
            if track.times and track.fixed is None and track.model.process is None
        }

    def as_obstacles(self) -> tuple[Obstacle, ...]:
        """Give what is known as obstacles of a scenario, with the planner's margin."""
        return tuple(self._as_obstacle(track) for track in self.tracks.values() if track.seen)

    def _as_obstacle(self, track: Track) -> Obstacle:
        common: dict[str, Any] = {"id": track.id, "shape": track.shape, "margin": track.margin}
        if track.fixed is not None:
            return Obstacle.model_construct(**common, motion=track.fixed, observations=None, model=track.model)
        each: Any = None
        if track.varying or not track.settled:
            each = tuple(_matrix(self._noise_of(track, one)) for one in track.covariances)
        elif track.covariance is not None:
            each = _matrix(track.covariance)
        model = track.model
        if model.prior is None and model.process is None and not track.settled:
            deviations = self.newcomers
            prior = Prior(
                velocity_deviation=deviations.velocity_deviation,
                acceleration_deviation=deviations.acceleration_deviation,
            )
            model = model.model_copy(update={"prior": prior})
        seen = Observations.model_construct(time=tuple(track.times), position=tuple(track.positions), covariance=each)
        return Obstacle.model_construct(**common, motion=None, observations=seen, model=model)


def _matrix(values: Array) -> tuple[Vector, Vector]:
    (xx, xy), (yx, yy) = values.tolist()
    return (xx, xy), (yx, yy)
