"""The command that writes plans and runs for other programs: export."""

from __future__ import annotations

import importlib.util
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scp_planner.cli.groups import Printing
from scp_planner.cli.options import Quiet, Samples, bad_option, check_folder, check_target
from scp_planner.cli.output import start_logging, tell
from scp_planner.errors import MISSING, Fault, PlanError

if TYPE_CHECKING:
    from scp_planner.planning.plan import Plan
    from scp_planner.simulation.run import Run


def export(
    source: Annotated[Path, typer.Argument(metavar="PLAN", help="Plan file or run file (JSON).")],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="Write .csv or .npz: a table; .mcap, or a folder without suffix: messages for ROS 2."
        ),
    ],
    samples: Samples = 200,
    frame: Annotated[str, typer.Option("--frame", metavar="NAME", help="Frame of messages.")] = "map",
    body: Annotated[str, typer.Option("--body", metavar="NAME", help="The vehicle in messages.")] = "base_link",
    epoch: Annotated[
        float, typer.Option("--epoch", metavar="S", help="ROS time at time 0 of the plan, for messages.")
    ] = 0.0,
    quiet: Quiet = False,
) -> None:
    """Write a plan or a run for other programs.

    As a table with units in its columns' names, or as messages for ROS 2: nav_msgs/Path and
    trajectory_msgs/MultiDOFJointTrajectory of a plan, nav_msgs/Odometry and nav_msgs/Path of a run.
    """
    from scp_planner.export import EXPORT_SUFFIXES
    from scp_planner.planning.plan import Plan

    start_logging(Printing(quiet=quiet))
    suffix = output.suffix.lower()
    if suffix not in (*EXPORT_SUFFIXES, ""):
        raise bad_option("--output", output, f"must end in one of {', '.join(EXPORT_SUFFIXES)}, or have no suffix")
    if suffix in ("", ".mcap") and importlib.util.find_spec("rosbags") is None:
        raise bad_option("--output", output, "needs rosbags: pip install 'scp-planner[ros]'")
    if suffix == "":
        _check_bag(output)
    else:
        check_target("--output", output, source)
    subject = _load(source)
    sampled = {"samples": samples} if isinstance(subject, Plan) else {}
    try:
        subject.export(output, frame=frame, body=body, epoch=epoch, **sampled)
    except ValueError as error:
        raise bad_option("--epoch", epoch, str(error)) from None
    if not quiet:
        tell(f"wrote {output}")


def _check_bag(folder: Path) -> None:
    """Refuse a bag's folder that could not be written."""
    from scp_planner.export.ros import is_bag

    if os.path.lexists(folder) and not is_bag(folder):
        raise bad_option("--output", folder, "exists already, and is no bag of this kind, which would be replaced")
    check_folder("--output", folder)


def _load(source: Path) -> Plan | Run:
    """Read a plan file or a run file, whichever it is."""
    from scp_planner.planning.plan import Plan
    from scp_planner.simulation.run import Run

    try:
        data = json.loads(source.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise PlanError(str(source), [Fault("", MISSING, f"not a JSON file: {error}")]) from None
    return Run.load(source) if isinstance(data, dict) and "course" in data else Plan.load(source)
