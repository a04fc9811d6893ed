"""The command line: parse, call, print. Results go to files and stdout, messages to stderr.

Exit codes: 0 done and certified; 2 bad input, and nothing has been written; 3 no certified plan exists or was
found, and the best attempt has been written with its status and the reason; 130 interrupted.
"""

from __future__ import annotations

import functools
import importlib.util
import json
import logging
import math
import os
import shutil
import statistics
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from enum import IntEnum, StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec, TypeVar

import typer

from scp_planner.errors import (
    EstimationError,
    MotionModelError,
    PlanError,
    ScenarioError,
    StudyError,
    TracksError,
)

if TYPE_CHECKING:
    from scp_planner.certificate import Certificate
    from scp_planner.plan import Plan
    from scp_planner.run import Run
    from scp_planner.scenario import Scenario
    from scp_planner.tracks import Tracks

BUILT_IN = "builtin:"
"""What the name of a built-in scenario follows where a file is wanted."""

DEMO_SCENARIO = "radar"
PAGE_SUFFIX = ".html"
FILM_SUFFIXES = (".gif", ".mp4")
FIGURE_SUFFIXES = (".pdf", ".png", ".svg")
PICTURE_SUFFIXES = (*FIGURE_SUFFIXES, *FILM_SUFFIXES, PAGE_SUFFIX)

P = ParamSpec("P")
R = TypeVar("R")


class ExitCode(IntEnum):
    """What a command tells its caller."""

    CERTIFIED = 0
    BAD_INPUT = 2
    NOT_CERTIFIED = 3
    INTERRUPTED = 130


class Method(StrEnum):
    """How a plan is made."""

    SCP = "scp"
    PENALTY_DESCENT = "penalty-descent"


class Compared(StrEnum):
    """What is compared: sequential convex programming, and the variants of penalty descent."""

    SCP = "scp"
    LBFGS = "l-bfgs"
    GRADIENT = "gradient-descent"
    MONTE_CARLO = "monte-carlo"


