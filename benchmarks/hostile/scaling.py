"""Scenes in other units of length and time: the power of each in the quantity of each key of a scenario."""

from __future__ import annotations

from typing import Any

import numpy as np

Data = dict[str, Any]

LARGEST = 1e300
"""What is larger, or no number, stays as it is."""

_POWERS = {
    # of the length and of the time in the quantity of each key
    "radius": (1, 0),
    "max_speed": (1, -1),
    "speed": (1, -1),
    "max_acceleration": (1, -2),
    "max_deceleration": (1, -2),
    "max_lateral_acceleration": (1, -2),
    "max_curvature": (-1, 0),
    "max_jerk": (1, -3),
    "max_curvature_rate": (-1, -1),
    "discs": (1, 0),
    "time": (0, 1),
    "position": (1, 0),
    "velocity": (1, -1),
    "acceleration": (1, -2),
    "earliest_arrival": (0, 1),
    "latest_arrival": (0, 1),
    "guide": (1, 0),
    "min": (1, 0),
    "max": (1, 0),
    "corridor": (1, 0),
    "from": (1, 0),
    "to": (1, 0),
    "disc": (1, 0),
    "polygon": (1, 0),
    "rectangle": (1, 0),
    "margin": (1, 0),
    "covariance": (2, 0),
    "acceleration_deviation": (1, -2),
    "max_total_acceleration": (1, -2),
    "max_power": (2, -3),
    "centre": (1, 0),
    "region": (1, 0),
    "speed_range": (1, -1),
    "arrival_step": (0, 1),
    "walls": (1, 0),
    "line": (1, 0),
    "ellipse": (1, 0),
    "manoeuvre": (1, -2),
    "deviation": (1, -2),
    "time_constant": (0, 1),
    "velocity_deviation": (1, -1),
    "noise_deviation": (1, 0),
    "lead_time": (0, 1),
    "max_turn_rate": (0, -1),
    "offset": (1, 0),
    "resolution": (1, 0),
    "origin": (1, 0),
}
_OF_A_STATE = ((1, 0), (1, -1), (1, -2))


def scaled(data: Any, length: float, time: float) -> Any:
    """Give a scenario whose unit of length, m, and of time, s, are these."""
    if isinstance(data, dict):
        if "diffusion" in data:
            powers = (2, -5) if data["kind"] == "random_walk_acceleration" else (2, -3)
            rest = {key: value for key, value in data.items() if key != "diffusion"}
            return {**scaled(rest, length, time), "diffusion": data["diffusion"] * _unit(powers, length, time)}
        if data.get("estimate") is not None:
            rest = {key: value for key, value in data.items() if key != "estimate"}
            return {**scaled(rest, length, time), "estimate": _scaled_estimate(data["estimate"], length, time)}
        return {
            key: _times(value, _unit(_POWERS[key], length, time)) if key in _POWERS else scaled(value, length, time)
            for key, value in data.items()
        }
    if isinstance(data, list):
        return [scaled(item, length, time) for item in data]
    return data


def _unit(powers: tuple[int, int], length: float, time: float) -> float:
    return length ** powers[0] * time ** powers[1]


def _scaled_estimate(given: Data, length: float, time: float) -> Data:
    """What a tracker says: its covariance is of quantities of several units."""
    known = len(given["covariance"]) // 2
    units = np.repeat([_unit(powers, length, time) for powers in _OF_A_STATE[:known]], 2)
    rest = {key: value for key, value in given.items() if key != "covariance"}
    return {**scaled(rest, length, time), "covariance": (np.outer(units, units) * given["covariance"]).tolist()}


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, list):
        return [_times(item, factor) for item in value]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return value * factor if number and abs(value) < LARGEST else value
