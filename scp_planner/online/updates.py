"""What trackers and predictors say, on its way to the obstacles."""

from __future__ import annotations

from dataclasses import dataclass

from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.scenario.estimates import Estimate
from scp_planner.scenario.motions import GivenMotion


@dataclass(frozen=True)
class Update:
    """What a tracker says of an obstacle, in the units of the scene.

    Attributes
    ----------
    obstacle : str
        Its id.
    given : Estimate
    """

    obstacle: str
    given: Estimate

    @property
    def time(self) -> float:
        """What it is of, s."""
        return self.given.time

    def taken_in(self, obstacles: ObstacleTracks) -> str | None:
        """Let the obstacles take it in; say what is wrong with it, if it was not used."""
        return obstacles.update(self.obstacle, self.given) if self.obstacle in obstacles.tracks else None


@dataclass(frozen=True)
class Forecast:
    """What a predictor says of an obstacle, in the units of the scene.

    Attributes
    ----------
    obstacle : str
        Its id.
    motion : Motion, Course or Futures
    """

    obstacle: str
    motion: GivenMotion

    def taken_in(self, obstacles: ObstacleTracks) -> None:
        """Let the obstacles take it in."""
        if self.obstacle in obstacles.tracks:
            obstacles.foretell(self.obstacle, self.motion)
