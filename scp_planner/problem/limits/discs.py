"""A long vehicle: further discs on its axis keep clear of zones and inside the workspace box.

The centre of a disc o ahead of the reference point is q = r + o T, T the direction of the path. With n the guide's
normal, k its curvature, p = 1 - k f, N the path's normal and kappa its curvature, at a fixed normalised time

    dq = n B dtheta + T (dD - dS) + o N [(f' k B + p B') / |r'|^2 dtheta + kappa (dD - dS)].
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.problem.limits.inputs import LimitInputs
from scp_planner.problem.limits.limit import OptionalLimit
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.contacts import ZoneContacts
from scp_planner.threat_zones.nearness import ABREAST, NEAR, nearness_of_samples
from scp_planner.trips.path import Path, PathPoints
from scp_planner.trips.space import TimeTable
from scp_planner.trips.trajectory import Trajectory

AS_NEAR = 1e-9  # units of length, by which clearances differ that are one: rounding is to tell no minima
STRIDE = 3  # every third sample near a zone counts, besides those around minima of clearance


def disc_positions(path: PathPoints, offset: float | Array) -> Array:
    """Centres of a disc that is so far ahead, or each so far, of points of a path on its axis, (n, 2) m."""
    positions: Array = path.position + (offset / path.speed)[:, None] * path.direction
    return positions


def of_offsets_alone(theta: Array, step_size: int) -> Array:
    """Gradients with respect to a step, (n, step), of what only the free offsets move, (n, free)."""
    gradient = np.zeros((len(theta), step_size))
    gradient[:, : theta.shape[1]] = theta
    return gradient


@dataclass(frozen=True)
class Swing:
    """How the centre of a disc moves with the offset of the path.

    Attributes
    ----------
    across : (n, 2) array
        The path's normal N.
    value, slope : (n,) arrays
        Derivatives of the direction of the path by f and f'.
    """

    across: Array
    value: Array
    slope: Array

    @classmethod
    def of(cls, points: PathPoints) -> Swing:
        """Return how directions of a path change at some of its points."""
        unit = points.direction / points.speed[:, None]
        squared = points.speed * points.speed
        curvature = points.turning[:, 0]
        return cls(
            np.stack([-unit[:, 1], unit[:, 0]], axis=1),
            points.slope * curvature / squared,
            points.stretch / squared,
        )

    def rows(self, path: Path, points: PathPoints, normal: Array, offset: float | Array) -> Array:
        """Derivative of normal . q by theta at fixed stations, (n, K1)."""
        basis = path.space.path
        sideways = np.einsum("ij,ij->i", normal, np.broadcast_to(points.normal, normal.shape))
        turn = offset * np.einsum("ij,ij->i", normal, self.across)
        rows = (sideways + turn * self.value)[:, None] * basis.rows_at(points.span, points.local)
        slopes = basis.derivative.rows_at(points.span, points.local) / path.space.length
        found: Array = rows + (turn * self.slope)[:, None] * slopes
        return found

    def turn_rows(self, path: Path, points: PathPoints) -> Array:
        """Derivative of the direction of the path by theta at fixed stations, (n, K1) rad/m."""
        basis = path.space.path
        slopes = basis.derivative.rows_at(points.span, points.local) / path.space.length
        value, slope = (np.broadcast_to(part, points.station.shape) for part in (self.value, self.slope))
        found: Array = value[:, None] * basis.rows_at(points.span, points.local) + slope[:, None] * slopes
        return found


class Discs:
    """The further discs of a vehicle among zones: the depths of all are found at once.

    Parameters
    ----------
    offsets : (D,) array
        Ahead of the reference point, m.
    samples : TimeTable
    zones : ZoneBatch
        Inflated by the vehicle's radius and the planner's margin.
    """

    def __init__(self, offsets: Array, samples: TimeTable, zones: ZoneBatch) -> None:
        self.offsets, self.samples, self.zones = offsets, samples, zones
        self._order = np.argsort(samples.sigma, kind="stable")
        self._last: tuple[Trajectory, Array] | None = None
        self._near: NearRows | None = None
        self._others: Discs | None = None

    def among(self, zones: ZoneBatch) -> Discs:
        """Return the discs among other zones: the same ones for the same zones."""
        if self._others is None or self._others.zones is not zones:
            self._others = Discs(self.offsets, self.samples, zones)
        return self._others

    def depths(self, trajectory: Trajectory) -> Array:
        """Return the depths, (D, n, L) m, of each disc, sample and zone; -inf where they do not count."""
        if self._last is None or self._last[0] is not trajectory:
            self._last = (trajectory, self._depths(trajectory))
        return self._last[1]

    def _depths(self, trajectory: Trajectory) -> Array:
        points, count = trajectory.kept_at(self.samples), len(self.offsets)
        ahead = points.path.direction / points.path.speed[:, None]
        centres = points.path.position + self.offsets[:, None, None] * ahead
        times = np.broadcast_to(points.time, (count, len(points.time))).ravel()
        clearance = self.zones.distances(times, centres.reshape(-1, 2), NEAR)
        clearance = clearance.reshape(count, len(points.time), self.zones.size)
        sorted_ = clearance[:, self._order]
        lower = np.ones(clearance.shape, dtype=bool)
        rise = np.diff(sorted_, axis=1)
        lower[:, 1:] &= rise <= AS_NEAR
        lower[:, :-1] &= rise >= -AS_NEAR
        beside = lower.copy()
        beside[:, 1:] |= lower[:, :-1]
        beside[:, :-1] |= lower[:, 1:]
        beside[:, ::STRIDE] |= sorted_[:, ::STRIDE] < nearness_of_samples(self.zones, NEAR)
        counts = np.empty_like(beside)
        counts[:, self._order] = beside
        return np.where(counts, -clearance, -np.inf)

    def near(self, trajectory: Trajectory) -> NearRows:
        """Return the depths of all discs that are looked at in a step, and their gradients."""
        if self._near is None or self._near.trajectory is not trajectory:
            index = np.flatnonzero(self.depths(trajectory) > -NEAR)
            contacts = self._contacts(trajectory, index)
            some = self.zones.leaders(index // max(self.zones.size, 1), self._split(index)[2], contacts, ABREAST * NEAR)
            index = index[some]
            self._near = NearRows(trajectory, index, self._gradient(trajectory, index, contacts.take(some)))
        return self._near

    def gradient(self, trajectory: Trajectory, place: int, index: Index) -> Array:
        """Return gradients of some depths of one disc by all offsets and what follows; of all that are near at once."""
        wanted, near = index + place * len(self.samples.sigma) * self.zones.size, self.near(trajectory)
        rows = near.index.searchsorted(wanted)
        if rows.max(initial=-1) >= len(near.index) or np.any(near.index[rows] != wanted):
            return self._gradient(trajectory, wanted, self._contacts(trajectory, wanted))
        return near.gradient[rows]

    def _split(self, index: Index) -> tuple[Index, Index, Index]:
        """Discs, samples and zones of some depths."""
        disc, index = np.divmod(index, max(len(self.samples.sigma) * self.zones.size, 1))
        return disc, *np.divmod(index, max(self.zones.size, 1))

    def _contacts(self, trajectory: Trajectory, index: Index) -> ZoneContacts:
        """Contacts of discs and zones that some depths are of."""
        disc, sample, zone = self._split(index)
        points = trajectory.kept_at(self.samples)
        return self.zones.contacts(
            zone, points.time[sample], disc_positions(points.path.take(sample), self.offsets[disc])
        )

    def _gradient(self, trajectory: Trajectory, index: Index, contacts: ZoneContacts) -> Array:
        disc, sample, _ = self._split(index)
        points, offset = trajectory.kept_at(self.samples).take(sample), self.offsets[disc]
        path, tau = points.path, trajectory.travel_time
        swing = Swing.of(path)
        curvature = trajectory.path.bend(path).curvature
        along = np.einsum("ij,ij->i", contacts.normal, path.direction) / path.speed
        along += offset * curvature * np.einsum("ij,ij->i", contacts.normal, swing.across)
        theta = swing.rows(trajectory.path, path, contacts.normal, offset)
        theta -= along[:, None] * trajectory.path.arc_length_gradient(points.parameter)
        beta = (tau * tau * along)[:, None] * points.table.distance
        rho = tau * points.table.sigma * (along * trajectory.space.start_speed + contacts.rate)
        return -np.concatenate([theta, beta, rho[:, None]], axis=1)


@dataclass(frozen=True)
class NearRows:
    """Gradients of the depths of all discs of a trip that are near, (m, all offsets and more), and which, (m,)."""

    trajectory: Trajectory
    index: Index
    gradient: Array


@dataclass(frozen=True)
class DiscClearance(OptionalLimit):
    """Entry of a disc into zones, m, at the samples around minima of its clearance and some others.

    Attributes
    ----------
    discs : Discs
        All of the vehicle's.
    place : int
        Which of them.
    free : slice
        The free control points of the offset.
    """

    name: ClassVar[str] = "discs"
    near: ClassVar[float] = NEAR

    discs: Discs
    place: int
    free: slice

    @property
    def offset(self) -> float:
        """How far the disc is ahead of the reference point, m."""
        return float(self.discs.offsets[self.place])

    def among(self, zones: ZoneBatch) -> Self:
        """Return the limit among other zones."""
        return type(self)(self.discs.among(zones), self.place, self.free)

    def excess(self, trajectory: Trajectory) -> Array:
        """Return the depths, (n L,) m: of each sample and zone."""
        return self.discs.depths(trajectory)[self.place].ravel()

    def touched(self, trajectory: Trajectory, depth: Array, near: float) -> dict[int, int]:
        """Zones that the disc comes nearer to than so much, m, and its side of them: 1 to the left, or -1."""
        zones, samples = self.discs.zones, self.discs.samples
        if depth.size == 0 or depth.size != len(samples.sigma) * zones.size:
            return {}  # of a trip among more zones than these
        depths = depth.reshape(-1, zones.size)
        near_zones = np.flatnonzero(depths.max(axis=0, initial=-np.inf) > -near)
        points = trajectory.kept_at(samples).take(depths[:, near_zones].argmax(axis=0))
        contacts = zones.contacts(near_zones, points.time, disc_positions(points.path, self.offset))
        sides = (contacts.normal * points.path.normal).sum(axis=1)
        return dict(zip(near_zones.tolist(), np.where(sides > 0.0, 1, -1).tolist(), strict=True))

    def places(self, trajectory: Trajectory, excess: Array) -> Index:
        """Return the depths that are looked at in a step, without those that others imply."""
        near, count = self.discs.near(trajectory).index, len(excess)
        first, last = near.searchsorted([self.place * count, (self.place + 1) * count])
        return near[first:last] - self.place * count

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradients of the depths."""
        whole, free = self.discs.gradient(trajectory, self.place, index), self.free
        return np.concatenate([whole[:, free], whole[:, trajectory.space.path_size :]], axis=1)


