"""Tracked objects of other programs: what messages say is what a planner is told."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import command
import numpy as np
import pytest
from scenes import scene
from tracked_messages import autoware, derived, detections, header, make, nav2, odometry, teb, write_bag

import scp_planner as sp
from scp_planner.formats.tracked_objects import Unknowns, tracked_objects
from scp_planner.simulation.replay import TrackFeed, replay

pytest.importorskip("rosbags")

AT, GOING, HEADING = (3.0, -2.0), (0.6, 0.8), math.atan2(0.8, 0.6)


@pytest.mark.parametrize("predicted", [True, False])
def test_autoware_states_are_turned_into_the_map(predicted: bool) -> None:
    """The twist, and its covariance, are in the frame of the object."""
    (found,) = tracked_objects(autoware(2.5, AT, GOING, label=7, predicted=predicted))
    assert (found.id, found.time, found.model) == ("07" * 16, 2.5, "pedestrian")
    assert found.position == pytest.approx(AT) and found.velocity == pytest.approx(GOING)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    assert found.covariance[:2, :2] == pytest.approx(np.diag([0.04, 0.09]))
    assert found.covariance[2:, 2:] == pytest.approx(turn @ np.diag([0.25, 0.01]) @ turn.T)
    assert isinstance(found.shape, sp.Rectangle)
    assert found.shape.rectangle == (0.8, 0.6) and found.shape.heading is None
    if predicted:
        assert found.futures is not None
        first, second = found.futures.futures
        assert (first.weight, second.weight) == pytest.approx((0.75, 0.25))
        assert isinstance(first.motion, sp.Course)
        assert first.motion.time == pytest.approx([2.5, 3.0, 3.5])
        assert first.motion.position[2] == pytest.approx((3.6, -1.2))
    else:
        assert found.futures is None


def test_what_stands_keeps_its_heading() -> None:
    (found,) = tracked_objects(autoware(0.0, AT, (0.0, 0.0), heading=0.3, label=1))
    assert isinstance(found.shape, sp.Rectangle) and found.shape.heading == pytest.approx(0.3)
    assert found.model == "car"


def test_footprints_and_cylinders_of_autoware() -> None:
    corners = [(1.0, 0.5), (-1.0, 0.5), (-1.0, -0.5), (1.0, -0.5)]
    (found,) = tracked_objects(autoware(0.0, AT, (0.0, 0.0), heading=math.pi / 2, kind=2, footprint=corners))
    assert isinstance(found.shape, sp.PolygonShape)
    assert {tuple(np.round(corner, 9)) for corner in found.shape.polygon} == {
        (-0.5, 1),
        (-0.5, -1),
        (0.5, -1),
        (0.5, 1),
    }
    (round_one,) = tracked_objects(autoware(0.0, AT, GOING, kind=1))
    assert round_one.shape == sp.Disc(disc=0.4)


def test_objects_of_derived_object_msgs() -> None:
    box, ball, detected = tracked_objects(derived(1.0, AT, GOING))
    assert (box.id, box.model) == ("1", "car")
    assert box.velocity == pytest.approx(GOING)
    assert isinstance(box.shape, sp.Rectangle) and box.shape.rectangle == (4.0, 1.8)
    assert ball.shape == sp.Disc(disc=0.5) and ball.model is None
    assert detected.velocity is None
    assert detected.covariance[0, 0] == pytest.approx(Unknowns().position ** 2)


def test_detections_are_positions() -> None:
    (found,) = tracked_objects(detections(1.0, AT))
    assert (found.id, found.model, found.velocity) == ("track-4", "pedestrian", None)
    assert found.covariance[:2, :2] == pytest.approx(0.01 * np.eye(2))
    assert found.shape == sp.Disc(disc=0.5)


def test_obstacles_of_nav2_and_teb() -> None:
    (walker,) = tracked_objects(nav2(1.0, AT, GOING))
    assert walker.position == pytest.approx(AT) and walker.velocity == pytest.approx(GOING)
    assert walker.shape == sp.Disc(disc=0.25) and walker.covariance[2, 2] == pytest.approx(0.04)
    point, square = tracked_objects(teb(1.0, AT, GOING))
    assert point.position == pytest.approx(AT) and point.shape == sp.Disc(disc=0.3)
    assert square.position == pytest.approx((5.0, 1.0)) and isinstance(square.shape, sp.PolygonShape)
    assert point.velocity == pytest.approx(GOING)


def test_other_messages_are_refused() -> None:
    with pytest.raises(ValueError, match="holds no tracked objects"):
        tracked_objects(make("std_msgs/msg/String", data="a"))
    strange = type("Strange", (), {"objects": [object()], "header": header(0.0)})()
    with pytest.raises(ValueError, match="no tracked object of a known kind"):
        tracked_objects(strange)


@pytest.mark.parametrize("message", [autoware, nav2], ids=["futures", "states"])
def test_a_planner_is_told_of_what_comes_goes_and_comes_back(message: Any) -> None:
    planner = sp.Planner(scene())
    feed = TrackFeed(planner, keep=0.5)
    (name,) = feed.take(message(0.0, (8.0, -2.0), (0.0, 0.5)))
    planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    assert {zone.id for zone in planner.zones} == {name}
    assert planner.zones[0].center(1.0) == pytest.approx((8.0, -1.5), abs=0.05)
    for time in (0.4, 0.8):
        empty = message(time, (0.0, 0.0), (0.0, 0.0))
        setattr(empty, "objects" if hasattr(empty, "objects") else "obstacles", [])
        feed.take(empty)
        planner.replan(time, (0.8 * time, 0.0), 0.0, 1.0)
        assert {zone.id for zone in planner.zones} == ({name} if time < 0.5 else set())
    feed.take(message(1.0, (8.0, -1.5), (0.0, 0.5)))
    planner.replan(1.0, (1.0, 0.0), 0.0, 1.0)
    assert planner.zones[0].center(2.0) == pytest.approx((8.0, -1.0), abs=0.05)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot that drives on at 1 m/s while a walker crosses, at the time of a Unix clock."""
    start = 1.7e9
    times = start + 0.1 * np.arange(31)
    messages = [odometry(t, (t - start, 0.0), 0.0, 1.0) for t in times.tolist()]
    messages += [autoware(t, (6.0, -3.0 + 0.8 * (t - start)), (0.0, 0.8), predicted=False) for t in times.tolist()]
    return write_bag(tmp_path_factory.mktemp("bags") / "drive", messages)


