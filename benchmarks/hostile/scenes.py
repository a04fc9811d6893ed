"""Scenes from the product of features: whatever a scenario, a map and a user's constraint can say, in odd combinations.

A scene is drawn in units of its own, in which lengths are some metres and times some seconds, and then scaled to any
size, place and clock. What comes of it is judged in the units that it was drawn in, for whose sizes the windows and
tolerances of the dense check are made.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.hostile.features import Data, Rng, Way, draw_map, enrich
from benchmarks.hostile.scaling import scaled

LENGTHS, TIMES = (0.5, 50.0), (0.3, 3.0)
"""m and s that a unit of a scene may become."""
ENRICHED = 0.8
"""Share of the scenes that have features besides those of their base."""
MAPPED, BOUND = 0.1, 0.03
"""Share of the scenes with a map, and with a user's constraint."""
FARTHEST, CLOCK = 300.0, 300.0
"""Units; largest distance from the origin, and from time 0, at which a trip begins."""
DIGITS = 9


def draw(rng: Rng) -> Data:
    """Draw a scene: a scenario, a map or None, the least time of a trip or None, and its units, m and s."""
    length, time = (float(np.exp(rng.uniform(*np.log(ends)))) for ends in (LENGTHS, TIMES))
    if rng.random() < 0.5:
        length = time = 1.0
    base = _Base(rng)
    scenario = base.draw()
    way = Way(base.begin, base.ahead, base.distance, base.clock)
    made: Data = {"map": None, "least_time": None, "length": length, "time": time}
    if rng.random() < ENRICHED:
        enrich(scenario, way, rng)
    if rng.random() < MAPPED:
        made["map"] = draw_map(way, rng)
        scenario["corridor"] = None
    if rng.random() < BOUND and not made["map"]:
        made["least_time"] = float(rng.uniform(1.0, 2.0)) * way.distance / scenario["vehicle"]["max_speed"]
    return {"scenario": _rounded(scenario), **made}


def whole(data: Data, **more: Any) -> Data:
    """Make a scene of a scenario as a dict, in its own units."""
    return {"scenario": data, "map": None, "least_time": None, "length": 1.0, "time": 1.0, **more}


def scenario_of(scene: Data) -> sp.Scenario:
    """Make the scenario of a scene, in m and s."""
    data = scaled(scene["scenario"], scene["length"], scene["time"])
    if scene["map"] is None:
        return sp.Scenario(**data)
    ground = sp.Ground(map=map_of(scaled(scene["map"], scene["length"], scene["time"])))
    return sp.Scenario(**{**data, "ground": ground})


def aim(goal: Data) -> list[float]:
    """Give the place that a trip leads to, roughly: a goal that is a region need not say."""
    if goal.get("position") is not None:
        return list(goal["position"])
    return [math.fsum(values) / len(values) for values in zip(*goal["region"], strict=True)]


def map_of(ground: Data) -> sp.OccupancyMap:
    """Make the map that is described."""
    cells = np.array(ground["cells"], dtype=bool)
    rest = {key: ground[key] for key in ("resolution", "yaw", "beyond")}
    return sp.OccupancyMap(cells, origin=tuple(ground["origin"]), **rest)


def constraints_of(scene: Data) -> Callable[[Any], list[Any]] | None:
    """Make the user's constraint of a scene."""
    if scene["least_time"] is None:
        return None
    least = scene["least_time"] * scene["time"]
    return lambda trip: [trip.travel_time >= least]


def _maybe(rng: Rng, probability: float, draw: Callable[[], Any]) -> Any:
    return draw() if rng.random() < probability else None


