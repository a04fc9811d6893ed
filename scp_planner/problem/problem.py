"""One planning problem, ready to be solved: splines, limits, zones and end conditions in the planning frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.verdict import Certificate
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.rounding import to_digits
from scp_planner.problem.ends import EndConditions
from scp_planner.problem.limits.limit import OptionalLimit
from scp_planner.problem.memory import check_memory
from scp_planner.problem.profile import SpeedProfile
from scp_planner.scenario.limits import Box, Limits
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import AS_GIVEN, NaturalUnits
from scp_planner.settings.planning import SceneSettings
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.space import TimeTable, TripSpace
from scp_planner.trips.trajectory import Trajectory

USUAL_ACCELERATION = 2.0  # units of acceleration: a stop from top speed on a ninth of the trip


class TripConstraints(Protocol):
    """A user's own constraints on the trips of one problem, whatever they are written in."""

    def worst(self, trajectory: Trajectory) -> float:
        """Return the largest violation, in its constraint's own unit; 0 without constraints."""
        ...

    def judged(self, certificate: Certificate, trajectory: Trajectory) -> Certificate:
        """Return a certificate that holds only if the constraints are kept too."""
        ...


EACH_SHARE = 0.95  # of the total acceleration, that a first guess drives along the path, and across it


@dataclass(frozen=True)
class Problem:
    """A scenario made ready for planning.

    Attributes
    ----------
    scenario : Scenario
    settings : SceneSettings
    frame : PlanningFrame
    space : TripSpace
    ends : EndConditions
    limits : Limits
        With the planner's margin.
    zones : ZoneBatch
        Inflated by the vehicle's radius and the planner's margin.
    box : Box
    samples : TimeTable
        Times at which constraints are looked at: equidistant ones, then the breakpoints of the acceleration.
    grid : int
        How many of them are equidistant.
    optional : tuple of OptionalLimit
        Limits that only some scenarios have.
    given : TripConstraints or None
        A user's own.
    profile : SpeedProfile or None
        The fastest drive along the guide, where places limit the speed.
    units : NaturalUnits
        In which it is written, for what is told of it.
    """

    scenario: Scenario
    settings: SceneSettings
    frame: PlanningFrame
    space: TripSpace
    ends: EndConditions
    limits: Limits
    zones: ZoneBatch
    box: Box
    samples: TimeTable
    grid: int
    optional: tuple[OptionalLimit, ...] = ()
    given: TripConstraints | None = None
    profile: SpeedProfile | None = None
    units: NaturalUnits = AS_GIVEN

    @cached_property
    def jumps(self) -> TimeTable:
        """Those of the samples that are breakpoints of the acceleration."""
        return self.samples.take(slice(self.grid, None))

    @cached_property
    def highest_accelerations(self) -> Array:
        """Upper bounds of the accelerations, (K2,) m/s^2; a given one at the start is its own."""
        return self._bounds(self.limits.acceleration)

    @cached_property
    def lowest_accelerations(self) -> Array:
        """Lower bounds of the accelerations, (K2,) m/s^2."""
        return self._bounds(-self.limits.deceleration)

    def _bounds(self, limit: float) -> Array:
        bounds = np.full(self.space.acceleration_size, limit)
        if self.ends.start_acceleration is not None:
            bounds[0] = self.ends.start_acceleration
        return bounds

    @cached_property
    def agility(self) -> float:
        """The largest limit of the acceleration, relative to a usual one: steps of accelerations are measured by it."""
        vehicle = self.scenario.vehicle
        return to_digits(max(vehicle.max_acceleration, vehicle.max_deceleration) / USUAL_ACCELERATION)

    @property
    def step_size(self) -> int:
        """Number of variables of a step: free offsets, accelerations, and rho."""
        return self.ends.free.stop - self.ends.free.start + self.space.acceleration_size + 1

    def check_memory(self) -> None:
        """Refuse to plan among more zones than there is memory for.

        Raises
        ------
        TooLargeError
            Saying what to change.
        """
        space = self.space
        check_memory(len(space.path.widths), len(space.acceleration.widths), self.grid - 1, self.zones.size)

    def tightened(
        self,
        zone_inflation: Array,
        lateral: float,
        curvature: float,
        box: float,
        optional: Mapping[str, float] | None = None,
    ) -> Problem:
        """Return the same problem with larger zones, lower limits and a smaller box.

        Parameters
        ----------
        zone_inflation : (L,) array
            m, added to each zone.
        lateral, curvature : float
            Relative reductions of the limits.
        box : float
            m, taken off each side of the workspace box.
        optional : mapping of str to float
            What is added to the excess over optional limits, by name.

        Returns
        -------
        Problem
        """
        more = optional or {}
        zones = self.zones.inflated(zone_inflation)
        limits = replace(
            self.limits,
            lateral_acceleration=self.limits.lateral_acceleration * (1.0 - lateral),
            curvature=self.limits.curvature * (1.0 - curvature),
        )
        return replace(
            self,
            limits=limits,
            zones=zones,
            box=replace(self.box, offsets=self.box.offsets - box),
            optional=tuple(limit.tightened(more.get(limit.name, 0.0)).among(zones) for limit in self.optional),
        )

    def among(self, zones: ZoneBatch) -> Problem:
        """Return the same problem with other zones."""
        return replace(self, zones=zones, optional=tuple(limit.among(zones) for limit in self.optional))
