"""Closed loops through recorded crowds, which do not react; and three simpler ways to drive through the same.

- ``zones``: the planner, with a motion with process noise fitted to every other person of the place.
- ``prediction``: the same planner and estimates, but people are taken to go on just as they do now: zones are no larger
  than the people.
- ``orca``: a robot that can change its velocity at once, ten times a second, and is told where people are and how fast.
  It gives way by ORCA, with the half that others are to do left undone.
- ``waiting``: straight to the goal, standing still while anybody is near the way that is needed to stop in.

People's positions are 0.4 s apart in the recordings, and straight in between. Many are first recorded in the middle of
a place: so that nobody appears out of nothing, each walks straight for 3 s to where the recording begins.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.crowds.policies import SHY, STANDING, closest, reciprocal_velocity
from benchmarks.facts import facts_of
from scp_planner.scenario.models import Steering
from scp_planner.scenario.process_model import ProcessModel
from scp_planner.simulation.crowds import CROWDS, among_people
from scp_planner.simulation.loop import simulate
from scp_planner.simulation.orca import Bodies
from scp_planner.simulation.people import Manner
from scp_planner.simulation.sensors import Sensor
from scp_planner.simulation.worlds import Course, VehicleState, track_course
from scp_planner.tracking.motion_fitting import fit_motion_model
from scp_planner.tracking.tracks import Track, Tracks

WAYS = ("zones", "prediction", "orca", "waiting")
FILES = {"eth": "eth_obsmat.txt", "hotel": "hotel_obsmat.txt", "univ": "univ_obsmat.txt"}
ACROSS = {
    "eth": ((0.0, 10.0), (0.0, 11.0)),
    "hotel": ((-2.5, 4.0), (-9.0, 3.0)),
    "univ": ((-7.0, 7.0), (-6.0, 8.0)),
}
"""Of each place: the range that x is drawn from, and y at either end of a trip; every other one is along x instead."""
ALONG = {
    "eth": ((3.0, 8.0), (-3.0, 13.0)),
    "hotel": ((-8.0, 3.0), (-3.0, 4.5)),
    "univ": ((-4.0, 6.0), (-7.0, 7.0)),
}
VEHICLE = sp.Vehicle(
    radius=0.3,
    max_speed=1.5,
    max_acceleration=1.0,
    max_deceleration=1.5,
    max_lateral_acceleration=1.5,
    max_curvature=2.0,
    steering=Steering.BOTH_WAYS,
)
PERSON = 0.3  # m, radius
GOAL_RADIUS = 0.3  # m
NOISE, RATE, RANGE = 0.05, 10.0, 10.0  # m, Hz, m
LONGEST = 60.0  # s
FEWEST = 3  # people there when the vehicle sets off
LEAD_IN = 3.0  # s
ROOM = 1.5  # m between centres when the vehicle sets off
STEP = 0.02  # s


def recordings(folder: str | os.PathLike[str] | None, places: Sequence[str] = tuple(FILES)) -> dict[str, Tracks]:
    """The tracks of places."""
    root = folder or os.environ.get(common.DATA_VARIABLE)
    if root is None:
        raise common.MissingDataError(f"no recorded motions: set {common.DATA_VARIABLE} or give --tracks FOLDER")
    files = {name: Path(root) / "pedestrians" / FILES[name] for name in places}
    for file in files.values():
        if not file.is_file():
            raise common.MissingDataError(f"no recorded motions: there is no {file}")
    return {name: _read(file) for name, file in files.items()}


@cache
def _read(file: Path) -> Tracks:
    """Once in a process: reading takes longer than a trip."""
    return Tracks.load(file)


@cache
def fitted_model(tracks: Tracks) -> ProcessModel:
    """The motion of every other person of a place."""
    return fit_motion_model(tracks.halves()[0])


@dataclass(frozen=True)
class Task:
    """A trip through a place, and the people who are there at some time of it."""

    time: float
    start: tuple[float, float]
    goal: tuple[float, float]
    people: Mapping[str, Course]

    @property
    def heading(self) -> float:
        return math.atan2(self.goal[1] - self.start[1], self.goal[0] - self.start[0])

    def places(self, time: float) -> np.ndarray:
        """Where people are at a time, (n, 2) m."""
        places = self.everybody(time)
        return np.asarray(places[np.isfinite(places[:, 0])])

    def everybody(self, time: float) -> np.ndarray:
        """The same of all, NaN for those who are not there: in the same order at all times."""
        return np.array([course(np.array([time]))[0] for course in self.people.values()]).reshape(-1, 2)


def task(place: str, tracks: Tracks, number: int) -> Task:
    """Draw a trip: at a moment when people are there, across the place or along it, either way."""
    rng = np.random.default_rng([tuple(FILES).index(place), number])
    while True:
        time = float(rng.uniform(tracks.start + 5.0, tracks.stop - LONGEST))
        across = rng.random() < 0.5
        span, ends = (ACROSS if across else ALONG)[place]
        side = float(rng.uniform(*span))
        points = [(side, end) if across else (end, side) for end in ends]
        start, goal = points if rng.random() < 0.5 else points[::-1]
        people = {
            track.id: track_course(led_in(track))
            for track in tracks
            if track.times[-1] > time - 6.0 and track.times[0] < time + LONGEST
        }
        drawn = Task(time, start, goal, people)
        there = drawn.places(time)
        soon = [drawn.places(time + later) for later in (0.0, 0.5, 1.0)]
        room = min(float(np.linalg.norm(each - start, axis=1).min(initial=math.inf)) for each in soon)
        if len(there) >= FEWEST and room > ROOM:
            return drawn


def led_in(track: Track) -> Track:
    """A track that begins some seconds sooner, straight."""
    if len(track) < 2:
        return track
    velocity = (track.positions[1] - track.positions[0]) / (track.times[1] - track.times[0])
    first = track.positions[0] - LEAD_IN * velocity
    return Track(track.id, np.insert(track.times, 0, track.times[0] - LEAD_IN), np.vstack([first, track.positions]))


def drive(tracks: Tracks, row: Mapping[str, Any]) -> dict[str, Any]:
    """Drive one trip in one of the ways."""
    drawn = task(str(row["place"]), tracks, int(row["number"]))
    if row["way"] in SIMPLER:
        return SIMPLER[row["way"]](drawn)
    level = CROWDS.level if row["way"] == "zones" else 1e-6
    scenario = sp.Scenario(
        name=str(row["place"]),
        vehicle=VEHICLE,
        start={"time": drawn.time, "position": drawn.start, "heading": drawn.heading, "speed": 0.0},
        goal={"position": drawn.goal, "radius": GOAL_RADIUS},
        confidence={"probability": level, "level": "per_time"},
    )
    run = simulate(
        scenario,
        seed=int(row["number"]),
        rate=RATE,
        world=drawn.people,
        sensors=[Sensor(rate=RATE, noise=NOISE, range=RANGE)],
        model=sp.Model(order=1, process=fitted_model(tracks)),
        online=among_people(VEHICLE, 1.0 / RATE),
        time_limit=LONGEST,
    )
    return {"people": len(drawn.places(drawn.time)), **facts_of(run)}


def _wait(drawn: Task) -> dict[str, Any]:
    """Drive straight; brake while anybody is near the way that is needed to stop in, and a step more."""
    ahead = np.array([math.cos(drawn.heading), math.sin(drawn.heading)])
    length = math.dist(drawn.start, drawn.goal) - GOAL_RADIUS
    driven = speed = elapsed = 0.0
    contact = standing = False
    while driven < length and elapsed < LONGEST:
        position = np.array(drawn.start) + driven * ahead
        offset = drawn.places(drawn.time + elapsed) - position
        along, across = offset @ ahead, offset @ np.array([-ahead[1], ahead[0]])
        stop = speed**2 / (2.0 * VEHICLE.max_deceleration) + VEHICLE.max_speed / RATE
        wide = VEHICLE.radius + PERSON + SHY
        near = (along > 0.0) & (along < stop + wide) & (np.abs(across) < wide)
        touched = bool((np.hypot(along, across) < VEHICLE.radius + PERSON).any())
        contact, standing = contact or (touched and speed > STANDING), standing or (touched and speed <= STANDING)
        if near.any():
            speed = max(speed - VEHICLE.max_deceleration * STEP, 0.0)
        else:
            speed = min(speed + VEHICLE.max_acceleration * STEP, VEHICLE.max_speed)
        driven, elapsed = driven + speed * STEP, elapsed + STEP
    return _simply(drawn, driven >= length, contact, standing, elapsed)


def _orca(drawn: Task) -> dict[str, Any]:
    """Give way by ORCA among people who are where they are, and drive as they have since the last look."""
    step, goal, elapsed, touched = 1.0 / RATE, np.array(drawn.goal), 0.0, {True: False, False: False}
    vehicle = VehicleState(drawn.time, np.array(drawn.start), np.zeros(2), VEHICLE.radius)
    while elapsed < LONGEST and math.dist(vehicle.position, drawn.goal) >= GOAL_RADIUS:
        before, now, after = (drawn.everybody(drawn.time + elapsed + k * step) for k in (-1, 0, 1))
        seen = np.linalg.norm(now - vehicle.position, axis=1) <= RANGE  # nobody who is not there
        there = now[seen]
        velocities = np.nan_to_num((there - before[seen]) / step)
        others = Bodies(there, velocities, np.full(len(there), PERSON))
        velocity = reciprocal_velocity(vehicle, goal, VEHICLE.max_speed, others, Manner(step))
        moved = vehicle.position + step * velocity
        apart = closest(now - vehicle.position, after - moved)
        standing = float(np.hypot(*velocity)) <= STANDING
        touched[standing] = touched[standing] or bool((apart < VEHICLE.radius + PERSON).any())
        elapsed += step
        vehicle = VehicleState(drawn.time + elapsed, moved, velocity, VEHICLE.radius)
    return _simply(drawn, elapsed < LONGEST, touched[False], touched[True], elapsed)


def _simply(drawn: Task, arrived: bool, contact: bool, standing: bool, elapsed: float) -> dict[str, Any]:
    """The columns of a trip without a planner."""
    return {
        "arrived": int(arrived),
        "contact": int(contact),
        "contact_standing": int(standing),
        "travel_time": elapsed,
        "people": len(drawn.places(drawn.time)),
        "median_ms": math.nan,
        "longest_ms": math.nan,
    }


SIMPLER: Mapping[str, Callable[[Task], dict[str, Any]]] = {"orca": _orca, "waiting": _wait}


def cells(rows: Sequence[Mapping[str, Any]]) -> list[object]:
    """What is said of the runs of one way through one place."""

    def rate(key: str) -> str:
        return common.number(100.0 * float(np.mean([int(row[key]) for row in rows])), 1)

    times = [float(row["travel_time"]) for row in rows if int(row["arrived"])]
    wall = common.median(float(row["median_ms"] or "nan") for row in rows)
    return [
        len(rows),
        *(rate(key) for key in ("contact", "contact_standing", "arrived")),
        common.number(float(np.mean(times)) if times else math.nan, 1),
        common.number(wall, 1),
    ]
