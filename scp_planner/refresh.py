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
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from scp_planner.confidence import ErrorLaw, NormalErrors, region_scale, shared_alpha, uniform_scale
from scp_planner.errors import EstimationError
from scp_planner.estimation import estimate_motion
from scp_planner.knobs import Knobs, Range
from scp_planner.least_squares import MotionPrior
from scp_planner.motion_estimate import POLYNOMIAL_TERMS, MotionEstimate
from scp_planner.motion_models import MotionFilter, ProcessEstimate
from scp_planner.polynomials import PiecewisePolynomials, shift_matrices
from scp_planner.recursive import RecursiveEstimator
from scp_planner.scenario import (
    Confidence,
    ConfidenceLevel,
    Course,
    KnownMotion,
    Model,
    Observations,
    Obstacle,
    Prior,
    Shape,
    Vector,
)
from scp_planner.zones import HORIZON, Body, ThreatZone, ZoneBatch, estimated_body, known_zone

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)

GATE_PROBABILITY = 1e-7
"""An observation that is less probable than this, by what was seen before, is taken for a fault of the sensor..."""
MOST_SUSPECTS = 3
"""...unless this many come in a row: then the obstacle moves otherwise than estimated, and is learnt anew."""
LONGER = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0])
"""s of further observation after which foreseen zones are computed; in between, they are interpolated."""
PANELS, NODES = 4, 12  # of the quadrature of standardised lengths
LEARNT = 1.0
"""s. From this span of observations on, a newcomer's motion is estimated without the prior for newcomers."""


@dataclass(frozen=True)
class Newcomers(Knobs):
    """What is taken for granted of obstacles that have only just been seen, until their motion shows.

    Attributes
    ----------
    velocity_deviation : float
        Standard deviation of each component of the velocity. Larger: wider zones at first.
    acceleration_deviation : float
        Standard deviation of each component of the acceleration. Larger: zones that grow faster at first.
    noise_deviation : float
        Of an observed coordinate, where it is to be estimated and there are too few observations for that.
    """

    velocity_deviation: Annotated[float, Range(1e-6, 1000.0, "m/s")] = 1.5
    acceleration_deviation: Annotated[float, Range(1e-6, 1000.0, "m/s2")] = 0.5
    noise_deviation: Annotated[float, Range(1e-6, 1000.0, "m")] = 0.1


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


class ObstacleTracks:
    """The obstacles that a planner knows of.

    Parameters
    ----------
    confidence : Confidence
        Level of the zones.
    margin : float
        Added to all zones, m.
    newcomers : Newcomers
    gate_probability : float
        See GATE_PROBABILITY; 0 for no gate.
    """

    def __init__(
        self,
        confidence: Confidence,
        margin: float = 0.0,
        newcomers: Newcomers | None = None,
        gate_probability: float = GATE_PROBABILITY,
    ) -> None:
        self.confidence = confidence
        self.margin = margin
        self.newcomers = newcomers or Newcomers()
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
        if track.estimator is None or (late and isinstance(track.estimator, MotionFilter)):
            self._relearn(track)
        else:
            self._update(track, time, position, self._noise_of(track, covariance))

    def _update(self, track: Track, time: float, position: tuple[float, float], noise: Array) -> None:
        estimator = track.estimator
        each = noise if track.varying or isinstance(estimator, MotionFilter) else None
        try:
            if estimator is not None:
                estimator.update(time, np.array([position]), each)
        except EstimationError as error:
            logger.info("obstacle %s: an observation is not used: %s", track.id, error)

    def _relearn(self, track: Track) -> None:
        """Make the estimator anew from all that was seen."""
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


_NORMAL = NormalErrors()


@dataclass(frozen=True)
class Learning:
    """What an estimate of a polynomial motion is made from: how it will improve by going on like this.

    Attributes
    ----------
    order : int
    count : int
        Observations.
    span : float
        From the first to the last of them, s.
    """

    order: int
    count: int
    span: float


def _variances(learning: Sequence[Learning], lead: float) -> Array:
    """Relative variances of K predictions so far ahead, s, after observing for so much longer as `LONGER`, (K, n).

    With n observations spread evenly over T one is sum_k (2 k + 1) P_k(1 + 2 lead / T)^2 / n, P_k Legendre's
    polynomials.
    """
    orders = np.array([one.order for one in learning])[:, None]
    now = np.array([one.span for one in learning])[:, None]
    span = now + LONGER
    s = 1.0 + 2.0 * lead / span
    squared = s * s
    growth = 1.0 + 3.0 * squared * (orders >= 1) + 1.25 * (3.0 * squared - 1.0) ** 2 * (orders >= 2)
    return growth * now / span


