"""Failure that explains itself: what stands in the way, when, how much is missing, and what would help."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from scp_planner.certificate.lower_bound import kinematic_bound, no_trip_within
from scp_planner.certificate.verdict import BEYOND_ZONES, EARLIEST, LATEST, Certificate, Violation
from scp_planner.planning.plan import UNCHECKED
from scp_planner.planning.tolerances import TRIP_ROUNDING
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.ready_made import NAMES
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.threat_zones.of_scenario import covering_radius, is_taken_for_a_disc
from scp_planner.threat_zones.zone import ThreatZone, by_obstacle
from scp_planner.trips.trip import Trip

GETS_AWAY = (
    "no trip meets the target: at no time is it as near to the start as the vehicle can have driven by then, at full"
    " acceleration up to its top speed"
)
_ORDERS = ("standing", "constant velocity", "constant acceleration")


@dataclass(frozen=True)
class Report:
    """Contents of an explanation."""

    trifle: float = 0.05  # Relative to the gravest violation: smaller ones come along with it and are not reported
    small: float = 0.1  # Relative to a limit, or to the vehicle's radius
    fewest_penalties: float = 1e-3  # units of time; less is rounding
    # Times the kinematic bound: trips up to this long are proved to be impossible, where there is no latest arrival
    looked_ahead: float = 2.0
    most_culprits: int = 4
    most_named: int = 3  # Number of alike obstacles that are named
    touching: float = 0.1  # of the vehicle's radius
    late_stop: float = 2.0  # times to a stop, in which a violation may come from what is straight ahead
    trip_looks: int = 65  # at times of a trip


REPORT = Report()
_ENDS = {
    LoopStatus.CONVERGED: "the loop converged",
    LoopStatus.STALLED: "the trust region became tiny before the loop converged",
    LoopStatus.INFEASIBLE: "no step comes nearer to keeping every constraint, at the highest penalties",
    LoopStatus.ITERATION_LIMIT: "the limit of iterations was reached",
    LoopStatus.TIME_LIMIT: "the time limit was reached",
    LoopStatus.SOLVER_FAILED: "the solver failed on the last subproblem",
    LoopStatus.SLOWER: "the run was aborted as slower than another",
    LoopStatus.SAME_WAY: "the run was aborted as converging to the trip of another",
}


@dataclass(frozen=True)
class Ending:
    """End of the best run, and the attempts that were made."""

    status: LoopStatus
    penalty: float  # cost of its violations, s; 0 where that is nothing but rounding
    tried: Mapping[str, int]  # runs by what the attempt tries

    @classmethod
    def of(cls, run: LoopRun, tried: Mapping[str, int], time: float = 1.0) -> Ending:
        """Return the ending of a run in natural units, with ``time`` the unit of time, s."""
        left = run.evaluation.merit(run.penalties) - run.evaluation.trajectory.travel_time
        return cls(run.status, left * time if left > REPORT.fewest_penalties else 0.0, tried)


def explain(
    scenario: Scenario,
    threat_zones: Sequence[ThreatZone],
    trip: Trip,
    ending: Ending,
    certificate: Certificate,
    *,
    prove_until: float = np.inf,
) -> str:
    """Say in one line why there is no certified plan."""
    told = grave_violations(scenario, trip, certificate)
    parts = ["; ".join(map(str, told)) or UNCHECKED, *_causes(scenario, threat_zones, trip, told, prove_until)]
    tried = _listed([_counted(number, what) for what, number in ending.tried.items()])
    penalty = f"; penalty left {ending.penalty:.3g} s" if ending.penalty > 0.0 else ""
    parts.append(f"Best of {tried}; {_ENDS[ending.status]}{penalty}")
    helps = "; ".join(_relaxations(scenario, told))
    return ". ".join([*parts, f"It would be acceptable with {helps}"] if helps else parts)


def grave_violations(scenario: Scenario, trip: Trip, certificate: Certificate) -> list[Violation]:
    """Return the violations of a certificate, gravest first, without the trifles that come along with them."""
    severity = {violation: _severity(scenario, trip, violation) for violation in certificate.violations}
    trifle = min(REPORT.trifle * max(severity.values(), default=0.0), REPORT.small)
    grave = sorted((each for each in severity if not severity[each] < trifle), key=lambda each: -severity[each])
    first = {(each.what, each.obstacle): each for each in reversed(grave)}
    return sorted(first.values(), key=lambda each: -severity[each])


def _relaxations(scenario: Scenario, told: Sequence[Violation]) -> Iterator[str]:
    for each in told:
        whole = each.obstacle is not None and -each.value > 0.5 * _extent(scenario)
        # by how much says nothing where it is most of the scene
        yield f"far smaller zones of {each.obstacle}" if whole else _relaxation(each)


def _severity(scenario: Scenario, trip: Trip, violation: Violation) -> float:
    """Size of a violation, relative to its limit, to the vehicle's radius or top speed, or to the travel time."""
    vehicle = scenario.vehicle
    excess = abs(violation.value - violation.allowed)
    match violation.unit.strip():
        case "m":
            return excess / vehicle.radius
        case "s":
            return excess / trip.trajectory.travel_time
        case "rad":
            return excess
        case "":
            return np.inf
        case "m/s" if violation.what.endswith(("speed", "error")):  # also driving backwards
            return excess / vehicle.max_speed
        case "m/s2" if violation.what.endswith("error"):
            return excess / vehicle.max_acceleration
    return excess / abs(violation.allowed)


