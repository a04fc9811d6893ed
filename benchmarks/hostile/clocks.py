"""The same drive on another clock, such as unix time: all that is said and planned is the same, but for the times."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.hostile import scenes
from benchmarks.hostile.features import Data
from benchmarks.hostile.outcome import Outcome, judged

CLOCKS = (1.7e9, 1e6, -1e5)
"""s, by which the clock is shifted."""
TICKS = 1024.0
"""Of a second: times are whole multiples, so that shifting them rounds nothing."""
PERIOD, REPLANS = 0.125, 4
SAME = 1e-5
"""Of lengths and speeds: what the rounding of absolute times makes of places."""
_TIMES = ("time", "earliest_arrival", "latest_arrival")


def draw(rng: np.random.Generator) -> Data:
    """Draw a scenario that begins at time 0, and another clock."""
    scenarios = (scenes.draw(rng)["scenario"] for _ in itertools.count())
    drawn = next(one for one in scenarios if one["start"]["time"] == 0.0)
    return {"data": shifted(drawn, 0.0), "clock": float(rng.choice(CLOCKS))}


def shifted(data: Any, clock: float) -> Any:
    """Give a scenario of another clock, its times being whole ticks."""
    if isinstance(data, dict):
        return {key: _later(value, clock) if key in _TIMES else shifted(value, clock) for key, value in data.items()}
    return [shifted(each, clock) for each in data] if isinstance(data, list) else data


def _later(value: Any, clock: float) -> Any:
    if isinstance(value, list):
        return [_later(each, clock) for each in value]
    return value if value is None else math.floor(value * TICKS) / TICKS + clock


def check(data: Data) -> Outcome:
    """Drive on both clocks."""
    try:
        usual, other = (sp.Scenario(**shifted(data["data"], clock)) for clock in (0.0, data["clock"]))
    except sp.ScenarioError:
        return Outcome("bad input")
    planners = [sp.Planner(each, online=sp.OnlineSettings(period=PERIOD)) for each in (usual, other)]
    start = usual.start
    state: tuple[Any, float | None, float] = (start.position, start.heading, start.speed)
    size = math.dist(start.position, usual.goal.position)
    for time in PERIOD * np.arange(REPLANS):
        first, second = (
            each.replan(float(time + clock), *state) for each, clock in zip(planners, (0.0, data["clock"]), strict=True)
        )
        later = time + PERIOD * np.arange(5)
        apart = np.abs(first.position(later) - second.position(later + data["clock"])).max()
        faster = np.abs(first.speed(later) - second.speed(later + data["clock"])).max()
        told = f"t = {time:g} s: {first.outcome}, safe {first.safe}; on the other clock {second.outcome}, {second.safe}"
        if first.safe != second.safe or apart > SAME * size or faster > SAME * usual.vehicle.max_speed:
            return judged("driven", f"{told}, {apart:.3g} m and {faster:.3g} m/s apart")
        state = (first.position(later[1]), float(first.heading(later[1])), max(float(first.speed(later[1])), 0.0))
        if first.arrived:
            break
    return judged("driven", "")
