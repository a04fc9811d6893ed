"""From a CommonRoad file to the plan that a solution is written of: the best of what its goal leaves open."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from math import inf
from os import PathLike
from time import perf_counter
from typing import Any

from scp_planner.certificate.check import certify
from scp_planner.certificate.verdict import LATEST, OFF_STEP
from scp_planner.errors import ScenarioError, TooLargeError
from scp_planner.formats.commonroad.cars import PLANNED, Car, VehicleModel, car_named, default_car, softer
from scp_planner.formats.commonroad.checker import SPEED_COLUMN, axle_states, joined
from scp_planner.formats.commonroad.goals import GoalAim, GoalState
from scp_planner.formats.commonroad.reading import READING, CommonRoadFile, read_commonroad, scenario_of
from scp_planner.planning.plan import Plan
from scp_planner.planning.plan_search import planned
from scp_planner.planning.sources.routes import WithoutGuide
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.planning import Settings

QUICK_RUNS, QUICK_SEARCHES = 2, 4  # settings of a look at an aim that is one of several


@dataclass(frozen=True)
class TrialParameters:
    # Of the way at the speed of the start: where goals of time alone are tried
    timed_ways: tuple[float, ...] = (0.8, 0.6, 1.0, 0.4, 1.3)
    # How far into a goal's region, where it is not reached as soon as it may be
    depths: tuple[float, float] = (0.5, 1.0)
    share: float = 0.5  # Of the time that is left, that one trial is given: others may do
    # Parts of jerk that are tried where the checker would not find the inputs of a plan
    softer: tuple[float, ...] = (1.0, 0.8, 0.6, 0.4)
    span: float = 0.65  # Lengths of the vehicle, of a span of the offset's spline: what drives fast bends slowly
    # Units of length of the scene: on very long roads spans of the vehicle's length are too many
    shortest_span: float = 0.15


TRIALS = TrialParameters()


@dataclass(frozen=True)
class CommonRoadPlan:
    """A plan and the scenario that it is a plan of."""

    scenario: Scenario
    plan: Plan


def plan_commonroad(
    path: str | PathLike[str],
    *,
    model: str = "PM",
    car: str | None = None,
    problem: int | None = None,
    settings: Settings | None = None,
    time_limit: float | None = None,
) -> CommonRoadPlan:
    """Plan a problem of a CommonRoad file for one of the benchmark's models."""
    job = _Job(
        read_commonroad(path, problem), model, car, settings, inf if time_limit is None else perf_counter() + time_limit
    )
    best: CommonRoadPlan | None = None
    refusal: ScenarioError | None = None
    tried: list[Scenario] = []
    for number, state in job.file.goal_states().items():
        for trial in _trials(number, state):
            if best is not None and job.left <= 0.0:
                break
            try:
                scenario = job.scenario(trial)
            except ScenarioError as error:  # of this aim: others may do
                refusal = refusal or error
                continue
            if scenario in tried and not trial.thorough:
                continue  # an aim is where another one is
            tried.append(scenario)
            made = job.planned(trial, scenario) if best is None else job.again(trial, best, scenario)
            made = _closer(job, trial, made)
            made = _found(job, replace(trial, discs=len(made.scenario.vehicle.discs)), made)
            best = made if best is None or _better(made.plan, best.plan) else best
            if made.plan.certified:
                break
    if best is None:
        assert refusal is not None, "there is an aim, or the goal has been refused"
        raise refusal
    return best


@dataclass(frozen=True)
class _Job:
    file: CommonRoadFile
    model: str
    car: str | None
    settings: Settings | None
    deadline: float

    @property
    def body(self) -> Car:
        """The car that is moved."""
        return car_named(self.car, VehicleModel(self.model))

    @property
    def left(self) -> float:
        return TRIALS.share * (self.deadline - perf_counter())

    def scenario(self, trial: _Trial) -> Scenario:
        """Return what is to be planned."""
        made = scenario_of(self.file, model=self.model, car=self.car, aim=trial.aim, discs=trial.discs)
        return made.model_copy(update={"vehicle": made.vehicle.model_copy(update=trial.soft)})

    def planned(self, trial: _Trial, scenario: Scenario) -> CommonRoadPlan:
        """Plan what is tried."""
        left = max(self.left, 0.0)
        settings = self.settings or road_settings(scenario)
        if trial.quick:
            settings = replace(settings, max_runs=QUICK_RUNS, searches=QUICK_SEARCHES)
        limit, sources = None if left == inf else left, [WithoutGuide()]
        made = planned(scenario, settings, time_limit=limit, thorough=trial.thorough, sources=sources)
        return CommonRoadPlan(scenario, replace(made, commonroad=self.told(trial)))

    def told(self, trial: _Trial) -> dict[str, Any]:
        car, problem = self.car or default_car(VehicleModel(self.model)), self.file.problem.planning_problem_id
        told = {"model": self.model, "car": car, "problem": problem, "discs": trial.discs, **asdict(trial.aim)}
        return {**told, "turn": None if trial.aim.turn == inf else trial.aim.turn}

    def again(self, trial: _Trial, made: CommonRoadPlan, scenario: Scenario | None = None) -> CommonRoadPlan:
        """Plan what is tried; what there is already, where the time is over before all obstacles can be looked at."""
        try:
            return self.planned(trial, scenario or self.scenario(trial))
        except TooLargeError:
            return made


