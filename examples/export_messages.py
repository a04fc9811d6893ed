"""Hand a plan to other programs: a table for pandas, arrays for numpy, messages for ROS 2; and read them all back.

The messages need rosbags, which needs nothing of ROS: pip install 'scp-planner[ros]'.

    python examples/export_messages.py [-o FOLDER]
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import scp_planner as sp
from scp_planner import builtin


def read_messages(path: Path) -> dict[str, Any]:
    """Read an MCAP file; the last message of each topic."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        return {
            connection.topic: reader.deserialize(data, connection.msgtype) for connection, _, data in reader.messages()
        }


def draw(path_message: Any, trajectory: Any, figure_file: Path) -> None:
    """Draw a nav_msgs/Path with its headings, and the speeds of a trajectory_msgs/MultiDOFJointTrajectory."""
    from matplotlib.figure import Figure

    poses = [stamped.pose for stamped in path_message.poses]
    x, y = (np.array([getattr(pose.position, axis) for pose in poses]) for axis in "xy")
    heading = np.array([2.0 * math.atan2(pose.orientation.z, pose.orientation.w) for pose in poses])
    time = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in trajectory.points]
    speed = [math.hypot(point.velocities[0].linear.x, point.velocities[0].linear.y) for point in trajectory.points]

    figure = Figure(figsize=(8.0, 5.0), dpi=110, layout="constrained")
    above, below = figure.subplots(2, 1)
    above.plot(x, y, color="#0072B2")
    some = slice(None, None, 10)
    above.quiver(x[some], y[some], np.cos(heading[some]), np.sin(heading[some]), color="#D55E00", width=3e-3)
    above.margins(y=0.4)
    above.set(aspect="equal", xlabel=f"x in {path_message.header.frame_id} (m)", ylabel="y (m)")
    above.set_title("nav_msgs/Path", loc="left")
    below.plot(time, speed, color="#0072B2")
    below.set(xlabel="time from start (s)", ylabel="speed (m/s)")
    below.set_title("trajectory_msgs/MultiDOFJointTrajectory", loc="left")
    figure.savefig(figure_file)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("."), help="folder to write into")
    options = parser.parse_args(argv)
    options.output.mkdir(exist_ok=True)
    table_file, array_file, message_file, figure_file = (
        options.output / name for name in ("plan.csv", "plan.npz", "plan.mcap", "plan.png")
    )

    plan = sp.plan(builtin.load("radar"))
    print(f"{plan.status}: {plan.travel_time:.3f} s")
    for file in (table_file, array_file, message_file):
        plan.export(file, samples=200)

    with table_file.open(encoding="utf-8", newline="") as file:  # or pandas.read_csv(table_file)
        rows = list(csv.DictReader(file))
    arrays = np.load(array_file)
    messages = read_messages(message_file)
    path = messages["/plan/path"]
    apart = max(
        math.dist((float(row["x_m"]), float(row["y_m"])), (pose.pose.position.x, pose.pose.position.y))
        for row, pose in zip(rows, path.poses, strict=True)
    )
    print(f"{len(rows)} rows of {len(rows[0])} columns, {len(arrays)} arrays, {len(path.poses)} poses")
    print(f"the table and the messages are {apart:g} m apart")
    draw(path, messages["/plan/trajectory"], figure_file)
    print(f"wrote {table_file}, {array_file}, {message_file} and {figure_file}")
    return 0 if plan.certified and apart == 0.0 else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(f"{missing}: pip install 'scp-planner[ros,plot]'") from None
