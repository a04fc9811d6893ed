"""Obstacles that were forgotten or removed, and what is said of them afterwards."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from replanning import begin, follow
from scenes import scene

import scp_planner as sp
from scp_planner.online.planner import Planner

pytestmark = pytest.mark.numerics

COVARIANCE = np.diag([0.01, 0.01, 0.04, 0.04])


def driving(forget_after: float = 1.0) -> Planner:
    """A planner at 2 s that has forgotten what it saw at 0 s."""
    scenario = scene(vehicle={"max_speed": 1.0}, start={"speed": 0.0})
    planner = Planner(scenario, online=sp.OnlineSettings(forget_after=forget_after))
    planner.add_obstacle("a", {"disc": 0.7}, covariance=0.04 * np.eye(2), model="pedestrian", margin=0.2)
    planner.observe("a", 0.0, (10.0, 4.0))
    begin(planner, scenario)
    for k in range(1, 21):
        follow(planner, 0.1 * k)
    return planner


def observe(planner: Planner) -> None:
    planner.observe("a", 2.05, (10.0, 4.0))


def update(planner: Planner) -> None:
    planner.update_obstacle("a", 2.05, (10.0, 4.0), (0.0, 0.0), covariance=COVARIANCE)


def predict(planner: Planner) -> None:
    planner.update_motion("a", {"time": 2.0, "position": [10.0, 4.0]})


@pytest.mark.parametrize("tell", [observe, update, predict])
@pytest.mark.parametrize("removed", [True, False])
def test_an_obstacle_that_is_seen_again_is_back_as_it_was_added(tell: Callable[[Planner], None], removed: bool) -> None:
    planner = driving(1e9 if removed else 1.0)
    if removed:
        planner.remove_obstacle("a")
    else:
        assert planner.notes[-1] == "a: forgotten, not seen for 1 s"
    assert "a" not in planner.obstacles.tracks
    tell(planner)
    follow(planner, 2.1)
    (zone,) = planner.zones
    assert zone.center(2.1) == pytest.approx([10.0, 4.0], abs=0.01)
    assert zone.radius == pytest.approx(0.9)  # shape and margin
    assert any(note == "a: it had gone, and is back as it was added" for note in planner.notes)
    if tell is observe:
        other = driving(1e9)
        other.remove_obstacle("a")
        other.add_obstacle("a", {"disc": 0.7}, covariance=0.04 * np.eye(2), model="pedestrian", margin=0.2)
        tell(other)
        follow(other, 2.1)
        assert zone.covariance(3.0) == pytest.approx(other.zones[0].covariance(3.0))  # noise and model


def test_what_was_seen_before_it_went_does_not_bring_it_back() -> None:
    planner = driving(1e9)
    planner.remove_obstacle("a")
    planner.observe("a", 1.9, (10.0, 4.0))
    follow(planner, 2.1)
    assert not planner.zones
    planner.observe("a", 2.1, (10.0, 4.0))
    follow(planner, 2.2)
    assert [zone.id for zone in planner.zones] == ["a"]


def test_to_remove_one_that_has_gone_is_noted() -> None:
    planner = driving()
    planner.remove_obstacle("a")
    assert planner.notes[-1] == "a: removed, but it had gone already"
    assert follow(planner, 2.1).safe


def test_one_that_has_gone_may_be_added_anew() -> None:
    planner = driving()
    planner.add_obstacle("a", {"disc": 0.3}, covariance=0.04 * np.eye(2), model={"order": 0})
    observe(planner)
    follow(planner, 2.1)
    assert planner.zones[0].radius == pytest.approx(0.3)


@pytest.mark.parametrize("call", ["observe", "update_obstacle", "update_motion", "remove_obstacle"])
def test_ids_that_were_never_added_are_misuse(call: str) -> None:
    planner = driving()
    calls: dict[str, Callable[[], None]] = {
        "observe": lambda: planner.observe("b", 2.0, (0.0, 0.0)),
        "update_obstacle": lambda: planner.update_obstacle("b", 2.0, (0, 0), (0, 0), covariance=COVARIANCE),
        "update_motion": lambda: planner.update_motion("b", {"position": [0.0, 0.0]}),
        "remove_obstacle": lambda: planner.remove_obstacle("b"),
    }
    with pytest.raises(ValueError, match=f"{call}: there is no obstacle 'b'"):
        calls[call]()
