"""Odd but common things that drivers of sensors and trackers send to an online planner: nothing may raise.

The covariances of a filter in single precision; places without noise and without a covariance, as simulators give
them; ids that come again after they were forgotten; stamps of the future, sometimes or always, which is told. Who is
seen well most of the time is in its zone about as often as the level of confidence says.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.hostile.features import Data
from benchmarks.hostile.outcome import Outcome, judged

ODDITIES = ("float32", "exact", "forgotten", "stamped", "leading")
MODELS = ("pedestrian", "car", {"order": 1}, {"order": 2})
STEPS, BEFORE = 32, 15
LEVEL, MISSED = 0.99, 0.3
"""Probability at a time, and the share of the times at which a person may be outside: errors last for a while..."""
MORE = 0.1
"""...and how much more of them with stamps of the future than without, of models that do not fit."""
FORGOTTEN = 1.0
"""s."""
AHEAD = (0.2, 5.0)
"""s that a stamp is too late."""


def draw(rng: np.random.Generator) -> Data:
    """Draw people, who sees them and how."""
    count = int(rng.integers(1, 5))
    return {
        "odd": str(rng.choice(ODDITIES)),
        "period": float(rng.choice([0.1, 0.25])),
        "model": MODELS[int(rng.integers(len(MODELS)))],
        "noise": float(rng.choice([0.03, 0.1])),
        "places": rng.uniform(-8.0, 8.0, (count, 2)).tolist(),
        "goals": rng.uniform(-8.0, 8.0, (count, 2)).tolist(),
        "pace": float(rng.uniform(0.3, 1.5)),
        "ahead": float(np.exp(rng.uniform(*np.log(AHEAD)))),
        "seed": int(rng.integers(10**6)),
    }


def check(data: Data) -> Outcome:
    """Drive among people who walk to their goals and slow down there; stamps of the future lose nobody from a zone."""
    odd = data["odd"]
    planner, share = _driven(data)
    allowed = MISSED if odd == "float32" else 1.0
    if odd == "stamped" and share > MISSED:
        allowed = max(MISSED, _driven({**data, "ahead": 0.0})[1] + MORE)
    if share > allowed:
        return judged(odd, f"{odd}: outside of the zone at {share:.0%} of the times")
    quiet = odd == "leading" and data["ahead"] > data["period"] and not planner.notes and not planner.doubts
    return judged(odd, f"nothing is said of stamps that are always {data['ahead']:.3g} s ahead" if quiet else "")


def _driven(data: Data) -> tuple[sp.Planner, float]:
    """The planner after a drive, and the share of the times at which people were outside of their zones."""
    rng, period, odd = np.random.default_rng(data["seed"]), data["period"], data["odd"]
    planner = sp.Planner(
        sp.Scenario(
            vehicle={"radius": 0.3, "max_speed": 1.0, "max_acceleration": 1.0, "max_deceleration": 1.0},
            start={"time": 0.0, "position": [0.0, -4.0], "heading": None, "speed": 0.0},
            goal={"position": [0.0, 30.0]},
            confidence={"probability": LEVEL, "level": "per_time"},
        ),
        online=sp.OnlineSettings(period=period, forget_after=FORGOTTEN if odd == "forgotten" else math.inf),
    )
    places, noise = np.array(data["places"]), 0.0 if odd == "exact" else data["noise"]
    names = [f"h{k}" for k in range(len(places))]
    known = None if odd == "exact" else noise**2 * np.eye(2)
    for name in names:
        planner.add_obstacle(name, {"disc": 0.3}, covariance=known, model=data["model"])
    state: tuple[Any, float | None, float] = ((0.0, -4.0), None, 0.0)
    missed = 0
    for step in range(-BEFORE, STEPS):
        left = np.array(data["goals"]) - places
        away = np.maximum(np.hypot(*left.T), 1e-9)[:, None]
        steps = period * left / away * np.minimum(data["pace"], away)
        places = places + steps
        time = step * period
        for name, place, moved in zip(names, places + noise * rng.normal(size=places.shape), steps, strict=True):
            if odd == "float32" and step >= 0:
                root = (0.2 * rng.normal(size=(4, 4)) + np.diag([1.0, 1.0, 4.0, 4.0])).astype(np.float32)
                spread = noise**2 * (root @ np.float32(np.diag([1.0, 3.0, 2.0, 1.0])) @ root.T)  # nearly symmetric
                planner.update_obstacle(name, time, place, moved / period, covariance=spread)
            elif odd == "forgotten" and step % 20 >= 5:
                continue
            elif odd == "forgotten" and step >= 0 and name == names[-1]:
                planner.update_motion(name, {"position": place})
            else:
                late = odd == "leading" or (odd == "stamped" and step in (10, 30))
                planner.observe(name, time + data["ahead"] * late, place)
        if step < 0:
            continue
        plan = planner.replan(time, *state)
        state = (plan.position(time + period), float(plan.heading(time + period)), float(plan.speed(time + period)))
        missed += sum(_outside(planner, name, time, place) for name, place in zip(names, places, strict=True))
    return planner, missed / (STEPS * len(names))


def _outside(planner: sp.Planner, name: str, time: float, place: np.ndarray) -> bool:
    """Whether the centre of a person is in no region that is left for it."""
    mine = [zone for zone in planner.zones if zone.id == name]
    return not any(zone.signed_distance(time, place) <= -0.3 + 1e-9 for zone in mine)
