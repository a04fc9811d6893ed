"""Planning while driving: observe, refresh the zones, replan before a deadline, fall back if nothing better is safe.

Each call of :meth:`Planner.replan` begins with what is left of the last plan, makes the zones anew from all that has
been observed, and improves the trip by a few steps of the loop. Now and then it looks for other ways round.

**What is promised.** A plan whose status is ``certified`` keeps clear of all zones, up to the goal. Zones of observed
obstacles grow with time, so far ahead they may leave no room for any trip; a vehicle that waited for a trip that is
certain to its end would often wait for ever. So a plan is also *safe* if the vehicle can begin it and still stop: the
stop that leaves the plan at the next replan is certified until the vehicle stands. The trip itself is planned against
*foreseen* zones, which are those that will be looked at when the vehicle gets there (`scp_planner.refresh`). With
``Safety.TRIP`` only whole trips will do.

**What happens else.** In this order: the last plan is ``kept`` while its certificate holds with the refreshed zones;
it is ``repaired`` by driving the same path slower; or the vehicle is ``braking`` along its path, certified until it
stands, or else in the least bad way. From a stop the planner recovers by itself.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scp_planner.braking import STANDING, fits, room_to_stop, standing_from, stop_after, stop_now, straight_stop
from scp_planner.certificate import Certificate, Ends, certify_trip
from scp_planner.linearisation import TrustRegion
from scp_planner.plan import Plan, PlanStatus, Trip
from scp_planner.problem import Problem, build_problem
from scp_planner.refresh import GATE_PROBABILITY, Newcomers, ObstacleTracks, foreseen
from scp_planner.remaining import State, remaining_trip
from scp_planner.scenario import Model, Obstacle, Scenario, Shape, Start
from scp_planner.scp import Run, ScpLoop
from scp_planner.seeds import WaySearch, bows, ways
from scp_planner.settings import Settings
from scp_planner.solvers import QpSolver, solver_named
from scp_planner.trajectory import Trajectory
from scp_planner.zones import ThreatZone, ZoneBatch

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)

WARM_TRUST = TrustRegion(theta=0.5, beta=1.5, rho=0.1)
STEEPEST = 1.25
"""rad. Largest angle between heading and goal direction at which a path over the straight guide is fitted."""
NEAR_GOAL = 0.4
"""s. With less of the trip left than this, the last plan is driven to its end if its certificate holds."""
ARRIVED = 1e-3
"""m."""
LOOK_GAIN = 0.02
LOOK_GAIN_TIME = 0.1
"""Another way round must be faster by this share, and by this time in s, for the vehicle to change over to it."""
SLOWER = 5e-3
"""s. By how much later a new plan may arrive before the last one is preferred, if that still holds."""
STOPS = 8
COMMITMENT = 1.75
"""s. A stop may leave a trip so much later than at the next replan: between two obstacles there is no place to stop,
but there is behind them. So many stops are looked at..."""
STOPS_TRIED = 2
"""...and so many certified, at most."""
NOTHING = 1e-6
"""m."""
TINY = 1e-9
"""s."""
EASINGS = (0.6, 0.25, 0.0)
"""What is tried of the planned speed to ease off to, to repair a plan."""


class Outcome(StrEnum):
    """What a replan came to."""

    IMPROVED = "improved"
    """A new plan."""
    KEPT = "kept"
    """The last plan, whose certificate holds with the refreshed zones."""
    REPAIRED = "repaired"
    """The path of the last plan, driven slower."""
    BRAKING = "braking"
    """A stop along the path."""


class Safety(StrEnum):
    """What must be certified before a plan is driven."""

    STOP = "stop"
    """The trip up to the next replan and a stop from there."""
    TRIP = "trip"
    """The trip up to the goal."""


@dataclass(frozen=True)
class OnlineSettings:
    """Settings of :class:`Planner`.

    Attributes
    ----------
    period : float
        Longest time between two replans, s.
    tracking_error : float
        Largest distance between the vehicle and where its plan has it, m. Zones are larger by this.
    reaction_time : float
        Time between a replan and the moment from which the vehicle follows it, s. At its top speed the vehicle drives
        on by ``reaction_time * max_speed`` before it begins to brake, and zones are larger by that too.
    safety : Safety
    foresight : float or None
        See `scp_planner.refresh`, s. None: the time to react, to the next replan and to stop.
    iterations : int
        Steps of the loop in one replan, at most.
    look_every : int
        Replans from one look at other ways round to the next.
    look_iterations : int
        Steps of the loop from another way, at most.
    first_runs : int
        Ways that the first plan is started from, at most.
    newcomers : Newcomers
    gate_probability : float
        An observation less probable than this is left out, see `scp_planner.refresh`.
    forget_after : float
        An obstacle that has not been seen for so long has gone, s.
    """

    period: float = 0.1
    tracking_error: float = 0.0
    reaction_time: float = 0.0
    safety: Safety = Safety.STOP
    foresight: float | None = None
    iterations: int = 3
    look_every: int = 10
    look_iterations: int = 12
    first_runs: int = 4
    newcomers: Newcomers = field(default_factory=Newcomers)
    gate_probability: float = GATE_PROBABILITY
    forget_after: float = math.inf

    def __post_init__(self) -> None:
        for name in ("tracking_error", "reaction_time"):
            _check_number(name, getattr(self, name), 0.0)
        _check_number("period", self.period, 1e-3)
        if self.foresight is not None:
            _check_number("foresight", self.foresight, 0.0)

    def margin(self, max_speed: float) -> float:
        """What is added to zones, m: tracking error, and what the vehicle drives in its reaction time."""
        return self.tracking_error + self.reaction_time * max_speed


@dataclass(frozen=True)
class OnlinePlan(Plan):
    """A plan of :class:`Planner`. ``reason`` tells in words what came about, and why.

    Attributes
    ----------
    outcome : Outcome
    stop : Trip or None
        The certified stop that the vehicle can leave the plan for; the trip itself where that is a certified stop.
    branch_time : float
        Absolute time up to which the stop is driven like the plan, s.
    """

    outcome: Outcome = Outcome.IMPROVED
    stop: Trip | None = None
    branch_time: float = math.inf

    @property
    def safe(self) -> bool:
        """Whether the vehicle can set off: the trip is certified to its end, or a stop from it is."""
        return self.certified or self.stop is not None


@dataclass(frozen=True)
class _Situation:
    """One moment, as the planner sees it."""

    state: State
    scenario: Scenario
    zones: tuple[ThreatZone, ...]
    foreseen: tuple[ThreatZone, ...]
    deadline: float
    began: float

    @property
    def growing(self) -> bool:
        """Whether foreseen zones are smaller than those that are known now."""
        return any(zone.covariances is not None for zone in self.zones)


@dataclass(frozen=True)
class _Stop:
    """A certified stop, and the absolute time up to which it keeps to its trip, s."""

    trip: Trip
    branch: float


@dataclass(frozen=True)
class _Vetted:
    """A trip and what is certified of it."""

    trip: Trip
    certificate: Certificate
    stop: _Stop | None
    feasible: bool = False
    iterations: int = 0

    @property
    def certified(self) -> bool:
        return self.certificate.holds

    @property
    def arrival(self) -> float:
        return self.trip.frame.time + self.trip.trajectory.travel_time


class Planner:
    """A planner that is called again and again while the vehicle drives.

    Parameters
    ----------
    scenario : Scenario
        Vehicle, goal, bounds, confidence, and what is known of obstacles so far.
    settings : Settings, optional
        Of the loop. Accelerations are piecewise constant here.
    online : OnlineSettings, optional
    solver : str, optional
        Overrides ``settings.solver``.

    Raises
    ------
    ValueError
        If no solver has that name.
    """

    def __init__(
        self,
        scenario: Scenario,
        settings: Settings | None = None,
        online: OnlineSettings | None = None,
        solver: str | None = None,
    ) -> None:
        settings = settings or Settings(clearance_margin=5e-3, samples=100)
        if solver is not None:
            settings = replace(settings, solver=solver)
        self.settings = replace(settings, acceleration_degree=0)
        self.online = online or OnlineSettings()
        self._solver: QpSolver = solver_named(settings.solver)
        vehicle = scenario.vehicle
        self.obstacles = ObstacleTracks(
            scenario.confidence,
            self.online.margin(vehicle.max_speed),
            self.online.newcomers,
            self.online.gate_probability,
        )
        for obstacle in scenario.obstacles:
            self.obstacles.add(obstacle)
        self._given = scenario
        self._breakpoints = tuple(float(b) for b in np.linspace(0.0, 1.0, settings.acceleration_spans + 1))
        stopping = vehicle.max_speed / vehicle.max_deceleration
        ahead = self.online.period + self.online.reaction_time + stopping
        self.foresight = ahead if self.online.foresight is None else self.online.foresight
        self.plan: OnlinePlan | None = None
        self.zones: tuple[ThreatZone, ...] = ()
        """Of the last replan, with the planner's margin."""
        self._cycle = 0
        self._time = -math.inf
        self._inbox: deque[tuple[str, float, tuple[float, float], Array | None]] = deque()
        self._busy = False
        self.notes: deque[str] = deque(maxlen=100)
        """What was odd about observations, the newest last."""

    # what is seen

    def observe(self, obstacle: str, time: float, position: ArrayLike, covariance: ArrayLike | None = None) -> None:
        """Take in an observation of an obstacle; during a replan, it is taken in between two of its steps.

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
        _check_number("time", time)
        noise = None if covariance is None else _covariance(covariance)
        self._inbox.append((obstacle, float(time), place, noise))
        if not self._busy:
            self._take_in()

    def _take_in(self) -> bool:
        """Take in what has been observed; return whether there was anything."""
        any_new = bool(self._inbox)
        while self._inbox:
            name, time, position, covariance = self._inbox.popleft()
            if name in self.obstacles.tracks:
                fault = self.obstacles.observe(name, time, position, covariance)
                if fault is not None:
                    self.notes.append(f"{name} at t = {time:.3f} s: {fault}")
                    logger.debug("observation of %s at %s: %s", name, time, fault)
        return any_new

    def add_obstacle(
        self,
        obstacle: Obstacle | Mapping[str, Any] | str,
        shape: Shape | Mapping[str, Any] | None = None,
        *,
        covariance: ArrayLike | None = None,
        model: Model | Mapping[str, Any] | None = None,
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
        model : Model, optional
            With an id: of its motion.
        margin : float
            With an id: extra clearance, m.

        Raises
        ------
        ValueError
            If the id is taken or a value is not allowed.
        """
        if isinstance(obstacle, str):
            checked = Obstacle.model_validate(
                {
                    "id": obstacle,
                    "shape": shape,
                    "margin": margin,
                    "motion": {"position": [0.0, 0.0]},
                    "model": model or Model(),
                }
            )
            self._check_new(checked.id)
            noise = None if covariance is None else _covariance(covariance)
            self.obstacles.add_unseen(checked.id, checked.shape, checked.model, checked.margin, noise)
            return
        whole = obstacle if isinstance(obstacle, Obstacle) else Obstacle.model_validate(obstacle)
        self._check_new(whole.id)
        self.obstacles.add(whole)

    def _check_new(self, name: str) -> None:
        if name in self.obstacles.tracks:
            raise ValueError(f"add_obstacle: there is an obstacle {name!r} already")

    def remove_obstacle(self, obstacle: str) -> None:
        """Forget an obstacle.

        Raises
        ------
        ValueError
            If the id is unknown.
        """
        if obstacle not in self.obstacles.tracks:
            raise ValueError(f"remove_obstacle: there is no obstacle {obstacle!r}")
        del self.obstacles.tracks[obstacle]

    def scenario_at(self, state: State) -> Scenario:
        """The scenario as the planner sees it from a state on: with what it observed, and with its margin."""
        return self._start_at(state).model_copy(update={"obstacles": self.obstacles.as_obstacles()})

    @property
    def scenario(self) -> Scenario:
        """The scenario of the last replan: what its plan was certified for."""
        if self._state is None:
            return self._given
        return self.scenario_at(self._state)

    _state: State | None = None

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
        self._busy = True
        try:
            now = self._situation(state, began, math.inf if deadline is None else began + deadline)
            plan = self._answer(now)
        finally:
            self._busy = False
        self.plan, self._state, self.zones = plan, state, now.zones
        self._cycle += 1
        return plan

    def _checked_state(
        self,
        time: float,
        position: ArrayLike,
        heading: float | None,
        speed: float,
        acceleration: float | None,
        deadline: float | None,
    ) -> State:
        _check_number("time", time)
        if time < self._time:
            raise ValueError(f"time: {time!r} is before {self._time!r}, the time of the last replan")
        place = _point("position", position)
        if heading is not None:
            _check_number("heading", heading)
        _check_number("speed", speed)
        if acceleration is not None:
            _check_number("acceleration", acceleration)
        if deadline is not None and not (deadline > 0.0):
            raise ValueError(f"deadline: {deadline!r} is not a positive number of seconds")
        self._time = float(time)
        # A sensor of a vehicle that stands may show a speed below nothing.
        return State(float(time), place, None if heading is None else float(heading), max(float(speed), 0.0))

    def _start_at(self, state: State) -> Scenario:
        start = Start.model_construct(
            time=state.time, position=state.position, heading=state.heading, speed=state.speed, acceleration=None
        )
        return self._given.model_copy(update={"start": start, "obstacles": (), "guide": None})

    def _situation(self, state: State, began: float, deadline: float) -> _Situation:
        self._take_in()
        self._forget(state.time)
        zones = self.obstacles.zones(state.time)
        return _Situation(
            state,
            self._start_at(state),
            zones,
            foreseen(zones, state.time, self.foresight) if self.online.safety is Safety.STOP else zones,
            deadline,
            began,
        )

    def _forget(self, time: float) -> None:
        gone = [
            track.id
            for track in self.obstacles.tracks.values()
            if track.times and track.fixed is None and time - track.times[-1] > self.online.forget_after
        ]
        for name in gone:
            self.notes.append(f"{name}: forgotten, not seen for {self.online.forget_after:g} s")
            del self.obstacles.tracks[name]

    def _answer(self, now: _Situation) -> OnlinePlan:
        last = self.plan if self.plan is not None and self.plan.outcome is not Outcome.BRAKING else None
        goal = self._given.goal
        away = math.dist(now.state.position, goal.position)
        if away <= max(goal.radius, ARRIVED):
            return self._standing(now, "arrived")
        if last is not None and last.arrival_time - now.state.time < NEAR_GOAL:
            kept = self._vet_kept(now, last)
            if kept is not None and (kept.certified or kept.stop is not None):
                return self._plan_of(kept, now, Outcome.KEPT, "the goal is near")
        problem = self._problem(now, away)
        if problem is None:
            return self._fall_back(now, None, None, "no path over the straight line to the goal begins in this heading")
        loop = ScpLoop(problem, self._solver)
        best, why = self._improve(now, loop, last)
        if best is not None:
            if last is None or best.arrival <= last.arrival_time + SLOWER:
                return self._plan_of(best, now, Outcome.IMPROVED, why)
            kept = self._vet_kept(now, last)
            if kept is not None and kept.certified and kept.arrival < best.arrival - SLOWER:
                return self._plan_of(kept, now, Outcome.KEPT, "it holds, and is faster than what was found")
            return self._plan_of(best, now, Outcome.IMPROVED, why)
        return self._fall_back(now, problem, last, why)

    def _problem(self, now: _Situation, away: float) -> Problem | None:
        heading, goal = now.state.heading, self._given.goal
        if heading is not None:
            ahead = math.atan2(goal.position[1] - now.state.position[1], goal.position[0] - now.state.position[0])
            if abs(math.remainder(heading - ahead, 2.0 * math.pi)) > STEEPEST:
                return None
        return build_problem(now.scenario, now.foreseen, self.settings, self._breakpoints)

    def _improve(self, now: _Situation, loop: ScpLoop, last: OnlinePlan | None) -> tuple[_Vetted | None, str]:
        """Continue the last plan and, where that is due, look at other ways round."""
        best: _Vetted | None = None
        why = "first plan"
        refused = ""
        if last is not None:
            start = remaining_trip(loop.problem, last.trip, now.state)
            run = loop.run(start, self.online.iterations, deadline=now.deadline, trust=WARM_TRUST)
            best, refused = self._vet_run(now, loop.problem, run)
            why = "the last plan, continued"
        every = self.online.look_every if best is not None else max(self.online.look_every // 3, 1)
        due = last is None or self._cycle % every == every - 1
        if due and perf_counter() < now.deadline:
            other, said = self._look(now, loop, best)
            if other is not None:
                best, why = other, "another way round" if last is not None else "first plan"
            elif best is None:
                refused = refused or said
        return best, (why if best is not None else refused)

    def _look(self, now: _Situation, loop: ScpLoop, best: _Vetted | None) -> tuple[_Vetted | None, str]:
        """Look for a way that is clearly faster than the best so far, or for any."""
        cutoff = math.inf
        if best is not None:
            tau = best.trip.trajectory.travel_time
            cutoff = tau - max(LOOK_GAIN * tau, LOOK_GAIN_TIME)
        found: _Vetted | None = None
        said = "no way round was found"
        runs = 1 if best is not None else self.online.first_runs
        iterations = self.online.look_iterations if self.plan is not None else self.settings.max_iterations
        for number, start in enumerate(self._starts(loop.problem, cutoff)):
            if number >= runs or perf_counter() > now.deadline:
                break
            run = loop.run(start, iterations, cutoff, now.deadline)
            if run.evaluation.trajectory.travel_time >= cutoff:
                continue
            vetted, refused = self._vet_run(now, loop.problem, run)
            if vetted is None:
                said = refused
            elif vetted.feasible or (best is None and found is None):
                found, cutoff = vetted, vetted.trip.trajectory.travel_time
                if vetted.feasible and best is not None:
                    break
        return found, said

    def _starts(self, problem: Problem, cutoff: float) -> Any:
        search = WaySearch(problem)
        found = False
        for way in ways(search, self.settings.searches):
            if way.travel_time >= cutoff + LOOK_GAIN_TIME:
                return
            found = True
            yield search.start(way)
        if not found and not math.isfinite(cutoff):
            yield from bows(problem)

    # what is safe

    def _vet_run(self, now: _Situation, problem: Problem, run: Run) -> tuple[_Vetted | None, str]:
        trajectory = run.evaluation.trajectory
        return self._vet(now, problem, trajectory, run.feasible, len(run.record))

    def _vet(
        self, now: _Situation, problem: Problem, trajectory: Trajectory, feasible: bool, iterations: int = 0
    ) -> tuple[_Vetted | None, str]:
        """Certify a trip, or at least a stop from it."""
        trip = Trip(problem.frame, trajectory)
        certificate = certify_trip(now.scenario, trip, now.zones)
        if certificate.holds:
            return _Vetted(trip, certificate, None, feasible, iterations), ""
        refused = "; ".join(str(violation) for violation in certificate.violations)
        if self.online.safety is Safety.TRIP:
            return None, refused
        stop, said = self._certified_stop(now, problem, trajectory)
        if stop is None:
            return None, f"no stop from it: {said}"
        return _Vetted(trip, certificate, stop, feasible, iterations), refused

    def _certified_stop(self, now: _Situation, problem: Problem, trajectory: Trajectory) -> tuple[_Stop | None, str]:
        """A certified stop that leaves a trip at the next replan or later: the one with most room, of a few."""
        batch = ZoneBatch(now.zones, problem.frame, problem.scenario.vehicle.radius)
        leads = self._leads(now, trajectory)
        room = room_to_stop(trajectory, leads, problem.limits.deceleration, batch)
        said = "the goal is nearer than the distance to stop in"
        for index in np.argsort(-room, kind="stable")[:STOPS_TRIED]:
            if room[index] < 0.0:
                said = said if room[index] == -np.inf else "every stop from it would enter a zone"
                break
            stop = stop_after(trajectory, float(leads[index]), problem.limits.deceleration)
            if not fits(stop):
                continue
            trip = Trip(problem.frame, stop)
            until = trip.frame.time + standing_from(stop)
            certificate = certify_trip(now.scenario, trip, now.zones, until=until, ends=Ends.START)
            if certificate.holds:
                return _Stop(trip, now.state.time + float(leads[index])), ""
            said = "; ".join(str(violation) for violation in certificate.violations)
        return None, said

    def _leads(self, now: _Situation, trajectory: Trajectory) -> Array:
        """Times after which a stop may leave a trip, s."""
        return np.minimum(self.online.period + COMMITMENT * np.arange(STOPS) / (STOPS - 1), trajectory.travel_time)

    def _vet_kept(self, now: _Situation, last: OnlinePlan) -> _Vetted | None:
        """The last plan as it is, if the vehicle is where it should be and the certificate holds from now on."""
        if not self._is_on(now, last):
            return None
        certificate = certify_trip(now.scenario, last.trip, now.zones, since=now.state.time)
        return _Vetted(last.trip, certificate, None) if certificate.holds else None

    def _vet_stop(self, now: _Situation, last: OnlinePlan) -> _Vetted | None:
        """The last plan as it is, if it can be followed for a period more and its stop still be made."""
        time = now.state.time
        if last.stop is None or time + self.online.period > last.branch_time + TINY or not self._is_on(now, last):
            return None
        until = last.stop.frame.time + standing_from(last.stop.trajectory)
        certificate = certify_trip(now.scenario, last.stop, now.zones, since=time, until=until, ends=Ends.START)
        if not certificate.holds:
            return None
        return _Vetted(last.trip, replace(certificate, holds=False), _Stop(last.stop, last.branch_time))

    def _is_on(self, now: _Situation, last: OnlinePlan) -> bool:
        """Whether the vehicle is where its plan has it."""
        should = last.position(now.state.time)
        off = math.dist(now.state.position, (float(should[0]), float(should[1])))
        return off <= self.online.tracking_error + NOTHING

    # what is left

    def _fall_back(self, now: _Situation, problem: Problem | None, last: OnlinePlan | None, why: str) -> OnlinePlan:
        """Keep the last plan, or drive its path slower, or brake."""
        if last is not None:
            kept = self._vet_kept(now, last)
            if kept is not None:
                return self._plan_of(kept, now, Outcome.KEPT, f"nothing better was found: {why}")
            kept = self._vet_stop(now, last)
            if kept is not None:
                return self._plan_of(kept, now, Outcome.KEPT, f"the stop from it still holds; {why}")
        if problem is not None and self.plan is not None:
            ahead = remaining_trip(problem, self.plan.trip, now.state)
            if last is not None:
                repaired = self._repair(now, problem, ahead)
                if repaired is not None:
                    return self._plan_of(repaired, now, Outcome.REPAIRED, why)
            return self._brake(now, problem, ahead, why)
        trip = straight_stop(now.state, _limits(now.scenario), self.settings, self._breakpoints)
        return self._stop_plan(now, [trip], why)

    def _repair(self, now: _Situation, problem: Problem, ahead: Trajectory) -> _Vetted | None:
        """Drive the same path slower: ease off for a period, then stop if need be, or go on."""
        limits, space = problem.limits, problem.space
        for share in EASINGS:
            if perf_counter() > now.deadline:
                return None
            first = ahead.beta[0]
            eased = share * max(first, 0.0) - (1.0 - share) * limits.deceleration
            beta = ahead.beta.copy()
            beta[0] = eased
            trial = space.trajectory(ahead.theta, beta)
            if not np.isfinite(trial.travel_time) or trial.speed_control_points().min() < 0.0:
                continue
            vetted, _ = self._vet(now, problem, trial, False)
            if vetted is not None:
                return vetted
        return None

    def _brake(self, now: _Situation, problem: Problem, ahead: Trajectory, why: str) -> OnlinePlan:
        trips = []
        if self.plan is not None and self.plan.stop is not None:
            trips.append(self.plan.stop)
        along = stop_now(ahead.path, problem.space.start_speed, problem.limits.deceleration)
        if fits(along):
            trips.append(Trip(problem.frame, along))
        trips.append(straight_stop(now.state, problem.limits, self.settings, self._breakpoints))
        return self._stop_plan(now, trips, why)

    def _stop_plan(self, now: _Situation, trips: list[Trip], why: str) -> OnlinePlan:
        """The first certified stop, or the one that does least harm."""
        least: tuple[float, Trip, Certificate] | None = None
        stands = now.state.speed <= STANDING
        for trip in trips:
            until = trip.frame.time + standing_from(trip.trajectory)
            since = now.state.time if trip.frame.time < now.state.time else None
            if stands or (since is not None and since >= until):
                continue
            certificate = certify_trip(now.scenario, trip, now.zones, since=since, until=until, ends=Ends.START)
            if certificate.holds:
                text = f"{why}; the stop is certified until the vehicle stands; what moves may still reach it"
                return self._braking(now, trip, certificate, text, True)
            if least is None or certificate.clearance.minimum > least[0]:
                least = certificate.clearance.minimum, trip, certificate
        if least is None:
            return self._standing(now, why)
        _, trip, certificate = least
        harm = "; ".join(str(violation) for violation in certificate.violations)
        return self._braking(
            now, trip, certificate, f"{why}; no stop is certified, this is the least bad: {harm}", False
        )

    def _standing(self, now: _Situation, why: str) -> OnlinePlan:
        trip = straight_stop(replace(now.state, speed=0.0), _limits(now.scenario), self.settings, self._breakpoints)
        certificate = certify_trip(now.scenario, trip, now.zones, until=now.state.time, ends=Ends.START)
        return self._braking(now, trip, certificate, f"{why}; the vehicle stands", certificate.holds)

    def _braking(self, now: _Situation, trip: Trip, certificate: Certificate, why: str, holds: bool) -> OnlinePlan:
        stop = _Stop(trip, trip.frame.time) if holds else None
        vetted = _Vetted(trip, replace(certificate, holds=False), stop)
        return self._plan_of(vetted, now, Outcome.BRAKING, why)

    def _plan_of(self, vetted: _Vetted, now: _Situation, outcome: Outcome, why: str) -> OnlinePlan:
        if vetted.certified:
            status = PlanStatus.CERTIFIED
        else:
            status = PlanStatus.FEASIBLE if vetted.feasible else PlanStatus.INFEASIBLE
        return OnlinePlan(
            scenario=self._given.name,
            status=status,
            reason=why,
            trip=vetted.trip,
            method="scp",
            solver=self.settings.solver,
            iterations=vetted.iterations,
            wall_time=perf_counter() - now.began,
            clearance=vetted.certificate.clearance,
            limits=vetted.certificate.limits,
            outcome=outcome,
            stop=None if vetted.stop is None else vetted.stop.trip,
            branch_time=math.inf if vetted.stop is None else vetted.stop.branch,
        )


def _limits(scenario: Scenario) -> Any:
    from scp_planner.problem import Limits

    return Limits.of(scenario)


def _check_number(name: str, value: float, least: float = -math.inf) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
        raise ValueError(f"{name}: {value!r} is not a finite number")
    if value < least:
        raise ValueError(f"{name}: {value!r} is less than {least:g}")


def _point(name: str, value: ArrayLike) -> tuple[float, float]:
    try:
        point = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: {value!r} is not a point [x, y]") from None
    if point.shape != (2,) or not np.isfinite(point).all():
        raise ValueError(f"{name}: {value!r} is not a point [x, y] of finite numbers")
    return float(point[0]), float(point[1])


def _covariance(value: ArrayLike) -> Array:
    from scp_planner.observations import check_covariance

    return np.asarray(check_covariance(value, 1).reshape(2, 2), dtype=float)
