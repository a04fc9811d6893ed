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
from scp_planner.threat_zones.nearness import NEAR
from scp_planner.trips.path import Path, PathPoints
from scp_planner.trips.space import TimeTable
from scp_planner.trips.trajectory import Trajectory

STRIDE = 3  # every third sample near a zone counts, besides those around minima of clearance


def disc_positions(path: PathPoints, offset: float) -> Array:
    """Centres of a disc that is so far ahead of points of a path on the vehicle's axis, (n, 2) m."""
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
    def of(cls, path: Path, points: PathPoints) -> Swing:
        """Return how directions of a path change at some of its points."""
        unit = points.direction / points.speed[:, None]
        squared = points.speed * points.speed
        curvature = 0.0 if path.space.frame is None else path.space.guide.frame(points.station).curvature
        return cls(
            np.stack([-unit[:, 1], unit[:, 0]], axis=1),
            points.slope * curvature / squared,
            points.stretch / squared,
        )

    def rows(self, path: Path, points: PathPoints, normal: Array, offset: float) -> Array:
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


@dataclass(frozen=True)
class DiscClearance(OptionalLimit):
    """Entry of a disc into zones, m, at the samples around minima of its clearance and some others.

    Attributes
    ----------
    offset : float
        Ahead of the reference point, m.
    free : slice
        The free control points of the offset.
    samples : TimeTable
    zones : ZoneBatch
        Inflated by the vehicle's radius and the planner's margin.
    """

    name: ClassVar[str] = "discs"
    reach: ClassVar[float] = NEAR

    offset: float
    free: slice
    samples: TimeTable
    zones: ZoneBatch

    def among(self, zones: ZoneBatch) -> Self:
        """Return the limit among other zones."""
        return type(self)(self.offset, self.free, self.samples, zones)

    def excess(self, trajectory: Trajectory) -> Array:
        """Return the depths, (n L,) m: of each sample and zone."""
        points = trajectory.at(self.samples)
        clearance = self.zones.distances(points.time, disc_positions(points.path, self.offset), NEAR)
        order = np.argsort(self.samples.sigma, kind="stable")
        sorted_ = clearance[order]
        counts = np.zeros(clearance.shape, dtype=bool)
        lower = np.ones_like(counts)
        lower[1:] &= sorted_[1:] <= sorted_[:-1]
        lower[:-1] &= sorted_[:-1] <= sorted_[1:]
        beside = lower.copy()
        beside[1:] |= lower[:-1]
        beside[:-1] |= lower[1:]
        beside[::STRIDE] = True
        counts[order] = beside
        return np.where(counts, -clearance, -np.inf).ravel()

    def touched(self, trajectory: Trajectory, depth: Array, near: float) -> dict[int, int]:
        """Zones that the disc comes nearer to than so much, m, and its side of them: 1 to the left, or -1."""
        found: dict[int, int] = {}
        if depth.size != len(self.samples.sigma) * self.zones.size:
            return found  # of a trip among more zones than these
        depths = depth.reshape(-1, max(self.zones.size, 1))
        for zone in np.flatnonzero(depths.max(axis=0, initial=-np.inf) > -near).tolist():
            points = trajectory.at(self.samples.take(np.argmax(depths[:, zone : zone + 1], axis=0)))
            place = disc_positions(points.path, self.offset)
            contacts = self.zones.contacts(np.array([zone]), points.time, place)
            found[zone] = 1 if float((contacts.normal * points.path.normal).sum()) > 0.0 else -1
        return found

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradients of the depths."""
        sample, zone = np.divmod(index, max(self.zones.size, 1))
        points = trajectory.at(self.samples.take(sample))
        path, tau = points.path, trajectory.travel_time
        contacts = self.zones.contacts(zone, points.time, disc_positions(path, self.offset))
        swing = Swing.of(trajectory.path, path)
        curvature = trajectory.path.bend(path).curvature
        along = np.einsum("ij,ij->i", contacts.normal, path.direction) / path.speed
        along += self.offset * curvature * np.einsum("ij,ij->i", contacts.normal, swing.across)
        theta = swing.rows(trajectory.path, path, contacts.normal, self.offset)
        theta -= along[:, None] * trajectory.path.arc_length_gradient(points.parameter)
        beta = (tau * tau * along)[:, None] * points.table.distance
        rho = tau * points.table.sigma * (along * trajectory.space.start_speed + contacts.rate)
        return -np.concatenate([theta[:, self.free], beta, rho[:, None]], axis=1)


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
    reach: ClassVar[float] = NEAR

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
        theta = Swing.of(path, points).rows(path, points, self.normals[side], self.offset)[:, self.free]
        return of_offsets_alone(theta, self.step_size)


def disc_limits(inputs: LimitInputs) -> Iterator[OptionalLimit]:
    """Make what keeps the further discs of a long vehicle clear of zones, and inside the box."""
    box = inputs.box
    for offset in inputs.vehicle.discs:
        if offset != 0.0:
            yield DiscClearance(offset, inputs.free, inputs.samples, inputs.zones)
            if len(box.offsets):
                yield DiscBox(offset, inputs.free, inputs.step_size, box.normals, box.offsets)
