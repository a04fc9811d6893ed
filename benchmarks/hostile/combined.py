"""Scenes from the product of features, each on or off by itself, in metres and seconds near one."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import shapely
import shapely.affinity

import scp_planner as sp
from benchmarks.hostile.wild import Data, Rng, wild

OFTEN, SELDOM, WILD = 0.3, 0.12, 0.3
CELLS = (8, 40)
"""Rows and columns of a map, at least and at most."""


def draw(rng: Rng) -> Data:
    """Draw a scene: a scenario, and a map, or how long a trip has to take, if there is one."""
    scenario = wild(rng).data if rng.random() < WILD else _plain(rng)
    begin, end = (np.asarray(scenario[key].get("position") or (0.0, 0.0), dtype=float) for key in ("start", "goal"))
    way = _Way(begin, end if "position" in scenario["goal"] else begin + 10.0, rng)
    made: Data = {"scenario": scenario, "map": None, "least_time": None}
    for feature in (_gears, _places, _target, _end, _ground, _limits, _body, _others):
        if rng.random() < OFTEN:
            feature(scenario, way, rng)
    if rng.random() < SELDOM:
        made["map"] = _map(way, rng)
        scenario["corridor"] = None
    if rng.random() < 0.03 and not made["map"]:
        made["least_time"] = float(rng.uniform(1.0, 2.0)) * way.length / scenario["vehicle"]["max_speed"]
    return made


def scenario_of(scene: Data) -> sp.Scenario:
    """Make the scenario of a scene."""
    ground = scene.get("map")
    if ground is None:
        return sp.Scenario(**scene["scenario"])
    return sp.Scenario(**scene["scenario"], ground=sp.Ground(map=map_of(ground)))


def map_of(ground: Data) -> sp.OccupancyMap:
    """Make the map that is described."""
    cells = np.array(ground["cells"], dtype=bool)
    rest = {key: ground[key] for key in ("resolution", "yaw", "beyond")}
    return sp.OccupancyMap(cells, origin=tuple(ground["origin"]), **rest)


def occupied_ground(ground: Data | None) -> Any:
    """Make a shapely geometry of the occupied cells of a map, and of what lies beyond it."""
    if ground is None:
        return None
    cells, edge = np.array(ground["cells"], dtype=bool), ground["resolution"]
    rows, columns = np.nonzero(cells)
    parts = [*shapely.box(columns * edge, rows * edge, (columns + 1) * edge, (rows + 1) * edge)]
    height, width = cells.shape
    if ground["beyond"]:
        frame, far = shapely.box(0.0, 0.0, width * edge, height * edge), 1e3 * (width + height) * edge
        parts.append(frame.buffer(far, join_style="mitre").difference(frame))
    turned = shapely.affinity.rotate(shapely.union_all(parts), ground["yaw"], origin=(0.0, 0.0), use_radians=True)
    return shapely.affinity.translate(turned, *ground["origin"])


class _Way:
    """The straight line that a scene is about."""

    def __init__(self, begin: np.ndarray, end: np.ndarray, rng: Rng) -> None:
        self.begin, self.rng = begin, rng
        self.length = max(math.dist(begin, end), 1e-6)
        self.ahead = (end - begin) / self.length
        self.left = np.array([-self.ahead[1], self.ahead[0]])
        self.angle = math.atan2(self.ahead[1], self.ahead[0])

    def place(self, share: tuple[float, float] = (0.1, 0.9), aside: float = 2.0) -> list[float]:
        """Draw a place beside the line."""
        along = self.rng.uniform(*share) * self.length
        return (self.begin + along * self.ahead + self.rng.normal(0.0, aside) * self.left).tolist()


def _plain(rng: Rng) -> Data:
    length, angle = float(rng.uniform(2.0, 25.0)), float(rng.choice([0.0, rng.uniform(-math.pi, math.pi)]))
    origin = rng.uniform(-50.0, 50.0, 2) * (rng.random() < 0.3)
    clock = float(rng.uniform(-100.0, 100.0)) * (rng.random() < 0.2)
    speed = float(rng.uniform(1.0, 4.0))
    return {
        "vehicle": {
            "radius": float(rng.uniform(0.2, 0.5)),
            "max_speed": speed,
            "max_acceleration": float(rng.uniform(0.8, 3.0)),
            "max_deceleration": float(rng.uniform(1.0, 4.0)),
            "max_curvature": float(rng.uniform(0.3, 1.5)),
        },
        "start": {
            "time": clock,
            "position": origin.tolist(),
            "heading": angle + float(rng.choice([0.0, 0.0, math.pi, rng.normal(0.0, 0.5)])),
            "speed": speed * float(rng.choice([0.0, 0.0, rng.uniform(0.0, 1.0)])),
        },
        "goal": {"position": (origin + length * np.array([math.cos(angle), math.sin(angle)])).tolist()},
        "obstacles": [],
    }


def _gears(data: Data, way: _Way, rng: Rng) -> None:
    vehicle = data["vehicle"]
    if rng.random() < 0.7:
        vehicle["reverse"] = {"max_speed": float(rng.uniform(0.3, 1.0)) * vehicle["max_speed"]}
        if rng.random() < 0.5:
            vehicle["reverse"]["max_acceleration"] = float(rng.uniform(0.3, 1.0)) * vehicle["max_acceleration"]
        if rng.random() < 0.6:
            data["start"]["speed"] = 0.0
    if rng.random() < 0.4:
        vehicle.update(steering="on_the_spot", max_turn_rate=float(rng.uniform(0.3, 2.0)))
        data["start"]["speed"] = 0.0
        if rng.random() < 0.5:
            data["goal"].update(heading=way.angle + float(rng.uniform(-3.0, 3.0)), speed=0.0)


def _places(data: Data, way: _Way, rng: Rng) -> None:
    data["goals"] = []
    for number in range(int(rng.integers(1, 4))):
        place: Data = {"position": way.place((0.2 * number + 0.1, 0.3 * number + 0.3))}
        if rng.random() < 0.6:
            place["radius"] = float(rng.uniform(0.05, 2.0))
        if rng.random() < SELDOM:
            place["heading_range"] = [
                way.angle - float(rng.uniform(0.2, 2.0)),
                way.angle + float(rng.uniform(0.2, 2.0)),
            ]
        if rng.random() < SELDOM:
            place["earliest_arrival"] = data["start"]["time"] + float(rng.uniform(0.0, 8.0))
        if rng.random() < SELDOM:
            place["latest_arrival"] = data["start"]["time"] + float(rng.uniform(2.0, 30.0))
        if rng.random() < SELDOM:
            place["target"] = {"motion": _motion(way, rng)}
        data["goals"].append(place)
    data["goals_order"] = str(rng.choice(["given", "given", "fastest"]))


def _motion(way: _Way, rng: Rng) -> Data:
    return {"position": way.place((0.4, 1.2)), "velocity": rng.normal(0.0, 0.4, 2).tolist()}


def _target(data: Data, way: _Way, rng: Rng) -> None:
    goal: Data = {"target": {"motion": _motion(way, rng)}, "radius": float(rng.choice([0.0, 0.3]))}
    if rng.random() < 0.3:
        motion = _motion(way, rng)
        times = data["start"]["time"] + np.array([0.0, 4.0, 9.0, 20.0])
        places = np.array(motion["position"]) + (times - times[0])[:, None] * motion["velocity"]
        goal["target"] = {
            "motion": {"time": times.tolist(), "position": (places + rng.normal(0.0, 0.3, (4, 2))).tolist()}
        }
    if rng.random() < 0.4:
        goal["match_velocity"] = True
    if rng.random() < 0.3:
        goal["offset"] = rng.normal(0.0, 0.5, 2).tolist()
    if rng.random() < SELDOM and not goal.get("match_velocity"):
        goal["approach"] = [-float(rng.uniform(0.2, 1.5)), float(rng.uniform(0.2, 1.5))]
    data["goal"], data["guide"] = goal, None


def _end(data: Data, way: _Way, rng: Rng) -> None:
    goal = data["goal"]
    if goal.get("target") is not None or goal.get("region") is not None:
        return
    if rng.random() < 0.5:
        goal["heading"] = way.angle + float(rng.normal(0.0, 1.0))
        goal.pop("heading_range", None)
    if rng.random() < 0.6:
        goal["speed"] = float(rng.choice([0.0, rng.uniform(0.0, 1.0)])) * data["vehicle"]["max_speed"]
        goal.pop("speed_range", None)
    if rng.random() < 0.3:
        goal["radius"] = float(rng.uniform(0.1, 1.0))


def _ground(data: Data, way: _Way, rng: Rng) -> None:
    if rng.random() < 0.6:
        data["walls"] = []
        for _ in range(int(rng.integers(1, 4))):
            middle, size = np.array(way.place()), rng.uniform(0.1, 1.5, 2)
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size
            data["walls"].append((middle + corners).tolist())
    if rng.random() < 0.4:
        first, last = np.sort(rng.uniform(0.0, way.length, 2)).tolist()
        line = [way.begin.tolist(), (way.begin + way.length * way.ahead).tolist()]
        top = float(rng.uniform(0.3, 0.95)) * data["vehicle"]["max_speed"]
        data["speed_limits"] = [{"from": first, "to": last + 0.1, "speed": top, "line": line}]
    if rng.random() < 0.3:
        half, beyond = float(rng.uniform(1.5, 6.0)), 1.5
        ends = (way.begin - beyond * way.ahead, way.begin + (way.length + beyond) * way.ahead)
        piece = [
            ends[0] - half * way.left,
            ends[1] - half * way.left,
            ends[1] + half * way.left,
            ends[0] + half * way.left,
        ]
        data["corridor"] = [np.array(piece).tolist()]


def _limits(data: Data, _: _Way, rng: Rng) -> None:
    vehicle = data["vehicle"]
    if rng.random() < 0.4:
        vehicle["max_jerk"] = float(rng.uniform(1.0, 10.0))
    if rng.random() < 0.4:
        vehicle["max_lateral_acceleration"] = float(rng.uniform(0.5, 4.0))
    if rng.random() < 0.3:
        vehicle["max_total_acceleration"] = float(rng.uniform(1.0, 4.0))
    if rng.random() < 0.3:
        vehicle["max_curvature_rate"] = float(rng.uniform(0.5, 5.0))


def _body(data: Data, _: _Way, rng: Rng) -> None:
    data["vehicle"]["discs"] = [0.0, float(rng.uniform(0.3, 1.0)), float(rng.uniform(-0.8, 0.0))]


def _others(data: Data, way: _Way, rng: Rng) -> None:
    for number in range(int(rng.integers(1, 5))):
        motion = _motion(way, rng)
        shape: Data = {"disc": float(rng.uniform(0.1, 0.8))}
        if rng.random() < 0.3:
            shape = {"rectangle": rng.uniform(0.2, 2.0, 2).tolist(), "heading": float(rng.uniform(-3.0, 3.0))}
        other: Data = {"id": f"more{number}", "shape": shape, "motion": motion}
        if rng.random() < 0.3:
            del other["motion"]
            covariance = (np.eye(4) * rng.uniform(1e-3, 0.05)).tolist()
            other["estimate"] = {"time": data["start"]["time"], **motion, "covariance": covariance}
            other["model"] = {"order": 1}
        data["obstacles"] = [*data["obstacles"], other]
    if rng.random() < 0.2 and data["obstacles"] and data["goal"].get("target") is not None:
        data["goal"].update(target=data["obstacles"][-1]["id"], radius=2.0, match_velocity=False)


def _map(way: _Way, rng: Rng) -> Data:
    rows, columns = (int(rng.integers(*CELLS)) for _ in range(2))
    edge = float(rng.uniform(1.2, 2.0)) * (way.length + 4.0) / min(rows, columns)
    cells = rng.random((rows, columns)) < float(rng.choice([0.0, 0.01, 0.05]))
    yaw = float(rng.choice([0.0, rng.uniform(-3.0, 3.0)]))
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    middle = way.begin + 0.5 * way.length * way.ahead
    origin = middle - turn @ (0.5 * edge * np.array([columns, rows]))
    return {
        "cells": cells.astype(int).tolist(),
        "resolution": edge,
        "origin": origin.tolist(),
        "yaw": yaw,
        "beyond": bool(rng.random() < 0.5),
    }


def constraints_of(scene: Data) -> Callable[[Any], list[Any]] | None:
    """Make the user's constraint of a scene."""
    least = scene.get("least_time")
    return None if least is None else lambda trip: [trip.travel_time >= least]
