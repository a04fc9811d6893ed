"""The command that replans along a recording of a robot: replay."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from scp_planner.cli.groups import Printing
from scp_planner.cli.options import bad_option, check_target, load_scenario
from scp_planner.cli.output import report, tell


def replay(
    bag: Annotated[Path, typer.Argument(metavar="BAG", exists=True, help="Folder of a bag of ROS 2, or MCAP file.")],
    goal: Annotated[str, typer.Option("--goal", metavar="X,Y", help="Where to go, m.")],
    scenario: Annotated[
        str | None,
        typer.Option("--scenario", metavar="SCENARIO", help="Whose vehicle, walls, bounds and confidence hold."),
    ] = None,
    period: Annotated[float, typer.Option("--period", metavar="S", help="Between two replans.")] = 0.1,
    deadline: Annotated[float | None, typer.Option("--deadline", metavar="S", help="Wall time of a replan.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Run file to write, JSON.")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="Picture to write, as of simulate.")] = None,
    printing: Printing = Printing(),  # noqa: B008 - frozen
) -> None:
    """Replan along a recording, each time from where the robot was, among the objects that it tracked.

    The recording holds nav_msgs/Odometry and, in the same frame, tracked objects: PredictedObjects or TrackedObjects
    of Autoware, ObjectArray of derived_object_msgs, Detection3DArray of vision_msgs, ObstacleArray of
    nav2_dynamic_msgs, or ObstacleArrayMsg of costmap_converter_msgs.
    """
    place = _place(goal)
    for option, value in (("--period", period), ("--deadline", deadline)):
        if value is not None and not value > 0.0:
            raise bad_option(option, value, "must be above 0")
    check_target("--output", output)
    check_target("--plot", plot)
    if importlib.util.find_spec("rosbags") is None:
        raise bad_option("BAG", bag, "needs rosbags: pip install 'scp-planner[ros]'")
    given = None if scenario is None else load_scenario(scenario)
    from rosbags.highlevel import AnyReaderError

    from scp_planner.simulation.replay import replay as replay_bag

    try:
        run = replay_bag(bag, place, given, period=period, deadline=deadline)
    except AnyReaderError as error:
        raise bad_option("BAG", bag, str(error)) from None
    if output is not None:
        run.save(output)
    if plot is not None:
        run.draw(plot)
    times, told = run.wall_times, [record.reason for record in run.records if not record.safe]
    summary = {
        "recording": str(bag),
        "replans": len(run.records),
        "safe": sum(record.safe for record in run.records),
        **run.outcomes,
        "tracked_objects": len(run.shapes),
        "median_replan_time": float(np.median(times)),
        "longest_replan_time": float(times.max()),
    }
    report(summary, printing)
    if told and not printing.quiet:
        tell(f"{bag}: {len(told)} replans are not safe, the first one: {told[0]}")


def _place(text: str) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise bad_option("--goal", text, "must be two numbers in m, such as 12.5,-3") from None
    return x, y
