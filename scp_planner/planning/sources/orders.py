"""Orders of the places to pass, and guides that lead over them, round what stands."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import inf

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import TooLargeError
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.taut import TautLines
from scp_planner.pauses import Budget, OutOfTimeError
from scp_planner.planning.plan import Plan, joined
from scp_planner.planning.search import Search, Source
from scp_planner.planning.task import Skeleton
from scp_planner.problem.guides import over_places
from scp_planner.routes.ground import MapLines
from scp_planner.routes.outlines import polygons_around, standing_shapes
from scp_planner.routes.visits import Visit, fixed, visits
from scp_planner.scenario.limits import Box
from scp_planner.scenario.models import Goal, Passage, Scenario
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import zones


@dataclass(frozen=True)
class OrderSettings:
    """Orders and guides that are tried."""

    orders: int = 3  # that are planned, where any will do
    most_orders: int = 8  # where none of those has a certified plan
    rounds: int = 4  # to targets that move, at most
    slow: float = 1.05  # times the time that is expected of a trip, from which on other guides are tried, too
    gain: float = 1e-3  # relative, of a trip that is led to its targets, below which there are no more rounds


ORDERS = OrderSettings()
Solve = Callable[[Skeleton, Budget], Plan]
"""Plans a skeleton by all sources."""


class Orders(Source[Skeleton, Plan]):
    """The fastest orders by straight legs, each with guides over its places.

    Targets stand at first where they are about when they are met, and then move: the trip over those places is led to
    where they really are. It says when they are met, and they stand there for the next one, while that gains.
    """

    name = "orders"

    def __init__(self, search: Search[Skeleton, Plan], solve: Solve, settings: Settings) -> None:
        self.search, self.solve, self.settings = search, solve, settings

    def decides(self, skeleton: Skeleton) -> bool:
        """True if there are places to pass, and no guide over them."""
        return skeleton.planned is None and bool(skeleton.scenario.goals) and skeleton.scenario.guide is None

    def children(self, skeleton: Skeleton, found: Plan | None) -> Iterator[tuple[float, Skeleton]]:  # noqa: ARG002
        """Yield guides over the places, order by order."""
        if self.search.due(skeleton) != self.name:
            return
        scenario, budget, search = skeleton.scenario, self.search.budget, self.search
        moves = any(one.target is not None for one in scenario.goals)
        asked = visits(scenario, ORDERS.most_orders)
        usual, whole = min(len(asked), ORDERS.orders), budget.part()
        for place, visit in enumerate(asked):
            enough = search.certified and (place >= usual or search.cutoff <= visit.arrival)
            if enough or (search.count and budget.is_over):
                return
            share = min((place + 1) / usual, 1.0)
            part = replace(whole, deadline=whole.begun + share * (whole.deadline - whole.begun))
            ordered = skeleton.after(f"order {' '.join(str(k + 1) for k in visit.order)}")
            yield from self._led(ordered, visit, part) if moves else self._over_places(ordered, visit, part)
            gears = scenario.vehicle.reverse is not None or scenario.vehicle.max_turn_rate is not None
            if gears and not moves and not search.certified:
                planned = partial(self._stopping, visit.taken(scenario))
                yield visit.arrival, replace(ordered.after("stop at each place", exact=False), planned=planned)

    def _over_places(self, skeleton: Skeleton, visit: Visit, budget: Budget) -> Iterator[tuple[float, Skeleton]]:
        """Yield guides over places that stand."""
        again = visit.taken(skeleton.scenario)
        guides = over_places(fixed(again), self._legs(again, budget))
        for tried, guided in enumerate(guides):
            share = budget.left / (len(guides) - tried)
            yield visit.arrival, replace(skeleton.after(f"guide {tried + 1}", guided), limit=share)

    def _stopping(self, scenario: Scenario, budget: Budget) -> Plan | None:
        """Plan from place to place, each with all gears, and join the legs."""
        start, plans = scenario.start, list[Plan]()
        for left, one in zip(range(len(scenario.goals), -1, -1), (*scenario.goals, scenario.goal), strict=True):
            goal = one
            if isinstance(one, Passage):
                kept = {key: getattr(one, key) for key in ("heading_range", "earliest_arrival", "latest_arrival")}
                goal = Goal(position=one.position, speed=0.0, **kept)
            scene = changed(scenario, start=start, goal=goal, goals=())
            made = self.solve(Skeleton(scene), budget.part(1.0 / (left + 1)))
            if not made.certified:
                return None
            plans.append(made)
            time = made.arrival_time
            (x, y), heading = made.position(time).tolist(), float(made.heading(time))
            start = changed(start, time=time, position=(x, y), heading=heading, speed=0.0, acceleration=None)
        return joined(plans)

    def _led(self, skeleton: Skeleton, visit: Visit, budget: Budget) -> Iterator[tuple[float, Skeleton]]:
        """Yield guides over where targets are about when they are met, while the trips that are led to them gain."""
        scenario, first, best = skeleton.scenario, 0, inf
        again = visit.taken(scenario)
        for _ in range(ORDERS.rounds):
            one, led = again, dict[int, _Led]()
            guides = over_places(fixed(one), self._legs(one, budget))
            for place in sorted(range(len(guides)), key=lambda place: place != first):
                led[place] = run = _Led(self.solve, guides[place], one, budget, 2 * (len(guides) - len(led)))
                yield visit.arrival, replace(skeleton.after(f"guide {place + 1}", exact=False), planned=run)
                if run.last is not None and run.last.certified:
                    if run.last.travel_time <= ORDERS.slow * visit.arrival:
                        break
            done = {place: run for place, run in led.items() if run.nearest is not None and run.last is not None}
            if not done:
                return
            first = min(done, key=lambda place: done[place].rank)
            nearest, last = done[first].nearest, done[first].last
            assert nearest is not None and last is not None
            visit = visit.led_by(one, nearest.trip)
            again = visit.taken(scenario)
            gains = last.certified and last.travel_time < best * (1.0 - ORDERS.gain)
            if again == one or budget.is_over or not (gains or best == inf):
                return
            best = last.travel_time if last.certified else best

    def _legs(self, scenario: Scenario, budget: Budget) -> list[Array]:
        """The shortest line from each place to the next, (n, 2) m, round what stands; straight where there is none."""
        places = [scenario.start.position, *(one.position for one in scenario.goals), scenario.goal.position]
        straight = [np.array(pair) for pair in pairwise(places)]
        if scenario.ground is not None:
            return MapLines(scenario, budget).pieces() or straight
        if not (scenario.obstacles or scenario.walls):
            return straight
        units, world = NaturalUnits.of(scenario), PlanningFrame((0.0, 0.0), 0.0, 0.0)
        margin, length = for_scene(self.settings, units), units.length
        batch = ZoneBatch.of(zones(scenario), world, scenario.vehicle.radius + length * margin.clearance_margin)
        shapes = standing_shapes(batch)
        box = Box.of(scenario, world, length * margin.box_margin)
        inside = list(zip(box.normals, box.offsets.tolist(), strict=True))
        found = list[Array]()
        for leg in straight:
            try:
                around = polygons_around(shapes, leg)
                line = next(iter(TautLines(around, leg[0], leg[1], inside, budget.deadline)), None)
            except (OutOfTimeError, TooLargeError):
                line = None
            found.append(leg if line is None else line.points)
        return found


class _Led:
    """A trip over places where targets stand, led to the targets as they move."""

    def __init__(self, solve: Solve, guided: Scenario, moving: Scenario, budget: Budget, parts: int) -> None:
        self.solve, self.guided, self.moving = solve, guided, moving
        self.budget, self.parts = budget, parts
        self.nearest: Plan | None = None
        self.last: Plan | None = None

    def __call__(self, _: Budget) -> Plan | None:
        self.nearest = self.solve(Skeleton(self.guided), self.budget.part(1.0 / self.parts))
        planned = self.nearest.planned or self.guided
        led = Skeleton(changed(self.moving, guide=planned.guide), begin=self.nearest.trip)
        self.last = self.solve(led, self.budget.part())
        return self.last

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """Led to a certified trip, from a certified one, the fastest."""
        assert self.nearest is not None and self.last is not None
        return not self.last.certified, not self.nearest.certified, self.nearest.travel_time
