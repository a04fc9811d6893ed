"""Where bends of a path are looked at: at its stations, at jumps of the acceleration, between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.problem.problem import Problem
from scp_planner.trips.bundle import TripBundle
from scp_planner.trips.path import PathBend
from scp_planner.trips.trajectory import TripPoints

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

    @classmethod
    def joined(cls, parts: Sequence[StationSites]) -> StationSites:
        """Return several sets of stations as one."""
        return (
            parts[0]
            if len(parts) == 1
            else cls(
                np.concatenate([part.parameters for part in parts]),
                PathBend.joined([part.bend for part in parts]),
                np.concatenate([part.sigma for part in parts]),
                np.concatenate([part.speed for part in parts]),
            )
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


def bend_sites(problem: Problem, bundle: TripBundle, points: TripPoints) -> list[BendSites]:
    """Return curvature and lateral acceleration of trips where they are limited.

    Parameters
    ----------
    problem : Problem
    bundle : TripBundle
    points : TripPoints
        The trips at the problem's samples, one after the other. Jumps, and peaks between stations, are only looked at
        when some station comes near to the limit.

    Returns
    -------
    list of BendSites
        One for each trip.
    """
    parameters, bend = problem.space.tables.station_parameters, bundle.station_bend
    arrivals = bundle.arrivals_each(bundle.station_arc_lengths)
    sigma = arrivals.sigma.reshape(bend.curvature.shape)
    speed = arrivals.speed.reshape(bend.curvature.shape)
    stations = [StationSites(parameters, bend.take(k), sigma[k], speed[k]) for k in range(bundle.count)]
    lateral = np.abs(speed * speed * bend.curvature)
    worst, sharpest = lateral.max(axis=1), np.abs(bend.curvature).max(axis=1).tolist()
    loud = worst >= QUIET * problem.limits.lateral_acceleration
    if not loud.any():
        quiet = zip(stations, worst.tolist(), sharpest, strict=True)
        return [BendSites(station, _NO_STATIONS, None, most, most_bent) for station, most, most_bent in quiet]
    if not problem.space.guide.straight:
        lateral = _with_parts(bundle, lateral)
        np.maximum(worst, lateral.max(axis=1), out=worst, where=loud)
    owner, around = _lateral_peaks(problem, lateral, loud, stations=len(parameters))
    peaks = station_sites(bundle, owner, around)
    np.maximum.at(worst, owner, np.abs(peaks.lateral))
    jump_bend, jump_lateral = _at_jumps(problem, bundle, points)
    np.maximum(worst, np.abs(jump_lateral).max(axis=1, initial=0.0), out=worst, where=loud)
    bounds = bundle.bounds(owner)
    sites = []
    for k, (first, last) in enumerate(pairwise(bounds)):
        if loud[k]:
            jumps = JumpSites(jump_bend.take(slice(*_part(problem, k))), jump_lateral[k])
            sites.append(BendSites(stations[k], peaks.take(slice(first, last)), jumps, float(worst[k]), sharpest[k]))
        else:
            sites.append(BendSites(stations[k], _NO_STATIONS, None, float(worst[k]), sharpest[k]))
    return sites


def _part(problem: Problem, k: int) -> tuple[int, int]:
    count = len(problem.jumps.sigma)
    return k * count, (k + 1) * count


def _at_jumps(problem: Problem, bundle: TripBundle, points: TripPoints) -> tuple[PathBend, Array]:
    """Curvature at the jumps of the acceleration, (K J,), and lateral acceleration, (K, J)."""
    path, index = points.path, _jump_samples(problem, bundle.count)
    jumps = path.take(index)
    bend = bundle.bend(bundle.owners(len(problem.jumps.sigma)), jumps)
    speed = points.speed[index]
    lateral = speed * speed * bend.curvature
    return bend, lateral.reshape(bundle.count, -1)


def _jump_samples(problem: Problem, count: int) -> Index | slice:
    """Where the jumps are among the samples of several trips."""
    each = len(problem.samples.sigma)
    if count == 1:
        return slice(problem.grid, None)
    return (each * np.arange(count)[:, None] + np.arange(problem.grid, each)).ravel()


def _with_parts(bundle: TripBundle, lateral: Array) -> Array:
    """Lateral accelerations at stations, (K, M), and at parts of the ways between them, (K, PARTS (M - 1) + 1) m/s^2.

    A curved guide bends most anywhere between stations, and where the speed turns there may be two peaks of one bend.
    """
    cells = lateral.shape[1] - 1
    shares = (np.arange(cells)[:, None] + np.arange(1, PARTS) / PARTS) / cells
    between = station_sites(bundle, bundle.owners(shares.size), np.tile(shares.ravel(), bundle.count))
    found = np.empty((bundle.count, PARTS * cells + 1))
    found[:, ::PARTS] = lateral
    found[:, :-1].reshape(-1, cells, PARTS)[:, :, 1:] = np.abs(between.lateral).reshape(-1, cells, PARTS - 1)
    return found


def _lateral_peaks(problem: Problem, value: Array, loud: Mask, stations: int) -> tuple[Index, Array]:
    """Normalised stations around peaks of the lateral acceleration, (K, M), by parabolas through its largest values."""
    here = value[:, 1:-1]
    high = (here >= value[:, :-2]) & (here >= value[:, 2:])
    high &= here > PEAK_REACH * problem.limits.lateral_acceleration
    high &= loud[:, None]
    owner, index = np.nonzero(high)
    index += 1
    before, after = value[owner, index - 1], value[owner, index + 1]
    bend = before - 2.0 * value[owner, index] + after
    shift = 0.5 * (before - after) / np.where(bend < 0.0, bend, -np.inf)
    peak = (index + shift) / (value.shape[1] - 1)
    around = (peak[:, None] + PEAK_NEIGHBOURS / (stations - 1)).ravel()
    return owner.repeat(len(PEAK_NEIGHBOURS)), np.minimum(np.maximum(around, 0.0), 1.0)


def station_sites(bundle: TripBundle, owner: Index, parameters: Array) -> StationSites:
    """Return trips at normalised stations, (n,)."""
    if len(parameters) == 0:
        return _NO_STATIONS
    arrivals = bundle.arrivals(owner, bundle.arc_length_at(owner, parameters))
    points = bundle.points(owner, parameters)
    return StationSites(parameters, bundle.bend(owner, points), arrivals.sigma, arrivals.speed)


_NO_BEND = PathBend(_NOWHERE, _NOWHERE, _NOWHERE, _NOWHERE)
_NO_STATIONS = StationSites(_NOWHERE, _NO_BEND, _NOWHERE, _NOWHERE)
