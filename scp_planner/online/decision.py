"""Choice of a replan among the last plan, an improved one, another way round and a way out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from scp_planner.errors import TooLargeError
from scp_planner.online.arrival import Waiting
from scp_planner.online.fallback import Fallback
from scp_planner.online.looks import Looks
from scp_planner.online.means import IMPROVEMENT, Means, Renewal, Replan
from scp_planner.online.plan import AWAY, OnlinePlan, Outcome
from scp_planner.online.reasons import ARRIVED, NEAR, OTHERWISE, CandidateKind, Reason, ReasonCode
from scp_planner.online.safety_gate import Refusal, Vetted
from scp_planner.online.stops import STOPS
from scp_planner.online.tolerances import OFF, TIME
from scp_planner.problem.problem import Problem
from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.record import FEASIBILITY, LoopRun
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class DecisionParameters:
    # Of the run that improves the rest of the last plan
    warm_trust: TrustRegion = field(default=TrustRegion(theta=0.5, beta=1.5, rho=0.1))
    # Units of time. With less of the trip left, the last plan is driven to its end if its certificate holds
    near_goal: float = 0.4
    # A plan that does not keep all limits or foreseen zones yet is improved so many times as often
    unfinished_sooner: int = 2
    # Radii of the vehicle by which every stop from a trip is inside of zones where it is not improved: the loop knows
    # of no stops
    hopeless: float = 1.0
    # Radii of the vehicle by which what is left of a trip is inside of zones where its stops are looked at beforehand
    deep: float = 0.5
    # Replans in a row in which ways to the goal are looked at, and a manoeuvre that was begun goes on. At the next
    # one manoeuvres are looked at, and no ways: both in one replan take twice as long
    gone_on: int = 2
    # Replans in a row without a look at ways to the goal, where nothing is safe: there are manoeuvres in each of them
    without_a_look: int = 5
    # Units of time: by how much later a new plan may arrive before the last one is preferred, if that still holds
    slower: float = 5e-3


DECISION = DecisionParameters()


class Decision:
    """Decides replan by replan what is driven, and remembers how good that is."""

    def __init__(self, means: Means) -> None:
        self._means = means
        self._looks, self._fallback = Looks(means), Fallback(means)
        self._improved = 0
        self._good_enough = True
        self._put_off = False  # a look at other ways, to the next time that what is left of the last trip is refused
        self._unfinished: Trip | None = None  # what has come of the last improvement, which is gone on with
        self._gone_on = 0  # replans in a row in which a manoeuvre was gone on with
        self._without = 0  # replans in a row without a look at ways
        self._waiting = Waiting()
        self.arrival = means.arrival

    def answer(self, now: Replan) -> OnlinePlan:
        state, goal = now.moment.state, now.moment.scenario.goal
        self._fallback.be_patient(self._waiting.waited(state.time, math.dist(state.position, goal.position)))
        try:
            plan = self._answer(now)
        except TooLargeError as error:  # the goal is too far away for trips to be looked for
            plan = self._stopped(now, Reason(ReasonCode.BLOCKED, str(error)))
        if self._means.gives_way_late or plan.arrived or plan.outcome in AWAY:
            return plan
        return self._fallback.sooner(now, plan)

    def _answer(self, now: Replan) -> OnlinePlan:
        last, moving = now.last, now.moment.moving
        if last is not None and last.outcome in AWAY:
            last = None
        if now.unrouted is not None or now.moment.lost is not None:
            return self._without_goal(now, last)
        if moving is not None:
            self.arrival.move(moving, now.moment.state.time)
        arriving = self._arriving(now, last)
        if arriving is not None:
            return arriving
        if last is not None and last.arrival_time <= now.moment.state.time + TIME:
            last = now.last = None  # it has ended elsewhere: it says nothing of what to drive
        elsewhere = last is not None and moving is None and not self.arrival.is_end_of(last.trip)
        now.aimless = now.last is None or elsewhere
        if last is None or now.aimless:
            return self._anew(now, None, last)
        return self._drive_on(now, last)

    def _drive_on(self, now: Replan, last: OnlinePlan) -> OnlinePlan:
        """Keep the last plan, or improve what is left of it where that is due."""
        off = _off_target(now, last)
        if last.arrival_time - now.moment.state.time < DECISION.near_goal and not off:
            kept = self._means.kept(now, last)
            if kept is not None:
                return self._means.plan_of(kept, now, Outcome.KEPT)
        now.improves = off or now.has_time("improvement", *IMPROVEMENT)
        due = off or (now.cycle - self._improved >= self._improve_every and now.improves)
        if not due and self._unfinished is None:
            kept = self._still_on(now, last)
            if kept is not None:
                return self._keep(now, kept)
        return self._anew(now, last)

    def _still_on(self, now: Replan, last: OnlinePlan) -> Vetted | None:
        """The last plan as it is, if that will do for a while."""
        safety_gate = self._means.safety_gate
        kept = safety_gate.vet_on(now.moment, last.trip, self._means.foreseen, last.branch_time, last.certified)
        now.lap("certificate")
        self._means.consider(now, CandidateKind.LAST, last.trip, kept)
        return kept

    def _arriving(self, now: Replan, last: OnlinePlan | None) -> OnlinePlan | None:
        """Drive on to the goal, or stop at it from the reported state; None where that is not due, or not certified."""
        state, arrival, means = now.moment.state, self.arrival, self._means
        if means.given.goals:
            return None
        front = state.heading if state.front is None else state.front
        there, moves = arrival.is_there(state.position, front), state.speed > STOPS.standing
        if there and last is not None and last.arrival_time > state.time + TIME and moves:
            moving = now.moment.moving
            nears = moving is None or moving.is_neared_by(last, state.time)
            kept = means.kept(now, last) if nears else None
            if kept is not None:
                return means.plan_of(kept, now, Outcome.KEPT)
        arrived, done = there and arrival.is_as_asked(state), arrival.is_done(state.position)
        arrived |= last is not None and self._has_crossed(now, last)
        if now.moment.onward:  # from where it ends, so that it is to be driven to its end
            arrived &= done or (last is not None and last.arrival_time <= state.time + TIME)
        if arrived or done:
            stop = self._stopped(now, ARRIVED if arrived else OTHERWISE)
            if stop.safe or done or not moves:
                return stop
        if (
            not moves
            or not arrival.is_to_stand
            or (last is not None and means.safety_gate.is_on(now.moment, last.trip))
        ):
            return None
        trip = means.straight_stop(state, means.braking if there else arrival.braking_to_it(state, means.braking))
        ((x, y),) = trip.frame.to_world(trip.positions_at(np.array([math.inf]))).tolist()
        if not there and not arrival.is_there((x, y), front):
            return None
        stop = means.stopping(now, trip, NEAR)
        return stop if stop.safe else None

    def _has_crossed(self, now: Replan, last: OnlinePlan) -> bool:
        """True if a goal that may be passed at speed was, on the last plan, as it was certified."""
        state, moving = now.moment.state, now.moment.moving
        since = state.time - last.arrival_time
        if not (last.certified and self.arrival.may_be_passed and since >= -TIME):
            return False
        off = now.moment.deviation(last.trip).distance - state.speed * max(since, 0.0)
        met = self.arrival.is_end_of(last.trip) if moving is None else moving.is_met_by(last)
        return met and off <= self._means.following.largest + OFF

    def _without_goal(self, now: Replan, last: OnlinePlan | None) -> OnlinePlan:
        """Stop; where a route is missing, drive on by the last plan while that can be left for a stop."""
        reason = now.unrouted or now.moment.lost or OTHERWISE
        kept = None if last is None or now.unrouted is None else self._still_on(now, last)
        if kept is None:
            return self._stopped(now, reason)
        return self._means.plan_of(kept, now, Outcome.KEPT, reason=reason)

    def _stopped(self, now: Replan, reason: Reason) -> OnlinePlan:
        """Stop straight on, or where that stays clear."""
        stop = self._means.stopping(now, self._means.straight_stop(now.moment.state, self._means.braking), reason)
        return stop if stop.safe else self._fallback.leave(now, reason) or stop

    def _anew(self, now: Replan, last: OnlinePlan | None, spare: OnlinePlan | None = None) -> OnlinePlan:
        """Improve what is left of the last trip; ``last`` is the plan of it, if that is one to drive on by.

        ``spare`` is a plan that leads elsewhere, which is driven until there is one to the goal.
        """
        self._improved = now.cycle
        fresh, self._unfinished = Renewal(self._means, now, self._unfinished), None
        best = self._improve(now, fresh, last)
        if isinstance(best, Refusal):
            kept = None if spare is None else self._still_on(now, spare)
            if kept is not None:
                return self._means.plan_of(kept, now, Outcome.KEPT)
            plan = self._going_on(now) or self._fallback.fall_back(now, fresh, last, best)
            # A look that only begins finds nothing before the next replan.
            at_once = self._put_off and not plan.safe and (self._looks.under_way or not self._means.gives_way_late)
            other = self._looked(now, fresh) if at_once else None
            if other is None:
                return plan
            best = other
        later = last is not None and best.arrival > last.arrival_time + DECISION.slower and not _off_target(now, last)
        if last is not None and (later or (last.certified and not best.certified)):
            kept = self._means.kept(now, last)
            if kept is not None:
                return self._means.plan_of(kept, now, Outcome.KEPT)
        if last is not None and best.trip is last.trip:
            return self._means.plan_of(best, now, Outcome.KEPT)
        self._good_enough = best.feasible
        return self._means.plan_of(best, now, Outcome.IMPROVED)

    def _going_on(self, now: Replan) -> OnlinePlan | None:
        """Go on with a manoeuvre that was begun, after a look at ways; None where that is unsafe, or others are due."""
        due = not self._takes_turns(now) or self._gone_on == DECISION.gone_on
        plan = None if due else self._fallback.go_on(now)
        self._gone_on = 0 if plan is None else self._gone_on + 1
        return plan

    def _takes_turns(self, now: Replan) -> bool:
        """True if ways and manoeuvres are looked at in turns: where time is short, or the vehicle gives way late."""
        last = now.last
        if last is None or not last.safe:
            return False
        if math.isfinite(now.deadline):
            return last.outcome in AWAY
        return last.outcome is Outcome.EVADING and self._means.gives_way_late

    def _looks_now(self, now: Replan) -> bool:
        """True if ways are looked at in a replan without a trip to drive on by."""
        is_safe = now.last is None or now.last.safe
        if is_safe or not self._means.gives_way_late or self._without == DECISION.without_a_look:
            self._without = 0
            return self._looks.is_due(now, None)
        self._without += 1
        return False

    @property
    def _improve_every(self) -> int:
        """Replans between improvements: fewer after one that is not good enough yet."""
        every = self._means.online.improve_every
        return every if self._good_enough else max(every // DECISION.unfinished_sooner, 1)

    def _keep(self, now: Replan, kept: Vetted) -> OnlinePlan:
        """Drive on by the last plan, unless a look at other ways, where one is due, finds a better one."""
        if self._looks.is_due(now, kept):
            other = self._looks.look(now, Renewal(self._means, now), kept)
            if other is not None:
                return self._means.plan_of(other, now, Outcome.IMPROVED)
        return self._means.plan_of(kept, now, Outcome.KEPT)

    def _improve(self, now: Replan, fresh: Renewal, last: OnlinePlan | None) -> Vetted | Refusal:
        """Continue the last plan, or look at other ways round: in turns, where both would be done in one replan."""
        refusal = Refusal("")
        if not now.improves:
            return refusal
        if math.isfinite(now.deadline) and now.last is not None and not now.last.safe:
            self._put_off = True  # first out of the way, as long as there is time for that
            return refusal
        if last is not None and not (self._put_off and last.safe and self._means.gives_way_late):
            found = self._continued(now, fresh)
            if isinstance(found, Vetted):
                self._put_off = False
                return found
            refusal, self._put_off = found, not self._put_off
            if self._put_off:
                return refusal
        elif last is None and self._gone_on == DECISION.gone_on and self._takes_turns(now):
            self._put_off = True
            return refusal
        return self._looked(now, fresh) or refusal

    def _looked(self, now: Replan, fresh: Renewal) -> Vetted | None:
        """Look at other ways round, where that is due; or drive what was found with a route, best if to its end."""
        known, self._means.known = self._means.known, None
        found = None if known is None else self._looks.as_planned(now, known.trip)
        if found is not None and found.certified:
            return found
        self._put_off = False
        return (self._looks.look(now, fresh, None) if self._looks_now(now) else None) or found

    def _continued(self, now: Replan, fresh: Renewal) -> Vetted | Refusal:
        """Improve what is left of the last trip."""
        loop = fresh.loop
        ahead = fresh.ahead if fresh.unfinished is None else fresh.left_of(fresh.unfinished)
        if ahead is None:
            return Refusal("nothing of the last trip leads on to the goal")
        if fresh.unfinished is not None:
            return self._improved_trip(now, loop, ahead, begun=True)
        radius = now.moment.scenario.vehicle.radius
        if _clearance(loop.problem, ahead) < -DECISION.deep * radius and self._means.safety_gate.stops_will_do:
            room = self._means.safety_gate.most_room(now.moment, Trip(loop.problem.frame, ahead.settled()))
            now.lap("certificate")
            if -math.inf < room < -DECISION.hopeless * radius:
                return Refusal("every stop from the rest of the last trip is far inside a zone", room)
        return self._improved_trip(now, loop, ahead)

    def _improved_trip(self, now: Replan, loop: ScpLoop, ahead: Trajectory, begun: bool = False) -> Vetted | Refusal:
        """Improve what is left of the last trip; once more where it is refused before it keeps its limits."""
        assert now.last is not None, "there is a last trip"
        run = self._run(now, loop, ahead)
        evaluation, steps = run.evaluation, len(run.record)
        kind, frame = CandidateKind.IMPROVED, loop.problem.frame
        found = self._means.vet(now, kind, frame, evaluation.trajectory, evaluation, steps)
        finished = evaluation.limit_violation <= FEASIBILITY
        if finished or isinstance(found, Vetted) or -math.inf < found.room < 0.0:
            return found
        kept = None if begun else self._still_on(now, now.last)
        if kept is not None:
            self._unfinished = Trip(frame, evaluation.trajectory)
            return kept
        run = self._run(now, loop, evaluation.trajectory)
        evaluation, steps = run.evaluation, steps + len(run.record)
        return self._means.vet(now, kind, frame, evaluation.trajectory, evaluation, steps)

    def _run(self, now: Replan, loop: ScpLoop, ahead: Trajectory) -> LoopRun:
        most = self._means.online.iterations
        if now.last is not None and self._means.safety_gate.is_on(now.moment, now.last.trip):
            most = max(most // 2, 1)  # there is a plan to fall back on, and the next replans go on
        overdue = now.late
        deadline = now.until_answer(overdue=overdue)
        run = loop.run(ahead, 1 if overdue else most, deadline=deadline, trust=DECISION.warm_trust, enough=1)
        now.lap("scp", len(run.record))
        return run


def _off_target(now: Replan, last: OnlinePlan) -> bool:
    """True if a plan no longer leads to where the target is most likely to be."""
    return now.moment.moving is not None and now.moment.moving.is_left_by(last)


def _clearance(problem: Problem, trip: Trajectory) -> float:
    """The least clearance of a trip at the problem's samples, m."""
    points = trip.kept_at(problem.samples)  # the loop looks at the same soon
    return float(problem.zones.distances(points.time, points.path.position, 0.0).min(initial=np.inf))
