"""One run of a closed loop, from the first look to the last step."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array
from scp_planner.online.plan import AWAY, OnlinePlan
from scp_planner.online.planner import Planner
from scp_planner.online.stops import STOPS
from scp_planner.scenario.models import Observations, Obstacle, Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.online import OnlineSettings
from scp_planner.simulation.cycle import Cycle, State
from scp_planner.simulation.run import STRANGER, Run
from scp_planner.simulation.sensors import LEAST_NOISE, Observation, Sensor
from scp_planner.simulation.setup import Follower, SimulationSettings
from scp_planner.simulation.stage import Stage
from scp_planner.simulation.tolerances import INSTANT, NO_TIME, NOWHERE, TIME_DECIMALS
from scp_planner.simulation.worlds import Script, World


class Drive:
    """The state of one run."""

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        world: World | Script,
        sensors: tuple[Sensor, ...],
        follower: Follower,
        online: OnlineSettings,
        history: float,
        chosen: SimulationSettings,
    ) -> None:
        assert online.period is not None
        self.scenario, self.seed, self.sensors = scenario, seed, sensors
        self.follower, self.online, self.chosen = follower, online, chosen
        self.period, self.units = online.period, NaturalUnits.of(scenario)
        self.known = {obstacle.id: obstacle for obstacle in scenario.obstacles}
        self.shapes = dict(chosen.shapes or {})
        self.stage = Stage(scenario, world, self.shapes, scenario.start.time - history)
        self.noise_rngs = [np.random.default_rng([seed, 1, k]) for k in range(len(sensors))]
        self.drift_rng = np.random.default_rng([seed, 2])
        self.pending: deque[Observation] = deque()
        self.offset = np.zeros(2)
        self.driven: OnlinePlan | None = None
        self._prepare()

    # before the start

    def _prepare(self) -> None:
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
        scenario = self.scenario.model_copy(update={"obstacles": tuple(obstacles)})
        self.planner = Planner(scenario, self.chosen.settings, self.online, self.chosen.solver, self.follower.tube)
        for observations in by_id.values():
            self._tell(
                [
                    one
                    for one in observations
                    if not (one.obstacle in self.known and self.known[one.obstacle].motion is None)
                ]
            )

    def _observed(self, obstacle: Obstacle, seen: list[Observation]) -> Obstacle:
        matrices = [((one.deviation**2, 0.0), (0.0, one.deviation**2)) for one in seen]
        same = all(one.deviation == seen[0].deviation for one in seen)
        observations = Observations.model_construct(
            time=tuple(one.time for one in seen),
            position=tuple(one.position for one in seen),
            covariance=matrices[0] if same else tuple(matrices),
        )
        return obstacle.model_copy(update={"motion": None, "observations": observations})

    # the sensors

    def _watch(self, until: float) -> list[Observation]:
        """Let time pass without driving; return what is heard of by its end, in order of arrival."""
        clock = self.stage.clock
        times = np.unique(
            np.concatenate([*(s.looks(clock - NO_TIME * self.units.time, until, until) for s in self.sensors), [until]])
        )
        for time in np.maximum(times, clock):
            self.stage.move_world(float(time))
            self._look(float(time))
        return self._heard(until)

    def _look(self, time: float) -> None:
        start, instant = self.scenario.start.time, INSTANT * self.units.time
        least, stage = LEAST_NOISE * self.units.length, self.stage
        for sensor, rng in zip(self.sensors, self.noise_rngs, strict=True):
            if len(sensor.looks(time - instant, time + instant, start)):
                self.pending.extend(sensor.look(time, stage.position, stage.heading, stage.centers, rng, least))

    def _heard(self, time: float) -> list[Observation]:
        time += NO_TIME * self.units.time
        heard = sorted((one for one in self.pending if one.arrival <= time), key=lambda one: (one.arrival, one.time))
        self.pending = deque(one for one in self.pending if one.arrival > time)
        return heard

    def _tell(self, heard: Sequence[Observation]) -> None:
        """Tell the planner of observations, and first of their obstacles if these are new."""
        planner = self.planner
        there = set(planner.obstacles.tracks)  # once: what is seen at about the same time is taken in together
        for one in heard:
            name, covariance = one.obstacle, one.deviation**2 * np.eye(2)
            if name not in there:
                given = self.known.get(name)
                if given is None:
                    shape = self.shapes.get(name, STRANGER)
                    planner.add_obstacle(name, shape, covariance=covariance, model=self.chosen.model)
                else:
                    planner.add_obstacle(
                        name, given.shape, covariance=covariance, model=given.model, margin=given.margin
                    )
                there.add(name)
            planner.observe(name, one.time, one.position, covariance)

    # the drive

    def run(self, time_limit: float, progress: Callable[[float], None] | None = None) -> Run:
        """Drive until arrival, or until the time is up."""
        start, stage = self.scenario.start.time, self.stage
        records: list[Cycle] = []
        plans: list[OnlinePlan] = []
        arrived, now = False, start
        heard: list[Observation] = []
        stage.move_world(now)
        stage.write_down(now)
        while not arrived and now < start + time_limit - NO_TIME * self.units.time:
            began = perf_counter()
            speed = -stage.speed if self._backs_up(now) else stage.speed
            plan = self.planner.replan(now, stage.position, stage.heading, speed, deadline=self.chosen.deadline)
            x, y = stage.position.tolist()
            state = State(now, (x, y), stage.heading, speed, perf_counter() - began)
            cycle, begin = self._written_down(state, plan, heard), len(stage.times) - 1
            plans.append(plan)
            following = start + len(plans) * self.period
            arrived = plan.arrived or self._drive(plan, now, following)
            records.append(replace(cycle, clearance=float(stage.clearances(begin).min(initial=np.inf))))
            now = following
            if progress is not None:
                progress(stage.times[-1] - start)
            if not arrived:
                heard = self._heard(now)
                self._tell(heard)
        return self._finished(arrived and stage.is_met(), records, plans)

    def _drive(self, plan: OnlinePlan, now: float, following: float) -> bool:
        """Drive for one cycle; return whether the vehicle has arrived."""
        switch = now + self.follower.reaction_time if self.driven is not None else now
        drift = self._drift(self.follower.largest_error(self.driven or plan, now))
        unit, start = self.units.time, self.scenario.start.time
        little = NO_TIME * unit
        looks = [sensor.looks(now + little, following, start) for sensor in self.sensors]
        steps = np.concatenate([np.linspace(now, following, 6)[1:], *looks])
        smooth = self.scenario.vehicle.max_jerk is not None
        if smooth and now < switch < following:
            steps = np.append(steps, switch)
        times = np.unique(np.round(steps / unit, TIME_DECIMALS)) * unit
        for time in times:
            before = self.stage.times[-1]
            # Without jumps a plan begins just when it is followed; else it is taken up in the step in which it is.
            if (before if smooth else time) >= switch - little and self.driven is not plan:
                self._follow(plan, before)
            assert self.driven is not None
            if self._arrives(self.driven, time):
                end = min(max(self.driven.arrival_time, before), time)
                self._move(self.driven, end, end - before, drift)
                return True
            self._move(self.driven, float(time), float(time) - before, drift)
            self._look(float(time))
        return False

    def _backs_up(self, now: float) -> bool:
        return self.driven is not None and bool(self.driven.backward(now))

    def _follow(self, plan: OnlinePlan, time: float) -> None:
        self.offset = self.stage.position - plan.position(time)
        self.driven = plan

    def _drift(self, most: float) -> Array:
        if most <= 0.0:
            return np.zeros(2)
        # Half of the largest error in a cycle, in any direction
        angle, size = self.drift_rng.uniform(0.0, 2.0 * math.pi), math.sqrt(self.drift_rng.uniform())
        pace = 0.5 * most / self.period
        return pace * size * np.array([math.cos(angle), math.sin(angle)])

    def _move(self, plan: OnlinePlan, time: float, dt: float, drift: Array) -> None:
        if np.any(self.offset) or np.any(drift):
            self.offset = (self.offset + drift * dt) * math.exp(-dt / (0.5 * self.units.time))
            size, most = float(np.hypot(*self.offset)), self.follower.largest_error(plan, time)
            if size > most > 0.0:
                self.offset *= most / size
            elif most == 0.0 and size < NOWHERE * self.units.length:
                self.offset = np.zeros(2)
        stage = self.stage
        stage.position = plan.position(time) + self.offset
        stage.heading = float(plan.heading(time))
        stage.speed = max(float(plan.speed(time)), 0.0)
        stage.move_world(time)
        stage.write_down(time)

    def _arrives(self, plan: OnlinePlan, time: float) -> bool:
        if plan.outcome in AWAY:
            return self.stage.speed <= STOPS.standing * self.units.speed and self.planner.at_goal(self.stage.position)
        over_all = plan.certified or not self.planner.given.goals
        return over_all and plan.arrival_time <= time + INSTANT * self.units.time

    # what is written down

    def _written_down(self, state: State, plan: OnlinePlan, heard: list[Observation]) -> Cycle:
        places = self.stage.centers.items()
        truth = tuple((name, (float(place[0]), float(place[1]))) for name, place in places)
        return Cycle.of(state, plan, tuple(heard), self.planner.zones, truth)

    def _finished(self, arrived: bool, records: list[Cycle], plans: list[OnlinePlan]) -> Run:
        stage = self.stage
        clearance, moving = stage.clearances(), stage.moving()
        return Run(
            scenario=self.scenario,
            seed=self.seed,
            arrived=arrived,
            contact=bool(np.any(clearance[moving] < 0.0)),
            contact_standing=bool(np.any(clearance[~moving] < 0.0)),
            travel_time=stage.times[-1] - self.scenario.start.time,
            least_clearance=float(clearance[moving].min(initial=np.inf)),
            records=tuple(records),
            time=np.array(stage.times),
            position=np.array(stage.positions),
            heading=np.array(stage.headings),
            speed=np.array(stage.speeds),
            obstacles={name: np.array(course) for name, course in stage.courses.items()},
            plans=tuple(plans),
            shapes=self.shapes,
        )
