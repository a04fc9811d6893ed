"""Scenarios with one fault each, and what must be said of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

DELETE = object()


@dataclass(frozen=True)
class Case:
    """One change of a valid file, and what the message must then say."""

    name: str
    change: dict[str, Any]
    path: str
    value: str
    allowed: str


def observed(**changes: Any) -> dict[str, Any]:
    return {f"obstacles.1.observations.{key}": value for key, value in changes.items()}


CASES = [
    # numbers
    Case("negative radius", {"vehicle.radius": -0.3}, "vehicle.radius", "-0.3", "greater than 0"),
    Case("zero speed limit", {"vehicle.max_speed": 0}, "vehicle.max_speed", "0", "greater than 0"),
    Case("no disc at the reference", {"vehicle.discs": [1, 2]}, "vehicle.discs", "[1.0, 2.0]", "one entry that is 0"),
    Case("a disc twice", {"vehicle.discs": [0, 1, 1]}, "vehicle.discs[2]", "1.0", "must differ"),
    Case("no discs", {"vehicle.discs": []}, "vehicle.discs", "[]", "at least 1"),
    Case("no jerk at all", {"vehicle.max_jerk": 0}, "vehicle.max_jerk", "0", "greater than 0"),
    Case("negative rate", {"vehicle.max_curvature_rate": -1}, "vehicle.max_curvature_rate", "-1", "greater than 0"),
    Case("NaN", {"vehicle.max_acceleration": float("nan")}, "vehicle.max_acceleration", "nan", "finite"),
    Case("infinity", {"goal.position": [float("inf"), 0]}, "goal.position[0]", "inf", "finite"),
    Case("boolean for a number", {"start.heading": True}, "start.heading", "true", "number"),
    Case("text for a number", {"vehicle.max_deceleration": "2"}, "vehicle.max_deceleration", "'2'", "number"),
    Case("null for a number", {"start.speed": None}, "start.speed", "null", "number"),
    Case("mapping for a number", {"start.time": {"s": 0}}, "start.time", "{'s': 0}", "number"),
    Case(
        "too large to resolve",
        {"goal.position": [1e13, 0]},
        "goal.position[0]",
        "10000000000000.0",
        "at most",
    ),
    Case("negative speed", {"start.speed": -1.0}, "start.speed", "-1.0", "at least 0"),
    Case("negative margin", {"obstacles.0.margin": -0.1}, "obstacles[0].margin", "-0.1", "at least 0"),
    Case("probability of 1", {"confidence.probability": 1}, "confidence.probability", "1", "less than 1"),
    Case("probability of 0", {"confidence.probability": 0.0}, "confidence.probability", "0.0", "greater than 0"),
    Case("order 3", {"obstacles.1.model.order": 3}, "obstacles[1].model.order", "3", "at most 2"),
    Case("order 1.5", {"obstacles.1.model.order": 1.5}, "obstacles[1].model.order", "1.5", "whole number"),
    Case("order true", {"obstacles.1.model.order": True}, "obstacles[1].model.order", "true", "whole number"),
    # keys and structure
    Case("unknown key", {"vehicle.radus": 0.3}, "vehicle.radus", "0.3", "did you mean 'radius'?"),
    Case("unknown key at the top", {"obstacle": []}, "obstacle", "[]", "did you mean 'obstacles'?"),
    Case("unknown key like no other", {"goal.xyz": 1}, "goal.xyz", "1", "position, heading, speed, radius"),
    Case("missing key", {"vehicle.radius": DELETE}, "vehicle.radius", "missing", "required"),
    Case("missing part", {"goal": DELETE}, "goal", "missing", "required"),
    Case("number for a part", {"vehicle": 3}, "vehicle", "3", "mapping"),
    Case("list for a part", {"start": [0, 0]}, "start", "[0, 0]", "mapping"),
    Case("mapping for a list", {"obstacles": {"a": 1}}, "obstacles", "{'a': 1}", "list"),
    Case("position of three", {"goal.position": [1, 2, 3]}, "goal.position", "[1, 2, 3]", "at most 2"),
    Case("position of one", {"start.position": [1]}, "start.position", "[1]", "at least 2"),
    Case("empty position", {"start.position": []}, "start.position", "[]", "at least 2"),
    Case("unknown level", {"confidence.level": "total"}, "confidence.level", "'total'", "'joint'"),
    Case("schema of the future", {"schema": 2}, "schema", "2", "must be 1"),
    Case("number for a name", {"name": 7}, "name", "7", "text"),
    Case("empty id", {"obstacles.0.id": ""}, "obstacles[0].id", "''", "not be empty"),
    Case("a prior", {"obstacles.1.model.prior": 0.3}, "obstacles[1].model.prior", "0.3", "mapping"),
    # the trip
    Case(
        "start is goal",
        {"goal.position": [0, 0], "guide": None},
        "goal.position",
        "[0.0, 0.0]",
        "start's position",
    ),
    Case("start in the goal", {"goal.radius": 25}, "goal.radius", "25.0", "less than 20"),
    Case("start too fast", {"start.speed": 4}, "start.speed", "4.0", "at most vehicle.max_speed, 3 m/s"),
    Case("goal too fast", {"goal.speed": 3.5}, "goal.speed", "3.5", "at most vehicle.max_speed, 3 m/s"),
    Case(
        "arrives before it starts", {"goal.latest_arrival": -1}, "goal.latest_arrival", "-1.0", "later than start.time"
    ),
    Case("arrives at the start", {"goal.earliest_arrival": 0}, "goal.earliest_arrival", "0.0", "later than start.time"),
    Case(
        "arrives too soon and too late",
        {"goal.earliest_arrival": 9, "goal.latest_arrival": 8.5},
        "goal.latest_arrival",
        "8.5",
        "must not be before earliest_arrival, 9 s",
    ),
    Case("start brakes too hard", {"start.acceleration": -3}, "start.acceleration", "-3.0", "[-2, 1.5]"),
    Case("start out of bounds", {"bounds.min": [-0.2, -9]}, "start.position", "[0.0, 0.0]", "[0.1, 20.7]"),
    Case("goal out of bounds", {"bounds.max": [20.2, 9]}, "goal.position", "[20.0, 0.0]", "[-0.7, 19.9]"),
    Case("bounds inside out", {"bounds.max": [21, -10]}, "bounds.max[1]", "-10.0", "greater than min"),
    Case("guide starts elsewhere", {"guide": [[1, 0], [20, 0]]}, "guide[0]", "[1.0, 0.0]", "start.position"),
    Case("guide ends elsewhere", {"guide": [[0, 0], [9, 0]]}, "guide[1]", "[9.0, 0.0]", "goal.position"),
    Case("guide halts", {"guide": [[0, 0], [5, 0], [5, 0], [20, 0]]}, "guide[2]", "[5.0, 0.0]", "before it"),
    Case("guide of one point", {"guide": [[0, 0]]}, "guide", "[[0, 0]]", "at least 2"),
    Case(
        "corridor of a concave polygon",
        {"corridor": [[[-1, -1], [21, -1], [10, 0], [21, 1], [-1, 1]]]},
        "corridor[0]",
        "[10.0, 0.0]",
        "must be convex",
    ),
    Case(
        "corridor with a flat polygon",
        {"corridor": [[[-1, -1], [21, -1], [21, 1], [-1, 1]], [[0, 0], [1, 0], [2, 0]]]},
        "corridor[1]",
        "[2.0, 0.0]",
        "area",
    ),
    Case("empty corridor", {"corridor": []}, "corridor", "[]", "at least 1"),
    Case(
        "corridor with a gap",
        {"corridor": [[[-1, -1], [9, -1], [9, 1], [-1, 1]], [[10, -1], [21, -1], [21, 1], [10, 1]]]},
        "corridor",
        "[10.0, -1.0]",
        "overlap",
    ),
    Case(
        "corridor beside the start",
        {"corridor": [[[1, -1], [21, -1], [21, 1], [1, 1]]]},
        "start.position",
        "[0.0, 0.0]",
        "in the corridor",
    ),
    Case(
        "start at the wall",
        {"corridor": [[[-1, -0.2], [5, -0.2], [5, 1], [-1, 1]], [[4, -1], [21, -1], [21, 1], [4, 1]]]},
        "start.position",
        "[0.0, 0.0]",
        "at least 0.3 m from the border of the corridor; it is 0.2 m",
    ),
    Case(
        "an obstacle called corridor",
        {"corridor": [[[-1, -1], [21, -1], [21, 1], [-1, 1]]], "obstacles.0.id": "corridor"},
        "obstacles[0].id",
        "'corridor'",
        "must not be",
    ),
    Case(
        "stretch inside out",
        {"speed_limits": [{"from": 5, "to": 4, "speed": 1}]},
        "speed_limits[0].to",
        "4.0",
        "greater than from, 5",
    ),
    Case(
        "stretch beyond the guide",
        {"speed_limits": [{"from": 50, "speed": 1}]},
        "speed_limits[0].from",
        "50.0",
        "the length of its line",
    ),
    Case("stretch without a speed", {"speed_limits": [{"from": 5}]}, "speed_limits[0].speed", "missing", "required"),
    Case(
        "a stretch that forbids", {"speed_limits": [{"from": 5, "speed": 0}]}, "speed_limits[0].speed", "0", "greater"
    ),
    Case(
        "start too fast for its place",
        {"speed_limits": [{"from": 0, "speed": 0.5}]},
        "start.speed",
        "1.0",
        "at most 0.5",
    ),
    Case(
        "goal too fast for its place",
        {"goal.speed": 2, "speed_limits": [{"from": 15, "speed": 1.5}]},
        "goal.speed",
        "2.0",
        "the limit of speed_limits[0] there",
    ),
    Case(
        "line that halts",
        {"speed_limits": [{"from": 0, "to": 1, "speed": 1, "line": [[0, 5], [0, 5], [1, 5]]}]},
        "speed_limits[0].line[1]",
        "[0.0, 5.0]",
        "before it",
    ),
    # obstacles
    Case("duplicate ids", {"obstacles.1.id": "crosser"}, "obstacles[1].id", "'crosser'", "obstacles[0]"),
    Case(
        "start inside an obstacle",
        {"obstacles.0.motion": {"position": [0.7, 0]}},
        "start.position",
        "[0.0, 0.0]",
        "from obstacles[0] (crosser); it is 0.2 m",
    ),
    Case(
        "start inside an obstacle on a course",
        {"obstacles.0.motion": {"time": [-1, 1], "position": [[0.5, -2], [0.9, 2]]}},
        "start.position",
        "[0.0, 0.0]",
        "from obstacles[0] (crosser); it is 0.2 m",
    ),
    Case(
        "course with too few covariances",
        {"obstacles.0.motion": {"time": [0, 1], "position": [[9, 9], [9, 8]], "covariance": [[[1, 0], [0, 1]]]}},
        "obstacles[0].motion.covariance",
        "[[1.0, 0.0], [0.0, 1.0]]",
        "as many as time has entries, 2, not 1",
    ),
    Case(
        "course with an impossible covariance",
        {"obstacles.0.motion": {"time": [0, 1], "position": [[9, 9], [9, 8]], "covariance": [[1, 2], [2, 1]]}},
        "obstacles[0].motion.covariance",
        "[[1.0, 2.0], [2.0, 1.0]]",
        "positive definite",
    ),
    Case("neither", {"obstacles.0.motion": DELETE}, "obstacles[0].motion", "missing", "observations"),
    Case(
        "both",
        {"obstacles.1.motion": {"position": [9, 9]}},
        "obstacles[1].observations",
        "-0.5",
        "left out where motion is given",
    ),
    Case("misspelt shape", {"obstacles.0.shape": {"disk": 1}}, "obstacles[0].shape.disk", "1", "'disc'"),
    Case("no shape", {"obstacles.0.shape": {}}, "obstacles[0].shape", "{}", "exactly one of"),
    Case("shape unheard of", {"obstacles.0.shape": {"cube": 1}}, "obstacles[0].shape", "'cube'", "disc, rect"),
    Case(
        "two shapes",
        {"obstacles.0.shape": {"disc": 1, "rectangle": [1, 2]}},
        "obstacles[0].shape",
        "'rectangle': [1, 2]",
        "exactly one of",
    ),
    Case(
        "flat rectangle",
        {"obstacles.0.shape": {"rectangle": [1, 0]}},
        "obstacles[0].shape.rectangle[1]",
        "0",
        "greater than 0",
    ),
    Case(
        "negative semi-axis",
        {"obstacles.0.shape": {"ellipse": [-1, 2]}},
        "obstacles[0].shape.ellipse[0]",
        "-1",
        "greater than 0",
    ),
    Case(
        "polygon of two",
        {"obstacles.0.shape": {"polygon": [[0, 0], [1, 1]]}},
        "obstacles[0].shape.polygon",
        "[[0, 0], [1, 1]]",
        "at least 3",
    ),
    Case(
        "polygon without area",
        {"obstacles.0.shape": {"polygon": [[0, 0], [1, 1], [2, 2]]}},
        "obstacles[0].shape.polygon",
        "[2.0, 2.0]",
        "area",
    ),
    Case(
        "polygon that crosses itself",
        {"obstacles.0.shape": {"polygon": [[0, 0], [2, 2], [2, 0], [0, 1]]}},
        "obstacles[0].shape.polygon",
        "[0.0, 1.0]",
        "cross",
    ),
    Case(
        "polygon with a vertex twice",
        {"obstacles.0.shape": {"polygon": [[0, 0], [1, 0], [1, 0], [0, 1]]}},
        "obstacles[0].shape.polygon[2]",
        "[1.0, 0.0]",
        "differ",
    ),
    # observations
    Case(
        "times fall",
        observed(time=[-0.5, -0.4, -0.45, -0.2, -0.1]),
        "obstacles[1].observations.time[2]",
        "-0.45",
        "later than the time before it, -0.4 s",
    ),
    Case(
        "a time twice",
        observed(time=[-0.5, -0.4, -0.4, -0.2, -0.1]),
        "obstacles[1].observations.time[2]",
        "-0.4",
        "later than the time before it",
    ),
    Case(
        "NaN observed",
        {"obstacles.1.observations.position.3": [float("nan"), 1]},
        "obstacles[1].observations.position[3][0]",
        "nan",
        "finite",
    ),
    Case(
        "observed in the future",
        observed(time=[-0.5, -0.4, -0.3, -0.2, 0.1]),
        "obstacles[1].observations.time[4]",
        "0.1",
        "later than start.time",
    ),
    Case(
        "observed in the future by a small part of a step",
        observed(time=[-0.5, -0.4, -0.3, -0.2, 1e-6]),
        "obstacles[1].observations.time[4]",
        "1e-06",
        "later than start.time",
    ),
    Case(
        "too few with a known covariance",
        observed(time=[-0.2, -0.1], position=[[7, 3], [7, 2.9]]),
        "obstacles[1].observations.time",
        "[-0.2, -0.1]",
        "at least 3 observations, not 2",
    ),
    Case(
        "too few to estimate a covariance",
        {
            "obstacles.1.observations": {
                "time": [-0.4, -0.3, -0.2, -0.1],
                "position": [[7.0, 2.9], [7.0, 2.8], [6.9, 2.7], [6.9, 2.6]],
            }
        },
        "obstacles[1].observations.time",
        "[-0.4, -0.3, -0.2, -0.1]",
        "at least 5 observations, not 4",
    ),
    Case(
        "no observation",
        observed(time=[], position=[]),
        "obstacles[1].observations.time",
        "[]",
        "at least 3 observations, not 0",
    ),
    Case(
        "more times than positions",
        observed(position=[[7.0, 2.9], [7.0, 2.8], [6.9, 2.7]]),
        "obstacles[1].observations.position",
        "[6.9, 2.7]",
        "as many entries as time, 5, not 3",
    ),
    Case(
        "asymmetric covariance",
        observed(covariance=[[0.01, 0.001], [0.002, 0.01]]),
        "obstacles[1].observations.covariance",
        "[[0.01, 0.001], [0.002, 0.01]]",
        "symmetric",
    ),
    Case(
        "indefinite covariance",
        observed(covariance=[[0.01, 0.02], [0.02, 0.01]]),
        "obstacles[1].observations.covariance",
        "[[0.01, 0.02], [0.02, 0.01]]",
        "positive definite",
    ),
    Case(
        "singular covariance",
        observed(covariance=[[0.01, 0.01], [0.01, 0.01]]),
        "obstacles[1].observations.covariance",
        "[[0.01, 0.01], [0.01, 0.01]]",
        "positive definite",
    ),
    Case(
        "zero covariance",
        observed(covariance=[[0, 0], [0, 0]]),
        "obstacles[1].observations.covariance",
        "[[0.0, 0.0], [0.0, 0.0]]",
        "positive definite",
    ),
    Case(
        "one bad covariance among many",
        observed(covariance=[[[0.01, 0], [0, 0.01]]] * 4 + [[[0.01, 0], [0, -0.01]]]),
        "obstacles[1].observations.covariance[4]",
        "[[0.01, 0.0], [0.0, -0.01]]",
        "positive definite",
    ),
    Case(
        "four covariances for five times",
        observed(covariance=[[[0.01, 0], [0, 0.01]]] * 4),
        "obstacles[1].observations.covariance",
        "[[0.01, 0.0], [0.0, 0.01]]",
        "as many as time has entries, 5, not 4",
    ),
    Case(
        "covariance of one row",
        observed(covariance=[[0.01, 0]]),
        "obstacles[1].observations.covariance",
        "[[0.01, 0]]",
        "at least 2",
    ),
]


def changed(data: dict[str, Any], change: dict[str, Any]) -> dict[str, Any]:
    for path, value in change.items():
        *steps, last = path.split(".")
        place: Any = data
        for step in steps:
            place = place[int(step)] if isinstance(place, list) else place[step]
        if value is DELETE:
            del place[last]
        elif isinstance(place, list):
            place[int(last)] = value
        else:
            place[last] = value
    return data
