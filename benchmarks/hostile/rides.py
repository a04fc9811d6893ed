"""Drives through drawn scenes in which limits, goal, ground and obstacles change, and odd states are reported.

The vehicle is said to be faster or slower, turned, beside the path, at the goal, late or early, or in a state that it
cannot have; arguments of calls are absurd. Whatever is safe has to begin at the reported state; a vehicle that is there
has to be able to follow it; what is certified, and each stop for which it can be left, keeps its promises by the dense
check among obstacles that move as they were drawn; and who has arrived is where the goal asks.
"""

from __future__ import annotations

import math
import time as clocks
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from pydantic import ValidationError

import scp_planner as sp
from benchmarks.hostile import scenes
from benchmarks.hostile.damage import ODD
from benchmarks.hostile.features import Data, Rng, Way, draw_map
from benchmarks.hostile.oracle import (
    Drive,
    contents,
    goal_speed_missed,
    occupied_ground,
    refused,
    tolerances,
)
from benchmarks.hostile.outcome import Outcome, judged
from benchmarks.hostile.scaling import scaled
from scp_planner.errors import TooLargeError
from scp_planner.online.plan import AWAY, OnlinePlan
from scp_planner.online.stops import standing_from
from scp_planner.scenario.models import Steering
from scp_planner.settings.online import Safety
from verification.differences import END_WINDOW, SLOW, Array, end_speed
from verification.findings import Finding, Tolerances
from verification.following import Allowed, Told, arrived, beginning, followed
from verification.places import corridor, disc_centres, walls, workspace

CYCLES = (3, 25)
"""Replans of a drive, at least and at most."""
PERIODS = (0.05, 0.1, 0.1, 0.5)
"""Units of time."""
WAITS = (1.0, 1.0, 1.0, 1.0, 0.0, 0.2, 1.5, 3.0)
"""Periods from one replan to the next."""
DEADLINE = 0.3
"""s."""
SPARE, SHARE = 0.1, 0.1
"""s, and share of a time limit, after which an answer is late, by the processor's time."""
CHANGES, ODD_STATES, ABSURD = 0.12, 0.15, 0.1
"""Share of the replans with a call before them, of those from an odd state, and of the absurd among the calls."""
SAMPLES = 4000
LONGEST = 1.5
"""s of the processor, after which no replan is begun."""
SHORTEST = 0.05
"""Units of time; a shorter drive is not checked, since differences would say nothing of it."""
SLOWEST = 0.05
"""Units of speed; a vehicle that is slower at its goal needs no room behind it."""
FOLLOWS = 2e-3
"""Units by which an answer may begin off the state from which its own plan led."""
HEADING = 0.05
"""rad, by which the heading of who has arrived may be off the goal's, as documented."""
ROUND_THE_END = 1e-6
"""Units of length; radius of the goal of an answer that ends anywhere."""
NOTHING: Data = {"call": None, "odd": None, "wait": 1.0}
"""A replan of which nothing is odd."""
REFUSALS = (sp.ScenarioError, TooLargeError, sp.EstimationError, ValidationError, ValueError)
"""Documented errors of a call."""


def draw(rng: Rng) -> Data:
    """Draw a scene, options, and what happens at each replan."""
    scene = scenes.draw(rng)
    vehicle = scene["scenario"]["vehicle"]
    for key in ("earliest_arrival", "latest_arrival", "arrival_step"):
        scene["scenario"]["goal"].pop(key, None)
    scene["least_time"] = None  # plan() alone takes a user's constraints
    if len(vehicle.get("discs", ())) < 2 and "steering" not in vehicle and rng.random() < 0.3:
        vehicle["steering"] = str(rng.choice([Steering.BOTH_WAYS, Steering.ANY]))
    options = {
        "period": float(rng.choice(PERIODS)),
        "tracking_error": float(rng.choice([0.0, 0.0, 0.02, 0.1])),
        "safety": str(rng.choice(list(Safety))),
    }
    steps = [_step(scene, rng) for _ in range(int(rng.integers(*CYCLES)))]
    # Without a deadline the same calls give the same answers
    deadline = DEADLINE if rng.random() < 0.5 else None
    return {"scene": scene, "options": options, "steps": steps, "predictor": rng.random() < 0.1, "deadline": deadline}


