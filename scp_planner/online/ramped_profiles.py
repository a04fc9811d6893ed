"""Profiles of dodges where the jerk is limited: to a level along ramps, on at that, and along ramps to a stop."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array
from scp_planner.online.braking import distinct_knots
from scp_planner.online.dodge_courses import COURSES, DodgeDrive, levels_and_cruises
from scp_planner.online.ramps import Ramps
from scp_planner.online.remaining import State
from scp_planner.online.tolerances import JERK_SHARE
from scp_planner.scenario.limits import Limits


@dataclass(frozen=True)
class RampedProfiles:
    """P drives that end in a stop."""

    change: Ramps  # To the levels, and from them to a stop
    braking: Ramps  # To the levels, and from them to a stop
    level: Array  # (P,) m/s
    cruise: Array  # (P,) For how long it is kept, s
    lasts: Array  # (P,) Until it has stood for as long as it has to, s

    @classmethod
    def of(cls, state: State, limits: Limits, jerk: float, width: float, wait: float) -> RampedProfiles:
        """Return the profiles of a vehicle."""
        level, cruise = levels_and_cruises(limits.speed, width)
        speed, acceleration = np.full(len(level), state.speed), np.full(len(level), state.acceleration or 0.0)
        share, jerk = COURSES.limit_share, JERK_SHARE * jerk
        rise, fall = limits.acceleration * share, limits.deceleration * share
        stops = Ramps.stopping(speed, acceleration, fall, jerk)
        moving = Ramps.between(speed, acceleration, level, rise, fall, jerk)
        change = stops.where(level == 0.0, moving)
        braking = Ramps.stopping(level, np.zeros(len(level)), fall, jerk)
        stands = change.duration + cruise + braking.duration
        return cls(change, braking, level, cruise, np.maximum(stands + wait, width / limits.speed))

    def last(self, count: int) -> RampedProfiles:
        """The last so many of them."""
        return RampedProfiles(
            self.change.last(count),
            self.braking.last(count),
            self.level[-count:],
            self.cruise[-count:],
            self.lasts[-count:],
        )

    @property
    def stands(self) -> Array:
        found: Array = self.change.duration + self.cruise + self.braking.duration
        return found

    @property
    def fastest(self) -> Array:
        """Highest speeds, (P,) m/s."""
        found: Array = np.maximum(self.change.fastest, self.level)
        return found

    @cached_property
    def way(self) -> Array:
        return self.change.way + self.level * self.cruise + self.braking.way

    def distance(self, times: Array) -> Array:
        """Distances driven at times (J,), (P, J) m."""
        begun = (self.change.duration + self.cruise)[:, None]
        changing = self.change.distance(np.minimum(times, begun))
        braking: Array = self.braking.distance(
            np.minimum(np.maximum(times - begun, 0.0), self.braking.duration[:, None])
        )
        return changing + braking

    def drive(self, number: int) -> DodgeDrive:
        change, braking, whole = self.change, self.braking, float(self.lasts[number])
        begun = change.duration[number] + self.cruise[number]
        times = np.concatenate([change.knots[number], begun + braking.knots[number], [whole]])
        accelerations = np.concatenate([change.acceleration[number], braking.acceleration[number], [0.0]])
        breaks, beta = distinct_knots(times / whole, accelerations)
        return DodgeDrive(float(change.start_speed[number]), 1, tuple(breaks.tolist()), beta, whole)
