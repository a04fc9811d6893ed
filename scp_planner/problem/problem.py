"""One planning problem, ready to be solved: what constraints are made from, and the constraints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

from scp_planner.arrays import Array
from scp_planner.certificate.verdict import Certificate
from scp_planner.constraints.constraint import Constraint
from scp_planner.constraints.setup import Setup
from scp_planner.problem.memory import check_memory
from scp_planner.problem.profile import SpeedProfile
from scp_planner.scenario.units import AS_GIVEN, NaturalUnits
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.trajectory import Trajectory

EACH_SHARE = 0.95  # of the total acceleration, that a first guess drives along the path, and across it


class TripConstraints(Protocol):
    """A user's own constraints on the trips of one problem, whatever they are written in."""

    def worst(self, trajectory: Trajectory) -> float:
        """Return the largest violation, in its constraint's own unit; 0 without constraints."""
        ...

    def judged(self, certificate: Certificate, trajectory: Trajectory) -> Certificate:
        """Return a certificate that holds only if the constraints are kept too."""
        ...


@dataclass(frozen=True)
class Problem(Setup):
    """A scenario made ready for planning."""

    constraints: tuple[Constraint, ...]  # all that the merit prices; clearance is the first
    given: TripConstraints | None = None  # a user's own
    profile: SpeedProfile | None = None  # the fastest drive along the guide, where places limit the speed
    units: NaturalUnits = AS_GIVEN  # in which it is written, for what is told of it

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        return tuple(constraint.size for constraint in self.constraints)

    def check_memory(self) -> None:
        """Raise `TooLargeError` if there are more zones than there is memory for."""
        space = self.space
        check_memory(len(space.path.widths), len(space.acceleration.widths), self.grid - 1, self.zones.size)

    def tightened(self, zone_inflation: Array, more: Mapping[str, float]) -> Problem:
        """Return the problem with larger zones, (L,) m, and with so much more kept from constraints, by name."""
        zones = self.zones.inflated(zone_inflation)
        constraints = tuple(one.tightened(more.get(one.name, 0.0)).among(zones) for one in self.constraints)
        limits = replace(self.limits, speed=self.limits.speed * (1.0 - more.get("speed", 0.0)))
        return replace(self, limits=limits, zones=zones, constraints=constraints)

    def among(self, zones: ZoneBatch) -> Problem:
        """Return the problem with other zones."""
        return replace(self, zones=zones, constraints=tuple(one.among(zones) for one in self.constraints))
