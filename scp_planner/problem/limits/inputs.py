"""What optional limits are made from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from scp_planner.arrays import Array
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.problem.ends import EndConditions
from scp_planner.scenario.limits import Box
from scp_planner.scenario.models import Scenario, Vehicle
from scp_planner.scenario.places import Stretch
from scp_planner.settings.planning import SceneSettings
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.space import TimeTable, TripSpace

OPTIONAL_MARGIN = 2.5e-4  # relative, of optional limits, besides the margin of all limits


def kept_of_limits(settings: SceneSettings) -> float:
    """Return how much of an optional limit is planned with, relative to it."""
    return 1.0 - settings.limit_margin - OPTIONAL_MARGIN


@dataclass(frozen=True)
class LimitInputs:
    """A problem in the making.

    Attributes
    ----------
    scenario : Scenario
    settings : SceneSettings
    frame : PlanningFrame
    space : TripSpace
    ends : EndConditions
    zones : ZoneBatch
        Inflated by the vehicle's radius and the planner's margin.
    box : Box
    samples : TimeTable
        Equidistant times, then the breakpoints of the acceleration.
    slow : tuple of Stretch
        The speed limits by place in the planning frame, less the margins.
    """

    scenario: Scenario
    settings: SceneSettings
    frame: PlanningFrame
    space: TripSpace
    ends: EndConditions
    zones: ZoneBatch
    box: Box
    samples: TimeTable
    slow: tuple[Stretch, ...]

    @property
    def vehicle(self) -> Vehicle:
        """The scenario's vehicle."""
        return self.scenario.vehicle

    @property
    def free(self) -> slice:
        """The free control points of the offset."""
        return self.ends.free

    @property
    def free_size(self) -> int:
        """Their number."""
        return self.free.stop - self.free.start

    @property
    def step_size(self) -> int:
        """Number of variables of a step: free offsets, accelerations, and rho."""
        return self.free_size + self.space.acceleration_size + 1

    @cached_property
    def kept(self) -> float:
        """How much of a limit is planned with, relative to it."""
        return kept_of_limits(self.settings)

    @property
    def equidistant(self) -> Array:
        """Equidistant normalised times, (n,)."""
        return self.samples.sigma[: self.settings.samples + 1]
