"""Predictors that a planner asks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from scp_planner.scenario.motions import GivenMotion


class Predictor(Protocol):
    """Predictor of obstacles, learnt or not, that a planner asks at each replan: ``planner.predictor = mine``."""

    def predict(self, now: float, horizon: float) -> Mapping[str, GivenMotion | Mapping[str, Any]]:
        """Predict obstacles.

        Parameters
        ----------
        now : float
            Time of the replan, s.
        horizon : float
            For how long, s: that of the last plan, or of a straight trip to the goal; predictions go straight on after
            their last time.

        Returns
        -------
        mapping of str to motion
            By ids of obstacles that the planner knows: a course, with a covariance or without, or weighted futures, as
            `Planner.update_motion` takes. Obstacles that are left out are estimated from what is observed.
        """
        ...
