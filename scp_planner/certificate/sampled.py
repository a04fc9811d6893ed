"""The certificate of a trip that is given by samples: of the motion that `trips.sampled_motion` makes of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.certificate.cells import CellsRound
from scp_planner.certificate.ends import (
    EndState,
    beside_corridor,
    goal_violations,
    sets_out_backwards,
    start_violations,
)
from scp_planner.certificate.passing import passes, places_missed
from scp_planner.certificate.sampled_pieces import Parts, PieceVelocities, first_parts
from scp_planner.certificate.tolerances import (
    END_TOLERANCE,
    LENGTH_TOLERANCE,
    RELATIVE_TOLERANCE,
    REPORT_PRECISION,
    STANDING_TURN,
)
from scp_planner.certificate.verdict import BEYOND_ZONES, Certificate, Clearance, LimitUse, Violation
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.occupancy import NAME, OccupancyMap
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.places import Stretch, stretches
from scp_planner.scenario.units import NaturalUnits
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.bounds import ZoneBounds
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.sorted_zones import known_until
from scp_planner.threat_zones.target import goal_on_arrival
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.sampled_motion import EndVelocity, SampledMotion, velocities
from scp_planner.trips.samples import SampledTrajectory


@dataclass(frozen=True)
class SampledEffort:
    """Most work that is done to check a motion given by samples."""

    most_halvings: int = 40  # of a piece; then it is at a distance that no halving decides
    most_parts: int = 20_000  # still undecided: along a zone at exactly no distance, no halving decides
    most_pairs: int = 1_000_000  # of parts and zones that are looked at together
    first_pairs: int = 8  # with which the least clearance is looked for


EFFORT = SampledEffort()


def certify_samples(
    scenario: Scenario, samples: SampledTrajectory, threat_zones: Sequence[ThreatZone] | None = None
) -> Certificate:
    """Check samples of a trip against a scenario, in continuous time."""
    units = NaturalUnits.to_check(scenario)
    inside, given = units.scenario(scenario), samples.inside(units)
    found = ZonesOf(inside) if threat_zones is None else tuple(zone.inside(units) for zone in threat_zones)
    end, known = float(given.time[-1]), known_until(found)
    if end > known:
        beyond = Violation(BEYOND_ZONES, end, known, known)
        return Certificate(False, Clearance(-np.inf), {}, (beyond,)).outside(units)
    frame = PlanningFrame((0.0, 0.0), 0.0, 0.0)
    batch = ZoneBatch.of(found, frame, inside.vehicle.radius)
    return _SampledCheck(inside, given, batch).run().outside(units)


class _SampledCheck:
    def __init__(self, scenario: Scenario, samples: SampledTrajectory, batch: ZoneBatch) -> None:
        start, goal = scenario.start, goal_on_arrival(scenario, float(samples.time[-1]))
        found = velocities(samples, EndVelocity(start.speed, start.heading), EndVelocity(goal.speed, goal.heading))
        self.scenario, self.batch = scenario, batch
        self.limits = Limits.of(scenario)
        self.motion = SampledMotion.between(samples, found)
        self.pieces = PieceVelocities.of(self.motion)
        self.violations: list[Violation] = []

    def run(self) -> Certificate:
        self._ends()
        self._directions()
        limits = {
            "speed": self._speed(),
            "acceleration": self._acceleration(),
            "curvature": self._across("curvature", self.limits.curvature, 3),
            "lateral_acceleration": self._across("lateral_acceleration", self.limits.lateral_acceleration, 1),
            **dict(self._further_limits()),
        }
        for number, part in enumerate(stretches(self.scenario)):
            limits[f"speed_limits[{number}]"] = self._speed_limit(f"speed_limits[{number}]", part)
        clearance = self._clearances()
        for offset in self.scenario.vehicle.discs:
            self._bounds(offset)
        return Certificate(not self.violations, clearance, limits, tuple(self.violations))

    # The motion by itself

    def _ends(self) -> None:
        motion, pieces = self.motion, self.pieces
        first = EndState(
            float(motion.begin[0]),
            _pair(motion.position[0]),
            pieces.heading(0),
            float(np.hypot(*motion.velocity[0])),
            float(pieces.acceleration_at_begin[0]),
        )
        last = EndState(
            float(motion.end[-1]),
            _pair(motion.position[-1]),
            pieces.heading(-1),
            float(np.hypot(*motion.velocity[-1])),
            float(pieces.acceleration_at_end[-1]),
        )
        wanted = self.scenario.start.heading
        if wanted is not None and first.speed == 0.0:
            missed = abs(np.remainder(first.heading - wanted + np.pi, 2.0 * np.pi) - np.pi)
            if missed <= STANDING_TURN:
                first = EndState(first.time, first.position, wanted, first.speed, first.acceleration)
        backwards = sets_out_backwards(self.scenario, first)
        self.violations += start_violations(self.scenario, first)
        found = passes(motion.at, first.time, last.time, self.scenario)
        self.violations += places_missed(found, self.scenario)
        self.violations += goal_violations(self.scenario, last, first.time, backwards)
        beside = beside_corridor(self.scenario, first.time, first.position, first.heading)
        self.violations += [] if beside is None else [beside]

    def _directions(self) -> None:
        """Violations by moving backwards, or turning on the spot."""
        pieces, vehicle = self.pieces, self.scenario.vehicle
        back = pieces.backwards
        if back.any():
            speed = np.where(back, np.hypot(*pieces.last.T), 0.0)
            worst = int(np.argmax(speed))
            self._note("speed", -float(speed[worst]), 0.0, self.motion.end[worst], True)
        if vehicle.max_curvature is None and vehicle.max_curvature_rate is None and vehicle.discs == (0.0,):
            return  # it may turn as sharply as it likes, and where it stands on the spot
        turn = pieces.standing_turn
        worst = int(np.argmax(turn))
        if turn[worst] > STANDING_TURN:
            self._note("turn while standing", float(turn[worst]), 0.0, self.motion.begin[worst], True)

    def _speed(self) -> LimitUse:
        speeds = np.hypot(*np.concatenate([self.pieces.first, self.pieces.last]).T)
        times = np.concatenate([self.motion.begin, self.motion.end])
        worst = int(np.argmax(speeds))
        # Driving faster than allowed at the start is the scenario's business, not the trip's.
        top = max(self.limits.speed, self.scenario.start.speed)
        use = LimitUse(float(speeds[worst]), self.limits.speed, float(times[worst]))
        self._note("speed", use.worst, top, use.time, not use.worst <= top * (1.0 + RELATIVE_TOLERANCE))
        return use

    def _acceleration(self) -> LimitUse:
        """Along the path it grows on each piece."""
        gained, lost = self.pieces.acceleration_at_end, self.pieces.acceleration_at_begin
        most, least = int(np.argmax(gained)), int(np.argmin(lost))
        up = self._used("acceleration", float(gained[most]), self.limits.acceleration, self.motion.end[most])
        down = self._used("acceleration", -float(lost[least]), self.limits.deceleration, self.motion.begin[least], -1.0)
        return up if up.worst / self.limits.acceleration >= -down.worst / self.limits.deceleration else down

    def _across(self, name: str, limit: float, power: int) -> LimitUse:
        """Cross product of velocity and acceleration, divided by a power of the speed."""
        pieces = self.pieces
        value = pieces.largest(np.abs(pieces.turn), power)
        worst = int(np.argmax(value))
        return self._used(name, float(value[worst]), limit, pieces.when_slowest[worst])

    def _further_limits(self) -> Iterator[tuple[str, LimitUse]]:
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

    def _jerk(self, limit: float) -> LimitUse:
        """Infinite where the acceleration along the path jumps; else (v x A)^2 / |v|^3, largest where it is slowest."""
        pieces = self.pieces
        jumps = np.abs(pieces.acceleration_at_begin[1:] - pieces.acceleration_at_end[:-1])
        jumping = jumps > RELATIVE_TOLERANCE * max(self.limits.acceleration, self.limits.deceleration)
        if jumping.any():
            return self._used("jerk", inf, limit, self.motion.end[np.argmax(jumping)])
        value = pieces.largest(pieces.turn**2, 3)
        worst = int(np.argmax(value))
        return self._used("jerk", float(value[worst]), limit, pieces.when_slowest[worst])

    def _used(self, name: str, value: float, limit: float, time: float, sign: float = 1.0) -> LimitUse:
        """Use of a limit by a quantity times a sign; noted if it is broken."""
        broken = not value <= limit * (1.0 + RELATIVE_TOLERANCE)
        self._note(name, sign * value, sign * limit, time, broken)
        return LimitUse(sign * value, sign * limit if np.isfinite(limit) else None, float(time))

    def _note(
        self, what: str, value: float, allowed: float, time: float, broken: bool, obstacle: str | None = None
    ) -> None:
        if broken:
            self.violations.append(Violation(what, value, allowed, float(time), obstacle))

    # Where it is

    @cached_property
    def _parts(self) -> Parts:
        """Intervals of time, none across the end of a piece, or a time at which a zone's polynomials change."""
        polynomials = [one for one in (self.batch.centers, self.batch.covariances) if one is not None]
        knots = np.unique(np.concatenate([np.zeros(0), *(one.breakpoints[:, 1:-1].ravel() for one in polynomials)]))
        return first_parts(self.motion, knots[np.isfinite(knots)])

    def _speed_limit(self, name: str, part: Stretch) -> LimitUse:
        """The speed wherever the vehicle may be in a stretch of a line."""
        allowed = part.speed * (1.0 + RELATIVE_TOLERANCE)
        parts, best, when = self._parts, 0.0, float(self.motion.begin[0])
        driven = part.line.followed(self.motion.position)
        for _ in range(EFFORT.most_halvings):
            disc = self.pieces.disc(parts, 0.0)
            about = None if driven is None else np.interp(disc.time, self.motion.begin, driven)
            speed, half = np.hypot(*disc.velocity.T), disc.half
            fastest = speed + disc.acceleration * half
            station = part.line.nearest(disc.position, about)
            there = np.flatnonzero((station >= part.first) & (station <= part.last))
            if len(there) and speed[there].max() > best:
                worst = there[int(np.argmax(speed[there]))]
                best, when = float(speed[worst]), float(disc.time[worst])
            undecided = fastest > allowed
            undecided[undecided] = part.line.may_be_between(
                disc.position[undecided],
                (fastest * half)[undecided] + END_TOLERANCE,
                part.first,
                part.last,
                None if about is None else about[undecided],
            )
            if best > allowed or not undecided.any():
                return self._used(name, best, part.speed, when)
            parts = parts.halves(undecided)
        self._note(name, best, part.speed, when, True)
        return LimitUse(best, part.speed, when)

    def _bounds(self, offset: float) -> None:
        """Violations of the workspace box by a disc of the vehicle."""
        box, radius = self.scenario.bounds, self.scenario.vehicle.radius
        if box is None:
            return
        normals = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        offsets = np.array([box.min[0], -box.max[0], box.min[1], -box.max[1]]) + radius + self._turned(offset)
        parts, least, when = self._parts, 0.0, 0.0
        for _ in range(EFFORT.most_halvings):
            disc = self.pieces.disc(parts, offset)
            half = disc.half[:, None]
            inside = disc.position @ normals.T - offsets
            lower = inside - np.abs(disc.velocity @ normals.T) * half - 0.5 * disc.acceleration[:, None] * half**2
            worst = np.unravel_index(int(np.argmin(inside)), inside.shape)
            least, when = float(inside[worst]), float(disc.time[worst[0]])
            undecided = ~(lower >= -END_TOLERANCE).all(axis=1)
            if not undecided.any():
                return
            if least < -END_TOLERANCE:
                break
            parts = parts.halves(undecided)
        self._note("workspace bounds", least, 0.0, when, True)

    def _turned(self, offset: float) -> float:
        """Largest distance of a disc from its course where the vehicle stands and turns by very little, m."""
        return 0.5 * abs(offset) * min(float(self.pieces.standing_turn.max()), STANDING_TURN)

    def _clearances(self) -> Clearance:
        found = [self._clearance(offset) for offset in self.scenario.vehicle.discs]
        if self.scenario.ground is not None:
            found += [
                self._clearance_of_cells(offset, self.scenario.ground.map) for offset in self.scenario.vehicle.discs
            ]
        return min(found, key=lambda one: one.minimum)

    def _clearance_of_cells(self, offset: float, ground: OccupancyMap) -> Clearance:
        """Least clearance of a disc that is so far ahead of the reference point from the cells of a map."""
        keep = self.scenario.vehicle.radius + self._turned(offset)
        parts, certified, least, when = self._parts, inf, inf, 0.0
        disc = self.pieces.disc(parts, offset)
        near = CellsRound(ground, keep)
        for _ in range(EFFORT.most_halvings):
            value, lower = near.distances(disc)
            value, lower = value - keep, lower - keep
            worst = int(np.argmin(value))
            if value[worst] < least:
                least, when = float(value[worst]), float(disc.time[worst])
            certified = min(certified, float(lower[lower >= 0.0].min(initial=inf)))
            if not least >= 0.0 or (lower >= 0.0).all():
                break
            parts = parts.halves(lower < 0.0)
            disc = self.pieces.disc(parts, offset)
        if least < 0.0 or not (lower >= 0.0).all():
            self._note("clearance", min(least, 0.0), 0.0, when, True, NAME)
            return Clearance(min(least, 0.0), NAME, when)
        return Clearance(certified, NAME, when)

    def _clearance(self, offset: float) -> Clearance:
        """Least clearance of a disc that is so far ahead of the reference point."""
        if self.batch.size == 0:
            return Clearance(inf)
        nearest = _DiscClearance(self.batch, self.pieces, offset)
        for parts in self._parts.chunks(max(EFFORT.most_pairs // self.batch.size, 1)):
            nearest.look(parts)
            if nearest.certified < 0.0:
                break
        identity = self.batch.ids[nearest.zone]
        certified = nearest.certified - self._turned(offset)
        if certified < 0.0:
            self._note("clearance", min(nearest.least, certified), 0.0, nearest.when, True, identity)
            return Clearance(min(nearest.least, certified), identity, nearest.when)
        return Clearance(certified, identity, nearest.when)


class _DiscClearance:
    """The least clearance of a disc of the vehicle, as far as it has been looked at."""

    def __init__(self, batch: ZoneBatch, pieces: PieceVelocities, offset: float) -> None:
        self._bounds, self._pieces, self._offset = ZoneBounds(batch), pieces, offset
        self.certified, self.least, self.when, self.zone = inf, inf, float(pieces.motion.begin[0]), 0

    def look(self, parts: Parts) -> None:
        """Look at parts of the motion, all zones."""
        moving = self._pieces.disc(parts, self._offset)
        crude = self._bounds.crude(moving)
        some = np.argpartition(crude, min(EFFORT.first_pairs, crude.size) - 1, axis=None)[: EFFORT.first_pairs]
        interval, zone = np.unravel_index(some, crude.shape)
        self._keep(self._bounds.fine(zone, interval, moving).value, zone, moving.time[interval])
        far = crude >= max(self.least - REPORT_PRECISION, 0.0)
        self.certified = min(self.certified, float(crude[far].min(initial=inf)))
        interval, zone = np.nonzero(~far)
        for _ in range(EFFORT.most_halvings):
            if not len(interval):
                return
            bound = self._bounds.fine(zone, interval, moving)
            self._keep(bound.value, zone, moving.time[interval])
            if not self.least >= -LENGTH_TOLERANCE:
                self.certified = self.least
                return
            done: Mask = (bound.lower >= 0.0) & (bound.lower >= self.least - REPORT_PRECISION)
            self.certified = min(self.certified, float(bound.lower[done].min(initial=inf)))
            open_parts, inverse = np.unique(interval[~done], return_inverse=True)
            if len(open_parts) > EFFORT.most_parts:
                break
            keep = np.zeros(len(parts.piece), dtype=bool)
            keep[open_parts] = True
            parts = parts.halves(keep)
            interval = np.concatenate([inverse, inverse + len(open_parts)])
            zone = np.tile(zone[~done], 2)
            moving = self._pieces.disc(parts, self._offset)
        self.certified = -inf

    def _keep(self, values: Array, zone: Index, times: Array) -> None:
        values = np.where(np.isnan(values), -inf, values)
        worst = int(np.argmin(values))
        if values[worst] < self.least:
            self.least, self.zone, self.when = float(values[worst]), int(zone[worst]), float(times[worst])


def _pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])
