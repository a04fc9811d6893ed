"""Trips to a target that moves: the earliest time at which the fastest trip to where it then is does not come late.

With tau(T) the travel time of the fastest trip to the target's place T after the start, the meeting is the first root
of tau(T) - T. Each tau is that of a trip to a goal that stands: ways to it are searched for once, and again where the
time has changed much; in between the last trip is led to the new place.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import dist, inf

import numpy as np

from scp_planner.arrays import Array
from scp_planner.planning.runs import CheckedRuns, ScpRun, Task
from scp_planner.scenario.limits import Limits, straight_trip_time
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import changed
from scp_planner.settings.planning import for_scene
from scp_planner.threat_zones.target import TargetMotion
from scp_planner.trips.trajectory import arriving

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class MeetingSettings:
    """Precision and work of the search for the time of a meeting."""

    precision: float = 1e-6  # relative, of the time of the meeting
    near: float = 2e-4  # of the time, by which a trip comes late or early where what it promises is the meeting
    far: float = 0.2  # relative change of the time after which ways to the new place are searched for
    searches: int = 4  # of ways, at most
    trips: int = 16  # at most
    slowest: float = 1e-2  # units of speed, that a trip is taken to end with at least
    slowest_gain: float = 1e-2  # of the speed, on the target; limits and times are kept no more exactly than for that
    fast_gain: float = 0.7  # of the speed: below it a trip with usual margin and tolerance is not good enough
    later: float = 1.25  # times the time to which no trip is found, that is tried next
    longest: float = 2.0  # times the last time, that the next one is at most
    # Relative delays of the meeting that are tried in turn where no trip arrives just then
    delays: tuple[float, ...] = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)


MEETING = MeetingSettings()
Searched = Callable[[Task], ScpRun]


class MeetingSearch:
    """Search for the meeting with the target of a scenario, in natural units."""

    def __init__(self, task: Task, scenario: Scenario, target: TargetMotion, least: float, searched: Searched) -> None:
        self.task, self.scenario, self.target, self.least, self._searched = task, scenario, target, least, searched
        self._points: list[tuple[float, float]] = []  # times of meetings, s, and by how much their trips come late

    def run(self) -> ScpRun:
        """Return the trip that meets the target, judged by the scenario; else the best attempt."""
        if self.least == inf:
            there = changed(self.scenario, goal=self.target.goal_at(self.scenario.goal, self.scenario.start.time))
            best = self._searched(self._task_at(straight_trip_time(there, Limits.of(there))))
            return best.runs.judged(best.run, self.scenario)
        time = searched = self.least
        best, searches = self._searched(self._task_at(time)), 1
        for _ in range(MEETING.trips):
            if _arrives(best):
                self._points.append((time, best.travel_time - time))
            if self.task.out_of_time or (_arrives(best) and self._is_met(best)):
                break
            time = self._next(best) if _arrives(best) else MEETING.later * time
            near = abs(time - searched) <= MEETING.far * searched
            go_on = _arrives(best) and (near or searches == MEETING.searches)
            led = self._led_to(best, time) if go_on else None
            if led is not None and _arrives(led):
                best = led
            elif searches < MEETING.searches:
                best, searched, searches = self._searched(self._task_at(time)), time, searches + 1
            else:
                break
            logger.info("meeting after %.6f units of time: its trip takes %.6f", time, best.travel_time)
        return self._on_time(best)

    @property
    def _bracket(self) -> tuple[float, float]:
        """Latest time to which the trip comes late, and earliest one to which it does not, s."""
        early = max((time for time, late in self._points if late > 0.0), default=self.least)
        return early, min((time for time, late in self._points if late <= 0.0), default=inf)

    def _is_met(self, best: ScpRun) -> bool:
        """True if the next trip will meet the target, and the last one was as exact as it takes."""
        (early, late), (time, missed) = self._bracket, self._points[-1]
        if best.certificate is not None and self._gains(best, time) < MEETING.fast_gain:
            return False
        return late - early <= MEETING.precision * time or abs(missed) <= MEETING.near * time

    def _next(self, best: ScpRun) -> float:
        """Time that the last trip promises for the meeting, or the middle of what is known, s."""
        (early, late), (time, missed) = self._bracket, self._points[-1]
        slope = self._slope(best, time)
        if len(self._points) > 1 and abs(self._points[-2][0] - time) > MEETING.near * time:
            other, before = self._points[-2]
            slope = (missed - before) / (time - other)
        wanted = time - missed / min(slope, -MEETING.slowest_gain)
        wanted += 0.25 * MEETING.precision * time  # rather just after the meeting than just before it
        if early < wanted < late:
            return min(wanted, MEETING.longest * time)
        return 0.5 * (early + late) if late < inf else MEETING.longest * time

    def _slope(self, best: ScpRun, time: float) -> float:
        """Rate at which trips come later, the later they are to meet the target: as where the end moves along them."""
        if self.scenario.goal.match_velocity:  # then it tells nothing: the end moves as the trip does
            return -1.0
        trip, frame = best.trajectory, best.runs.problem.frame
        ahead = frame.vectors_to_world(trip.path.points(np.ones(1)).direction)[0]
        receding = float(ahead @ np.array(self.target.velocity(self.scenario.start.time + time)))
        return receding / max(trip.final_speed, abs(receding), MEETING.slowest) - 1.0

    def _gains(self, best: ScpRun, time: float) -> float:
        """Share of its speed by which a trip gains on the target."""
        return min(max(-self._slope(best, time), MEETING.slowest_gain), 1.0)

    def _task_at(self, time: float, *, on_time: bool = False) -> Task:
        """The task of a trip to where the target is after a time, s; to arrive just then, or as soon as it may."""
        scenario, arrival = self.scenario, self.scenario.start.time + time
        goal = self.target.goal_at(scenario.goal, arrival)
        if self.target.covariances is not None:
            goal = changed(goal, radius=0.0)  # the estimate itself: there the target is within the radius most probably
        window = arrival if on_time else None
        return replace(
            self.task, scenario=changed(scenario, goal=changed(goal, earliest_arrival=window, latest_arrival=window))
        )

    def _led_to(self, best: ScpRun, time: float, *, on_time: bool = False) -> ScpRun:
        """Go on from a trip to the same one, turned and scaled to end where the target is at another time."""
        # Margin and tolerance cost more time, the slower the vehicle gains on the target.
        gains, task = self._gains(best, time), self._task_at(time, on_time=on_time)
        given = for_scene(self.task.settings)
        finer = replace(given, limit_margin=gains * given.limit_margin, tolerance=gains * given.tolerance)
        task = replace(task, settings=finer)
        trip, start = best.trajectory, task.scenario.start.position
        scale = dist(start, task.scenario.goal.position) / dist(start, best.runs.task.scenario.goal.position)
        guide, breakpoints = trip.space.guide.in_units(scale), tuple(trip.space.acceleration.breakpoints.tolist())
        runs = CheckedRuns(task, guide, breakpoints, len(trip.space.path.widths))
        problem, ends = runs.problem, runs.problem.ends
        theta: Array = scale * trip.theta
        theta[: ends.free.start], theta[ends.free.stop :] = ends.theta[: ends.free.start], ends.theta[ends.free.stop :]
        begin = arriving(problem.space, theta, trip.beta, problem.limits.acceleration, trip.travel_time)
        return runs.attempt(begin, loop=runs.patient_loop) if on_time else runs.unchecked(begin)

    def _on_time(self, best: ScpRun) -> ScpRun:
        """The trip that arrives with the target, judged by the scenario."""
        near = best.runs.judged(best.run, self.scenario)
        if not self._points:
            return near
        time, delays = self._next(best), iter(MEETING.delays)
        while not self.task.out_of_time:
            run = self._led_to(best, time, on_time=True)
            found = run.runs.judged(run.run, self.scenario)
            if run.holds and found.holds:
                return found
            near = found if found.better_than(near) else near
            missed = run.travel_time - time
            if run.run.feasible and missed > MEETING.precision * time and len(self._points) < MEETING.trips:
                self._points.append((time, missed))
                time = self._next(run)
            elif (delay := next(delays, None)) is not None:
                time *= 1.0 + delay
            else:
                break
        return near


def _arrives(run: ScpRun) -> bool:
    """True if a trip is certified, or was not looked at and keeps all constraints."""
    return run.holds or (run.certificate is None and run.run.feasible)