def _step(scene: Data, rng: Rng) -> Data:
    step = {**NOTHING, "wait": float(rng.choice(WAITS))}
    if rng.random() < ODD_STATES:
        kind = str(rng.choice(["backwards", "fast", "factor", "zero", "aside", "turned", "there", "nan"]))
        size = float(rng.uniform(0.05, 1.0)) if rng.random() < 0.5 else float(10.0 ** rng.uniform(-3.0, -1.0))
        step["odd"] = [kind, size]
    if rng.random() < CHANGES:
        step["call"] = _call(scene, rng)
    return step


def _call(scene: Data, rng: Rng) -> list[Any]:
    """Draw a method and its arguments, in units of the scene, now and then with one that is absurd."""
    name, arguments = _change(scene, rng)
    values = [key for key in arguments if key != "obstacle"]
    if values and rng.random() < ABSURD:
        key = str(rng.choice(values))
        arguments[key] = ODD[int(rng.integers(len(ODD)))]
    return [name, arguments]


def _change(scene: Data, rng: Rng) -> tuple[str, Data]:
    data = scene["scenario"]
    vehicle, begin, clock = data["vehicle"], np.array(data["start"]["position"]), data["start"]["time"]
    place = begin + rng.normal(0.0, 5.0, 2)
    match int(rng.integers(10)):
        case 0:
            name = str(rng.choice(["max_speed", "max_deceleration"]))
            return "set_limits", {name: float(rng.uniform(0.3, 1.2)) * vehicle[name]}
        case 1:
            return "set_limits", {"max_curvature": float(rng.uniform(0.2, 1.5))}
        case 2:
            return "set_limits", {"reverse": None}
        case 3:
            away = 10.0 ** rng.uniform(-9.0, 2.0) * rng.choice([0.0, 1.0], p=[0.1, 0.9])
            angle = float(rng.uniform(-3.2, 3.2))
            place = begin + rng.normal(0.0, 2.0, 2) + away * np.array([math.cos(angle), math.sin(angle)])
            return "set_goal", {"goal": {"position": place.tolist()}}
        case 4:
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * rng.uniform(0.1, 1.0, 2)
            return "set_walls", {"walls": [(place + corners).tolist()]}
        case 5:
            half = float(rng.uniform(2.0, 30.0))
            return "set_ground", {"bounds": {"min": (begin - half).tolist(), "max": (begin + half).tolist()}}
        case 6:
            return "update_map", {"map": draw_map(Way(begin, np.array([1.0, 0.0]), 10.0, clock), rng)}
        case 7:
            return "remove_obstacle", {"obstacle": _name(data, rng)}
        case 8:
            seen = {"time": clock + float(rng.uniform(-1.0, 2.0)), "position": place.tolist()}
            return "observe", {"obstacle": _name(data, rng), **seen, "covariance": [[0.01, 0.0], [0.0, 0.01]]}
        case _:
            return "add_obstacle", {"obstacle": "new", "shape": {"disc": 0.3}, "margin": float(rng.uniform(0.0, 0.2))}


def _name(data: Data, rng: Rng) -> str:
    return str(rng.choice([*(each["id"] for each in data["obstacles"]), "nobody"]))


class _Straight:
    """A predictor that knows nothing but where things are."""

    def __init__(self, scenario: sp.Scenario) -> None:
        self.names = [each.id for each in scenario.obstacles if each.motion is not None][:1]

    def predict(self, now: float, horizon: float) -> Mapping[str, Any]:
        return {name: {"time": now, "position": [1e3, 1e3 + horizon], "velocity": [0.0, 0.0]} for name in self.names}


def odd_state(told: Told, kind: str, size: float, scenario: Data) -> Told:
    """Return what is reported in place of a state."""
    top, goal = float(scenario["vehicle"]["max_speed"]), scenario["goal"]
    match kind:
        case "backwards":
            return replace(told, speed=-size * top)
        case "fast":
            return replace(told, speed=(1.0 + size) * top)
        case "factor":
            return replace(told, speed=(1.0 + size) * told.speed)
        case "zero":
            return replace(told, speed=0.0)
        case "aside":
            return replace(told, position=told.position + size * np.array([1.0, -1.0]))
        case "turned":
            return replace(told, heading=None if told.heading is None else told.heading + size)
        case "there":
            return replace(told, position=np.array(goal["position"])) if goal.get("position") is not None else told
    return replace(told, speed=math.nan)