@dataclass(frozen=True)
class DiscBox(OptionalLimit):
    """How far a disc is outside the workspace box, m, at the fixed stations.

    Attributes
    ----------
    offset : float
        Ahead of the reference point, m.
    free : slice
        The free control points of the offset.
    step_size : int
        Number of variables of a step.
    normals, offsets : (S, 2), (S,) arrays
        Of the sides: normal . q <= offset.
    """

    name: ClassVar[str] = "workspace bounds"
    near: ClassVar[float] = NEAR

    offset: float
    free: slice
    step_size: int
    normals: Array
    offsets: Array

    def tightened(self, more: float) -> DiscBox:
        """Return a smaller box."""
        return DiscBox(self.offset, self.free, self.step_size, self.normals, self.offsets - more)

    def excess(self, trajectory: Trajectory) -> Array:
        """Return the depths beyond each side at each station, (M S,) m."""
        points = trajectory.path.points(trajectory.space.tables.station_parameters)
        return (disc_positions(points, self.offset) @ self.normals.T - self.offsets).ravel()

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradients of the depths."""
        station, side = np.divmod(index, len(self.offsets))
        path = trajectory.path
        points = path.points(trajectory.space.tables.station_parameters[station])
        theta = Swing.of(points).rows(path, points, self.normals[side], self.offset)[:, self.free]
        return of_offsets_alone(theta, self.step_size)


def disc_limits(inputs: LimitInputs) -> Iterator[OptionalLimit]:
    """Make what keeps the further discs of a long vehicle clear of zones, and inside the box."""
    box, offsets = inputs.box, [offset for offset in inputs.vehicle.discs if offset != 0.0]
    discs = Discs(np.array(offsets), inputs.samples, inputs.zones)
    for place, offset in enumerate(offsets):
        yield DiscClearance(discs, place, inputs.free)
        if len(box.offsets):
            yield DiscBox(offset, inputs.free, inputs.step_size, box.normals, box.offsets)
