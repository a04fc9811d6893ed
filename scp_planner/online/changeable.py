"""Changes of what a planner is asked for, while the vehicle drives."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

from numpy.typing import ArrayLike

from scp_planner.errors import ScenarioError
from scp_planner.mathematics.occupancy import OccupancyMap
from scp_planner.online.arguments import ground_given, own_ground
from scp_planner.online.perception import Perception
from scp_planner.online.remaining import State
from scp_planner.scenario.models import Goal, Ground, Passage, Scenario
from scp_planner.scenario.places import anchored
from scp_planner.scenario.targets import obstacle_met
from scp_planner.scenario.underway import Underway
from scp_planner.scenario.units import changed
from scp_planner.scenario.validation import unknown_key
from scp_planner.settings.online import SceneOnlineSettings
from scp_planner.solvers import QpSolver
from scp_planner.threat_zones.target import tracked

GROUND = ("walls", "bounds", "corridor", "speed_limits")


class Changeable(Perception):
    """A planner whose goal, ground, limits and map may change while it drives."""

    _asked: Scenario  # in the user's units
    _online: SceneOnlineSettings
    _state: State | None
    solver: QpSolver

    @property
    @abstractmethod
    def given(self) -> Scenario:
        """The scenario that is planned for, in units of the scene, with the places that are left to pass."""

    @property
    @abstractmethod
    def _places_left(self) -> tuple[int, ...]:
        """Numbers of the places on the way that are left to pass, of those that were asked for last."""

    @abstractmethod
    def _take_up(self, scenario: Scenario, solver: QpSolver) -> None:
        """Plan for a scenario from the next replan on, in units of the scene."""

    @abstractmethod
    def _left(self, state: State) -> Scenario:
        """Return what is left of the scenario at a state, without obstacles."""

    def set_goal(
        self,
        goal: Goal | Mapping[str, Any],
        guide: ArrayLike | None = None,
        goals: Sequence[Passage | Mapping[str, Any]] = (),
    ) -> None:
        """Drive to another goal from the next replan on; tracks, the plan and its certified stop are kept.

        Parameters
        ----------
        goal : Goal or mapping
            As in a scenario.
        guide : (n, 2), optional
            m, from about where the vehicle is to the goal; the last one leads to the last goal and is dropped.
        goals : sequence of Passage or mapping
            Places to pass before it, in place of those that are left.

        Raises
        ------
        ScenarioError
            With all that is wrong with it; then nothing has changed.
        """
        self._change("set_goal", goal=goal, guide=guide, goals=list(goals))

    def set_limits(self, **limits: Any) -> None:
        """Drive within other limits of the vehicle from the next replan on.

        Parameters
        ----------
        **limits
            Fields of `Vehicle`, such as ``max_speed``; the others stay.

        Raises
        ------
        ScenarioError
            As :meth:`set_goal`.
        EstimationError
            If the vehicle may drive or turn faster than the tube was recorded for.
        """
        self._change("set_limits", vehicle={**dict(self._asked.vehicle), **limits})

    def set_ground(self, **ground: Any) -> None:
        """Drive over another ground from the next replan on.

        The last plan goes on only if it, or the stop from it, is certified over the new ground, too.

        Parameters
        ----------
        **ground
            Of ``walls``, ``bounds``, ``corridor`` and ``speed_limits`` those that change, as in a scenario. The vehicle
            may be outside of them: it is not safe then, and finds its way out if there is one.

        Raises
        ------
        ScenarioError
            As :meth:`set_goal`.
        """
        unknown = [unknown_key(name, value, GROUND) for name, value in ground.items() if name not in GROUND]
        if unknown:
            raise ScenarioError("set_ground", unknown)
        self._change("set_ground", **ground)

    def set_walls(self, walls: Sequence[ArrayLike]) -> None:
        """Drive among other walls, convex polygons, (n, 2) m each: :meth:`set_ground` of these alone."""
        self.set_ground(walls=walls)

    def update_map(self, map: OccupancyMap | Ground | Mapping[str, Any] | str | PathLike[str]) -> None:
        """Drive over another map from the next replan on.

        The last plan goes on only if it, or the stop from it, is certified over the new cells, too. Equal cells change
        nothing; cells may be changed in place between calls.

        Parameters
        ----------
        map : OccupancyMap, Ground, mapping, str or path
            As ``ground`` of a scenario, or its ``map`` alone. Plans tell if vehicle or goal are on occupied cells.

        Raises
        ------
        ScenarioError
            As :meth:`set_ground`, and if there is a corridor.
        """
        ground = ground_given("update_map", map, self._asked)
        if ground != self._asked.ground:
            self._change("update_map", ground=ground)

    def _change(self, call: str, **changes: Any) -> None:
        """Check changes of what is asked for, in the user's units, and take them up."""
        start = self._asked.start
        if self._state is not None:
            start = self._units.inverse.scenario(self._left(self._state)).start
        left = changes.get("goals", [self._asked.goals[k] for k in self._places_left])
        names = [name for one in (changes.get("goal"), *left) if (name := obstacle_met(one)) is not None]
        for name in names:
            self._check_known(call, name)
        seen = [self._units.inverse.obstacle(one) for one in self.obstacles.as_obstacles() if one.id in names]
        ground = changes.pop("ground", self._asked.ground)
        # Only of a goal that is asked for now is it a mistake to be on occupied cells
        checked = ground if changes.keys() & {"goal", "corridor"} else None
        now = {"start": start, "obstacles": seen, "goals": left, **changes, "ground": checked}
        try:
            asked: Scenario = changed(Underway(**{**dict(self._asked), **now}), ground=own_ground(ground))
        except ScenarioError as error:
            raise ScenarioError(call, error.faults) from None
        asked = tracked(anchored(asked.model_copy(update={"obstacles": ()})))
        inside = self._units.scenario(asked)
        with self._inbox.work:
            self._obstacles.replace(*inside.obstacles)
            self._take_up(inside, self.solver)
            self._obstacles.widen(self._online.margin(inside.vehicle.max_speed))
            self._asked = asked.model_copy(update={"obstacles": ()})
        for each in self.listeners:
            each.changed(asked)