def drive(case: Data) -> Outcome:
    """Drive through a scene, and judge every answer."""
    scene, options = case["scene"], case["options"]
    try:
        scenario = scenes.scenario_of(scene)
        online = sp.OnlineSettings(
            period=options["period"] * scene["time"],
            tracking_error=options["tracking_error"] * scene["length"],
            safety=options["safety"],
        )
        planner = sp.Planner(scenario, online=online)
    except (sp.ScenarioError, TooLargeError):
        return Outcome("bad input")
    ride = Ride(scene, planner, case["deadline"])
    if case["predictor"]:
        planner.predictor = _Straight(scenario)
        ride.lose(planner.predictor.names)
    began = clocks.process_time()
    for number, step in enumerate(case["steps"]):
        if clocks.process_time() - began > LONGEST:
            break
        ride.change(step["call"])
        told = ride.state
        if step["odd"] is not None:
            kind, size = step["odd"]
            told = odd_state(told, kind, size, contents(planner.scenario, scene))
        plan, missed = ride.replan(told)
        if missed:
            outcome = "nothing" if plan is None else plan.outcome
            about = f"replan {number}, t = {told.time:.6g}, {outcome}, {step['odd']}, {step['call']}"
            return judged("driven", f"{about}: {missed}")
        if plan is not None and not ride.drive_on(plan, told, step["wait"] * options["period"]):
            break
    return judged("driven", "", ride.checked)