def scenario_planned(path: str | PathLike[str], plan: Plan) -> Scenario:
    """Read the scenario of a CommonRoad file that a plan was made for, or else that of `load_commonroad`."""
    told = plan.commonroad
    if told is None:
        return scenario_of(read_commonroad(path))
    turn = inf if told["turn"] is None else told["turn"]
    aim = GoalAim(told["state"], told["timed_way"], told["depth"], turn)
    file = read_commonroad(path, told["problem"])
    return scenario_of(file, model=told["model"], car=told["car"], aim=aim, discs=told["discs"])


def _closer(job: _Job, trial: _Trial, made: CommonRoadPlan) -> CommonRoadPlan:
    """Cover a car that gets nowhere for what it touches by more discs, which stick out of it less."""
    for discs in READING.more_discs:
        if discs <= len(made.scenario.vehicle.discs):
            continue
        if not _touches_alone(job, made) or job.left <= 0.0:
            break
        again = job.again(replace(trial, discs=discs), made)
        made = again if _better(again.plan, made.plan) else made
    return made


def _found(job: _Job, trial: _Trial, made: CommonRoadPlan) -> CommonRoadPlan:
    """Drive more softly, where the official checker would not find the inputs of what is certified."""
    step, start = job.file.step, job.file.heading
    model, vehicle = VehicleModel(job.model), made.scenario.vehicle
    for part in TRIALS.softer:
        if not made.plan.certified or job.left <= 0.0:
            break
        states = axle_states(made.plan, step, job.body, start)
        if joined(states, step, model, job.body) is not None:
            break
        again = job.again(replace(trial, soft=softer(vehicle, step, float(states[:, SPEED_COLUMN].max()), part)), made)
        made = again if again.plan.certified else made
    return made


def _touches_alone(job: _Job, made: CommonRoadPlan) -> bool:
    """True if nothing is wrong with a trip but when it arrives and what it touches, with what sticks out of the car."""
    if made.plan.certified:
        return False
    out = made.scenario.vehicle.radius - 0.5 * job.body.width
    violations = certify(made.scenario, made.plan).violations
    touches = [-violation.value for violation in violations if violation.what == "clearance"]
    others = {violation.what for violation in violations} - {"clearance", LATEST, OFF_STEP}
    return not others and 0.0 < max(touches, default=0.0) < out


@dataclass(frozen=True)
class _Trial:
    aim: GoalAim
    quick: bool
    thorough: bool = False
    discs: int = PLANNED.fewest_discs
    soft: Mapping[str, float] = field(default_factory=dict)


def _trials(number: int, state: GoalState) -> Iterator[_Trial]:
    if state.places:
        # What takes longest, and hardly ever finds a trip, comes after all other aims.
        yield _Trial(GoalAim(number), quick=False)
        if state.heading is not None:
            yield _Trial(GoalAim(number, turn=inf), quick=True)
        for depth in TRIALS.depths:
            yield _Trial(GoalAim(number, depth=depth), quick=True)
        yield _Trial(GoalAim(number), quick=False, thorough=True)
        return
    for quick in (True, False):
        for way in TRIALS.timed_ways:
            yield _Trial(GoalAim(number, timed_way=way), quick, thorough=not quick)


def road_settings(scenario: Scenario) -> Settings:
    """Return settings for a vehicle on a road."""
    discs = scenario.vehicle.discs
    wanted = TRIALS.span * (max(discs) - min(discs) + 2.0 * scenario.vehicle.radius)
    return Settings(path_span=max(wanted, TRIALS.shortest_span * NaturalUnits.of(scenario).length))


def _better(one: Plan, other: Plan) -> bool:
    """Certified before not certified, then sooner."""
    return (not one.certified, one.arrival_time) < (not other.certified, other.arrival_time)
