"""Closed loops as pictures show them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scenes import POCKET, scene, shaped

import scp_planner as sp
from scp_planner import builtin
from scp_planner.plotting import animate
from scp_planner.plotting.recording import Recording
from scp_planner.plotting.run_recording import record_run
from scp_planner.plotting.viewer import save_recording
from scp_planner.simulation.loop import simulate
from scp_planner.simulation.run import Run


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(builtin.load("headon"), rate=4.0)


@pytest.fixture(scope="module")
def recording(run: Run) -> Recording:
    return record_run(run, frames_per_second=8.0)


def test_course_is_what_was_driven(run: Run, recording: Recording) -> None:
    assert recording.time[0] == run.time[0] and recording.time[-1] == run.time[-1]
    assert np.diff(recording.time) == pytest.approx(1.0 / 8.0, rel=0.05)
    for axis in (0, 1):
        assert np.array_equal(recording.position[:, axis], np.interp(recording.time, run.time, run.position[:, axis]))
    speed, acceleration, *_ = recording.profiles
    assert np.array_equal(speed.values, np.interp(recording.time, run.time, run.speed))
    gained = np.trapezoid(acceleration.values, recording.time)
    assert gained == pytest.approx(run.speed[-1] - run.speed[0], abs=0.1)


def test_each_time_shows_the_plan_of_its_cycle(run: Run, recording: Recording) -> None:
    cycles = np.array([cycle.time for cycle in run.records])
    for time, position, number in zip(recording.time, recording.position, recording.path_index, strict=True):
        assert cycles[number] <= time + 1e-6
        assert number == len(cycles) - 1 or time < cycles[number + 1] + 1e-6
        # A vehicle that follows exactly is on that plan, and the plan begins where the cycle did.
        path = recording.paths[number]
        assert np.linalg.norm(path - position, axis=1).min() < 0.15
    for number, cycle in enumerate(run.records):
        assert recording.paths[number][0] == pytest.approx(cycle.position, abs=1e-3)


def test_each_time_shows_the_zones_of_its_cycle(run: Run, recording: Recording) -> None:
    for obstacle in recording.obstacles:
        for i, time in enumerate(recording.time):
            known = {zone.id: zone for zone in run.records[recording.path_index[i]].zones}[obstacle.id]
            assert obstacle.center[i] == pytest.approx(known.center(time), abs=1e-12)
            (outline,) = obstacle.zone_at(i)
            assert np.abs(known.signed_distance(np.full(len(outline), time), outline)).max() < 1e-6
            expected = known.signed_distance(time, recording.position[i]) - recording.radius
            assert obstacle.clearance[i] == pytest.approx(expected, abs=1e-9)


def test_zones_keep_their_shapes(tmp_path: Path) -> None:
    """In the record, in its file, and in pictures; also what is concave, or turns."""
    obstacles = shaped(
        pocket=({"polygon": POCKET}, {"position": [6.0, 3.5]}),
        car=({"rectangle": [3.0, 1.0]}, {"position": [4.0, -4.0], "velocity": [1.0, 0.2]}),
        pond=({"ellipse": [2.0, 0.5], "heading": 0.4}, {"position": [3.0, -2.5]}),
    )
    run = simulate(scene(*obstacles, goal={"position": [6.0, 0.0]}), noise=0.01, rate=4.0)
    run.save(tmp_path / "run.json")
    assert Run.load(tmp_path / "run.json") == run
    # What turns with an estimated motion is widened by what its heading may be off.
    pieces = {record.id: min(len(record.outlines), 2) for record in run.records[-1].zones}
    assert pieces == {"pocket": 2, "car": 1, "pond": 1}
    recording = record_run(run, frames_per_second=2.0)
    last = len(recording.time) - 1
    for obstacle in recording.obstacles:
        zone = next(zone for zone in run.records[-1].zones if zone.id == obstacle.id)
        drawn = obstacle.zone_at(last)
        if obstacle.id == "pocket":
            assert len(drawn) == len(zone.outlines) > 1
        for piece, outline in zip(drawn, zone.outlines or (None,), strict=True):
            alone = zone if outline is None else replace(zone, outlines=(outline,))
            assert np.abs(alone.signed_distance(np.full(len(piece), recording.time[last]), piece)).max() < 1e-5
        # The true shape, somewhere in its zone.
        center = obstacle.truth_at(last)
        assert center is not None
        corners = obstacle.body_at(last, center)
        assert zone.signed_distance(np.full(len(corners), recording.time[last]), corners).max() < 0.1


def test_truth_and_observations_are_those_of_the_run(run: Run, recording: Recording) -> None:
    for obstacle in recording.obstacles:
        truth = run.obstacles[obstacle.id]
        assert obstacle.truth is not None
        assert np.allclose(obstacle.truth[-1], truth[-1])
        seen = sum(seen.obstacle == obstacle.id for cycle in run.records for seen in cycle.observations)
        assert obstacle.observed is not None and len(obstacle.observed) == seen > 10


def test_facts_tell_how_it_ended(recording: Recording, run: Run) -> None:
    facts = dict(recording.facts)
    assert facts["closed loop"].startswith("arrived")
    assert facts["travel time"] == f"{run.travel_time:.2f} s"
    assert facts["cycles"].startswith(f"{len(run.records)}: ")


def test_obstacles_that_come_late(tmp_path: Path) -> None:
    """While nobody knows of an obstacle there is no zone to show; while it is not there, nothing at all."""
    alone = builtin.load("headon").model_copy(update={"obstacles": ()})
    appears = np.array([2.0, 30.0])
    world = {"late": (appears, np.array([[25.0, 3.0], [-10.0, 3.0]]))}
    run = simulate(alone, rate=4.0, world=world, shapes={"late": sp.Disc(disc=0.4)})
    recording = record_run(run, 3.0)
    (late,) = recording.obstacles
    unknown = np.asarray(np.isnan(late.center).any(axis=1))
    assert unknown[0] and not unknown[-1]
    assert np.isnan(late.clearance[unknown]).all() and np.isinf(recording.clearance[unknown]).all()
    assert late.truth_at(0) is None and late.truth_at(len(recording.time) - 1) is not None
    animate(recording, tmp_path / "late.gif")
    with Image.open(tmp_path / "late.gif") as film:
        assert film.n_frames == len(recording.time)  # type: ignore[attr-defined]
    assert recording.extent()[1][0] < 25.0  # where the obstacle is far away, nobody needs to look
    save_recording(recording, tmp_path / "late.html")
    assert "NaN" not in (tmp_path / "late.html").read_text().split('id="data">')[1].split("</script>")[0]
