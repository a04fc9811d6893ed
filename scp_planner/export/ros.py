"""Plans and runs as messages of the Robot Operating System, ROS 2, in MCAP files and bags."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from scp_planner.arrays import Array, left_of, unit_vectors
from scp_planner.export.tables import SAMPLES, plan_table
from scp_planner.files import replacing, temporary_folder
from scp_planner.mathematics.polylines import rates

if TYPE_CHECKING:
    from scp_planner.planning.plan import Plan
    from scp_planner.simulation.run import Run

MCAP_SUFFIX = ".mcap"
BAG_METADATA = "metadata.yaml"
FRAME, BODY = "map", "base_link"
"""Names of the scenario's frame and of the vehicle's."""

NANOSECONDS = 1_000_000_000
SECONDS = 2**31  # ROS counts them in 32 bits


@dataclass(frozen=True)
class StampedMessage:
    """A message, and where and when it was sent."""

    topic: str  # Such as ``/plan/path``
    kind: str  # Such as ``nav_msgs/msg/Path``
    stamp: int  # ns
    message: Any  # With the attributes that the kind has in ROS


def plan_messages(
    plan: Plan, times: ArrayLike | int = SAMPLES, *, frame: str = FRAME, body: str = BODY, epoch: float = 0.0
) -> tuple[StampedMessage, ...]:
    """Give a plan as a path to show and as a trajectory to follow.

    Parameters
    ----------
    plan : Plan
    times : (n,) array or int
        Absolute times of the samples, s, or how many, spread equally over the trip.
    frame, body : str
        Names of the frame that positions are in and of the vehicle.
    epoch : float
        ROS time at time 0 of the plan, s.

    Returns
    -------
    tuple of StampedMessage
        ``/plan/path``, ``nav_msgs/msg/Path``: poses, each with its own stamp. ``/plan/trajectory``,
        ``trajectory_msgs/msg/MultiDOFJointTrajectory``: transforms of `body` with velocities and accelerations in
        `frame`, and times from the start.

    Raises
    ------
    ImportError
        If `rosbags` is not installed.
    ValueError
        If a time has no stamp: before 1970 on the clock of ROS, or after 2038; or `times` are not times.
    """
    table = plan_table(plan, times)
    start = _stamp(plan.start_time, epoch)
    return (
        StampedMessage("/plan/path", "nav_msgs/msg/Path", start, _path(table, frame, epoch, plan.start_time)),
        StampedMessage(
            "/plan/trajectory",
            "trajectory_msgs/msg/MultiDOFJointTrajectory",
            start,
            _trajectory(plan, table, frame, body, epoch),
        ),
    )


def run_messages(
    run: Run, *, frame: str = FRAME, body: str = BODY, epoch: float = 0.0, samples: int = 50
) -> tuple[StampedMessage, ...]:
    """Give a closed loop as what was driven and what was planned on the way.

    Parameters
    ----------
    run : Run
    frame, body : str
        Names of the frame that positions are in and of the vehicle.
    epoch : float
        ROS time at time 0 of the run, s.
    samples : int
        Of each plan.

    Returns
    -------
    tuple of StampedMessage
        ``/odometry``, ``nav_msgs/msg/Odometry``, at each of the run's times; ``/plan/path``,
        ``nav_msgs/msg/Path``, at each cycle: what was left of its plan. In order of time.

    Raises
    ------
    ImportError
        If `rosbags` is not installed.
    ValueError
        If a time has no stamp: before 1970 on the clock of ROS, or after 2038.
    """
    paths = [
        StampedMessage("/plan/path", "nav_msgs/msg/Path", _stamp(record.time, epoch), path)
        for record, plan in zip(run.records, run.plans, strict=True)
        for path in [_path(plan_table(plan, _rest(plan, record.time, samples)), frame, epoch, record.time)]
    ]
    driven = [
        StampedMessage("/odometry", "nav_msgs/msg/Odometry", _stamp(time, epoch), message)
        for time, message in zip(run.time.tolist(), _odometry(run, frame, body, epoch), strict=True)
    ]
    return tuple(sorted([*paths, *driven], key=lambda message: message.stamp))


def save_messages(messages: Iterable[StampedMessage], path: str | PathLike[str]) -> None:
    """Write messages as an MCAP file or as a bag.

    Parameters
    ----------
    messages : iterable of StampedMessage
        At least one.
    path : path
        .mcap: one file, for `ros2 bag play` and for viewers; without suffix: a folder with such a file and its
        metadata. Like a file, a bag that is there is replaced; any other folder is refused.

    Raises
    ------
    ImportError
        If `rosbags` is not installed.
    FileExistsError
        If the folder exists and is no bag.
    OSError
        If there is something else than a file to replace, see `scp_planner.files.regular_target`.
    ValueError
        If the suffix is another one, or there are no messages.
    """
    target, sent = Path(path), tuple(messages)
    if target.suffix.lower() not in (MCAP_SUFFIX, ""):
        raise ValueError(f"{path}: must end in {MCAP_SUFFIX}, or have no suffix for a bag's folder")
    if not sent:
        raise ValueError("messages: there are none")
    if target.suffix == "":
        _save_bag(sent, target)
        return
    with replacing(target) as temporary, temporary_folder(temporary.parent) as folder:
        _write_bag(sent, bag := folder / target.stem)
        (file,) = bag.glob(f"*{MCAP_SUFFIX}")
        shutil.copyfile(file, temporary)


def is_bag(folder: Path) -> bool:
    """Tell whether a folder is a bag and nothing else: its metadata, and the files that they name."""
    try:
        with open(folder / BAG_METADATA, encoding="utf-8") as file:
            named = yaml.safe_load(file)["rosbag2_bagfile_information"]["relative_file_paths"]
        return {BAG_METADATA, *named} == set(os.listdir(folder))
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError):
        return False


def _save_bag(messages: tuple[StampedMessage, ...], path: Path) -> None:
    """Write a bag; one that is there is moved aside first, and back if the new one cannot take its place."""
    target = Path(os.path.realpath(path))
    replaces = target.exists()
    if replaces and not is_bag(target):
        raise FileExistsError(errno.EEXIST, "exists already, and is no bag", str(path))
    with temporary_folder(target.parent) as folder:
        # The bag's name is that of its files.
        made, old = folder / "new" / target.stem, folder / "old"
        made.parent.mkdir()
        _write_bag(messages, made)
        if replaces:
            target.rename(old)
        try:
            made.rename(target)
        except OSError:
            if replaces:
                old.rename(target)
            raise


def _write_bag(messages: tuple[StampedMessage, ...], folder: Path) -> None:
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
    from rosbags.rosbag2 import StoragePlugin, Writer

    # Who subscribes late still gets the last plan.
    never = QosTime(0, 0)
    kept = Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        never,
        never,
        QosLiveliness.AUTOMATIC,
        never,
        False,
    )
    types = _types()
    # Known to releases from Iron on.
    with Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        kinds = {message.topic: message.kind for message in messages}
        connections = {
            topic: writer.add_connection(topic, kind, typestore=types, offered_qos_profiles=[kept])
            for topic, kind in kinds.items()
        }
        for message in messages:
            writer.write(connections[message.topic], message.stamp, types.serialize_cdr(message.message, message.kind))


@cache
def _types() -> Any:
    """Give the messages' types; those used here are the same in every release of ROS 2."""
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ImportError("messages need rosbags: pip install 'scp-planner[ros]'") from error

    return get_typestore(Stores.ROS2_HUMBLE)


