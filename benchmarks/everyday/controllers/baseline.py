"""Parts of the baselines: tracks at constant velocity, the distance to the goal, a vehicle within its limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from time import process_time
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from benchmarks.everyday.bodies import polygon_distance
from benchmarks.everyday.loop import Motion
from benchmarks.everyday.motions import Array, Robot
from benchmarks.everyday.scene import Agent, Scene, Walls

WINDOW = 7  # measurements of a track
NOTICED = 0.12  # m/s, below which a track stands
CELLS = 250  # along the longer side of a grid
FREE_CURVATURE = 4.0  # 1/m, of a vehicle without a limit, of one metre in size


@dataclass(frozen=True)
class Discs:
    """Obstacles as discs at constant velocities."""

    position: Array  # (n, 2) m
    velocity: Array  # (n, 2) m/s
    radius: Array  # (n,) m

    def at(self, times: Array) -> Array:
        """Positions (n, len(times), 2) after times, s."""
        return self.position[:, None] + np.multiply.outer(times, self.velocity).swapaxes(0, 1)


class Tracks:
    """Least-squares line through the last measurements of each obstacle."""

    def __init__(self, rate: float) -> None:
        self._forgotten = 3.0 * WINDOW / rate
        self._measured: dict[str, list[tuple[float, float, float]]] = {}
        self._shapes: dict[str, Mapping[str, Any]] = {}

    def add(self, time: float, agent: Agent, position: Array) -> None:
        rows = self._measured.setdefault(agent.id, [])
        rows.append((time, float(position[0]), float(position[1])))
        del rows[:-WINDOW]
        self._shapes[agent.id] = agent.shape

    def discs(self, time: float) -> Discs:
        """Return all obstacles at a time; a rectangle is four discs along its course."""
        found: list[tuple[Array, Array, float]] = []
        for name, rows in self._measured.items():
            table = np.array(rows)
            if time - table[-1, 0] > self._forgotten:
                continue
            place, velocity = table[-1, 1:], np.zeros(2)
            if len(table) > 2:
                basis = np.stack([np.ones(len(table)), table[:, 0] - time], axis=1)
                (place, velocity), *_ = np.linalg.lstsq(basis, table[:, 1:], rcond=None)
                if np.hypot(*velocity) < NOTICED:
                    velocity = np.zeros(2)
            found += _discs_of(self._shapes[name], place, velocity)
        places = np.array([each[0] for each in found]).reshape(-1, 2)
        return Discs(
            places, np.array([each[1] for each in found]).reshape(-1, 2), np.array([each[2] for each in found])
        )


def _discs_of(shape: Mapping[str, Any], place: Array, velocity: Array) -> list[tuple[Array, Array, float]]:
    if "disc" in shape:
        return [(place, velocity, float(shape["disc"]))]
    length, width = shape["rectangle"]
    heading = math.atan2(velocity[1], velocity[0]) if np.any(velocity) else 0.0
    ahead, half = np.array([math.cos(heading), math.sin(heading)]), 0.5 * max(length - width, 0.0)
    return [(place + along * ahead, velocity, 0.56 * width) for along in np.linspace(-half, half, 4)]


class DistanceField:
    """Shortest distance to the goal over a grid of cells that the vehicle's disc can stand in."""

    def __init__(self, scene: Scene, walls: Walls, goal: Mapping[str, Any]) -> None:
        self.goal = np.array(goal["position"], dtype=float)
        start = np.array(scene.start[:2])
        extent = max(float(np.hypot(*(self.goal - start))), 1.0)
        low, high = np.minimum(start, self.goal) - 0.35 * extent, np.maximum(start, self.goal) + 0.35 * extent
        if scene.bounds is not None:
            low, high = np.array(scene.bounds[0], dtype=float), np.array(scene.bounds[1], dtype=float)
        self._low, self.cell = low, max(float((high - low).max()) / CELLS, float(scene.vehicle["radius"]) / 6.0)
        self._shape = np.maximum(((high - low) / self.cell).astype(int) + 1, 2)
        x, y = (low[k] + self.cell * np.arange(self._shape[k]) for k in (0, 1))
        points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        free = np.ones(len(points), dtype=bool)
        for wall in walls:
            free &= polygon_distance(points, wall) > 0.0
        if scene.corridor is not None:
            free &= np.min([polygon_distance(points, part) for part in scene.corridor], axis=0) < 0.0
        grid = free.reshape(self._shape)
        self.closed = bool(walls) or scene.bounds is not None or scene.corridor is not None
        if scene.bounds is not None:
            grid[[0, -1]] = grid[:, [0, -1]] = False
        clearance = self.cell * (distance_transform_edt(grid) - 0.5) if not grid.all() else np.full(grid.shape, np.inf)
        self._free = clearance > float(scene.vehicle["radius"]) - 0.5 * self.cell
        self._distance = self._spread()

    def _index(self, points: Array) -> Array:
        return np.clip(np.rint((points - self._low) / self.cell).astype(int), 0, self._shape - 1)

    def _spread(self) -> Array:
        number = np.arange(self._free.size).reshape(self._free.shape)
        rows, columns, weights = [], [], []
        for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
            ours = (slice(0, -dx or None), slice(max(-dy, 0), -dy if dy > 0 else None))
            theirs = (slice(dx, None), slice(max(dy, 0), dy if dy < 0 else None))
            both = self._free[ours] & self._free[theirs]
            rows.append(number[ours][both])
            columns.append(number[theirs][both])
            weights.append(np.full(int(both.sum()), self.cell * math.hypot(dx, dy)))
        count = self._free.size
        graph = coo_array((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), (count, count))
        source = number[tuple(self._index(self.goal))]
        return np.asarray(dijkstra(graph.tocsr(), directed=False, indices=int(source))).reshape(self._free.shape)

    def distance(self, points: Array) -> Array:
        """Distances to the goal of points (..., 2), m; the straight distance and a large number where none leads on."""
        i, j = np.moveaxis(self._index(points), -1, 0)
        straight = np.hypot(points[..., 0] - self.goal[0], points[..., 1] - self.goal[1])
        if not self.closed:
            return np.asarray(straight)
        found = self._distance[i, j]
        return np.where(np.isfinite(found) & self.is_free(points), np.maximum(found, straight), straight + 1e3)

    def is_free(self, points: Array) -> Array:
        i, j = np.moveaxis(self._index(points), -1, 0)
        inside = ((points >= self._low) & (points <= self._low + self.cell * (self._shape - 1))).all(axis=-1)
        return np.asarray(self._free[i, j] & inside if self.closed else np.ones(points.shape[:-1], dtype=bool))

    def direction(self, place: Array, ahead: float) -> Array:
        """Unit vector (2,) of the shortest way from a place, which looks so far ahead, m."""
        straight = self.goal - place
        if not self.closed or np.hypot(*straight) < ahead:
            return np.asarray(straight / max(float(np.hypot(*straight)), 1e-9))
        angle = np.linspace(0.0, 2.0 * np.pi, 65)[:-1]
        around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        reach = np.linspace(0.25, 1.0, 4)[:, None, None] * ahead * around
        open_way = self.is_free(place + reach).all(axis=0)
        cost = self.distance(place + ahead * around) + np.where(open_way, 0.0, 1e4)
        return np.asarray(around[int(np.argmin(cost))])


