"""Scenes that can be driven by construction: a motion first, then what stands and moves, clear of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import shapely

import scp_planner as sp
from benchmarks.hostile.features import Data, Rng
from benchmarks.hostile.scenes import scenario_of, whole
from benchmarks.pairs.motion import USED, Array, Drive, Motion, Piece, Profile

SPARE = 0.5
"""Radii of the vehicle that a motion keeps clear of everything, beyond its own radius."""
SAMPLED = 600
"""Times of a motion at which it is compared with what stands and moves."""
TURNED = 0.5
"""rad, by which the vehicle may head aside of the motion at a goal on the way."""
FARTHER = 1.2
"""Factor on the distance of something that is in the way of the motion, until it is not."""


@dataclass(frozen=True)
class Feature:
    """One feature of scenes.

    Attributes
    ----------
    name : str
    words : tuple of str
        By which the messages of errors may name it.
    add : callable
        ``add(scene, rng)`` adds it to a scene.
    shapes : bool
        True if it changes the vehicle or its motion, so that it comes before what is put round that.
    """

    name: str
    words: tuple[str, ...]
    add: Callable[[Scene, Rng], None]
    shapes: bool = False


@dataclass(frozen=True)
class Change:
    """Call of a planner that drives, with the place (2,) of its vehicle.

    It is due at a time, s, or on arrival (None), and returns what is another from then on: ``goal``, ``goals``,
    ``walls`` or ``map``; None for nothing.
    """

    time: float | None
    call: Callable[[sp.Planner, Array], Data | None]


@dataclass
class Scene:
    """Scenario in the file format, the motion that shows that it can be driven, and how it is planned for."""

    begin: Array
    clock: float
    vehicle: Data
    pieces: list[Piece]
    margin: float = 0.0
    """m, that the vehicle may be off its plan."""
    heads: bool = False
    """True if the heading on arrival is asked for."""
    data: Data = field(default_factory=dict)
    map: Data | None = None
    least_time: float | None = None
    bound: tuple[Array, float] | None = None
    """Unit normal n and the most that n x may be along the path, m, as a user's constraint."""
    settings: Data = field(default_factory=dict)
    """Fields of `OnlineSettings`."""
    deadline: float | None = None
    predictor: Any = None
    known: dict[str, Data] = field(default_factory=dict)
    """Obstacles, by id, as a planner that drives knows them at first, where that is not the truth."""
    passed: list[float] = field(default_factory=list)
    """When the motion passes each of the places, s."""
    changes: list[Change] = field(default_factory=list)

    @cached_property
    def motion(self) -> Motion:
        return Motion(self.begin, self.clock, self.pieces, self.vehicle)

    def set_out(self) -> None:
        """Write the scenario of vehicle, start and goal; from now on the motion is settled."""
        motion, last = self.motion, self.pieces[-1]
        (x, y, heading), (speed,) = motion.poses(motion.start)[0], motion.speeds(motion.start)
        goal: Data = {"position": motion.position(motion.end)[0].tolist()}
        if self.heads:
            goal["heading"] = float(math.remainder(motion.heading(motion.end)[0], 2.0 * math.pi))
        if last.profile.end == 0.0:
            goal["speed"] = 0.0
        start = {"time": self.clock, "position": [float(x), float(y)], "heading": float(heading), "speed": float(speed)}
        self.data = {"vehicle": self.vehicle, "start": start, "goal": goal, "obstacles": [], "goals": [], "walls": []}

    def begin_with_goal_at(self, share: float, when: float | None) -> None:
        """Begin with a goal on the motion, and set the present one at a time, s, or on arrival (None).

        Places are given with the second goal, but for those that the motion passes before it arrives at the first.
        """
        turning = self.motion.start + share * self.motion.duration
        x, y, heading = (float(value) for value in self.motion.poses(turning)[0])
        about = [heading - TURNED, heading + TURNED]
        way = {"position": [x, y], "radius": 0.5 * self.vehicle["radius"], "heading_range": about}
        goal, places = self.data["goal"], self.data["goals"]
        early = [when is None and time < turning for time in self.passed]
        before = [place for place, first in zip(places, early, strict=True) if first]
        behind = [place for place, first in zip(places, early, strict=True) if not first]

        def set_goal(planner: sp.Planner, _: Array) -> Data:
            planner.set_goal(goal, goals=behind)
            return {"goal": goal, "goals": behind}

        self.data = {**self.data, "goal": way, "goals": before}
        self.passed = [time for time, first in zip(self.passed, early, strict=True) if first]
        self.changes.append(Change(when, set_goal))

    @property
    def described(self) -> Data:
        """Scene as `benchmarks.hostile` writes it."""
        return whole(self.data, map=self.map, least_time=self.least_time)

    def scenario(self) -> sp.Scenario:
        """Make the scenario; as a planner that drives knows it at first."""
        obstacles = [self.known.get(each["id"], each) for each in self.data["obstacles"]]
        return scenario_of({**self.described, "scenario": {**self.data, "obstacles": obstacles}})

    # what a motion sweeps

    @property
    def clear(self) -> float:
        """Distance that all stays from the centres of the vehicle's discs, m."""
        return (1.0 + SPARE) * float(self.vehicle["radius"]) + self.margin

    @cached_property
    def times(self) -> Array:
        """Times of the motion, (n,) s."""
        return np.linspace(self.motion.start, self.motion.end, SAMPLED)

    @cached_property
    def centres(self) -> Array:
        """Places of the vehicle's discs at these times, (discs, n, 2) m."""
        poses = self.motion.poses(self.times)
        ahead = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
        return np.stack([poses[:, :2] + offset * ahead for offset in self.vehicle.get("discs") or (0.0,)])

    @cached_property
    def swept(self) -> Any:
        """Lines that the discs' centres drive along."""
        return shapely.union_all([shapely.LineString(line) for line in self.centres])

    def beside(self, share: float, aside: float) -> Array:
        """Return the place so far to the left of the motion, m, at a share of its time."""
        (x, y, heading) = self.motion.poses(self.motion.start + share * self.motion.duration)[0]
        return np.array([x - aside * math.sin(heading), y + aside * math.cos(heading)])

    def put_beside(self, shape: Callable[[Array], Any], rng: Rng) -> Any:
        """Put a shapely geometry beside the motion: as near as it stays clear of it."""
        share, aside = float(rng.uniform(0.1, 0.9)), float(rng.choice([-1.0, 1.0])) * self.clear
        aside *= float(rng.uniform(1.1, 2.0))
        while shapely.distance(made := shape(self.beside(share, aside)), self.swept) < self.clear:
            aside *= FARTHER
        return made


