"""Work of one call: the scene with its decisions, and the same in the units of the scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.lower_bound import ground_bound
from scp_planner.pauses import Budget
from scp_planner.planning.plan import Plan
from scp_planner.planning.search import SearchLog
from scp_planner.problem.memory import check_obstacles
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.scp.goal import ArrivalSteps
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.solvers import QpSolver, solver_named
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trip import Trip

if TYPE_CHECKING:
    from scp_planner.scp.given import UserConstraints


PlanOne = Callable[["Skeleton", Budget, bool], Plan]
"""Plans a skeleton within a budget; thoroughly, if it is the only one."""


@dataclass(frozen=True)
class Skeleton:
    """Decisions about a trip, and the scene that they leave to plan.

    Attributes
    ----------
    scenario : Scenario
        What is left to plan: with a guide where the route is decided, without a map where the ground is.
    decided : tuple of str
        The decisions, in words.
    exact : bool
        A plan that is certified for ``scenario`` is certified for the one that was asked for.
    line : ndarray, optional
        Route from start to goal that the first trip follows, (n, 2) m.
    begin : Trip, optional
        Trip that the loop starts from.
    limit : float
        Wall time that planning it may take, s.
    planned : callable, optional
        Plans the skeleton within a budget, in place of a single trip; None where there is no certified one.
    """

    scenario: Scenario
    decided: tuple[str, ...] = ()
    exact: bool = True
    line: Array | None = None
    begin: Trip | None = None
    limit: float = inf
    planned: Callable[[Budget], Plan | None] | None = None

    def after(self, decision: str, scenario: Scenario | None = None, *, exact: bool = True) -> Skeleton:
        """Return the skeleton with one decision more.

        Parameters
        ----------
        decision : str
            In words.
        scenario : Scenario, optional
            What it leaves to plan; default: the scene as it is.
        exact : bool
            A plan that is certified for that is certified for the scene as it is.

        Returns
        -------
        Skeleton
        """
        decided = (*self.decided, decision)
        return Skeleton(scenario or self.scenario, decided, exact=self.exact and exact, limit=self.limit)

    def along(self, guide: Sequence[Sequence[float]], name: str = "drawn guide") -> Skeleton:
        """Return the skeleton with a guide.

        Parameters
        ----------
        guide : sequence of (float, float)
            Polyline [[x, y], ...], m, from start to goal.
        name : str
            In ``plan.explanation``.

        Returns
        -------
        Skeleton
        """
        line = tuple((float(x), float(y)) for x, y in guide)
        return self.after(name, changed(self.scenario, guide=line), exact=False)


def check_scenario(scenario: Scenario) -> None:
    """Refuse what is no scenario, and one of more obstacles than there is memory for."""
    NaturalUnits.of(scenario)
    check_obstacles(len(scenario.obstacles))


def may_have_legs(scenario: Scenario) -> bool:
    """True if trips of several legs are looked for."""
    return scenario.start.heading is not None and may_back_up(scenario)


def may_back_up(scenario: Scenario) -> bool:
    """True if a trip may have several legs, where it begins with a heading."""
    vehicle = scenario.vehicle
    return is_plain(scenario) and (vehicle.reverse is not None or vehicle.max_turn_rate is not None)


def is_plain(scenario: Scenario) -> bool:
    """True if manoeuvres are looked for: with no guide, to a goal that stands, at any time."""
    return scenario.guide is None and scenario.goal.target is None and scenario.goal.arrival_step is None


@dataclass(frozen=True)
class OwnConstraints:
    """A user's own constraints, and the units of the scene, in which they are not written."""

    constraints: UserConstraints
    units: NaturalUnits


@dataclass(frozen=True)
class Request:
    """A call of :func:`scp_planner.plan`, in the user's units."""

    settings: Settings
    budget: Budget
    log: SearchLog
    solver: QpSolver | None = None
    constraints: UserConstraints | None = None
    thorough: bool = True
    threat_zones: Sequence[ThreatZone] | None = None
    known: float = inf  # travel time that a trip has to beat, s

    @classmethod
    def of(
        cls,
        settings: Settings | None,
        solver: str | QpSolver | None,
        constraints: UserConstraints | None,
        budget: Budget,
        **more: object,
    ) -> Request:
        """Return a call; own constraints are kept by CVXPY where no solver is named."""
        settings = settings or Settings()
        if constraints is not None and solver is None and settings.solver == Settings.solver:
            solver = "cvxpy"
        if isinstance(solver, str):
            settings, solver = replace(settings, solver=solver), None
        return cls(settings, budget, new_log(), solver, constraints, **more)  # type: ignore[arg-type]

    def task(self, scenario: Scenario, units: NaturalUnits, log: SearchLog | None = None) -> tuple[Scenario, Task]:
        """Return a scenario in some units, and the task of planning it; its log may go on with another one."""
        go_on = self.budget.go_on
        inside = units.scenario(scenario, go_on)
        any_time, known = at_any_time(inside), self.threat_zones
        task = Task(
            any_time,
            ZonesOf(any_time, go_on) if known is None else tuple(zone.inside(units) for zone in known),
            for_scene(self.settings, units),
            self.budget,
            own_solver=self.solver,
            given=None if self.constraints is None else OwnConstraints(self.constraints, units),
            arrival_step=inside.goal.arrival_step,
            thorough=self.thorough,
            log=log or new_log(),
        )
        return inside, task


def new_log() -> SearchLog:
    """Return the empty log of a call."""
    return SearchLog("build", "search", "scp", "certificate")


@dataclass(frozen=True)
class Task:
    """A scene without decisions left but those of a single trip, in its natural units."""

    scenario: Scenario
    threat_zones: Sequence[ThreatZone]
    settings: Settings
    budget: Budget = field(default_factory=Budget)
    own_solver: QpSolver | None = None
    given: OwnConstraints | None = None
    arrival_step: float | None = None  # s; the scenario lacks it: the trip is brought to a step at last
    least_time: float = 0.0  # s; no trip is faster
    thorough: bool = True  # arcs, and a proof that there is no trip, where no start leads to a certified one
    provisional: bool = False  # a trip that keeps all constraints is taken for certified: it is changed before it is
    log: SearchLog = field(default_factory=new_log)

    @property
    def steps(self) -> ArrivalSteps | None:
        """Steps of time to arrive on, in travel times."""
        if self.arrival_step is None:
            return None
        latest = self.scenario.goal.latest_arrival
        return ArrivalSteps(self.arrival_step, np.inf if latest is None else latest - self.scenario.start.time)

    @property
    def bounded(self) -> Task:
        """The task with the time that the shortest route round what stands takes at least."""
        with self.log.timed("search"):
            least = ground_bound(self.scenario, self.threat_zones, self.budget.deadline)
        return replace(self, least_time=least if np.isfinite(least) else 0.0)

    def solvers(self) -> tuple[QpSolver, str | None]:
        """Return the solver, and the name of the one to fall back to; a user's own solver or constraints allow none."""
        if self.own_solver is not None:
            return self.own_solver, None
        name = self.settings.solver
        if self.given is not None:
            return solver_named(name), None
        return solver_named(name), "clarabel" if name != "clarabel" else "daqp"


def at_any_time(scenario: Scenario) -> Scenario:
    """Return the scenario without the step of its arrival."""
    if scenario.goal.arrival_step is None:
        return scenario
    return changed(scenario, goal=changed(scenario.goal, arrival_step=None))
