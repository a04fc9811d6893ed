"""Trips in a plan's file."""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import isfinite
from typing import Any, TypeVar

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import MISSING, Fault, PlanError, TooLargeError
from scp_planner.files import LARGEST_COORDINATE
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.splines import clamped_knots
from scp_planner.trips.guide import Guide, guide_from_dict
from scp_planner.trips.legs import Leg, Legs, Stand
from scp_planner.trips.space import TripSpace
from scp_planner.trips.tolerances import SAME_TIME
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

T = TypeVar("T")


class KeyReader:
    """Reads keys of a plan file with errors that name the file, the key and the value."""

    def __init__(self, data: dict[str, Any], file: str, path: str = "") -> None:
        self.data = data
        self._file = file
        self._path = path

    def fault(self, key: str, value: object, allowed: str) -> PlanError:
        """Return the error that names the file, the key's path, the value and what is allowed."""
        return PlanError(self._file, [Fault(self._where(key), value, f"expected {allowed}")])

    def _where(self, key: str) -> str:
        return ".".join(part for part in (self._path, key) if part)

    def get(self, key: str) -> Any:
        """Return the value of a key, which must be there."""
        if key not in self.data:
            raise self.fault(key, MISSING, "a value")
        return self.data[key]

    def part(self, key: str) -> KeyReader:
        """Return the mapping of a key."""
        value = self.get(key)
        if not isinstance(value, dict):
            raise self.fault(key, value, "an object")
        return KeyReader(value, self._file, self._where(key))

    def parts(self, key: str) -> list[KeyReader]:
        """Return the mappings in the list of a key, of which there is at least one."""
        value = self.get(key)
        if not isinstance(value, list) or not value or not all(isinstance(each, dict) for each in value):
            raise self.fault(key, value, "a list of objects")
        return [KeyReader(each, self._file, self._where(f"{key}[{number}]")) for number, each in enumerate(value)]

    def number(self, key: str) -> float:
        """Return a finite number."""
        value = self.get(key)
        if not _is_number(value, sys.float_info.max):
            raise self.fault(key, value, "a finite number")
        return float(value)

    def coordinate(self, key: str) -> float:
        """Return a length, a time, a speed or the like: what scenarios may hold."""
        value = self.get(key)
        if not _is_number(value, LARGEST_COORDINATE):
            raise self.fault(key, value, f"a number from {-LARGEST_COORDINATE:g} to {LARGEST_COORDINATE:g}")
        return float(value)

    def integer(self, key: str, least: int, most: int | None) -> int:
        """Return a whole number within bounds."""
        value = self.get(key)
        if (
            isinstance(value, bool)
            or not isinstance(value, int)
            or value < least
            or (most is not None and value > most)
        ):
            raise self.fault(
                key,
                value,
                f"an integer from {least} to {most}" if most is not None else f"an integer >= {least}",
            )
        return value

    def text(self, key: str) -> str:
        """Return text."""
        value = self.get(key)
        if not isinstance(value, str):
            raise self.fault(key, value, "text")
        return value

    def optional(self, key: str, read: Callable[[str], T]) -> T | None:
        """Return what is read of a key, or None if it is null."""
        return None if self.get(key) is None else read(key)

    def flag(self, key: str) -> bool:
        """Return true or false."""
        value = self.get(key)
        if not isinstance(value, bool):
            raise self.fault(key, value, "true or false")
        return value

    def vector(self, key: str, size: int | None) -> Array:
        """Return a list of numbers, of a given size if there is one."""
        value = self.get(key)
        good = isinstance(value, list) and all(_is_number(each, LARGEST_COORDINATE) for each in value)
        if not good or (size is not None and len(value) != size):
            wanted = f"numbers from {-LARGEST_COORDINATE:g} to {LARGEST_COORDINATE:g}"
            raise self.fault(key, value, wanted if size is None else f"{size} {wanted}")
        return np.array(value, dtype=float)

    def vectors(self, key: str, count: int) -> Array:
        """Return a list of so many pairs of numbers, (count, 2)."""
        value = self.get(key)
        pairs = value if isinstance(value, list) else []
        good = len(pairs) == count and all(isinstance(pair, list) and len(pair) == 2 for pair in pairs)
        if not good or not all(_is_number(each, LARGEST_COORDINATE) for pair in pairs for each in pair):
            wanted = f"{count} pairs of numbers from {-LARGEST_COORDINATE:g} to {LARGEST_COORDINATE:g}"
            raise self.fault(key, value, wanted)
        return np.array(value, dtype=float).reshape(-1, 2)

    def breakpoints(self, key: str, degree: int) -> Array:
        """Return the breakpoints of clamped knots."""
        knots = self.vector(key, None)
        breaks = knots[degree : len(knots) - degree]
        if len(breaks) < 2 or np.any(np.diff(breaks) <= 0.0) or np.any(clamped_knots(degree, breaks) != knots):
            raise self.fault(key, knots.tolist(), f"the clamped knots of degree {degree}, increasing inside")
        return breaks


def trip_written(trip: Trip) -> dict[str, Any]:
    """Return the path and the acceleration of a trip for a plan file."""
    trajectory, frame = trip.trajectory, trip.frame
    space = trajectory.space
    path_degree, drive_degree = (spline.coefficients.shape[1] - 1 for spline in (space.path, space.acceleration))
    return {
        "path": {
            "degree": path_degree,
            "knots": (clamped_knots(path_degree, space.path.breakpoints) * space.length).tolist(),
            "offsets": trajectory.theta.tolist(),
            "guide": {"origin": list(frame.origin), "heading": frame.heading, **space.guide.to_dict()},
        },
        "acceleration": {
            "degree": drive_degree,
            "knots": clamped_knots(drive_degree, space.acceleration.breakpoints).tolist(),
            "coefficients": trajectory.beta.tolist(),
            "start_speed": space.start_speed,
        },
    }


