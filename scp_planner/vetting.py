"""What may be driven: trips that are certified to the goal, or that a certified stop can be made from.

A stop from a trip keeps to it for a while, then brakes along its path until the vehicle stands. It need not begin at
once: between two obstacles there is no place to stop, but there is behind them, and a trip that is certified past both
and can be stopped after that is safe. Obstacles are where they will be within a few seconds, while a trip to a far goal
would have to be clear of zones that have grown for as long as it takes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scp_planner.braking import fits, room_to_stop, standing_from, stop_after
from scp_planner.certificate import Certificate, Ends, certify_trip
from scp_planner.evaluation import Evaluation
from scp_planner.frames import PlanningFrame
from scp_planner.plan import Clearance, Trip
from scp_planner.problem import Problem
from scp_planner.remaining import State
from scp_planner.scenario import Scenario
from scp_planner.scp import FEASIBILITY
from scp_planner.trajectory import Trajectory
from scp_planner.zones import ThreatZone, ZoneBatch

Array = NDArray[np.float64]

STOPS = 8
COMMITMENT = 1.75
"""s. A stop may leave a trip so much later than at the next replan. So many stops are looked at..."""
STOPS_TRIED = 2
"""...and so many certified, at most."""
NEAR = 0.1
"""m. Sampled clearances beyond this need not be exact."""
NOTHING = 1e-6
"""m."""
TINY = 1e-9
"""s."""


@dataclass(frozen=True)
class Moment:
    """A moment of a drive, as the planner sees it.

    Attributes
    ----------
    state : State
    scenario : Scenario
        That starts with this state; without obstacles.
    zones : tuple of ThreatZone
    """

    state: State
    scenario: Scenario
    zones: tuple[ThreatZone, ...]

    @cached_property
    def frame(self) -> PlanningFrame:
        """The planning frame of trips that begin now."""
        return PlanningFrame.between(self.state.position, self.scenario.goal.position, self.state.time)

    @cached_property
    def batch(self) -> ZoneBatch:
        """The zones in this frame, inflated by the vehicle."""
        return ZoneBatch(self.zones, self.frame, self.scenario.vehicle.radius)

    @property
    def growing(self) -> bool:
        """Whether any zone grows."""
        return self.batch.covariances is not None

    def certify(
        self,
        trip: Trip,
        *,
        since: float | None = None,
        until: float | None = None,
        ends: Ends = Ends.BOTH,
    ) -> Certificate:
        """Certify a trip; see `certify_trip`."""
        return certify_trip(
            self.scenario,
            trip,
            self.zones,
            since=since,
            until=until,
            ends=ends,
            precision=math.inf,
            batch=self.batch if trip.frame == self.frame else None,
        )


@dataclass(frozen=True)
class Stop:
    """A stop, and the absolute time up to which it keeps to its trip, s."""

    trip: Trip
    branch: float

    @property
    def stands(self) -> float:
        """Absolute time from which on the vehicle stands, s."""
        return self.trip.frame.time + standing_from(self.trip.trajectory)


@dataclass(frozen=True)
class Vetted:
    """A trip that may be driven.

    Attributes
    ----------
    trip : Trip
    certificate : Certificate
        Of the trip, or of its stop if that is all that is certified.
    stop : Stop or None
        The certified stop; None for a trip that is certified to the goal.
    violation : float
        How much the trip enters foreseen zones, m, or exceeds limits, as far as samples tell.
    iterations : int
    """

    trip: Trip
    certificate: Certificate
    stop: Stop | None
    violation: float = math.inf
    iterations: int = 0

    @property
    def feasible(self) -> bool:
        """Whether the trip keeps clear of foreseen zones."""
        return self.violation <= FEASIBILITY

    @property
    def certified(self) -> bool:
        """Whether the trip is certified to the goal."""
        return self.stop is None and self.certificate.holds

    @property
    def arrival(self) -> float:
        """Absolute time, s."""
        return self.trip.frame.time + self.trip.trajectory.travel_time


@dataclass(frozen=True)
class Refusal:
    """Why a trip may not be driven, in words."""

    why: str


class Vetting:
    """Decides what may be driven.

    Parameters
    ----------
    period : float
        Longest time to the next replan, s.
    stops_will_do : bool
        Whether a trip that can be stopped will do; else it must be certified to the goal.
    tracking_error : float
        m.
    """

    def __init__(self, period: float, stops_will_do: bool, tracking_error: float) -> None:
        self.period = period
        self.stops_will_do = stops_will_do
        self.tracking_error = tracking_error

    def vet(
        self,
        now: Moment,
        problem: Problem,
        trajectory: Trajectory,
        evaluation: Evaluation | None = None,
        iterations: int = 0,
        branch: float = math.inf,
    ) -> Vetted | Refusal:
        """Certify a trip that begins now, or at least a stop from it.

        Parameters
        ----------
        now : Moment
        problem : Problem
        trajectory : Trajectory
        evaluation : Evaluation, optional
            Of it, if it is at hand.
        iterations : int
            That it took.
        branch : float
            Absolute time at which the stop from the last plan leaves it, s: tried first.

        Returns
        -------
        Vetted or Refusal
        """
        trip = Trip(problem.frame, trajectory)
        violation = math.inf if evaluation is None else evaluation.worst_violation
        why = ""
        if not self.stops_will_do or self._may_hold(now, evaluation):
            certificate = now.certify(trip)
            if certificate.holds:
                return Vetted(trip, certificate, None, violation, iterations)
            why = _violations(certificate)
            if not self.stops_will_do:
                return Refusal(why)
        found = self._stop(now, problem, trajectory, branch)
        if isinstance(found, Refusal):
            return Refusal("; ".join(part for part in (why, f"no stop from it: {found.why}") if part))
        stop, certificate = found
        return Vetted(trip, certificate, stop, violation, iterations)

    @staticmethod
    def _may_hold(now: Moment, evaluation: Evaluation | None) -> bool:
        """Whether a trip keeps clear of the zones at samples; if not, no certificate is needed to refuse it."""
        if evaluation is None or evaluation.worst_violation > FEASIBILITY:
            return evaluation is None
        if not now.growing:
            return True
        points = evaluation.points
        return bool(now.batch.distances(points.time, points.path.position, NEAR).min() >= 0.0)

    def _stop(
        self, now: Moment, problem: Problem, trajectory: Trajectory, branch: float
    ) -> tuple[Stop, Certificate] | Refusal:
        """A certified stop from a trip: the one that the last plan had, or the one with most room of a few."""
        deceleration = problem.limits.deceleration
        why = "the goal is nearer than the distance to stop in"
        for lead in self._leads(now, trajectory, branch, deceleration):
            stop = stop_after(trajectory, lead, deceleration)
            if not fits(stop):
                continue
            made = Stop(Trip(problem.frame, stop), now.state.time + lead)
            certificate = now.certify(made.trip, until=made.stands, ends=Ends.START)
            if certificate.holds:
                return made, certificate
            why = _violations(certificate)
        return Refusal(why)

    def _leads(self, now: Moment, trajectory: Trajectory, branch: float, deceleration: float) -> Iterator[float]:
        """Times after which a stop may leave a trip, s, the most promising first."""
        least = self.period
        if least <= branch - now.state.time <= least + COMMITMENT:
            yield branch - now.state.time
        leads = np.minimum(least + COMMITMENT * np.arange(STOPS) / (STOPS - 1), trajectory.travel_time)
        room = room_to_stop(trajectory, leads, deceleration, now.batch)
        for index in np.argsort(-room, kind="stable")[:STOPS_TRIED]:
            if room[index] >= 0.0:
                yield float(leads[index])

    def vet_kept(self, now: Moment, last: Trip) -> Vetted | None:
        """The last trip as it is, if the vehicle is where it should be and the certificate holds from now on."""
        if not self.is_on(now, last):
            return None
        certificate = now.certify(last, since=now.state.time)
        return Vetted(last, certificate, None) if certificate.holds else None

    def vet_kept_stop(self, now: Moment, last: Trip, stop: Stop) -> Vetted | None:
        """The last trip as it is, if it can be followed for a period more and its stop still be made."""
        if now.state.time + self.period > stop.branch + TINY or not self.is_on(now, last):
            return None
        certificate = now.certify(stop.trip, since=now.state.time, until=stop.stands, ends=Ends.START)
        return Vetted(last, certificate, stop) if certificate.holds else None

    def is_on(self, now: Moment, trip: Trip) -> bool:
        """Whether the vehicle is where a trip has it."""
        points, _ = trip.at(now.state.time)
        x, y = trip.frame.to_world(points.path.position)[0]
        return math.hypot(now.state.position[0] - x, now.state.position[1] - y) <= self.tracking_error + NOTHING


def _violations(certificate: Certificate) -> str:
    return "; ".join(str(violation) for violation in certificate.violations)


def no_certificate(zones: tuple[ThreatZone, ...]) -> Certificate:
    """The certificate of something that has not been looked at."""
    return Certificate(False, Clearance(-math.inf if zones else math.inf), {}, ())


def refused(certificate: Certificate) -> Certificate:
    """The same certificate, not holding."""
    return replace(certificate, holds=False)
