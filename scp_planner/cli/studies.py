"""Commands that measure: study consistency, study coverage, fit-motion."""

from __future__ import annotations

import math
import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scp_planner.cli import pictures
from scp_planner.cli.groups import Printing
from scp_planner.cli.options import (
    NoiseSeed,
    Workers,
    at_least,
    bad_option,
    check_folder,
    check_probability,
    check_target,
    motion_model,
)
from scp_planner.cli.output import print_json, progress_bar, report, start_logging, tell

if TYPE_CHECKING:
    from scp_planner.studies.coverage import Coverage
    from scp_planner.tracking.tracks import Tracks

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
    if pictures.can_plot():
        from scp_planner.studies.figures import plot_border, plot_consistency

        figures = [output / name for name in CONSISTENCY_FIGURES]
        plot_consistency(result, figures[0])
        plot_border(border(), figures[1])
        written += figures
    if printing.as_json:
        print_json({"slopes": [asdict(slope) for slope in result.slopes]})
    elif not printing.quiet:
        typer.echo(result.table())
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
    check_probability(probability)
    if model is not None:
        _coverage_of_model(model, tracks or [], probability, output, printing)
        return
    from scp_planner.studies import coverage as simulated
    from scp_planner.studies import recorded

    loaded = _load_tracks(tracks or [])
    results = _simulated(probability, runs, seed, printing.quiet)
    output.mkdir(exist_ok=True)
    simulated.save_csv(results, output / "coverage.csv")
    written = [output / "coverage.csv"]
    tables = [simulated.summary(results)]
    records: dict[str, Any] = {"simulated": [asdict(row) for row in results]}
    if pictures.can_plot():
        simulated.plot_coverage(results, output / "coverage.png")
        written.append(output / "coverage.png")
    if loaded:
        measured = [
            row
            for name, own in loaded
            for row in recorded.measure_recorded_coverage(own, data=name, window=window, probability=probability)
        ]
        recorded.save_csv(measured, output / "recorded.csv")
        written.append(output / "recorded.csv")
        tables.append(recorded.summary(measured))
        records["recorded"] = [asdict(row) for row in measured]
    if printing.as_json:
        print_json(records)
    elif not printing.quiet:
        typer.echo("\n\n".join(tables))
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
    recorded.save_csv(measured, output / "recorded.csv")
    if printing.as_json:
        print_json({"recorded": [asdict(row) for row in measured]})
    elif not printing.quiet:
        typer.echo(recorded.summary(measured))
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
        if self.conformal is not None and not 0.0 < self.conformal < 1.0:
            raise bad_option("--conformal", self.conformal, "must be between 0 and 1")
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


def _load_tracks(paths: list[Path]) -> list[tuple[str, Tracks]]:
    """Load recorded tracks, each with a short name."""
    from scp_planner.tracking.tracks import Tracks

    return [(path.stem.removesuffix("_obsmat"), Tracks.load(path)) for path in paths]


def _tell_written(files: list[Path], printing: Printing) -> None:
    if not printing.quiet:
        tell(f"wrote {', '.join(str(file) for file in files)}")
