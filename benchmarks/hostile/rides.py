"""Drives through drawn scenes in which limits, goal and ground change, and odd states are reported."""

from __future__ import annotations

import math
import time as clocks
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.hostile import combined
from benchmarks.hostile.dense import goal_speed_missed
from benchmarks.hostile.drives import HEADING, ROUND_THE_END
from benchmarks.hostile.oracle import contents, refused, tolerances
from benchmarks.hostile.outcome import Outcome, judged
from benchmarks.hostile.wild import Data, Rng
from scp_planner.errors import TooLargeError
from scp_planner.online.plan import AWAY, OnlinePlan
from verification.differences import END_WINDOW

CYCLES = (3, 25)
PERIOD, DEADLINE = 0.1, 0.3
"""s."""
SPARE, SHARE = 0.1, 0.1
"""s, and share of a time limit, after which an answer is late, by the processor's time."""
CHANGES, ODD_STATES = 0.12, 0.12
SAMPLES = 4000
SHORTEST = 0.05
"""s of a trip, for differences to say something."""
FOLLOWS = 2e-3
"""m/s and rad by which an answer may begin off the state that it was planned to have, where it is kept."""
STANDS = 1e-12  # of the top speed: rounding, of a vehicle that stands


def draw(rng: Rng) -> Data:
    """Draw a scene, and what happens at each replan."""
    scene = combined.draw(rng)
    for key in ("earliest_arrival", "latest_arrival", "arrival_step"):
        scene["scenario"]["goal"].pop(key, None)
    scene["least_time"] = None  # plan() alone takes a user's constraints
    steps = [_step(scene, rng) for _ in range(int(rng.integers(*CYCLES)))]
    # Without a deadline the same calls give the same answers
    deadline = DEADLINE if rng.random() < 0.5 else None
    return {"scene": scene, "steps": steps, "predictor": bool(rng.random() < 0.1), "deadline": deadline}


def _step(scene: Data, rng: Rng) -> Data:
    vehicle = scene["scenario"]["vehicle"]
    step: Data = {"call": None, "odd": None}
    if rng.random() < ODD_STATES:
        kind = str(rng.choice(["backwards", "fast", "zero", "aside", "nan"]))
        step["odd"] = [kind, float(rng.uniform(0.05, 1.0))]
    if rng.random() < CHANGES:
        step["call"] = _call(scene, vehicle, rng)
    return step


def _call(scene: Data, vehicle: Data, rng: Rng) -> list[Any]:
    begin = np.array(scene["scenario"]["start"]["position"])
    match int(rng.integers(6)):
        case 0:
            name = str(rng.choice(["max_speed", "max_deceleration"]))
            return ["set_limits", {name: float(rng.uniform(0.3, 1.2)) * vehicle[name]}]
        case 1:
            return ["set_limits", {"max_curvature": float(rng.uniform(0.2, 1.5))}]
        case 2:
            return ["set_limits", {"reverse": None}]
        case 3:
            away = 10.0 ** rng.uniform(-9.0, 2.0) * rng.choice([0.0, 1.0], p=[0.1, 0.9])
            angle = float(rng.uniform(-3.2, 3.2))
            place = begin + rng.normal(0.0, 2.0, 2) + away * np.array([math.cos(angle), math.sin(angle)])
            return ["set_goal", {"goal": {"position": place.tolist()}}]
        case 4:
            middle = begin + rng.normal(0.0, 5.0, 2)
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * rng.uniform(0.1, 1.0, 2)
            return ["set_walls", {"walls": [(middle + corners).tolist()]}]
        case _:
            half = float(rng.uniform(2.0, 30.0))
            return ["set_ground", {"bounds": {"min": (begin - half).tolist(), "max": (begin + half).tolist()}}]


class _Straight:
    """A predictor that knows nothing but where things are."""

    def __init__(self, scenario: sp.Scenario) -> None:
        self.names = [each.id for each in scenario.obstacles if each.motion is not None]

    def predict(self, now: float, horizon: float) -> Mapping[str, Any]:
        return {
            name: {"time": now, "position": [1e3, 1e3 + horizon], "velocity": [0.0, 0.0]} for name in self.names[:1]
        }


@dataclass
class _State:
    time: float
    position: np.ndarray
    heading: float | None
    speed: float

    def odd(self, kind: str, size: float, top: float) -> _State:
        """Return what is reported in place of it."""
        if kind == "backwards":
            return replace(self, speed=-size * top)
        if kind == "fast":
            return replace(self, speed=(1.0 + size) * top)
        if kind == "zero":
            return replace(self, speed=0.0)
        if kind == "aside":
            return replace(self, position=self.position + size * np.array([1.0, -1.0]))
        return replace(self, speed=math.nan)


