"""Recorded crowds in closed loop, in the manner of ECP-MPC.

J. Shin, J. Lee and I. Yang, *Egocentric conformal prediction for safe and efficient navigation in dynamic cluttered
environments* (2025), whose starts, goals, times and measures these are: a robot of 0.4 m radius that drives at most
0.8 m/s, forwards or backwards, and turns at most 0.7 rad/s stands for 15 steps of 0.4 s and then drives among people
who were recorded and do not react. A step counts as a collision if a person is within 1.107 m of the robot's centre;
the exit is reached within 0.6 m of the goal, and its step counts from when the robot was put there. Their robot changes
its speed at once and turns on the spot. This one takes a step to its top speed, and turns only as it drives, in bends
no tighter than theirs at top speed. Of their places ETH, HOTEL and the university are here. The coordinates of the last
differ from theirs, so that trip has the same direction and length and the middle of the place in its middle.

Taken as they were recorded (`Beginning.AS_RECORDED`), people appear in the middle of a place, up to on top of the
robot, and stand where it is put: no robot can answer that. So unless that is asked for (`Beginning.UNTOUCHED`), each
walks in for some seconds, straight, as in `benchmarks.online_crowds`, and the robot sets off at the first step at which
nobody touches it, nor did a moment ago, nor will at the next steps if it stands.

J. Shin, Y. Ra and I. Yang, *From prediction uncertainty to conformalized distance fields for safe motion planning*
(arXiv:2607.00776, 2026), drive the same trips at other times (`Times.FCP`), with 300 steps in the university. Their
data of ETH take ten frames for a step, of which fifteen were recorded in a second: people walk 1.67 times as fast.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from itertools import count, product
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.crowds.policies import PLAN_OUTCOMES
from benchmarks.online_crowds import fitted_model, led_in, recordings
from scp_planner.arrays import Array
from scp_planner.scenario.models import Steering
from scp_planner.settings.online import OnlineSettings
from scp_planner.simulation.crowds import CROWDS, among_people
from scp_planner.simulation.loop import simulate
from scp_planner.simulation.run import Run
from scp_planner.simulation.sensors import Sensor
from scp_planner.simulation.worlds import Course, track_course
from scp_planner.tracking.tracks import Tracks

Row = dict[str, Any]

STEP = 0.4  # s
WAITING = 15  # steps
MOST_STEPS = 100
ROBOT, PERSON = 0.4, 1.0 / math.sqrt(2.0)  # m
TOP_SPEED, TURNING = 0.8, 0.7  # m/s, rad/s
NEAR_EXIT = 0.6  # m
VEHICLE = sp.Vehicle(
    radius=ROBOT,
    max_speed=TOP_SPEED,
    max_acceleration=TOP_SPEED / STEP,
    max_deceleration=TOP_SPEED / STEP,
    max_curvature=TURNING / TOP_SPEED,
    steering=Steering.BOTH_WAYS,
)
GONE = 1.5
"""Steps after which somebody who is not seen has gone: everybody who is there is seen in every step."""
BEGINNINGS = (100, 200, 300)
"""Steps of the recording at which the published scenes begin; further ones follow at the same distance."""


TOUCHING = ROBOT + PERSON  # m
SOON = 2
"""Steps before and after that at which the robot sets off, in which nobody touches it where it stands: who is not seen
any more is remembered for a while."""


class Times(StrEnum):
    """Whose scenes are driven."""

    ECP = "ecp-mpc"
    FCP = "fcp-mpc"


FCP_BEGINNINGS = {"eth": (732, 339, 653), "hotel": (1001, 1245, 1582), "univ": (40, 140, 240)}
FCP_MOST_STEPS = {"univ": 300}
FCP_PACE = {"eth": 6.0 / 10.0}
"""Time between the positions of their data, relative to the recording."""


class Beginning(StrEnum):
    """How people and the robot come to be where they are."""

    UNTOUCHED = "untouched"
    """People walk in, and the robot sets off when nobody touches it."""
    AS_RECORDED = "as-recorded"
    """People appear where they were first recorded, and the robot sets off after 15 steps."""


@dataclass(frozen=True)
class Place:
    """Start, its heading in rad, and goal of the trip through a place, m."""

    start: tuple[float, float]
    heading: float
    goal: tuple[float, float]


PLACES = {
    "eth": Place((5.0, 1.0), 0.5 * math.pi, (3.0, 10.0)),
    "hotel": Place((-1.5, 0.0), -0.5 * math.pi, (2.0, -6.0)),
    "univ": Place((-3.3, -2.6), 0.25 * math.pi, (4.7, 3.9)),
}


@dataclass(frozen=True)
class Scene:
    """A trip through a recording: the scenario, and the courses of those who are there meanwhile."""

    scenario: sp.Scenario
    people: Mapping[str, Any]
    shapes: Mapping[str, Any]


def scenes(tracks: Tracks, place: str = "", times: Times = Times.ECP) -> int:
    """How many scenes of a recording there are: people are recorded for all of their steps."""
    if times is Times.FCP:
        return len(FCP_BEGINNINGS[place])
    steps = round((tracks.stop - tracks.start) / STEP)
    return max((steps - MOST_STEPS - BEGINNINGS[0]) // (BEGINNINGS[1] - BEGINNINGS[0]) + 1, 0)


def most_steps(place: str, times: Times) -> int:
    """Steps of a scene, with the first ones, for which the robot stands."""
    return FCP_MOST_STEPS.get(place, MOST_STEPS) if times is Times.FCP else MOST_STEPS


@cache
def paced(place: str, tracks: Tracks, times: Times) -> Tracks:
    """Tracks of a place at the pace of the data that were used."""
    pace = FCP_PACE.get(place, 1.0) if times is Times.FCP else 1.0
    return tracks if pace == 1.0 else Tracks([replace(track, times=pace * track.times) for track in tracks])


def scene(
    place: str, tracks: Tracks, number: int, beginning: Beginning = Beginning.UNTOUCHED, times: Times = Times.ECP
) -> Scene:
    """The scene of a place that begins at a step of its recording."""
    where, tracks = PLACES[place], paced(place, tracks, times)
    put = BEGINNINGS[0] + number * (BEGINNINGS[1] - BEGINNINGS[0])
    if times is Times.FCP:
        put = FCP_BEGINNINGS[place][number]
    length = 2 * most_steps(place, times)
    start, end = (tracks.start + (put + steps) * STEP for steps in (WAITING, WAITING + length))
    some = [t for t in tracks if len(t) > 1 and t.times[-1] > start - WAITING * STEP and t.times[0] < end]
    if beginning is Beginning.UNTOUCHED:
        some = [led_in(track) for track in some]
    people = {track.id: track_course(track) for track in some}
    if beginning is Beginning.UNTOUCHED:
        start = next(time for k in count() if _is_free(people, where.start, time := start + k * STEP))
    scenario = sp.Scenario(
        name=f"{place}-{number}",
        vehicle=VEHICLE,
        start=sp.Start(time=start, position=where.start, heading=where.heading, speed=0.0),
        goal=sp.Goal(position=where.goal, radius=NEAR_EXIT),
        confidence=sp.Confidence(probability=CROWDS.level, level="per_time"),
        obstacles=(),
    )
    return Scene(scenario, people, {name: sp.Disc(disc=PERSON) for name in people})


def _is_free(people: Mapping[str, Course], place: tuple[float, float], time: float) -> bool:
    """Whether nobody touches a robot that stands at a place, m, about a time, s."""
    times: Array = time + STEP * np.arange(-SOON, SOON + 1.0)
    return not any((np.hypot(*(course(times) - place).T) < TOUCHING).any() for course in people.values())


def among_recorded_people() -> OnlineSettings:
    """Settings among people, but that nobody is hidden here."""
    return replace(among_people(VEHICLE, STEP), forget_after=GONE * STEP)


def run(row: Row, folder: str | None = None) -> Row:
    """One scene; the row says which."""
    from benchmarks.crowds.profiles import profile

    place, times = row["place"], Times(row["times"])
    tracks = recordings(folder, [place])[place]
    drawn = scene(place, tracks, int(row["number"]), Beginning(row["beginning"]), times)
    online, model = profile(str(row["profile"]))
    if online is None:
        model = sp.Model(order=1, process=fitted_model(paced(place, tracks, times)))
    done = simulate(
        drawn.scenario,
        seed=int(row["number"]),
        rate=1.0 / STEP,
        world=drawn.people,
        shapes=drawn.shapes,
        sensors=[Sensor(rate=1.0 / STEP, noise=0.0)],
        history=WAITING * STEP,
        model=model,
        online=online or among_recorded_people(),
        time_limit=(most_steps(place, times) - WAITING) * STEP,
    )
    return written(done)


def written(done: Run) -> Row:
    """The columns of a run."""
    steps = np.array([_nearest(record.position, record.truth) for record in done.records])
    safe, near = np.array([record.safe for record in done.records]), steps < TOUCHING
    wall = 1e3 * done.wall_times[1:]
    return {
        "arrived": int(done.arrived),
        "steps": WAITING + math.ceil(done.travel_time / STEP - 1e-6),
        "driven": len(steps),
        "near": int(near.sum()),
        "least": float(steps.min()),
        "unsafe": int((~safe).sum()),
        "unsafe_untouched": int((~safe & ~near).sum()),
        "median_ms": float(np.median(wall)),
        "slow_ms": float(np.quantile(wall, 0.99)),
        **{name: done.outcomes[name] for name in PLAN_OUTCOMES},
    }


def _nearest(position: tuple[float, float], truth: Sequence[tuple[str, tuple[float, float]]]) -> float:
    return min((math.dist(position, place) for _, place in truth), default=math.inf)


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """What is said of many scenes: means over scenes, as published."""

    def column(key: str) -> np.ndarray:
        return np.array([float(row[key]) for row in rows])

    driven = column("driven")
    return {
        "scenes": float(len(rows)),
        "arrived": float(column("arrived").mean()),
        "collision_steps": float((column("near") / driven).mean()),
        "exit_steps": float(column("steps").mean()),
        "unsafe_steps": float((column("unsafe") / driven).mean()),
        "unsafe_untouched_steps": float((column("unsafe_untouched") / driven).mean()),
        "least_distance": float(column("least").min()),
        "median_ms": common.median(column("median_ms")),
        "slow_ms": common.median(column("slow_ms")),
        **{name: float(column(name).sum() / driven.sum()) for name in PLAN_OUTCOMES},
    }


HEADINGS = [
    "place",
    "times",
    "beginning",
    "scenes",
    "arrived, %",
    "steps within 1.107 m, %",
    "steps to the exit",
    "steps not safe, %",
    "and untouched, %",
    "nearest m",
    "replan ms",
    "99 %",
    "braking, %",
    "evading, %",
]


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """A line for each place, and one for all, for each list of scenes and beginning."""
    lines = []
    for times, beginning, name in product(Times, Beginning, (*PLACES, "all")):
        as_asked = [row for row in rows if (row["times"], row["beginning"]) == (times, beginning)]
        some = [row for row in as_asked if name in ("all", row["place"])]
        if not some:
            continue
        facts = summary(some)
        lines.append(
            [
                name,
                times,
                beginning,
                len(some),
                *(common.number(100.0 * facts[key], 1) for key in ("arrived", "collision_steps")),
                common.number(facts["exit_steps"], 1),
                *(common.number(100.0 * facts[key], 1) for key in ("unsafe_steps", "unsafe_untouched_steps")),
                *(common.number(facts[key], digits) for key, digits in (("least_distance", 2), ("median_ms", 1))),
                common.number(facts["slow_ms"], 1),
                *(common.number(100.0 * facts[key], 1) for key in ("braking", "evading")),
            ]
        )
    return common.table(HEADINGS, lines)


PUBLISHED = {
    Times.ECP: "published (ECP-MPC, nine scenes): 6.9 % of steps within 1.107 m, 55 steps to the exit, 15 % infeasible",
    Times.FCP: (
        "published (repository of FCP-MPC, June 2026; three scenes each): steps within 1.107 m, infeasible, %, steps\n"
        "to the goal: eth: ECP-MPC 4.7, 23.9, never; FCP-MPC hard 5.7, 70.0, 84, soft 17.5, -, 41; CC 3.6, -, 97\n"
        "hotel: ECP-MPC 2.0, 21.3, 86; FCP-MPC hard 6.8, 35.7, 80, soft 4.5, -, 36; CC 4.9, -, 99\n"
        "univ: ECP-MPC 29.2, 66.4, never; FCP-MPC hard 20.4, 57.9, 283, soft 17.4, -, 92; CC 6.8, -, never"
    ),
}


def section(rows: Sequence[Mapping[str, Any]], title: str) -> list[str]:
    """The section of the page of benchmarks."""
    text = (
        "A robot of 0.4 m radius at 0.8 m/s, with steps of 0.4 s, of which it stands for the first 15, among people "
        "who were recorded and do not react. Means over scenes."
    )
    return [f"## {title.capitalize()}", text, table(rows), f"{PUBLISHED[Times.ECP].capitalize()}."]
