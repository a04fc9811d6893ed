"""Fallbacks where nothing better than the last plan is found: that plan, its path slower, or a stop."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from scp_planner.certificate.verdict import Certificate, Ends
from scp_planner.online.evasion import Evasion, Manoeuvre
from scp_planner.online.means import Means, Renewal, Replan
from scp_planner.online.plan import AWAY, OnlinePlan, Outcome
from scp_planner.online.reasons import CandidateKind, Reason
from scp_planner.online.remaining import eased
from scp_planner.online.safety_gate import Refusal, Stop, Vetted
from scp_planner.online.stops import STOPS, fits
from scp_planner.online.tolerances import TIME
from scp_planner.problem.problem import Problem
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class FallbackParameters:
    # Shares of the planned acceleration that are tried to repair a plan; the rest is braking
    easings: tuple[float, ...] = (0.4, 0.0)
    # Radii of the vehicle by which every stop from a trip is inside of zones that is not driven slower
    deep: float = 2.0
    # Radii by which every stop is inside of zones from a trip that is driven slower, that is not driven still slower
    hopeless: float = 1.0


FALLBACK = FallbackParameters()


class Fallback:
    def __init__(self, means: Means) -> None:
        self._means = means
        self._evasion = Evasion(means)
        self._whom: str | None = None  # for which obstacle the last evasive manoeuvre was

    def be_patient(self, waited: float) -> None:
        self._evasion.outlooks.be_patient(waited)

    def fall_back(self, now: Replan, fresh: Renewal, last: OnlinePlan | None, refusal: Refusal) -> OnlinePlan:
        """Keep the last plan, or drive its path slower, or brake."""
        moment = now.moment
        if last is not None:
            kept = self._means.kept(now, last)
            if kept is None and last.stop is not None:
                kept = self._means.safety_gate.vet_kept_stop(moment, last.trip, Stop(last.stop, last.branch_time))
                self._means.consider(now, CandidateKind.LAST, last.trip, kept)
            if kept is not None:
                return self._means.plan_of(kept, now, Outcome.KEPT)
        deep = -np.inf < refusal.room < -FALLBACK.deep * moment.scenario.vehicle.radius
        if last is not None and fresh.ahead is not None and not deep:
            repaired = self._repair(now, fresh.problem, fresh.ahead)
            if repaired is not None:
                return self._means.plan_of(repaired, now, Outcome.REPAIRED)
        return self._give_way(now, fresh)

    def go_on(self, now: Replan) -> OnlinePlan | None:
        """Go on with the manoeuvre that was begun, or stand, without a look at others; None if it is not certified."""
        begun = self._evasion.begun(now)
        if now.last is None:
            return None
        if begun is None:
            if now.last.outcome is not Outcome.BRAKING or now.moment.state.speed > STOPS.standing:
                return None
            stop = self._means.stopping(now, self._means.straight_stop(now.moment.state, self._means.braking), None)
            return stop if stop.safe else None
        certificate = self._means.safety_gate.certify_stop(now.moment, begun, now.moment.state.time)
        now.lap("certificate")
        self._means.consider(now, CandidateKind.EVASION, begun.trip, certificate)
        if not certificate.holds:
            return None
        whole = Stop(begun.trip, begun.trip.frame.time + begun.trip.trajectory.travel_time)
        return self._means.plan_of(Vetted(begun.trip, certificate, whole, 0.0), now, now.last.outcome, self._whom)

    def leave(self, now: Replan, reason: Reason | None = None) -> OnlinePlan | None:
        """Get out of the way along a certified manoeuvre; None if none is certified."""
        manoeuvre = self._evasion.safest(now)
        return None if manoeuvre is None else self._dodging(now, manoeuvre, reason)

    def sooner(self, now: Replan, plan: OnlinePlan) -> OnlinePlan:
        """Get out of the way where that is clearly better than a plan that would do."""
        manoeuvre = self._evasion.sooner(now, plan.trip)
        return plan if manoeuvre is None else self._dodging(now, manoeuvre)

    def _dodging(self, now: Replan, manoeuvre: Manoeuvre, reason: Reason | None = None) -> OnlinePlan:
        stop = Stop(manoeuvre.trip, manoeuvre.trip.frame.time + manoeuvre.trip.trajectory.travel_time)
        self._whom, vetted = manoeuvre.threat, Vetted(manoeuvre.trip, manoeuvre.certificate, stop, 0.0)
        return self._means.plan_of(vetted, now, manoeuvre.outcome, manoeuvre.threat, reason)

    def _give_way(self, now: Replan, fresh: Renewal) -> OnlinePlan:
        """Get out of the way, or stand where that is as safe; or else do what does least harm."""
        safe = self.leave(now)
        if safe is not None:
            return safe
        promised = self._as_promised(now)
        if promised is not None:
            return self._means.plan_of(promised, now, Outcome.BRAKING)
        found = [(each, self._certify_stop(now, each)) for each in self._goes_on(now)]
        for trip in () if now.moment.state.speed <= STOPS.standing else self._stops(now, fresh):
            stop = Stop(trip, trip.frame.time + trip.trajectory.travel_time)
            if stop.stands > now.moment.state.time:
                certificate = self._certify_stop(now, stop)
                if certificate.holds and self._evasion.stays_clear(now, stop):
                    return self._means.plan_of(Vetted(trip, certificate, stop, 0.0), now, Outcome.BRAKING)
                found.append((stop, certificate))
            if not now.has_time("fallback", "certificate"):
                break
        fewest = min((certificate.limits_broken for _, certificate in found), default=0)
        return self._least_harmful(now, [stop for stop, each in found if each.limits_broken == fewest])

    def _certify_stop(self, now: Replan, stop: Stop) -> Certificate:
        since = now.moment.state.time if stop.trip.frame.time < now.moment.state.time else None
        certificate = self._means.safety_gate.certify_stop(now.moment, stop, since)
        now.lap("certificate")
        self._means.consider(now, CandidateKind.STOP, stop.trip, certificate)
        return certificate

    def _least_harmful(self, now: Replan, others: list[Stop]) -> OnlinePlan:
        begun = self._evasion.begun(now)
        least = self._evasion.least_harmful(now, others)
        goes_on = begun is not None and least.trip is begun.trip
        manoeuvre = self._evasion.as_manoeuvre(now, begun) if begun is not None and goes_on else least
        if isinstance(manoeuvre, Stop):
            return self._harmful(now, manoeuvre)
        if manoeuvre.safe:  # it was none of those that were tried to certify
            return self._dodging(now, manoeuvre)
        return self._means.plan_of(
            Vetted(manoeuvre.trip, manoeuvre.certificate, None), now, manoeuvre.outcome, manoeuvre.threat
        )

    def _harmful(self, now: Replan, stop: Stop) -> OnlinePlan:
        """The plan of the last trip, which is not safe, or of a stop."""
        moment, trip = now.moment, stop.trip
        since = moment.state.time if trip.frame.time < moment.state.time else None
        certificate = moment.certify(
            trip, since=since, until=stop.stands, ends=Ends.START, motions=self._means.safety_gate.motions
        )
        now.lap("certificate")
        failed, goes_on = replace(certificate, holds=False), now.last is not None and trip is now.last.trip
        self._means.consider(now, CandidateKind.LAST if goes_on else CandidateKind.STOP, trip, failed)
        if goes_on:
            return self._means.plan_of(Vetted(trip, failed, None), now, Outcome.KEPT)
        return self._means.plan_of(Vetted(trip, certificate, None), now, Outcome.BRAKING)

    def _goes_on(self, now: Replan) -> list[Stop]:
        begun, last = self._evasion.begun(now), now.last
        if begun is not None:
            return [begun]
        if last is None or last.outcome in AWAY or not self._means.safety_gate.is_on(now.moment, last.trip):
            return []
        return [Stop(last.trip, last.trip.frame.time)]

    def _as_promised(self, now: Replan) -> Vetted | None:
        """The last plan's stop, if it still holds."""
        moment, last = now.moment, now.last
        if last is None or last.stop is None:
            return None
        stop = Stop(last.stop, last.branch_time)
        begun = moment.state.time > stop.branch + TIME
        if begun or stop.stands <= moment.state.time or not self._means.safety_gate.is_on(moment, stop.trip):
            return None
        certificate = self._means.safety_gate.certify_stop(moment, stop, moment.state.time)
        self._means.consider(now, CandidateKind.STOP, stop.trip, certificate)
        # From now on it is this stop that is driven, up to its end.
        whole = Stop(stop.trip, stop.trip.frame.time + stop.trip.trajectory.travel_time)
        return Vetted(stop.trip, certificate, whole, 0.0) if certificate.holds else None

    def _repair(self, now: Replan, problem: Problem, ahead: Trajectory) -> Vetted | None:
        """Drive the same path slower: ease off for a while, then go on, or stop if need be."""
        for share in FALLBACK.easings:
            if not now.has_time("fallback", "certificate"):
                return None
            beta = eased(problem, ahead, share)
            trial = Trajectory(ahead.path, beta, problem.space.travel_time(ahead.path.arc_length, beta))
            if not np.isfinite(trial.travel_time) or trial.speed_control_points().min() < 0.0:
                continue
            # Driven slower, where the last trip was to be left says little.
            vetted = self._means.vet(now, CandidateKind.SLOWER, problem.frame, trial, branch=np.inf)
            if isinstance(vetted, Vetted):
                return vetted
            if -np.inf < vetted.room < -FALLBACK.hopeless * now.moment.scenario.vehicle.radius:
                return None
        return None

    def _stops(self, now: Replan, fresh: Renewal) -> Iterator[Trip]:
        moment = now.moment
        last = now.last
        if last is not None and last.stop is not None and self._means.safety_gate.is_on(moment, last.stop):
            # Where the jerk is limited, the stop must not have left the plan yet: else it brakes already.
            if moment.state.acceleration is None or moment.state.time <= last.branch_time + TIME:
                yield last.stop
        yield self._means.straight_stop(moment.state, self._means.braking)
        if fresh.ahead is not None:  # last: it takes a problem, which may have to be built
            along = self._means.braking.stop_now(fresh.ahead.path, moment.state)
            if fits(along):
                yield Trip(fresh.problem.frame, along)
