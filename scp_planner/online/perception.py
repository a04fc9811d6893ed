"""Perception of a planner: obstacles come, are observed and predicted, and go."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.online.arguments import (
    OutOfRangeError,
    _point,
    check_number,
    checked_covariance,
    checked_estimate,
    checked_motion,
)
from scp_planner.online.inbox import Forecast, Inbox, Measurement, Update
from scp_planner.prediction.obstacle_tracks import ObstacleTracks
from scp_planner.scenario.models import Model, Obstacle
from scp_planner.scenario.motions import GivenMotion
from scp_planner.scenario.shapes import Shape
from scp_planner.scenario.units import NaturalUnits


class Perception:
    """Obstacles of a planner: they come, are observed and predicted, and go.

    Attributes
    ----------
    listeners : list
        Recorders that are told of obstacles, observations and replans.
    """

    def __init__(self, inbox: Inbox, units: NaturalUnits) -> None:
        self._inbox, self._obstacles, self._units = inbox, inbox.obstacles, units
        self.listeners: list[Any] = []

    @property
    def obstacles(self) -> ObstacleTracks:
        """The obstacles that it knows of, in the units of its scene."""
        self._inbox.settle()
        return self._obstacles

    @property
    def notes(self) -> deque[str]:
        """Oddities of observations, the newest last."""
        self._inbox.settle()
        return self._inbox.notes

    def observe(self, obstacle: str, time: float, position: ArrayLike, covariance: ArrayLike | None = None) -> None:
        """Take in an observation of an obstacle; during a replan, of another thread, between two of its stages.

        Parameters
        ----------
        obstacle : str
            Id of an obstacle that was added; one that has gone comes back as it was added, with a note.
        time : float
            When it was seen, absolute, s; late ones are welcome. One later than the replan by more than a period is
            held back until the clock of the replans gets there, or dropped if one in time comes after it, with a note.
        position : (2,)
            m; beyond what scenarios may hold it is left out with a note.
        covariance : (2, 2), optional
            m2; else that of the scenario. Rounding in single precision is repaired, and a variance of 0 is taken for a
            very small one.

        Raises
        ------
        ValueError
            If no obstacle of that id was ever added, a number is not finite, or the covariance is none.
        """
        self._check_known("observe", obstacle)
        units = self._units
        try:
            place = _point("position", position)
            check_number("time", time)
            noise = self._noise(covariance)
        except OutOfRangeError as odd:
            self._inbox.notes.append(f"{obstacle}: {odd}; left out")
            return
        self._inbox.put(Measurement(obstacle, units.instant(float(time)), units.place(place), noise))
        for each in self.listeners:
            each.observed(obstacle, time, place, covariance)

    def update_obstacle(
        self,
        obstacle: str,
        time: float,
        position: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike | None = None,
        *,
        covariance: ArrayLike,
    ) -> None:
        """Take what a tracker says of an obstacle in place of all that was known of it, at any time as :meth:`observe`.

        Parameters
        ----------
        obstacle : str
            Id of an obstacle that was added; its model says how it goes on from there.
        time : float
            What the state is of, absolute, s; what comes after a newer one is left out, and one that is too far ahead
            is held back as in :meth:`observe`.
        position, velocity, acceleration : (2,)
            m, m/s, m/s2; without an acceleration the velocity is kept up.
        covariance : (4, 4) or, with an acceleration, (6, 6)
            Of the error of the state in the order x, y, vx, vy, ax, ay, in m and s; repaired as in :meth:`observe`.

        Raises
        ------
        ValueError
            If no obstacle of that id was ever added, a number is not finite, or the covariance is none.
        """
        self._check_known("update_obstacle", obstacle)
        try:
            given = checked_estimate(time, position, velocity, acceleration, covariance, self._units)
        except OutOfRangeError as odd:
            self._inbox.notes.append(f"{obstacle}: {odd}; left out")
            return
        inside = self._units.estimate(given)
        self._inbox.put(Update(obstacle, inside.time, inside))
        for each in self.listeners:
            each.observed(obstacle, time, given.position, covariance)

    def update_motion(self, obstacle: str, motion: GivenMotion | Mapping[str, Any]) -> None:
        """Take in a new prediction for a known obstacle: it replaces all that was known of its motion.

        During a replan, of another thread, it is taken in between two of its stages. It holds until there is another
        one, or until the obstacle is observed: then its motion is estimated from what is observed.

        Parameters
        ----------
        obstacle : str
            Its id.
        motion : Motion, Course, Futures or mapping
            As in the scenario: exact, with a covariance, or several futures with their weights. Without a time a
            `Motion` holds at the scenario's ``start.time``; while driving, state the time.

        Raises
        ------
        ValueError
            If no obstacle of that id was ever added, or a value is not allowed.
        """
        self._check_known("update_motion", obstacle)
        made = self._inbox.timed(obstacle, checked_motion(obstacle, motion))
        self._inbox.put(Forecast(obstacle, self._units.motion(made)))

    def _noise(self, covariance: ArrayLike | None) -> Array | None:
        """A covariance (2, 2) in m2, checked, in the units of the scene."""
        if covariance is None:
            return None
        return checked_covariance(covariance, self._units) / (self._units.length * self._units.length)

    def _check_known(self, call: str, obstacle: str) -> None:
        if not self._inbox.knows(obstacle):
            raise ValueError(f"{call}: there is no obstacle {obstacle!r}; add_obstacle adds one")

    def add_obstacle(
        self,
        obstacle: Obstacle | Mapping[str, Any] | str,
        shape: Shape | Mapping[str, Any] | None = None,
        *,
        covariance: ArrayLike | None = None,
        model: Model | Mapping[str, Any] | str | None = None,
        margin: float = 0.0,
    ) -> None:
        """Take in a new obstacle: one as in a scenario, or the id and shape of one that will be observed.

        Parameters
        ----------
        obstacle : Obstacle, mapping or str
            A whole obstacle, or the id of one that has not been observed yet. A motion without a time holds at the
            scenario's ``start.time``.
        shape : shape, optional
            With an id: as in the scenario, such as ``{"disc": 0.3}``.
        covariance : (2, 2), optional
            With an id: of one observation, m2; else it comes with each, or is estimated.
        model : Model, mapping or str, optional
            With an id: of its motion, or the name of a ready-made one.
        margin : float
            With an id: extra clearance, m.

        Raises
        ------
        ValueError
            If the id is taken or a value is not allowed.
        """
        if not isinstance(obstacle, str):
            whole = obstacle if isinstance(obstacle, Obstacle) else Obstacle(**obstacle)
            self._check_new(whole.id)
            if whole.motion is not None:
                whole = whole.model_copy(update={"motion": self._inbox.timed(whole.id, whole.motion)})
            self._obstacles.add(self._units.obstacle(whole))
            for each in self.listeners:
                each.added(whole.id, whole.shape)
            return
        still = {"position": [0.0, 0.0], "time": 0.0}
        parts = {"id": obstacle, "shape": shape, "margin": margin, "motion": still, "model": model or Model()}
        checked = self._units.obstacle(Obstacle(**parts))
        self._check_new(obstacle)
        self._obstacles.add_unseen(checked.id, checked.shape, checked.model, checked.margin, self._noise(covariance))
        for each in self.listeners:
            each.added(obstacle, self._units.inverse.obstacle(checked).shape)

    def _check_new(self, name: str) -> None:
        if name in self._obstacles.tracks:
            raise ValueError(f"add_obstacle: there is an obstacle {name!r} already")

    def remove_obstacle(self, obstacle: str) -> None:
        """Forget an obstacle; what is seen of it later brings it back as it was added, with a note.

        Parameters
        ----------
        obstacle : str
            Its id; one that had gone already is noted.

        Raises
        ------
        ValueError
            If no obstacle of that id was ever added.
        """
        if not self._inbox.knows(obstacle):
            raise ValueError(f"remove_obstacle: there is no obstacle {obstacle!r}")
        self._inbox.dismiss(obstacle)