def legs_written(legs: Legs) -> dict[str, Any]:
    """Return legs for a plan file."""
    each = [
        {
            "backward": leg.backward,
            "start_time": leg.begin,
            "travel_time": leg.trip.trajectory.travel_time,
            **({} if leg.trip.trajectory.arrives else {"stops": True}),
            **trip_written(leg.trip),
        }
        for leg in legs.legs
    ]
    return {"legs": each, "first_heading": legs.first.heading, "last_heading": legs.last.heading}


def legs_in(reader: KeyReader) -> Legs:
    """Return the legs of a plan file."""
    legs = []
    for part in reader.parts("legs"):
        legs.append(Leg(trip_in(part), part.flag("backward")))
        if len(legs) > 1 and legs[-1].begin < legs[-2].end - SAME_TIME * max(1.0, abs(legs[-2].end)):
            raise part.fault("start_time", legs[-1].begin, f"at least {legs[-2].end!r}, the end of the leg before it")
    begin, travel_time = reader.coordinate("start_time"), reader.coordinate("travel_time")
    if begin > legs[0].begin or begin + travel_time < legs[-1].end - SAME_TIME * max(1.0, abs(legs[-1].end)):
        raise reader.fault("travel_time", travel_time, "all of the legs")
    first, last = (reader.coordinate(f"{end}_heading") for end in ("first", "last"))
    return Legs(tuple(legs), Stand(begin, first), Stand(begin + travel_time, last))


def trip_in(reader: KeyReader) -> Trip:
    """Return the trip of a plan file."""
    return Trip(_frame_in(reader), _trajectory_in(reader))


def _frame_in(reader: KeyReader) -> PlanningFrame:
    """Return the frame of a plan file."""
    guide = reader.part("path").part("guide")
    x, y = guide.vector("origin", 2).tolist()
    return PlanningFrame((x, y), guide.coordinate("heading"), reader.coordinate("start_time"))


def _guide_in(path: KeyReader) -> Guide:
    """Return the guide of a plan file, given its part ``path``."""
    part = path.part("guide")
    try:
        guide = guide_from_dict(part.data)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise part.fault("", part.data, f"a guide ({error})") from None
    if guide.length > LARGEST_COORDINATE:
        raise part.fault("length", guide.length, f"at most {LARGEST_COORDINATE:g} m")
    return guide


def _space_in(reader: KeyReader) -> TripSpace:
    """Return the guide and the splines of a plan file."""
    path, drive = reader.part("path"), reader.part("acceleration")
    guide = _guide_in(path)
    path_degree, drive_degree = path.integer("degree", 3, 5), drive.integer("degree", 0, 2)
    path_breaks = path.breakpoints("knots", path_degree)
    drive_breaks = drive.breakpoints("knots", drive_degree)
    if abs(path_breaks[-1] - guide.length) > 1e-9 * guide.length or path_breaks[0] != 0.0:
        raise path.fault("knots", [path_breaks[0], path_breaks[-1]], f"from 0 to the guide's length {guide.length!r}")
    equal = np.linspace(0.0, guide.length, len(path_breaks))
    if np.abs(path_breaks - equal).max() > 1e-9 * guide.length:
        raise path.fault("knots", path_breaks.tolist(), "equidistant")
    if drive_breaks[0] != 0.0 or drive_breaks[-1] != 1.0:
        raise drive.fault("knots", [drive_breaks[0], drive_breaks[-1]], "from 0 to 1")
    speed = drive.coordinate("start_speed")
    if speed < 0.0:
        raise drive.fault("start_speed", speed, "at least 0")
    try:
        return TripSpace(
            guide, speed, path_degree, len(path_breaks) - 1, drive_degree, tuple(float(b) for b in drive_breaks)
        )
    except TooLargeError as error:
        raise path.fault("knots", path_breaks.tolist(), f"fewer; {error}") from None


def _trajectory_in(reader: KeyReader) -> Trajectory:
    """Return the trip of a plan file in its planning frame."""
    space = _space_in(reader)
    theta = reader.part("path").vector("offsets", space.path_size)
    beta = reader.part("acceleration").vector("coefficients", space.acceleration_size)
    travel_time = reader.coordinate("travel_time")
    if travel_time <= 0.0:
        raise reader.fault("travel_time", travel_time, "greater than 0")
    trajectory = Trajectory.of(space, theta, beta, travel_time).settled()
    if not isfinite(trajectory.path.arc_length):
        raise reader.part("path").fault("offsets", theta.tolist(), "a path of finite length")
    if "stops" in reader.data and reader.flag("stops"):
        return Trajectory(trajectory.path, beta, travel_time)
    if not isfinite(trajectory.travel_time) or abs(trajectory.travel_time - travel_time) > 1e-6 * travel_time:
        found = f"{trajectory.travel_time!r}, which is what path and acceleration give"
        raise reader.fault("travel_time", travel_time, found)
    return trajectory


def _is_number(value: object, largest: float) -> bool:
    """True if it is a number of at most a size; whole numbers may have more digits than a float can hold."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -largest <= value <= largest
