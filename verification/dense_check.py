"""Independent check of any trip: that it is where it says, as slow as it must be, and outside every obstacle.

The check shares no mathematics with the planner. All that it takes is a function of time to position;
speed, acceleration, curvature and heading come from differences of 20,001 positions, clearances from the
distances to each obstacle at the same times. Where a trip turns so fast that this is too coarse there are up to
sixteen times as many.

What the differences can and cannot see
---------------------------------------
- **Speed** is the sum of the chords of about 1 ms divided by their duration. A chord is never longer than its arc,
  so this is at most the exact mean speed over that time: an exact trip is never refused for rounding up. It falls
  short by a share of (turn between samples)^2 / 24, below 1e-9 at 5 rad/s.
- **Acceleration along the path** is the difference of two such speeds about 4 ms apart: a weighted mean of
  the exact acceleration over 5 ms, less what the chords may fall short by in the slower of the two: below 1e-4 m/s2, as
  samples are added until it is, unless that takes over sixteen times as many. A jump is seen as a ramp, never as more
  than it is.
- **Curvature** is the turn between two neighbouring chords of about 3 mm by their mean length: a weighted
  mean over 6 mm. Chords are chosen by length, not by time, so that it stays sharp where the vehicle creeps
  or stops. A corner of angle phi, also one taken at standstill, shows as about phi / 3 mm.
- **Total acceleration** is the difference of two mean velocities about 4 ms apart: a weighted mean of the exact vector,
  whose norm is at most the mean of the exact norms. **Power** is the energy won over as long: its exact mean, plus less
  than 3e-5 s times the square of a jump of the acceleration.
- **Acceleration at the start** is a one-sided second difference of fourth order, over 5 ms; where it may jump it
  says nothing.
- **Jerk** and the **rate of the curvature** are differences of those over 50 ms: their mean values over that
  time. A jump of the acceleration by 1 m/s2 shows as 20 m/s3.
- **Lateral acceleration** is that curvature times the square of the mean speed over the same two chords.
- **Clearance** between two samples h apart is overlooked by at most c'' h^2 / 8; with relative speed 6 m/s
  around a disc of 0.5 m and h = 0.4 ms this is 1.4e-6 m.

A position that carries rounding or inversion errors of e metres along the path disturbs the acceleration by
4 e / (1 ms * 4 ms) = 1e6 e: the tolerance of 5e-4 m/s2 allows e = 5e-10 m.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from verification.arrivals import first_acceleration, goal_conditions
from verification.differences import (
    ACCELERATION_WINDOW,
    Array,
    HeadingFunction,
    PositionFunction,
    ends,
    motion_limits,
    shortfalls,
)
from verification.distances import clearances
from verification.findings import DenseReport, Finding, Tolerances
from verification.gears import braking_speeds, gear_limits
from verification.meetings import meeting, passages
from verification.places import corridor, disc_centres, occupied, place_speeds, walls, workspace

SAMPLES = 20_000
MOST_REFINEMENT = 16  # times the samples, for trips that turn fast
CHORD_SHARE = 0.2  # of what an acceleration is allowed to be off, that chords may make it


def check_trip(
    scenario: Mapping[str, Any] | str | os.PathLike[str],
    position: PositionFunction,
    start_time: float,
    arrival_time: float,
    *,
    tolerances: Tolerances | None = None,
    samples: int = SAMPLES,
    regions: Mapping[str, float] | None = None,
    heading: HeadingFunction | None = None,
    ground: Any = None,
    lowered: bool = False,
) -> DenseReport:
    """Check one trip against a scenario in the file format.

    Parameters
    ----------
    scenario : mapping or path
        Scenario as a plain dict, or a JSON file. Of a shape that heads along its velocity only what it covers at any
        heading is judged where it hardly moves, and where its motion is not known exactly. About a region of centres
        what is no disc is looked at from so many places on its border that some is overlooked, and nothing invented.
    position : callable
        (n,) times in s to (n, 2) positions in m.
    start_time, arrival_time : float
        First and last time of the trip, s, on the scenario's clock.
    tolerances : Tolerances, optional
        Excess allowed per quantity.
    samples : int
        Number of intervals between sampled times.
    regions : mapping of str to float, optional
        For each observed or predicted obstacle q > 0: its centre may be anywhere in the ellipse z' C(t)^-1 z <= q
        around its estimate, C(t) the covariance of the estimate. Future k of an obstacle is called ``id[k]``; of those
        with a covariance one that is not there is left out. Which q gives which confidence is not judged here.
    heading : callable, optional
        (n,) times in s to (n,) headings of the vehicle, rad, of a trip that may stand, turn on the spot and drive
        backwards. Without them the vehicle heads where it drives.
    ground : shapely geometry, optional
        Occupied ground, in m.
    lowered : bool
        Limits may have been lowered under way: a speed may begin above its limit if it falls as fast as the vehicle
        can brake, and curvature, forces and clearance may begin beyond theirs if these never get worse.

    Raises
    ------
    ValueError
        If the scenario has an obstacle that this check cannot judge, or the times or positions are unusable.
    """
    data = _as_mapping(scenario)
    allowed = tolerances or Tolerances()
    if not (math.isfinite(start_time) and math.isfinite(arrival_time) and arrival_time > start_time):
        raise ValueError(f"a trip needs start_time < arrival_time, got {start_time!r} and {arrival_time!r}")
    times, positions = _sampled(position, start_time, arrival_time, samples)
    needed = _refinement(times, positions, allowed) if np.isfinite(positions).all() else 1
    if needed > 1:
        times, positions = _sampled(position, start_time, arrival_time, samples * min(needed, MOST_REFINEMENT))
    if not np.isfinite(positions).all():
        first = times[np.flatnonzero(~np.isfinite(positions).all(axis=1))[0]]
        broken = Finding("position", math.nan, 0.0, math.inf, 0.0, float(first), "not a number")
        return DenseReport((broken,), arrival_time - start_time)
    headings = None if heading is None else np.asarray(heading(times), dtype=float)
    if headings is not None and not np.isfinite(headings).all():
        raise ValueError("a heading is not a number")
    excused = braking_speeds(data, times) if lowered else None
    findings = [
        *ends(data, times, positions, position, allowed, heading),
        *goal_conditions(data, start_time, arrival_time, position, allowed, heading),
        *first_acceleration(data, start_time, arrival_time, position, allowed),
        *(
            motion_limits(data, times, positions, allowed, excused)
            if headings is None
            else gear_limits(data, times, positions, headings, allowed, excused)
        ),
        *place_speeds(data, times, positions, allowed, excused),
        *meeting(data, position, heading, start_time, arrival_time, allowed),
        *passages(data, times, positions, headings, allowed),
    ]
    for place in disc_centres(data, positions, headings):
        findings += [
            *workspace(data, times, place, allowed, falling=lowered),
            *corridor(data, times, place, allowed, falling=lowered),
            *walls(data, times, place, allowed, falling=lowered),
            *occupied(data, times, place, allowed, ground, falling=lowered),
            *clearances(data, times, place, allowed, regions or {}, falling=lowered),
        ]
    return DenseReport(tuple(findings), arrival_time - start_time)


def _sampled(position: PositionFunction, start_time: float, arrival_time: float, samples: int) -> tuple[Array, Array]:
    """Equidistant times of a trip, (samples + 1,), and its positions there."""
    times = np.linspace(start_time, arrival_time, samples + 1)
    positions = np.asarray(position(times), dtype=float)
    if positions.shape != (times.size, 2):
        raise ValueError(f"position gave shape {positions.shape} for {times.size} times, (n, 2) expected")
    return times, positions


def _refinement(times: Array, positions: Array, allowed: Tolerances) -> int:
    """How many times as many samples it takes for chords to fall short of their arcs by little enough."""
    short = float(shortfalls(positions, float(times[1] - times[0])).max())
    ratio = short / (CHORD_SHARE * allowed.acceleration * ACCELERATION_WINDOW)
    return math.ceil(math.sqrt(min(ratio, 1.0 / np.finfo(float).eps)))


def _as_mapping(scenario: Mapping[str, Any] | str | os.PathLike[str]) -> Mapping[str, Any]:
    if isinstance(scenario, Mapping):
        return scenario
    data: Mapping[str, Any] = json.loads(Path(scenario).read_text(encoding="utf-8"))
    return data
