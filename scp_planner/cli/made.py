"""Commands about what planners made: check, export."""

from __future__ import annotations

import importlib.util
import os
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scp_planner.cli import commonroad, summaries
from scp_planner.cli.application import ExitCode
from scp_planner.cli.groups import Printing
from scp_planner.cli.options import (
    MotionModel,
    Quiet,
    Samples,
    ScenarioFile,
    bad_option,
    check_folder,
    check_number,
    check_target,
    load_scenario,
)
from scp_planner.cli.output import report, start_logging, tabulate, tell
from scp_planner.errors import PlanError
from scp_planner.files import JSON_SUFFIX, read_json, text_table

if TYPE_CHECKING:
    from scp_planner.certificate.verdict import Certificate
    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario
    from scp_planner.simulation.run import Run
    from scp_planner.trips.samples import SampledTrajectory
LIMIT_PREFIX = "max_"
"""Prefix of a vehicle's limits."""

PLAN_KEY = "schema"
"""Key of every plan file, which a file of samples has not."""


def check(
    scenario_file: ScenarioFile,
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help="Plan files (JSON), or samples of trips (.csv, .npz, .json; t, x, y, heading, speed), whoever made"
            " them.",
        ),
    ],
    slack: Annotated[
        float,
        typer.Option(
            "--slack",
            metavar="SHARE",
            help="By which share limits of speed, acceleration, jerk, curvature and power may be exceeded, such as"
            " 0.02: what is lost between samples. Clearance has none.",
        ),
    ] = 0.0,
    motion: MotionModel = None,
    *,
    printing: Printing,
) -> None:
    """Certify trips against a scenario, whoever planned them.

    Of several files a table is printed: certified or not, travel time, least clearance, and how far limits are used.
    Plans for a model of CommonRoad are certified for the car, problem and goal that they were made for.
    """
    from scp_planner.certificate.check import certify

    start_logging(printing)
    check_number("--slack", slack, 0.0)
    usual = cache(lambda: load_scenario(scenario_file, motion))
    if motion is not None:
        usual()  # What is wrong with the model is reported first
    trips = [_plan_or_samples(file) for file in files]
    driven = [commonroad.scenario_of(scenario_file, trip) or usual() for trip in trips]
    certificates = [
        certify(_widened(each, 1.0 + slack) if slack else each, trip) for each, trip in zip(driven, trips, strict=True)
    ]
    rows = [_summary(*one, 1.0 + slack) for one in zip(driven, files, trips, certificates, strict=True)]
    if len(rows) == 1:
        report(rows[0], printing)
    else:
        tabulate(rows, _table(rows), printing)
    for file, certificate in zip(files, certificates, strict=True):
        if not certificate.holds:
            tell(f"{file}: not certified: {'; '.join(map(str, certificate.violations))}")
    if not all(certificate.holds for certificate in certificates):
        raise typer.Exit(ExitCode.NOT_CERTIFIED)


def _plan_or_samples(file: Path) -> Plan | SampledTrajectory:
    """Read a plan file or a file of samples, whichever it is."""
    from scp_planner.planning.plan import Plan
    from scp_planner.trips.samples import SampledTrajectory

    if file.suffix.lower() != JSON_SUFFIX:
        return SampledTrajectory.load(file)
    data = read_json(file, PlanError)
    return Plan.load(file) if isinstance(data, dict) and PLAN_KEY in data else SampledTrajectory.load(file)


def _widened(scenario: Scenario, factor: float) -> Scenario:
    """The scenario with all limits of its vehicle and its places larger by a factor."""
    vehicle = scenario.vehicle
    limits = {name: getattr(vehicle, name) for name in type(vehicle).model_fields if name.startswith(LIMIT_PREFIX)}
    wider = {name: None if limit is None else limit * factor for name, limit in limits.items()}
    places = tuple(place.model_copy(update={"speed": place.speed * factor}) for place in scenario.speed_limits)
    return scenario.model_copy(update={"vehicle": vehicle.model_copy(update=wider), "speed_limits": places})


def _summary(
    scenario: Scenario, file: Path, trip: Plan | SampledTrajectory, certificate: Certificate, factor: float
) -> dict[str, Any]:
    from scp_planner.trips.samples import SampledTrajectory

    summary = {**summaries.of_certificate(scenario, certificate), "travel_time": trip.travel_time, "file": str(file)}
    for use in summary["limits"].values():
        if use["limit"] is not None:
            use |= {"limit": use["limit"] / factor, "used": use["used"] * factor}
    if factor > 1.0:
        summary["slack"] = factor - 1.0
    if isinstance(trip, SampledTrajectory):
        missing = [name for name in ("heading", "speed") if getattr(trip, name) is None]
        summary |= {"samples": len(trip), "from_positions": " and ".join(missing) or None}
    return summary


def _table(rows: list[dict[str, Any]]) -> str:
    """A line a file, with how much of each limit is used."""
    names = [name for name in rows[0]["limits"] if any(row["limits"][name]["used"] is not None for row in rows)]
    heads = ["file", "certified", "travel time", "clearance", *(name.replace("_", " ") for name in names)]
    lines = [
        [
            row["file"],
            "yes" if row["certified"] else "no",
            f"{row['travel_time']:.3f} s",
            f"{row['least_clearance']:.4f} m",
            *(f"{row['limits'][name]['used']:.1%}" for name in names),
        ]
        for row in rows
    ]
    return text_table([heads, *lines])


# The command that writes plans and runs for other programs: export


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
    subject = _plan_or_run(source)
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


def _plan_or_run(source: Path) -> Plan | Run:
    """Read a plan file or a run file, whichever it is."""
    from scp_planner.planning.plan import Plan
    from scp_planner.simulation.run import Run

    data = read_json(source, PlanError)
    return Run.load(source) if isinstance(data, dict) and "course" in data else Plan.load(source)
