"""Times and lengths as people like to read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index


def clock_of(time: Array) -> float:
    """Origin for displaying times (n,) s: 0, or the first one on a clock that is far from 0."""
    # From 1e4 s on a start time is too long a number to be read off an axis.
    return float(time[0]) if abs(time[0]) > 1e4 else 0.0


def length_text(metres: float) -> str:
    """Write a length in a unit of its size."""
    for unit, size in (("\N{MICRO SIGN}m", 1e-6), ("mm", 1e-3)):
        if abs(metres) < 999.5 * size and abs(metres) < 0.1:
            return f"{metres / size:.3g} {unit}"
    return f"{metres:.2f} m"


@dataclass(frozen=True)
class Unit:
    """A unit of lengths, or of something per length or time: its name, and its size in the unit with m in it."""

    name: str
    size: float

    def label(self, quantity: str) -> str:
        """Label of an axis of a quantity."""
        return f"{quantity} ({self.name})"

    def text(self, metres: float) -> str:
        """Write a length, given in m, or a speed in m/s and so on, in this unit, as it stands at an axis."""
        return f"{metres / self.size:.10g}".replace("-", "\N{MINUS SIGN}")


METRES = Unit("m", 1.0)
UNITS = (Unit("km", 1e3), METRES, Unit("mm", 1e-3))
"""From the largest on."""


def unit_of(span: float) -> Unit:
    """Unit for axes that show a span, m."""
    # The largest unit of which at least two are shown.
    return next((unit for unit in UNITS if span >= 2.0 * unit.size), UNITS[-1])


def unit_of_rate(name: str, most: float) -> Unit:
    """Unit for an axis of speeds, accelerations or curvatures."""
    inverse = name.startswith("1/")
    length = 1.0 / most if inverse and most > 0.0 else most
    kilometres, _, millimetres = UNITS
    unit = METRES
    if length >= 2.0 * kilometres.size:
        unit = kilometres
    # 1.5 m/s is easier to read than 1500 mm/s.
    elif 0.0 < length < 0.05:
        unit = millimetres
    return Unit(name.replace("m", unit.name, 1), 1.0 / unit.size if inverse else unit.size)


def nice_times(start: float, end: float, most: int = 6) -> Array:
    """Instants to show: round ones after the start, the start and the end, (n,) s."""
    span = end - start
    power = 10.0 ** np.floor(np.log10(span / most))
    step = next(
        power * factor for factor in (1, 1.5, 2, 3, 4, 5, 10, 15, 20) if span / (power * factor) <= most - 1 + 1e-9
    )
    times = start + step * np.arange(int(span / step) + 1)
    if end - times[-1] < 0.4 * step and len(times) > 1:
        times = times[:-1]
    return np.append(times, end)


def nearest_indices(times: Array, wanted: Sequence[float] | Array) -> Index:
    """Index of the time nearest to each of the wanted ones."""
    return np.abs(np.asarray(wanted)[:, None] - times).argmin(axis=1)
