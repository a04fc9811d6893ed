"""Crowds as an environment of Gymnasium."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scp_planner.simulation.crowds import circle_crossing
from scp_planner.simulation.worlds import VehicleState

gymnasium = pytest.importorskip("gymnasium")

from scp_planner.simulation.environment import CrowdEnv  # noqa: E402


@pytest.mark.parametrize("episode", ["circle", "square", "arena"])
def test_gymnasium_finds_nothing_wrong(episode: str) -> None:
    from gymnasium.utils.env_checker import check_env

    check_env(CrowdEnv(episode), skip_render_check=True)


def test_people_are_those_of_the_episode() -> None:
    """They decide by what the robot did before, as in the closed loop."""
    env, same = CrowdEnv("circle", 5, sees_vehicle=True), circle_crossing(4, 5, True)
    observed, _ = env.reset(seed=4)
    place, velocity = np.array(same.scenario.start.position), np.zeros(2)
    for action in ([0.0, 1.0], [0.6, 0.8], [0.0, 0.5]):
        same.people.step(0.25, VehicleState(0.0, place, velocity, 0.3))
        velocity = np.array(action)
        place = place + 0.25 * velocity
        observed, _, _, _, info = env.step(np.array(action, dtype=np.float32))
    assert observed["robot"][:4] == pytest.approx([*place, *velocity], abs=1e-5)
    assert observed["people"][:, :2] == pytest.approx(same.people.positions - place, abs=1e-5)
    assert info["time"] == pytest.approx(0.75)


def test_contact_ends_an_episode() -> None:
    env = CrowdEnv("circle", 1)
    observed, _ = env.reset(seed=3)
    ended: dict[str, Any] = {}
    for _ in range(200):
        towards = observed["people"][0, :2]
        observed, reward, terminated, truncated, info = env.step(
            (towards / max(float(np.hypot(*towards)), 1e-3)).astype(np.float32)
        )
        if terminated or truncated:
            ended = {"reward": reward, "terminated": terminated, "clearance": info["clearance"]}
            break
    assert ended["terminated"] and ended["reward"] == -0.25 and ended["clearance"] < 0.0 and not info["arrived"]


def test_the_goal_ends_an_episode_and_time_truncates_it() -> None:
    env = CrowdEnv("square", 1)
    observed, _ = env.reset(seed=1)
    while True:
        # Faster than allowed: it drives at 1 m/s all the same.
        observed, reward, terminated, truncated, info = env.step((10.0 * observed["robot"][5:]).astype(np.float32))
        if terminated or truncated:
            break
    assert terminated and reward == 1.0 and info["arrived"] and info["time"] == pytest.approx(7.75)
    env.reset(seed=1)
    steps = 0
    while True:
        steps += 1
        _, reward, terminated, truncated, info = env.step(np.zeros(2, dtype=np.float32))
        if terminated or truncated:
            break
    assert truncated and not terminated and reward == 0.0 and steps == 100


def test_people_out_of_view_are_not_observed() -> None:
    env = CrowdEnv("arena", 20)
    observed, _ = env.reset(seed=2)
    distance = np.hypot(*(env.episode.people.positions - env.stage.position).T)
    assert (observed["seen"] == (distance <= 5.0)).all() and 0 < observed["seen"].sum() < 20
    assert (observed["people"][observed["seen"] == 0] == 0.0).all()


def test_other_names_are_refused() -> None:
    with pytest.raises(ValueError, match="episode: 'ring' must be one of circle, square, arena"):
        CrowdEnv("ring")
    with pytest.raises(ValueError, match="people: 0 must be at least 1"):
        CrowdEnv(people=0)


def test_gymnasium_makes_it_by_its_id() -> None:
    made = gymnasium.make("scp_planner.simulation.environment:scp_planner/Crowd-v0", people=3)
    seen, _ = made.reset(seed=1)
    assert made.observation_space.contains(seen)
    assert isinstance(made.unwrapped, CrowdEnv)
