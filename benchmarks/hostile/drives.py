"""Wild scenarios driven with an online planner that is told other states than it planned, its promises checked densely.

The vehicle is said to be faster or slower, turned, beside the path, late or early. What is safe has to begin where the
vehicle is said to be, and a vehicle that is there has to be able to follow it to its end; what is certified, and a stop
for which a trip can be left, have to be so by the dense check, for the scenario that the planner says it planned for;
and who has arrived has to stand at the goal.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.hostile.dense import goal_speed_missed, regions
from benchmarks.hostile.outcome import Outcome, judged
from benchmarks.hostile.wild import Data, Wild, scaled, wild
from scp_planner.online.plan import AWAY, OnlinePlan
from scp_planner.online.stops import standing_from
from scp_planner.scenario.models import Steering
from scp_planner.settings.online import Safety
from scp_planner.trips.trip import Trip
from verification.dense_check import check_trip
from verification.differences import SLOW, PositionFunction, end_heading, end_speed
from verification.findings import Finding, Tolerances
from verification.following import Allowed, Told, arrived, beginning, followed
from verification.places import corridor, disc_centres, walls, workspace

CYCLES = (2, 12)
"""Replans of a drive, at least and at most."""
SAMPLES = 4000
SHORTEST_CHECKED = 0.05
"""Units of time; what is left of a trip, for differences to say something."""
ROUND_THE_END = 1e-6
"""Units of length; radius of the goal of a trip that ends anywhere."""
PERTURBED = 0.4
"""How often a state is told that is not the planned one."""
THERE = 0.1
"""How often the vehicle is said to be at the goal already."""
FASTEST, TURN, BESIDE = 2.0, 1.0, 0.3
"""Times the planned speed, rad and units of length, that a state may be told off at most."""
HEADING = 0.05
"""rad, by which the heading of who has arrived may be off the goal's, as documented."""
FITS = 1e-3
"""m/s by which an answer may begin slower before it is looked at who follows it."""
WAITS = (1.0, 1.0, 1.0, 0.0, 0.2, 1.5, 3.0)
"""Periods from one replan to the next."""


def draw(rng: np.random.Generator) -> Data:
    """Draw a scenario, options, and what is told in each replan."""
    drawn = wild(rng)
    vehicle, goal = drawn.data["vehicle"], drawn.data["goal"]
    if len(vehicle.get("discs", ())) < 2:
        vehicle["steering"] = str(rng.choice(list(Steering)))
    for key in ("earliest_arrival", "latest_arrival", "arrival_step"):
        goal.pop(key, None)  # for whoever drives, another trip each time
    options = {
        "period": float(rng.choice([0.05, 0.1, 0.5])),
        "tracking_error": float(rng.choice([0.0, 0.0, 0.02, 0.1])),
        "safety": str(rng.choice(list(Safety))),
    }
    told = [_told(rng) for _ in range(int(rng.integers(*CYCLES)))]
    return {"data": drawn.data, "length": drawn.length, "time": drawn.time, "options": options, "told": told}


def _told(rng: np.random.Generator) -> Data:
    """How a state is off: a factor, rad, units of length, or at the goal; and how many periods the next one waits."""
    told: Data = {"wait": float(rng.choice(WAITS)), "factor": 1.0, "turn": 0.0, "beside": 0.0}
    told["there"] = bool(rng.random() < THERE)
    if rng.random() < PERTURBED:
        size = float(np.exp(rng.uniform(np.log(1e-3), 0.0)))
        key = str(rng.choice(["factor", "turn", "beside", "all"]))
        off = {"factor": FASTEST - 1.0, "turn": TURN, "beside": BESIDE}
        told.update({k: told[k] + size * rng.uniform(-1.0, 1.0) * most for k, most in off.items() if key in (k, "all")})
    return told