def _relaxation(violation: Violation) -> str:
    if violation.obstacle is not None:
        if violation.value > -violation.rounding:
            return f"{violation.obstacle} only a little smaller"
        return f"{-violation.value:.3g} m less of {violation.obstacle}"
    excess = violation.value - violation.allowed
    if violation.what in (EARLIEST, LATEST):
        return f"the {violation.what} {abs(excess):.3g} s {'sooner' if excess < 0.0 else 'later'}"
    if violation.what == BEYOND_ZONES:
        return f"a trip that ends {excess:.3g} s sooner, since later nothing is known of observed obstacles"
    if violation.what == "workspace bounds":
        return f"workspace bounds {-excess:.3g} m wider"
    return f"{abs(excess):.3g}{violation.unit} more of {violation.what}"


def _causes(
    scenario: Scenario, threat_zones: Sequence[ThreatZone], trip: Trip, told: list[Violation], prove_until: float
) -> Iterator[str]:
    """Say what is certainly behind violations, the gravest of which comes first."""
    zones = by_obstacle(threat_zones)
    for number, violation in enumerate(told):
        if violation.what == "goal speed error":
            yield from _too_short_a_way(scenario, trip)
        elif violation.what == "curvature" and not number:
            yield f"The tightest turn that is allowed has a radius of {1.0 / violation.allowed:.3g} m"
    cut = [each for each in told if each.obstacle is not None and each.obstacle in zones]
    yield from _uncertainty(scenario, zones, cut)
    shapes = {obstacle.id: obstacle.shape for obstacle in scenario.obstacles}
    for name in dict.fromkeys(str(each.obstacle) for each in cut):
        if name in shapes and is_taken_for_a_disc(shapes[name], zones[name]):
            disc = f"a disc of {covering_radius(shapes[name]):.3g} m"
            yield f"{name} is taken for {disc}, as its heading is not known: give shape.heading if you know it"
    first = min((each.time for each in cut or told), default=np.inf)
    for name in dict.fromkeys(str(each.obstacle) for each in cut) if cut else zones:
        yield from _stopping(scenario, zones[name], name, first)
    if perf_counter() < prove_until:
        yield from _no_way(scenario, tuple(threat_zones), _touched(scenario, threat_zones, trip), prove_until)


def _too_short_a_way(scenario: Scenario, trip: Trip) -> Iterator[str]:
    vehicle, first, last = scenario.vehicle, scenario.start.speed, scenario.goal.speed
    if last is None:
        return
    rate = vehicle.max_acceleration if last > first else vehicle.max_deceleration
    needed, way = abs(last**2 - first**2) / (2.0 * rate), trip.trajectory.path.arc_length
    if needed > way * (1.0 + TRIP_ROUNDING):
        yield f"From {first:g} m/s to {last:g} m/s takes {needed:.3g} m, and this path is {way:.3g} m long"