def drive(case: Data) -> Outcome:
    """Drive through a scene, and judge every answer."""
    scene = case["scene"]
    try:
        scenario = combined.scenario_of(scene)
        planner = sp.Planner(scenario, online=sp.OnlineSettings(period=PERIOD))
    except (sp.ScenarioError, TooLargeError):
        return Outcome("bad input")
    if case["predictor"]:
        planner.predictor = _Straight(scenario)
    start = scenario.start
    ride = _Ride(
        scene, planner, _State(start.time, np.array(start.position), start.heading, start.speed), case["deadline"]
    )
    for number, step in enumerate(case["steps"]):
        ride.change(step["call"])
        told = ride.state
        if step["odd"] is not None:
            kind, size = step["odd"]
            told = told.odd(kind, size, scenario.vehicle.max_speed)
        plan, missed = ride.replan(told)
        if missed:
            outcome = "nothing" if plan is None else plan.outcome
            about = f"replan {number}, t = {told.time:.6g} s, {outcome}, {step['odd']}, {step['call']}"
            return judged("driven", f"{about}: {missed}")
        if plan is not None and not ride.drive_on(plan, told):
            break
    return judged("driven", "", ride.checked)


@dataclass
class _Ride:
    """A planner, where its vehicle is, and where it has been since its goal was set."""

    scene: Data
    planner: sp.Planner
    state: _State
    deadline: float | None
    crossed: list[np.ndarray] = field(default_factory=list)
    checked: int = 0

    def change(self, call: list[Any] | None) -> None:
        """Change limits, goal or ground; what is refused changes nothing."""
        if call is None:
            return
        try:
            getattr(self.planner, call[0])(**call[1])
        except (sp.ScenarioError, TooLargeError):
            return
        if call[0] == "set_goal":
            self.crossed = []
            self.scene = {**self.scene, "scenario": {**self.scene["scenario"], **call[1]}}

    def replan(self, told: _State) -> tuple[OnlinePlan | None, str]:
        """Replan from a state that is reported, and say what is wrong with the answer."""
        doubts, began = list(self.planner.doubts), clocks.process_time()
        try:
            plan = self.planner.replan(told.time, told.position, told.heading, told.speed, deadline=self.deadline)
        except ValueError:
            if math.isfinite(told.speed):
                raise
            return None, ""
        if not math.isfinite(told.speed):
            return plan, "nan is taken for a speed"
        took = clocks.process_time() - began
        doubted = list(self.planner.doubts) != doubts
        late = self.deadline is not None and took > self.deadline * (1.0 + SHARE) + SPARE
        missed = [
            f"{took:.2f} s for {self.deadline:g} s" if late else "",
            _judge(self.scene, self.planner, plan, told, doubted=doubted),
            _arrived(self.planner, plan, told, self.crossed),
        ]
        self.checked += plan.safe
        return plan, "; ".join(filter(None, missed))

    def drive_on(self, plan: OnlinePlan, told: _State) -> bool:
        """Drive to the next replan; return False if the drive is over."""
        ahead = told.time + PERIOD
        if plan.arrived or (plan.outcome not in AWAY and plan.arrival_time <= ahead):
            return False
        gear = -1.0 if bool(plan.backward(ahead)) else 1.0
        self.state = _State(ahead, plan.position(ahead), float(plan.heading(ahead)), gear * float(plan.speed(ahead)))
        self.crossed += list(plan.position(np.linspace(told.time, ahead, 20)))
        return True