def tolerances(given: sp.Scenario, error: float, length: float, time: float) -> Allowed:
    """How far off the answers for a scenario may begin by a tracking error, m, in units of so many m and s."""
    vehicle, usual = given.vehicle, Tolerances()
    gains, brakes = vehicle.max_acceleration, vehicle.max_deceleration
    way = math.dist(given.start.position, given.goal.position)
    top = min(vehicle.max_speed, math.sqrt(2.0 * gains * brakes * way / (gains + brakes)))
    return Allowed(
        error / length + max(usual.position, 2e-6 / length),
        error * brakes / top * time / length + usual.boundary_speed,
        2.0 * error * brakes / top**2 + usual.heading,
    )


def arrival(allowed: Allowed, planner: sp.Planner, drawn: Wild, data: Mapping[str, Any]) -> Allowed:
    """How far off a vehicle may be at the goal of a scenario, in its units, beyond what a state may be off."""
    near = 1e-3 * max(1.0, math.dist(data["start"]["position"], data["goal"]["position"]) / 20.0)
    vehicle, goal, period = data["vehicle"], data["goal"], (planner.online.period or 0.0) / drawn.time
    if not goal.get("radius") and not goal.get("region"):
        near += period * vehicle["max_speed"]
    speed = allowed.speed + goal_speed_missed(data) + vehicle["max_deceleration"] * period
    return Allowed(allowed.position + near, speed, allowed.heading + HEADING)


def drive(case: Mapping[str, Any], deadline: float) -> Outcome:
    """Drive a scenario for some replans, of a deadline, s, each."""
    drawn = Wild(case["data"], case["length"], case["time"])
    try:
        scenario = sp.Scenario(**drawn.scaled())
    except sp.ScenarioError:
        return Outcome("bad input")
    period = case["options"]["period"] * drawn.time
    error = case["options"]["tracking_error"] * drawn.length
    online = sp.OnlineSettings(period=period, tracking_error=error, safety=case["options"]["safety"])
    judge = Judge(sp.Planner(scenario, online=online), drawn)
    time, start = scenario.start.time, scenario.start
    state: tuple[Any, float | None, float] = (np.array(start.position), start.heading, start.speed)
    for number, off in enumerate(case["told"]):
        position, heading, speed = state
        position = np.array(scenario.goal.position) if off["there"] else position
        heading = None if heading is None else heading + off["turn"]
        left = np.array([-math.sin(heading or 0.0), math.cos(heading or 0.0)])
        told = Told(time, position + off["beside"] * drawn.length * left, heading, speed * off["factor"])
        plan = judge.planner.replan(time, told.position, heading, told.speed, deadline=deadline)
        assert plan.reason, f"a plan without a reason: {plan.outcome}"
        refused = judge.of(plan, told)
        if refused:
            return judged("driven", f"replan {number}, t = {time:.6g} s, {plan.outcome}, {off}: {refused}")
        time += off["wait"] * period
        if plan.arrived or (plan.outcome not in AWAY and plan.arrival_time <= time):
            break
        state = (plan.position(time), float(plan.heading(time)), max(float(plan.speed(time)), 0.0))
    return judged("driven", "", judge.checked)