def foreseen(batch: ZoneBatch, foresight: float, learning: Mapping[str, Learning], now: float = 0.0) -> ZoneBatch:
    """Zones that do not grow beyond the foresight, but shrink with what will be learnt; see the head of this module.

    Parameters
    ----------
    batch : ZoneBatch
    foresight : float
        s.
    learning : mapping of str to Learning
        By the ids of the zones; the others keep their size.
    now : float
        What the clock of the batch shows now, s.

    Returns
    -------
    ZoneBatch
    """
    if batch.covariances is None:
        return batch
    covariances = batch.covariances
    pieces, powers, width = covariances.coefficients.shape[1:]
    count = covariances.size
    factors = np.ones((count, len(LONGER)))
    known = [(k, learning.get(batch.ids[index])) for k, index in enumerate(batch.uncertain)]
    learnt = [(k, one) for k, one in known if one is not None and one.span > 0.0]
    if learnt:
        variance = _variances([one for _, one in learnt], foresight)
        factors[[k for k, _ in learnt]] = variance / variance[:, :1]
    every = np.arange(count)
    size = covariances.at(every, np.full(count, now + foresight))
    # Pieces that begin after the foresight are empty, and those that follow them are taken first.
    begins = np.minimum(covariances.breakpoints[:, :-1], now + foresight)
    coefficients = np.zeros((count, pieces + len(LONGER), max(powers, 2), width))
    coefficients[:, :pieces, :powers] = covariances.coefficients
    coefficients[:, pieces:, 0] = factors[:, :, None] * size[:, None]
    slopes = np.diff(factors, axis=1) / np.diff(LONGER)
    coefficients[:, pieces:-1, 1] = slopes[:, :, None] * size[:, None]
    later = np.broadcast_to(now + foresight + LONGER, (count, len(LONGER)))
    end = np.full((count, 1), np.inf)
    seen = copy(batch)
    seen.covariances = PiecewisePolynomials(np.concatenate([begins, later, end], axis=1), coefficients)
    return seen


_ONE = np.ones(1)


def _shift(order: int, shift: Array, scale: Array) -> Array:
    """Matrices from coefficients of powers of u to those of s, where u = shift + scale s, (K, p, p)."""
    matrix = shift_matrices(order + 1, shift)
    matrix *= scale[:, None, None] ** np.arange(order + 1)[:, None]
    return matrix


@lru_cache(maxsize=8)
def _products(terms: int) -> Array:
    """Matrix from the products of coefficients k and m, in rows, to the coefficient k + m."""
    matrix = np.zeros((terms, terms, POLYNOMIAL_TERMS))
    for k in range(terms):
        for m in range(terms):
            matrix[k, m, k + m] = 1.0
    return matrix.reshape(-1, POLYNOMIAL_TERMS)


def _lengths(spread: Array, start: Array, stop: Array) -> Array:
    """Standardised lengths of K polynomial motions over spans of normalised time, (K,).

    See `scp_planner.motion_estimate`: s = tan(angle), and the rows (1, s, s^2) become (cos^2, sin cos, sin^2).
    """
    order = spread.shape[1] - 1
    if order == 0:
        return np.zeros(len(spread))
    nodes, weights = _quadrature()
    low, high = np.arctan(start), np.arctan(stop)
    angles = low[:, None] + (high - low)[:, None] * nodes
    sine, cosine = np.sin(angles), np.cos(angles)
    if order == 1:
        rows, slopes = [cosine, sine], [-sine, cosine]
    else:
        both = sine * cosine
        rows = [cosine * cosine, both, sine * sine]
        slopes = [-2.0 * both, cosine * cosine - sine * sine, 2.0 * both]
    x, y = np.stack(rows, axis=-1), np.stack(slopes, axis=-1)
    weighted = x @ spread
    error, cross = (weighted * x).sum(axis=-1), (weighted * y).sum(axis=-1)
    rate = ((y @ spread) * y).sum(axis=-1)
    speed = np.sqrt(np.maximum(rate * error - cross * cross, 0.0)) / error
    return (high - low) * (speed @ weights)


def _quadrature() -> tuple[Array, Array]:
    global _RULE
    if _RULE is None:
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        edges = np.arange(PANELS) / PANELS
        points = (edges[:, None] + (0.5 + 0.5 * nodes) / PANELS).ravel()
        _RULE = points, np.tile(0.5 * weights / PANELS, PANELS)
    return _RULE


_RULE: tuple[Array, Array] | None = None


def _matrix(values: Array) -> tuple[Vector, Vector]:
    (xx, xy), (yx, yy) = values.tolist()
    return (xx, xy), (yx, yy)