def draw(rng: Rng) -> Scene:
    """Draw a vehicle and a motion ahead along three arcs: what every scene begins with."""
    radius, top = float(rng.uniform(0.2, 0.5)), float(rng.uniform(1.2, 3.0))
    vehicle = {
        "radius": radius,
        "max_speed": top,
        "max_acceleration": float(rng.uniform(0.8, 2.0)),
        "max_deceleration": float(rng.uniform(1.0, 3.0)),
        "max_lateral_acceleration": float(rng.uniform(1.0, 3.0)),
        "max_curvature": float(rng.uniform(0.5, 1.0)),
    }
    begin = np.array([*rng.uniform(-20.0, 20.0, 2), rng.uniform(-math.pi, math.pi)])
    moves = rng.random(2) < 0.5
    profile = Profile(*(float(rng.uniform(0.5, 1.0)) * moves))
    return Scene(begin, float(rng.choice([0.0, rng.uniform(-50.0, 50.0)])), vehicle, [_leg(vehicle, profile, rng)])


def _leg(vehicle: Data, profile: Profile, rng: Rng) -> Drive:
    """Draw three arcs, each straight or bent, that turn by at most 1 rad each."""
    arcs = []
    for _ in range(3):
        length = float(rng.uniform(2.0, 5.0))
        bend = float(rng.uniform(-1.0, 1.0)) * min(USED * vehicle["max_curvature"], 1.0 / length)
        arcs.append((length, bend))
    return Drive(tuple(arcs), profile)


def lead_in(scene: Scene, piece: Piece) -> None:
    """Put a piece, which ends at rest, before all others."""
    first = scene.pieces[0]
    scene.pieces[0] = replace(first, profile=Profile(0.0, first.profile.end))
    scene.pieces.insert(0, piece)


def lead_out(scene: Scene, piece: Piece) -> None:
    """Put a piece, which begins at rest, behind all others."""
    last = scene.pieces[-1]
    scene.pieces[-1] = replace(last, profile=Profile(last.profile.begin, 0.0))
    scene.pieces.append(piece)


def build(features: Sequence[Feature], rng: Rng) -> Scene:
    """Draw a scene with some features: first those that shape the motion, then those that are put round it."""
    scene = draw(rng)
    for feature in features:
        if feature.shapes:
            feature.add(scene, rng)
    scene.set_out()
    for feature in features:
        if not feature.shapes:
            feature.add(scene, rng)
    return scene