@dataclass
class Judge:
    """Looks at what a planner answers, in the units that its scenario was drawn in."""

    planner: sp.Planner
    drawn: Wild
    checked: int = 0

    def __post_init__(self) -> None:
        """Keep the scenario that is begun with."""
        self._given = self.planner.scenario

    def of(self, plan: OnlinePlan, told: Told) -> str:
        """Say what is wrong with an answer; nothing if nothing is."""
        length, time = self.drawn.length, self.drawn.time
        scenario = self.planner.scenario
        data = scaled(scenario.to_dict(), 1.0 / length, 1.0 / time)
        allowed = tolerances(self._given, self.planner.online.tracking_error, length, time)
        told = Told(told.time / time, told.position / length, told.heading, told.speed * time / length)
        ways = scenario.vehicle.steering
        free = ways is Steering.ANY or (ways is not Steering.AHEAD and told.speed <= SLOW)
        begun, found, speed = replace(told, heading=None if free else told.heading), [], told.speed
        for name, trip, end in _promised(plan):
            aim = data if name == plan.outcome and plan.outcome not in AWAY else self._ending(data, trip, end)
            known = regions(scenario, end)
            found += [(name, each) for each in self._looked(aim, trip, begun, end / time, known, allowed)]
            speed = end_speed(self._places(trip), end / time, -1)
        if plan.arrived:
            near = arrival(allowed, self.planner, self.drawn, data)
            found += [("arrived", each) for each in arrived(data, begun, near, speed)]
        return "; ".join(f"{name}: {each}" for name, each in found if not each.ok)

    def _places(self, trip: Trip) -> PositionFunction:
        length, time = self.drawn.length, self.drawn.time
        return lambda times: trip.frame.to_world(trip.at(np.asarray(times) * time)[0].path.position) / length

    def _ending(self, data: Data, trip: Trip, end: float) -> Data:
        """The scenario with the end of a trip as its goal: it does not go where the scenario says."""
        place = np.asarray(self._places(trip)(np.array([end / self.drawn.time])))[0]
        return {**data, "goal": {"position": place.tolist(), "radius": ROUND_THE_END}}

    def _looked(
        self, data: Data, trip: Trip, told: Told, end: float, known: Mapping[str, float], allowed: Allowed
    ) -> list[Finding]:
        self.checked += 1
        place, whole = self._places(trip), max(end - told.time, 0.0)
        found = beginning(told, place, whole, allowed)
        if not all(each.ok for each in found) or told.speed > found[1].value + FITS:
            found += self._followed(data, place, told, end, allowed)
        if whole < SHORTEST_CHECKED:
            return found
        speed, heading = end_speed(place, told.time, 1), end_heading(place, whole, told.time, 1)
        position = np.asarray(place(np.array([told.time])))[0].tolist()
        begins = {**data["start"], "position": position, "heading": heading, "speed": speed}
        # Driving faster than allowed at the start is the scenario's business, not the plan's.
        vehicle = {**data["vehicle"], "max_speed": max(data["vehicle"]["max_speed"], speed)}
        usual = replace(Tolerances(), goal_speed=goal_speed_missed(data), position=2e-6 / min(1.0, self.drawn.length))
        report = check_trip(
            {**data, "start": begins, "vehicle": vehicle},
            place,
            told.time,
            end,
            tolerances=usual,
            samples=SAMPLES,
            regions=known,
        )
        return [*found, *report.findings]

    def _followed(self, data: Data, place: PositionFunction, told: Told, end: float, allowed: Allowed) -> list[Finding]:
        """How near to zones and borders a vehicle comes that follows from where it was told to be."""
        length, time, radius = self.drawn.length, self.drawn.time, float(data["vehicle"]["radius"])
        times, places = followed(data["vehicle"], told, place, max(end, told.time + SHORTEST_CHECKED))
        usual, found = Tolerances(clearance=allowed.position), []
        for each in disc_centres({**data, "start": {**data["start"], "heading": told.heading or 0.0}}, places):
            found += [*workspace(data, times, each, usual), *corridor(data, times, each, usual)]
            found += walls(data, times, each, usual)
            for zone in self.planner.zones:
                room = zone.signed_distance(times * time, each * length) / length - radius
                worst = int(np.argmin(room))
                least, when = float(room[worst]), float(times[worst])
                found.append(Finding("followed", least, 0.0, -least, allowed.position, when, zone.id))
        return found


def _promised(plan: OnlinePlan) -> list[tuple[str, Trip, float]]:
    """Trips that are promised, by name, and the absolute times at which they end, s."""
    made = [(str(plan.outcome), plan.trip, plan.arrival_time)] if plan.certified else []
    if plan.stop is not None:
        made.append(("stop", plan.stop, plan.stop.frame.time + standing_from(plan.stop.trajectory)))
    return made
