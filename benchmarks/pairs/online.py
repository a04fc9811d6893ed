"""Closed loops through scenes: the vehicle drives what it is told, and what it drove is judged."""

from __future__ import annotations

import math
import time as clocks
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.hostile.features import Data, Rng
from benchmarks.hostile.oracle import occupied_ground
from benchmarks.hostile.rides import HEADING, SHARE
from benchmarks.hostile.rides import SPARE as LATE
from benchmarks.pairs.motion import Array
from benchmarks.pairs.scene import Change, Feature, Scene
from benchmarks.pairs.verdict import Result, judge
from scp_planner.online.plan import AWAY
from verification.distances import clearances
from verification.findings import Finding, Tolerances, find_worst
from verification.meetings import meeting, passages
from verification.places import corridor, disc_centres, occupied, walls

PERIOD = 0.1
"""s."""
LONGEST = 3.0
"""Times the motion of the scene, that a drive may take."""
STEPS = 20
"""Times in a period at which a drive is looked at."""
KEPT = 0.8
"""Share of the tracking error by which the vehicle is off its plan."""
CLEAR = 1e-3
"""m or m/s, by which a drive may miss more than a plan, between the times at which it is looked at."""


@dataclass(frozen=True)
class Stretch:
    """Part of a drive, and the scenario and the map that it was driven for."""

    data: Data
    map: Data | None
    margin: float
    times: Array
    states: Array
    """Columns: x and y, m, heading, rad, speed, m/s, negative backwards."""

    def touched(self) -> Iterator[Finding]:
        """Compare the drive with the speeds of its gears, and with all that it is to stay clear of."""
        allowed = Tolerances(clearance=CLEAR)
        vehicle, speeds = self.data["vehicle"], self.states[:, 3]
        yield from find_worst("speed", speeds, vehicle["max_speed"], CLEAR, self.times)
        backwards = vehicle.get("reverse") or {"max_speed": 0.0}
        yield from find_worst("speed_backwards", -speeds, backwards["max_speed"], CLEAR, self.times)
        ground = occupied_ground(self.map)
        for place in disc_centres(self.data, self.states[:, :2], self.states[:, 2]):
            yield from walls(self.data, self.times, place, allowed)
            yield from corridor(self.data, self.times, place, allowed)
            yield from occupied(self.data, self.times, place, allowed, ground)
            yield from clearances(self.data, self.times, place, allowed, {})

    def missed(self) -> Iterator[Finding]:
        """Compare the drive with the places to pass, and its last period with the goal, as closely as documented."""
        allowed = Tolerances(position=CLEAR + self.margin)
        yield from passages(self.data, self.times, self.states[:, :2], self.states[:, 2], allowed)
        ends = [self._end(k) for k in range(-min(STEPS, len(self.times)), 0)]
        yield from min(ends, key=lambda found: max(each.excess - each.tolerance for each in found))

    def _end(self, k: int) -> list[Finding]:
        """Compare a state with the goal: its place, heading and speed, or those of its target."""
        goal, vehicle, when = self.data["goal"], self.data["vehicle"], float(self.times[k])
        radius = goal.get("radius") or PERIOD * vehicle["max_speed"]
        x, y, heading, speed = self.states[k]
        velocity = speed * np.array([math.cos(heading), math.sin(heading)])
        slower = PERIOD * vehicle["max_deceleration"] + HEADING * vehicle["max_speed"]
        allowed = Tolerances(position=CLEAR + self.margin, heading=HEADING, boundary_speed=slower)
        if goal.get("target") is not None:
            return meeting(
                {**self.data, "goal": {**goal, "radius": radius}},
                lambda times: np.array([x, y]) + np.multiply.outer(times - when, velocity),
                lambda times: np.full_like(times, heading),
                when - PERIOD,
                when,
                allowed,
            )
        gap = math.dist((x, y), goal["position"])
        found = [Finding("goal_position", gap, radius, gap - radius, allowed.position, when)]
        if goal.get("heading") is not None:
            off = abs(math.remainder(heading - goal["heading"], 2.0 * math.pi))
            found.append(Finding("goal_heading", heading, goal["heading"], off, allowed.heading, when))
        if goal.get("speed") is not None:
            off = abs(abs(speed) - goal["speed"])
            found.append(Finding("goal_speed", abs(speed), goal["speed"], off, slower, when))
        return found


