"""The certificate: whether a plan keeps every limit and every clearance at *all* times, not only at samples.

It is independent of the search for the plan: it uses the trip and the zones, and nothing of the optimisation. What it
shares with the planner is how a path and a drive are evaluated, the zones, and the ellipses and outlines in them.

Time is divided where a spline has a knot, so that on each interval [m - h, m + h] the offset f and the
acceleration are one polynomial each. Then, with interval enclosures of their derivatives on the interval:

- Clearance. For *any* fixed unit vector nu, l(t) = nu . (r(t) - eta(t)) - h_E(nu, t) - R is a lower bound of the
  signed distance. With nu taken at m,  l(m + d) >= l(m) - |l'(m)| h - K h^2 / 2, where K bounds
  |r''| + |eta''| + growth'' on the interval. For a zone that turns, nu turns with it, and K contains that.
- Curvature and lateral acceleration by the mean value form q(m) + [q'] h, q' enclosed by interval arithmetic.
- Speed and acceleration by the Bernstein coefficients of their pieces (convex hull), halved where that decides nothing.

For clearance, nu is the direction from the centre at first, for all intervals and zones at once, and the exact normal
where that does not decide. Intervals whose bound does not decide are halved or quartered, until all hold, a violation
is found at a midpoint, or the intervals get too short.

Of a trip that is driven on, limits that it was once found to keep are known (`Motions`); only the zones are new.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from scp_planner.certificate.checked_trip import WHOLE, CheckedTrip, Scope
from scp_planner.certificate.clearance import VehicleDisc, least_clearance, leaves_bounds
from scp_planner.certificate.limits import keeps_speed_later, limits_found
from scp_planner.certificate.remembered import KeptMotion, Motions
from scp_planner.certificate.sampled import certify_samples
from scp_planner.certificate.trip_ends import begins_beside, ends_broken
from scp_planner.certificate.verdict import (
    BEYOND_ZONES,
    CLEARANCE_TOLERANCE,
    POSITION_TOLERANCE,
    Certificate,
    Clearance,
    Ends,
    Violation,
)
from scp_planner.estimation.tracking import TrackingTube
from scp_planner.files import LARGEST_COORDINATE
from scp_planner.pauses import OutOfTimeError, look_at_the_clock
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.sorted_zones import known_until
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.samples import SampledTrajectory
from scp_planner.trips.trip import Trip


class HasTrip(Protocol):
    """What can be certified: a plan, and whatever else has a trip."""

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
    units = NaturalUnits.to_check(scenario)
    if not hasattr(plan, "trip"):
        raise TypeError(f"plan: must be a Plan or a SampledTrajectory, not {type(plan).__name__}")
    inside, trip = units.scenario(scenario), plan.trip.inside(units)
    found = ZonesOf(inside) if threat_zones is None else tuple(zone.inside(units) for zone in threat_zones)
    within = None if tube is None else tube.inside(units)
    return certify_trip(inside, trip, found, Scope(tube=within)).outside(units)


def certify_trip(
    scenario: Scenario,
    trip: Trip,
    threat_zones: Sequence[ThreatZone],
    scope: Scope = WHOLE,
    *,
    batch: ZoneBatch | None = None,
    motions: Motions | None = None,
) -> Certificate:
    """Check a trip against a scenario, both in its natural units, in continuous time. See :func:`certify`.

    Parameters
    ----------
    scenario : Scenario
    trip : Trip
    threat_zones : sequence of ThreatZone
    scope : Scope
    batch : ZoneBatch, optional
        The zones in the trip's frame, inflated by the vehicle's radius, if they are at hand.
    motions : Motions, optional
        What was found of trips that were checked before; what is found now is added.

    Returns
    -------
    Certificate
        One that does not hold and says nothing else, if there was no time for the check.
    """
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
    findings = limits_found(checked, limits, pieces, enclosure)
    violations += [violation for finding in findings.values() for violation in finding.violations]
    uses = {name: finding.use for name, finding in findings.items()}
    checked.go_on()
    discs = tuple(VehicleDisc.on(enclosure, offset, checked.tube) for offset in checked.scenario.vehicle.discs)
    outside = [one for one in (leaves_bounds(checked, pieces, disc) for disc in discs) if one is not None]
    known = motions is not None and checked.tube is None and not violations and not outside
    if motions is not None and known and keeps_speed_later(checked, limits):
        space, scenario = checked.trajectory.space, checked.scenario
        motions.add(checked.trip, KeptMotion(space, scenario, ends, checked.first, checked.last, pieces, discs, uses))
    kept = least_clearance(checked, pieces, discs, precision)
    violations += [*kept.violations, *outside]
    return Certificate(not violations, kept.clearance, uses, tuple(violations))


def _checked_again(checked: CheckedTrip, ends: Ends, precision: float, motions: Motions) -> Certificate | None:
    """Check the clearance alone, if the rest is known; None if that does not decide."""
    motion = motions.of(checked.trip)
    part = motion.part(checked) if motion is not None and motion.serves(checked, ends) else None
    if motion is None or part is None:
        return None
    kept = least_clearance(checked, part.pieces, part.discs, precision)
    if not kept.violations:
        return Certificate(True, kept.clearance, motion.limits)
    begun = checked.absolute(checked.first)
    if all(one.value < -CLEARANCE_TOLERANCE and one.time >= begun for one in kept.violations):
        return Certificate(False, kept.clearance, motion.limits, kept.violations)
    return None


def _never_arrives(trip: Trip) -> Violation | None:
    """What is wrong with a trip that takes no time, or for ever, or is no numbers: no bound says anything of it."""
    trajectory = trip.trajectory
    time = trajectory.travel_time
    if not (np.all(np.isfinite(trajectory.theta)) and np.all(np.isfinite(trajectory.beta))):
        time = np.nan
    if 0.0 < time <= LARGEST_COORDINATE:
        return None
    return Violation("travel time", time, LARGEST_COORDINATE, trip.frame.time)


def _is_anywhere(trip: Trip) -> Violation | None:
    """What is wrong with a trip whose positions are not known well enough: one with a cusp, or with absurd bends."""
    path = trip.trajectory.path
    error = path.space.guide.error + path.exact.error
    if error <= POSITION_TOLERANCE:
        return None
    return Violation("error of the positions", error, POSITION_TOLERANCE, trip.frame.time)


def _goes_beyond(checked: CheckedTrip, zones: Sequence[ThreatZone]) -> Violation | None:
    """What is wrong with a trip that takes longer than zones of observed obstacles are made for."""
    end, known = checked.absolute(checked.last), known_until(zones)
    return Violation(BEYOND_ZONES, end, known, known) if end > known else None
