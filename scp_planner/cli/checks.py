"""The command that certifies what planners made: check."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scp_planner.cli import commonroad, summaries
from scp_planner.cli.application import ExitCode
from scp_planner.cli.groups import Printing
from scp_planner.cli.options import MotionModel, ScenarioFile, check_number, load_scenario
from scp_planner.cli.output import print_json, report, start_logging, tell
from scp_planner.errors import MISSING, Fault, PlanError
from scp_planner.files import JSON_SUFFIX, text_table

if TYPE_CHECKING:
    from scp_planner.certificate.verdict import Certificate
    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario
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
    trips = [_load(file) for file in files]
    driven = [commonroad.scenario_of(scenario_file, trip) or usual() for trip in trips]
    certificates = [
        certify(_widened(each, 1.0 + slack) if slack else each, trip) for each, trip in zip(driven, trips, strict=True)
    ]
    rows = [_summary(*one, 1.0 + slack) for one in zip(driven, files, trips, certificates, strict=True)]
    if len(rows) == 1:
        report(rows[0], printing)
    elif printing.as_json:
        print_json(rows)
    elif not printing.quiet:
        typer.echo(_table(rows))
    for file, certificate in zip(files, certificates, strict=True):
        if not certificate.holds:
            tell(f"{file}: not certified: {'; '.join(map(str, certificate.violations))}")
    if not all(certificate.holds for certificate in certificates):
        raise typer.Exit(ExitCode.NOT_CERTIFIED)


def _load(file: Path) -> Plan | SampledTrajectory:
    """Read a plan file or a file of samples, whichever it is."""
    from scp_planner.planning.plan import Plan
    from scp_planner.trips.samples import SampledTrajectory

    if file.suffix.lower() != JSON_SUFFIX:
        return SampledTrajectory.load(file)
    try:
        data = json.loads(file.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise PlanError(str(file), [Fault("", MISSING, f"not a JSON file: {error}")]) from None
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
    return text_table(heads, lines)
