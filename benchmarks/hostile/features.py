"""Features that a scene may have besides those of its base: gears, places, targets, maps, walls, forces, predictions.

Each is drawn with some probability, and takes the place of what was there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from scp_planner.mathematics import planar

Data = dict[str, Any]
Rng = np.random.Generator

OFTEN, SELDOM = 0.3, 0.12
CELLS = (8, 40)
"""Rows and columns of a map, at least and at most."""


@dataclass(frozen=True)
class Way:
    """The straight way that a scenario is about.

    Attributes
    ----------
    begin : (2,)
    ahead : (2,)
        Of length 1.
    distance : float
    clock : float
        When the trip begins.
    """

    begin: np.ndarray
    ahead: np.ndarray
    distance: float
    clock: float

    def place(self, share: float, offset: float) -> np.ndarray:
        """Give a place by its share of the way and its offset to the left."""
        left = np.array([-self.ahead[1], self.ahead[0]])
        return self.begin + share * self.distance * self.ahead + offset * left

    def draw(self, rng: Rng, share: tuple[float, float] = (0.1, 0.9), aside: float = 2.0) -> Any:
        """Draw a place beside the way."""
        return self.place(float(rng.uniform(*share)), float(rng.normal(0.0, aside))).tolist()

    @property
    def angle(self) -> float:
        """Heading of the way, rad."""
        return math.atan2(self.ahead[1], self.ahead[0])


def enrich(data: Data, way: Way, rng: Rng) -> None:
    """Put in what is drawn."""
    for feature, share in ((_gears, OFTEN), (_vehicle, 1.0), (_goal, 1.0), (_places, OFTEN), (_target, OFTEN)):
        if rng.random() < share:
            feature(data, way, rng)
    if rng.random() < OFTEN:
        data["walls"] = [_wall(way, rng) for _ in range(int(rng.integers(1, 4)))]
    if rng.random() < SELDOM:
        data["speed_limits"] = [*data["speed_limits"], _stretch(data["vehicle"], way, rng)]
    for obstacle in data["obstacles"]:
        _obstacle(obstacle, way, rng)
    met = [each["id"] for each in data["obstacles"] if "estimate" in each or "velocity" in each.get("motion", {})]
    if data["goal"].get("target") is not None and met and rng.random() < OFTEN:
        data["goal"].update(target=str(rng.choice(met)), radius=2.0, match_velocity=False)


def _vehicle(data: Data, _: Way, rng: Rng) -> None:
    vehicle, start = data["vehicle"], data["start"]
    along = max(vehicle["max_acceleration"], vehicle["max_deceleration"])
    if rng.random() < OFTEN:
        vehicle["max_total_acceleration"] = float(rng.uniform(0.6, 1.5)) * along
    if rng.random() < OFTEN:
        vehicle["max_power"] = float(rng.uniform(0.05, 1.0)) * vehicle["max_acceleration"] * vehicle["max_speed"]
    if "discs" in vehicle and rng.random() < 0.5:
        vehicle["centre"] = float(rng.uniform(-0.5, 1.0))
    if rng.random() < SELDOM:
        least = 0.0 if start["speed"] == 0.0 else -0.5 * vehicle["max_deceleration"]
        start["acceleration"] = float(rng.uniform(least, 0.5 * vehicle["max_acceleration"]))
        if rng.random() < 0.5:
            vehicle["max_jerk"] = float(rng.uniform(1.0, 10.0))


def _goal(data: Data, way: Way, rng: Rng) -> None:
    goal, vehicle = data["goal"], data["vehicle"]
    if rng.random() < OFTEN:
        corners = int(rng.integers(3, 8))
        angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, corners))
        radii = 0.2 * way.distance * rng.uniform(0.3, 1.0, corners)
        middle = way.place(1.0, 0.0)
        goal.update(
            region=(middle + radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)).tolist(),
            radius=0.0,
            heading=None,
        )
        beside = planar.distance_to_polygon(goal["position"], goal["region"]) > abs(vehicle.get("centre", 0.0))
        if rng.random() < 0.5 or beside:
            del goal["position"]
    if goal["heading"] is None and rng.random() < SELDOM:
        towards = way.angle + float(rng.normal(0.0, 0.3))
        half = float(rng.uniform(0.0, 0.5))
        goal["heading_range"] = [towards - half, towards + half]
    if goal["speed"] is None and rng.random() < SELDOM:
        goal["speed_range"] = np.sort(rng.uniform(0.0, vehicle["max_speed"], 2)).tolist()
    if rng.random() < SELDOM:
        goal["arrival_step"] = float(rng.choice([0.1, 0.25, 1.0]))


def _gears(data: Data, way: Way, rng: Rng) -> None:
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


def _places(data: Data, way: Way, rng: Rng) -> None:
    data["goals"] = []
    for number in range(int(rng.integers(1, 4))):
        place: Data = {"position": way.draw(rng, (0.2 * number + 0.1, 0.3 * number + 0.3))}
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


def _motion(way: Way, rng: Rng) -> Data:
    return {"position": way.draw(rng, (0.4, 1.2)), "velocity": rng.normal(0.0, 0.4, 2).tolist()}


def _target(data: Data, way: Way, rng: Rng) -> None:
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


def _wall(way: Way, rng: Rng) -> Any:
    """A convex polygon beside the way, or across a part of it."""
    size = float(np.exp(rng.uniform(np.log(0.2), np.log(3.0))))
    middle = way.place(float(rng.uniform(0.1, 0.9)), float(rng.choice([-1.0, 1.0])) * (size + rng.uniform(-0.3, 2.0)))
    angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, int(rng.integers(3, 7))))
    return (middle + size * np.stack([np.cos(angles), np.sin(angles)], axis=1)).tolist()


def _stretch(vehicle: Data, way: Way, rng: Rng) -> Data:
    first, last = np.sort(rng.uniform(0.0, 1.0, 2))
    line = [way.place(float(share), float(rng.normal(0.0, 0.5))).tolist() for share in (-0.1, 0.4, 1.2)]
    return {
        "from": float(first) * way.distance,
        "to": None if rng.random() < 0.3 else float(last) * way.distance + 0.1,
        "speed": float(rng.uniform(0.2, 1.0)) * vehicle["max_speed"],
        "line": line,
    }


def draw_map(way: Way, rng: Rng) -> Data:
    """Draw a map about the way, with few occupied cells."""
    rows, columns = (int(rng.integers(*CELLS)) for _ in range(2))
    edge = float(rng.uniform(1.2, 2.0)) * (way.distance + 4.0) / min(rows, columns)
    cells = rng.random((rows, columns)) < float(rng.choice([0.0, 0.01, 0.05]))
    yaw = float(rng.choice([0.0, rng.uniform(-3.0, 3.0)]))
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    middle = way.begin + 0.5 * way.distance * way.ahead
    origin = middle - turn @ (0.5 * edge * np.array([columns, rows]))
    return {
        "cells": cells.astype(int).tolist(),
        "resolution": edge,
        "origin": origin.tolist(),
        "yaw": yaw,
        "beyond": bool(rng.random() < 0.5),
    }


# obstacles


def _obstacle(made: Data, way: Way, rng: Rng) -> None:
    if rng.random() < OFTEN:
        _shape(made, rng)
    if "observations" in made:
        _observed(made, way, rng)
    elif "time" in made["motion"]:
        _on_course(made["motion"], rng)
    if "motion" in made and rng.random() < OFTEN:
        made["motion"] = _futures(made["motion"], rng)


def _shape(made: Data, rng: Rng) -> None:
    sizes = np.exp(rng.uniform(np.log(0.1), np.log(1.0), 2)).tolist()
    kind = str(rng.choice(["ellipse", "rectangle", "polygon"]))
    if kind == "polygon":
        made["shape"] = {"polygon": [[-sizes[0], -sizes[1]], [sizes[0], -0.3 * sizes[1]], [0.2, sizes[1]]]}
        return
    made["shape"] = {kind: sizes}
    if rng.random() < 0.5:
        made["shape"]["heading"] = float(rng.uniform(-math.pi, math.pi))


def _on_course(motion: Data, rng: Rng) -> None:
    if "covariance" not in motion and rng.random() < 0.5:
        motion["heading"] = (rng.uniform(-3.0, 3.0) + np.cumsum(rng.uniform(-1.0, 1.0, len(motion["time"])))).tolist()


def _futures(motion: Data, rng: Rng) -> Data:
    """Some motions that differ by where they are turned to and how probable they are."""
    count = int(rng.integers(1, 4))
    weights = rng.dirichlet(np.full(count, float(rng.choice([0.3, 2.0]))))
    weights[-1] = 1.0 - weights[:-1].sum()
    return {"futures": [{"weight": float(w), "motion": _shifted(motion, rng)} for w in np.clip(weights, 0.0, 1.0)]}


def _shifted(motion: Data, rng: Rng) -> Data:
    offset = rng.normal(0.0, 0.5, 2)
    places = np.array(motion["position"])
    return {**motion, "position": (places + offset).tolist()}


def _observed(made: Data, way: Way, rng: Rng) -> None:
    """Observed otherwise: with process noise, with noise of unknown size, or by a tracker that says a state."""
    how = str(rng.choice(["as it is", "process", "process", "unknown noise", "tracker", "manoeuvre"]))
    if how == "process":
        made["model"] = {"process": _process(rng)}
    elif how == "unknown noise":
        made["observations"]["covariance"] = None
        made["model"] = {"order": made["model"]["order"]}
        if len(made["observations"]["time"]) < made["model"]["order"] + 4:
            how = "tracker"
    elif how == "manoeuvre":
        made["model"]["manoeuvre"] = float(rng.uniform(0.0, 0.2))
    if how == "tracker":
        _tracked(made, way, rng)


def _process(rng: Rng) -> Data:
    kind = str(rng.choice(["random_walk", "mean_reverting", "singer", "random_walk_acceleration"]))
    little, constant = float(np.exp(rng.uniform(np.log(1e-4), np.log(0.05)))), float(rng.uniform(0.2, 5.0))
    process: Data = {"kind": kind}
    if kind == "random_walk":
        process["diffusion"] = little
    elif kind == "mean_reverting":
        process.update(diffusion=little, time_constant=constant)
    elif kind == "singer":
        process.update(deviation=2.0 * little, time_constant=constant)
    else:
        process.update(diffusion=0.1 * little, acceleration_deviation=0.2)
    tails = {"degrees_of_freedom": float(rng.uniform(3.0, 20.0)), "lead_time": [0.5, 2.0], "inflation": [1.0, 1.5]}
    return {
        "process": process,
        "velocity_deviation": float(rng.uniform(0.3, 2.0)),
        "noise_deviation": 0.05,
        "tails": tails if rng.random() < 0.3 else None,
    }


def _tracked(made: Data, way: Way, rng: Rng) -> None:
    """What a tracker may say in place of the observations: about the last of them."""
    seen = made.pop("observations")
    known = int(rng.integers(2, 4))
    scales = np.repeat([0.1, 0.1, 0.05][:known], 2)
    root = np.eye(2 * known) + 0.3 * rng.normal(size=(2 * known, 2 * known))
    covariance = np.outer(scales, scales) * (root @ root.T) * float(np.exp(rng.uniform(-3.0, 0.0)))
    made["estimate"] = {
        "time": float(min(seen["time"][-1], way.clock)),
        "position": seen["position"][-1],
        "velocity": rng.normal(0.0, 0.5, 2).tolist(),
        "covariance": np.round(covariance, 9).tolist(),
    }
    if known == 3:
        made["estimate"]["acceleration"] = rng.normal(0.0, 0.05, 2).tolist()
    order = int(rng.integers(1, known))
    made["model"] = {"process": _process(rng)} if rng.random() < 0.5 else {"order": order}
