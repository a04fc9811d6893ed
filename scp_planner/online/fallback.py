"""What is driven where nothing better than the last plan is found: that plan, its path slower, or a stop."""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter

import numpy as np

from scp_planner.certificate.verdict import Certificate, Ends
from scp_planner.online.braking import straight_stop
from scp_planner.online.evasion import Dodge, Evasion
from scp_planner.online.means import Means, Replan
from scp_planner.online.plan import AWAY, OnlinePlan, Outcome
from scp_planner.online.remaining import eased
from scp_planner.online.stops import STANDING, fits
from scp_planner.online.vetting import TINY_TIME, Moment, Stop, Vetted, refused
from scp_planner.problem.problem import Problem
from scp_planner.settings.online import GiveWay
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

LOWER_LEVELS = (0.75, 0.5, 0.25, 0.1)
"""Sizes of regions, as shares of those at the level asked for, that dodges keep clear of where nothing does better."""
PARTS = (1.0, 0.75, 0.5, 0.25)
"""Shares of the time in which samples of a dodge are clear, for which it is tried to certify it."""
EASINGS = (0.6, 0.25, 0.0)
"""Shares of the planned acceleration that are tried to repair a plan; the rest is braking."""

HOPELESS = 4.0
"""Radii of the vehicle by which every stop from a trip is inside of zones that is not driven still slower."""


