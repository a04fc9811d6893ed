"""The switching poses of a manoeuvre for the least time: all its legs in one loop of quadratic programs.

Each leg is driven along so many equal pieces of constant curvature; unknown are the curvatures, the lengths of the
legs, by how much longer than at top speed each takes, and waits before them. A step is the answer to a quadratic
program in a trust region, in which the goal and the clearances have a slack each, with an exact penalty (J. Nocedal,
S. Wright, Numerical Optimization, 2006, section 18.5). Top speeds follow from curvatures and lengths.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, pi

import numpy as np

from scp_planner.arrays import Array, Index, unit_vectors
from scp_planner.pauses import Budget
from scp_planner.routes.manoeuvres import Manoeuvre
from scp_planner.scenario.models import Scenario
from scp_planner.solvers.interface import QuadraticProgram, SolverStatus, solver_named
from scp_planner.threat_zones.batch import ZoneBatch


@dataclass(frozen=True)
class SteeringSettings:
    """Pieces of legs, and steps of the loop over them."""

    pieces: int = 24  # of a leg
    ramp: float = 2.0  # pieces, in which the curvature changes from one limit to the other
    shortest: float = 0.02  # radii, of a leg
    near: float = 1.0  # radii, to what is looked at
    waits: int = 24  # times in a wait
    steps: int = 40
    trust: float = 0.2  # of the largest curvature, of a radius, and of the time of a radius
    least_trust: float = 1e-3
    kept: float = 0.1  # of what a step promises, that it must gain
    grown: float = 1.5
    shrunk: float = 0.4
    longest: float = 2.0  # times the time without, of waits that are tried
    tried: int = 33  # of these
    far: float = 100.0  # times in which radii are driven: price of what is missed
    smooth: float = 1e-4  # times in which radii are driven, by changes of the curvature
    converged: float = 1e-4  # of the time, that a step promises
    missed: float = 1e-3  # radii, by which the goal and what stands may be missed


STEERING = SteeringSettings()


@dataclass(frozen=True)
class SteeredLeg:
    """A leg between two poses at which the vehicle stands."""

    backward: bool
    poses: Array  # (n + 1, 3): x and y, m, and heading of the vehicle, rad
    wait: float  # s, before it
    slack: float  # s, the wait and what slower driving adds
    time: float  # s, about, at top speed


@dataclass(frozen=True)
class Steered:
    """Legs that lead to the goal, but for ``missed`` radii."""

    legs: tuple[SteeredLeg, ...]
    time: float  # s
    missed: float

    @property
    def good(self) -> bool:
        """True if they lead to the goal, and into nothing that stands."""
        return self.missed <= STEERING.missed


class Steering:
    """Improves manoeuvres of a scenario, among zones in world coordinates that are inflated by a radius, m."""

    def __init__(
        self, scenario: Scenario, zones: ZoneBatch, radius: float, curvature: float, budget: Budget | None = None
    ) -> None:
        self.scenario, self.zones, self.radius, self.curvature = scenario, zones, radius, curvature
        self.budget = budget or Budget()
        self.solver = solver_named("daqp")

    def among_standing(self, manoeuvre: Manoeuvre) -> list[Drive]:
        """Find the drives of the least time near a manoeuvre, among what stands, each with one spare leg fewer."""
        standing = self.zones.subset(self.zones.standing)
        drives = [self._improved(self.along(manoeuvre), standing)]
        while (short := drives[-1].spare_leg) is not None:
            fewer = self._improved(self.along(drives[-1].without(short)), standing)
            if fewer.missed + fewer.deep > 2.0 * STEERING.missed:
                break
            drives.append(fewer)
        return drives

    def improved(self, found: Drive) -> Steered:
        """Find the legs of the least time near a drive, with waits for what moves."""
        if len(self.zones.moving) == 0:
            return found.steered()
        best = self._improved(found, self.zones)
        for waiting in self._waiting(found):
            other = self._improved(waiting, self.zones)
            best = min(best, other, key=lambda each: each.merit)
        return best.steered()

    def _improved(self, start: Drive, zones: ZoneBatch) -> Drive:
        """Go on from a drive, step by step, among some zones."""
        now, trust = replace(start, zones=zones), STEERING.trust
        for _ in range(STEERING.steps):
            self.budget.check()
            step = self._step(now, trust)
            if step is None:
                trust *= STEERING.shrunk
                continue
            change, promised = step
            there = replace(now, x=now.x + change)
            if now.merit - there.merit > STEERING.kept * promised > 0.0:
                now, trust = there, min(STEERING.grown * trust, STEERING.trust)
            else:
                trust *= STEERING.shrunk
            if promised < STEERING.converged * now.time or trust < STEERING.least_trust:
                break
        return now

    def _waiting(self, drive: Drive) -> Iterator[Drive]:
        """Yield, for each leg, the drive clear of what moves with the shortest wait before it, and the least slower.

        A drive that is clear without any is none of them.
        """
        among, legs = replace(drive, zones=self.zones), len(drive.signs)
        if among.deep <= STEERING.missed:
            return
        for place in np.flatnonzero(np.concatenate([among.most_slower, among.longest_waits])).tolist():
            for longer in np.linspace(0.0, STEERING.longest * drive.time, STEERING.tried)[1:]:
                self.budget.check()
                x = drive.x.copy()
                x[len(x) - 2 * legs + place] = longer
                waiting = replace(among, x=x)
                if waiting.deep <= STEERING.missed:
                    yield waiting
                    break

    def along(self, manoeuvre: Manoeuvre) -> Drive:
        """Return the drive along a manoeuvre, its curvatures smoothed."""
        each, lengths, signs = [], [], []
        for curvature, driven in manoeuvre.legs:
            ends = np.concatenate([[0.0], np.cumsum(np.abs(driven))])
            turned = np.concatenate([[0.0], np.cumsum(curvature * np.abs(driven))])
            at = np.linspace(0.0, ends[-1], STEERING.pieces + 1)
            bend = np.diff(np.interp(at, ends, turned)) / max(ends[-1] / STEERING.pieces, 1e-12)
            padded = np.concatenate([bend[:1], bend, bend[-1:]])
            each.append(0.25 * padded[:-2] + 0.5 * bend + 0.25 * padded[2:])
            lengths.append(max(ends[-1], STEERING.shortest / self.curvature))
            signs.append(float(np.sign(driven[0])))
        bends = np.clip(np.concatenate(each), -self.curvature, self.curvature)
        x = np.concatenate([bends, lengths, np.zeros(2 * len(signs))])
        return Drive(self, x, tuple(signs), manoeuvre.start, self.zones)

    def _step(self, now: Drive, trust: float) -> tuple[Array, float] | None:
        """Return a step, and by how much it promises to lower the merit."""
        count, legs = len(now.x), len(now.signs)
        scale = now.scale
        goal, clear = now.goal_rows(), now.clear_rows()
        bends = count - 3 * legs
        lower, upper = np.full(count + 2, -trust), np.full(count + 2, trust)
        least = np.concatenate(
            [np.full(bends, -self.curvature), np.full(legs, STEERING.shortest / self.curvature), np.zeros(2 * legs)]
        )
        most = np.concatenate([np.full(bends, self.curvature), np.full(legs, inf), now.most_slower, now.longest_waits])
        lower[:count] = np.maximum(lower[:count], (least - now.x) / scale)
        upper[:count] = np.minimum(upper[:count], (most - now.x) / scale)
        lower[count:], upper[count:] = 0.0, 1e6
        ramps, room = now.ramp_rows()
        blank = np.zeros((len(ramps), 2))
        soft = np.zeros((2 * len(goal[1]) + len(clear[1]), 2))
        soft[: 2 * len(goal[1]), 0], soft[2 * len(goal[1]) :, 1] = -1.0, -1.0
        matrix = np.vstack([goal[0], -goal[0], -clear[0]]) * scale
        rows = np.vstack([np.hstack([ramps * scale, blank]), np.hstack([matrix, soft])])
        bound = np.concatenate([room, -goal[1], goal[1], clear[1]])
        within = bound <= trust * np.abs(rows[:, :count]).sum(axis=1)  # the others hold in all of the region
        rows, bound = rows[within], bound[within]
        gradient = np.concatenate([now.time_gradient * scale / now.unit, np.full(2, STEERING.far)])
        hessian = 1e-6 * np.eye(count + 2)
        hessian[:bends, :bends] += STEERING.smooth * now.roughness
        gradient[:bends] += STEERING.smooth * now.roughness @ (now.x[:bends] / scale[:bends])
        found = self.solver.solve(QuadraticProgram(hessian, gradient, lower, upper, rows, bound, 0))
        if found.status is not SolverStatus.OPTIMAL:
            return None
        change: Array = found.x[:count] * scale
        linear = float(now.time_gradient @ change) + STEERING.far * now.unit * (
            float(found.x[count:].sum()) - now.missed - now.deep
        )
        return change, -linear


@dataclass(frozen=True)
class Drive:
    """Curvatures of all pieces, 1/m; of legs: lengths, m, what slower driving adds, and waits before them, s."""

    steering: Steering
    x: Array
    signs: tuple[float, ...]
    start: Array  # (3,)
    zones: ZoneBatch

    @cached_property
    def radius(self) -> float:
        return 1.0 / self.steering.curvature

    @cached_property
    def unit(self) -> float:
        """Time in which a radius is driven, s."""
        return self.radius / self.steering.scenario.vehicle.max_speed

    @cached_property
    def scale(self) -> Array:
        legs = len(self.signs)
        bends = len(self.x) - 3 * legs
        return np.concatenate(
            [np.full(bends, self.steering.curvature), np.full(legs, self.radius), np.full(2 * legs, self.unit)]
        )

    @cached_property
    def lengths(self) -> Array:
        legs = len(self.signs)
        return self.x[-3 * legs : -2 * legs]

    @cached_property
    def slower(self) -> Array:
        legs = len(self.signs)
        return self.x[-2 * legs : -legs]

    @property
    def spare_leg(self) -> int | None:
        """The shortest of several legs, if that is as short as may be."""
        short = int(np.argmin(self.lengths))
        least = (1.0 + STEERING.missed) * STEERING.shortest * self.radius
        return short if len(self.signs) > 1 and self.lengths[short] <= least else None

    def without(self, leg: int) -> Manoeuvre:
        """Return the manoeuvre without a leg; what is before and behind that becomes one."""
        driven, bends = (each.reshape(-1, STEERING.pieces) for each in self._pieces)
        others = np.arange(len(self.signs)) != leg
        return Manoeuvre(self.start, bends[others].ravel(), driven[others].ravel(), self.time)

    @cached_property
    def waits(self) -> Array:
        return self.x[-len(self.signs) :]

    @cached_property
    def most_slower(self) -> Array:
        """Slower driving is of use only where something moves."""
        return np.full(len(self.signs), inf if len(self.zones.moving) else 0.0)

    @cached_property
    def longest_waits(self) -> Array:
        """Waits are of use only where something moves, and from a stand."""
        most = self.most_slower.copy()
        if self.steering.scenario.start.speed > 0.0:
            most[0] = 0.0
        return most

    @cached_property
    def _pieces(self) -> tuple[Array, Array]:
        """Signed lengths and curvatures of all pieces."""
        steps = np.repeat(np.array(self.signs) * self.lengths / STEERING.pieces, STEERING.pieces)
        return steps, self.x[: len(steps)]

    @cached_property
    def poses(self) -> Array:
        """Poses at the ends of all pieces, (N + 1, 3)."""
        steps, bends = self._pieces
        turned = np.concatenate([[0.0], np.cumsum(steps * bends)]) + self.start[2]
        middle, chord = turned[:-1] + 0.5 * steps * bends, steps * np.sinc(0.5 * steps * bends / pi)
        moved = np.stack([chord * np.cos(middle), chord * np.sin(middle)], axis=1)
        places = np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)]) + self.start[:2]
        return np.concatenate([places, turned[:, None]], axis=1)

    @cached_property
    def jacobian(self) -> Array:
        """Derivatives of the poses, (N + 1, 3, variables)."""
        steps, bends = self._pieces
        count = len(steps)
        turning = np.zeros((count, len(self.x)))
        turning[np.arange(count), np.arange(count)] = steps
        length, sign = count + np.arange(count) // STEERING.pieces, np.repeat(self.signs, STEERING.pieces)
        each = sign / STEERING.pieces
        turning[np.arange(count), length] = each * bends
        turned = np.concatenate([np.zeros((1, len(self.x))), np.cumsum(turning, axis=0)])
        middle = turned[:-1] + 0.5 * turning
        half = 0.5 * steps * bends
        angle, sinc = self.poses[:-1, 2] + half, np.sinc(half / pi)
        ahead, aside = unit_vectors(angle), np.stack([-np.sin(angle), np.cos(angle)], 1)
        moved = ((steps * sinc)[:, None] * aside)[:, :, None] * middle[:, None, :]
        bent = np.where(np.abs(half) < 1e-4, -half / 3.0, (np.cos(half) - sinc) / np.where(half, half, 1.0))
        moved[np.arange(count), :, np.arange(count)] += (0.5 * steps**2 * bent)[:, None] * ahead
        moved[np.arange(count), :, length] += (each * np.cos(half))[:, None] * ahead
        places = np.concatenate([np.zeros((1, 2, len(self.x))), np.cumsum(moved, axis=0)])
        return np.concatenate([places, turned[:, None, :]], axis=1)

    @cached_property
    def _driven(self) -> tuple[Array, Array]:
        """Times at the ends of pieces after the begin of their legs, (legs, n + 1), and their growth with lengths."""
        longer = 1e-4 * self.radius
        return self._times(self.lengths), (self._times(self.lengths + longer) - self._times(self.lengths)) / longer

    def _times(self, lengths: Array) -> Array:
        scenario, count = self.steering.scenario, STEERING.pieces
        vehicle = scenario.vehicle
        legs = [(vehicle.max_speed, vehicle.max_acceleration)] * len(self.signs)
        if vehicle.reverse is not None:
            back = (vehicle.reverse.max_speed, vehicle.reverse.max_acceleration or vehicle.max_acceleration)
            legs = [leg if sign > 0.0 else back for leg, sign in zip(legs, self.signs, strict=True)]
        top, gain = np.array(legs).T
        step = lengths / count
        squared = np.repeat(top[:, None] ** 2, count + 1, axis=1)
        if vehicle.max_lateral_acceleration is not None:
            bends = np.abs(self._pieces[1]).reshape(len(self.signs), count)
            sharp = np.maximum(np.pad(bends, ((0, 0), (1, 0)), "edge"), np.pad(bends, ((0, 0), (0, 1)), "edge"))
            squared = np.minimum(squared, vehicle.max_lateral_acceleration / np.maximum(sharp, 1e-9))
        end = squared[-1, -1]
        squared[:, 0], squared[:, -1] = 0.0, 0.0
        squared[0, 0] = scenario.start.speed**2
        squared[-1, -1] = end if scenario.goal.speed is None else scenario.goal.speed**2
        for i in range(1, count + 1):
            squared[:, i] = np.minimum(squared[:, i], squared[:, i - 1] + 2.0 * gain * step)
        for i in range(count - 1, -1, -1):
            squared[:, i] = np.minimum(squared[:, i], squared[:, i + 1] + 2.0 * vehicle.max_deceleration * step)
        speed = np.sqrt(squared)
        spent = 2.0 * step[:, None] / np.maximum(speed[:, 1:] + speed[:, :-1], 1e-9)
        return np.concatenate([np.zeros((len(step), 1)), np.cumsum(spent, axis=1)], axis=1)

    @cached_property
    def clock(self) -> Array:
        """Times at the ends of pieces after the begin of their legs, (legs, n + 1) s."""
        return self._driven[0] + self.slower[:, None] * np.linspace(0.0, 1.0, STEERING.pieces + 1)

    @cached_property
    def begins(self) -> Array:
        """Times at which the legs begin, s after the start."""
        spent = self.clock[:, -1]
        return np.cumsum(self.waits) + np.concatenate([[0.0], np.cumsum(spent[:-1])])

    @cached_property
    def time(self) -> float:
        return float(self.begins[-1] + self.clock[-1, -1])

    @cached_property
    def time_gradient(self) -> Array:
        gradient = np.zeros(len(self.x))
        legs = len(self.signs)
        gradient[-3 * legs : -2 * legs], gradient[-2 * legs :] = self._driven[1][:, -1], 1.0
        return gradient

    @cached_property
    def roughness(self) -> Array:
        """Hessian of the sum of squared changes of the curvature within legs."""
        change = self._changes
        return change.T @ change

    @cached_property
    def _changes(self) -> Array:
        count = len(self._pieces[0])
        change = np.eye(count, k=1) - np.eye(count)
        return change[np.arange(count) % STEERING.pieces < STEERING.pieces - 1]

    def ramp_rows(self) -> tuple[Array, Array]:
        """Rows, and bounds, of the changes of the curvature from piece to piece."""
        change, most = self._changes, 2.0 * self.steering.curvature / STEERING.ramp
        matrix = np.zeros((len(change), len(self.x)))
        matrix[:, : change.shape[1]] = change
        now = change @ self._pieces[1]
        return np.vstack([matrix, -matrix]), np.maximum(np.concatenate([most - now, most + now]), 0.0)

    def goal_rows(self) -> tuple[Array, Array]:
        """Derivatives of what misses the goal, and by how much, in radii."""
        missed, rows = self._goal
        return self.jacobian[-1][: len(missed)] * rows[:, None], missed

    @cached_property
    def _goal(self) -> tuple[Array, Array]:
        goal, (x, y, heading) = self.steering.scenario.goal, self.poses[-1]
        missed = [(x - goal.position[0]) / self.radius, (y - goal.position[1]) / self.radius]
        if goal.heading is not None:
            missed.append(float(np.remainder(heading - goal.heading + pi, 2.0 * pi)) - pi)
        return np.array(missed), np.array([1.0 / self.radius, 1.0 / self.radius, 1.0])[: len(missed)]

    @cached_property
    def missed(self) -> float:
        return float(np.abs(self._goal[0]).max())

    @cached_property
    def _places(self) -> tuple[Index, Array, Array, Array]:
        """Pieces' ends, times, and gradients of times, of all that has to keep clear: drives and waits, (m, ...)."""
        count, legs = STEERING.pieces, len(self.signs)
        node = (count * np.arange(legs)[:, None] + np.arange(count + 1)).ravel()
        time = (self.begins[:, None] + self.clock).ravel()
        slope = np.zeros((legs, count + 1, len(self.x)))
        lengths, slower, waits = (len(self.x) - k * legs for k in (3, 2, 1))
        for leg in range(legs):
            slope[leg, :, waits : waits + leg + 1] = 1.0
            slope[leg, :, slower : slower + leg] = 1.0
            slope[leg, :, slower + leg] = np.linspace(0.0, 1.0, count + 1)
            slope[leg, :, lengths : lengths + leg] = self._driven[1][:leg, -1]
            slope[leg, :, lengths + leg] = self._driven[1][leg]
        flat = slope.reshape(-1, len(self.x))
        if self.longest_waits.max() > 0.0:
            shares = np.linspace(0.0, 1.0, STEERING.waits, endpoint=False)
            waiting = np.repeat(count * np.arange(legs), len(shares))
            begun = np.repeat(self.begins, len(shares)) - np.tile(shares, legs) * np.repeat(self.waits, len(shares))
            waited = np.repeat(slope[:, 0], len(shares), axis=0)
            waited[np.arange(len(waiting)), len(self.x) - legs + np.repeat(np.arange(legs), len(shares))] -= np.tile(
                shares, legs
            )
            node, time, flat = np.append(node, waiting), np.append(time, begun), np.vstack([flat, waited])
        return node, time, flat, self.poses[node]

    def _disc(self, offset: float) -> Array:
        """Centres of a disc at all places, (m, 2)."""
        poses = self._places[3]
        return poses[:, :2] + offset * unit_vectors(poses[:, 2])

    @cached_property
    def _rooms(self) -> list[tuple[Array, Array, Array]]:
        """Centres of each disc, distances to zones, (m, Z), and to the sides of the workspace, (m, 4), m."""
        scenario, zones, found = self.steering.scenario, self.zones, []
        for offset in scenario.vehicle.discs:
            points = self._disc(offset)
            to_zones = zones.distances(self._places[1], points) if zones.size else np.zeros((len(points), 0))
            to_sides = np.zeros((len(points), 0))
            if scenario.bounds is not None:
                low, high = scenario.bounds.min, scenario.bounds.max
                to_sides = np.concatenate([points - low, high - points], axis=1) - self.steering.radius
            found.append((points, to_zones, to_sides))
        return found

    @cached_property
    def deep(self) -> float:
        """Largest depth in zones and beyond the workspace, radii."""
        least = [min(zones.min(initial=inf), sides.min(initial=inf)) for _, zones, sides in self._rooms]
        return max(0.0, -float(min(least)) / self.radius)

    def clear_rows(self) -> tuple[Array, Array]:
        """Derivatives of distances that are small, and the distances, in radii."""
        node, times, slope, poses = self._places
        reach, rows, rooms = STEERING.near * self.radius, [], []
        sides = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
        for offset, (points, to_zones, to_sides) in zip(self.steering.scenario.vehicle.discs, self._rooms, strict=True):
            aside = offset * np.stack([-np.sin(poses[:, 2]), np.cos(poses[:, 2])], axis=1)
            moved = self.jacobian[node, :2] + aside[:, :, None] * self.jacobian[node, 2][:, None, :]
            at, zone = np.nonzero(to_zones < reach)
            if len(at):
                contact = self.zones.contacts(zone, times[at], points[at])
                along = np.einsum("ij,ijk->ik", contact.normal, moved[at]) + contact.rate[:, None] * slope[at]
                rows.append(along)
                rooms.append(to_zones[at, zone])
            at, side = np.nonzero(to_sides < reach)
            if len(at):
                rows.append(np.einsum("ij,ijk->ik", sides[side], moved[at]))
                rooms.append(to_sides[at, side])
        if not rows:
            return np.zeros((0, len(self.x))), np.zeros(0)
        return np.vstack(rows) / self.radius, np.concatenate(rooms) / self.radius

    @cached_property
    def merit(self) -> float:
        return self.time + STEERING.far * self.unit * (self.missed + self.deep)

    def steered(self) -> Steered:
        """Return the legs."""
        spent, waits, count = self._driven[0][:, -1], np.maximum(self.waits, 0.0), STEERING.pieces
        slack = waits + np.maximum(self.slower, 0.0)
        legs = tuple(
            SteeredLeg(sign < 0.0, self.poses[k * count : (k + 1) * count + 1], *map(float, times))
            for k, (sign, *times) in enumerate(zip(self.signs, waits, slack, spent, strict=True))
        )
        return Steered(legs, self.time, max(self.missed, self.deep))
