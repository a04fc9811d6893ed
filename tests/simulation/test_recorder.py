"""Recordings of a loop of one's own: what was told and answered comes back, also after a crash."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp

LOOP = """
import os, signal, sys, time
import numpy as np
import scp_planner as sp
from scenes import disc, scene

planner = sp.Planner(scene(disc("far", (10.0, 8.0))))
with planner.record(sys.argv[1]):
    planner.add_obstacle("seen", {"rectangle": [0.6, 0.4]}, model="pedestrian", covariance=0.01 * np.eye(2))
    position, heading, speed = np.zeros(2), 0.0, 1.0
    for k in range(5):
        t = 0.1 * k
        planner.observe("seen", t, (12.0 - 0.5 * t, 2.0))
        plan = planner.replan(t, position, heading, speed)
        position, heading, speed = plan.position(t + 0.1), float(plan.heading(t + 0.1)), float(plan.speed(t + 0.1))
    while open(sys.argv[1]).read().count("\\n") < 7:
        time.sleep(0.01)
    if len(sys.argv) > 2:
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(scope="module", params=["whole", "killed"])
def recorded(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording that ended well, and one of a process that was killed, whose last line is half there."""
    path = tmp_path_factory.mktemp("recorded") / "drive.jsonl"
    killed = request.param == "killed"
    command = [sys.executable, "-c", LOOP, str(path), *(["now"] if killed else [])]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})
    assert done.returncode == (-signal.SIGKILL if killed else 0)
    if killed:
        with path.open("a", encoding="utf-8") as file:
            file.write('{"cycle": {"time": 0.5, "posi')
    return path


def test_a_recording_is_read_as_a_run(recorded: Path) -> None:
    run = sp.Run.load(recorded)
    assert run.time == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert run.records[0].outcome == "improved"
    assert all(cycle.wall_time > 0.0 for cycle in run.records)
    assert {zone.id for zone in run.records[-1].zones} == {"far", "seen"}
    (seen,) = run.records[2].observations
    assert seen.obstacle == "seen" and seen.time == pytest.approx(0.2)
    assert seen.position == pytest.approx((12.0 - 0.5 * 0.2, 2.0))
    shape = run.shapes["seen"]
    assert isinstance(shape, sp.Rectangle) and shape.rectangle == (0.6, 0.4)
    for plan, now in zip(run.plans, run.time, strict=True):
        assert isinstance(plan, sp.OnlinePlan)
        assert plan.position(now) == pytest.approx(run.position[np.flatnonzero(run.time == now)[0]], abs=1e-6)


def test_a_recording_is_drawn(recorded: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    run = sp.Run.load(recorded)
    for view in ("map", "space-time", "profiles"):
        run.plot(tmp_path / f"{view}.png", view=view)
    run.draw(tmp_path / "drive.html")
    assert "seen" in (tmp_path / "drive.html").read_text(encoding="utf-8")


def test_a_planner_goes_on_after_its_recording(tmp_path: Path) -> None:
    planner = sp.Planner(scene(disc("far", (10.0, 8.0))))
    with planner.record(tmp_path / "drive.jsonl"):
        planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    planner.replan(0.1, (0.1, 0.0), 0.0, 1.0)
    lines = (tmp_path / "drive.jsonl").read_text(encoding="utf-8").splitlines()
    assert [next(iter(json.loads(line))) for line in lines] == ["schema", "cycle"]


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="must end in"):
        sp.Planner(scene()).record(tmp_path / "drive.bin")
    (tmp_path / "empty.jsonl").write_text("", encoding="utf-8")
    with pytest.raises(sp.PlanError, match="without any replan"):
        sp.Run.load(tmp_path / "empty.jsonl")


def test_a_recording_of_one_replan_is_drawn(tmp_path: Path) -> None:
    planner = sp.Planner(scene(disc("far", (10.0, 8.0))))
    with planner.record(tmp_path / "drive.jsonl"):
        planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    assert len(sp.Run.load(tmp_path / "drive.jsonl").recording().time) > 0


@pytest.mark.parametrize(
    ("keys", "value", "told"),
    [
        (("cycle", "outcome"), 3, "line 2.cycle.outcome = 3: must be text"),
        (("cycle", "zones", 0, "center"), [], "line 2.cycle.zones[0].center = []: must be as many polynomials"),
        (("cycle", "zones", 0, "breakpoints"), [1.0, 0.0], "line 2.cycle.zones[0].breakpoints = [1.0, 0.0]: must incr"),
        (("cycle", "position"), [1.0], "line 2.cycle.position = [1.0]: too short"),
        (("cycle", "observed"), 1, "line 2.cycle.observed = 1: unknown key"),
        (("plan", "status"), [], "line 2.plan.status = []: must be 'certified'"),
        (("plan", "outcome"), "x", "line 2.plan.outcome = 'x': must be one of"),
        (("plan", "clearance", "time"), "x", "line 2.plan.clearance.time = 'x': must be a number"),
        (("arrived",), "no", "line 2.arrived = 'no'"),
    ],
)
def test_faults_of_a_recording_are_named_by_line_and_key(keys: Any, value: Any, told: str, tmp_path: Path) -> None:
    planner = sp.Planner(scene(disc("far", (10.0, 8.0))))
    file = tmp_path / "drive.jsonl"
    with planner.record(file):
        planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    first, second, _ = file.read_text().split("\n")
    line = json.loads(second)
    place = line
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    file.write_text(f"{first}\n{json.dumps(line)}\n")
    with pytest.raises(sp.PlanError) as caught:
        sp.Run.load(file)
    assert told in str(caught.value) and str(file) in str(caught.value)


def test_no_recording_is_read_in_part(tmp_path: Path) -> None:
    """A line that is broken in the middle is a fault, not the end."""
    planner = sp.Planner(scene(disc("far", (10.0, 8.0))))
    file = tmp_path / "drive.jsonl"
    with planner.record(file):
        planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    first, second, _ = file.read_text().split("\n")
    file.write_text(f"{first}\n{second}\n{second[:99]}\n{second}\n")
    with pytest.raises(sp.PlanError, match=r"line 3 = .*must be JSON"):
        sp.Run.load(file)
