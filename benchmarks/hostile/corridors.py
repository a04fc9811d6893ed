"""Trips through corridors of any size with holes, pillars, slots and slivers, compared with the union of polygons.

A trip that is certified has all its discs inside of the union, by shapely, whatever the union leaves out.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from shapely.geometry import LineString, Polygon
from shapely.ops import unary_union

import scp_planner as sp
from benchmarks.hostile.features import Data
from benchmarks.hostile.outcome import Outcome, judged

SIZES = (1e-3, 1e6)
"""m, of the way."""
SMALLEST = 1e-7
"""Of the way; no hole and no slot is narrower."""
ROUNDED = 1e-9
"""Of the coordinates: polygons that are nearer to each other than this touch, and a disc may be so far outside."""
PLANNED = 0.05
"""How often a trip is planned, and not driven straight on."""


def draw(rng: np.random.Generator) -> Data:
    """Draw a corridor in units of its way, and how that is to be placed, scaled and driven."""
    width = float(np.exp(rng.uniform(np.log(2e-3), np.log(0.5))))
    pieces = _random(rng, width) if rng.random() < 0.4 else _holed(rng, width)
    return {
        "pieces": [np.asarray(piece).tolist() for piece in pieces],
        "size": float(np.exp(rng.uniform(*np.log(SIZES)))),
        "turn": float(rng.choice([0.0, rng.uniform(-math.pi, math.pi)])),
        "origin": (float(rng.choice([0.0, 1.0, 100.0])) * rng.normal(size=2)).tolist(),
        "radius": width * float(rng.uniform(0.05, 0.6)),
        "beside": width * float(rng.choice([0.0, rng.normal(0.0, 0.3)])),
        "discs": [0.0, float(rng.uniform(0.05, 0.6))] if rng.random() < 0.2 else [0.0],
        "planned": bool(rng.random() < PLANNED),
    }


def _box(left: float, right: float, low: float, high: float) -> Any:
    return [[left, low], [right, low], [right, high], [left, high]]


def _holed(rng: np.random.Generator, width: float) -> list[Any]:
    """A road with holes, or with slots from its sides: boxes round what is left out."""
    end = 1.0 + 2.0 * width + float(rng.choice([0.0, rng.uniform(0.0, 0.6)]))
    count = int(rng.integers(1, 4))
    places = np.sort(rng.uniform(0.1, 0.9, count))
    pieces, left = [], -2.0 * width
    for place in places.tolist():
        half = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(0.1))))
        half = min(half, 0.4 * (place - left))
        low, high = np.sort(rng.normal(0.0, 0.4, 2)) * width
        if rng.random() < 0.5:
            low, high = -min(half, 0.5 * width), min(half, 0.5 * width)  # a pillar
        reach = min(float(rng.uniform(1.5, 10.0)) * half + 1e-3, 0.9 * (place - left))
        pieces.append(_box(left, place - half, -width, width))
        if rng.random() < 0.9:
            pieces.append(_box(place - reach, place + reach, high, width))
        if rng.random() < 0.9:
            pieces.append(_box(place - reach, place + reach, -width, low))
        left = place + half
    return [*pieces, _box(left, end, -width, width)]


def _random(rng: np.random.Generator, width: float) -> list[Any]:
    """Polygons all over the way."""
    pieces = []
    for share in np.linspace(0.0, 1.0, int(rng.integers(2, 9))):
        angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, int(rng.integers(3, 9))))
        axes = np.array([rng.uniform(0.1, 0.6), width * np.exp(rng.uniform(-1.0, 1.0))])
        middle = np.array([share + rng.normal(0.0, 0.05), rng.normal(0.0, 0.3) * width])
        pieces.append(middle + axes * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    return pieces


def check(data: Data) -> Outcome:
    """Certify a trip, and compare what its discs cover with the union."""
    size, radius, turn = data["size"], data["size"] * data["radius"], data["turn"]
    turned = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])

    def placed(points: Any) -> np.ndarray:
        return size * (np.asarray(points) @ turned.T + data["origin"])

    ends = placed([[0.0, data["beside"]], [1.0, data["beside"]]])
    speed = size / 10.0
    vehicle = {"radius": radius, "max_speed": 2.0 * speed, "max_acceleration": speed, "max_deceleration": speed}
    vehicle["discs"] = [size * each for each in data["discs"]]
    begins = {"time": 0.0, "position": ends[0].tolist(), "heading": None, "speed": speed}
    pieces = [placed(piece) for piece in data["pieces"]]
    corridor = [each.tolist() for each in pieces]
    try:
        scenario = sp.Scenario(
            vehicle=vehicle,
            start=begins,
            goal={"position": ends[1].tolist()},
            corridor=corridor,
        )
    except sp.ScenarioError:
        return Outcome("bad input")
    if data["planned"]:
        plan = sp.plan(scenario, time_limit=2.0)
        times = np.linspace(plan.start_time, plan.arrival_time, 4001)
        path, holds = plan.position(times), plan.certified
        headings = np.asarray(plan.heading(times))
    else:
        times, path, headings = np.array([0.0, size / speed]), ends, np.full(2, turn)
        trip = sp.SampledTrajectory(times, path, headings, np.full(2, speed))
        holds = sp.certify(scenario, trip).holds
    if not holds:
        return Outcome("does not hold")
    rounded = ROUNDED * max(np.abs(each).max() for each in (*pieces, size))
    union = unary_union([Polygon(each).buffer(rounded, join_style="mitre") for each in pieces])
    outside = max(_outside(union, path, headings, offset, radius) for offset in vehicle["discs"])
    # Between two samples of a trip that turns lies an arc.
    allowed = 4.0 * rounded + (1e-6 * size if data["planned"] else 0.0)
    return judged("certified", f"{outside:.3g} m outside, radius {radius:.3g} m" if outside > allowed else "")


def _outside(union: Any, path: np.ndarray, headings: np.ndarray, offset: float, radius: float) -> float:
    """How far a disc that is so far ahead of a path is outside of a union, m; negative inside."""
    line = LineString(path + offset * np.stack([np.cos(headings), np.sin(headings)], axis=1))
    if not union.covers(line):
        return float(radius + line.difference(union).length)
    return float(radius - union.boundary.distance(line))
