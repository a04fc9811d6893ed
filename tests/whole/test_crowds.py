"""The benchmarks among people: what is counted, and that each policy drives."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks import common
from benchmarks.crowds import __main__ as crowds
from benchmarks.crowds import policies, recorded
from benchmarks.report.__main__ import main as write_page
from scp_planner.arrays import Array
from scp_planner.simulation.crowds import circle_crossing
from scp_planner.tracking.tracks import Track, Tracks


def test_closest_is_that_of_many_points_between() -> None:
    rng = np.random.default_rng(2)
    before, after = rng.normal(size=(2, 30, 2))
    share = np.linspace(0.0, 1.0, 2001)[:, None, None]
    dense = np.linalg.norm(before + share * (after - before), axis=2).min(axis=0)
    assert policies.closest(before, after) == pytest.approx(dense, abs=1e-3)


def test_orca_is_hit_by_people_who_do_not_see_it_and_not_by_others() -> None:
    done = {sees: [policies.stepped(circle_crossing(k, 5, sees), policies.orca_velocity) for k in range(12)]
            for sees in (False, True)}  # fmt: skip
    assert all(each.success and each.least_distance > 0.0 for each in done[True])
    assert 0 < sum(not each.success for each in done[False]) < 12
    assert all((each.least_distance < 0.0) == (each.contact or each.contact_standing) for each in done[False])


def test_planner_crosses_and_the_page_tells(tmp_path: Path) -> None:
    options = ["--count", "1", "--people", "1", "--output", str(tmp_path), "--json", str(tmp_path / "one.json")]
    assert crowds.main(["circle", *options]) == 0
    facts = json.loads((tmp_path / "one.json").read_text())
    assert facts["success"] == 1.0 and facts["late"] == 0.0 and 7.5 < facts["mean_time"] < 15.0
    assert facts["least_distance"] > 0.0 and facts["profile"] == "crowd"
    assert crowds.main(["circle", "--policy", "wait", *options[:-2]]) == 0
    assert len(common.read_csv(tmp_path / "crowds.csv")) == 2
    page = tmp_path / "page.md"
    assert write_page(["--results", str(tmp_path), "--page", str(page)]) == 0
    assert "## Among people" in page.read_text() and "scp crowd" in page.read_text()


def test_recorded_scene_begins_where_the_published_one_does() -> None:
    """A person who walks by is there as recorded; the robot has seen it for 15 steps when it sets off."""
    times = 50.0 + 0.4 * np.arange(400.0)
    walked: Array = np.stack([0.05 * (times - 50.0), np.full(400, 5.0)], axis=-1)
    walker = Track("w", times, walked)
    drawn = recorded.scene("eth", Tracks([walker]), 1, recorded.Beginning.AS_RECORDED)
    start = drawn.scenario.start
    assert start.time == pytest.approx(50.0 + 0.4 * 215) and start.position == (5.0, 1.0)
    assert drawn.scenario.vehicle.max_speed == 0.8 and drawn.scenario.goal.radius == 0.6
    assert drawn.people["w"](np.array([start.time]))[0] == pytest.approx((0.05 * 0.4 * 215, 5.0))
    assert drawn.shapes["w"].disc + drawn.scenario.vehicle.radius == pytest.approx(0.4 + math.sqrt(0.5))


def _stands(name: str, first: float, last: float, place: tuple[float, float]) -> Track:
    return Track(name, np.array([first, last]), np.array([place, place]))


def test_recorded_scene_sets_off_when_nobody_touches_the_robot_nor_will_at_once() -> None:
    """One stands by the start until step 220; one is there from 7.5 steps, 3 s, before a recording begins."""
    step, (x, y) = recorded.STEP, recorded.PLACES["eth"].start
    there = _stands("there", 0.0, 220.0 * step, (x + 1.1, y))
    comes = _stands("comes", 240.0 * step, 250.0 * step, (x, y - 1.1))
    far = _stands("far", 0.0, 400.0 * step, (x, y + 1.2))
    for people, sets_off in (([far], 215), ([far, there], 223), ([far, there, comes], 223), ([far, comes], 215)):
        start = recorded.scene("eth", Tracks(people), 1).scenario.start
        assert round(start.time / step) == sets_off
    late = [far, there, _stands("late", 232.0 * step, 240.0 * step, (x, y - 1.1))]
    assert round(recorded.scene("eth", Tracks(late), 1).scenario.start.time / step) == 243


def test_recorded_people_walk_in_unless_as_recorded_is_asked_for() -> None:
    far = _stands("far", 0.0, 160.0, (9.0, 9.0))
    appears = Track("a", np.array([100.0, 101.0, 110.0]), np.array([[0.0, 0.0], [1.0, 0.0], [9.0, 0.0]]))
    before = np.array([98.0])
    walks, jumps = (
        recorded.scene("eth", Tracks([far, appears]), 1, each).people["a"](before)[0] for each in recorded.Beginning
    )
    assert walks == pytest.approx((-2.0, 0.0)) and np.isnan(jumps).all()


def test_recorded_scenes_are_those_with_people_to_the_end() -> None:
    for steps, count in ((199, 0), (200, 1), (299, 1), (300, 2)):
        assert recorded.scenes(Tracks([_stands("s", 7.0, 7.0 + steps * recorded.STEP, (0.0, 0.0))])) == count