def _make(kind: str, **fields: Any) -> Any:
    return _types().types[kind](**fields)


def _path(table: dict[str, NDArray[Any]], frame: str, epoch: float, time: float) -> Any:
    poses = [
        _make("geometry_msgs/msg/PoseStamped", header=_header(t, frame, epoch), pose=_pose(x, y, heading))
        for t, x, y, heading in _rows(table, "time_s", "x_m", "y_m", "heading_rad")
    ]
    return _make("nav_msgs/msg/Path", header=_header(time, frame, epoch), poses=poses)


def _trajectory(plan: Plan, table: dict[str, NDArray[Any]], frame: str, body: str, epoch: float) -> Any:
    heading, curvature = table["heading_rad"], table["curvature_per_m"]
    heading = np.where(plan.backward(table["time_s"]), heading + np.pi, heading)  # as it drives
    forward = unit_vectors(heading)
    left = left_of(forward)
    acceleration = (
        table["acceleration_m_per_s2"][:, None] * forward + table["lateral_acceleration_m_per_s2"][:, None] * left
    )
    turning, turning_change = table["speed_m_per_s"] * curvature, _turning_change(plan, table["time_s"])
    points = [
        _make(
            "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint",
            transforms=[
                _make("geometry_msgs/msg/Transform", translation=_vector(x, y), rotation=_quaternion(direction))
            ],
            velocities=[_twist(vx, vy, turning[k])],
            accelerations=[_twist(acceleration[k, 0], acceleration[k, 1], turning_change[k])],
            time_from_start=_clock("Duration", round((t - plan.start_time) * NANOSECONDS)),
        )
        for k, (t, x, y, direction, vx, vy) in enumerate(
            _rows(table, "time_s", "x_m", "y_m", "heading_rad", "velocity_x_m_per_s", "velocity_y_m_per_s")
        )
    ]
    return _make(
        "trajectory_msgs/msg/MultiDOFJointTrajectory",
        header=_header(plan.start_time, frame, epoch),
        joint_names=[body],
        points=points,
    )


