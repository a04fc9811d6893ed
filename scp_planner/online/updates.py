"""Updates from trackers and predictors, on their way to the obstacles."""

from __future__ import annotations

from dataclasses import dataclass, replace

from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.scenario.estimates import Estimate
from scp_planner.scenario.motions import GivenMotion
from scp_planner.scenario.units import changed


@dataclass(frozen=True)
class Update:
    obstacle: str  # Its id
    given: Estimate

    @property
    def time(self) -> float:
        return self.given.time

    def at(self, time: float) -> Update:
        """As if it were of another time, s."""
        return replace(self, given=changed(self.given, time=time))

    def taken_in(self, obstacles: ObstacleTracks) -> str | None:
        """Let the obstacles take it in; say what is wrong with it, if it was not used."""
        return obstacles.update(self.obstacle, self.given) if self.obstacle in obstacles.tracks else None


@dataclass(frozen=True)
class Forecast:
    obstacle: str  # Its id
    motion: GivenMotion

    def taken_in(self, obstacles: ObstacleTracks) -> None:
        """Let the obstacles take it in."""
        if self.obstacle in obstacles.tracks:
            obstacles.foretell(self.obstacle, self.motion)