class Vehicle:
    """Unicycle or car with its limits, driven by an acceleration and a curvature over one period."""

    def __init__(self, facts: Mapping[str, Any]) -> None:
        self.radius, self.discs = float(facts["radius"]), np.array(facts.get("discs", [0.0]))
        self.acceleration, self.deceleration = float(facts["max_acceleration"]), float(facts["max_deceleration"])
        self.top_speed = float(facts["max_speed"])
        self.curvature = float(facts.get("max_curvature") or FREE_CURVATURE)
        self.lateral = float(facts.get("max_lateral_acceleration") or math.inf)

    def allowed_curvature(self, speed: Any) -> Any:
        return np.minimum(self.curvature, self.lateral / np.maximum(speed, 0.05 * self.top_speed) ** 2)

    def motion(self, time: float, robot: Robot, acceleration: float, curvature: float, period: float) -> Motion:
        """Drive with constant values from a state, and stand once the speed is zero."""
        speed, top = max(robot.speed, 0.0), self.top_speed
        rate = min(max(acceleration, -self.deceleration), self.acceleration)
        fastest = min(max(speed + max(rate, 0.0) * period, speed), top)
        limit = float(self.allowed_curvature(fastest))
        bend = min(max(curvature, -limit), limit)
        place, heading = robot.position.copy(), robot.heading
        ends = (top - speed) / rate if rate > 0.0 else speed / -rate if rate < 0.0 else math.inf

        def at(when: float) -> tuple[Array, Array]:
            passed = max(when - time, 0.0)
            driven = min(passed, max(ends, 0.0))
            now = speed + rate * driven
            way = speed * driven + 0.5 * rate * driven**2 + now * (passed - driven)
            turned = heading + bend * way
            chord = way * np.sinc(0.5 * bend * way / np.pi)
            middle = heading + 0.5 * bend * way
            return place + chord * np.array([math.cos(middle), math.sin(middle)]), np.array([turned, now])

        return at


class Baseline:
    """Base of the baselines: what they know of the scene, and the rule of arrival."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.vehicle, self.tracks = scene, Vehicle(scene.vehicle), Tracks(scene.rate)
        self.goal: Mapping[str, Any] = scene.goals[0]
        self.walls: Walls = scene.walls
        self.unsafe, self.times = 0, list[float]()
        self.reason = ""

    @cached_property
    def field(self) -> DistanceField:
        return DistanceField(self.scene, self.walls, self.goal)

    def _forget_field(self) -> None:
        self.__dict__.pop("field", None)

    def set_goal(self, goal: Mapping[str, Any]) -> None:
        self.goal = goal
        self._forget_field()

    def set_walls(self, walls: Walls) -> None:
        self.walls = walls
        self._forget_field()

    def observe(self, time: float, agent: Agent, position: Array, noise: float) -> None:
        self.tracks.add(time, agent, position)

    def has_arrived(self, robot: Robot) -> bool:
        return self.scene.is_at(self.goal, robot)

    def explains(self, time: float, agent: Agent, place: Array) -> str:
        return "a baseline promises nothing"

    def step(self, time: float, robot: Robot) -> Motion:
        began = process_time()
        acceleration, curvature = self.command(robot, self.tracks.discs(time))
        self.times.append(1e3 * (process_time() - began))
        return self.vehicle.motion(time, robot, acceleration, curvature, self.scene.period)

    def command(self, robot: Robot, others: Discs) -> tuple[float, float]:
        """Return an acceleration, m/s2, and a curvature, 1/m, for the next period."""
        raise NotImplementedError

    @property
    def stops(self) -> bool:
        """True if the vehicle is to stand at its goal."""
        return self.goal.get("speed") == 0.0

    def speed_to_goal(self, left: float) -> float:
        """Largest speed, m/s, from which the vehicle stands after so many metres, if it is to."""
        if not self.stops:
            return self.vehicle.top_speed
        return math.sqrt(1.6 * self.vehicle.deceleration * max(left, 0.0))