def _uncertainty(scenario: Scenario, zones: Mapping[str, list[ThreatZone]], cut: Sequence[Violation]) -> Iterator[str]:
    """Say how uncertain positions are by then, if that is what is in the way, and which model would know more."""
    for violation in cut:
        uncertain = _spread(zones[str(violation.obstacle)], violation.time)
        if 2.0 * uncertain > -violation.value:
            yield f"By then the position of {violation.obstacle} is uncertain by up to {uncertain:.3g} m"
            if uncertain > _extent(scenario):
                yield _model_to_change(scenario, zones, violation)
                return  # of others it would be the same


def _spread(zones: Sequence[ThreatZone], time: float) -> float:
    """By how much a position is uncertain in that of an obstacle's zones in which it is most, m."""
    covariances = [zone.covariance(time) for zone in zones if zone.covariances is not None]
    return max((float(np.sqrt(np.linalg.eigvalsh(each)[-1])) for each in covariances), default=0.0)


def _model_to_change(scenario: Scenario, zones: Mapping[str, list[ThreatZone]], worst: Violation) -> str:
    """Name the model that zones larger than the scene come from, and what to put in its place."""
    size, time = _extent(scenario), worst.time
    wide = {one.id: one.model for one in scenario.obstacles if one.id in zones and _spread(zones[one.id], time) > size}
    others = [name for name in wide if name != worst.obstacle]
    told = f"That is more than the whole scene, {size:.3g} m"
    if others:
        named = ", ".join(others[: REPORT.most_named]) + (", ..." if len(others) > REPORT.most_named else "")
        told += f", as of {len(others)} more ({named})"
    believed = [model.order for model in wide.values() if model.process is None]
    if not believed:
        return f"{told}: no model predicts that far ahead; replan while driving (simulate, Planner), or ask for less"
    names = " or ".join([", ".join(NAMES[:-1]), NAMES[-1]])
    order = max(believed)
    keeps = "if it keeps its velocity, set order: 1; " if order > 1 else ""
    told += f": the model, order {order} ({_ORDERS[order]}), does not predict that far ahead; "
    return f"{told}{keeps}if one fits, set model: {names}"


def _extent(scenario: Scenario) -> float:
    """Largest distance of the start, guide and goal from the start, m."""
    points = np.array([scenario.start.position, *(scenario.guide or ()), scenario.goal.position])
    return float(np.hypot(*(points - points[0]).T).max())


def _stopping(scenario: Scenario, zones: Sequence[ThreatZone], name: str, time: float) -> Iterator[str]:
    """Say so if the vehicle would hit what is before it even if it only braked."""
    start, vehicle = scenario.start, scenario.vehicle
    if start.heading is None or start.speed == 0.0:
        return
    stop = start.speed / vehicle.max_deceleration
    if time > start.time + REPORT.late_stop * stop:
        return
    after = np.linspace(0.0, stop, REPORT.trip_looks)
    driven = start.speed * after - 0.5 * vehicle.max_deceleration * after**2
    positions = np.array(start.position) + driven[:, None] * [np.cos(start.heading), np.sin(start.heading)]
    distance = np.min([zone.signed_distance(start.time + after, positions) for zone in zones], axis=0)
    touching = np.flatnonzero(distance < vehicle.radius)
    if len(touching):
        yield (
            f"Straight on and braking at {vehicle.max_deceleration:g} m/s2 from {start.speed:g} m/s, it would touch"
            f" {name} at t = {start.time + after[touching[0]]:.3f} s"
        )


