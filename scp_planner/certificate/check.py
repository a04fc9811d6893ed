"""The certificate: whether a plan keeps every limit and every clearance at *all* times, not only at samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from scp_planner.certificate.cells import clearance_kept
from scp_planner.certificate.checked_trip import WHOLE, CheckedTrip, Scope
from scp_planner.certificate.clearance import leaves_bounds
from scp_planner.certificate.ends import begins_beside, ends_broken
from scp_planner.certificate.legs import certify_legs
from scp_planner.certificate.limits import limits_found
from scp_planner.certificate.passing import passes_of, places_missed
from scp_planner.certificate.remembered import KeptMotion, Motions
from scp_planner.certificate.sampled import certify_samples
from scp_planner.certificate.tolerances import LENGTH_TOLERANCE
from scp_planner.certificate.verdict import BEYOND_ZONES, Certificate, Clearance, Ends, Violation
from scp_planner.files import LARGEST_COORDINATE
from scp_planner.pauses import OutOfTimeError, look_at_the_clock
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.error_tube import TrackingTube
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.sorted_zones import known_until
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.legs import Legs
from scp_planner.trips.samples import SampledTrajectory
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
        NaturalUnits.to_check(scenario)  # which refuses what is no scenario
        raise TypeError(f"plan: must be a Plan or a SampledTrajectory, not {type(plan).__name__}")
    legs: Legs | None = getattr(plan, "legs", None)
    units = NaturalUnits.to_check(scenario, None if legs is None else legs.length)
    inside = units.scenario(scenario)
    found = ZonesOf(inside) if threat_zones is None else tuple(zone.inside(units) for zone in threat_zones)
    scope = Scope(tube=None if tube is None else tube.inside(units))
    if legs is None:
        return certify_trip(inside, plan.trip.inside(units), found, scope).outside(units)

    def check(scene: Scenario, trip: Trip, part: Scope) -> Certificate:
        return certify_trip(scene, trip, found, part)

    return certify_legs(inside, legs.inside(units), scope, check).outside(units)


def certify_trip(
    scenario: Scenario,
    trip: Trip,
    threat_zones: Sequence[ThreatZone],
    scope: Scope = WHOLE,
    *,
    batch: ZoneBatch | None = None,
    motions: Motions | None = None,
) -> Certificate:
    """Check a trip against a scenario, both in its natural units, in continuous time."""
    unfit = _never_arrives(trip) or _is_anywhere(trip)
    if unfit is not None:
        return Certificate(False, Clearance(-np.inf), {}, (unfit,))
    try:
        look_at_the_clock(scope.deadline)
        if batch is None:
            batch = ZoneBatch.of(threat_zones, trip.frame, scenario.vehicle.radius)
        checked = CheckedTrip.of(scenario, trip, batch, scope)
        beyond = _goes_beyond(checked, threat_zones)
        if beyond is not None:
            return Certificate(False, Clearance(-np.inf), {}, (beyond,))
        return _checked(checked, scope, motions)
    except OutOfTimeError:
        return Certificate(False, Clearance(-np.inf), {})


def _checked(checked: CheckedTrip, scope: Scope, motions: Motions | None) -> Certificate:
    """Check a trip, of which something may be known."""
    ends, found = scope.ends, None
    if scope.since is not None:
        ends &= Ends.GOAL
        found = None if motions is None else _checked_again(checked, ends, scope.precision, motions)
    if found is None:
        found = _checked_whole(checked, ends, scope.precision, motions)
    beside = begins_beside(checked) if found.holds else None
    return found if beside is None else replace(found, holds=False, violations=(beside,))


def _checked_whole(checked: CheckedTrip, ends: Ends, precision: float, motions: Motions | None) -> Certificate:
    """Check all of a trip, and remember it if it keeps all limits."""
    limits = Limits.of(checked.scenario)
    pieces = checked.first_pieces(precision)
    enclosure = checked.enclosed(pieces)
    violations = list(ends_broken(checked, ends))
    if Ends.GOAL in ends and checked.scenario.goals:
        found = passes_of(checked.trip, checked.scenario, checked.absolute(checked.first))
        violations += places_missed(found, checked.scenario)
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
    if all(one.value < -LENGTH_TOLERANCE and one.time >= begun for one in kept.violations):
        return Certificate(False, kept.clearance, motion.limits, kept.violations)
    return None


def _never_arrives(trip: Trip) -> Violation | None:
    """Violation by a trip that takes no time, or for ever, or is not a number: no bound holds for it."""
    trajectory = trip.trajectory
    time = trajectory.travel_time
    if not (np.all(np.isfinite(trajectory.theta)) and np.all(np.isfinite(trajectory.beta))):
        time = np.nan
    if 0.0 < time <= LARGEST_COORDINATE:
        return None
    return Violation("travel time", time, LARGEST_COORDINATE, trip.frame.time)


def _is_anywhere(trip: Trip) -> Violation | None:
    """Violation by a trip whose positions are not known well enough: one with a cusp, or absurd curvature."""
    path = trip.trajectory.path
    error = path.space.guide.error + path.exact.error
    if error <= LENGTH_TOLERANCE:
        return None
    return Violation("error of the positions", error, LENGTH_TOLERANCE, trip.frame.time)


def _goes_beyond(checked: CheckedTrip, zones: Sequence[ThreatZone]) -> Violation | None:
    """Violation by a trip that takes longer than zones of observed obstacles are made for."""
    end, known = checked.absolute(checked.last), known_until(zones)
    return Violation(BEYOND_ZONES, end, known, known) if end > known else None
