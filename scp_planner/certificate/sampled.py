"""The certificate of a trip that is given by samples: of the motion that `trips.sampled_motion` makes of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from math import inf

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.cells import clearance_kept
from scp_planner.certificate.checked_trip import Checked, Finding
from scp_planner.certificate.clearance import leaves_bounds
from scp_planner.certificate.enclosures import Pieces
from scp_planner.certificate.ends import Course, EndState, beside_corridor
from scp_planner.certificate.excess import HardestStop
from scp_planner.certificate.limits import speed_limits_found
from scp_planner.certificate.passing import passes
from scp_planner.certificate.sampled_pieces import EnclosedSamples, PieceVelocities, first_pieces
from scp_planner.certificate.tolerances import (
    END_TOLERANCE,
    RELATIVE_TOLERANCE,
    REPORT_PRECISION,
    STANDING_TURN,
    TripUnit,
)
from scp_planner.certificate.verdict import BEYOND_ZONES, Certificate, Clearance, Ends, Violation
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.places import Line
from scp_planner.scenario.units import NaturalUnits
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.sorted_zones import known_until
from scp_planner.threat_zones.target import goal_on_arrival
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.sampled_motion import EndVelocity, SampledMotion, velocities
from scp_planner.trips.samples import SampledTrajectory

WORLD = PlanningFrame((0.0, 0.0), 0.0, 0.0)


def certify_samples(
    scenario: Scenario, samples: SampledTrajectory, threat_zones: Sequence[ThreatZone] | None = None
) -> Certificate:
    """Check samples of a trip against a scenario, in continuous time."""
    units = NaturalUnits.to_check(scenario, _length(samples))
    inside, given = units.scenario(scenario), samples.inside(units)
    found = ZonesOf(inside) if threat_zones is None else tuple(zone.inside(units) for zone in threat_zones)
    end, known = float(given.time[-1]), known_until(found)
    if end > known:
        beyond = Violation(BEYOND_ZONES, end, known, known)
        return Certificate(False, Clearance(-np.inf), {}, (beyond,)).outside(units)
    batch = ZoneBatch.of(found, WORLD, inside.vehicle.radius)
    return _CheckedSamples(inside, given, batch).run().outside(units)


class _CheckedSamples(Checked[EnclosedSamples]):
    """A motion given by samples under check; its clock is absolute time."""

    def __init__(self, scenario: Scenario, samples: SampledTrajectory, batch: ZoneBatch) -> None:
        start, goal = scenario.start, goal_on_arrival(scenario, float(samples.time[-1]))
        found = velocities(samples, EndVelocity(start.speed, start.heading), EndVelocity(goal.speed, goal.heading))
        self.scenario, self.batch = scenario, batch
        self.limits = Limits.of(scenario)
        self.motion = SampledMotion.between(samples, found)
        self.pieces = PieceVelocities.of(self.motion)
        self.first = float(self.motion.begin[0])
        top = float(np.hypot(*np.concatenate([self.pieces.first, self.pieces.last]).T).max())
        self.unit = TripUnit.of(scenario, _length(samples), samples.travel_time, top)

    @property
    def frame(self) -> PlanningFrame:
        return WORLD

    def absolute(self, clock: float) -> float:
        return float(clock)

    def enclosed(self, pieces: Pieces) -> EnclosedSamples:
        return EnclosedSamples(self.pieces, pieces)

    def followed(self, line: Line) -> tuple[Array, Array] | None:
        stations = line.followed(self.motion.position)
        return None if stations is None else (self.motion.begin, stations)

    def run(self) -> Certificate:
        """Check the motion by itself, then where it is."""
        found = {
            "speed": self._speed(),
            "acceleration": self._acceleration(),
            "curvature": self._across("curvature", self.limits.curvature, 3),
            "lateral_acceleration": self._across("lateral_acceleration", self.limits.lateral_acceleration, 1),
            **dict(self._further_limits()),
        }
        pieces = first_pieces(self.motion, self.zone_instants())
        enclosed, offsets = self.enclosed(pieces), self.scenario.vehicle.discs
        found |= speed_limits_found(self, pieces, enclosed)
        kept = clearance_kept(self, pieces, [enclosed.disc(offset) for offset in offsets], REPORT_PRECISION)
        outside = (leaves_bounds(self, pieces, enclosed, offset) for offset in offsets)
        violations = [
            *self._ends(),
            *self._directions(),
            *(violation for finding in found.values() for violation in finding.violations),
            *kept.violations,
            *(one for one in outside if one is not None),
        ]
        uses = {name: finding.use for name, finding in found.items()}
        return Certificate(not violations, kept.clearance, uses, tuple(violations))

    def _ends(self) -> Iterator[Violation]:
        motion, pieces = self.motion, self.pieces
        speeds = [float(np.hypot(*velocity)) for velocity in (motion.velocity[0], motion.velocity[-1])]
        rates = float(pieces.acceleration_at_begin[0]), float(pieces.acceleration_at_end[-1])
        times, places = (float(motion.begin[0]), float(motion.end[-1])), (motion.position[0], motion.position[-1])
        first, last = (EndState(times[k], _pair(places[k]), pieces.heading(-k), speeds[k], rates[k]) for k in (0, 1))
        wanted = self.scenario.start.heading
        if wanted is not None and first.speed == 0.0:
            missed = abs(np.remainder(first.heading - wanted + np.pi, 2.0 * np.pi) - np.pi)
            if missed <= STANDING_TURN:
                first = replace(first, heading=wanted)
        passed = passes(motion.at, *times, self.scenario, END_TOLERANCE * self.unit.length)
        yield from Course([first, first, last, last]).broken(self.scenario, Ends.BOTH, passed, self.unit)
        beside = beside_corridor(self.scenario, first, self.unit)
        if beside is not None:
            yield beside

    def _directions(self) -> Iterator[Violation]:
        """Violations by moving backwards, or turning on the spot."""
        pieces, vehicle = self.pieces, self.scenario.vehicle
        back = pieces.backwards
        if back.any():
            speed = np.where(back, np.hypot(*pieces.last.T), 0.0)
            worst = int(np.argmax(speed))
            yield self.broken("speed", -float(speed[worst]), 0.0, self.motion.end[worst])
        if vehicle.max_curvature is None and vehicle.max_curvature_rate is None and vehicle.discs == (0.0,):
            return  # it may turn as sharply as it likes, and where it stands on the spot
        turn = pieces.standing_turn
        worst = int(np.argmax(turn))
        if turn[worst] > STANDING_TURN:
            yield self.broken("turn while standing", float(turn[worst]), 0.0, self.motion.begin[worst])

    @cached_property
    def hardest_stop(self) -> HardestStop:
        start, speed = self.scenario.start, float(np.hypot(*self.pieces.first[0]))
        return HardestStop.from_state(speed, start.acceleration or 0.0, self.scenario.vehicle)

    def excused_until(self, after: float) -> float:
        stop, motion = self.hardest_stop, self.motion
        # Until the brakes are released the stop's speed is nowhere convex, as that of each piece is: its ends tell.
        latest = self.first + min(after, float(stop.time[3]))
        ends = np.minimum(motion.end[motion.begin < latest], latest)
        most = stop.speed_at(ends - self.first) + RELATIVE_TOLERANCE * stop.speed.max()
        slower = np.append(self._speed_at(ends) <= most, False)
        kept = int(np.argmin(slower))
        return float(ends[kept - 1]) if kept else self.first

    def _speed_at(self, times: Array) -> Array:
        piece = np.maximum(np.searchsorted(self.motion.begin, times, "left") - 1, 0)
        return np.hypot(*self.motion.velocity_at(piece, times).T)

    def _speed(self) -> Finding:
        """On each piece it is largest at an end."""
        limit = self.limits.speed
        begin = self.excused_until(self.hardest_stop.slows_to(limit))
        times = np.concatenate([np.maximum(self.motion.begin, begin), self.motion.end])[
            np.tile(self.motion.end >= begin, 2)
        ]
        speeds = self._speed_at(times)
        worst = int(np.argmax(speeds))
        return self._used("speed", float(speeds[worst]), limit, times[worst])

    def _acceleration(self) -> Finding:
        """Along the path it grows on each piece."""
        gained, lost = self.pieces.acceleration_at_end, self.pieces.acceleration_at_begin
        most, least = int(np.argmax(gained)), int(np.argmin(lost))
        up = self._used("acceleration", float(gained[most]), self.limits.acceleration, self.motion.end[most])
        down = self._used("acceleration", -float(lost[least]), self.limits.deceleration, self.motion.begin[least], -1.0)
        gains = up.use.worst / self.limits.acceleration >= -down.use.worst / self.limits.deceleration
        return Finding((up if gains else down).use, up.violations + down.violations)

    def _across(self, name: str, limit: float, power: int) -> Finding:
        """Cross product of velocity and acceleration, divided by a power of the speed."""
        pieces = self.pieces
        value = pieces.largest(np.abs(pieces.turn), power)
        worst = int(np.argmax(value))
        return self._used(name, float(value[worst]), limit, pieces.when_slowest[worst])

    def _further_limits(self) -> Iterator[tuple[str, Finding]]:
        vehicle, motion, pieces = self.scenario.vehicle, self.motion, self.pieces
        if vehicle.max_curvature_rate is not None:
            bends = pieces.turn != 0.0
            when = float(motion.begin[np.argmax(bends)])
            rate = inf if bends.any() else 0.0
            yield "curvature_rate", self._used("curvature_rate", rate, vehicle.max_curvature_rate, when)
        if vehicle.max_total_acceleration is not None:
            total = np.hypot(*motion.acceleration.T)
            worst = int(np.argmax(total))
            limit = vehicle.max_total_acceleration
            yield (
                "total_acceleration",
                self._used("total_acceleration", float(total[worst]), limit, motion.begin[worst]),
            )
        if vehicle.max_power is not None:
            # v . A grows with time.
            power = np.maximum((pieces.last * motion.acceleration).sum(axis=1), 0.0)
            worst = int(np.argmax(power))
            yield "power", self._used("power", float(power[worst]), vehicle.max_power, motion.end[worst])
        if vehicle.max_jerk is not None:
            yield "jerk", self._jerk(vehicle.max_jerk)

    def _jerk(self, limit: float) -> Finding:
        """Infinite where the acceleration along the path jumps; else (v x A)^2 / |v|^3, largest where it is slowest."""
        pieces = self.pieces
        jumps = np.abs(pieces.acceleration_at_begin[1:] - pieces.acceleration_at_end[:-1])
        jumping = jumps > RELATIVE_TOLERANCE * max(self.limits.acceleration, self.limits.deceleration)
        if jumping.any():
            return self._used("jerk", inf, limit, self.motion.end[np.argmax(jumping)])
        value = pieces.largest(pieces.turn**2, 3)
        worst = int(np.argmax(value))
        return self._used("jerk", float(value[worst]), limit, pieces.when_slowest[worst])

    def _used(self, name: str, value: float, limit: float, time: float, sign: float = 1.0) -> Finding:
        """Use of a limit by a quantity times a sign."""
        kept = value <= limit * (1.0 + RELATIVE_TOLERANCE)
        return self.finding(name, sign * value, sign * limit, time, kept=kept)


def _length(samples: SampledTrajectory) -> float:
    return float(np.hypot(*np.diff(samples.position, axis=0).T).sum())


def _pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])
