"""Trips that keep a whole tube clear: everywhere that the vehicle may be instead of where its plan has it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter

from scp_planner.certificate.check import certify
from scp_planner.certificate.verdict import Violation
from scp_planner.planning.plan import Plan, judged_by
from scp_planner.problem.preparation import last_check, left_before_check
from scp_planner.scenario.models import Scenario
from scp_planner.threat_zones.error_tube import TrackingTube


@dataclass(frozen=True)
class TubeRounds:
    """Rounds of planning in a tube."""

    most: int = 6  # Trips that are planned, at most; the last has the most room that the tube can take
    more: float = 1.05  # Times of the missing clearance that are added: the next trip may be a little faster there


ROUNDS = TubeRounds()
PlanOne = Callable[[Scenario, float | None], Plan]
"""Plans a scenario within a wall time, s."""


def plan_in_tube(scenario: Scenario, tube: TrackingTube, plan_one: PlanOne, time_limit: float | None) -> Plan:
    """Plan a trip whose tube is certified."""
    # The tube is as wide as the speed and the turns of the trip that is looked for, between its width where the vehicle
    # stands and its bound over all that the vehicle may do. So a first trip keeps the least of it from all obstacles;
    # those that its tube touches get as much more as is missing, until the certificate holds for the tube; at last all
    # get the bound. Obstacles that are passed slowly and straight on take no more room than that asks for.
    began, widest = perf_counter(), tube.bound(scenario.vehicle)
    # From each obstacle by its id, and from the walls of the workspace, None, which all keep at least.
    rooms: dict[str | None, float] = dict.fromkeys([None, *(one.id for one in scenario.obstacles)], tube.standing)
    iterations, lower_bound = 0, 0.0
    for left in reversed(range(ROUNDS.most)):
        made = plan_one(_roomier(scenario, rooms), left_before_check(time_limit, began))
        iterations += made.iterations
        # Every trip with this tube keeps the first, the least room of all; of later ones that is not sure.
        lower_bound = lower_bound or made.lower_bound
        found = certify(scenario, made, tube=tube, deadline=last_check(time_limit, began))
        late = time_limit is not None and perf_counter() - began > time_limit
        # Where there is no trip with this room, there is none with more.
        if found.holds or late or not made.certified or min(rooms.values()) >= widest:
            break
        rooms = _more(rooms, found.violations, widest) if left > 1 else dict.fromkeys(rooms, widest)
    whole = replace(made, iterations=iterations, lower_bound=lower_bound, wall_time=perf_counter() - began)
    told = judged_by(whole, scenario, found)
    return told if found.holds else replace(told, reason=f"with room for the tube of tracking errors: {told.reason}")


def _roomier(scenario: Scenario, rooms: Mapping[str | None, float]) -> Scenario:
    """The scenario with a larger vehicle, and with obstacles that are larger still, by the room from each, m."""
    radius, walls = scenario.vehicle.radius, rooms[None]
    obstacles = tuple(
        one.model_copy(update={"margin": one.margin + max(rooms[one.id] - walls, 0.0)}) for one in scenario.obstacles
    )
    vehicle = scenario.vehicle.model_copy(update={"radius": radius + walls})
    return scenario.model_copy(update={"obstacles": obstacles, "vehicle": vehicle})


def _more(rooms: Mapping[str | None, float], violations: Iterable[Violation], widest: float) -> dict[str | None, float]:
    """The rooms, and so much more of them as is missing from what a tube touches; or most of it from all."""
    more = dict(rooms)
    for violation in violations:
        whom = violation.obstacle if violation.obstacle in rooms else None
        missing = max(violation.allowed - violation.value, 0.0)
        more[whom] = min(max(rooms[whom], rooms[None]) + ROUNDS.more * missing, widest)
    return more if more != rooms else dict.fromkeys(rooms, widest)
