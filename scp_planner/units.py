"""Units of length and time, and where an origin and a clock stand: what quantities are converted by."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

Point = tuple[float, float]


@dataclass(frozen=True)
class Units:
    """Units, and where their origin and clock stand in those of the user."""

    length: float = 1.0  # m in a unit of length
    time: float = 1.0  # s in a unit of time
    origin: Point = (0.0, 0.0)  # World coordinates of the origin, m
    clock: float = 0.0  # Absolute time at which the clock begins, s

    @property
    def are_those_of_the_user(self) -> bool:
        """True if nothing changes on the way in or out."""
        return (self.length, self.time, self.origin, self.clock) == (1.0, 1.0, (0.0, 0.0), 0.0)

    @property
    def speed(self) -> float:
        """m/s in a unit of speed."""
        return self.length / self.time

    @property
    def acceleration(self) -> float:
        """m/s^2 in a unit of acceleration."""
        return self.length / (self.time * self.time)  # not by a power: that is not rounded alike in all units

    @property
    def jerk(self) -> float:
        """m/s^3 in a unit of jerk."""
        return self.acceleration / self.time

    def factor(self, unit: str) -> float:
        """Ratio of the natural unit to an SI unit; 1 without a dimension."""
        length, time = self.length, self.time
        return {
            "": 1.0,
            "rad": 1.0,
            "m": length,
            "s": time,
            "m/s": self.speed,
            "m/s2": self.acceleration,
            "m/s3": self.jerk,
            "1/m": 1.0 / length,
            "1/(m s)": 1.0 / (length * time),
            "m2/s3": self.speed * self.acceleration,
            "m2/s5": self.acceleration * self.jerk,
        }[unit]

    def instant(self, time: float) -> float:
        """Absolute time, s, on the clock of the trip."""
        return (time - self.clock) / self.time

    def absolute(self, instant: float) -> float:
        """Time on the clock of the trip as absolute time, s."""
        return instant * self.time + self.clock

    def place(self, point: Sequence[float]) -> Point:
        """World coordinates, m, from the start in units of length."""
        return (point[0] - self.origin[0]) / self.length, (point[1] - self.origin[1]) / self.length

    def lines(self, lines: Iterable[Sequence[Sequence[float]]]) -> tuple[tuple[Point, ...], ...]:
        """World coordinates, m, of polylines or polygons from the start in units of length."""
        (x0, y0), length = self.origin, self.length
        return tuple([tuple([((x - x0) / length, (y - y0) / length) for x, y in line]) for line in lines])

    def world(self, place: Sequence[float]) -> Point:
        """World coordinates, m, of a place from the start in units of length."""
        return place[0] * self.length + self.origin[0], place[1] * self.length + self.origin[1]

    def covariance(self, covariance: Any) -> Any:
        """Return covariances of positions, tuples of m^2, in these units; None as it is."""
        if covariance is None:
            return None
        unit = self.length * self.length
        if isinstance(covariance[0][0], tuple):  # one for each of many: no call for each
            return tuple([tuple([tuple([value / unit for value in row]) for row in one]) for one in covariance])
        return over(covariance, unit)


def over(value: Any, unit: float) -> Any:
    """Divide a number, or the numbers in tuples of tuples, by a unit; None as it is."""
    if value is None:
        return None
    if isinstance(value, tuple):
        return tuple(over(each, unit) for each in value)
    return value / unit