def _turning_change(plan: Plan, time: Array) -> Array:
    """Differentiate the turning rate by time, rad/s2."""
    step = 1e-4 * plan.travel_time
    before, after = (np.clip(time + sign * step, plan.start_time, plan.arrival_time) for sign in (-1.0, 1.0))
    turning = [plan.speed(t) * plan.curvature(t) for t in (before, after)]
    span = after - before
    return np.divide(turning[1] - turning[0], span, out=np.zeros_like(span), where=span > 0.0)


def _odometry(run: Run, frame: str, body: str, epoch: float) -> Iterator[Any]:
    turning = rates(np.unwrap(run.heading), run.time)
    unknown = np.zeros(36)  # covariances, which nothing is known of
    rows = np.column_stack([run.time, run.position, run.heading, run.speed, turning]).tolist()
    for time, x, y, heading, speed, rate in rows:
        yield _make(
            "nav_msgs/msg/Odometry",
            header=_header(time, frame, epoch),
            child_frame_id=body,
            pose=_make("geometry_msgs/msg/PoseWithCovariance", pose=_pose(x, y, heading), covariance=unknown),
            # In the frame of the vehicle, as the message asks for.
            twist=_make("geometry_msgs/msg/TwistWithCovariance", twist=_twist(speed, 0.0, rate), covariance=unknown),
        )


def _rest(plan: Plan, time: float, samples: int) -> Array:
    """Times of what is left of a plan, s."""
    return np.linspace(time, max(time, plan.arrival_time), samples)


def _rows(table: dict[str, NDArray[Any]], *names: str) -> Iterator[tuple[float, ...]]:
    return zip(*(table[name].tolist() for name in names), strict=True)


def _stamp(time: float, epoch: float) -> int:
    stamp = round((time + epoch) * NANOSECONDS)
    if not 0 <= stamp < SECONDS * NANOSECONDS:
        raise ValueError(f"{time + epoch} s is no time of ROS: must be at least 0 and less than {SECONDS}")
    return stamp


def _header(time: float, frame: str, epoch: float) -> Any:
    stamp = _clock("Time", _stamp(time, epoch))
    return _make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def _clock(kind: str, nanoseconds: int) -> Any:
    seconds, rest = divmod(nanoseconds, NANOSECONDS)
    return _make(f"builtin_interfaces/msg/{kind}", sec=seconds, nanosec=rest)


def _pose(x: float, y: float, heading: float) -> Any:
    return _make(
        "geometry_msgs/msg/Pose",
        position=_make("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
        orientation=_quaternion(heading),
    )


def _quaternion(heading: float) -> Any:
    half = 0.5 * heading
    return _make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half)))


def _vector(x: float, y: float, z: float = 0.0) -> Any:
    return _make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))


def _twist(x: float, y: float, turning: float) -> Any:
    return _make("geometry_msgs/msg/Twist", linear=_vector(x, y), angular=_vector(0.0, 0.0, turning))