def test_a_recording_is_replanned(bag: Path) -> None:
    run = replay(bag, (10.0, 0.0), period=0.2)
    assert len(run.records) == 15 and all(record.safe for record in run.records)
    assert run.position[5] == pytest.approx((1.0, 0.0), abs=1e-3)
    assert run.plans[0].position(run.plans[0].arrival_time) == pytest.approx((10.0, 0.0), abs=0.5)
    for plan, record in zip(run.plans, run.records, strict=True):
        assert plan.position(record.time) == pytest.approx(record.position, abs=1e-3)
        (zone,) = record.zones
        assert zone.center(record.time)[1] == pytest.approx(-3.0 + 0.8 * (record.time - 1.7e9), abs=0.1)


def test_the_command_reports(bag: Path, tmp_path: Path) -> None:
    done = command.run("replay", bag, "--goal", "10,0", "--period", "0.5", "-o", tmp_path / "run.json")
    assert done.exit_code == 0, done.output
    assert "replans:                 6" in done.output and "tracked objects:         1" in done.output
    assert len(sp.Run.load(tmp_path / "run.json").records) == 6


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--goal", "10"], "must be two numbers"),
        (["--goal", "10,0", "--period", "0"], "must be above 0"),
    ],
)
def test_wrong_options_are_refused(bag: Path, options: list[str], told: str) -> None:
    done = command.run("replay", bag, *options)
    assert done.exit_code == 2 and told in done.output


def test_a_recording_without_objects_is_refused(tmp_path: Path) -> None:
    empty = write_bag(tmp_path / "empty", [odometry(0.0, (0.0, 0.0), 0.0, 1.0)])
    done = command.run("replay", empty, "--goal", "10,0")
    assert done.exit_code == 2 and "has no message of" in done.output
    (tmp_path / "folder").mkdir()
    done = command.run("replay", tmp_path / "folder", "--goal", "10,0")
    assert done.exit_code == 2