class Fallback:
    """What is driven where nothing better than the last plan is found.

    Parameters
    ----------
    means : Means
    """

    def __init__(self, means: Means) -> None:
        self._means = means
        self._evasion = Evasion(means)

    def be_patient(self, waited: float) -> None:
        """Say for how long the vehicle has come no nearer to its goal, s."""
        self._evasion.outlooks.be_patient(waited)

    def fall_back(
        self, now: Replan, problem: Problem, last: OnlinePlan | None, ahead: Trajectory | None, why: str
    ) -> OnlinePlan:
        """Keep the last plan, or drive its path slower, or brake."""
        moment = now.moment
        why = why or "there is no time now to look for a way"
        if last is not None:
            kept = self._means.vetting.vet_kept(moment, last.trip)
            if kept is not None:
                return self._means.plan_of(kept, now, Outcome.KEPT, f"nothing better was found: {why}")
            if last.stop is not None:
                kept = self._means.vetting.vet_kept_stop(moment, last.trip, Stop(last.stop, last.branch_time))
                if kept is not None:
                    return self._means.plan_of(kept, now, Outcome.KEPT, f"a stop from it still holds; {why}")
        if last is not None and ahead is not None:
            repaired = self._repair(now, problem, ahead)
            if repaired is not None:
                return self._means.plan_of(repaired, now, Outcome.REPAIRED, why)
        return self._give_way(now, problem, ahead, why)

    def sooner(self, now: Replan, plan: OnlinePlan) -> OnlinePlan:
        """Get out of the way where that is clearly better than a plan that would do."""
        dodge = self._evasion.sooner(now, plan.trip)
        if dodge is None:
            return plan
        return self._dodging(now, dodge, "there is more room for it than on the way")

    def _dodging(self, now: Replan, dodge: Dodge, why: str) -> OnlinePlan:
        stop = Stop(dodge.trip, dodge.trip.frame.time + dodge.trip.trajectory.travel_time)
        text = f"{_what(dodge)}: {why}{'' if dodge.moves else '; the vehicle stands'}"
        return self._means.plan_of(Vetted(dodge.trip, dodge.certificate, stop, 0.0), now, dodge.outcome, text)

    def _give_way(self, now: Replan, problem: Problem, ahead: Trajectory | None, why: str) -> OnlinePlan:
        """Get out of the way, or stand where that is as safe; or else do what does least harm."""
        dodge = self._evasion.safest(now)
        if dodge is not None:
            return self._dodging(now, dodge, why)
        before = self._evasion.going_on(now)
        if before is not None and before.safe:
            return self._dodging(now, before, why)
        promised = self._as_promised(now)
        if promised is not None:
            text = f"{why}; the last plan's stop is gone on with"
            return self._means.plan_of(promised, now, Outcome.BRAKING, text)
        lower = self._at_lower_level(now, why) if now.moment.growing else None
        if lower is not None:
            return lower
        if before is not None:
            text = f"{_what(before)} as before: {why}; nothing is safe, and nothing new does less harm"
            return self._means.plan_of(Vetted(before.trip, before.certificate, None), now, before.outcome, text)
        return self._brake(now, problem, ahead, why, self._evasion.least_harmful(now))

    def _at_lower_level(self, now: Replan, why: str) -> OnlinePlan | None:
        """Go on, or get out of the way, at the highest lower level at which either is clear of zones."""
        last = now.last if now.last is not None and now.last.outcome not in AWAY else None
        for share in LOWER_LEVELS:
            moment = now.moment.with_smaller_zones(share)
            text = f"{why}; clear of zones whose uncertainty is {share:g} times as large"
            kept = None if last is None else self._goes_on(moment, last)
            now.lap("certificate")
            if kept is not None:
                return self._means.plan_of(kept, now, Outcome.KEPT, f"goes on: {text}")
            dodge = self._evasion.at_lower_level(now, moment)
            if dodge is not None:
                before = " as before" if now.last is not None and dodge.trip is now.last.trip else ""
                risky = Vetted(dodge.trip, refused(dodge.certificate), None)
                return self._means.plan_of(risky, now, dodge.outcome, f"{_what(dodge)}{before}: {text}")
            if now.late:
                break
        return None

    def _goes_on(self, moment: Moment, last: OnlinePlan) -> Vetted | None:
        """The last trip, which is not safe, if it would be among smaller zones; None if not."""
        vetting = self._means.vetting
        kept = vetting.vet_kept(moment, last.trip)
        if kept is None:
            kept = vetting.vet_on(moment, last.trip, self._means.foreseen, last.branch_time, whole=False)
        # how much it enters smaller zones says nothing of those of the level asked for
        return None if kept is None else Vetted(last.trip, refused(kept.certificate), None)

    def _as_promised(self, now: Replan) -> Vetted | None:
        """The last plan's stop, if it still holds; for a vehicle that may brake at once, a dodge is as good."""
        moment, last = now.moment, now.last
        if moment.state.acceleration is None or last is None or last.stop is None:
            return None
        stop = Stop(last.stop, last.branch_time)
        begun = moment.state.time > stop.branch + TINY_TIME
        if begun or stop.stands <= moment.state.time or not self._means.vetting.is_on(moment, stop.trip):
            return None
        certificate = self._means.vetting.certify_stop(moment, stop, moment.state.time)
        # From now on it is this stop that is driven, up to its end.
        whole = Stop(stop.trip, stop.trip.frame.time + stop.trip.trajectory.travel_time)
        return Vetted(stop.trip, certificate, whole, 0.0) if certificate.holds else None

    def _repair(self, now: Replan, problem: Problem, ahead: Trajectory) -> Vetted | None:
        """Drive the same path slower: ease off for a while, then go on, or stop if need be."""
        for share in EASINGS:
            if perf_counter() > now.deadline:
                return None
            trial = Trajectory.of(problem.space, ahead.theta, eased(problem, ahead, share))
            if not np.isfinite(trial.travel_time) or trial.speed_control_points().min() < 0.0:
                continue
            # Driven slower, where the last trip was to be left says little.
            vetted = self._means.vet(now, problem, trial, branch=np.inf)
            if isinstance(vetted, Vetted):
                return vetted
            if -np.inf < vetted.room < -HOPELESS * now.moment.scenario.vehicle.radius:
                return None
        return None

    def _brake(self, now: Replan, problem: Problem, ahead: Trajectory | None, why: str, dodge: Dodge) -> OnlinePlan:
        """Where nothing stays clear: a stop that does at least until the vehicle stands, or what does least harm."""
        moment = now.moment
        time, stands = moment.state.time, moment.state.speed <= STANDING
        least: tuple[float, Trip, Certificate] | None = None
        for trip in self._stops(now, problem, ahead):
            if least is not None and now.late:
                break
            stop = Stop(trip, trip.frame.time)
            since = time if trip.frame.time < time else None
            if since is not None and since >= stop.stands:
                continue
            certificate = moment.certify(
                trip, since=since, until=stop.stands, ends=Ends.START, motions=self._means.vetting.motions
            )
            if certificate.holds and not stands and self._means.vetting.clear_for(moment, stop) >= dodge.clear:
                text = f"{why}; the stop is certified until the vehicle stands; what moves may still reach it"
                return self._means.plan_of(Vetted(trip, certificate, None), now, Outcome.BRAKING, text)
            if least is None or certificate.clearance.minimum > least[0]:
                least = certificate.clearance.minimum, trip, certificate
        assert least is not None, "the last stop begins now"
        _, trip, certificate = least
        harm = "; ".join(str(violation.outside(self._means.units)) for violation in certificate.violations)
        early = self._means.online.give_way is GiveWay.EARLY
        if early or stands or dodge.lasts or dodge.least > least[0] + moment.scenario.vehicle.radius:
            text = f"{why}; nothing is safe, this does least harm, {self._what_holds(now, dodge)}"
            return self._means.plan_of(Vetted(dodge.trip, dodge.certificate, None), now, dodge.outcome, text)
        text = f"{why}; no stop is certified, this is the least bad: {harm}"
        return self._means.plan_of(Vetted(trip, certificate, None), now, Outcome.BRAKING, text)

    def _what_holds(self, now: Replan, dodge: Dodge) -> str:
        """What is certified of a dodge that is not safe, in words: how long it keeps clear, or from when on."""
        moment, begin, unit = now.moment, now.moment.state.time, self._means.units.time
        whom = dodge.threat or "the border"
        stop = Stop(dodge.trip, dodge.trip.frame.time)
        if 0.0 < dodge.clear < np.inf:
            for share in PARTS:
                if now.late:
                    break
                until = begin + share * dodge.clear
                certificate = moment.certify(
                    dodge.trip, since=begin, until=until, ends=Ends.START, motions=self._means.vetting.motions
                )
                if certificate.holds:
                    return f"certified to keep clear for {share * dodge.clear * unit:.3g} s, then comes near to {whom}"
        elif 0.0 < dodge.leaves < stop.stands - begin and not now.late:
            if self._means.vetting.certify_stop(moment, stop, begin + dodge.leaves).holds:
                return f"near to {whom} now, certified to keep clear from {dodge.leaves * unit:.3g} s from now on"
        return f"comes near to {whom}"

    def _stops(self, now: Replan, problem: Problem, ahead: Trajectory | None) -> Iterator[Trip]:
        moment = now.moment
        last = now.last
        if last is not None and last.stop is not None and self._means.vetting.is_on(moment, last.stop):
            # Where the jerk is limited, the stop must not have left the plan yet: else it brakes already.
            if moment.state.acceleration is None or moment.state.time <= last.branch_time + TINY_TIME:
                yield last.stop
        if ahead is not None:
            along = self._means.braking.stop_now(ahead.path, moment.state)
            if fits(along):
                yield Trip(problem.frame, along)
        yield straight_stop(moment.state, self._means.braking, self._means.settings, self._means.breakpoints)


def _what(dodge: Dodge) -> str:
    """What is done, and for whom, in words."""
    whom = dodge.blocked_by or dodge.threat
    if whom is None:
        # Nobody is in the way: it is how the vehicle stands, in the room that there is, or who is far ahead.
        if not dodge.moves:
            return "waits, as no trip leads on from where it stands"
        return "nears the goal as far as is safe" if dodge.nears else "moves to where it is safer"
    if not dodge.moves:
        return f"waits for {whom}"
    return f"nears the goal as far as is safe, behind {whom}" if dodge.nears else f"gives way to {whom}"
