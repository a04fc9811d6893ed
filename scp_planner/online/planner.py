"""Planning while driving: observe, refresh the zones, replan before a deadline, fall back if nothing better is safe.

Each call of :meth:`Planner.replan` begins with what is left of the last plan, makes the zones anew from all that has
been observed, and improves the trip by a few steps of the loop. Now and then it looks for other ways round.

**What is promised.** A plan whose status is ``certified`` keeps clear of all zones, up to the goal. Zones of observed
obstacles grow with time, so far ahead they may leave no room for any trip; a vehicle that waited for a trip that is
certain to its end would often wait for ever. So a plan is also *safe* if the vehicle can begin it and still stop: a
stop that leaves it, at the next replan or somewhat later, is certified until the vehicle stands. The trip itself is
planned against *foreseen* zones, which are those that will be looked at when the vehicle gets there
(`scp_planner.online.foresight`). With ``Safety.TRIP`` only whole trips will do.

**What happens else.** In this order: the last plan is ``kept`` while its certificate holds with the refreshed zones;
it is ``repaired`` by driving the same path slower; the vehicle is ``braking`` along its path, certified until it
stands; it is ``evading``, clear of the zones of the highest level that a trip or a stop from it is found for; or it
brakes in the least bad way. From a stop the planner recovers by itself.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from threading import Lock
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.certificate.verdict import Certificate, Ends
from scp_planner.errors import Fault, ScenarioError
from scp_planner.online.arguments import _covariance, _point, check_number, checked_estimate, checked_motion
from scp_planner.online.foresight import foreseen
from scp_planner.online.looks import (
    FEWEST_LOOK_STEPS,
    FIRST_LOOK_TIME,
    HOPELESS,
    LOOK_GAIN,
    LOOK_GAIN_TIME,
    LOOK_RUNS,
    LOOK_SOONER,
    LOOK_TIME_DECAY,
    LOOK_TRUST,
    SPARED,
    _Look,
)
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.online.plan import OnlinePlan, Outcome
from scp_planner.online.remaining import State, _guide_from, remaining_trip
from scp_planner.online.stops import STANDING, fits, stop_now, straight_stop
from scp_planner.online.updates import Forecast, Update
from scp_planner.online.vetting import COMMITMENT, Moment, Refusal, Stop, Vetted, Vetting, refused
from scp_planner.planning.plan import PlanStatus
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Model, Obstacle, Scenario, Start
from scp_planner.scenario.motions import GivenMotion
from scp_planner.scenario.places import anchored
from scp_planner.scenario.shapes import Shape
from scp_planner.scenario.units import NaturalUnits
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.parameters import LOOP
from scp_planner.scp.record import FEASIBILITY, LoopStatus
from scp_planner.search.first_trips import bows, trip_along
from scp_planner.search.ways import WaySearch, ways
from scp_planner.settings.online import OnlineSettings, Safety
from scp_planner.settings.planning import SceneSettings, Settings, for_scene
from scp_planner.solvers import QpSolver, solver_named
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import corridor_zones
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

logger = logging.getLogger(__name__)

SETTINGS = SceneSettings(clearance_margin=0.01, limit_margin=0.005, samples=100, tolerance=2e-3)
"""Of the loop, unless others are given: plans are for a moment only, and there is no time to make up for small misses
between samples."""
WARM_TRUST = TrustRegion(theta=0.5, beta=1.5, rho=0.1)
NEAR_GOAL = 0.4
"""Units of time. With less of the trip left, the last plan is driven to its end if its certificate holds."""
ARRIVED = 1e-3
"""Units of length."""
VIOLATION_COST = 5.0
"""Units of time to one of length. What the entry into a foreseen zone counts, in comparing ways."""
UNFINISHED_SOONER = 2
"""A plan that does not keep all limits or foreseen zones yet is improved so many times as often."""
NEARLY_CLEAR = 5e-3
"""Units of length. Another way that enters foreseen zones, which change with each observation, by less than this may be
driven."""
SLOWER = 5e-3
"""Units of time. By how much later a new plan may arrive before the last one is preferred, if that still holds."""
LOWER_LEVELS = (0.75, 0.5, 0.25, 0.1)
"""Sizes of regions, as shares of those at the level asked for, that trips keep clear of where nothing does better."""
EVADING_STEPS = 8
"""Steps of the loop for each of them."""
EASINGS = (0.6, 0.25, 0.0)
"""Shares of the planned acceleration that are tried to repair a plan; the rest is braking."""


@dataclass
class _Replan:
    """One call of :meth:`Planner.replan`."""

    moment: Moment
    began: float
    deadline: float
    timings: dict[str, float] = field(default_factory=dict)
    clock: float = 0.0

    def lap(self, stage: str) -> None:
        """Count the time since the last lap to a stage."""
        clock = perf_counter()
        self.timings[stage] = self.timings.get(stage, 0.0) + clock - self.clock
        self.clock = clock


class Planner:
    """A planner that is called again and again while the vehicle drives.

    Parameters
    ----------
    scenario : Scenario
        Vehicle, goal, bounds, confidence, and what is known of obstacles so far. A latest arrival is not looked at:
        the plans are as fast as they may be, and their arrival time tells.
    settings : Settings, optional
        Of the loop. Accelerations are piecewise constant here.
    online : OnlineSettings, optional
    solver : str or QpSolver, optional
        Overrides ``settings.solver``: a name, or a solver of one's own.

    Attributes
    ----------
    plan : OnlinePlan or None
        The last answer.
    online : OnlineSettings
        With the period that the scene decides, if that was left open.
    notes : deque of str
        What was odd about observations, the newest last.
    solver : QpSolver
        Of the subproblems.

    Raises
    ------
    ValueError
        If no solver has that name.
    ScenarioError
        If the scenario limits the jerk.
    """

    def __init__(
        self,
        scenario: Scenario,
        settings: Settings | None = None,
        online: OnlineSettings | None = None,
        solver: str | QpSolver | None = None,
    ) -> None:
        if scenario.vehicle.max_jerk is not None:
            text = "must be null online: the vehicle has to be able to brake at once"
            raise ScenarioError(scenario.name, [Fault("vehicle.max_jerk", scenario.vehicle.max_jerk, text)])
        self._units = units = NaturalUnits.of(scenario)
        scenario = units.scenario(scenario)
        settings = SETTINGS if settings is None else for_scene(settings, units)
        if isinstance(solver, str):
            settings, solver = replace(settings, solver=solver), None
        self.settings = replace(settings, acceleration_degree=0)
        self._online = (online or OnlineSettings()).for_scene(units)
        self.online = replace(online or OnlineSettings(), period=self._online.period * units.time)
        self.plan: OnlinePlan | None = None
        self._last: OnlinePlan | None = None
        self._zones: tuple[ThreatZone, ...] = ()
        self.notes: deque[str] = deque(maxlen=100)
        self.obstacles = ObstacleTracks(
            scenario.confidence,
            self._online.margin(scenario.vehicle.max_speed),
            self._online.newcomers,
            self._online.watch,
        )
        self.obstacles.add(*scenario.obstacles)
        # Late or not, the vehicle drives on as fast as it may.
        in_time = scenario.goal.model_copy(update={"latest_arrival": None})
        self.given = anchored(scenario.model_copy(update={"goal": in_time}))
        self.solver: QpSolver = solver or solver_named(settings.solver)
        self._vetting = Vetting(
            self._online.period, self._online.safety is Safety.STOP, self._online.tracking_error, units
        )
        self._breakpoints = tuple(float(b) for b in np.linspace(0.0, 1.0, settings.acceleration_spans + 1))
        stopping = scenario.vehicle.max_speed / scenario.vehicle.max_deceleration
        self._foresight = self._online.period + self._online.reaction_time + stopping + 0.5 * COMMITMENT
        if self._online.foresight is not None:
            self._foresight = self._online.foresight
        self._state: State | None = None
        self._clock: float | None = None
        self._cycle = 0
        self._look_time = FIRST_LOOK_TIME
        self._look: _Look | None = None
        self._improved = self._looked = 0
        self._good_enough = True
        self._inbox: deque[tuple[str, float, tuple[float, float], Array | None]] = deque()
        self._updates: deque[Update | Forecast] = deque()
        self._work = Lock()

    @property
    def zones(self) -> tuple[ThreatZone, ...]:
        """The zones that the last plan was made with: with the planner's margin."""
        return tuple(zone.outside(self._units) for zone in self._zones)

    # what is seen

    def observe(self, obstacle: str, time: float, position: ArrayLike, covariance: ArrayLike | None = None) -> None:
        """Take in an observation of an obstacle; during a replan, of another thread, between two of its stages.

        Parameters
        ----------
        obstacle : str
            Id of an obstacle that is known.
        time : float
            When it was seen, absolute, s; late ones are welcome.
        position : (2,)
            m.
        covariance : (2, 2), optional
            m2; else that of the scenario.

        Raises
        ------
        ValueError
            If the id is unknown, or a number is not finite.
        """
        if obstacle not in self.obstacles.tracks:
            raise ValueError(f"observe: there is no obstacle {obstacle!r}; add_obstacle adds one")
        place = _point("position", position)
        check_number("time", time)
        units = self._units
        noise = None if covariance is None else _covariance(covariance) / units.length**2
        self._inbox.append((obstacle, units.instant(float(time)), units.place(place), noise))
        self._look_in()

    def update_obstacle(
        self,
        obstacle: str,
        time: float,
        position: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike | None = None,
        *,
        covariance: ArrayLike,
    ) -> None:
        """Take what a tracker says of an obstacle in place of all that was known of it, at any time as :meth:`observe`.

        Parameters
        ----------
        obstacle : str
            Id of an obstacle that is known; its model says how it goes on from there.
        time : float
            What the state is of, absolute, s; what comes after a newer one is left out.
        position, velocity, acceleration : (2,)
            m, m/s, m/s2; without an acceleration the velocity is kept up.
        covariance : (4, 4) or, with an acceleration, (6, 6)
            Of the error of the state in the order x, y, vx, vy, ax, ay, in m and s.

        Raises
        ------
        ValueError
            If the id is unknown, a number is not finite, or the covariance is none.
        """
        if obstacle not in self.obstacles.tracks:
            raise ValueError(f"update_obstacle: there is no obstacle {obstacle!r}; add_obstacle adds one")
        self._updates.append(
            Update(obstacle, self._units.estimate(checked_estimate(time, position, velocity, acceleration, covariance)))
        )
        self._look_in()

    def update_motion(self, obstacle: str, motion: GivenMotion | Mapping[str, Any]) -> None:
        """Take in a new prediction for a known obstacle: it replaces all that was known of its motion.

        During a replan, of another thread, it is taken in between two of its stages. It holds until there is another
        one, or until the obstacle is observed: then its motion is estimated from what is observed.

        Parameters
        ----------
        obstacle : str
            Its id.
        motion : Motion, Course, Futures or mapping
            As in the scenario: exact, with a covariance, or several futures with their weights.

        Raises
        ------
        ValueError
            If the id is unknown or a value is not allowed.
        """
        if obstacle not in self.obstacles.tracks:
            raise ValueError(f"update_motion: there is no obstacle {obstacle!r}; add_obstacle adds one")
        self._updates.append(Forecast(obstacle, self._units.motion(checked_motion(obstacle, motion))))
        self._look_in()

    def _look_in(self) -> None:
        """Take in what is new, unless a replan is at work, which does it itself."""
        if self._work.acquire(blocking=False):
            try:
                self._take_in()
            finally:
                self._work.release()

    def _take_in(self) -> bool:
        """Take in what has been observed; return whether there was anything."""
        any_new = bool(self._inbox) or bool(self._updates)
        while self._updates:
            update = self._updates.popleft()
            fault = update.taken_in(self.obstacles)
            if fault is not None and isinstance(update, Update):
                self.notes.append(f"{update.obstacle} at t = {self._units.absolute(update.given.time):.3f} s: {fault}")
        while self._inbox:
            name, time, position, covariance = self._inbox.popleft()
            if name not in self.obstacles.tracks:
                continue
            fault = self.obstacles.observe(name, time, position, covariance)
            if fault is not None:
                self.notes.append(f"{name} at t = {self._units.absolute(time):.3f} s: {fault}")
        return any_new

    def add_obstacle(
        self,
        obstacle: Obstacle | Mapping[str, Any] | str,
        shape: Shape | Mapping[str, Any] | None = None,
        *,
        covariance: ArrayLike | None = None,
        model: Model | Mapping[str, Any] | str | None = None,
        margin: float = 0.0,
    ) -> None:
        """Take in a new obstacle: one as in a scenario, or the id and shape of one that will be observed.

        Parameters
        ----------
        obstacle : Obstacle, mapping or str
            A whole obstacle, or the id of one that has not been observed yet.
        shape : shape, optional
            With an id: as in the scenario, such as ``{"disc": 0.3}``.
        covariance : (2, 2), optional
            With an id: of one observation, m2; else it comes with each, or is estimated.
        model : Model, mapping or str, optional
            With an id: of its motion, or the name of a ready-made one.
        margin : float
            With an id: extra clearance, m.

        Raises
        ------
        ValueError
            If the id is taken or a value is not allowed.
        """
        if not isinstance(obstacle, str):
            whole = obstacle if isinstance(obstacle, Obstacle) else Obstacle.model_validate(obstacle)
            self._check_new(whole.id)
            self.obstacles.add(self._units.obstacle(whole))
            return
        still = {"position": [0.0, 0.0]}
        parts = {"id": obstacle, "shape": shape, "margin": margin, "motion": still, "model": model or Model()}
        checked = self._units.obstacle(Obstacle.model_validate(parts))
        self._check_new(obstacle)
        noise = None if covariance is None else _covariance(covariance) / self._units.length**2
        self.obstacles.add_unseen(checked.id, checked.shape, checked.model, checked.margin, noise)

    def _check_new(self, name: str) -> None:
        if name in self.obstacles.tracks:
            raise ValueError(f"add_obstacle: there is an obstacle {name!r} already")

    def remove_obstacle(self, obstacle: str) -> None:
        """Forget an obstacle.

        Parameters
        ----------
        obstacle : str
            Its id.

        Raises
        ------
        ValueError
            If the id is unknown.
        """
        if obstacle not in self.obstacles.tracks:
            raise ValueError(f"remove_obstacle: there is no obstacle {obstacle!r}")
        self.obstacles.remove(obstacle)

    @property
    def scenario(self) -> Scenario:
        """What the last plan was made for: the state, what has been observed, and the planner's margin.

        `scp_planner.certify` of this and of a plan that begins now says what the planner says.
        """
        made = self.given
        if self._state is not None:
            made = self._scenario_at(self._state).model_copy(update={"obstacles": self.obstacles.as_obstacles()})
        return self._units.inverse.scenario(made)

    # what to do

    def replan(
        self,
        time: float,
        position: ArrayLike,
        heading: float | None,
        speed: float,
        acceleration: float | None = None,
        deadline: float | None = None,
    ) -> OnlinePlan:
        """Plan anew from the present state.

        Parameters
        ----------
        time : float
            Absolute, s; not before that of the last call.
        position : (2,)
            m.
        heading : float or None
            rad; None: free.
        speed : float
            m/s.
        acceleration : float, optional
            Along the path, m/s2. Not used: accelerations of the plan may jump.
        deadline : float, optional
            Wall time in s from now by which the answer is wanted. Without one the work is limited by steps only,
            and the same calls give the same plans.

        Returns
        -------
        OnlinePlan

        Raises
        ------
        ValueError
            If a number is not finite or time goes backwards.
        """
        began = perf_counter()
        state = self._checked_state(time, position, heading, speed, acceleration, deadline)
        end = math.inf if deadline is None else began + deadline - self._online.reserve
        with self._work:
            now = _Replan(self._moment(state), began, end, clock=began)
            now.lap("zones")
            plan = self._answer(now)
        self._last, self._state, self._zones = plan, state, now.moment.zones
        self._clock = float(time)
        self._cycle += 1
        self.plan = plan.outside(self._units)
        return self.plan

    def _checked_state(
        self,
        time: float,
        position: ArrayLike,
        heading: float | None,
        speed: float,
        acceleration: float | None,
        deadline: float | None,
    ) -> State:
        check_number("time", time)
        if self._clock is not None and time < self._clock:
            raise ValueError(f"time: {time!r} is before {self._clock!r}, the time of the last replan")
        place = _point("position", position)
        check_number("speed", speed)
        for name, value in (("heading", heading), ("acceleration", acceleration)):
            if value is not None:
                check_number(name, value)
        if deadline is not None and not (isinstance(deadline, int | float | np.number) and deadline > 0.0):
            raise ValueError(f"deadline: {deadline!r} is not a positive number of seconds")
        # The sensor of a vehicle that stands may show a speed below nothing.
        units = self._units
        return State(
            units.instant(float(time)),
            units.place(place),
            None if heading is None else float(heading),
            max(float(speed), 0.0) / units.speed,
        )

    def _scenario_at(self, state: State) -> Scenario:
        start = Start.model_construct(
            time=state.time, position=state.position, heading=state.heading, speed=state.speed, acceleration=None
        )
        changes: dict[str, Any] = {"start": start, "obstacles": ()}
        if self.given.guide is not None:
            changes["guide"] = _guide_from(self.given.guide, state.position)
        return self.given.model_copy(update=changes)

    def _moment(self, state: State) -> Moment:
        self._take_in()
        self._forget(state.time)
        return Moment(state, self._scenario_at(state), self.obstacles.zones(state.time) + corridor_zones(self.given))

    def _forget(self, time: float) -> None:
        for track in list(self.obstacles.tracks.values()):
            if track.times and track.fixed is None and time - track.times[-1] > self._online.forget_after:
                self.notes.append(f"{track.id}: forgotten, not seen for {self.online.forget_after:g} s")
                self.obstacles.remove(track.id)

    def at_goal(self, position: ArrayLike) -> bool:
        """Whether a position, (2,) m, is the goal: nearly there or within its radius, and the tracking error."""
        return self._is_there(self._units.place(_point("position", position)))

    def _is_there(self, place: tuple[float, float]) -> bool:
        goal = self.given.goal
        return math.dist(place, goal.position) <= max(goal.radius, ARRIVED) + self._online.tracking_error

    def _answer(self, now: _Replan) -> OnlinePlan:
        last = self._last if self._last is not None and self._last.outcome is not Outcome.BRAKING else None
        state = now.moment.state
        if self._is_there(state.position):
            # Within the goal's radius the vehicle may still be coming to rest, or on its way to where it arrives.
            kept = None
            if last is not None and last.arrival_time > state.time and state.speed > STANDING:
                kept = self._vetting.vet_kept(now.moment, last.trip)
            if kept is not None:
                return self._plan_of(kept, now, Outcome.KEPT, "the goal is near")
            return replace(self._standing(now, "arrived"), arrived=True)
        if last is not None and last.arrival_time - state.time < NEAR_GOAL:
            kept = self._vetting.vet_kept(now.moment, last.trip)
            if kept is not None:
                return self._plan_of(kept, now, Outcome.KEPT, "the goal is near")
        if last is not None and self._cycle - self._improved < self._improve_every:
            kept = self._vetting.vet_on(now.moment, last.trip, self._foreseen, last.branch_time, last.certified)
            now.lap("certificate")
            if kept is not None:
                return self._keep(now, kept)
        self._improved = self._cycle
        problem = self._problem(now)
        loop = ScpLoop(problem, self.solver)
        ahead = None if self._last is None else remaining_trip(problem, self._last.trip, state)
        now.lap("problem")
        best, why = self._improve(now, loop, None if last is None else ahead)
        if best is None:
            return self._fall_back(now, problem, last, ahead, why)
        later = last is not None and best.arrival > last.arrival_time + SLOWER
        if last is not None and (later or (last.certified and not best.certified)):
            kept = self._vetting.vet_kept(now.moment, last.trip)
            now.lap("certificate")
            if kept is not None:
                why = "is faster than what was found" if later else "is certified to the goal, unlike what was found"
                return self._plan_of(kept, now, Outcome.KEPT, f"it holds, and {why}")
        self._good_enough = best.feasible
        return self._plan_of(best, now, Outcome.IMPROVED, why)

    @property
    def _improve_every(self) -> int:
        """Replans between improvements: fewer after one that is not good enough yet."""
        every = self._online.improve_every
        return every if self._good_enough else max(every // UNFINISHED_SOONER, 1)

    def _keep(self, now: _Replan, kept: Vetted) -> OnlinePlan:
        """Drive on by the last plan, unless a look at other ways, where one is due, finds a better one."""
        if self._look_is_due(now, kept):
            loop = ScpLoop(self._problem(now), self.solver)
            now.lap("problem")
            other, _ = self._look_round(now, loop, kept)
            if other is not None:
                return self._plan_of(other, now, Outcome.IMPROVED, "another way round")
        return self._plan_of(kept, now, Outcome.KEPT, "it holds, and is improved at another replan")

    def _foreseen(self, batch: ZoneBatch, clock: float = 0.0) -> ZoneBatch:
        """The zones that trips are planned among, of those on a clock that shows a time now."""
        if self._online.safety is Safety.TRIP:
            return batch
        return foreseen(batch, self._foresight, self.obstacles.learning(), clock)

    def _problem(self, now: _Replan) -> Problem:
        problem = build_problem(now.moment.scenario, (), self.settings, self._breakpoints)
        batch = self._foreseen(now.moment.batch)
        return problem.among(batch.inflated(np.full(batch.size, self.settings.clearance_margin)))

    def _improve(self, now: _Replan, loop: ScpLoop, ahead: Trajectory | None) -> tuple[Vetted | None, str]:
        """Continue the last plan and, where that is due, look at other ways round."""
        best: Vetted | None = None
        why, refused = "first plan", ""
        if ahead is not None:
            most = self._online.iterations
            if self._last is not None and self._vetting.is_on(now.moment, self._last.trip):
                most = max(most // 2, 1)  # there is a plan to fall back on, and the next replans go on
            run = loop.run(ahead, most, deadline=now.deadline, trust=WARM_TRUST, enough=1)
            now.lap("scp")
            found = self._vet(now, loop.problem, run.evaluation.trajectory, run.evaluation, len(run.record))
            if isinstance(found, Vetted):
                best, why = found, "the last plan, continued"
            else:
                refused = found.why
        if best is None and self._look_is_due(now, best):
            best, said = self._look_round(now, loop, None)
            why = "first plan" if self._last is None else "another way round"
            refused = refused or said
        return best, why if best is not None else refused

    def _look_is_due(self, now: _Replan, best: Vetted | None) -> bool:
        """Whether there is to be a look at other ways in this replan: at once where there is nothing to drive."""
        if self._last is None:
            return True  # a plan is worth waiting for only where there is none at all
        every = self._online.look_every // (1 if best is None or best.violation <= NEARLY_CLEAR else LOOK_SOONER)
        if best is not None and self._look is None and self._cycle - self._looked < every:
            return False
        # The search for ways cannot be broken off.
        in_time = perf_counter() + self._look_time < now.deadline
        if not in_time:
            self._look_time *= LOOK_TIME_DECAY
        return in_time

    def _look_round(self, now: _Replan, loop: ScpLoop, best: Vetted | None) -> tuple[Vetted | None, str]:
        """Look for a way that is clearly faster than the best so far, or for any; go on with it at the next replan."""
        began, problem, first = perf_counter(), loop.problem, self._last is None
        cutoff = math.inf
        if best is not None:
            tau = best.arrival - now.moment.state.time + VIOLATION_COST * best.violation
            cutoff = tau - max(LOOK_GAIN * tau, LOOK_GAIN_TIME)
        if self._look is None:
            runs = self._online.first_runs if best is None else LOOK_RUNS
            self._look = _Look(self._starts(problem, cutoff), runs)
        self._looked = self._cycle
        # Only a trip that keeps clear takes the place of one that is certified to the goal.
        strict = first or (best is not None and best.certified)
        tolerance = FEASIBILITY if strict else NEARLY_CLEAR
        found, said = self._try_ways(now, loop, self._look, cutoff, tolerance, best is None)
        if first or (found is not None and found.violation <= NEARLY_CLEAR):
            self._look = None
        if not first:
            self._look_time = max(LOOK_TIME_DECAY * self._look_time, perf_counter() - began)
        return found, said

    def _try_ways(
        self, now: _Replan, loop: ScpLoop, look: _Look, cutoff: float, tolerance: float, any_will_do: bool
    ) -> tuple[Vetted | None, str]:
        """Go on with a look; return the first way that is clear and fast enough, or, if any will do, one that is safe.

        For a first plan all ways are tried, and the fastest is returned.
        """
        problem, first = loop.problem, self._last is None
        most = self.settings.max_iterations if first else self._online.look_iterations
        left = most * self._online.first_runs
        if not first:
            left = max(self._online.look_steps - (0 if any_will_do else SPARED), 1)
        spare: Vetted | None = None
        said = "no way round was found"
        while left > 0 and perf_counter() <= now.deadline:
            if look.trip is None:
                more = look.begin_next()
                now.lap("search")
                if not more:
                    self._look = None
                if not more or not first:
                    break  # the search is work enough for one replan
            assert look.trip is not None
            start, trust = look.trip.trajectory, LOOP.first_trust
            if look.trip.frame != problem.frame:
                start = remaining_trip(problem, look.trip, now.moment.state)
                trust = LOOK_TRUST if look.steps else LOOP.first_trust
            enough = None if first else FEWEST_LOOK_STEPS
            run = loop.run(start, min(left, most - look.steps), cutoff, now.deadline, trust, enough)
            now.lap("scp")
            evaluation, steps = run.evaluation, max(len(run.record), 1)
            look.trip, look.steps, left = Trip(problem.frame, evaluation.trajectory), look.steps + steps, left - steps
            clear = evaluation.worst_violation <= tolerance
            faster = evaluation.trajectory.travel_time + VIOLATION_COST * evaluation.worst_violation < cutoff
            ended = run.status not in (LoopStatus.ITERATION_LIMIT, LoopStatus.TIME_LIMIT) or look.steps >= most
            hopeful = (
                any_will_do and spare is None and (ended or left <= 0) and (first or self._is_hopeful(now, evaluation))
            )
            if (clear and faster) or hopeful:
                vetted = self._vet(now, problem, evaluation.trajectory, evaluation, look.steps)
                ended = ended or clear
                if isinstance(vetted, Refusal):
                    said = vetted.why
                elif clear and not first:
                    return vetted, ""
                elif clear or spare is None:
                    spare, cutoff = vetted, vetted.trip.trajectory.travel_time if clear else cutoff
            if ended:
                look.trip = None
                if not first:
                    break
        return spare, said

    @staticmethod
    def _is_hopeful(now: _Replan, evaluation: Evaluation) -> bool:
        """Whether a way that is not clear may become so: others move on, limits do not.

        A vehicle that stands waits for a clear way rather than creep into a dead end.
        """
        return now.moment.state.speed > STANDING and float(evaluation.limit_violation.max()) <= HOPELESS

    def _starts(self, problem: Problem, cutoff: float) -> Iterator[Trip]:
        any_way = False
        search = WaySearch(problem)
        for way in ways(search, self.settings.searches, cutoff + LOOK_GAIN_TIME):
            any_way = True
            yield Trip(problem.frame, trip_along(problem, way))
        if not any_way and not math.isfinite(cutoff):
            for bow in bows(problem):
                yield Trip(problem.frame, bow)

    def _vet(
        self, now: _Replan, problem: Problem, trajectory: Trajectory, evaluation: Any = None, iterations: int = 0
    ) -> Vetted | Refusal:
        """Certify a trip, with the newest observations."""
        if self._inbox:
            now.moment = self._moment(now.moment.state)
        branch = math.inf if self._last is None else self._last.branch_time
        vetted = self._vetting.vet(now.moment, problem, trajectory, evaluation, iterations, branch)
        now.lap("certificate")
        return vetted

    # what is left

    def _fall_back(
        self, now: _Replan, problem: Problem, last: OnlinePlan | None, ahead: Trajectory | None, why: str
    ) -> OnlinePlan:
        """Keep the last plan, or drive its path slower, or brake."""
        moment = now.moment
        if last is not None:
            kept = self._vetting.vet_kept(moment, last.trip)
            if kept is not None:
                return self._plan_of(kept, now, Outcome.KEPT, f"nothing better was found: {why}")
            if last.stop is not None:
                kept = self._vetting.vet_kept_stop(moment, last.trip, Stop(last.stop, last.branch_time))
                if kept is not None:
                    return self._plan_of(kept, now, Outcome.KEPT, f"a stop from it still holds; {why}")
        if last is not None and ahead is not None:
            repaired = self._repair(now, problem, ahead)
            if repaired is not None:
                return self._plan_of(repaired, now, Outcome.REPAIRED, why)
        return self._brake(now, problem, ahead, why)

    def _repair(self, now: _Replan, problem: Problem, ahead: Trajectory) -> Vetted | None:
        """Drive the same path slower: ease off for a while, then go on, or stop if need be."""
        for share in EASINGS:
            if perf_counter() > now.deadline:
                return None
            beta = ahead.beta.copy()
            beta[0] = share * max(beta[0], 0.0) - (1.0 - share) * problem.limits.deceleration
            trial = Trajectory.of(problem.space, ahead.theta, beta)
            if not np.isfinite(trial.travel_time) or trial.speed_control_points().min() < 0.0:
                continue
            vetted = self._vet(now, problem, trial)
            if isinstance(vetted, Vetted):
                return vetted
        return None

    def _evade(self, now: _Replan, ahead: Trajectory | None, why: str) -> OnlinePlan | None:
        """What keeps clear at the highest level at which anything is found: a stop, or a trip that can be stopped."""
        moment = now.moment
        if ahead is None or not moment.growing:
            return None
        for share in LOWER_LEVELS:
            if perf_counter() > now.deadline:
                break
            lower = _Replan(moment.with_smaller_zones(share), now.began, now.deadline, now.timings, now.clock)
            problem = self._problem(lower)
            loop = ScpLoop(problem, self.solver)
            for start in chain([ahead], (each.trajectory for each in islice(self._starts(problem, math.inf), 1))):
                run = loop.run(start, EVADING_STEPS, deadline=now.deadline, trust=LOOP.first_trust, enough=1)
                steps, trajectory = len(run.record), run.evaluation.trajectory
                found = self._vetting.vet(lower.moment, problem, trajectory, run.evaluation, steps)
                if isinstance(found, Vetted):
                    text = f"{why}; clear of zones whose uncertainty is {share:g} times as large"
                    trip = Vetted(found.trip, refused(found.certificate), None, iterations=steps)
                    return self._plan_of(trip, now, Outcome.EVADING, text)
        return None

    def _brake(self, now: _Replan, problem: Problem, ahead: Trajectory | None, why: str) -> OnlinePlan:
        """The first certified stop, or the one that does least harm."""
        moment = now.moment
        if moment.state.speed <= STANDING:
            return self._standing(now, why)
        least: tuple[float, Trip, Certificate] | None = None
        for trip in self._stops(moment, problem, ahead):
            stop = Stop(trip, trip.frame.time)
            since = moment.state.time if trip.frame.time < moment.state.time else None
            if since is not None and since >= stop.stands:
                continue
            certificate = moment.certify(
                trip, since=since, until=stop.stands, ends=Ends.START, motions=self._vetting.motions
            )
            if certificate.holds:
                text = f"{why}; the stop is certified until the vehicle stands; what moves may still reach it"
                return self._plan_of(Vetted(trip, certificate, stop), now, Outcome.BRAKING, text)
            if least is None or certificate.clearance.minimum > least[0]:
                least = certificate.clearance.minimum, trip, certificate
        evading = self._evade(now, ahead, why)
        if evading is not None:
            return evading
        assert least is not None, "the last stop begins now"
        _, trip, certificate = least
        harm = "; ".join(str(violation.outside(self._units)) for violation in certificate.violations)
        text = f"{why}; no stop is certified, this is the least bad: {harm}"
        return self._plan_of(Vetted(trip, certificate, None), now, Outcome.BRAKING, text)

    def _stops(self, moment: Moment, problem: Problem, ahead: Trajectory | None) -> Iterator[Trip]:
        if self._last is not None and self._last.stop is not None and self._vetting.is_on(moment, self._last.stop):
            yield self._last.stop
        if ahead is not None:
            along = stop_now(ahead.path, problem.space.start_speed, problem.limits.deceleration)
            if fits(along):
                yield Trip(problem.frame, along)
        yield straight_stop(moment.state, problem.limits, self.settings, self._breakpoints)

    def _standing(self, now: _Replan, why: str) -> OnlinePlan:
        moment = now.moment
        limits = Limits.of(moment.scenario)
        trip = straight_stop(replace(moment.state, speed=0.0), limits, self.settings, self._breakpoints)
        certificate = moment.certify(trip, since=moment.state.time, until=moment.state.time, ends=Ends.START)
        stop = Stop(trip, trip.frame.time) if certificate.holds else None
        return self._plan_of(Vetted(trip, certificate, stop), now, Outcome.BRAKING, f"{why}; the vehicle stands")

    def _plan_of(self, vetted: Vetted, now: _Replan, outcome: Outcome, why: str) -> OnlinePlan:
        if vetted.certified and outcome is not Outcome.BRAKING:
            status = PlanStatus.CERTIFIED
        else:
            status = PlanStatus.FEASIBLE if vetted.feasible else PlanStatus.INFEASIBLE
        return OnlinePlan(
            scenario=self.given.name,
            status=status,
            reason=why,
            trip=vetted.trip,
            method="scp",
            solver=self.solver.name,
            iterations=vetted.iterations,
            wall_time=perf_counter() - now.began,
            clearance=vetted.certificate.clearance,
            limits=vetted.certificate.limits,
            timings=now.timings,
            outcome=outcome,
            stop=None if vetted.stop is None else vetted.stop.trip,
            branch_time=math.inf if vetted.stop is None else vetted.stop.branch,
        )
