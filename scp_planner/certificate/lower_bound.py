"""Times that no trip can be shorter than, with obstacles and without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from scp_planner.certificate.ground import least_length
from scp_planner.certificate.meeting import first_meeting
from scp_planner.certificate.relaxation import SIZE, NotDecided, Relaxation
from scp_planner.certificate.tolerances import ROUNDING, SPEED_ROUNDING
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.scenario.limits import Limits, straight_travel_time, straight_trip_time
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.target import TargetMotion
from scp_planner.threat_zones.zone import ThreatZone


@dataclass(frozen=True)
class Bisection:
    """Precision and steps of the search for a lower bound."""

    precision: float = 1e-3  # relative, to which the bound is found
    first_step: float = 0.99  # of this precision: what is possible after it is near enough
    # Times the kinematic bound: how long trips are looked for, until there may be one
    growth: tuple[float, ...] = (1.02, 1.1, 1.25, 1.6, 2.2, 3.0, 4.0)


BISECTION = Bisection()


def kinematic_bound(scenario: Scenario) -> float:
    """No trip is shorter than a straight one without obstacles, s, and none arrives before it may.

    Of a target: the earliest time at which the vehicle can have driven as far as the target is away; inf if it never
    can.
    """
    target = TargetMotion.of(scenario)
    time = straight_trip_time(scenario, Limits.of(scenario)) if target is None else first_meeting(scenario, target)
    earliest = scenario.goal.earliest_arrival
    return time if earliest is None else max(time, earliest - scenario.start.time)


def ground_bound(scenario: Scenario, threat_zones: Sequence[ThreatZone], deadline: float = np.inf) -> float:
    """No trip is shorter than the fastest drive over the shortest way round all that stands, s, in natural units.

    It is inf where what stands lets no trip through.
    """
    least = kinematic_bound(scenario)
    length = least_length(scenario, threat_zones, deadline)
    if length == 0.0 or not np.isfinite(length):
        return max(least, length)
    limits, start, goal = Limits.of(scenario), scenario.start, scenario.goal
    return max(least, straight_travel_time(length, start.speed, limits, goal.speed)[0] * (1.0 - SPEED_ROUNDING))


def lower_bound(
    scenario: Scenario,
    *,
    at_most: float | None = None,
    threat_zones: tuple[ThreatZone, ...] | None = None,
    time_limit: float | None = None,
    gap: float | None = None,
) -> float:
    """Return a travel time that no trip among the obstacles is shorter than.

    Parameters
    ----------
    scenario : Scenario
    at_most : float, optional
        Travel time of a trip that is known, s: the bound is not looked for above it, which makes it quicker and finer.
        Without it, it is looked for up to four times the kinematic bound.
    threat_zones : tuple of ThreatZone, optional
        The scenario's zones, if they are at hand.
    time_limit : float, optional
        Wall time in s after which the best bound so far is returned.
    gap : float, optional
        Relative: a bound from which ``at_most`` is no farther is good enough. That is asked first, once, which is far
        quicker than to look for the best bound.

    Returns
    -------
    float
        s, never less than the fastest drive over the shortest way round what stands, which it is where the trip is so
        long that there would be too many cells and instants to look at, and inf where nothing leads through; it is the
        smaller of what is true and what cells and instants can show, to a thousandth. Waiting for what fills a bounded
        workspace shows, and going far round; the price of small sidesteps, and of turning, does not. Of a target it
        is the time at which the target can first be met on free ground; inf if no trip ever meets it.
    """
    deadline = np.inf if time_limit is None else perf_counter() + time_limit
    units = NaturalUnits.of(scenario)

    def go_on() -> None:
        if perf_counter() > deadline:
            raise NotDecided

    try:
        inside = units.scenario(scenario, go_on)
        found = ZonesOf(inside, go_on) if threat_zones is None else tuple(zone.inside(units) for zone in threat_zones)
    except NotDecided:
        return kinematic_bound(scenario)
    return bound_among(inside, None if at_most is None else at_most / units.time, found, deadline, gap) * units.time


def bound_among(
    scenario: Scenario,
    at_most: float | None,
    threat_zones: Sequence[ThreatZone],
    deadline: float = np.inf,
    gap: float | None = None,
) -> float:
    """Return :func:`lower_bound` of a scenario in natural units."""
    if scenario.goal.target is not None:
        return kinematic_bound(scenario)
    least = ground_bound(scenario, threat_zones, deadline)
    if not scenario.obstacles or not np.isfinite(least):
        return least
    return _Bisection(scenario, tuple(threat_zones), least, deadline).bound(at_most, gap)


class _Bisection:
    """The longest duration that is excluded, as far as it is found."""

    def __init__(self, scenario: Scenario, threat_zones: tuple[ThreatZone, ...], least: float, deadline: float) -> None:
        self.scenario, self.threat_zones = scenario, threat_zones
        self.least = self.excluded = least
        self.deadline = deadline

    def bound(self, at_most: float | None, gap: float | None = None) -> float:
        """Return it, at most a duration that is known to be possible, s; one that is near enough to that will do."""
        wanted = None if at_most is None or gap is None else at_most / (1.0 + gap)
        try:
            if wanted is None or not self._excludes(wanted):
                self._look(wanted or at_most, quickly=wanted is not None)
        except NotDecided:
            pass
        return self.excluded

    def _excludes(self, duration: float) -> bool:
        """True if a duration is excluded, s, which is asked once with few cells, and once with many."""
        for cells in (SIZE.few_cells, SIZE.cells):
            if duration <= self.least or not self._relaxation(duration, cells).possible(duration):
                self.excluded = max(self.excluded, duration)
                return True
        return False

    def _look(self, at_most: float | None, *, quickly: bool = False) -> None:
        if at_most is None:
            at_most = self._first_possible()
        if at_most is None:
            return
        precision = BISECTION.precision * self.least
        # More cells exclude hardly more: it is looked for from below, in steps that grow.
        finer = () if quickly else ((SIZE.cells, BISECTION.first_step * precision),)
        for cells, step in ((SIZE.some_cells, np.inf), *finer):
            if at_most - self.excluded > precision:
                self._narrow(at_most, cells, step)

    def _first_possible(self) -> float | None:
        """A duration that cannot be excluded, s; None if there is none that is looked at."""
        for growth in BISECTION.growth:
            longest = growth * self.least
            if self._relaxation(longest, SIZE.some_cells).possible(longest):
                return longest
            self.excluded = longest
        return None

    def _narrow(self, longest: float, cells: int, step: float) -> None:
        """Exclude what can be excluded below a duration, with so many cells: by halves, or by steps that double."""
        relaxation = self._relaxation(longest, cells)
        while longest - self.excluded > BISECTION.precision * self.least:
            duration = min(0.5 * (self.excluded + longest), self.excluded + step)
            if relaxation.possible(duration):
                longest = duration
            else:
                self.excluded = duration
                step *= 2.0

    def _relaxation(self, longest: float, cells: int) -> Relaxation:
        return Relaxation(self.scenario, self.threat_zones, longest, cells, self.deadline)


def no_trip_within(
    scenario: Scenario, travel_time: float, threat_zones: Sequence[ThreatZone], deadline: float = np.inf
) -> bool:
    """True if it can be proved, quickly, that no trip takes a travel time or less."""
    if travel_time < kinematic_bound(scenario) * (1.0 - SPEED_ROUNDING):
        return True
    if not threat_zones:  # straight on, inside a convex workspace
        return False
    units = NaturalUnits.of(scenario)
    inside = units.scenario(scenario.model_copy(update={"obstacles": ()}))
    found = tuple(zone.inside(units) for zone in threat_zones)
    longest = travel_time / units.time
    try:
        return not Relaxation(inside, found, longest, SIZE.few_cells, deadline).possible(longest)
    except NotDecided:
        return False


def goal_is_covered_for_good(scenario: Scenario, threat_zones: Sequence[ThreatZone]) -> bool:
    """True if one of the zones that stand covers all of the goal: then no trip ever arrives."""
    frame = PlanningFrame.between(scenario.start.position, scenario.goal.position, scenario.start.time)
    zones = ZoneBatch.of(threat_zones, frame, scenario.vehicle.radius - ROUNDING)
    goal = frame.to_frame(np.array([scenario.goal.position]))
    depth = -zones.subset(zones.standing).distances(np.zeros(1), goal)
    return bool(np.any(depth > scenario.goal.radius + ROUNDING))