def _touched(scenario: Scenario, threat_zones: Sequence[ThreatZone], trip: Trip) -> list[str]:
    """Name the zones that a trip cuts or touches, the ones it cuts deepest first."""
    trajectory = trip.trajectory
    points = trajectory.at(trajectory.space.time_table(np.linspace(0.0, 1.0, REPORT.trip_looks)))
    times, positions = trip.frame.time + points.time, trip.frame.to_world(points.path.position)
    radius = scenario.vehicle.radius
    least = {
        name: min(float(zone.signed_distance(times, positions).min()) for zone in several) - radius
        for name, several in by_obstacle(threat_zones).items()
    }
    near = sorted((name for name in least if least[name] < REPORT.touching * radius), key=lambda name: least[name])
    return near[: REPORT.most_culprits]


def _no_way(scenario: Scenario, zones: tuple[ThreatZone, ...], culprits: list[str], deadline: float) -> Iterator[str]:
    """Say that there is no trip at all if that can be proved, and what is in its way."""
    start, latest = scenario.start.time, scenario.goal.latest_arrival
    least = kinematic_bound(scenario)
    horizon = REPORT.looked_ahead * least if latest is None else latest - start
    until = f"before t = {start + horizon:.4g} s" if latest is None else f"by t = {latest:.4g} s"
    if horizon < least * (1.0 - TRIP_ROUNDING):
        yield f"No trip arrives before t = {start + least:.4g} s, even with nothing in the way"
        return
    # The proof is about a goal that stands.
    if scenario.goal.target is not None or not no_trip_within(scenario, horizon, zones, deadline):
        return
    every = {name: several for name, several in by_obstacle(zones).items() if name in culprits}
    covering = [name for name, several in every.items() if _covers_goal(scenario, several, least, horizon)]
    if covering:
        yield f"No trip at all arrives {until}: {_listed(covering)} cover{'s' if len(covering) == 1 else ''} the goal"
        return
    others = {name: tuple(zone for zone in zones if zone.id != name) for name in culprits}
    needed = [name for name, rest in others.items() if not no_trip_within(scenario, horizon, rest, deadline)]
    if needed and scenario.bounds is not None:
        unbounded = scenario.model_copy(update={"bounds": None})
        if not no_trip_within(unbounded, horizon, zones, deadline):
            alone = [zone for zone in zones if [zone.id] == needed]
            gap = _widest_gap(scenario, alone[0], start + horizon) if len(alone) == 1 else ""
            needed.append(f"the workspace bounds{gap}")
    if not needed or perf_counter() > deadline:  # without the time to say which
        yield f"No trip at all arrives {until}"
    elif len(needed) == 1:
        yield f"No trip at all arrives {until}, unless {needed[0]} gives way"
    else:
        yield f"No trip at all arrives {until}, between {_listed(needed)}"


def _covers_goal(scenario: Scenario, zones: Sequence[ThreatZone], first: float, last: float) -> bool:
    """True if the zones of an obstacle leave no room at the goal, whenever a trip might arrive."""
    times = scenario.start.time + np.linspace(first, last, REPORT.trip_looks)
    goal = np.broadcast_to(np.array(scenario.goal.position), (REPORT.trip_looks, 2))
    distance = np.min([zone.signed_distance(times, goal) for zone in zones], axis=0)
    return bool(np.all(distance + scenario.goal.radius - scenario.vehicle.radius < 0.0))


def _widest_gap(scenario: Scenario, zone: ThreatZone, time: float) -> str:
    """Tell the room beside a zone in the workspace if the vehicle does not fit through, in brackets."""
    assert scenario.bounds is not None
    center = zone.center(time)
    gaps = []
    for axis in (0, 1):
        one = np.eye(2)[axis]
        high = scenario.bounds.max[axis] - float(center[axis] + zone.support(time, one))
        low = float(center[axis] - zone.support(time, -one)) - scenario.bounds.min[axis]
        gaps.append(max(high, low, 0.0))
    taken = 2.0 * scenario.vehicle.radius
    if min(gaps) >= taken:
        return ""
    return f" (at most {min(gaps):.3g} m between them; the vehicle takes {taken:.3g} m)"


def _counted(number: int, what: str) -> str:
    """Return a number of things, of which the first word is the noun."""
    noun, space, rest = what.partition(" ")
    return f"{number} {noun}{'' if number == 1 else 's'}{space}{rest}"


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