class Ride:
    """A planner, where its vehicle is, and where it has been since its goal was set, in the units of a scene.

    Parameters
    ----------
    scene : dict
    planner : Planner
    deadline : float or None
        Of each replan, s.

    Attributes
    ----------
    state : Told
        Where the vehicle is.
    checked : int
        Promises that were looked at.
    """

    def __init__(self, scene: Data, planner: sp.Planner, deadline: float | None = None) -> None:
        self.scene, self.planner, self.deadline = scene, planner, deadline
        start = scene["scenario"]["start"]
        self.state = Told(start["time"], np.array(start["position"]), start.get("heading"), start["speed"])
        self.checked = 0
        self.crossed: list[Array] = []
        self.last: OnlinePlan | None = None
        goal, vehicle = scene["scenario"]["goal"], scene["scenario"]["vehicle"]
        gains, brakes = vehicle["max_acceleration"], vehicle["max_deceleration"]
        way = math.inf if goal.get("target") is not None else math.dist(start["position"], scenes.aim(goal))
        self.reached = math.sqrt(2.0 * gains * brakes * way / (gains + brakes))
        self.truth = {each["id"]: each for each in scene["scenario"]["obstacles"]}
        for each in scene["scenario"]["obstacles"]:
            exact = each.get("motion") or {"covariance": True}
            if "covariance" in exact or "futures" in exact:
                self.lose([each["id"]])

    def lose(self, names: list[str]) -> None:
        """Trust what the planner says of some obstacles: they are told otherwise than they were drawn."""
        for name in names:
            self.truth.pop(name, None)

    def change(self, call: list[Any] | None) -> None:
        """Change limits, goal, ground or obstacles; what is refused by a documented error changes nothing."""
        if call is None:
            return
        name, arguments = call
        made = scaled(arguments, self.scene["length"], self.scene["time"])
        try:
            if name == "update_map" and isinstance(made["map"], dict) and "cells" in made["map"]:
                made["map"] = scenes.map_of(made["map"])
            getattr(self.planner, name)(**made)
        except REFUSALS as error:
            if isinstance(error, np.linalg.LinAlgError):
                raise
            return
        if name == "set_goal":
            self.crossed = []
        if name == "update_map":
            self.scene = {**self.scene, "map": arguments["map"]}
        if name in ("remove_obstacle", "observe"):
            self.lose([arguments["obstacle"]])

    def replan(self, told: Told) -> tuple[OnlinePlan | None, str]:
        """Replan from a state that is reported, and say what is wrong with the answer."""
        length, time = self.scene["length"], self.scene["time"]
        doubts, began = list(self.planner.doubts), clocks.process_time()
        try:
            plan = self.planner.replan(
                told.time * time, told.position * length, told.heading, told.speed * length / time, None, self.deadline
            )
        except ValueError:
            if math.isfinite(told.speed):
                raise
            return None, ""
        if not math.isfinite(told.speed):
            return plan, "nan is taken for a speed"
        took = clocks.process_time() - began
        late = self.deadline is not None and took > self.deadline * (1.0 + SHARE) + SPARE
        doubted = list(self.planner.doubts) != doubts
        missed = [
            f"{took:.2f} s for {self.deadline:g} s" if late else "",
            "" if plan.reason else "no reason",
            self.judge(plan, told, doubted=doubted),
        ]
        self.last = plan
        return plan, "; ".join(filter(None, missed))

    def drive_on(self, plan: OnlinePlan, told: Told, wait: float) -> bool:
        """Drive to the next replan; return False if the drive is over."""
        ahead, made = told.time + wait, Drive(plan, self.scene["length"], self.scene["time"])
        if plan.arrived or (plan.outcome not in AWAY and made.end <= ahead):
            return False
        (place,), (heading,) = made.position([ahead]), made.heading([ahead])
        self.state = Told(ahead, place, float(heading), made.speed(ahead))
        self.crossed += list(made.position(np.linspace(told.time, ahead, 20)))
        return True

    def judge(self, plan: OnlinePlan, told: Told, *, doubted: bool = False) -> str:
        """Say what an answer breaks: its beginning, its scenario, its stop, a stop behind its goal, an arrival."""
        answer, data = Drive(plan, self.scene["length"], self.scene["time"]), self._promised()
        missed = [_arrived(self, plan, told, data)]
        if plan.outcome not in AWAY and not plan.arrived and plan.safe and answer.end < told.time - SHORTEST:
            missed.append(f"a plan that ended at {answer.end:.6g} is kept")
        if plan.safe:
            vehicle = data["vehicle"]
            backwards = vehicle.get("reverse") is not None or vehicle.get("steering") in ("both_ways", "any")
            speed = told.speed
            if told.heading is None:  # the sign says nothing
                speed = abs(speed)
            error = self.planner.online.tracking_error / answer.length
            if speed < -self.off(vehicle, error).speed - 1e-12 * float(vehicle["max_speed"]) and not backwards:
                if not doubted:
                    return f"{speed:.3g} without a reverse gear is safe, and nothing is doubted"
                speed = 0.0
            told = replace(told, speed=speed if backwards else max(speed, 0.0))
            missed += self._kept(plan, answer, told, data)
        return "; ".join(filter(None, missed))

    def _promised(self) -> Data:
        """Return the scenario of the planner, with those obstacles that there are."""
        data = contents(self.planner.scenario, self.scene)
        # A target is not kept clear of, but where it is an obstacle, too
        given = {each["id"] for each in self.scene["scenario"]["obstacles"]}
        told = {each["id"]: each for each in data["obstacles"]}
        places = (data["goal"], *data.get("goals", ()))
        met = {name: told.pop(name) for place in places if (name := _met(place)) in told and name not in given}
        data["goal"], *data["goals"] = ({**each, "target": met.get(_met(each), each.get("target"))} for each in places)
        start = float(self.scene["scenario"]["start"]["time"])
        for name, each in self.truth.items():
            told[name] = {**each, "motion": {"time": start, **each["motion"]}}
        return {**data, "obstacles": list(told.values())}

    def _kept(self, plan: OnlinePlan, answer: Drive, told: Told, data: Data) -> Iterator[str]:
        """What a safe answer, and the stop from it, break."""
        if plan.certified:
            self.checked += 1
            yield self._looked(answer, told, answer.end, data, away=plan.outcome in AWAY)
            yield _behind(plan, answer, data, occupied_ground(self.scene["map"]))
        if plan.stop is not None:
            self.checked += 1
            gear = math.pi if answer.speed(told.time) < 0.0 or bool(plan.backward(told.time * answer.time)) else 0.0
            stop = replace(answer, plan=replace(plan, trip=plan.stop, legs=None), turn=gear)
            end = (plan.stop.frame.time + standing_from(plan.stop.trajectory)) / answer.time
            missed = self._looked(stop, told, end, data, away=True)
            yield f"stop: {missed}" if missed else ""

    def _looked(self, made: Drive, told: Told, end: float, data: Data, *, away: bool) -> str:
        """Say what a drive up to a time breaks, from where it begins near a state that is reported."""
        vehicle, error = data["vehicle"], self.planner.online.tracking_error / made.length
        steering = vehicle.get("steering") or "ahead"
        off = self.off(vehicle, error)
        times = np.linspace(told.time, max(end, told.time + SHORTEST), 200)
        usual = tolerances(data, made.position(times), times)
        follows = FOLLOWS if end < told.time + SHORTEST else 0.0
        allowed = Allowed(
            usual.position + off.position + follows,
            usual.boundary_speed + off.speed + follows,
            usual.heading + off.heading,
        )
        free = steering == "any" or (steering != "ahead" and abs(told.speed) <= SLOW)
        begun = replace(told, heading=None if free else told.heading)
        if steering == "any":
            begun = replace(begun, speed=math.copysign(told.speed, made.speed(told.time)))
        elif steering == "both_ways" and told.heading is not None:
            turn = float(made.heading([told.time])[0]) - told.heading
            if math.cos(turn) < 0.0:  # its plans say in which direction it drives, and not in which gear
                begun = replace(begun, heading=None if free else told.heading + math.pi, speed=-told.speed)
        found = beginning(begun, made.position, end - told.time, allowed, made.heading)
        off_by = max(each.excess for each in found)
        if error and told.speed >= 0.0 and off_by > 1e-6 and all(each.ok for each in found):
            found += self._followed(data, made, told, end, allowed)
        missed = "; ".join(str(each) for each in found if not each.ok)
        if missed or end - told.time < SHORTEST:
            return missed
        place, speed = made.position([told.time])[0], end_speed(made.position, told.time, 1)
        start = {**data["start"], "time": told.time, "position": place.tolist(), "heading": None}
        start["acceleration"] = self._accelerates(told)
        data = {**data, "start": {**start, "speed": math.copysign(speed, made.speed(told.time) or begun.speed)}}
        speed_met = 0.0
        if away:
            last = made.position([end])[0]
            data |= {"goal": {"position": last.tolist(), "radius": ROUND_THE_END}, "goals": []}
        elif data["goal"].get("target") is not None:  # met as closely as a period allows, as documented
            period = (self.planner.online.period or 0.0) / made.time
            near = data["goal"].get("radius") or period * float(vehicle["max_speed"])
            data["goal"] = {**data["goal"], "radius": near}
            speed_met = period * float(vehicle["max_deceleration"]) + HEADING * float(vehicle["max_speed"])
        return refused(
            self.scene, self.planner.scenario, made, data=data, begin=told.time, end=end, samples=SAMPLES,
            lowered=True, speed_met=speed_met,
        )  # fmt: skip

    def off(self, vehicle: Mapping[str, Any], error: float) -> Allowed:
        """How far off an answer may begin by a tracking error, as documented."""
        brakes, top = float(vehicle["max_deceleration"]), min(float(vehicle["max_speed"]), self.reached)
        return Allowed(error, error * brakes / top, 2.0 * error * brakes / top**2)

    def _accelerates(self, told: Told) -> float | None:
        """Acceleration at a state: that of the last answer, as one goes on from there where the jerk is limited."""
        start = self.scene["scenario"]["start"]
        if self.last is None:
            return start.get("acceleration")
        time, length = self.scene["time"], self.scene["length"]
        moment = told.time * time
        inside = self.last.start_time <= moment <= self.last.arrival_time
        found = float(self.last.acceleration(moment)) * time**2 / length if inside else 0.0
        return max(found, 0.0) if told.speed == 0.0 else found

    def _followed(self, data: Data, made: Drive, told: Told, end: float, allowed: Allowed) -> list[Finding]:
        """How near to zones and borders a vehicle comes that follows from where it was told to be."""
        radius = float(data["vehicle"]["radius"])
        times, places = followed(data["vehicle"], told, made.position, max(end, told.time + SHORTEST))
        usual, found = Tolerances(clearance=allowed.position), []
        for each in disc_centres({**data, "start": {**data["start"], "heading": told.heading or 0.0}}, places):
            found += [*workspace(data, times, each, usual), *corridor(data, times, each, usual)]
            found += walls(data, times, each, usual)
            for zone in self.planner.zones:
                room = zone.signed_distance(times * made.time, each * made.length) / made.length - radius
                worst = int(np.argmin(room))
                least, when = float(room[worst]), float(times[worst])
                found.append(Finding("followed", least, 0.0, -least, allowed.position, when, zone.id))
        return found