def _judge(scene: Data, planner: sp.Planner, plan: OnlinePlan, told: _State, *, doubted: bool) -> str:
    """Say what a safe answer breaks: that it begins as reported, its scenario, and a stop behind its goal."""
    if not plan.safe:
        return ""
    scenario = planner.scenario
    vehicle, data = scenario.vehicle, contents(scenario)
    backwards = vehicle.reverse is not None or str(vehicle.steering) in ("both_ways", "any")
    speed = abs(told.speed) if told.heading is None else told.speed  # without a heading the sign says nothing
    if speed < -STANDS * vehicle.max_speed and not backwards:
        if not doubted:
            return f"{speed:.3g} m/s without a reverse gear is safe, and nothing is doubted"
        speed = 0.0
    begins = {**data["start"], "time": told.time, "position": told.position.tolist(), "speed": speed}
    begins["heading"] = told.heading if str(vehicle.steering) == "ahead" else None
    # What is met is not kept clear of, but where it is an obstacle, too
    given = {each["id"] for each in scene["scenario"]["obstacles"]}
    met = {each["id"]: each for each in data["obstacles"] if each["id"] not in given}
    data["goal"], *data["goals"] = (_with_target(each, met) for each in (data["goal"], *data.get("goals", ())))
    data = {**data, "start": begins, "obstacles": [each for each in data["obstacles"] if each["id"] in given]}
    speed_met = 0.0
    if data["goal"].get("target") is not None:  # met as closely as a period allows, as documented
        data["goal"] = {**data["goal"], "radius": data["goal"].get("radius") or PERIOD * vehicle.max_speed}
        speed_met = PERIOD * vehicle.max_deceleration + HEADING * vehicle.max_speed
    if plan.certified and plan.arrival_time - told.time >= SHORTEST:
        if plan.outcome in AWAY:
            data["goal"], data["goals"] = _at_the_end(plan), []
        missed = refused(
            scene, scenario, plan, data=data, begin=told.time, samples=SAMPLES, lowered=True, speed_met=speed_met
        )
        return missed or _behind(plan, data)
    off = math.dist(np.asarray(plan.position(told.time)), told.position)
    near = tolerances(data, np.array([told.position, told.position]), np.array([told.time, told.time])).position
    if off > near + FOLLOWS:
        return f"the answer begins {off:.3g} m from the state that was reported"
    gear = -1.0 if bool(plan.backward(told.time)) else 1.0
    gap = abs(gear * float(plan.speed(told.time)) - speed)
    if gap > FOLLOWS and not (speed == 0.0 and gap < FOLLOWS):
        return f"the answer begins {gap:.3g} m/s off the speed that was reported"
    return ""


def _with_target(place: Data, met: Mapping[str, Data]) -> Data:
    """Return a goal or a place whose target is told, if it was named by the planner."""
    target = place.get("target")
    name = target.get("obstacle") if isinstance(target, dict) else target
    return place if name is None or name not in met else {**place, "target": met[name]}


def _at_the_end(plan: OnlinePlan) -> Data:
    """The goal of an answer that does not go where the scenario says."""
    return {"position": np.asarray(plan.position(plan.arrival_time)).tolist(), "radius": ROUND_THE_END}


def _behind(plan: OnlinePlan, data: Mapping[str, Any]) -> str:
    """Say which box a vehicle leaves that passes its goal and brakes straight on, if it has no other stop."""
    goal, bounds = data["goal"], data.get("bounds")
    end = plan.arrival_time
    here, before = (np.asarray(plan.position(end - back)) for back in (0.0, END_WINDOW))
    velocity = (here - before) / END_WINDOW
    pace = float(np.linalg.norm(velocity))
    if plan.stop is not None or bounds is None or goal.get("speed") is not None or pace < 0.05:
        return ""
    way = velocity * pace / (2.0 * float(data["vehicle"]["max_deceleration"]))
    stands, radius = here + way, float(data["vehicle"]["radius"])
    out = max(float((stands + radius - bounds["max"]).max()), float((np.array(bounds["min"]) - stands + radius).max()))
    return f"no stop behind the goal: {out:.3g} m out of the bounds" if out > 1e-3 else ""


def _arrived(planner: sp.Planner, plan: OnlinePlan, told: _State, crossed: list[np.ndarray]) -> str:
    """Say how far a vehicle that is said to have arrived was from its goal, or how fast it still is."""
    goal = planner.scenario.goal
    if not plan.arrived or goal.target is not None or goal.region is not None:
        return ""
    vehicle = planner.scenario.vehicle
    length = math.dist(crossed[0] if crossed else told.position, goal.position)
    near = goal.radius + 2e-3 * max(1.0, length / 20.0) + (0.0 if goal.radius else PERIOD * vehicle.max_speed)
    places = np.array([*crossed, told.position]) if goal.speed is None else told.position[None]
    off = float(np.linalg.norm(places - np.array(goal.position), axis=1).min())
    if off > near:
        return f"arrived {off:.3g} m from the goal, {near:.3g} m allowed"
    missed = goal_speed_missed(contents(planner.scenario)) + vehicle.max_deceleration * PERIOD
    if goal.speed is not None and abs(told.speed) > goal.speed + missed + FOLLOWS:
        return f"arrived at {told.speed:.3g} m/s, {goal.speed:.3g} m/s asked for"
    return ""
