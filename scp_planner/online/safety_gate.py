"""Trips that may be driven: certified to the goal, or to a certified stop on the way."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array, Mask
from scp_planner.certificate.check import certify_trip
from scp_planner.certificate.checked_trip import Scope
from scp_planner.certificate.remembered import Motions
from scp_planner.certificate.verdict import Certificate, Ends
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.following import Deviation, Following
from scp_planner.online.moving_goal import MovingGoal
from scp_planner.online.reasons import REASONS, Reason
from scp_planner.online.remaining import State, TripSamples
from scp_planner.online.stops import (
    STOPS,
    Braking,
    braking_of,
    leaving,
    spans_between,
    standing_from,
    standing_trip,
    surely_clear,
)
from scp_planner.online.tolerances import TIME
from scp_planner.prediction.foresight import foreseen, smaller
from scp_planner.scenario.models import Passage, Scenario
from scp_planner.scenario.units import changed
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.record import FEASIBILITY
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.error_tube import TrackingTube
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class SafetyGateParameters:
    stops: int = 8  # Stops from a trip that are evaluated by samples
    commitment: float = 3.0  # Units of time: a stop may leave a trip so much later than at the next replan
    stops_tried: int = 2  # Stops from a trip that are certified, at most
    plenty: float = 0.5  # Units of length. Stops with more room than this are as good as each other
    trip_samples: int = 48  # Samples of the last trip
    # Units of length. A trip that enters foreseen zones, which come and go with each observation, by no more may be
    # kept for a while
    deep: float = 0.1
    halvings: int = 6  # Of the speed at the end of a trip, to one from which the vehicle can stop behind it


SAFETY_GATE = SafetyGateParameters()
_SHARES = np.linspace(0.0, 1.0, SAFETY_GATE.trip_samples)


@dataclass(frozen=True)
class Moment:
    """A moment of a drive, as the planner sees it."""

    state: State
    scenario: Scenario
    zones: tuple[ThreatZone, ...]
    tube: TrackingTube | None = None
    moving: MovingGoal | None = None  # The goal, where that moves
    lost: Reason | None = None  # Why there is no goal to plan to
    passing: tuple[Passage, ...] = ()  # Places on the way as they have to be passed, where the scenario's are narrower
    onward: bool = False  # The vehicle stands at the goal before it drives on
    whole: Moment | None = None
    share: float = 1.0

    @cached_property
    def frame(self) -> PlanningFrame:
        """The planning frame of trips that begin now."""
        return PlanningFrame.between(self.state.position, self.scenario.goal.position, self.state.time)

    @property
    def batch(self) -> ZoneBatch:
        """The zones in this frame, inflated by the vehicle."""
        return self.batch_in(self.frame)

    @cached_property
    def speeds(self) -> Array:
        """Speeds of the zones of the batch now, (L,) m/s."""
        return np.hypot(*self.batch.velocities.grid(np.zeros(1))[0].T)

    @property
    def stands(self) -> Mask:
        """True of the zones of the batch that stand or hardly move, (L,)."""
        return self.speeds < REASONS.still * self.scenario.vehicle.max_speed

    @cached_property
    def _batches(self) -> dict[PlanningFrame, ZoneBatch]:
        return {}

    def batch_in(self, frame: PlanningFrame) -> ZoneBatch:
        batch = self._batches.get(frame)
        if batch is None:
            if self.whole is None:
                batch = ZoneBatch.of(self.zones, frame, self.scenario.vehicle.radius)
            else:
                batch = smaller(self.whole.batch_in(frame), self.share)
            self._batches[frame] = batch
        return batch

    def with_smaller_zones(self, share: float) -> Moment:
        return replace(self, whole=self, share=share)

    @cached_property
    def _deviations(self) -> dict[int, tuple[Trip, Deviation]]:
        return {}

    def deviation(self, trip: Trip) -> Deviation:
        """Compare the reported state with a trip."""
        known = self._deviations.get(id(trip))
        if known is None:
            known = self._deviations[id(trip)] = trip, Deviation.of(self.state, trip, self.scenario.vehicle)
        return known[1]

    @property
    def growing(self) -> bool:
        """True if any zone grows."""
        return self.batch.covariances is not None

    def certify(
        self,
        trip: Trip,
        *,
        since: float | None = None,
        until: float | None = None,
        ends: Ends = Ends.BOTH,
        motions: Motions | None = None,
    ) -> Certificate:
        scenario = self.scenario
        if self.passing:
            scenario = changed(scenario, goals=self.passing)
        if self.moving is not None:
            arrival = trip.frame.time + trip.trajectory.travel_time
            scenario = changed(scenario, goal=self.moving.accepted(arrival))
        return certify_trip(
            scenario,
            trip,
            self.zones,
            Scope(since, until, ends, math.inf, tube=self.tube),
            batch=self.batch_in(trip.frame),
            motions=motions,
        )

    def certify_standing(self, trip: Trip, since: float, wait: float, unseen_until: float) -> Certificate | None:
        """Certify standing where a trip stands, against zones that do not grow any more: who stands sees them come."""
        if wait <= 0.0 or not self.zones:
            return None
        ahead = max(map(abs, self.scenario.vehicle.discs))
        batch, grows = self.batch_in(trip.frame), max(unseen_until - since, 0.0)
        (position,) = trip.positions_at(np.array([since]))
        if surely_clear(batch, position, (since - trip.frame.time, grows, wait), ahead):
            return None
        points, _ = trip.at(since)
        (place,) = trip.frame.to_world(points.path.position).tolist()
        heading = trip.frame.vectors_to_world(points.path.direction)[0]
        frame = PlanningFrame((place[0], place[1]), math.atan2(heading[1], heading[0]), since)
        stands = standing_trip(trip, frame, wait)
        still = foreseen(self.batch_in(frame), grows, {})
        certificate = certify_trip(
            self.scenario, stands, self.zones, Scope(ends=Ends(0), precision=math.inf), batch=still
        )
        return None if certificate.holds else certificate


@dataclass(frozen=True)
class Stop:
    """A stop, and the absolute time up to which it keeps to its trip, s."""

    trip: Trip
    branch: float

    @cached_property
    def stands(self) -> float:
        """Absolute time from which on the vehicle stands, s."""
        return self.trip.frame.time + standing_from(self.trip.trajectory)


@dataclass(frozen=True)
class Vetted:
    """A trip that may be driven."""

    trip: Trip
    certificate: Certificate
    stop: Stop | None  # The certified stop; None for a trip that is certified to the goal
    violation: float = math.inf
    iterations: int = 0

    @property
    def feasible(self) -> bool:
        """True if the trip keeps clear of foreseen zones."""
        return self.violation <= FEASIBILITY

    @property
    def certified(self) -> bool:
        return self.stop is None and self.certificate.holds

    @property
    def arrival(self) -> float:
        """Absolute time, s."""
        return self.trip.frame.time + self.trip.trajectory.travel_time


@dataclass(frozen=True)
class Refusal:
    """Why a trip may not be driven."""

    why: Certificate | str
    room: float = math.inf


@dataclass
class _Tried:
    refused: Certificate | str = ""
    otherwise: str = ""
    room: float = math.inf

    @property
    def why(self) -> Certificate | str:
        """Why none of those that were tried to certify will do; or why none was."""
        return self.refused or self.otherwise


class SafetyGate:
    def __init__(
        self,
        period: float,
        stops_will_do: bool,
        following: Following,
        wait: float = 0.0,
        stop_from: Callable[[State], Trip] | None = None,
    ) -> None:
        """``stop_from`` makes the stop behind the end of a trip; None: no end needs one."""
        self._stop_from = stop_from
        self.fastest_end = math.inf  # m/s, from which the vehicle can stop behind the last trip that was refused there
        self._stops_behind: tuple[object, ...] = ()  # The last trip behind which it can, and all that this depends on
        self.wait = wait
        self.period = period
        self.stops_will_do = stops_will_do
        self.following = following
        self.motions = Motions()

    def vet(
        self,
        now: Moment,
        frame: PlanningFrame,
        trajectory: Trajectory,
        evaluation: Evaluation | None = None,
        iterations: int = 0,
        branch: float = math.inf,
    ) -> Vetted | Refusal:
        """Certify a trip that begins now, or at least a stop from it."""
        trip = Trip(frame, trajectory.settled())
        violation = math.inf if evaluation is None else evaluation.worst_violation
        broken = math.inf
        if not self.stops_will_do or self._may_hold(now, trip, evaluation):
            certificate = self._certify_whole(now, trip)
            if certificate.holds:
                return Vetted(trip, certificate, None, violation, iterations)
            if not self.stops_will_do:
                return Refusal(certificate)
            broken = min((one.time for one in certificate.violations), default=math.inf)
        found = self._stop(now, trip, branch, broken)
        if isinstance(found, Refusal):
            return found
        stop, certificate = found
        return Vetted(trip, certificate, stop, violation, iterations)

    def _may_hold(self, now: Moment, trip: Trip, evaluation: Evaluation | None) -> bool:
        """True if a trip keeps clear of the zones at samples; if not, no certificate is needed to refuse it."""
        if evaluation is None:
            ahead = TripSamples.of(trip, _SHARES)
            return bool(now.batch.distances(ahead.time, ahead.position, 0.0).min(initial=np.inf) >= 0.0)
        if evaluation.worst_violation > FEASIBILITY:
            return False
        if not now.growing:
            return True
        points = evaluation.points
        return bool(now.batch.distances(points.time, points.path.position, 0.0).min() >= 0.0)

    def _stop(
        self, now: Moment, trip: Trip, branch: float, broken: float = math.inf
    ) -> tuple[Stop, Certificate] | Refusal:
        """A certified stop from a trip: the one that the last plan had, or the one with most room of a few."""
        driven = now.state.time - trip.frame.time
        braking = braking_of(now.scenario.vehicle)
        since = now.state.time if driven > 0.0 else None
        tried = _Tried()
        for spans in self._spans(now, trip, braking, branch, tried):
            left = leaving(trip, braking, spans)
            if left is None:
                continue
            if left[1] >= broken:
                tried.refused = tried.refused or "no stop leaves it before that"
                continue
            made = Stop(*left)
            certificate = self.certify_stop(now, made, since)
            if certificate.holds:
                return made, certificate
            tried.refused = certificate
            broken = min([broken, *(one.time for one in certificate.violations if one.time < made.branch)])
        return Refusal(tried.why, tried.room)

    def _spans(self, now: Moment, trip: Trip, braking: Braking, branch: float, tried: _Tried) -> Iterator[int]:
        breaks = trip.trajectory.space.acceleration.breakpoints * trip.trajectory.travel_time
        driven = now.state.time - trip.frame.time
        earliest = driven + self.period
        spans = spans_between(breaks, earliest - TIME, earliest + SAFETY_GATE.commitment, SAFETY_GATE.stops)
        if not len(spans):
            tried.otherwise = "the goal is nearer than the distance to stop in"
            return
        if breaks[spans[0]] <= branch - trip.frame.time <= breaks[spans[-1]]:
            before = int(np.searchsorted(breaks, branch - trip.frame.time - TIME))
            # That of the last plan held a moment ago; of a new trip samples are asked first, which are soon looked at.
            left = None if driven > 0.0 else leaving(trip, braking, before)
            if left is None or np.isinf(self.clear_for(now, Stop(*left))):
                yield before
        batch = now.batch_in(trip.frame)
        room = braking.room(trip.trajectory, breaks[spans], batch, driven, self.wait)
        tried.room = float(room.max())
        # The latest of those with plenty of room: it will do for the most replans.
        order = np.lexsort((-spans, -np.minimum(room, SAFETY_GATE.plenty)))
        if np.isneginf(tried.room):
            tried.otherwise = "the goal is nearer than the distance to stop in"
        else:
            tried.otherwise = "no stop from it keeps clear"
        for index in order[: SAFETY_GATE.stops_tried]:
            if room[index] >= 0.0:
                yield int(spans[index])

    def most_room(self, now: Moment, trip: Trip) -> float:
        """The most room that one of the stops from a trip has, m, as far as samples tell; -inf where there is none."""
        tried = _Tried(room=-math.inf)
        next(self._spans(now, trip, braking_of(now.scenario.vehicle), math.inf, tried), None)
        return tried.room

    def vet_on(
        self, now: Moment, last: Trip, foresee: Callable[[ZoneBatch, float], ZoneBatch], branch: float, whole: bool
    ) -> Vetted | None:
        """The last trip as it is, with a new stop if need be, as long as it is not far inside of foreseen zones."""
        if whole:
            # What is certified keeps clear of foreseen zones too, which are no larger
            if not self.is_on(now, last):
                return None
            certificate = self._certify_whole(now, last, now.state.time)
            if certificate.holds:
                return Vetted(last, certificate, None, 0.0)
        if not self.stops_will_do:
            return None
        ahead = self._ahead(now, last)
        if ahead is None:
            return None
        batch = now.batch_in(last.frame)
        violation = 0.0
        if batch.size:
            driven = now.state.time - last.frame.time
            violation = -float(foresee(batch, driven).distances(ahead.time, ahead.position, 0.0).min())
        if violation > SAFETY_GATE.deep:
            return None
        found = self._stop(now, last, branch)
        if isinstance(found, Refusal):
            return None
        return Vetted(last, found[1], found[0], max(violation, 0.0))

    def vet_kept(self, now: Moment, last: Trip) -> Vetted | None:
        """The last trip as it is, if the vehicle is where it should be and the certificate holds from now on."""
        ahead = self._ahead(now, last)
        if ahead is None:
            return None
        batch = now.batch_in(last.frame)
        if batch.size and batch.distances(ahead.time, ahead.position, 0.0).min() < 0.0:
            return None
        certificate = self._certify_whole(now, last, now.state.time)
        return Vetted(last, certificate, None, 0.0) if certificate.holds else None

    def vet_kept_stop(self, now: Moment, last: Trip, stop: Stop) -> Vetted | None:
        """The last trip as it is, if it can be followed for a period more and its stop still be made."""
        if now.state.time + self.period > stop.branch + TIME or not self.is_on(now, last):
            return None
        if np.isfinite(self.clear_for(now, stop)):
            return None
        certificate = self.certify_stop(now, stop, now.state.time)
        return Vetted(last, certificate, stop) if certificate.holds else None

    def unseen_until(self, now: Moment) -> float:
        """Absolute time of the next replan at the latest, s: zones grow up to then, whatever the vehicle does."""
        return now.state.time + self.period

    def certify_stop(self, now: Moment, stop: Stop, since: float | None) -> Certificate:
        """Certify a stop from an absolute time on, s, or its start, until the vehicle has stood for long enough."""
        certificate = now.certify(stop.trip, since=since, until=stop.stands, ends=Ends.START, motions=self.motions)
        if not certificate.holds or self.wait <= 0.0:
            return certificate
        begins = max(stop.stands, now.state.time)
        stands = now.certify_standing(stop.trip, begins, stop.stands + self.wait - begins, self.unseen_until(now))
        return certificate if stands is None else replace(stands, limits=certificate.limits)

    def _certify_whole(self, now: Moment, trip: Trip, since: float | None = None) -> Certificate:
        """Certify a trip up to its end, and the stand there where the vehicle then drives on."""
        certificate = now.certify(trip, since=since, motions=self.motions)
        if not certificate.holds:
            return certificate
        behind = self._certify_behind(now, trip)
        if behind is not None or not now.onward:
            return behind or certificate
        end = trip.frame.time + trip.trajectory.travel_time
        stands = now.certify_standing(trip, max(end, now.state.time), self.wait, self.unseen_until(now))
        return certificate if stands is None else replace(stands, limits=certificate.limits)

    def _certify_behind(self, now: Moment, trip: Trip) -> Certificate | None:
        """Certify the stop behind a trip that ends at speed, among all whose motion is known; None where it holds."""
        stop_from, scenario = self._stop_from, now.scenario
        known = tuple(zone for zone in now.zones if zone.covariances is None)
        around = (*known, scenario.bounds, scenario.corridor, scenario.ground)
        asked = (trip, scenario.vehicle, now.tube, *around)
        seen = len(asked) == len(self._stops_behind) and all(map(operator.is_, asked, self._stops_behind))
        if stop_from is None or seen or not any(one is not None for one in around):
            return None
        end = State.at_end(trip)
        if end.speed <= STOPS.standing:
            return None

        def certificate(speed: float) -> Certificate:
            scope = Scope(ends=Ends(0), precision=math.inf, tube=now.tube)
            found = certify_trip(scenario, stop_from(replace(end, speed=speed)), known, scope)
            leaves = tuple(one for one in found.violations if not one.is_of_limit)
            return replace(found, holds=not leaves, violations=leaves)

        found = certificate(end.speed)
        if found.holds:
            self._stops_behind = asked
            return None
        low, high = 0.0, end.speed
        for _ in range(SAFETY_GATE.halvings):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if certificate(middle).holds else (low, middle)
        self.fastest_end = low
        return found

    def clear_for(self, now: Moment, stop: Stop) -> float:
        trip = stop.trip
        times = np.linspace(now.state.time, stop.stands + self.wait, SAFETY_GATE.trip_samples)
        grown = max(stop.stands, self.unseen_until(now)) - trip.frame.time
        batch = foreseen(now.batch_in(trip.frame), grown, {})
        away = batch.distances(times - trip.frame.time, trip.positions_at(times), 0.0)
        entered = away.min(axis=1, initial=np.inf) < 0.0
        return float(times[entered.argmax()] - times[0]) if entered.any() else math.inf

    def _ahead(self, now: Moment, trip: Trip) -> TripSamples | None:
        """Samples of what is left of a trip, if the vehicle is on it."""
        if not self.is_on(now, trip):
            return None
        first = min(max((now.state.time - trip.frame.time) / trip.trajectory.travel_time, 0.0), 1.0)
        return TripSamples.of(trip, first + (1.0 - first) * _SHARES)

    def is_on(self, now: Moment, trip: Trip) -> bool:
        """True if the reported state is that of a trip, within the tolerances of the follower."""
        return self.following.allows(now.deviation(trip))
