"""Random scenarios, family by family, as plain dicts in the scenario format.

All draw from the generator they are given, so that a seed names a scenario. The reference families are drawn
to resemble the recorded ones in the number, size, speed and place of their obstacles; the others try what
those do not.

========================  ==============================================================================
family                    what it tries
========================  ==============================================================================
``crossing3/5/10/20``     accelerating discs that cross the straight line about when the vehicle is there
``headon``                three large discs coming the other way
``crowd60``               many slow discs, most of them irrelevant at any moment
``walls``                 standing walls (polygons), each with one gap, to weave through
``convoy``                a column crosses the line with no room between its members: wait, or go round
``noisy<n>``              crossing discs whose motions are only observed, with noise
``far<n>``                a crowd of 50, and n - 50 discs hundreds of metres away
========================  ==============================================================================
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np

Scenario = dict[str, Any]

VEHICLE = {
    "radius": 0.3,
    "max_speed": 3.0,
    "max_acceleration": 1.5,
    "max_deceleration": 2.0,
    "max_lateral_acceleration": 2.0,
    "max_curvature": 1.0,
}
START = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0}
CRUISE = 2.5  # m/s, the mean speed of a trip that is hardly hindered
NEAR_OBSTACLES = 50  # of a `far` scenario
DIGITS = 6

# All families that `random_scenario` knows without a number of its own.
FAMILIES = ("crossing3", "crossing5", "crossing10", "crossing20", "headon", "crowd60", "walls", "convoy", "noisy5")


def random_scenario(family: str, rng: np.random.Generator, name: str | None = None) -> Scenario:
    """One random scenario of a family.

    Parameters
    ----------
    family : str
        ``crossing<n>``, ``headon``, ``crowd<n>``, ``walls``, ``convoy``, ``noisy<n>`` or ``far<n>``.
    rng : numpy.random.Generator
        Source of all randomness.
    name : str, optional
        Name of the scenario; the family's name by default.

    Raises
    ------
    ValueError
        If there is no such family.
    """
    match = re.fullmatch(r"(crossing|crowd|noisy|far)(\d+)|(headon|walls|convoy)", family)
    if match is None:
        raise ValueError(f"no family {family!r}: known are {', '.join(FAMILIES)} and far<n>")
    counted: dict[str, Callable[[np.random.Generator, int], Scenario]] = {
        "crossing": crossing,
        "crowd": crowd,
        "noisy": noisy,
        "far": far,
    }
    plain: dict[str, Callable[[np.random.Generator], Scenario]] = {
        "headon": headon,
        "walls": walls,
        "convoy": convoy,
    }
    data = counted[match[1]](rng, int(match[2])) if match[1] else plain[match[3]](rng)
    data["name"] = name or family
    return data


def as_scenario(data: Scenario) -> Any:
    """The plain dict as an ``scp_planner.Scenario``."""
    import scp_planner

    return scp_planner.Scenario.model_validate(data)


def crossing(rng: np.random.Generator, count: int) -> Scenario:
    """``count`` accelerating discs, each at a point near the line about when the vehicle gets there."""
    obstacles: list[Scenario] = []
    while len(obstacles) < count:
        station = rng.uniform(3.0, 18.0)
        meeting = np.array([station, rng.normal(0.0, 0.5)])
        when = max(0.5, station / CRUISE + rng.normal(0.0, 0.5))
        velocity = np.array([rng.normal(0.0, 0.9), rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 2.5)])
        acceleration = rng.normal(0.0, 0.27, 2)
        place = meeting - velocity * when - acceleration * when**2 / 2.0
        radius = rng.uniform(0.3, 0.8)
        # The vehicle needs about 1.5 m to brake or turn away from whatever is near it at the start.
        if np.linalg.norm(place) > radius + 1.8:
            obstacles.append(_disc(len(obstacles), radius, place, velocity, acceleration))
    return _scenario([20.0, 0.0], obstacles)


def headon(rng: np.random.Generator) -> Scenario:
    """Three large discs in a row that come the other way, speeding up or braking."""
    obstacles = []
    for number, station in enumerate((16.0, 22.0, 28.0)):
        place = np.array([station, rng.uniform(-1.2, 1.2)])
        velocity = np.array([-rng.uniform(0.6, 2.0), 0.0])
        acceleration = np.array([rng.uniform(-0.25, 0.15), 0.0])
        obstacles.append(_disc(number, rng.uniform(0.6, 1.15), place, velocity, acceleration))
    return _scenario([20.0, 0.0], obstacles)


def crowd(rng: np.random.Generator, count: int) -> Scenario:
    """``count`` slow discs over 40 m, none near the start."""
    obstacles: list[Scenario] = []
    while len(obstacles) < count:
        place = np.array([rng.uniform(2.0, 38.0), rng.uniform(-12.0, 12.0)])
        velocity, acceleration = rng.normal(0.0, 0.7, 2), rng.normal(0.0, 0.05, 2)
        radius = rng.uniform(0.25, 0.5)
        if np.linalg.norm(place) > radius + 2.7 and np.linalg.norm(place - [40.0, 0.0]) > radius + 1.8:
            obstacles.append(_disc(len(obstacles), radius, place, velocity, acceleration))
    return _scenario([40.0, 0.0], obstacles)


def walls(rng: np.random.Generator) -> Scenario:
    """Three standing walls across the way, each with one gap of 1.6 to 2.4 m, some metres off the line."""
    obstacles: list[Scenario] = []
    for station in (5.0, 10.0, 15.0):
        centre, half_gap = rng.uniform(-2.0, 2.0), rng.uniform(0.8, 1.2)
        for side in (-1.0, 1.0):
            inner = centre + side * half_gap
            length = rng.uniform(4.0, 8.0)
            place = np.array([station, inner + side * length / 2.0])
            corners = [[-0.15, -length / 2], [0.15, -length / 2], [0.15, length / 2], [-0.15, length / 2]]
            shape = {"polygon": [[round(value, DIGITS) for value in corner] for corner in corners]}
            still = np.zeros(2)
            obstacles.append(_obstacle(len(obstacles), shape, place, still, still))
    return _scenario([20.0, 0.0], obstacles)


def convoy(rng: np.random.Generator) -> Scenario:
    """Eight discs in a column across the line, 0.2 to 0.4 m between them: no way through, only round."""
    speed = rng.uniform(0.8, 2.0)
    side = rng.choice([-1.0, 1.0])
    radius = rng.uniform(0.5, 0.8)
    spacing = 2.0 * radius + rng.uniform(0.2, 0.4)
    station = rng.uniform(6.0, 14.0)
    velocity = np.array([rng.normal(0.0, 0.2), -side * speed])
    acceleration = np.array([0.0, rng.normal(0.0, 0.05)])
    # The head reaches the line at a random share of the vehicle's time to get there.
    head = speed * (station / CRUISE) * rng.uniform(0.2, 1.0)
    obstacles = [
        _disc(number, radius, np.array([station, side * (head + number * spacing)]), velocity, acceleration)
        for number in range(8)
    ]
    return _scenario([20.0, 0.0], obstacles)


def noisy(rng: np.random.Generator, count: int) -> Scenario:
    """Crossing discs that were seen ten times a second for 6 s, each position with noise of 1 to 4 cm.

    Half of them move at constant velocity, and are known to; the others accelerate.
    """
    data = crossing(rng, count)
    times = np.linspace(-5.9, 0.0, 60)
    for number, obstacle in enumerate(data["obstacles"]):
        order = 1 + number % 2
        motion = {key: np.array(value) for key, value in obstacle.pop("motion").items()}
        clock = times[:, None]
        truth = motion["position"] + motion["velocity"] * clock
        if order == 2:
            truth = truth + motion["acceleration"] * clock**2 / 2.0
        deviations = rng.uniform(0.01, 0.04, 2)
        correlation = rng.uniform(-0.5, 0.5) * deviations.prod()
        covariance = np.array([[deviations[0] ** 2, correlation], [correlation, deviations[1] ** 2]])
        seen = truth + rng.multivariate_normal(np.zeros(2), covariance, times.size)
        obstacle["observations"] = {
            "time": [round(float(t), DIGITS) for t in times],
            "position": [[round(float(x), DIGITS) for x in place] for place in seen],
            "covariance": [[round(float(x), 2 * DIGITS) for x in row] for row in covariance],
        }
        obstacle["model"] = {"order": order}
    return data


def far(rng: np.random.Generator, count: int, near: int = NEAR_OBSTACLES) -> Scenario:
    """A crowd of ``near`` discs, and ``count - near`` more that stay hundreds of metres away.

    With the same generator state the near ones are the same for every ``count``, as are the first far ones.
    """
    data = crowd(rng, min(near, count))
    for number in range(near, count):
        angle, distance = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(300.0, 900.0)
        place = np.array([20.0 + distance * np.cos(angle), distance * np.sin(angle)])
        velocity, acceleration = rng.normal(0.0, 1.0, 2), rng.normal(0.0, 0.05, 2)
        radius = rng.uniform(0.25, 0.8)
        data["obstacles"].append(_disc(number, radius, place, velocity, acceleration))
    return data


def _disc(number: int, radius: float, place: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> Scenario:
    return _obstacle(number, {"disc": round(float(radius), DIGITS)}, place, velocity, acceleration)


def _obstacle(
    number: int, shape: Scenario, place: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> Scenario:
    motion = {"position": place, "velocity": velocity, "acceleration": acceleration}
    return {
        "id": f"o{number}",
        "shape": shape,
        "motion": {key: [round(float(x), DIGITS) for x in value] for key, value in motion.items()},
    }


def _scenario(goal: list[float], obstacles: list[Scenario]) -> Scenario:
    return {
        "schema": 1,
        "name": "",
        "vehicle": dict(VEHICLE),
        "start": dict(START),
        "goal": {"position": goal, "heading": None, "speed": None},
        "obstacles": obstacles,
    }
