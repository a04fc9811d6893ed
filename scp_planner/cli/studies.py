"""Commands that measure: study consistency, study coverage, fit-motion, fit-tracking."""

from __future__ import annotations

import csv
import math
import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scp_planner.cli.groups import Printing
from scp_planner.cli.options import (
    Json,
    NoiseSeed,
    Quiet,
    Workers,
    at_least,
    bad_option,
    can_plot,
    check_folder,
    check_probability,
    check_target,
    motion_model,
)
from scp_planner.cli.output import progress_bar, report, start_logging, tabulate, tell
from scp_planner.errors import MISSING, Fault, TracksError
from scp_planner.files import write_rows

if TYPE_CHECKING:
    from scp_planner.studies.coverage import Coverage

CONSISTENCY_FIGURES = ("consistency.png", "border.png")
CONSISTENCY_FILES = ("results.jsonl", "summary.csv", "slopes.csv", "border.csv", *CONSISTENCY_FIGURES)
PredictionWindow = Annotated[
    int, typer.Option("--window", metavar="N", callback=at_least(1), help="Positions that a prediction is made from.")
]
COVERAGE_FILES = ("coverage.csv", "coverage.png", "recorded.csv")


def consistency(
    quick: Annotated[bool, typer.Option("--quick", help="Few repetitions: slopes roughly, in under a minute.")] = False,
    repetitions: Annotated[
        int | None,
        typer.Option(
            "--repetitions",
            metavar="N",
            callback=at_least(2),
            help="Of each noise and number of observations, 2 or more.",
        ),
    ] = None,
    workers: Workers = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for results; those that are there already are used.")
    ] = Path("consistency"),
    seed: NoiseSeed = 0,
    *,
    printing: Printing,
) -> None:
    """Measure how estimates converge.

    The objective with estimated zones, and its minimisers, against the true ones as observations grow in number.
    """
    start_logging(printing)
    check_folder("--output", output, *CONSISTENCY_FILES)
    from scp_planner.studies.consistency import run_consistency
    from scp_planner.studies.field import ConsistencySettings, border

    settings = ConsistencySettings.quick(seed) if quick else ConsistencySettings(seed=seed)
    if repetitions is not None:
        settings = replace(settings, repetitions=repetitions)
    processes = workers or os.cpu_count() or 1
    result = run_consistency(settings, folder=output, workers=processes, progress=not printing.quiet)
    written = result.save(output)
    if can_plot():
        from scp_planner.studies.figures import plot_border, plot_consistency

        figures = [output / name for name in CONSISTENCY_FIGURES]
        plot_consistency(result, figures[0])
        plot_border(border(), figures[1])
        written += figures
    tabulate({"slopes": [asdict(slope) for slope in result.slopes]}, result.table(), printing)
    _tell_written(written, printing)


def coverage(
    tracks: Annotated[
        list[Path] | None,
        typer.Argument(metavar="TRACKS", help="Recorded tracks to measure too: half fitted, half tested."),
    ] = None,
    runs: Annotated[
        int, typer.Option("--runs", metavar="N", callback=at_least(1), help="Simulated runs of each case.")
    ] = 20_000,
    probability: Annotated[float, typer.Option("--probability", metavar="P", help="Nominal level.")] = 0.95,
    window: PredictionWindow = 8,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            metavar="NAME",
            help="Only test this motion model, a ready-made one or a file of fit-motion --half, on every other track.",
        ),
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for tables and figure.")] = Path("coverage"),
    seed: NoiseSeed = 0,
    *,
    printing: Printing,
) -> None:
    """Measure how often zones hold.

    How often zones of each level of confidence hold what they promise, in simulation and on recorded tracks.
    """
    start_logging(printing)
    check_folder("--output", output, *COVERAGE_FILES)
    check_probability("--probability", probability)
    if model is not None:
        _coverage_of_model(model, tracks or [], probability, output, printing)
        return
    from scp_planner.studies import coverage as simulated
    from scp_planner.studies import recorded
    from scp_planner.tracking.tracks import Tracks

    loaded = [(path.stem.removesuffix("_obsmat"), Tracks.load(path)) for path in tracks or ()]
    results = _simulated(probability, runs, seed, printing.quiet)
    output.mkdir(exist_ok=True)
    write_rows(output / "coverage.csv", simulated.Coverage, results)
    written = [output / "coverage.csv"]
    tables = [simulated.summary(results)]
    records: dict[str, Any] = {"simulated": [asdict(row) for row in results]}
    if can_plot():
        simulated.plot_coverage(results, output / "coverage.png")
        written.append(output / "coverage.png")
    if loaded:
        measured = [
            row
            for name, own in loaded
            for row in recorded.measure_recorded_coverage(own, data=name, window=window, probability=probability)
        ]
        write_rows(output / "recorded.csv", recorded.RecordedCoverage, measured)
        written.append(output / "recorded.csv")
        tables.append(recorded.summary(measured))
        records["recorded"] = [asdict(row) for row in measured]
    tabulate(records, "\n\n".join(tables), printing)
    _tell_written(written, printing)


