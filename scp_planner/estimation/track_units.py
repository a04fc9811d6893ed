"""Units of recorded tracks: those of robots on a table top, and of ships, are fitted like those of people."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from scp_planner.arrays import Array
from scp_planner.estimation.tracks import Tracks

_STEP, _INTERVAL = 0.5, 0.4  # m and s between two positions of people, in whose units parameters are near 1
_BITS = 8  # a unit is 1, or 2^8 as large or small, and so on: how often people were seen does not matter


def unit_of(name: str, tracks: Tracks) -> float:
    """Return the unit of a parameter of motion models in which it is near 1.

    Parameters
    ----------
    name : str
        ``time_constant``, ``noise_deviation``, ``velocity_deviation`` or ``diffusion``.
    tracks : Tracks

    Returns
    -------
    float
        In SI, a power of two.
    """
    steps = [np.hypot(*np.diff(track.positions, axis=0).T) for track in tracks]
    length, time = _coarse(steps, _STEP), _coarse([np.diff(track.times) for track in tracks], _INTERVAL)
    units = {
        "time_constant": time,
        "noise_deviation": length,
        "velocity_deviation": length / time,
        "diffusion": length**2 / time**3,
    }
    return units[name]


def _coarse(values: Sequence[Array], usual: float) -> float:
    """The power of 2^8 that is nearest to how large values are on average, in relation to usual ones."""
    together = np.concatenate(values) if values else np.zeros(0)
    mean = float(together.mean()) if len(together) else 0.0
    return 2.0 ** (_BITS * round(math.log2(mean / usual) / _BITS)) if mean > 0.0 else 1.0
