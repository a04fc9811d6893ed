"""The same trip with all motions known: the time to compare with, and whether a stand was needed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.everyday.loop import LONG, Drive
from benchmarks.everyday.scene import Scene

COARSE = 0.2  # s, between two points of a known motion
LATER = 40.0  # s, for which motions are known beyond the end of a loop


def known_obstacles(scene: Scene, drive: Drive) -> list[dict[str, Any]]:
    """Obstacles of a scenario with the motions that a loop saw, and those to come where they are known."""
    found = []
    for agent in scene.agents:
        track = drive.tracks[agent.id][:: round(COARSE / 0.01)]
        points = [(time, *place) for time, place in track]
        if agent.has_known_future:
            end = points[-1][0]
            later = np.arange(end + COARSE, end + LATER, COARSE)
            points += [(float(time), *agent.motion(float(time), None)) for time in later]
        table = np.array(points)
        shape = dict(agent.shape)
        motion: dict[str, Any] = {"position": table[0, 1:].tolist()}
        if len(table) > 1 and np.ptp(table[:, 1:], axis=0).max() > 1e-6:
            motion = {"time": table[:, 0].tolist(), "position": table[:, 1:].tolist()}
        elif "rectangle" in shape:
            shape["heading"] = agent.heading
        found.append({"id": agent.id, "shape": shape, "motion": motion})
    return found


def known_trip(
    scene: Scene, drive: Drive, start: tuple[float, float, float, float] | None = None, time: float = 0.0
) -> sp.Plan:
    """Plan the trip with the true motions, from the scene's start or from a state on the way."""
    walls = scene.walls if scene.walls_at is None else scene.walls_at(math.inf, drive.path[0][1])
    return sp.plan(scene.scenario(known_obstacles(scene, drive), start, time, walls), time_limit=20.0)


def needless_stands(scene: Scene, drive: Drive) -> list[str]:
    """Describe each long stand in which a trip with the true motions would have set out more than 5 s earlier."""
    if scene.is_patrol:
        return [f"stands from {begin:.1f} to {end:.1f} s" for begin, end in drive.stands]
    times = [time for time, _ in drive.path]
    found = []
    for begin, end in drive.stands:
        _, robot = drive.path[int(np.searchsorted(times, begin + 0.05))]
        try:
            plan = known_trip(scene, drive, (*robot.position.tolist(), robot.heading, 0.0), begin)
        except sp.ScenarioError:  # somebody has come too near since
            continue
        if not plan.certified:
            continue
        sample = np.arange(begin, plan.arrival_time, 0.1)
        moving = np.flatnonzero(np.atleast_1d(plan.speed(sample)) > 0.05)
        waits = 0.1 * float(moving[0]) if len(moving) else 0.0
        if end - begin - waits > LONG:
            found.append(f"stands from {begin:.1f} to {end:.1f} s, could have set out after {waits:.1f} s")
    return found
