"""Crowds as an environment of Gymnasium, for robots that are driven by something else than this package."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, MultiBinary
from numpy.typing import NDArray

from scp_planner.arrays import Array
from scp_planner.simulation.crowds import Episode, circle_crossing, restless_arena, square_crossing
from scp_planner.simulation.stage import Stage

EPISODES: Mapping[str, Callable[[int, int, bool], Episode]] = MappingProxyType(
    {"circle": circle_crossing, "square": square_crossing, "arena": restless_arena}
)
WON, TOUCH_REWARD = 1.0, -0.25
"""Rewards, as CrowdNav gives them; less than 0.2 m from somebody costs 0.5 for each m and s."""

Observation = dict[str, NDArray[Any]]


class CrowdEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A robot among people: it chooses its velocity every step, and has it at once."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - what Gymnasium calls for

    def __init__(self, episode: str = "circle", people: int = 5, sees_vehicle: bool = False) -> None:
        if episode not in EPISODES:
            raise ValueError(f"episode: {episode!r} must be one of {', '.join(EPISODES)}")
        if people < 1:
            raise ValueError(f"people: {people!r} must be at least 1")
        self.make, self.count, self.sees_vehicle = EPISODES[episode], people, sees_vehicle
        self.render_mode = None
        top = self.make(0, 0, sees_vehicle).scenario.vehicle.max_speed
        self.action_space = Box(-top, top, (2,), np.float32)
        self.observation_space: Dict = Dict(  # type: ignore[assignment]  # of arrays, which its stubs do not say
            {
                "robot": Box(-1e3, 1e3, (7,), np.float32),
                "people": Box(-1e3, 1e3, (people, 5), np.float32),  # relative position, velocity, radius
                "seen": MultiBinary(people),
            }
        )

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002 - Gymnasium calls with it
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin another episode."""
        super().reset(seed=seed)
        number = int(self.np_random.integers(2**31)) if seed is None else seed
        self.episode = self.make(number, self.count, self.sees_vehicle)
        scenario = self.episode.scenario
        self.stage = Stage(scenario, self.episode.people, self.episode.shapes, scenario.start.time)
        self.stage.move_world(scenario.start.time)
        self.stage.write_down(scenario.start.time)
        self.goal = np.array(scenario.goal.position)
        self.velocity = np.zeros(2)
        return self._observed(), self._info(math.inf)

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for a step."""
        stage, step = self.stage, self.episode.step
        wanted = np.asarray(action, dtype=float)
        size, top = float(np.hypot(*wanted)), self.episode.scenario.vehicle.max_speed
        self.velocity = wanted * min(1.0, top / size) if size > 0.0 else wanted
        # The people see the velocity that the robot had when they decide.
        after = stage.clock + step
        stage.move_world(after)
        stage.position = stage.position + step * self.velocity
        stage.speed = min(size, top)
        if size > 0.0:
            stage.heading = math.atan2(self.velocity[1], self.velocity[0])
        stage.write_down(after)
        clearance = float(stage.clearances(len(stage.times) - 2).min(initial=math.inf))
        info = self._info(clearance)
        touched = clearance < 0.0
        arrived = info["arrived"] = info["arrived"] and not touched
        late = info["time"] >= self.episode.time_limit - 0.5 * step
        reward = TOUCH_REWARD if touched else WON if arrived else -0.5 * step * max(0.2 - clearance, 0.0)
        return self._observed(), reward, touched or arrived, late and not (touched or arrived), info

    def _observed(self) -> Observation:
        stage, people = self.stage, self.episode.people
        offset = people.positions - stage.position
        seen = np.hypot(offset[:, 0], offset[:, 1]) <= self.episode.view
        each = np.column_stack([offset, people.velocities, people.radii])
        radius = self.episode.scenario.vehicle.radius
        robot: Array = np.concatenate([stage.position, self.velocity, [radius], self.goal - stage.position])
        return {
            "robot": robot.astype(np.float32),
            "people": np.where(seen[:, None], each, 0.0).astype(np.float32),
            "seen": seen.astype(np.int8),
        }

    def _info(self, clearance: float) -> dict[str, Any]:
        scenario = self.episode.scenario
        near = float(np.hypot(*(self.goal - self.stage.position))) < scenario.goal.radius
        return {"time": self.stage.clock - scenario.start.time, "clearance": clearance, "arrived": near}


# gymnasium.make("scp_planner.simulation.environment:scp_planner/Crowd-v0") imports this module first.
gymnasium.register("scp_planner/Crowd-v0", f"{__name__}:CrowdEnv")
