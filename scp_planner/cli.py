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
import sys
from collections.abc import Callable
from enum import IntEnum, StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec, TypeVar

import typer

from scp_planner.errors import PlanError, ScenarioError

if TYPE_CHECKING:
    from scp_planner.certificate import Certificate
    from scp_planner.plan import Plan
    from scp_planner.scenario import Scenario

BUILT_IN = "builtin:"
"""What the name of a built-in scenario follows where a file is wanted."""

DEMO_SCENARIO = "radar"
PAGE_SUFFIX = ".html"
FILM_SUFFIXES = (".gif", ".mp4")
PICTURE_SUFFIXES = (".pdf", ".png", ".svg", *FILM_SUFFIXES, PAGE_SUFFIX)

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


app = typer.Typer(
    help="Plan the fastest safe trip of an unmanned vehicle among moving obstacles.",
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


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
        except (ScenarioError, PlanError) as error:
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
    _check_solver(solver)
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


def _can_plot() -> bool:
    return importlib.util.find_spec("matplotlib") is not None


def _check_solver(solver: str | None) -> None:
    from scp_planner.solvers.interface import SOLVERS

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


def _check_figure(option: str, target: Path | None, source: str) -> None:
    if target is None:
        return
    suffix = target.suffix.lower()
    if suffix not in PICTURE_SUFFIXES:
        raise _bad_option(option, target, f"must end in one of {', '.join(PICTURE_SUFFIXES)}")
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
