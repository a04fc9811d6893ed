"""Where bends of a path are looked at: at its stations, at jumps of the acceleration, between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.problem.problem import Problem
from scp_planner.trips.path import PathBend
from scp_planner.trips.trajectory import Trajectory, TripPoints

PEAK_REACH = 0.8  # of the limit; lower peaks of the lateral acceleration between stations are not looked at
PEAK_NEIGHBOURS = np.linspace(-0.6, 0.6, 7)  # stations: a peak moves when it is pressed down in one place
PARTS = 4  # of the way from station to station over a curved guide, at the ends of which peaks are looked for

QUIET = 0.8  # of the limit; if no station is above, nothing between stations is looked at
_NOWHERE: Array = np.zeros(0)


@dataclass(frozen=True)
class BendSites:
    """Where curvature and lateral acceleration of a trip are limited: fixed stations, and peaks between them.

    Attributes
    ----------
    stations : StationSites
        The M fixed stations.
    peaks : StationSites
        P stations between the fixed ones, around peaks of the lateral acceleration.
    jumps : JumpSites or None
        Where the vehicle is when its acceleration jumps: the speed peaks there.
    worst_lateral : float
        Largest lateral acceleration at all sites, m/s^2.
    worst_curvature : float
        Largest curvature at the fixed stations, 1/m.
    """

    stations: StationSites
    peaks: StationSites
    jumps: JumpSites | None
    worst_lateral: float
    worst_curvature: float

    @property
    def curvature(self) -> Array:
        """Curvature at the fixed stations, (M,) 1/m: it peaks at breakpoints of a cubic offset or close to them."""
        return self.stations.bend.curvature


@dataclass(frozen=True)
class StationSites:
    """A trip at given stations.

    Attributes
    ----------
    parameters : (n,) array
        Normalised stations.
    bend : PathBend
        Curvature there.
    sigma : (n,) array
        When the vehicle is there, normalised.
    speed : (n,) array
        m/s.
    """

    parameters: Array
    bend: PathBend
    sigma: Array
    speed: Array

    @cached_property
    def lateral(self) -> Array:
        """Lateral acceleration, (n,) m/s^2, signed."""
        return self.speed * self.speed * self.bend.curvature

    def take(self, index: Index | slice) -> StationSites:
        """Return some of the stations."""
        return StationSites(self.parameters[index], self.bend.take(index), self.sigma[index], self.speed[index])

    def joined(self, other: StationSites) -> StationSites:
        """Return both sets of stations."""
        return StationSites(
            np.concatenate([self.parameters, other.parameters]),
            PathBend.joined([self.bend, other.bend]),
            np.concatenate([self.sigma, other.sigma]),
            np.concatenate([self.speed, other.speed]),
        )


@dataclass(frozen=True)
class JumpSites:
    """A trip at those of the problem's samples that are breakpoints of the acceleration.

    Attributes
    ----------
    bend : PathBend
        Curvature there.
    lateral : (n,) array
        Lateral acceleration, m/s^2, signed.
    """

    bend: PathBend
    lateral: Array


def bend_sites(problem: Problem, trip: Trajectory, points: TripPoints) -> BendSites:
    """Return curvature and lateral acceleration where they are limited, given the trip at the problem's samples.

    Jumps, and peaks between stations, are only looked at when some station comes near to the limit.
    """
    path, parameters = trip.path, problem.space.tables.station_parameters
    arrivals = trip.arrivals(path.station_arc_lengths)
    stations = StationSites(parameters, path.station_bend, arrivals.sigma, arrivals.speed)
    lateral = np.abs(stations.lateral)
    worst, sharpest = float(lateral.max()), float(np.abs(stations.bend.curvature).max())
    if worst < QUIET * problem.limits.lateral_acceleration:
        return BendSites(stations, _NO_STATIONS, None, worst, sharpest)
    if not problem.space.guide.straight:
        lateral = _with_parts(trip, lateral)
    peaks = station_sites(trip, _lateral_peaks(problem, lateral, stations=len(parameters)))
    jumps = _at_jumps(problem, trip, points)
    beside = (np.abs(found).max(initial=0.0) for found in (lateral, peaks.lateral, jumps.lateral))
    return BendSites(stations, peaks, jumps, max(worst, *map(float, beside)), sharpest)


def _at_jumps(problem: Problem, trip: Trajectory, points: TripPoints) -> JumpSites:
    """Curvature and lateral acceleration at the jumps of the acceleration."""
    there = slice(problem.grid, None)
    bend, speed = trip.path.bend(points.path.take(there)), points.speed[there]
    return JumpSites(bend, speed * speed * bend.curvature)


def _with_parts(trip: Trajectory, lateral: Array) -> Array:
    """Lateral accelerations at stations, (M,), and at parts of the ways between them, (PARTS (M - 1) + 1,) m/s^2.

    A curved guide bends most anywhere between stations, and where the speed turns there may be two peaks of one bend.
    """
    cells = len(lateral) - 1
    shares = (np.arange(cells)[:, None] + np.arange(1, PARTS) / PARTS) / cells
    found = np.empty(PARTS * cells + 1)
    found[::PARTS] = lateral
    found[:-1].reshape(cells, PARTS)[:, 1:] = np.abs(station_sites(trip, shares.ravel()).lateral).reshape(cells, -1)
    return found


def _lateral_peaks(problem: Problem, value: Array, stations: int) -> Array:
    """Normalised stations around peaks of the lateral acceleration, (n,), by parabolas through its largest values."""
    here = value[1:-1]
    high = (here >= value[:-2]) & (here >= value[2:]) & (here > PEAK_REACH * problem.limits.lateral_acceleration)
    index = 1 + np.flatnonzero(high)
    before, after = value[index - 1], value[index + 1]
    bend = before - 2.0 * value[index] + after
    shift = 0.5 * (before - after) / np.where(bend < 0.0, bend, -np.inf)
    peak = (index + shift) / (len(value) - 1)
    around = (peak[:, None] + PEAK_NEIGHBOURS / (stations - 1)).ravel()
    return np.minimum(np.maximum(around, 0.0), 1.0)


def station_sites(trip: Trajectory, parameters: Array) -> StationSites:
    """Return a trip at normalised stations, (n,)."""
    if len(parameters) == 0:
        return _NO_STATIONS
    path = trip.path
    arrivals = trip.arrivals(path.arc_length_at(parameters))
    return StationSites(parameters, path.bend(path.points(parameters)), arrivals.sigma, arrivals.speed)


_NO_BEND = PathBend(_NOWHERE, _NOWHERE, _NOWHERE, _NOWHERE)
_NO_STATIONS = StationSites(_NOWHERE, _NO_BEND, _NOWHERE, _NOWHERE)