app = typer.Typer(
    help="Plan the fastest safe trip of an unmanned vehicle among moving obstacles.",
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


studies = typer.Typer(help="Measure the published claims.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(studies, name="study")


def _at_least(least: int) -> Callable[[int], int]:
    """Make the check of an option; unlike the parser's own, its message has the value."""

    def check(value: int) -> int:
        if value < least:
            raise typer.BadParameter(f"{value}: must be at least {least}")
        return value

    return check


ScenarioFile = Annotated[
    str, typer.Argument(metavar="SCENARIO", help=f"Scenario file (YAML or JSON), or {BUILT_IN}NAME.")
]
MethodName = Annotated[Method, typer.Option("--method", help="How to plan.")]
SolverName = Annotated[str | None, typer.Option("--solver", help="daqp (default), clarabel, osqp or cvxpy.")]
Seed = Annotated[
    int,
    typer.Option("--seed", callback=_at_least(0), help="Seed of the starts, 0 or more; same seed, same plan."),
]
Json = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors and what --json asks for.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Tell on stderr what the planner does.")]


def main() -> None:
    """Run the command line."""
    app(prog_name="scp-planner")


def _with_exit_codes(command: Callable[P, R]) -> Callable[P, R]:
    """Turn what a command raises into a message on stderr and an exit code."""

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except (ScenarioError, PlanError, StudyError, EstimationError, MotionModelError, TracksError) as error:
            _tell(str(error))
        except BrokenPipeError:
            raise  # the reader of stdout has seen enough
        except OSError as error:
            _tell(f"{error.filename}: {error.strerror}" if error.filename else str(error))
        except KeyboardInterrupt:
            _tell("interrupted")
            # An interrupt while an extension module is imported leaves a mark in CPython, which then ends the
            # process by the signal, whatever its exit code. Running a string takes the mark away.
            exec("")
            raise typer.Exit(ExitCode.INTERRUPTED) from None
        raise typer.Exit(ExitCode.BAD_INPUT)

    return run


def _print_version(wanted: bool) -> None:
    if wanted:
        from scp_planner import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command("plan")
@_with_exit_codes
def plan_command(
    scenario_file: ScenarioFile,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the plan, JSON.")] = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", help="Draw the plan: .png, .pdf, .svg; .gif, .mp4; .html to look at in a browser."),
    ] = None,
    method: MethodName = Method.SCP,
    solver: SolverName = None,
    seed: Seed = 0,
    time_limit: Annotated[
        float | None, typer.Option("--time-limit", metavar="S", help="Seconds to plan in; default: no limit.")
    ] = None,
    samples: Annotated[int, typer.Option("--samples", callback=_at_least(2), help="Samples in the plan file.")] = 200,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Plan one scenario."""
    _start_logging(quiet, verbose)
    _check_solver(solver, method)
    _check_time_limit(time_limit)
    _check_target("--output", output, scenario_file)
    _check_figure("--plot", plot, scenario_file)
    scenario = _load_scenario(scenario_file)
    plan = _make_plan(scenario, method, solver, seed, time_limit)
    if output is not None:
        plan.save(output, samples=samples)
    if plot is not None:
        _draw(plan, scenario, plot)
    _report(_summary_of_plan(scenario, plan), as_json, quiet)
    _finish(scenario_file, plan.certified, f"{plan.status}: {plan.reason}" if plan.reason else str(plan.status))


@app.command("check")
@_with_exit_codes
def check_command(
    scenario_file: ScenarioFile,
    plan_file: Annotated[Path, typer.Argument(metavar="PLAN", help="Plan file (JSON), whoever made it.")],
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Certify a plan file against a scenario."""
    from scp_planner.certificate import certify
    from scp_planner.plan import Plan

    _start_logging(quiet, verbose)
    scenario = _load_scenario(scenario_file)
    certificate = certify(scenario, Plan.load(plan_file))
    _report(_summary_of_certificate(scenario, certificate), as_json, quiet)
    violations = "; ".join(str(violation) for violation in certificate.violations)
    _finish(str(plan_file), certificate.holds, violations)


@app.command("compare")
@_with_exit_codes
def compare_command(
    scenario_files: Annotated[
        list[str], typer.Argument(metavar="SCENARIO...", help=f"Scenario files (YAML or JSON), or {BUILT_IN}NAME.")
    ],
    starts: Annotated[
        int, typer.Option("--starts", callback=_at_least(1), help="Starts of each scenario, at most.")
    ] = 3,
    methods: Annotated[
        list[Compared] | None,
        typer.Option("--method", help="What to compare; may be given several times; default: scp and l-bfgs."),
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write all trials, CSV.")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="Draw convergence: .png, .pdf or .svg.")] = None,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Compare sequential convex programming with penalty descent, on the same objective from the same starts."""
    _start_logging(quiet, verbose)
    _check_target("--output", output, "")
    _check_figure("--plot", plot, "", FIGURE_SUFFIXES)
    scenarios = [_load_scenario(file) for file in scenario_files]
    from tqdm import tqdm

    from scp_planner import comparison

    chosen = [comparison.Method(method.value) for method in methods or (Compared.SCP, Compared.LBFGS)]
    most = len(scenarios) * starts * len(chosen)
    with tqdm(total=most, unit="trial", disable=True if quiet else None) as bar:

        def advance(_: object) -> None:
            bar.update()

        trials = comparison.compare(scenarios, starts_each=starts, methods=chosen, seed=seed, progress=advance)
    if output is not None:
        comparison.save_trials(trials, output)
    if plot is not None:
        from scp_planner.plotting.studies import plot_comparison

        plot_comparison(trials, plot)
    if as_json:
        records = [comparison.trial_record(trial) for trial in trials]
        _print_json({"summary": [asdict(row) for row in comparison.summaries(trials)], "trials": records})
    elif not quiet:
        typer.echo(comparison.summary_table(trials))
    certified = {trial.scenario for trial in trials if trial.certified}
    missing = [scenario.name for scenario in scenarios if scenario.name not in certified]
    if missing:
        _tell(f"no certified plan by any method: {', '.join(missing)}")
        raise typer.Exit(ExitCode.NOT_CERTIFIED)


@studies.command("consistency")
@_with_exit_codes
def consistency_command(
    quick: Annotated[bool, typer.Option("--quick", help="Few repetitions: slopes roughly, in under a minute.")] = False,
    repetitions: Annotated[
        int | None, typer.Option("--repetitions", help="Of each noise and number of observations, 2 or more.")
    ] = None,
    workers: Annotated[
        int, typer.Option("--workers", callback=_at_least(1), help="Processes; default: one for each core.")
    ] = os.cpu_count() or 1,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for results; those that are there already are used.")
    ] = Path("consistency"),
    seed: Annotated[int, typer.Option("--seed", callback=_at_least(0), help="Seed of the errors, 0 or more.")] = 0,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Measure how the estimated objective and its minimisers converge to the true ones."""
    _start_logging(quiet, verbose)
    _check_target("--output", output, "", is_folder=True)
    if repetitions is not None and repetitions < 2:
        raise _bad_option("--repetitions", repetitions, "must be at least 2")
    from scp_planner.studies.consistency import run_consistency
    from scp_planner.studies.field import ConsistencySettings, border

    settings = ConsistencySettings.quick(seed) if quick else ConsistencySettings(seed=seed)
    if repetitions is not None:
        settings = replace(settings, repetitions=repetitions)
    result = run_consistency(settings, folder=output, workers=workers, progress=not quiet)
    written = result.save(output)
    if _can_plot():
        from scp_planner.plotting.studies import plot_border, plot_consistency

        plot_consistency(result, output / "consistency.png")
        plot_border(border(), output / "border.png")
        written += [output / "consistency.png", output / "border.png"]
    if as_json:
        _print_json({"slopes": [asdict(slope) for slope in result.slopes]})
    elif not quiet:
        typer.echo(result.table())
        _tell(f"wrote {', '.join(str(file) for file in written)}")


@studies.command("coverage")
@_with_exit_codes
def coverage_command(
    tracks: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[TRACKS]...", help="Recorded tracks to measure too: half fitted, half tested."),
    ] = None,
    runs: Annotated[int, typer.Option("--runs", callback=_at_least(1), help="Simulated runs of each case.")] = 20_000,
    probability: Annotated[float, typer.Option("--probability", metavar="P", help="Nominal level.")] = 0.95,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for tables and figure.")] = Path("coverage"),
    seed: Annotated[int, typer.Option("--seed", callback=_at_least(0), help="Seed of the noise, 0 or more.")] = 0,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Measure how often zones of each level hold what they promise."""
    _start_logging(quiet, verbose)
    _check_target("--output", output, "", is_folder=True)
    _check_probability(probability)
    from scp_planner.studies.coverage import measure_coverage, plot_coverage, save_csv, summary

    loaded = _load_tracks(tracks or [])
    results = measure_coverage(probability=probability, runs=runs, seed=seed)
    output.mkdir(exist_ok=True)
    save_csv(results, output / "coverage.csv")
    written = [output / "coverage.csv"]
    if _can_plot():
        plot_coverage(results, output / "coverage.png")
        written.append(output / "coverage.png")
    tables = [summary(results)]
    if loaded:
        tables.append(_measure_recorded(loaded, probability, output / "recorded.csv"))
        written.append(output / "recorded.csv")
    if not quiet:
        typer.echo("\n\n".join(tables))
        _tell(f"wrote {', '.join(str(file) for file in written)}")


@app.command("fit-motion")
@_with_exit_codes
def fit_motion_command(
    tracks_file: Annotated[Path, typer.Argument(metavar="TRACKS", help="File or folder of recorded tracks.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Write the model, .yaml or .json.")] = Path(
        "motion.yaml"
    ),
    kind: Annotated[
        str, typer.Option("--kind", help="random_walk (of the velocity), mean_reverting or singer.")
    ] = "random_walk",
    window: Annotated[
        int, typer.Option("--window", callback=_at_least(1), help="Positions that a prediction is made from.")
    ] = 8,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Fit a motion with process noise to recorded tracks, for use as an obstacle's `model: {process: FILE}`."""
    _start_logging(quiet, verbose)
    _check_target("--output", output, str(tracks_file))
    if output.suffix not in (".yaml", ".yml", ".json"):
        raise _bad_option("--output", output, "must end in .yaml, .yml or .json")
    from scp_planner.motion_fitting import fit_motion_model

    model = fit_motion_model(_load_tracks([tracks_file])[0][1], kind, window=window)
    model.save(output)
    if not quiet:
        _tell(f"wrote {output}")


def _load_tracks(paths: list[Path]) -> list[tuple[str, Tracks]]:
    """Load recorded tracks, each with a short name."""
    from scp_planner.tracks import Tracks

    return [(path.stem.removesuffix("_obsmat"), Tracks.load(path)) for path in paths]


def _measure_recorded(loaded: list[tuple[str, Tracks]], probability: float, target: Path) -> str:
    """Measure the coverage on recorded tracks, write the table and return its summary."""
    from scp_planner.studies.recorded import measure_recorded_coverage, save_csv, summary

    results = [
        result
        for name, tracks in loaded
        for result in measure_recorded_coverage(tracks, data=name, probability=probability)
    ]
    save_csv(results, target)
    return summary(results)


def _check_probability(probability: float) -> None:
    if not 0.0 < probability < 1.0:
        raise _bad_option("--probability", probability, "must be between 0 and 1")


@app.command("simulate")
@_with_exit_codes
def simulate_command(
    scenario_file: ScenarioFile,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the run, JSON.")] = None,
    animation: Annotated[
        Path | None, typer.Option("--animate", help="Animate the run: .gif, .mp4; .html to look at in a browser.")
    ] = None,
    noise: Annotated[
        float, typer.Option("--noise", metavar="S", help="Standard deviation of observed coordinates, m.")
    ] = 0.1,
    rate: Annotated[float, typer.Option("--rate", metavar="HZ", help="Observations and replans per second.")] = 10.0,
    seed: Annotated[
        int, typer.Option("--seed", callback=_at_least(0), help="Seed of the noise, 0 or more; same seed, same run.")
    ] = 0,
    solver: SolverName = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Drive one scenario in a closed loop: observe, refresh zones, replan, drive."""
    from scp_planner.simulation import simulate

    _start_logging(quiet, verbose)
    _check_solver(solver, Method.SCP)
    for option, value, least in (("--noise", noise, 0.0), ("--rate", rate, 1e-3)):
        if not (math.isfinite(value) and value >= least):
            raise _bad_option(option, value, f"must be a finite number of at least {least:g}")
    _check_target("--output", output, scenario_file)
    _check_figure("--animate", animation, scenario_file, (*FILM_SUFFIXES, PAGE_SUFFIX))
    run = simulate(_load_scenario(scenario_file), noise, rate, seed, solver=solver)
    if output is not None:
        run.save(output)
    if animation is not None:
        _animate(run, animation)
    _report(_summary_of_run(run), as_json, quiet)
    faults = [] if run.arrived else [f"did not arrive in {run.travel_time:g} s"]
    if run.contact:
        faults.append(f"touched an obstacle, {-run.least_clearance:.3g} m deep")
    if faults:
        _tell(f"{scenario_file}: {'; '.join(faults)}")
        raise typer.Exit(ExitCode.NOT_CERTIFIED)


@app.command("export")
@_with_exit_codes
def export_command(
    source: Annotated[Path, typer.Argument(metavar="PLAN", help="Plan file or run file (JSON).")],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="Write .csv or .npz: a table; .mcap, or a folder without suffix: messages for ROS 2."
        ),
    ],
    samples: Annotated[int, typer.Option("--samples", callback=_at_least(2), help="Samples of a plan.")] = 200,
    frame: Annotated[str, typer.Option("--frame", help="Name of the frame of messages.")] = "map",
    body: Annotated[str, typer.Option("--body", help="Name of the vehicle in messages.")] = "base_link",
    epoch: Annotated[
        float, typer.Option("--epoch", metavar="S", help="ROS time at time 0 of the plan, for messages.")
    ] = 0.0,
    quiet: Quiet = False,
) -> None:
    """Write a plan or a run for other programs: for example scp-planner export plan.json -o plan.csv."""
    from scp_planner.export import EXPORT_SUFFIXES, export
    from scp_planner.export.files import load_plan_or_run

    _start_logging(quiet, verbose=False)
    suffix = output.suffix.lower()
    if suffix not in (*EXPORT_SUFFIXES, ""):
        raise _bad_option("--output", output, f"must end in one of {', '.join(EXPORT_SUFFIXES)}, or have no suffix")
    if suffix in ("", ".mcap") and importlib.util.find_spec("rosbags") is None:
        raise _bad_option("--output", output, "needs rosbags: pip install 'scp-planner[ros]'")
    if suffix == "" and output.exists():
        raise _bad_option("--output", output, "exists already; a bag's folder must be a new one")
    _check_target("--output", output, str(source))
    subject = load_plan_or_run(source)
    try:
        export(subject, output, samples=samples, frame=frame, body=body, epoch=epoch)
    except ValueError as error:
        raise _bad_option("--epoch", epoch, str(error)) from None
    if not quiet:
        _tell(f"wrote {output}")


@app.command("schema")
@_with_exit_codes
def schema_command() -> None:
    """Print the JSON schema of the scenario file."""
    from scp_planner.scenario import Scenario

    typer.echo(json.dumps(Scenario.json_schema(), indent=2))


@app.command("demo")
@_with_exit_codes
def demo_command(
    name: Annotated[str, typer.Argument(help="A built-in scenario.")] = DEMO_SCENARIO,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write into.")] = Path("demo"),
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Plan a built-in scenario; write scenario, plan, page and pictures into a folder."""
    _start_logging(quiet, verbose)
    _check_target("--output", output, "", is_folder=True)
    scenario = _load_scenario(BUILT_IN + name)
    plan = _make_plan(scenario, Method.SCP)
    output.mkdir(exist_ok=True)
    scenario.save(output / "scenario.yaml")
    plan.save(output / "plan.json")
    pictures = ["plan.html"]
    if _can_plot():
        from scp_planner.plotting import plot_space_time

        pictures += ["plan.png", "plan.gif"]
        plot_space_time(plan, scenario, output / "space_time.png")
    else:
        _tell("no figures: matplotlib is not installed (pip install 'scp-planner[plot]')")
    for picture in pictures:
        _draw(plan, scenario, output / picture)
    written = ["scenario.yaml", "plan.json", *pictures, *(["space_time.png"] if _can_plot() else [])]
    _report(_summary_of_plan(scenario, plan), as_json, quiet)
    if not quiet:
        _tell(f"wrote {', '.join(str(output / file) for file in written)}")
    _finish(BUILT_IN + name, plan.certified, str(plan.reason))


def _load_scenario(source: str) -> Scenario:
    if source.startswith(BUILT_IN):
        from scp_planner import builtin

        return builtin.load(source.removeprefix(BUILT_IN))
    from scp_planner.scenario import Scenario

    return Scenario.load(source)


def _make_plan(
    scenario: Scenario,
    method: Method,
    solver: str | None = None,
    seed: int = 0,
    time_limit: float | None = None,
) -> Plan:
    match method:
        case Method.SCP:
            from scp_planner.planner import plan

            return plan(scenario, solver=solver, seed=seed, time_limit=time_limit)
        case Method.PENALTY_DESCENT:
            from scp_planner.penalty_descent import penalty_descent

            return penalty_descent(scenario, seed=seed, time_limit=time_limit)


def _draw(plan: Plan, scenario: Scenario, path: Path) -> None:
    """Draw a plan as the file's suffix says: a page for a browser, an animation or a figure."""
    suffix = path.suffix.lower()
    if suffix == PAGE_SUFFIX:
        from scp_planner.viewer import save_viewer

        save_viewer(plan, scenario, path)
    elif suffix in FILM_SUFFIXES:
        from scp_planner.plotting import animate_plan

        animate_plan(plan, scenario, path)
    else:
        from scp_planner.plotting import plot_plan

        plot_plan(plan, scenario, path)


def _animate(run: Run, path: Path) -> None:
    if path.suffix.lower() == PAGE_SUFFIX:
        from scp_planner.viewer import save_recording

        save_recording(run.recording(), path)
    else:
        from scp_planner.plotting import animate

        animate(run.recording(), path)


def _can_plot() -> bool:
    return importlib.util.find_spec("matplotlib") is not None


def _check_solver(solver: str | None, method: Method) -> None:
    from scp_planner.solvers.interface import SOLVERS

    if solver is not None and method is not Method.SCP:
        raise _bad_option("--solver", solver, f"--method {method} solves no subproblems")
    if solver is not None and solver not in SOLVERS:
        raise _bad_option("--solver", solver, f"must be one of {', '.join(SOLVERS)}")


def _check_time_limit(limit: float | None) -> None:
    if limit is not None and not (math.isfinite(limit) and limit > 0):
        raise _bad_option("--time-limit", limit, "must be a finite number of seconds greater than 0")


def _check_target(option: str, target: Path | None, source: str, *, is_folder: bool = False) -> None:
    """Refuse before planning what could not be written after it."""
    if target is None:
        return
    if not target.parent.is_dir():
        raise _bad_option(option, target, f"the folder {target.parent} must exist")
    if target.exists() and target.is_dir() != is_folder:
        raise _bad_option(option, target, "must be a folder" if is_folder else "must not be a folder")
    if not os.access(target if target.is_dir() else target.parent, os.W_OK):
        raise _bad_option(option, target, "the folder must be writable")
    if source and target.exists() and Path(source).exists() and target.samefile(source):
        raise _bad_option(option, target, "must not be the scenario file itself")


def _check_figure(option: str, target: Path | None, source: str, suffixes: tuple[str, ...] = PICTURE_SUFFIXES) -> None:
    if target is None:
        return
    suffix = target.suffix.lower()
    if suffix not in suffixes:
        raise _bad_option(option, target, f"must end in one of {', '.join(suffixes)}")
    if suffix != PAGE_SUFFIX and not _can_plot():
        raise _bad_option(option, target, "needs matplotlib: pip install 'scp-planner[plot]'")
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise _bad_option(option, target, "needs ffmpeg, which is not installed; .gif does without")
    _check_target(option, target, source)


def _bad_option(option: str, value: object, message: str) -> typer.BadParameter:
    return typer.BadParameter(f"{value}: {message}", param_hint=option)


def _summary_of_plan(scenario: Scenario, plan: Plan) -> dict[str, Any]:
    return {
        "scenario": scenario.name,
        "status": str(plan.status),
        "certified": plan.certified,
        "reason": plan.reason,
        "arrival_time": plan.arrival_time,
        "travel_time": plan.travel_time,
        "least_clearance": plan.clearance.minimum,
        "nearest_obstacle": plan.clearance.obstacle,
        "time_of_least_clearance": plan.clearance.time,
        "iterations": plan.iterations,
        "wall_time": plan.wall_time,
        "method": plan.method,
        "solver": plan.solver,
    }


def _summary_of_run(run: Run) -> dict[str, Any]:
    return {
        "scenario": run.scenario.name,
        "arrived": run.arrived,
        "contact": run.contact,
        "contact_standing": run.contact_standing,
        "travel_time": run.travel_time,
        "least_clearance": run.least_clearance,
        "replans": len(run.records),
        **run.outcomes,
        "median_replan_time": statistics.median(run.wall_times.tolist()),
        "seed": run.seed,
    }


def _summary_of_certificate(scenario: Scenario, certificate: Certificate) -> dict[str, Any]:
    return {
        "scenario": scenario.name,
        "certified": certificate.holds,
        "least_clearance": certificate.clearance.minimum,
        "nearest_obstacle": certificate.clearance.obstacle,
        "time_of_least_clearance": certificate.clearance.time,
        "violations": [str(violation) for violation in certificate.violations],
    }


_UNITS = {
    "arrival_time": "s",
    "travel_time": "s",
    "least_clearance": "m",
    "time_of_least_clearance": "s",
    "wall_time": "s",
    "median_replan_time": "s",
}
_TOLD_AT_THE_END = ("reason", "violations")


def _report(summary: dict[str, Any], as_json: bool, quiet: bool) -> None:
    """Print a summary on stdout: as JSON, or one line a figure with its unit."""
    if as_json:
        finite = {key: _finite(value) for key, value in summary.items()}
        typer.echo(json.dumps(finite, indent=1, allow_nan=False))
    elif not quiet:
        for key, value in summary.items():
            if value is not None and key not in _TOLD_AT_THE_END:
                typer.echo(f"{key.replace('_', ' ') + ':':<25}{_shown(value)} {_UNITS.get(key, '')}".rstrip())


def _print_json(data: Any) -> None:
    """Print as JSON; numbers that JSON has no word for become null."""

    def known(value: Any) -> Any:
        match value:
            case dict():
                return {key: known(item) for key, item in value.items()}
            case list():
                return [known(item) for item in value]
            case _:
                return _finite(value)

    typer.echo(json.dumps(known(data), indent=1, allow_nan=False))


def _shown(value: object) -> str:
    match value:
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.4f}"
        case _:
            return str(value)


def _finite(value: Any) -> Any:
    """Give None for a number that JSON has no word for: the clearance where there are no obstacles."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _finish(source: str, certified: bool, reason: str) -> None:
    if not certified:
        _tell(f"{source}: not certified: {reason}")
        raise typer.Exit(ExitCode.NOT_CERTIFIED)


def _start_logging(quiet: bool, verbose: bool) -> None:
    level = logging.DEBUG if verbose else logging.ERROR if quiet else logging.WARNING
    logging.basicConfig(stream=sys.stderr, level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    logging.getLogger("scp_planner").setLevel(level)


def _tell(message: str) -> None:
    typer.echo(message, err=True)