def _met(place: Mapping[str, Any]) -> str | None:
    """Id of the target of a goal or a place."""
    target = place.get("target")
    name = target.get("obstacle") if isinstance(target, dict) else target
    return None if name is None else str(name)


def _behind(plan: OnlinePlan, answer: Drive, data: Mapping[str, Any], ground: Any) -> str:
    """Say what a vehicle hits that passes its goal and brakes straight on, if it has no other stop."""
    goal, end = data["goal"], answer.end
    here, before = answer.position(np.array([end, end - END_WINDOW]))
    velocity = (here - before) / END_WINDOW
    pace = float(np.linalg.norm(velocity))
    if plan.stop is not None or plan.outcome in AWAY or goal.get("speed") is not None or pace < SLOWEST:
        return ""
    stands = here + velocity * pace / (2.0 * float(data["vehicle"]["max_deceleration"]))
    way = shapely.LineString([here, stands]).buffer(float(data["vehicle"]["radius"]) - 1e-3)
    bounds = data.get("bounds")
    if bounds is not None and not shapely.box(*bounds["min"], *bounds["max"]).contains(way):
        return "no stop behind the goal: out of the bounds"
    blocked = [f"walls[{k}]" for k, wall in enumerate(data.get("walls") or ()) if way.intersects(shapely.Polygon(wall))]
    blocked += ["occupied ground"] if ground is not None and way.intersects(ground) else []
    return f"no stop behind the goal: {', '.join(blocked)} in the way" if blocked else ""


