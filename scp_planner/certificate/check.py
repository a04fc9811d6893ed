"""The certificate: whether a plan keeps every limit and every clearance at *all* times, not only at samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from scp_planner.certificate.cells import clearance_kept
from scp_planner.certificate.checked_trip import WHOLE, CheckedTrip, Scope
from scp_planner.certificate.clearance import leaves_bounds
from scp_planner.certificate.ends import Course, EndState, beside_corridor
from scp_planner.certificate.limits import limits_found
from scp_planner.certificate.passing import Pass, passes_of
from scp_planner.certificate.remembered import KeptMotion, Motions
from scp_planner.certificate.sampled import certify_samples
from scp_planner.certificate.tolerances import END_TOLERANCE, LENGTH_TOLERANCE, TripUnit
from scp_planner.certificate.verdict import BEYOND_ZONES, Certificate, Clearance, Ends, LimitUse, Violation
from scp_planner.files import LARGEST_COORDINATE
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.pauses import OutOfTimeError, look_at_the_clock
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.reversing import backwards, with_lines
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.error_tube import TrackingTube
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.sorted_zones import known_until
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.guide import StraightGuide
from scp_planner.trips.legs import Leg, Legs, Pause
from scp_planner.trips.path import Path
from scp_planner.trips.samples import SampledTrajectory
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip


class HasTrip(Protocol):
    """Anything with a trip, such as a plan."""

    @property
    def trip(self) -> Trip:
        """The trip, in world coordinates and absolute time."""
        ...


def certify(
    scenario: Scenario,
    plan: HasTrip | SampledTrajectory,
    threat_zones: Sequence[ThreatZone] | None = None,
    *,
    tube: TrackingTube | None = None,
    deadline: float = np.inf,
) -> Certificate:
    """Check a plan against a scenario in continuous time, whoever made it.

    Parameters
    ----------
    scenario : Scenario
    plan : Plan or SampledTrajectory
        Or whatever else has a ``trip``.
    threat_zones : sequence of ThreatZone, optional
        The scenario's zones, if they are at hand.
    tube : TrackingTube, optional
        How far the vehicle may be from the trip, by speed and lateral acceleration. Wherever it may be, it is to keep
        clear, and in the workspace. On each piece of a trip that is by its own speed and turns; for samples it is the
        largest that the vehicle may make of it.
    deadline : float
        Value of :func:`time.perf_counter` at which the check of a plan is given up, s: then it does not hold.

    Returns
    -------
    Certificate

    Raises
    ------
    EstimationError
        If the vehicle may drive or turn faster than the tube was recorded for.
    TypeError
        If the scenario or the plan is something else.
    """
    if tube is not None:
        widest = tube.bound(scenario.vehicle)
    if isinstance(plan, SampledTrajectory):
        if tube is not None:
            wider = scenario.vehicle.model_copy(update={"radius": scenario.vehicle.radius + widest})
            scenario = scenario.model_copy(update={"vehicle": wider})
        return certify_samples(scenario, plan, threat_zones)
    if not hasattr(plan, "trip"):
        NaturalUnits.of(scenario)  # which refuses what is no scenario
        raise TypeError(f"plan: must be a Plan or a SampledTrajectory, not {type(plan).__name__}")
    driven: Trip | Legs = getattr(plan, "legs", None) or plan.trip
    units = NaturalUnits.to_check(scenario, _distance(_legs(driven)))
    inside = units.scenario(scenario)
    found = ZonesOf(inside) if threat_zones is None else tuple(zone.inside(units) for zone in threat_zones)
    scope = Scope(tube=None if tube is None else tube.inside(units), deadline=deadline)
    return certify_trip(inside, driven.inside(units), found, scope).outside(units)


def certify_trip(
    scenario: Scenario,
    driven: Trip | Legs,
    threat_zones: Sequence[ThreatZone],
    scope: Scope = WHOLE,
    *,
    batch: ZoneBatch | None = None,
    motions: Motions | None = None,
) -> Certificate:
    """Check a drive against a scenario, both in its natural units, in continuous time: a trip is its only leg."""
    scenario, legs = with_lines(scenario), _legs(driven)
    unfit = next(filter(None, (_is_unfit(scenario, leg) for leg in legs)), None)
    if unfit is None:
        unit = TripUnit.of_trips(scenario, [leg.trip for leg in legs])
        unfit = next(filter(None, (_is_anywhere(leg.trip, unit) for leg in legs)), None)
    if unfit is not None:
        return Certificate(False, Clearance(-np.inf), {}, (unfit,))
    try:
        look_at_the_clock(scope.deadline)
        parts = list[CheckedTrip]()
        for scene, trip in _parts(scenario, driven):
            zones = ZoneBatch.of(threat_zones, trip.frame, scene.vehicle.radius) if batch is None else batch
            parts.append(CheckedTrip.of(scene, trip, zones, scope, unit))
        beyond = next(filter(None, (_goes_beyond(part, threat_zones) for part in parts)), None)
        if beyond is not None:
            return Certificate(False, Clearance(-np.inf), {}, (beyond,))
        return _checked(scenario, driven, parts, scope, motions)
    except OutOfTimeError:
        return Certificate(False, Clearance(-np.inf), {})


def _legs(driven: Trip | Legs) -> Sequence[Leg]:
    return driven.legs if isinstance(driven, Legs) else (Leg(driven),)


def _distance(legs: Sequence[Leg]) -> float:
    """Distance that is driven; no number if the drive is none."""
    return sum(leg.trip.trajectory.driven_length for leg in legs)


def _parts(scenario: Scenario, driven: Trip | Legs) -> Iterator[tuple[Scenario, Trip]]:
    """Pauses and legs in order, as trips of a vehicle that drives ahead, and what each is checked against."""
    if isinstance(driven, Trip):
        yield scenario, driven
        return
    rest = changed(scenario, start=changed(scenario.start, speed=0.0))
    for number, pause in enumerate(driven.pauses):
        if pause.end.time > pause.begin.time:
            yield rest, _standing_trip(pause)
        if number < len(driven.legs):
            leg, scene = driven.legs[number], rest if number else scenario
            yield backwards(scene) if leg.backward else scene, leg.trip


def _standing_trip(pause: Pause) -> Trip:
    """The trip that stands for as long as a pause."""
    space = TripSpace(StraightGuide(1.0), 0.0, 3, 4, 0, (0.0, 1.0))
    still = Trajectory(Path(space, np.zeros(space.path_size)), np.zeros(1), pause.end.time - pause.begin.time)
    return Trip(PlanningFrame(pause.position, pause.end.heading, pause.begin.time), still)


def _checked(
    scenario: Scenario, driven: Trip | Legs, parts: Sequence[CheckedTrip], scope: Scope, motions: Motions | None
) -> Certificate:
    """Check the parts of a drive, of which something may be known, and all together."""
    ends, found = scope.ends, list[Certificate]()
    if scope.since is not None:
        ends &= Ends.GOAL
        known = None if motions is None else _checked_again(parts[0], ends, scope.precision, motions)
        found = [] if known is None else [known]
    if not found:
        broken = _broken(scenario, driven, ends, scope.since, parts[0].unit)
        found = [Certificate(not broken, Clearance(np.inf), {}, broken)] if len(parts) > 1 else []
        known_to_break = broken if len(parts) == 1 else ()
        found += [_checked_whole(part, ends, scope.precision, motions, known_to_break) for part in parts]
    beside = [_begins_beside(part) for part in parts] if all(one.holds for one in found) else []
    violations = [*(each for one in found for each in one.violations), *filter(None, beside)]
    clearance = min((one.clearance for one in found), key=lambda one: one.minimum)
    return Certificate(not violations, clearance, _worst([one.limits for one in found]), tuple(violations))


def _broken(
    scenario: Scenario, driven: Trip | Legs, ends: Ends, since: float | None, unit: TripUnit
) -> tuple[Violation, ...]:
    """Return what a drive breaks at its ends, at the places on its way, and between its legs."""
    if not ends and isinstance(driven, Trip):
        return ()
    course = Course.of(_legs(driven))
    if isinstance(driven, Legs):
        course = course.between(driven.first, driven.last, unit)
    passed: Sequence[Pass] = ()
    if Ends.GOAL in ends and scenario.goals:
        passed = passes_of(driven, scenario, since, END_TOLERANCE * unit.length)
    return tuple(course.broken(scenario, ends, passed, unit))


def _checked_whole(
    checked: CheckedTrip, ends: Ends, precision: float, motions: Motions | None, broken: Sequence[Violation]
) -> Certificate:
    """Check all of a trip, and remember it if it keeps all limits and breaks nothing else."""
    limits = Limits.of(checked.scenario)
    pieces = checked.first_pieces(precision)
    enclosure = checked.enclosed(pieces)
    violations = [*_beyond_path(checked), *broken]
    findings = limits_found(checked, limits, pieces, enclosure)
    violations += [violation for finding in findings.values() for violation in finding.violations]
    uses = {name: finding.use for name, finding in findings.items()}
    checked.go_on()
    offsets = checked.scenario.vehicle.discs
    discs = tuple(enclosure.disc(offset) for offset in offsets)
    beyond = (leaves_bounds(checked, pieces, enclosure, offset) for offset in offsets)
    outside = [one for one in beyond if one is not None]
    known = motions is not None and checked.tube is None and not violations and not outside
    if motions is not None and known:
        space, scenario = checked.trajectory.space, checked.scenario
        motions.add(checked.trip, KeptMotion(space, scenario, ends, checked.first, checked.last, pieces, discs, uses))
    kept = clearance_kept(checked, pieces, discs, precision)
    violations += [*kept.violations, *outside]
    return Certificate(not violations, kept.clearance, uses, tuple(violations))


def _checked_again(checked: CheckedTrip, ends: Ends, precision: float, motions: Motions) -> Certificate | None:
    """Check the clearance alone, if the rest is known; None if that does not decide."""
    motion = motions.of(checked.trip)
    part = motion.part(checked) if motion is not None and motion.serves(checked, ends) else None
    if motion is None or part is None:
        return None
    kept = clearance_kept(checked, part.pieces, part.discs, precision)
    if not kept.violations:
        return Certificate(True, kept.clearance, motion.limits)
    begun = checked.absolute(checked.first)
    if all(one.value < -one.rounding and one.time >= begun for one in kept.violations):
        return Certificate(False, kept.clearance, motion.limits, kept.violations)
    return None


def _is_unfit(scenario: Scenario, leg: Leg) -> Violation | None:
    """Violation by a leg for which no bound holds: backwards without a reverse gear, or that never arrives."""
    if leg.backward and scenario.vehicle.reverse is None:
        return Violation("speed", -leg.trip.trajectory.path.arc_length, 0.0, leg.begin)
    return _never_arrives(leg.trip)


def _never_arrives(trip: Trip) -> Violation | None:
    """Violation by a trip that takes no time, or for ever, or is not a number: no bound holds for it."""
    trajectory = trip.trajectory
    time = trajectory.travel_time
    if not (np.all(np.isfinite(trajectory.theta)) and np.all(np.isfinite(trajectory.beta))):
        time = np.nan
    if 0.0 < time <= LARGEST_COORDINATE:
        return None
    return Violation("travel time", time, LARGEST_COORDINATE, trip.frame.time)


def _is_anywhere(trip: Trip, unit: TripUnit) -> Violation | None:
    """Violation by a trip whose positions are not known well enough: one with a cusp, or absurd curvature."""
    path = trip.trajectory.path
    error = path.space.guide.error + path.exact.error
    allowed = LENGTH_TOLERANCE * unit.length
    return None if error <= allowed else Violation("error of the positions", error, allowed, trip.frame.time)


def _beyond_path(checked: CheckedTrip) -> Iterator[Violation]:
    """Tell of a trip that goes on beyond its path: it would be held at the goal, at a speed that it does not have."""
    trajectory = checked.trajectory
    beyond = trajectory.driven_length - trajectory.path.driven_length
    if not beyond <= END_TOLERANCE * checked.unit.length:
        yield Violation("distance beyond the path", beyond, 0.0, checked.absolute(1.0))


def _begins_beside(checked: CheckedTrip) -> Violation | None:
    """Return where what is checked of a trip begins beside the corridor; None where it begins in it."""
    if checked.scenario.corridor is None:
        return None
    (first,) = EndState.along(Leg(checked.trip), (checked.first,))
    return beside_corridor(checked.scenario, first, checked.unit)


def _goes_beyond(checked: CheckedTrip, zones: Sequence[ThreatZone]) -> Violation | None:
    """Violation by a trip that takes longer than zones of observed obstacles are made for."""
    end, known = checked.absolute(checked.last), known_until(zones)
    return Violation(BEYOND_ZONES, end, known, known) if end > known else None


def _worst(several: Sequence[dict[str, LimitUse]]) -> dict[str, LimitUse]:
    """The use of each limit that comes nearest to it."""
    worst: dict[str, LimitUse] = {}
    for uses in several:
        for name, use in uses.items():
            if name not in worst or _share(use) > _share(worst[name]):
                worst[name] = use
    return worst


def _share(use: LimitUse) -> float:
    return abs(use.worst) if use.limit is None else use.worst / use.limit
