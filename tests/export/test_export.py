"""Tables and messages: that what other programs read is the plan."""

from __future__ import annotations

import csv
import importlib.util
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import command
import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner import builtin
from scp_planner.export import (
    cycle_table,
    plan_messages,
    plan_table,
    run_messages,
    run_table,
    save_messages,
    save_table,
)

pytestmark = pytest.mark.numerics


@pytest.fixture(scope="module")
def plan() -> sp.Plan:
    return sp.plan(builtin.load("radar"))


@pytest.fixture(scope="module")
def late(plan: sp.Plan) -> sp.Plan:
    """A plan on a Unix clock."""
    scenario = builtin.load("crossing").model_copy(update={"obstacles": ()})
    start = scenario.start.model_copy(update={"time": 1.6e9 + 0.125})
    return sp.plan(scenario.model_copy(update={"start": start}))


@pytest.fixture(scope="module")
def run() -> sp.Run:
    return sp.simulate(scene(disc("a,b", (8.0, -3.0), (0.0, 0.8)), goal={"position": [8.0, 0.0]}), noise=0.02, rate=4.0)


# Tables


def test_columns_are_the_plan(plan: sp.Plan) -> None:
    table = plan_table(plan, 50)
    time = np.linspace(plan.start_time, plan.arrival_time, 50)
    assert np.array_equal(table["time_s"], time)
    assert np.array_equal(np.stack([table["x_m"], table["y_m"]], axis=-1), plan.position(time))
    assert np.array_equal(table["heading_rad"], plan.heading(time))
    assert np.array_equal(table["acceleration_m_per_s2"], plan.acceleration(time))
    # The others follow from these.
    velocity = np.stack([table["velocity_x_m_per_s"], table["velocity_y_m_per_s"]], axis=-1)
    assert np.linalg.norm(velocity, axis=1) == pytest.approx(table["speed_m_per_s"], abs=1e-12)
    assert np.arctan2(velocity[:, 1], velocity[:, 0]) == pytest.approx(table["heading_rad"], abs=1e-12)
    fine = np.linspace(plan.start_time, plan.arrival_time, 20_001)
    driven = np.cumsum(np.linalg.norm(np.diff(plan.position(fine), axis=0), axis=1))
    assert table["distance_m"] == pytest.approx(np.interp(time, fine[1:], driven), abs=2e-3)


def test_lateral_acceleration_is_that_of_the_velocity(plan: sp.Plan) -> None:
    time, step = np.linspace(plan.start_time + 0.1, plan.arrival_time - 0.1, 40), 1e-5
    table = plan_table(plan, time)
    change = (plan.velocity(time + step) - plan.velocity(time - step)) / (2.0 * step)
    left = np.stack([-np.sin(table["heading_rad"]), np.cos(table["heading_rad"])], axis=-1)
    assert np.sum(change * left, axis=1) == pytest.approx(table["lateral_acceleration_m_per_s2"], abs=1e-5)


@pytest.mark.parametrize("times", [1, 0, [], [[1.0, 2.0]], [math.nan]])
def test_wrong_times_are_refused(plan: sp.Plan, times: Any) -> None:
    with pytest.raises(ValueError, match="times: must be"):
        plan_table(plan, times)


def test_csv_keeps_every_bit(plan: sp.Plan, tmp_path: Path) -> None:
    table = plan_table(plan)
    save_table(table, tmp_path / "plan.csv")
    with (tmp_path / "plan.csv").open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == list(table)
    assert np.array_equal(np.array(rows, dtype=float), np.stack(list(table.values()), axis=-1))


def test_numpy_reads_the_npz(plan: sp.Plan, tmp_path: Path) -> None:
    table = plan_table(plan)
    save_table(table, tmp_path / "plan.npz")
    with np.load(tmp_path / "plan.npz") as read:
        assert list(read) == list(table)
        assert all(np.array_equal(read[name], column) for name, column in table.items())
    assert [path.name for path in tmp_path.iterdir()] == ["plan.npz"]


