"""Changes while driving: of the goal, the limits, the walls or the map, once in a drive."""

from __future__ import annotations

import numpy as np
import shapely

import scp_planner as sp
from benchmarks.hostile.features import Data, Rng
from benchmarks.hostile.scenes import map_of
from benchmarks.pairs.features.grid import draw_map, freed
from benchmarks.pairs.features.ground import draw_walls
from benchmarks.pairs.motion import Array
from benchmarks.pairs.scene import Change, Scene

LOWERED = 1.1
"""Times the largest speed of the motion, that a lowered limit is."""
EARLY = 0.25
"""Share of the time of other changes, at which another goal is set."""
ROOM = 4.0
"""Stopping distances round the vehicle that new ground leaves free."""


def add(scene: Scene, rng: Rng) -> None:
    change = (set_goal, set_limits, set_walls, update_map)[int(rng.integers(4))]
    change(scene, scene.motion.start + float(rng.uniform(0.1, 0.4)) * scene.motion.duration, rng)


def set_goal(scene: Scene, when: float, rng: Rng) -> None:
    """Begin with a goal on the way; set the other one before the motion passes the first place."""
    motion = scene.motion
    scene.begin_with_goal_at(float(rng.uniform(0.5, 0.8)), motion.start + EARLY * (when - motion.start))


def set_limits(scene: Scene, when: float, _: Rng) -> None:
    """Lower the top speed to little more than the motion has."""
    least = LOWERED * float(np.abs(scene.motion.speeds(scene.times)).max())
    backwards = scene.vehicle.get("reverse") or {"max_speed": 0.0}
    top = min(max(least, backwards["max_speed"]), scene.vehicle["max_speed"])

    def lower(planner: sp.Planner, _: Array) -> None:
        planner.set_limits(max_speed=top)

    scene.changes.append(Change(when, lower))


def set_walls(scene: Scene, when: float, rng: Rng) -> None:
    """Put up more walls, clear of the motion and of where the vehicle is."""
    drawn = draw_walls(scene, rng)

    def put_up(planner: sp.Planner, here: Array) -> Data:
        kept, away = _kept(scene, here), scene.clear
        added = [wall for wall in drawn if shapely.distance(shapely.Polygon(wall), kept) > away]
        walls = [*scene.data["walls"], *added]
        planner.set_walls(walls)
        return {"walls": walls}

    scene.changes.append(Change(when, put_up))


def update_map(scene: Scene, when: float, rng: Rng) -> None:
    """Give another map, clear of the motion and of where the vehicle is."""
    drawn = draw_map(scene, rng)

    def update(planner: sp.Planner, here: Array) -> Data:
        ground = freed(drawn, _kept(scene, here), scene.clear)
        planner.update_map(map_of(ground))
        return {"map": ground}

    scene.changes.append(Change(when, update))


def _kept(scene: Scene, here: Array) -> shapely.Geometry:
    """Ground that stays free: the motion, the way to it, and the vehicle's surroundings."""
    vehicle = scene.vehicle
    braking = vehicle["max_speed"] ** 2 / (2.0 * vehicle["max_deceleration"])
    around = shapely.Point(here).buffer(ROOM * (braking + vehicle["radius"]))
    return shapely.union_all([scene.swept, shapely.shortest_line(shapely.Point(here), scene.swept), around])