def _arrived(ride: Ride, plan: OnlinePlan, told: Told, data: Mapping[str, Any]) -> str:
    """Say how a vehicle that is said to have arrived misses its goal: one with a speed now, another one on its way."""
    goal, vehicle, length = data["goal"], data["vehicle"], ride.scene["length"]
    if not plan.arrived or goal.get("target") is not None:
        return ""
    online, made = ride.planner.online, Drive(plan, length, ride.scene["time"])
    period, error = (online.period or 0.0) / made.time, online.tracking_error / length
    first = ride.crossed[0] if ride.crossed else told.position
    near = error + 2e-3 * max(1.0, math.dist(first, scenes.aim(goal)) / 20.0)
    if not goal.get("radius") and goal.get("region") is None:
        near += period * float(vehicle["max_speed"])
    if goal.get("speed") is None and goal.get("speed_range") is None:
        ahead = abs(float(vehicle.get("centre") or 0.0))
        area = shapely.Point(goal["position"]) if goal.get("region") is None else shapely.Polygon(goal["region"])
        off = float(shapely.distance(area, shapely.points([*ride.crossed, told.position])).min())
        near += float(goal.get("radius") or 0.0) + (0.0 if goal.get("region") is None else ahead)
        return "" if off <= near else f"arrived {off:.3g} from the goal, {near:.3g} allowed"
    more = goal_speed_missed(data) + float(vehicle["max_deceleration"]) * period + ride.off(vehicle, error).speed
    allowed = Allowed(near, more + FOLLOWS, HEADING + ride.off(vehicle, error).heading)
    pace = abs(told.speed)
    if goal.get("speed") is not None:  # slower is as good
        pace = min(pace, float(goal["speed"]))
    found = arrived(data, replace(told, speed=pace), allowed, abs(made.speed(made.end)))
    fast = f"arrived at {told.speed:.3g}, {pace:.3g} asked for" if abs(told.speed) > pace + allowed.speed else ""
    return "; ".join(filter(None, [fast, *(f"arrived: {each}" for each in found if not each.ok)]))