def _simulated(probability: float, runs: int, seed: int, quiet: bool) -> list[Coverage]:
    """Measure simulated runs, with a progress bar."""
    from scp_planner.studies.coverage import measure_coverage

    with progress_bar(None, "case", quiet) as bar:

        def advance(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        return measure_coverage(probability=probability, runs=runs, seed=seed, progress=advance)


def _coverage_of_model(model: str, tracks: list[Path], probability: float, output: Path, printing: Printing) -> None:
    """Test a model on recorded tracks."""
    if not tracks:
        raise bad_option("TRACKS", "none", "are needed to test a model on")
    from scp_planner.studies import recorded
    from scp_planner.tracking.tracks import Tracks

    process = motion_model(model).process
    assert process is not None
    name = Path(model).stem
    measured = recorded.measure_model(Tracks.joined(tracks), process, data=name, name=name, probability=probability)
    output.mkdir(exist_ok=True)
    write_rows(output / "recorded.csv", recorded.RecordedCoverage, measured)
    tabulate({"recorded": [asdict(row) for row in measured]}, recorded.summary(measured), printing)
    _tell_written([output / "recorded.csv"], printing)


@dataclass(frozen=True)
class FitOptions:
    kind: Annotated[
        str, typer.Option("--kind", metavar="NAME", help="random_walk (of the velocity), mean_reverting or singer.")
    ] = "random_walk"
    window: PredictionWindow = 8
    conformal: Annotated[
        float | None,
        typer.Option(
            "--conformal",
            metavar="P",
            help="Level at which regions are split-conformal, from half of the tracks; such as 0.95.",
        ),
    ] = None
    noise: Annotated[
        float | None,
        typer.Option(
            "--noise",
            metavar="S",
            help="Standard deviation of observed coordinates, m; default: fitted. Smoothed tracks show none.",
        ),
    ] = None
    tails: Annotated[
        bool,
        typer.Option("--tails/--no-tails", help="Fit how often errors are large, too; that needs 10 tracks or more."),
    ] = True

    def check(self) -> None:
        """Refuse what is no probability, and a noise that is none."""
        check_probability("--conformal", self.conformal)
        if self.noise is not None and not 0.0 < self.noise < math.inf:
            raise bad_option("--noise", self.noise, "must be a positive number")


def fit_motion(
    tracks_files: Annotated[list[Path], typer.Argument(metavar="TRACKS", help="Files or folders of recorded tracks.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Write the model, .yaml or .json.")] = Path(
        "motion.yaml"
    ),
    *,
    fit: FitOptions,
    half: Annotated[
        bool, typer.Option("--half", help="Fit to every other track; `study coverage --model` tests it on the rest.")
    ] = False,
    source: Annotated[
        str | None, typer.Option("--source", metavar="TEXT", help="What the file says that the tracks are.")
    ] = None,
    printing: Printing,
) -> None:
    """Fit a motion model to recorded tracks.

    It is a motion with process noise, for use as an obstacle's `model: {process: FILE}`.
    """
    start_logging(printing)
    for tracks_file in tracks_files:
        check_target("--output", output, tracks_file)
    if output.suffix not in (".yaml", ".yml", ".json"):
        raise bad_option("--output", output, "must end in .yaml, .yml or .json")
    fit.check()
    from scp_planner.tracking.motion_fitting import bounds_met, fit_motion_model
    from scp_planner.tracking.tracks import Tracks

    tracks = Tracks.joined(tracks_files)
    fitted = tracks.halves()[0] if half else tracks
    model = fit_motion_model(
        fitted, fit.kind, window=fit.window, conformal=fit.conformal, noise=fit.noise, tails=fit.tails
    )
    if source is not None and model.fitted_to is not None:
        model = model.model_copy(update={"fitted_to": model.fitted_to.model_copy(update={"source": source})})
    model.save(output)
    found = model.model_dump(mode="json", by_alias=True)
    listed = {**found["process"], **{key: found[key] for key in ("velocity_deviation", "noise_deviation")}}
    listed |= {"tracks": found["fitted_to"]["tracks"]}
    report(found if printing.as_json else listed, printing)
    for text in () if printing.quiet else bounds_met(fitted, model):
        tell(text)
    _tell_written([output], printing)


def _tell_written(files: list[Path], printing: Printing) -> None:
    if not printing.quiet:
        tell(f"wrote {', '.join(str(file) for file in files)}")


# The command that calibrates what planners allow for from recorded drives: fit-tracking

DRIVE_COLUMNS = ("drive", "speed", "curvature", "error")


def fit_tracking(
    drives: Annotated[
        Path, typer.Argument(metavar="DRIVES", help="CSV file with the columns drive, speed, curvature and error.")
    ],
    probability: Annotated[
        float,
        typer.Option("--probability", metavar="P", help="With which a whole new drive stays in the tube, at least."),
    ] = 0.95,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate the tracking error from recorded drives.

    The tube round a plan that the vehicle stays in, its radius growing with speed and lateral acceleration. In the file
    speed (m/s) and curvature (1/m) are what was planned, error (m) is how far the vehicle was from there; rows of one
    drive have the same text in the column drive.
    """
    check_probability("--probability", probability)
    import numpy as np

    from scp_planner.threat_zones.error_tube import TrackingRecord, fit_tracking_tube

    records = []
    for rows in _drives(drives).values():
        speed, curvature, error = np.array(rows).T
        records.append(TrackingRecord(speed, speed**2 * np.abs(curvature), error))
    tube = fit_tracking_tube(records, probability)
    largest = float(tube.radius(tube.max_speed, tube.max_lateral))
    report({**asdict(tube), "largest_radius": largest}, Printing(as_json, quiet))


def _drives(path: Path) -> dict[str, list[list[float]]]:
    """Read the planned speed and curvature and the error at each moment of each drive."""
    drives: dict[str, list[list[float]]] = {}
    faults: list[Fault] = []
    with path.open(encoding="utf-8", newline="") as file:
        table = csv.DictReader(file)
        missing = [name for name in DRIVE_COLUMNS if name not in (table.fieldnames or ())]
        if missing:
            raise TracksError(
                str(path), [Fault("line 1", missing[0], f"must have the columns {', '.join(DRIVE_COLUMNS)}")]
            )
        for row in table:
            values = [_number(row[name]) for name in DRIVE_COLUMNS[1:]]
            for name, value in zip(DRIVE_COLUMNS[1:], values, strict=True):
                if not math.isfinite(value) or (value < 0.0 and name != "curvature"):
                    least = "" if name == "curvature" else " of at least 0"
                    place = f"line {table.line_num}, column {name}"
                    faults.append(Fault(place, row[name] or MISSING, f"must be a finite number{least}"))
            drives.setdefault(row["drive"], []).append(values)
            if len(faults) >= 20:
                break
    if faults:
        raise TracksError(str(path), faults)
    return drives


def _number(text: str | None) -> float:
    try:
        return math.nan if text is None else float(text)
    except ValueError:
        return math.nan
