"""Trips to a target that moves: the earliest time at which the fastest trip to where it then is does not come late.

With tau(T) the travel time of the fastest trip to the target's place T after the start, the meeting is the first root
of tau(T) - T. Each tau is that of a trip to a goal that stands: ways to it are searched for once, and again where the
time has changed much; in between the last trip is led to the new place. Where that changes it by no more than margins
allow, it is not run again: the same trip, turned and dilated in space and time alike, arrives with the target.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import dist, inf

import numpy as np

from scp_planner.arrays import Array, Mask
from scp_planner.certificate.meeting import first_meeting
from scp_planner.constraints.ends import end_conditions
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.planning.checked import QUALITY
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.planning.sources.refinements import over_other_breakpoints
from scp_planner.planning.task import Task
from scp_planner.problem.tightening import TIGHTENINGS
from scp_planner.scenario.limits import Limits, straight_trip_time
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import changed
from scp_planner.search.first_trips import arcs
from scp_planner.settings.planning import for_scene
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.target import TargetMotion
from scp_planner.trips.trajectory import Trajectory

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class MeetingSettings:
    """Precision and work of the search for the time of a meeting."""

    dilated: float = 0.5  # of the margin of limits: by so much of its length a trip's end may be moved
    rounding: float = 1e-9  # relative, of the time of the meeting
    looks: int = 129  # at times at which something may cover the place to meet
    closer_looks: int = 3  # between two of them
    dilations: int = 4  # until the trip arrives with the target, where turning it changes more than its direction
    apart: float = 2e-4  # relative, of times whose trips tell how delays change with the time
    jump: float = 1e-3  # relative, of times before which trips come late, and after which they come early
    steepest: float = 2.0  # rate at which trips come earlier, the later they are to meet the target, but for jumps
    far: float = 0.02  # relative change of the time after which ways to the new place are searched for
    searches: int = 6  # of ways, at most
    trips: int = 16  # at most
    slowest: float = 1e-2  # units of speed, that a trip is taken to end with at least
    slowest_gain: float = 1e-2  # of the speed, on the target; limits and times are kept no more exactly than for that
    fast_gain: float = 0.7  # of the speed: below it a trip with usual margin and tolerance is not good enough
    later: float = 1.25  # times the time to which no trip is found, that is tried next
    share: float = 0.5  # of the time that is left, for one search to a goal that stands
    slower: tuple[float, ...] = (1.001, 1.05, 1.2)  # times the time of such a trip: meetings that are tried
    longest: float = 2.0  # times the last time, that the next one is at most


MEETING = MeetingSettings()
NONE_EARLY: tuple[float, ScpRun | None] = (inf, None)
Searched = Callable[[Task, ScpRun | None], ScpRun | None]


class MeetingSearch:
    """Search for the meeting with the target of a scenario, in natural units.

    ``searched`` returns the fastest trip of a task that is faster than a known one.
    """

    def __init__(self, task: Task, scenario: Scenario, target: TargetMotion, least: float, searched: Searched) -> None:
        """Take a scene with its target; ``searched`` returns the fastest trip of a task faster than a known one."""
        # The trip that arrives with the target is certified; the next ones keep what was missed
        self.task, self.scenario, self.target = replace(task, provisional=True), scenario, target
        self._searched = searched
        earliest = scenario.goal.earliest_arrival or scenario.start.time
        self.least = max(least, earliest - scenario.start.time)
        self._points: list[tuple[float, float]] = []  # times of meetings, s, and by how much their trips come late
        self._surely: list[tuple[float, float]] = []  # those of them where all ways were searched
        self._late = NONE_EARLY  # earliest time, s, at which a trip comes early, and that
        self._shut = 0.0  # latest time of a meeting to which no trip was found, s
        self._frame = PlanningFrame(scenario.start.position, 0.0, scenario.start.time)
        self._missed: list[ScpRun] = []  # trips that meet the target, but are not certified
        self._waits = False  # True if trips come early to the next time, and late to times before it
        self._held = False  # True if those that waited until such a time came late: they wait until later ones

    def run(self) -> ScpRun:
        """Return the trip that meets the target, judged by the scenario; else the best attempt."""
        return self._gets_away() if self.least == inf else self._earliest()

    def _earliest(self) -> ScpRun:
        time, searched, searches = self._cleared(self._estimate()), 0.0, 0
        led_from: ScpRun | None = None  # the one that arrives early at the earliest time; else the last one
        met: ScpRun | None = None
        is_led = False
        for _ in range(MEETING.trips):
            again: ScpRun | None = None
            found, is_led = None if led_from is None else self._led_to(led_from, time), True
            known = found if found is not None and found.holds else None
            if searches < MEETING.searches and (known is None or self._unsure(known, time, searched)):
                other = self._searched(self._task_at(time), known)
                searched, searches = time, searches + 1
                if other is not None and (known is None or (other.holds and other.travel_time < known.travel_time)):
                    found, is_led = other, False
                    self._points = [*self._surely]  # the times of other trips say nothing of this one
                if found is not None and found.holds:
                    self._surely.append((time, found.travel_time - time))
            assert found is not None, "the first run is never cut off"
            if found.holds:
                led_from = self._kept(found, time)
                if searches == MEETING.searches or not self._unsure(found, time, searched):
                    again = self._met(found, time, exact=is_led)
                    met = again if again is not None and again.better_than(met) else met
            else:
                self._shut = max(self._shut, time)
            if self.task.budget.is_over or (met is not None and met.holds):
                break
            logger.info("meeting after %.6f units of time: its trip takes %.6f", time, found.travel_time)
            before, time = time, self._next(found if found.holds else led_from)
            if searches == MEETING.searches and (led_from is None or (time == before and not found.holds)):
                break
            if again is not None:
                self._ask_for_more(again)
        assert found is not None, "there is a first trip"
        return met or found.runs.judged(found.run, self.scenario)

    def _ask_for_more(self, failed: ScpRun) -> None:
        """Have trips keep what the certificate of one that meets the target found missing: they take longer."""
        self._missed.append(failed)
        self.task = replace(self.task, provisional=len(self._missed) <= TIGHTENINGS)
        self._points, self._surely, self._late = [], [], NONE_EARLY

    def _kept(self, found: ScpRun, time: float) -> ScpRun:
        """Note how late a trip comes to a meeting after a time, s; return the one that others are led from."""
        if found.travel_time <= time < self._late[0]:
            self._late = (time, found)
        self._points.append((time, found.travel_time - time))
        return self._late[1] or found

    def _gets_away(self) -> ScpRun:
        """A trip towards a target that gets away, whatever is in the way."""
        there = changed(self.scenario, goal=self.target.goal_at(self.scenario.goal, self.scenario.start.time))
        task = self._task_at(straight_trip_time(there, Limits.of(there)))
        runs = CheckedRuns(replace(task, threat_zones=()))
        return CheckedRuns(task).judged(runs.unchecked(next(arcs(runs.problem))).run, self.scenario)

    def _estimate(self) -> float:
        """Time of the meeting where nothing is in the way, and turning takes no time, s."""
        time = self.least
        for _ in range(MEETING.trips):
            scenario = self._task_at(time).scenario
            before, time = time, max(straight_trip_time(scenario, Limits.of(scenario)), self.least)
            if abs(time - before) <= MEETING.far * before or time > MEETING.longest * self.least:
                break
        return min(time, MEETING.longest * self.least)

    def _unsure(self, found: ScpRun, time: float, searched: float) -> bool:
        """True if a trip about meets the target, and another way may be faster."""
        enough = found.travel_time <= self.least * (1.0 + QUALITY.good_enough)
        near = self._waits or abs(found.travel_time - time) <= MEETING.far * time
        return near and not enough and abs(time - searched) > MEETING.far * time

    def _next(self, best: ScpRun | None) -> float:
        """Time that the last trip promises for the meeting, or the middle of what is known, s."""
        # Trips come late until then, or there is none; and the earliest time to which they do not
        late = self._late[0]
        early = max((time for time, late in self._points if late > 0.0), default=self.least)
        early = max(early, self._shut if self._shut < late else 0.0)
        # Where trips come early by more than they can have gained since they came late, that is by a jump
        comes_early = 0.0 if self._late[1] is None else late - self._late[1].travel_time
        jumps = late - early <= min(MEETING.jump * late, comes_early / MEETING.steepest)
        if best is None or not self._points:
            self._waits = self._held or jumps
            return self._cleared(self._within_reach(MEETING.later * early, early))
        time, missed = self._points[-1]
        if self._waits and time == late and missed > MEETING.jump * time:
            self._late, self._held, late = NONE_EARLY, True, inf
        self._waits = self._held or jumps
        if self._waits and late < inf:
            return late
        slope = self._slope(best, time)
        if len(self._points) > 1 and abs(self._points[-2][0] - time) > MEETING.apart * time:
            other, before = self._points[-2]
            slope = (missed - before) / (time - other)
        wanted = min(time - missed / min(slope, -MEETING.slowest_gain), MEETING.longest * time)
        if not early < wanted < late:
            wanted = 0.5 * (early + late) if late < inf else MEETING.later * early
        wanted = self._within_reach(wanted, early)
        return min(self._cleared(wanted, early), late)

    def _within_reach(self, wanted: float, early: float) -> float:
        """The first time from one on, s, at which the target is within reach; or else one nearer to another."""
        # Once the target has got away for good, it is met before that, or never.
        while (again := first_meeting(self.scenario, self.target, wanted)) == inf:
            if wanted - early <= MEETING.jump * early:
                break
            wanted = 0.5 * (early + wanted)
        return wanted if again == inf else again

    def _cleared(self, time: float, since: float = inf) -> float:
        """The time, s, or if something covers the place to meet then, when that has begun or ended.

        Where trips may meet the target well after a time, ``since``, and before it is covered, that is tried first.
        """
        if not len(self.task.threat_zones) or 0.0 not in self.scenario.vehicle.discs:
            return time
        if self._clear(np.array([time]))[0]:
            return time
        before = self._nearest_clear(time, since) if since < time else None
        if before is not None and before > (1.0 + MEETING.jump) * since:
            return before
        after = self._nearest_clear(time, MEETING.longest * time)
        self._waits = self._waits or after is not None
        return time if after is None else after

    def _nearest_clear(self, covered: float, end: float) -> float | None:
        """The time nearest to another one, s, on the way to an end, at which nothing covers the place to meet."""
        for _ in range(MEETING.closer_looks):
            times = np.linspace(covered, end, MEETING.looks)
            first = int(np.argmax(self._clear(times)))
            if not first:  # it is clear never, or by now
                return None
            covered, end = float(times[first - 1]), float(times[first])
        return end

    def _clear(self, times: Array) -> Mask:
        """True at each time after the start, (n,) s, at which no zone covers the place to meet."""
        places = self._frame.to_frame(self.target.places(self._frame.time + times))
        clear: Mask = self._zones.distances(times, places).min(axis=1) > 0.0
        return clear

    @cached_property
    def _zones(self) -> ZoneBatch:
        """Zones, as large as they are to a vehicle that is to be within the radius of the goal."""
        scenario, margin = self.scenario, for_scene(self.task.settings).clearance_margin
        return ZoneBatch.of(
            self.task.threat_zones, self._frame, scenario.vehicle.radius + margin - scenario.goal.radius
        )

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
        """The task of a trip to where the target is after a time, s; not before that, or just then, where it waits."""
        scenario, arrival = self.scenario, self.scenario.start.time + time
        goal = self.target.goal_at(scenario.goal, arrival)
        if self.target.covariances is not None:
            goal = changed(goal, radius=0.0)  # the estimate itself: there the target is within the radius most probably
        if self._waits:
            goal = changed(goal, earliest_arrival=arrival, latest_arrival=arrival if on_time else goal.latest_arrival)
        return replace(self.task, scenario=changed(scenario, goal=goal))

    def _led_to(self, best: ScpRun, time: float) -> ScpRun:
        """Go on from a trip to the same one, turned and scaled to end where the target is at another time."""
        # Margin and tolerance cost more time, the slower the vehicle gains on the target.
        gains, task = self._gains(best, time), self._task_at(time, on_time=True)
        given = for_scene(self.task.settings)
        finer = replace(given, limit_margin=gains * given.limit_margin, tolerance=gains * given.tolerance)
        turned = _turned(best, task)
        # Speeds to match change with the time, and so does the share of it at which the drive to them switches.
        runs = CheckedRuns(replace(task, settings=finer), turned.space.guide, spans=len(turned.space.path.widths))
        begin = over_other_breakpoints(runs.problem, best.trajectory, turned.theta)
        if self.task.provisional:
            return runs.unchecked(begin, self._missed)
        return runs.attempt(begin, loop=runs.patient_loop)

    def _met(self, best: ScpRun, time: float, *, exact: bool) -> ScpRun | None:
        """The trip to a place of the target, turned and dilated to arrive with it; None if it would change by too much.

        Its speeds stay as they are, and accelerations and curvatures change by as much as its length does.
        """
        gains, trip = self._gains(best, time), best.trajectory
        if not exact and gains < MEETING.fast_gain:
            return None
        most = max(MEETING.dilated * gains * for_scene(self.task.settings).limit_margin, MEETING.rounding)
        before, late, meeting = time, trip.travel_time - time, trip.travel_time
        for _ in range(MEETING.dilations):
            task = replace(self._task_at(meeting), settings=best.runs.task.settings)
            moved = dist(task.scenario.goal.position, best.runs.task.scenario.goal.position)
            if not moved <= most * dist(task.scenario.start.position, task.scenario.goal.position):
                return None
            led = _turned(best, task)
            late, missed = led.travel_time - meeting, late
            if abs(late) <= MEETING.rounding * meeting:
                run = replace(best.run, evaluation=replace(best.run.evaluation, trajectory=led))
                return CheckedRuns.over(task, led.space).judged(run, self.scenario)
            if late == missed:
                return None
            before, meeting = meeting, meeting - late * (meeting - before) / (late - missed)
        return None


def _turned(best: ScpRun, task: Task) -> Trajectory:
    """The trip of a run, turned and dilated to end at the goal of a task, with the headings of the task's ends."""
    trip, scenario = best.trajectory, task.scenario
    start, goal = scenario.start.position, scenario.goal.position
    scale = dist(start, goal) / dist(start, best.runs.task.scenario.goal.position)
    space, frame = trip.space.in_units(scale, scale), PlanningFrame.between(start, goal, scenario.start.time)
    ends = end_conditions(scenario, frame, space, for_scene(task.settings).max_offset)
    theta = ends.around(np.clip(scale * trip.theta, ends.lower, ends.upper)[ends.free])
    return Trajectory.of(space, theta, trip.beta / scale, scale * trip.travel_time)