class _Base:
    def __init__(self, rng: Rng) -> None:
        self.rng = rng
        self.begin = rng.uniform(-FARTHEST, FARTHEST, 2) if rng.random() < 0.5 else np.zeros(2)
        self.angle = float(rng.uniform(-math.pi, math.pi)) if rng.random() < 0.7 else 0.0
        self.distance = float(np.exp(rng.uniform(np.log(1.0), np.log(60.0))))
        self.ahead = np.array([math.cos(self.angle), math.sin(self.angle)])
        self.left = np.array([-self.ahead[1], self.ahead[0]])
        self.clock = float(rng.uniform(-CLOCK, CLOCK)) if rng.random() < 0.4 else 0.0

    def draw(self) -> Data:
        rng = self.rng
        vehicle = self._vehicle()
        start = {
            "time": self.clock,
            "position": self.begin.tolist(),
            "heading": _maybe(rng, 0.8, lambda: self.angle + rng.normal(0.0, 0.5)),
            "speed": float(rng.choice([0.0, rng.uniform(0.0, 1.0), 1.0])) * vehicle["max_speed"],
        }
        goal = {
            "position": (self.begin + self.distance * self.ahead).tolist(),
            "heading": _maybe(rng, 0.3, lambda: self.angle + rng.normal(0.0, 0.8)),
            "speed": _maybe(rng, 0.4, lambda: rng.choice([0.0, rng.uniform(0.0, 1.0)]) * vehicle["max_speed"]),
            "radius": float(rng.choice([0.0, 0.0, rng.uniform(0.0, 0.3 * self.distance)])),
            "earliest_arrival": _maybe(rng, 0.1, lambda: self.clock + rng.uniform(0.1, 30.0)),
            "latest_arrival": _maybe(rng, 0.1, lambda: self.clock + rng.uniform(0.5, 90.0)),
        }
        data = {
            "name": str(rng.choice(["wild", "ünïcode ✓", " ", "a\nb", "0"])),
            "vehicle": vehicle,
            "start": start,
            "goal": goal,
            "guide": _maybe(rng, 0.15, self._guide),
            "bounds": _maybe(rng, 0.2, self._bounds),
            "corridor": _maybe(rng, 0.1, self._corridor),
            "speed_limits": self._speed_limits(vehicle["max_speed"]) if rng.random() < 0.15 else [],
            "confidence": {
                "probability": float(rng.choice([0.5, 0.95, 0.999, rng.uniform(0.01, 0.99)])),
                "level": str(rng.choice(["per_time", "per_obstacle", "joint"])),
            },
        }
        count = int(rng.choice([0, 1, 2, 3, 5, 8, 20], p=[0.2, 0.2, 0.2, 0.15, 0.15, 0.07, 0.03]))
        data["obstacles"] = [self._obstacle(k) for k in range(count)]
        return data

    def _vehicle(self) -> Data:
        rng = self.rng
        vehicle: Data = {
            "radius": float(np.exp(rng.uniform(np.log(0.05), np.log(0.8)))),
            "max_speed": float(np.exp(rng.uniform(np.log(0.4), np.log(6.0)))),
            "max_acceleration": float(np.exp(rng.uniform(np.log(0.3), np.log(5.0)))),
            "max_deceleration": float(np.exp(rng.uniform(np.log(0.3), np.log(6.0)))),
            "max_lateral_acceleration": _maybe(rng, 0.7, lambda: float(np.exp(rng.uniform(np.log(0.4), np.log(6.0))))),
            "max_curvature": _maybe(rng, 0.7, lambda: float(np.exp(rng.uniform(np.log(0.1), np.log(3.0))))),
            "max_jerk": _maybe(rng, 0.1, lambda: float(rng.uniform(1.0, 10.0))),
            "max_curvature_rate": _maybe(rng, 0.1, lambda: float(rng.uniform(0.5, 5.0))),
        }
        if rng.random() < 0.1:
            vehicle["discs"] = [0.0, *rng.uniform(-1.0, 1.5, int(rng.integers(1, 3))).tolist()]
        return vehicle

    def _place(self, station: float, offset: float) -> np.ndarray:
        """A place by its share of the way and its offset to the left."""
        return self.begin + station * self.distance * self.ahead + offset * self.left

    def _guide(self) -> Any:
        bend = self.rng.normal(0.0, 0.1 * self.distance, 2)
        inner = [self._place(share, float(each)).tolist() for share, each in zip((0.3, 0.7), bend, strict=True)]
        return [self.begin.tolist(), *inner, (self.begin + self.distance * self.ahead).tolist()]

    def _bounds(self) -> Data:
        ends = np.stack([self.begin, self.begin + self.distance * self.ahead])
        room = self.rng.uniform(0.9, 6.0, 4)
        return {"min": (ends.min(axis=0) - room[:2]).tolist(), "max": (ends.max(axis=0) + room[2:]).tolist()}

    def _corridor(self) -> Any:
        width, joint = self.rng.uniform(1.5, 5.0, 2), float(self.rng.uniform(0.3, 0.7))

        def piece(begin: float, end: float, half: float) -> Any:
            corners = ((begin, -half), (end, -half), (end, half), (begin, half))
            return [self._place(share, side).tolist() for share, side in corners]

        beyond = 2.0 / self.distance
        return [piece(-beyond, joint + 0.5 * beyond, width[0]), piece(joint - 0.5 * beyond, 1.0 + beyond, width[1])]

    def _speed_limits(self, fastest: float) -> Any:
        first, last = np.sort(self.rng.uniform(0.0, 1.0, 2)) * self.distance
        return [{"from": float(first), "to": float(last) + 0.1, "speed": float(self.rng.uniform(0.2, 1.0)) * fastest}]

    def _shape(self) -> Data:
        rng = self.rng
        size = float(np.exp(rng.uniform(np.log(0.1), np.log(2.0))))
        kind = rng.choice(["disc", "disc", "polygon", "rectangle"])
        if kind == "disc":
            return {"disc": size}
        if kind == "rectangle":
            return {"rectangle": [2.0 * size, float(rng.uniform(0.2, 2.0)) * size]}
        angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, int(rng.integers(3, 8))))
        radii = size * rng.uniform(0.3, 1.3, len(angles))
        return {"polygon": (radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)).tolist()}

    def _obstacle(self, number: int) -> Data:
        """Something that is near the way about when the vehicle may be there."""
        rng = self.rng
        meeting = self._place(float(rng.uniform(0.1, 1.1)), float(rng.normal(0.0, 1.5)))
        lead = float(rng.uniform(0.2, 1.0)) * self.distance / 2.0
        velocity = rng.normal(0.0, float(rng.choice([0.0, 0.5, 1.5])), 2)
        acceleration = rng.normal(0.0, 0.15, 2) * (rng.random() < 0.5)
        place = meeting - velocity * lead - acceleration * lead**2 / 2.0
        made: Data = {"id": f"{number}", "shape": self._shape(), "margin": float(rng.choice([0.0, 0.0, 0.2]))}
        kind = rng.choice(["motion", "course", "predicted", "observed"], p=[0.55, 0.15, 0.1, 0.2])
        if "rectangle" in made["shape"] and kind == "motion":
            acceleration = np.zeros(2)  # the dense check knows rectangles that do not turn, and those on courses
        if kind in ("predicted", "observed"):
            made["shape"] = {"disc": float(rng.uniform(0.1, 0.8))}
        if kind == "observed":
            made.update(self._observed(place, velocity, acceleration))
        elif kind == "motion":
            motion = {"position": place, "velocity": velocity, "acceleration": acceleration}
            made["motion"] = {key: value.tolist() for key, value in motion.items()}
        else:
            times = self.clock + np.cumsum(rng.uniform(0.3, 2.5, int(rng.integers(2, 8)))) - rng.uniform(0.0, 3.0)
            since = (times - self.clock)[:, None]
            velocity = velocity + 0.2 * self.ahead  # a course that stands has no direction to turn a rectangle to
            places = place + velocity * since + acceleration * since**2 / 2.0 + rng.normal(0.0, 0.1, (len(times), 2))
            made["motion"] = {"time": times.tolist(), "position": places.tolist()}
            if kind == "predicted":
                made["motion"]["covariance"] = [_covariance(rng) for _ in times]
        return made

    def _observed(self, place: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> Data:
        rng = self.rng
        order = int(rng.integers(0, 3))
        times = -np.sort(rng.uniform(0.0, 3.0, int(rng.integers(order + 3, 40))))[::-1]
        covariance = np.array(_covariance(rng))
        since = times[:, None]
        noise = rng.multivariate_normal(np.zeros(2), covariance, len(times))
        seen = place + velocity * since + acceleration * since**2 / 2.0 + noise
        times = self.clock + times
        return {
            "observations": {"time": times.tolist(), "position": seen.tolist(), "covariance": covariance.tolist()},
            "model": {
                "order": order,
                "prior": _maybe(rng, 0.3, lambda: {"acceleration_deviation": 0.3} if order == 2 else None),
            },
        }


def _covariance(rng: Rng) -> Any:
    spread = np.exp(rng.uniform(np.log(0.01), np.log(0.2), 2))
    tied = float(rng.uniform(-0.9, 0.9)) * spread[0] * spread[1]
    return [[float(spread[0]) ** 2, tied], [tied, float(spread[1]) ** 2]]


def _rounded(value: Any) -> Any:
    """Give a scenario of plain numbers with few digits."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    if isinstance(value, float | np.floating):
        return round(float(value), DIGITS)
    return value
