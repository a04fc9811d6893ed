"""Units and usual parameters of recorded tracks: robots on a table top, and ships, are fitted like people."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.tracking.tracks import Tracks

_STEP, _INTERVAL = 0.5, 0.4  # m and s between two positions of people, in whose units parameters are near 1


@dataclass(frozen=True)
class TrackUnits:
    """Units of recorded tracks."""

    noise: float = 0.1  # of the usual distance between positions
    bits: int = 8  # a unit is 1, or 2^8 as large or small, and so on: how often people were seen does not matter


UNITS = TrackUnits()


def unit_of(name: str, tracks: Tracks) -> float:
    """Return the unit of a parameter of motion models in which it is near 1."""
    length, time = _coarse(step_lengths(tracks), _STEP), _coarse(_intervals(tracks), _INTERVAL)
    units = {
        "time_constant": time,
        "noise_deviation": length,
        "velocity_deviation": length / time,
        "diffusion": length**2 / time**3,
    }
    return units[name]


def usual_parameters(tracks: Tracks) -> dict[str, float]:
    """Return parameters of motion models, of which those that fit tracks are near."""
    steps, lags = step_lengths(tracks), _intervals(tracks)
    speed = math.sqrt(float((steps**2).sum() / (2.0 * (lags**2).sum())))  # along one axis
    durations = [np.ptp(track.times) for track in tracks if len(track) > 1]
    lasting = math.sqrt(float(np.median(lags)) * float(np.median(durations)))
    return {
        "velocity_deviation": speed,
        "time_constant": lasting,
        "diffusion": 2.0 * speed**2 / lasting,
        "noise_deviation": UNITS.noise * float(steps.mean()),
    }


def step_lengths(tracks: Tracks) -> Array:
    """Return the distances from position to position, of all tracks one after the other, m."""
    return np.concatenate([np.zeros(0), *(np.hypot(*np.diff(track.positions, axis=0).T) for track in tracks)])


def _intervals(tracks: Tracks) -> Array:
    """The times from position to position, of all tracks one after the other, s."""
    return np.concatenate([np.zeros(0), *(np.diff(track.times) for track in tracks)])


def _coarse(values: Array, usual: float) -> float:
    """The power of 2^8 that is nearest to how large values are on average, in relation to usual ones."""
    mean = float(values.mean()) if len(values) else 0.0
    return 2.0 ** (UNITS.bits * round(math.log2(mean / usual) / UNITS.bits)) if mean > 0.0 else 1.0