def test_run_as_tables(run: sp.Run, tmp_path: Path) -> None:
    table = run_table(run)
    assert np.array_equal(table["a,b.y_m"], run.obstacles["a,b"][:, 1])
    save_table(table, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["a,b.x_m"]) for row in rows] == run.obstacles["a,b"][:, 0].tolist()
    assert [float(row["speed_m_per_s"]) for row in rows] == run.speed.tolist()
    cycles = cycle_table(run)
    assert cycles["time_s"].tolist() == [record.time for record in run.records]
    assert {name: (cycles["outcome"] == name).sum() for name in run.outcomes} == run.outcomes
    assert {len(column) for column in cycles.values()} == {len(run.records)}


# Messages


needs_rosbags = pytest.mark.skipif(
    importlib.util.find_spec("rosbags") is None, reason="needs rosbags, which is not installed"
)


def read_back(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Contents by the library's own reader: by topic, the stamps and the messages."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        found: dict[str, list[tuple[int, Any]]] = {connection.topic: [] for connection in reader.connections}
        for connection, stamp, data in reader.messages():
            found[connection.topic].append((stamp, reader.deserialize(data, connection.msgtype)))
    return found


def read_by_another(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Contents by a reader that shares no code with the writer."""
    reader = pytest.importorskip("mcap_ros2.reader", reason="needs mcap-ros2-support, which is not installed")
    found: dict[str, list[tuple[int, Any]]] = {}
    for message in reader.read_ros2_messages(str(path)):
        found.setdefault(message.channel.topic, []).append((message.log_time_ns, message.ros_msg))
    return found


def seconds(stamp: Any) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec


def heading_of(quaternion: Any) -> float:
    """The turn about z of any unit quaternion."""
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    assert x * x + y * y + z * z + w * w == pytest.approx(1.0, abs=1e-12)
    assert (x, y) == (0.0, 0.0)
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def check_plan(found: dict[str, list[tuple[int, Any]]], plan: sp.Plan, count: int) -> None:
    """The path's poses and the trajectory's points are the plan at their times.

    To the bit the plan at all times together, as the table is. Asked for one time alone, the plan may round
    differently.
    """
    assert set(found) == {"/plan/path", "/plan/trajectory"}
    ((sent, path),), ((also_sent, trajectory),) = found["/plan/path"], found["/plan/trajectory"]
    assert sent == also_sent == round(plan.start_time * 1e9)
    assert path.header.frame_id == trajectory.header.frame_id == "odom"
    assert list(trajectory.joint_names) == ["robot"]
    assert len(path.poses) == len(trajectory.points) == count
    times = np.linspace(plan.start_time, plan.arrival_time, count)
    positions = plan.position(times)
    rounding = 1e-12 * max(1.0, np.abs(positions).max())
    resolution = 1e-9 + np.spacing(plan.arrival_time)
    speed, acceleration = 3.0, 5.0
    assert seconds(path.header.stamp) == pytest.approx(plan.start_time, abs=resolution)
    for time, position, pose, point in zip(times, positions, path.poses, trajectory.points, strict=True):
        assert position == pytest.approx(plan.position(time), rel=0.0, abs=rounding)
        assert pose.header.frame_id == "odom"
        assert seconds(pose.header.stamp) == pytest.approx(time, abs=resolution)
        assert [pose.pose.position.x, pose.pose.position.y] == position.tolist()
        assert heading_of(pose.pose.orientation) == pytest.approx(plan.heading(time), abs=1e-12)
        (transform,), (velocity,), (change,) = point.transforms, point.velocities, point.accelerations
        assert seconds(point.time_from_start) == pytest.approx(time - plan.start_time, abs=resolution)
        assert [transform.translation.x, transform.translation.y] == position.tolist()
        assert heading_of(transform.rotation) == pytest.approx(plan.heading(time), abs=1e-12)
        assert [velocity.linear.x, velocity.linear.y] == pytest.approx(plan.velocity(time), abs=1e-12)
        assert {pose.pose.position.z, transform.translation.z, velocity.linear.z, change.linear.z} == {0.0}
        assert abs(velocity.linear.x) <= speed and abs(change.linear.x) <= acceleration
    inner = slice(1, -1)
    step = 1e-5 * plan.travel_time
    differences = (plan.velocity(times[inner] + step) - plan.velocity(times[inner] - step)) / (2.0 * step)
    changes = np.array([[p.accelerations[0].linear.x, p.accelerations[0].linear.y] for p in trajectory.points])
    turns = np.unwrap(plan.heading(np.stack([times[inner] - step, times[inner] + step])), axis=0)
    turning = np.array([p.velocities[0].angular.z for p in trajectory.points])
    difference = 1e-5 + 8.0 * np.spacing(plan.arrival_time) / step
    assert turning[inner] == pytest.approx(np.diff(turns, axis=0)[0] / (2.0 * step), abs=difference)
    # The acceleration jumps where its pieces meet; a difference across a jump is none of either side.
    smooth = np.abs(times[inner, None] - plan.knot_times).min(axis=1) > 2.0 * step
    assert changes[inner][smooth] == pytest.approx(differences[smooth], abs=difference)


@needs_rosbags
@pytest.mark.parametrize("form", ["plan.mcap", "bag"])
@pytest.mark.parametrize("clock", ["plan", "late"])
def test_messages_are_the_plan(form: str, clock: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    plan = request.getfixturevalue(clock)
    path = tmp_path / form
    plan.export(path, samples=41, frame="odom", body="robot")
    check_plan(read_back(path), plan, 41)
    assert [entry.name for entry in tmp_path.iterdir()] == [form]


@needs_rosbags
def test_another_reader_finds_the_same(plan: sp.Plan, tmp_path: Path) -> None:
    plan.export(tmp_path / "plan.mcap", samples=41, frame="odom", body="robot")
    check_plan(read_by_another(tmp_path / "plan.mcap"), plan, 41)


@needs_rosbags
def test_turning_changes_as_the_turning_rate_does(plan: sp.Plan) -> None:
    trajectory = plan_messages(plan, 2001)[1].message
    rates = np.array([point.velocities[0].angular.z for point in trajectory.points])
    changes = np.array([point.accelerations[0].angular.z for point in trajectory.points])
    time = np.linspace(0.0, plan.travel_time, 2001)
    gained = np.sum(0.5 * (changes[1:] + changes[:-1]) * np.diff(time))
    assert gained == pytest.approx(rates[-1] - rates[0], abs=1e-2)
    assert np.ptp(changes) > 0.1


@needs_rosbags
def test_run_as_messages(run: sp.Run, tmp_path: Path) -> None:
    save_messages(run_messages(run, epoch=100.0), tmp_path / "run.mcap")
    found = read_back(tmp_path / "run.mcap")
    odometry, paths = found["/odometry"], found["/plan/path"]
    assert [stamp for stamp, _ in odometry] == [round((time + 100.0) * 1e9) for time in run.time]
    poses = [message.pose.pose for _, message in odometry]
    assert [[pose.position.x, pose.position.y] for pose in poses] == run.position.tolist()
    assert [message.twist.twist.linear.x for _, message in odometry] == run.speed.tolist()
    assert [heading_of(pose.orientation) for pose in poses] == pytest.approx(run.heading.tolist(), abs=1e-9)
    assert [stamp for stamp, _ in paths] == [round((record.time + 100.0) * 1e9) for record in run.records]
    for record, plan, (_, path) in zip(run.records, run.plans, paths, strict=True):
        first, last = path.poses[0].pose.position, path.poses[-1].pose.position
        assert [first.x, first.y] == pytest.approx(plan.position(record.time), abs=1e-12)
        assert [last.x, last.y] == pytest.approx(plan.position(plan.arrival_time), abs=1e-12)


@needs_rosbags
def test_a_run_of_one_time_turns_nowhere(run: sp.Run) -> None:
    columns = {key: getattr(run, key)[:1] for key in ("time", "position", "heading", "speed")}
    (odometry,) = (each for each in run_messages(replace(run, **columns)) if each.topic == "/odometry")
    assert odometry.message.twist.twist.angular.z == 0.0


@needs_rosbags
@pytest.mark.parametrize("epoch", [-1.0, 2.0**31])
def test_times_without_a_stamp_are_refused(plan: sp.Plan, tmp_path: Path, epoch: float) -> None:
    with pytest.raises(ValueError, match="no time of ROS"):
        plan.export(tmp_path / "plan.mcap", epoch=epoch)
    assert list(tmp_path.iterdir()) == []


@needs_rosbags
@pytest.mark.parametrize("name", ["plan.mcap", "bag", "link"])
def test_what_was_exported_before_is_replaced(plan: sp.Plan, tmp_path: Path, name: str) -> None:
    target = tmp_path / name
    if name == "link":
        target.symlink_to(tmp_path / "bag")
    for samples in (5, 7):
        plan.export(target, samples=samples)
        file = target if target.is_file() else next(target.glob("*.mcap"))
        assert len(read_back(file)["/plan/path"][0][1].poses) == samples
    assert target.is_symlink() == (name == "link")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted({name, "bag" if name == "link" else name})


@needs_rosbags
def test_a_folder_that_is_no_bag_is_left_alone(plan: sp.Plan, plan_file: Path, tmp_path: Path) -> None:
    for name in ("empty", "mixed", "other"):
        (tmp_path / name).mkdir()
    (tmp_path / "other" / "metadata.yaml").write_text("nothing: of a bag")
    plan.export(tmp_path / "mixed" / "bag")
    (tmp_path / "mixed" / "bag" / "diary.txt").write_text("mine")
    for folder in (tmp_path / "empty", tmp_path / "mixed" / "bag", tmp_path / "other"):
        before = sorted(folder.iterdir())
        with pytest.raises(FileExistsError):
            plan.export(folder)
        done = command.run("export", plan_file, "-o", folder)
        assert done.exit_code == 2 and "is no bag" in done.stderr
        assert sorted(folder.iterdir()) == before


def test_unknown_forms_are_refused(plan: sp.Plan, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"plan\.xlsx: must end in one of \.csv, \.npz, \.mcap"):
        plan.export(tmp_path / "plan.xlsx")
    assert list(tmp_path.iterdir()) == []


# The command


@pytest.fixture
def plan_file(plan: sp.Plan, tmp_path: Path) -> Path:
    plan.save(tmp_path / "plan.json")
    return tmp_path / "plan.json"


@pytest.mark.parametrize("name", ["plan.csv", "plan.npz", pytest.param("plan.mcap", marks=needs_rosbags)])
def test_command_exports_a_plan(plan_file: Path, name: str) -> None:
    target = plan_file.with_name(name)
    done = command.run("export", plan_file, "-o", target, "--samples", "7")
    assert done.exit_code == 0, done.output
    assert done.stdout == "" and done.stderr == f"wrote {target}\n"
    if name == "plan.csv":
        assert len(target.read_text(encoding="utf-8").splitlines()) == 8
    elif name == "plan.mcap":
        assert len(read_back(target)["/plan/path"][0][1].poses) == 7


def test_command_exports_a_run(run: sp.Run, tmp_path: Path) -> None:
    run.save(tmp_path / "run.json")
    done = command.run("export", tmp_path / "run.json", "-o", tmp_path / "run.csv", "-q")
    assert (done.exit_code, done.output) == (0, "")
    assert len((tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()) == len(run.time) + 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["-o", "plan.xlsx"], "must end in one of .csv, .npz, .mcap"),
        (["-o", "plan.csv", "--samples", "1"], "must be at least 2"),
        (["-o", "nowhere/plan.csv"], "the folder nowhere must exist"),
        pytest.param(["-o", "plan.mcap", "--epoch", "-9"], "no time of ROS", marks=needs_rosbags),
    ],
)
def test_command_refuses(plan_file: Path, arguments: list[str], said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(plan_file.parent)
    done = command.run("export", plan_file.name, *arguments)
    assert done.exit_code == 2
    assert said in " ".join(done.stderr.split())
    assert list(plan_file.parent.iterdir()) == [plan_file]


def test_command_refuses_what_is_no_plan(tmp_path: Path) -> None:
    (tmp_path / "other.json").write_text("[1, 2]", encoding="utf-8")
    done = command.run("export", tmp_path / "other.json", "-o", tmp_path / "o.csv")
    assert done.exit_code == 2 and "other.json" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["other.json"]
