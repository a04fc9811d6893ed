"""Zones that follow observations: what a replanning vehicle knows of its obstacles."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from scp_planner.arrays import Array, joined, rows_of
from scp_planner.errors import EstimationError
from scp_planner.prediction.alarmed_zones import Alarmed, changes_among
from scp_planner.prediction.foresight import Learning, least_noise
from scp_planner.prediction.many_zones import (
    InitialisedTracks,
    Level,
    SortedTracks,
    TrackKind,
    learns,
    newcomers_together,
)
from scp_planner.prediction.regions import RegionSizes
from scp_planner.prediction.track import TRACKS, GivenZones, ObstacleTrack, Seen, prior_of, slots_of
from scp_planner.scenario.estimates import Estimate
from scp_planner.scenario.models import Confidence, Model, Observations, Obstacle, Prior
from scp_planner.scenario.motions import Course, GivenMotion
from scp_planner.scenario.process_model import MeanRevertingVelocity
from scp_planner.scenario.shapes import Shape
from scp_planner.scenario.values import Vector
from scp_planner.settings.online import Regions, SceneOnlineSettings
from scp_planner.threat_zones.of_scenario import (
    Embodied,
    EstimatedRegion,
    estimated_body,
    estimated_region,
    given_zones,
)
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.tracking.change_hypotheses import CHANGE_HYPOTHESES, ChangeHypotheses
from scp_planner.tracking.confidence import marginal_scale, outside_probability
from scp_planner.tracking.estimators import MOST_LATE, NoticingTrack, PolynomialTrack, ProcessTrack, TrackEstimator
from scp_planner.tracking.filters import FilterModels
from scp_planner.tracking.futures import PolynomialMotions
from scp_planner.tracking.motion_estimate import HORIZON, MotionEstimate, PolynomialEstimate
from scp_planner.tracking.noticing import Bank, NoiseWatch, is_misfit, neighbour_differences
from scp_planner.tracking.predictions import Prediction, PredictionKind
from scp_planner.tracking.process_estimate import predicted_together
from scp_planner.tracking.recursive import SquareRoots

logger = logging.getLogger(__name__)
JUMP = 1e-3  # Units of time before a break of a zone, where it may jump
PREDICTED_TIMES = np.concatenate([[0.0], np.geomspace(0.1, HORIZON, 150)])
"""Units of time from now on, at which zones are put down that a scenario cannot hold otherwise..."""


class ObstacleTracks:
    """The obstacles that a planner knows of, in the natural units of its scene."""

    def __init__(
        self, confidence: Confidence, margin: float = 0.0, settings: SceneOnlineSettings | None = None
    ) -> None:
        self.confidence = confidence
        self.margin = margin
        self.settings = settings or SceneOnlineSettings()
        self.newcomers = self.settings.newcomers
        self._manoeuvre = self.settings.manoeuvre * self.newcomers.acceleration_deviation
        self.tracks: dict[str, ObstacleTrack] = {}
        self.noise = NoiseWatch()
        adaptive = self.settings.regions is Regions.ADAPTIVE
        self.sizes = RegionSizes(outside_probability(confidence.probability)) if adaptive else None
        self._banks: dict[int, Bank] = {}
        self._ready: tuple[SortedTracks, list[InitialisedTracks]] | None = None  # until anything new is known
        self._asked = True  # for zones, since that was worked out

    def add(self, *obstacles: Obstacle) -> None:
        """Take in obstacles of a scenario, with their motions or their observations."""
        self._ready = None
        together: list[ObstacleTrack] = []
        for obstacle in obstacles:
            track = self._new_track(obstacle.id, obstacle.shape, obstacle.model, obstacle.margin)
            self.tracks[track.id] = track
            if obstacle.motion is not None:
                track.fixed = obstacle.motion
            elif obstacle.estimate is not None:
                track.follow(obstacle.estimate)
            elif obstacle.observations is not None:
                track.remember(obstacle.observations)
                together.append(track)
        self._learn_together([track for track in together if track.simple and self.settings.alarm_probability > 0.0])
        for track in together:
            if track.estimator is None:
                track.relearn()

    def replace(self, *obstacles: Obstacle) -> None:
        """Take in obstacles in place of those of the same ids."""
        for obstacle in obstacles:
            if obstacle.id in self.tracks:
                self.remove(obstacle.id)
        self.add(*obstacles)

    def widen(self, margin: float) -> None:
        """Keep another margin of all obstacles, m."""
        wider, self.margin = margin - self.margin, margin
        if wider != 0.0:
            self._ready = None
            for track in self.tracks.values():
                track.margin, track.made = track.margin + wider, None

    def _learn_together(self, tracks: Sequence[ObstacleTrack]) -> None:
        """Learn from what has been seen of obstacles before: first how much noise there is, then how they move."""
        for track in tracks:
            track.begin()
        for track in tracks:
            whiten = np.linalg.inv(np.linalg.cholesky(np.asarray(track.covariance)))
            positions = np.array([one.position for one in track.history])
            self.judge_noise(neighbour_differences(np.array(track.times), positions, whiten))
        for order, bank in self._banks.items():
            self._replay(bank, [track for track in tracks if track.model.order == order])

    def _replay(self, bank: Bank, tracks: list[ObstacleTrack]) -> None:
        """Let a bank learn from all that has been seen of obstacles, but for outliers."""
        gate = -2.0 * math.log(self.settings.gate_probability) if self.settings.gate_probability > 0.0 else math.inf
        wild: dict[str, list[int]] = {track.id: [] for track in tracks}
        for place in range(max((len(track.history) for track in tracks), default=0)):
            some = [track for track in tracks if len(track.history) > place]
            slots = slots_of(some)
            times = np.array([track.history[place].time for track in some])
            positions = np.array([track.history[place].position for track in some])
            keep = bank.surprise(slots, times, positions) <= gate
            for number, track in enumerate(some):
                before = wild[track.id][1 - TRACKS.most_suspects :]
                if not keep[number] and before == list(range(place + 1 - TRACKS.most_suspects, place)):
                    keep[number] = True  # so many are no outliers
                    bank.alarm(slots[number : number + 1], np.array([TRACKS.most_suspects]))
                elif not keep[number]:
                    wild[track.id].append(place)
            bank.update(slots[keep], times[keep], positions[keep])
        for track in tracks:
            left_out = set(wild[track.id])
            track.history = [one for k, one in enumerate(track.history) if k not in left_out]

    def _make(self, track: ObstacleTrack) -> TrackEstimator:
        process, covariance = track.model.process, track.covariance
        if process is not None:
            return ProcessTrack(process)
        if covariance is None or not track.simple or self.settings.alarm_probability <= 0.0:
            return PolynomialTrack(track.model.order, covariance, track.varying)
        return NoticingTrack(self._bank(track.model.order), covariance)

    def _bank(self, order: int) -> Bank:
        if order not in self._banks:
            models = FilterModels(self.newcomers.velocity_deviation, self.newcomers.acceleration_deviation)
            self._banks[order] = Bank(order, models, self.settings.alarm_probability)
            self._banks[order].set_noise(self.noise.factor)
        return self._banks[order]

    def judge_noise(self, differences: Array) -> None:
        """Take the noise for what it is seen to be."""
        self._ready = None
        if not self.noise.take_in(differences):
            return
        logger.info("noise: taken as %.3g times the declared variance", self.noise.factor)
        for bank in self._banks.values():
            bank.set_noise(self.noise.factor)
        for track in self.tracks.values():
            track.noise_factor = self.noise.factor
            if track.estimator is not None and not isinstance(track.estimator, NoticingTrack):
                track.relearn()

    def add_unseen(self, name: str, shape: Shape, model: Model, margin: float, covariance: Array | None) -> None:
        """Take in an obstacle that will be observed from now on."""
        self._ready = None
        track = self._new_track(name, shape, model, margin)
        track.covariance, track.newcomer = covariance, True
        self.tracks[name] = track

    def remove(self, name: str) -> None:
        self._ready = None
        track = self.tracks.pop(name)
        if self.sizes is not None:
            self.sizes.forget(name)
        if track.estimator is not None:
            track.estimator.close()

    def foretell(self, name: str, motion: GivenMotion) -> None:
        """Take an obstacle to move as is predicted, until it is observed."""
        self._ready = None
        track = self.tracks[name]
        track.fixed, track.suspects = motion, []

    def _new_track(self, name: str, shape: Shape, model: Model, margin: float) -> ObstacleTrack:
        body, factor = estimated_body(shape, model), self.noise.factor
        return ObstacleTrack(
            name, shape, model, margin + self.margin, body, self.newcomers, self._make, noise_factor=factor
        )

    def observe(
        self, name: str, time: float, position: tuple[float, float], covariance: Array | None = None
    ) -> str | None:
        self._ready, track, one = None, self.tracks[name], Seen(time, position, covariance)
        if track.fixed is not None:
            track.fixed, track.newcomer = None, True  # it does not move as was known
        if track.given is not None:
            track.forsake_tracker()
        if track.came_already(one):
            return "it came twice"
        if track.comes_too_late(one):
            return f"it came too late, after {MOST_LATE} newer observations"
        if track.is_improbable(one, self.settings.gate_probability):
            track.suspects.append(one)
            if len(track.suspects) < TRACKS.most_suspects:
                return "it is improbable given the earlier observations"
            logger.info("obstacle %s: track restarted, it moves otherwise than estimated", name)
            track.learn_anew(track.suspects)
            return None
        track.suspects = []
        if self.sizes is not None:
            self.sizes.learn([track], [one])
        track.insert(one)
        if track.estimator is not None and track.estimator.bank is not None:
            self.judge_noise(track.estimator.bank.differences(np.array([track.estimator.slot])))
        return None

    def remember(self, tracks: Sequence[ObstacleTrack], seen: Sequence[Seen]) -> None:
        """Put down the newest observations of some obstacles, which their bank takes in."""
        self._ready = None
        if self.sizes is not None:
            self.sizes.learn(tracks, seen)
        for track, one in zip(tracks, seen, strict=True):
            track.history.append(one)

    @property
    def wander(self) -> bool:
        """True if any obstacle wanders about a velocity of its own."""
        processes = (track.model.process for track in self.tracks.values() if track.fixed is None)
        return any(one is not None and isinstance(one.process, MeanRevertingVelocity) for one in processes)

    def update(self, name: str, given: Estimate) -> str | None:
        """Take what a tracker says of an obstacle in place of all that was known of it."""
        self._ready, track = None, self.tracks[name]
        if track.given is not None and given.time < track.given.time:
            return "it came too late, after a newer estimate"
        track.follow(given)
        return None

    def prepare(self) -> None:
        """Work out what zones are made from, if they have been asked for since that was done."""
        if self._asked:
            self._learnt()

    def _learnt(self) -> tuple[SortedTracks, list[InitialisedTracks]]:
        if self._ready is None:
            tracks = SortedTracks.of(self.tracks.values(), self.confidence)
            settled = [self._settled(some, tracks.level) for some in tracks.kinds[TrackKind.SETTLED].values()]
            self._ready, self._asked = (tracks, settled), False
        return self._ready

    def zones(self, start: float) -> tuple[ThreatZone, ...]:
        """Zones of all obstacles that have been seen, from a time on, s."""
        tracks, settled = self._learnt()
        self._asked = True
        made = self._together(tracks, settled, start)
        alone = [track for track in tracks.every if track.fixed is None and track.id not in made]
        if alone:
            zones = self._alone(alone, start, tracks.level, tracks.headings)
            made |= zip((track.id for track in alone), zones, strict=True)
        uncertain = tracks.level.estimated
        every = ((made[track.id],) if track.fixed is None else self._given(track, uncertain) for track in tracks.every)
        return tuple(chain.from_iterable(every))

    def _given(self, track: ObstacleTrack, uncertain: int) -> tuple[ThreatZone, ...]:
        """Zones of a track whose motion is given, beside how many that are not known exactly."""
        motion, made = track.fixed, track.made
        assert motion is not None
        if made is None or made.motion is not motion or made.uncertain != uncertain:
            zones = given_zones(track.id, track.shape, track.margin, motion, self.confidence, uncertain)
            track.made = made = GivenZones(motion, uncertain, zones)
        return made.zones

    def _together(
        self, tracks: SortedTracks, settled: Sequence[InitialisedTracks], start: float
    ) -> dict[str, ThreatZone]:
        """Zones of those tracks that can be made together with others."""
        kinds, level = tracks.kinds, tracks.level
        made: dict[str, ThreatZone] = {}
        for those in settled:
            made.update(zip((track.id for track in those.tracks), those.zones(start, level), strict=True))
        for order, some in kinds[TrackKind.ALARMED].items():
            deviation = self.newcomers.acceleration_deviation if self.settings.changes > 0.0 else 0.0
            sizing = None if self.sizes is None else self.sizes.of(some, np.full(len(some), PredictionKind.NOTICED))
            zones = Alarmed(some, self._banks[order], deviation).zones(start, level, sizing)
            for track, zone in zip(some, zones, strict=True):
                track.zone = made[track.id] = zone
        for order, some in kinds[TrackKind.NEW].items():
            for track in some:
                track.zone = None
            made |= newcomers_together(some, self._roots(some), prior_of(self.newcomers, order), start, level)
        return made

    def _settled(self, tracks: Sequence[ObstacleTrack], level: Level) -> InitialisedTracks:
        banked = all(isinstance(track.estimator, NoticingTrack) for track in tracks)
        changes = self._change_hypotheses(tracks, level) if banked else None
        sigma = np.array([track.known_noise for track in tracks])
        motions = PolynomialMotions.of(self._roots(tracks), sigma, self._manoeuvre, changes)
        suspected = np.zeros(len(tracks), dtype=bool) if changes is None else changes.probability > 0.0
        usual = PredictionKind.BELIEVED if banked else PredictionKind.ALONE
        kinds = np.where(suspected, PredictionKind.NOTICED, usual)
        sizing = None if self.sizes is None else self.sizes.of(tracks, kinds)
        return InitialisedTracks(tracks, motions, suspected, sizing)

    def _roots(self, tracks: Sequence[ObstacleTrack]) -> SquareRoots:
        estimators = [track.estimator for track in tracks]
        if all(isinstance(one, NoticingTrack) for one in estimators):
            return rows_of(self._banks[tracks[0].model.order].polynomials.roots, slots_of(tracks))
        return joined([one.roots for one in estimators if one is not None and one.roots is not None])

    def _change_hypotheses(self, tracks: Sequence[ObstacleTrack], level: Level) -> ChangeHypotheses | None:
        """Changes of acceleration of some tracks of one bank that are likely enough to matter."""
        if self.settings.changes <= 0.0:
            return None
        bank, slots = self._banks[tracks[0].model.order], slots_of(tracks)
        some = np.flatnonzero(bank.trend[slots] > CHANGE_HYPOTHESES.looked_at)
        if not len(some):
            return None
        found = changes_among(bank, slots[some], self.newcomers.acceleration_deviation)
        least = CHANGE_HYPOTHESES.left_out * level.alpha
        return found.change_hypotheses(self.settings.changes).among(some, len(tracks), least)

    def _estimate(self, track: ObstacleTrack) -> MotionEstimate:
        try:
            estimate = track.estimate()
            while track.estimates_noise and is_misfit(
                track.times, [one.position for one in track.history], estimate.noise_covariance
            ):
                track.begin_again(len(track.history) // 2)
                estimate = track.estimate()
        except EstimationError:
            track.begin_again(1)
            estimate = track.estimate()
        if isinstance(estimate, PolynomialEstimate) and track.settled:
            return estimate.with_manoeuvre(self._manoeuvre)
        return estimate

    def _alone(self, tracks: Sequence[ObstacleTrack], start: float, level: Level, headings: bool) -> list[ThreatZone]:
        """Zones of tracks, each from an estimate of its own."""
        estimates = predicted_together([self._estimate(track) for track in tracks])
        regions = [self._computed(*one, start, level, headings) for one in zip(tracks, estimates, strict=True)]
        made: dict[int, ThreatZone] = {}
        if self.sizes is not None:
            # what a zone with its heading allows for is no covariance of a position alone
            turn = [headings and track.body.turning is not None for track in tracks]
            some = [k for k, track in enumerate(tracks) if track.given is None and track.settled and not turn[k]]
            sized = self.sizes.sized([tracks[k] for k in some], [regions[k].uncut for k in some])
            made = dict(zip(some, sized, strict=True))
        zones = [region.resized(made.get(k, region.uncut)).zone() for k, region in enumerate(regions)]
        for k, (track, region) in enumerate(zip(tracks, regions, strict=True)):
            if region.stands is not None or made.get(k, region.uncut) is not region.uncut:
                track.zone = zones[k]
            if k in made:
                track.keep_prediction()
        return zones

    def _computed(self, track: ObstacleTrack, estimate: MotionEstimate, *more: Any) -> EstimatedRegion:
        """Region of one track, of its newest observation alone where what was seen makes none."""
        try:
            return self._plain(track, estimate, *more)
        except EstimationError:
            track.begin_again(1)
            return self._plain(track, self._estimate(track), *more)

    def _plain(
        self, track: ObstacleTrack, estimate: MotionEstimate, start: float, level: Level, headings: bool
    ) -> EstimatedRegion:
        """The region of one track, as its model has it."""
        start = max(start, estimate.earliest)
        track.seen_noise = estimate.noise_covariance if track.estimates_noise else None
        body = track.body if headings or track.body.turning is None else replace(track.body, turning=None)
        track.zone, shaped = None, Embodied(track.id, track.shape, body, track.margin, track.model.bounds)
        region = estimated_region(shaped, estimate, self.confidence, level.estimated, start, track.stand)
        near = region.motion.center[0], region.motion.covariance[0]
        track.predicted = Prediction(start, *near, estimate.errors, PredictionKind.ALONE)
        return region

    def learning(self) -> dict[str, Learning]:
        some = [track for track in self.tracks.values() if learns(track)]
        change: dict[str, float] = {}
        if self._manoeuvre > 0.0:
            known = [track for track in some if track.simple and track.settled]
            noise = [least_noise(track.known_noise.tobytes()) for track in known]
            allowed = self._manoeuvre**2 / np.array(noise)
            change = dict(zip((track.id for track in known), allowed.tolist(), strict=True))
        return {
            track.id: Learning(
                track.model.order, len(track.history), track.newest - track.oldest, change.get(track.id, 0.0)
            )
            for track in some
        }

    def _predicted(self, zone: ThreatZone) -> Course:
        """Give a zone as a course whose own zone, at the same level, is nowhere larger."""
        uncertain = sum(track.uncertain for track in self.tracks.values() if track.seen)
        assert zone.covariances is not None, "it is estimated"
        begin, *breaks, _ = zone.covariances.breakpoints[0]
        times = np.unique(np.concatenate([begin + PREDICTED_TIMES, breaks, np.subtract(breaks, JUMP)]))
        times = times[times >= begin]
        scale = marginal_scale(str(self.confidence.level), self.confidence.probability, len(times), uncertain)
        covariances = zone.covariance(times) / (scale * (1.0 + TRACKS.interpolated))
        return Course.model_construct(
            time=tuple(times.tolist()),
            position=tuple((x, y) for x, y in zone.center(times).tolist()),
            covariance=tuple(_matrix(one) for one in covariances),
        )

    def as_obstacles(self) -> tuple[Obstacle, ...]:
        """Give what is known as obstacles of a scenario, with the planner's margin."""
        return tuple(self._as_obstacle(track) for track in self.tracks.values() if track.seen)

    def _as_obstacle(self, track: ObstacleTrack) -> Obstacle:
        common: dict[str, Any] = {"id": track.id, "shape": track.shape, "margin": track.margin}
        if track.fixed is not None:
            return Obstacle.model_construct(**common, motion=track.fixed, observations=None, model=track.model)
        if track.zone is not None:
            course = self._predicted(track.zone)
            return Obstacle.model_construct(**common, motion=course, observations=None, model=track.model)
        if track.given is not None:
            change = {} if track.model.process is not None else {"manoeuvre": self._manoeuvre}
            model = track.model.model_copy(update=change)
            return Obstacle.model_construct(**common, motion=None, observations=None, estimate=track.given, model=model)
        each: Any = None
        if track.varying or not track.settled:
            each = tuple(_matrix(track.noise_of(one.covariance)) for one in track.history)
        elif track.covariance is not None:
            each = _matrix(track.known_noise)
        model = track.model
        if model.process is None and track.settled:
            model = model.model_copy(update={"manoeuvre": self._manoeuvre})
        if model.prior is None and model.process is None and not track.settled:
            new = self.newcomers
            prior = Prior(velocity_deviation=new.velocity_deviation, acceleration_deviation=new.acceleration_deviation)
            model = model.model_copy(update={"prior": prior})
        positions = tuple(one.position for one in track.history)
        seen = Observations.model_construct(time=tuple(track.times), position=positions, covariance=each)
        return Obstacle.model_construct(**common, motion=None, observations=seen, model=model)


def _matrix(values: Array) -> tuple[Vector, Vector]:
    (xx, xy), (yx, yy) = values.tolist()
    return (xx, xy), (yx, yy)
