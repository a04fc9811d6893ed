"""A trip in world coordinates and absolute time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, unit_vectors
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.trips.trajectory import Trajectory, TripPoints
from scp_planner.units import Units

AT_ONCE = 20_000  # points that are looked at together: each takes some kilobytes


def discs_at(position: Array, heading: Array, offsets: Sequence[float]) -> list[Array]:
    """Centres of the discs of a vehicle, (n, 2) m each, at positions (n, 2) m and headings (n,) rad."""
    ahead = unit_vectors(heading)
    return [position + offset * ahead if offset else position for offset in offsets]


@dataclass(frozen=True, eq=False)
class Trip:
    """A trip in world coordinates and absolute time."""

    frame: PlanningFrame
    trajectory: Trajectory  # In the planning frame

    def __post_init__(self) -> None:
        """Refuse a trip that never arrives."""
        if not 0.0 <= self.trajectory.travel_time < inf:
            raise ValueError(f"trajectory: the trip never arrives; its travel time is {self.trajectory.travel_time} s")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Trip) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    def __repr__(self) -> str:
        begin, duration = self.frame.time, self.trajectory.travel_time
        return f"Trip({self.trajectory.path.arc_length:.4g} m, t = {begin:g} ... {begin + duration:g} s)"

    @property
    def _identity(self) -> tuple[Any, ...]:
        """All that it depends on."""
        trajectory, space = self.trajectory, self.trajectory.space
        guide = space.guide.to_dict().items()
        return (
            self.frame,
            trajectory.travel_time,
            trajectory.theta.tobytes(),
            trajectory.beta.tobytes(),
            tuple((key, tuple(value) if isinstance(value, list) else value) for key, value in guide),
            space.start_speed,
            space.path.coefficients.shape,
            space.acceleration.coefficients.shape,
            space.acceleration.breakpoints.tobytes(),
        )

    def inside(self, units: Units) -> Trip:
        """Return the trip in the units of its scene."""
        if units.are_those_of_the_user:
            return self
        frame = PlanningFrame(units.place(self.frame.origin), self.frame.heading, units.instant(self.frame.time))
        return Trip(frame, self.trajectory.in_units(1.0 / units.length, 1.0 / units.time))

    def outside(self, units: Units) -> Trip:
        """Return a trip in the units of its scene in SI units."""
        if units.are_those_of_the_user:
            return self
        frame = PlanningFrame(units.world(self.frame.origin), self.frame.heading, units.absolute(self.frame.time))
        return Trip(frame, self.trajectory.in_units(units.length, units.time))

    def positions_at(self, times: Array) -> Array:
        """Positions at absolute times, (n,) s, clamped to the trip, in its frame: (n, 2) m."""
        sigma = np.minimum(np.maximum((times - self.frame.time) / self.trajectory.travel_time, 0.0), 1.0)
        path, distance = self.trajectory.path, self.trajectory.distance_at(sigma)
        return path.places(path.exact.parameter_at(distance))

    def at(self, t: ArrayLike) -> tuple[TripPoints, tuple[int, ...]]:
        """Return the trip at absolute times, clamped to the trip, and the shape of ``t``."""
        times = np.asarray(t, dtype=float)
        tau = self.trajectory.travel_time
        sigma = np.clip((times.ravel() - self.frame.time) / tau, 0.0, 1.0)
        return self.trajectory.driven(self.trajectory.space.time_table(sigma)), times.shape

    def told(self, t: ArrayLike, value: Callable[[TripPoints], Array]) -> Array:
        """Return a value of points of the trip at absolute times, (...) s to (..., k): so many points at a time."""
        times = np.asarray(t, dtype=float)
        flat = times.ravel()
        parts = [value(self.at(flat[begin : begin + AT_ONCE])[0]) for begin in range(0, max(flat.size, 1), AT_ONCE)]
        found = np.concatenate(parts) if len(parts) > 1 else parts[0]
        return found.reshape((*times.shape, *found.shape[1:]))