class Drive:
    """A vehicle, its planner, and where it has been."""

    def __init__(self, scene: Scene, rng: Rng) -> None:
        self.scene, self.rng = scene, rng
        self.planner = sp.Planner(scene.scenario(), online=sp.OnlineSettings(period=PERIOD, **scene.settings))
        self.planner.predictor = scene.predictor
        start = scene.data["start"]
        self.time = scene.motion.start
        self.state = np.array([*start["position"], start["heading"], start["speed"]])
        self.data, self.map = scene.data, scene.map
        self.left = sorted(scene.changes, key=lambda each: np.inf if each.time is None else each.time)
        self.times: list[Array] = [np.array([self.time])]
        self.states: list[Array] = [self.state[None]]
        self.over = self.set = 0  # states before the present ground, and before the present goal
        self.found: list[Finding] = []
        self.latest = 0.0

    def run(self) -> str:
        """Drive until the vehicle has arrived at its last goal; return what is wrong."""
        until = self.scene.motion.start + LONGEST * self.scene.motion.duration
        reason = ""
        while self.time < until:
            while self.left and self.left[0].time is not None and self.left[0].time <= self.time:
                self._change(self.left.pop(0))
            plan = self._replan()
            reason = f"{plan.outcome}, {plan.code}: {plan.reason}"
            if plan.arrived or self._drive(plan):
                self.found += self._since(self.set).missed()
                if not self.left:
                    return self._faults("")
                self._change(self.left.pop(0))
        off = np.linalg.norm(self.state[:2] - self.scene.motion.position(self.scene.motion.end)[0])
        return self._faults(
            f"not arrived in {LONGEST:g} times {self.scene.motion.duration:.1f} s, {off:.2f} m off; {reason}"
        )

    def _since(self, first: int) -> Stretch:
        """Give what was driven since a state."""
        times, states = np.concatenate(self.times)[first:], np.concatenate(self.states)[first:]
        if len(times) == 1:  # two, so that there is a chord
            times, states = np.repeat(times, 2), np.repeat(states, 2, axis=0)
        return Stretch(self.data, self.map, self.scene.margin, times, states)

    def _faults(self, never: str) -> str:
        """Say what is wrong with a drive that is over."""
        self.found += self._since(self.over).touched()
        late = self.scene.deadline is not None and self.latest > self.scene.deadline * (1.0 + SHARE) + LATE
        told = [never, f"{self.latest:.2f} s for {self.scene.deadline} s" if late else ""]
        return "; ".join(filter(None, [*told, *(str(each) for each in self.found if not each.ok)]))

    def _replan(self) -> Any:
        began = clocks.process_time()
        x, y, heading, speed = self.state.tolist()
        plan = self.planner.replan(self.time, (x, y), heading, speed, deadline=self.scene.deadline)
        self.latest = max(self.latest, clocks.process_time() - began)
        return plan

    def _change(self, change: Change) -> None:
        """Make a call, and judge what follows by what it asks for."""
        self.found += self._since(self.over).touched()
        self.over = sum(map(len, self.times)) - 1
        asked = dict(change.call(self.planner, self.state[:2]) or {})
        self.set = self.over if "goal" in asked else self.set
        self.map = asked.pop("map", self.map)
        self.data = {**self.data, **asked}

    def _drive(self, plan: Any) -> bool:
        """Drive to the next replan; return True if the plan arrives before that."""
        ahead = self.time + PERIOD
        ends = plan.outcome not in AWAY and plan.certified and plan.arrival_time <= ahead
        ahead = plan.arrival_time if ends else ahead
        if ahead <= self.time:
            return bool(ends)
        times = np.linspace(self.time, ahead, STEPS + 1)
        speeds = np.where(plan.backward(times), -1.0, 1.0) * plan.speed(times)
        driven = np.column_stack([plan.position(times), plan.heading(times), speeds])
        off = self.state[:2] - driven[0, :2]
        driven[:, :2] += off + (times - self.time)[:, None] / PERIOD * (self._error() - off)
        self.state, self.time = driven[-1], ahead
        self.times.append(times[1:])
        self.states.append(driven[1:])
        return bool(ends)

    def _error(self) -> Array:
        """Draw how far off its plan the vehicle is at the next replan, (2,) m."""
        angle = float(self.rng.uniform(-np.pi, np.pi))
        return KEPT * self.scene.margin * np.array([np.cos(angle), np.sin(angle)])


def try_online(features: Sequence[Feature], scene: Scene, rng: Rng) -> Result:
    """Drive through a scene, and judge the drive."""
    return judge(features, lambda: Drive(scene, rng).run())
