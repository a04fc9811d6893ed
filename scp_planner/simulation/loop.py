"""The closed loop: sensors look, the planner replans, the vehicle drives, the obstacles move.

Everything that is random comes from one seed, and the planner's work is limited by steps and not by the clock, so the
same call gives the same run, bit by bit. With a ``deadline`` the planner answers in time instead, and runs may differ.

The vehicle follows its plan with a *tracking error*: it drifts off by a random velocity, a new one in each cycle, up to
a largest distance, and is led back. It follows a new plan from a *reaction time* after the replan on, and the old one
until then. Both belong into the planner's margin, see `OnlineSettings`.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.online.plan import OnlinePlan, Outcome
from scp_planner.online.planner import Planner
from scp_planner.online.stops import STANDING
from scp_planner.scenario.models import Model, Observations, Obstacle, Scenario
from scp_planner.scenario.shapes import Disc, Shape
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.online import OnlineSettings
from scp_planner.settings.planning import Settings
from scp_planner.simulation.cycle import Cycle, ZoneRecord
from scp_planner.simulation.run import STRANGER, Run
from scp_planner.simulation.sensors import LEAST_NOISE, Observation, Sensor
from scp_planner.simulation.worlds import Script, VehicleState, World, as_course, drawn_course
from scp_planner.solvers import QpSolver
from scp_planner.threat_zones.of_scenario import covering_radius
from scp_planner.trips.trip import discs_at

logger = logging.getLogger(__name__)

STEPS = 5  # of the simulation in one cycle
NOISE = 0.1
"""Units of length of the scene."""
RATE = 10.0
"""In a unit of time."""
HISTORY = 10.0
"""Units of time of observations before the start: what a sensor has seen when the vehicle sets off."""
TIME_LIMIT = 60.0
"""Units of time after which a run ends, or four times the trip without obstacles if that is longer."""
FORGET_AFTER = 2.0
"""Units of time after which an obstacle that is not seen has gone, unless other settings are given."""
WAY_BACK_TIME = 0.5
"""Units of time in which a vehicle that is off its plan gets most of the way back."""
NO_TIME, NO_TIME_AT_ALL = 1e-6, 1e-9
"""Units of time."""
DECIMALS = 9  # of a unit of time, that tell the times of steps and looks apart
NEAR = 0.5  # units of length; obstacles that are no discs are looked at closely if nearer
NOWHERE = 1e-12
"""Units of length."""
MOVING = 0.01
"""Units of speed. Contact at a lower speed is contact of a vehicle that stands."""


@dataclass(frozen=True)
class Follower:
    """How the simulated vehicle follows its plan.

    Attributes
    ----------
    tracking_error : float
        Largest distance from the plan, m.
    reaction_time : float
        From a replan to the moment from which its plan is followed, s.
    """

    tracking_error: float = 0.0
    reaction_time: float = 0.0


def simulate(
    scenario: Scenario,
    noise: float | None = None,
    rate: float | None = None,
    seed: int = 0,
    *,
    world: World | Mapping[str, Any] | None = None,
    sensors: Sequence[Sensor] | None = None,
    follower: Follower | None = None,
    settings: Settings | None = None,
    online: OnlineSettings | None = None,
    solver: str | QpSolver | None = None,
    history: float | None = None,
    deadline: float | None = None,
    time_limit: float | None = None,
    shapes: Mapping[str, Shape] | None = None,
    model: Model | None = None,
    progress: Callable[[float], None] | None = None,
) -> Run:
    """Drive a scenario in a closed loop.

    Parameters
    ----------
    scenario : Scenario
        Obstacles with a ``motion`` really move like that, and are observed with noise; of those with observations, the
        truth is drawn from what the observations leave open.
    noise : float, optional
        Standard deviation of each coordinate of an observed position, m. By default 0.1 units of length of the scene,
        see :class:`scp_planner.Settings`.
    rate : float, optional
        Looks and replans per second, Hz. By default 10 in a unit of time of the scene.
    seed : int
    world : World or mapping, optional
        What obstacles really do instead: an object with ``step``, or, by id, a function of times, a `Track`, or the
        arrays (times, centres). The planner is told of an obstacle when it is first seen.
    sensors : sequence of Sensor, optional
        Instead of one that sees everything at ``rate`` with ``noise``.
    follower : Follower, optional
        Default: a vehicle that follows its plan exactly and at once.
    settings : Settings, optional
    online : OnlineSettings, optional
        Its ``period`` becomes that of the loop; unless it is given, its margin becomes that of the follower.
    solver : str or QpSolver, optional
    history : float, optional
        s of observations before the start. By default 10 units of time.
    deadline : float, optional
        Of each replan, s of wall time.
    time_limit : float, optional
        s after which the run ends.
    shapes : mapping, optional
        Shapes of a world's obstacles that are not in the scenario.
    model : Model, optional
        Of the motion of these.
    progress : callable, optional
        Called after each cycle with the time driven so far, s.

    Returns
    -------
    Run

    Raises
    ------
    ValueError
        If a value is not allowed.
    """
    units = NaturalUnits.of(scenario)
    noise = NOISE * units.length if noise is None else noise
    rate = RATE / units.time if rate is None else rate
    history = HISTORY * units.time if history is None else history
    for name, value, positive in (("noise", noise, False), ("rate", rate, True), ("history", history, False)):
        if not (math.isfinite(value) and (value > 0.0 if positive else value >= 0.0)):
            raise ValueError(f"{name}: {value!r} must be finite and {'greater than' if positive else 'at least'} 0")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"seed: {seed!r} must be a whole number of at least 0")
    follower = follower or Follower()
    if online is None:
        online = OnlineSettings(
            tracking_error=follower.tracking_error,
            reaction_time=follower.reaction_time,
            forget_after=FORGET_AFTER * units.time,
        )
    loop = _Loop(
        scenario,
        int(seed),
        _world_of(scenario, world, int(seed)),
        tuple(sensors) if sensors is not None else (Sensor(rate=rate, noise=noise),),
        follower,
        online,
        1.0 / rate,
        history,
        deadline,
        dict(shapes or {}),
        model,
    )
    loop.prepare(settings, solver)
    if time_limit is None:
        trip = math.dist(scenario.start.position, scenario.goal.position) / scenario.vehicle.max_speed
        time_limit = max(TIME_LIMIT * units.time, 4.0 * trip)
    return loop.run(time_limit, progress)


def _world_of(scenario: Scenario, world: World | Mapping[str, Any] | None, seed: int) -> World | Script:
    if world is None:
        rng = np.random.default_rng([seed, 0])
        return Script({obstacle.id: drawn_course(obstacle, rng) for obstacle in scenario.obstacles})
    if isinstance(world, Script):
        return world
    if isinstance(world, Mapping):
        return Script({name: as_course(course) for name, course in world.items()})
    if not hasattr(world, "step"):
        raise ValueError(f"world: {world!r} is neither a mapping nor an object with a step")
    return world


class _Loop:
    """The state of one run."""

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        world: World | Script,
        sensors: tuple[Sensor, ...],
        follower: Follower,
        online: OnlineSettings,
        period: float,
        history: float,
        deadline: float | None,
        shapes: dict[str, Shape],
        model: Model | None,
    ) -> None:
        self.scenario, self.seed, self.world, self.sensors = scenario, seed, world, sensors
        self.follower, self.online, self.deadline = follower, replace(online, period=period), deadline
        self.period, self.units = period, NaturalUnits.of(scenario)
        self.known = {obstacle.id: obstacle for obstacle in scenario.obstacles}
        self.shapes, self.model = shapes, model
        self.noise_rngs = [np.random.default_rng([seed, 1, k]) for k in range(len(sensors))]
        self.drift_rng = np.random.default_rng([seed, 2])
        self.clock = scenario.start.time - history
        self.pending: deque[Observation] = deque()
        start = scenario.start
        goal = scenario.goal.position
        towards = math.atan2(goal[1] - start.position[1], goal[0] - start.position[0])
        self.position = np.array(start.position, dtype=float)
        self.heading = towards if start.heading is None else start.heading
        self.speed = start.speed
        self.offset = np.zeros(2)
        self.centers: dict[str, Array] = {}
        self.driven: OnlinePlan | None = None
        self.times: list[float] = []
        self.positions: list[Array] = []
        self.headings: list[float] = []
        self.speeds: list[float] = []
        self.courses: dict[str, list[Array]] = {}

    # before the start

    def prepare(self, settings: Settings | None, solver: str | QpSolver | None) -> None:
        """Let the sensors look while the vehicle waits to set off, and set up the planner with what they saw."""
        seen = self._watch(self.scenario.start.time)
        by_id: dict[str, list[Observation]] = {}
        for one in seen:
            by_id.setdefault(one.obstacle, []).append(one)
        obstacles = []
        for name, obstacle in self.known.items():
            if obstacle.motion is None:
                obstacles.append(obstacle)
            elif len(by_id.get(name, ())) > obstacle.model.order:
                obstacles.append(self._observed(obstacle, by_id.pop(name)))
        self.planner = Planner(
            self.scenario.model_copy(update={"obstacles": tuple(obstacles)}), settings, self.online, solver
        )
        for observations in by_id.values():
            for one in observations:
                if not (one.obstacle in self.known and self.known[one.obstacle].motion is None):
                    self._tell(one)

    def _observed(self, obstacle: Obstacle, seen: list[Observation]) -> Obstacle:
        matrices = [((one.deviation**2, 0.0), (0.0, one.deviation**2)) for one in seen]
        same = all(one.deviation == seen[0].deviation for one in seen)
        observations = Observations.model_construct(
            time=tuple(one.time for one in seen),
            position=tuple(one.position for one in seen),
            covariance=matrices[0] if same else tuple(matrices),
        )
        return obstacle.model_copy(update={"motion": None, "observations": observations})

    # the world and the sensors

    def _watch(self, until: float) -> list[Observation]:
        """Let time pass without driving; return what is heard of by its end, in order of arrival."""
        times = np.unique(
            np.concatenate(
                [*(s.looks(self.clock - NO_TIME_AT_ALL * self.units.time, until, until) for s in self.sensors), [until]]
            )
        )
        for time in np.maximum(times, self.clock):
            self._move_world(float(time))
            self._look(float(time))
        return self._heard(until)

    def _move_world(self, time: float) -> None:
        if isinstance(self.world, Script):
            places = self.world.at(np.array([time]))
            self.centers = {name: place[0] for name, place in places.items() if not np.isnan(place[0]).any()}
        else:
            velocity = self.speed * np.array([math.cos(self.heading), math.sin(self.heading)])
            vehicle = VehicleState(self.clock, self.position.copy(), velocity, self.scenario.vehicle.radius)
            moved = self.world.step(max(time - self.clock, 0.0), vehicle)
            self.centers = {name: np.asarray(place, dtype=float) for name, place in moved.items()}
        self.clock = time

    def _look(self, time: float) -> None:
        start, instant = self.scenario.start.time, NO_TIME * self.units.time
        least = LEAST_NOISE * self.units.length
        for sensor, rng in zip(self.sensors, self.noise_rngs, strict=True):
            if len(sensor.looks(time - instant, time + instant, start)):
                seen = sensor.look(time, self.position, self.heading, self.centers, rng, least)
                self.pending.extend(seen)

    def _heard(self, time: float) -> list[Observation]:
        time += NO_TIME_AT_ALL * self.units.time
        heard = sorted((one for one in self.pending if one.arrival <= time), key=lambda one: (one.arrival, one.time))
        self.pending = deque(one for one in self.pending if one.arrival > time)
        return heard

    def _tell(self, one: Observation) -> None:
        """Tell the planner of an observation, and first of its obstacle if that is new."""
        planner, name = self.planner, one.obstacle
        covariance = one.deviation**2 * np.eye(2)
        if name not in planner.obstacles.tracks:
            given = self.known.get(name)
            if given is None:
                planner.add_obstacle(name, self.shapes.get(name, STRANGER), covariance=covariance, model=self.model)
            else:
                planner.add_obstacle(name, given.shape, covariance=covariance, model=given.model, margin=given.margin)
        planner.observe(name, one.time, one.position, covariance)

    # the drive

    def run(self, time_limit: float, progress: Callable[[float], None] | None = None) -> Run:
        """Drive until arrival, or until the time is up."""
        start, period = self.scenario.start.time, self.period
        records: list[Cycle] = []
        plans: list[OnlinePlan] = []
        arrived, cycle, now = False, 0, start
        heard: list[Observation] = []
        self._write_down(now)
        while not arrived and now < start + time_limit - NO_TIME_AT_ALL * self.units.time:
            began = perf_counter()
            plan = self.planner.replan(now, self.position, self.heading, self.speed, deadline=self.deadline)
            wall_time = perf_counter() - began
            plans.append(plan)
            begin = len(self.times) - 1
            record = (now, tuple(self.position.tolist()), self.heading, self.speed, wall_time)
            zones = tuple(ZoneRecord.of(zone) for zone in self.planner.zones)
            truth = tuple((name, tuple(place.tolist())) for name, place in self.centers.items())
            cycle += 1
            following = start + cycle * period
            arrived = plan.arrived or self._drive(plan, now, following)
            records.append(self._record(record, plan, heard, zones, truth, begin))
            now = following
            if progress is not None:
                progress(self.times[-1] - start)
            if not arrived:
                heard = self._heard(now)
                for one in heard:
                    self._tell(one)
        return self._finished(arrived, records, plans)

    def _drive(self, plan: OnlinePlan, now: float, following: float) -> bool:
        """Drive for one cycle; return whether the vehicle has arrived."""
        switch = now + self.follower.reaction_time if self.driven is not None else now
        drift = self._drift()
        unit, start = self.units.time, self.scenario.start.time
        little = NO_TIME_AT_ALL * unit
        looks = [sensor.looks(now + little, following, start) for sensor in self.sensors]
        steps = np.concatenate([np.linspace(now, following, STEPS + 1)[1:], *looks])
        times = np.unique(np.round(steps / unit, DECIMALS)) * unit
        for time in times:
            before = self.times[-1]
            if time >= switch - little and self.driven is not plan:
                self._follow(plan, before)
            assert self.driven is not None
            if self._arrives(self.driven, time):
                end = min(max(self.driven.arrival_time, before), time)
                self._move(self.driven, end, end - before, drift)
                return True
            self._move(self.driven, float(time), float(time) - before, drift)
            self._look(float(time))
        return False

    def _follow(self, plan: OnlinePlan, time: float) -> None:
        self.offset = self.position - plan.position(time)
        self.driven = plan

    def _drift(self) -> Array:
        if self.follower.tracking_error <= 0.0:
            return np.zeros(2)
        # Half of the largest error in a cycle, in any direction
        angle, size = self.drift_rng.uniform(0.0, 2.0 * math.pi), math.sqrt(self.drift_rng.uniform())
        pace = 0.5 * self.follower.tracking_error / self.period
        return pace * size * np.array([math.cos(angle), math.sin(angle)])

    def _move(self, plan: OnlinePlan, time: float, dt: float, drift: Array) -> None:
        if np.any(self.offset) or np.any(drift):
            self.offset = (self.offset + drift * dt) * math.exp(-dt / (WAY_BACK_TIME * self.units.time))
            size, most = float(np.hypot(*self.offset)), self.follower.tracking_error
            if size > most > 0.0:
                self.offset *= most / size
            elif most == 0.0 and size < NOWHERE * self.units.length:
                self.offset = np.zeros(2)
        self.position = plan.position(time) + self.offset
        self.heading = float(plan.heading(time))
        self.speed = max(float(plan.speed(time)), 0.0)
        self._move_world(time)
        self._write_down(time)

    def _arrives(self, plan: OnlinePlan, time: float) -> bool:
        if plan.outcome is Outcome.BRAKING:
            return self.speed <= STANDING * self.units.speed and self.planner.at_goal(self.position)
        return plan.arrival_time <= time + NO_TIME * self.units.time

    def _write_down(self, time: float) -> None:
        if not self.times:
            self._move_world(time)
        self.times.append(time)
        self.positions.append(self.position.copy())
        self.headings.append(self.heading)
        self.speeds.append(self.speed)
        absent = np.full(2, np.nan)
        for name in self.centers:
            if name not in self.courses:
                self.courses[name] = [absent] * (len(self.times) - 1)
        for name, course in self.courses.items():
            course.append(self.centers.get(name, absent))

    # afterwards

    def _shape(self, name: str) -> Shape:
        return self.known[name].shape if name in self.known else self.shapes.get(name, STRANGER)

    def _clearances(self, first: int, last: int) -> Array:
        """Least distances to the true obstacles between fine times, (last - first,) m; inf without any."""
        reference, heading = np.array(self.positions[first : last + 1]), np.array(self.headings[first : last + 1])
        discs = discs_at(reference, heading, self.scenario.vehicle.discs)
        return np.min([self._disc_clearances(disc, first, last) for disc in discs], axis=0)

    def _disc_clearances(self, own: Array, first: int, last: int) -> Array:
        least = np.full(last - first, np.inf)
        for name, course in self.courses.items():
            center = np.array(course[first : last + 1])
            shape = self._shape(name)
            relative = own - center
            distance = _closest(relative)
            reach = covering_radius(shape)
            distance = distance - reach
            if not isinstance(shape, Disc):
                distance = self._exact(shape, center, own, distance)
            least = np.fmin(least, distance)
        return least - self.scenario.vehicle.radius

    def _exact(self, shape: Shape, center: Array, own: Array, bound: Array) -> Array:
        """Distances to a shape that is no disc, at the ends of the steps where they matter."""
        distance = bound.copy()
        near = np.flatnonzero(bound < self.scenario.vehicle.radius + NEAR * self.units.length)
        velocity = np.diff(center, axis=0)
        for k in near:
            heading = math.atan2(velocity[k, 1], velocity[k, 0])
            distance[k] = min(shape.distance(tuple(own[i] - center[i]), heading) for i in (k, k + 1))
        return distance

    def _record(
        self,
        record: tuple[Any, ...],
        plan: OnlinePlan,
        heard: list[Observation],
        zones: tuple[ZoneRecord, ...],
        truth: tuple[Any, ...],
        begin: int,
    ) -> Cycle:
        time, position, heading, speed, wall_time = record
        clearance = self._clearances(begin, len(self.times) - 1)
        return Cycle(
            time=time,
            position=position,
            heading=heading,
            speed=speed,
            outcome=str(plan.outcome),
            status=str(plan.status),
            certified=plan.certified,
            safe=plan.safe,
            reason=plan.reason or "",
            arrival_time=plan.arrival_time,
            iterations=plan.iterations,
            observations=tuple(heard),
            zones=zones,
            truth=truth,
            clearance=float(clearance.min(initial=np.inf)),
            wall_time=wall_time,
        )

    def _finished(self, arrived: bool, records: list[Cycle], plans: list[OnlinePlan]) -> Run:
        clearance = self._clearances(0, len(self.times) - 1)
        speeds = np.array(self.speeds)
        moving = np.maximum(speeds[1:], speeds[:-1]) > MOVING * self.units.speed
        return Run(
            scenario=self.scenario,
            seed=self.seed,
            arrived=arrived,
            contact=bool(np.any(clearance[moving] < 0.0)),
            contact_standing=bool(np.any(clearance[~moving] < 0.0)),
            travel_time=self.times[-1] - self.scenario.start.time,
            least_clearance=float(clearance[moving].min(initial=np.inf)),
            records=tuple(records),
            time=np.array(self.times),
            position=np.array(self.positions),
            heading=np.array(self.headings),
            speed=speeds,
            obstacles={name: np.array(course) for name, course in self.courses.items()},
            plans=tuple(plans),
            shapes=self.shapes,
        )


def _closest(relative: Array) -> Array:
    """Least distance from the origin of each straight piece of a polyline (n + 1, 2), (n,); NaN where not there."""
    begin, step = relative[:-1], np.diff(relative, axis=0)
    squared = (step * step).sum(axis=1)
    along = -(begin * step).sum(axis=1) / np.where(squared > 0.0, squared, 1.0)
    nearest = begin + np.clip(along, 0.0, 1.0)[:, None] * step
    return np.asarray(np.hypot(nearest[:, 0], nearest[:, 1]))
