"""Arguments and options that several commands share, and the checks of what is given for them."""

from __future__ import annotations

import importlib.util
import math
import os
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scp_planner.batch.jobs import PlanningMethod
from scp_planner.files import regular_target, try_to_write
from scp_planner.settings.pictures import FIGURE_SUFFIXES, FILM_SUFFIXES, PAGE_SUFFIXES, PICTURE_SUFFIXES, View

if TYPE_CHECKING:
    from scp_planner.scenario.models import Model, Scenario


BUILT_IN = "builtin:"
"""Prefix of a built-in scenario's name where a file is wanted."""

COMMONROAD_SUFFIX = ".xml"
"""Suffix of CommonRoad's scenarios."""


def at_least(least: int) -> Callable[[int | None], int | None]:
    """Make the check of an option; unlike the parser's own, its message has the value."""

    def check(value: int | None) -> int | None:
        if value is not None and value < least:
            raise typer.BadParameter(f"{value}: must be at least {least}")
        return value

    return check


def _completed(names: Callable[[], Iterable[str]]) -> Callable[[str], Iterable[str]]:
    """Make a completion of names, which are found out only when a shell asks for them."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]


@_completed
def _known_demos() -> Iterable[str]:
    from scp_planner import builtin

    return builtin.names()


@_completed
def _known_solvers() -> Iterable[str]:
    from scp_planner.settings.planning import solver_names

    return solver_names()


@_completed
def _known_models() -> Iterable[str]:
    from scp_planner.scenario.ready_made import NAMES

    return NAMES


@_completed
def known_settings() -> Iterable[str]:
    """Names of settings, those of closed loops too."""
    from scp_planner.settings.knobs import knobs
    from scp_planner.settings.online import OnlineSettings
    from scp_planner.settings.planning import Settings

    return [*knobs(Settings), *knobs(OnlineSettings)]


def _known_scenarios(incomplete: str) -> Iterable[str]:
    """Complete the names of built-in scenarios; where none begins like that, the shell completes files."""
    names = [BUILT_IN + name for name in _known_demos("")]
    return [name for name in names if incomplete and name.startswith(incomplete)]


def _assigned_settings(context: typer.Context, incomplete: str) -> Iterable[str]:
    """Complete the names of the settings that a command takes."""
    from scp_planner.settings.knobs import knobs
    from scp_planner.settings.planning import Settings

    drives = context.info_name == "simulate"
    return [f"{name}=" for name in known_settings(incomplete) if drives or name in knobs(Settings)]


def _seed(help_text: str) -> Any:
    return typer.Option("--seed", metavar="N", callback=at_least(0), help=help_text)


ScenarioFile = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help=f"Scenario file (YAML or JSON; XML of CommonRoad), or {BUILT_IN}NAME.",
        autocompletion=_known_scenarios,
    ),
]
ScenarioFiles = Annotated[
    list[str],
    typer.Argument(
        metavar="SCENARIO",
        help=f"Scenario files (YAML or JSON; XML of CommonRoad), or {BUILT_IN}NAME.",
        autocompletion=_known_scenarios,
    ),
]
MotionModel = Annotated[
    str | None,
    typer.Option(
        "--model",
        metavar="NAME",
        help="Motion model of all obstacles whose motion is estimated, in place of the scenario's: pedestrian, cyclist,"
        " car, ship, drone, or a file of fit-motion.",
        autocompletion=_known_models,
    ),
]
DemoName = Annotated[str, typer.Argument(metavar="NAME", help="A built-in scenario.", autocompletion=_known_demos)]
MethodName = Annotated[PlanningMethod, typer.Option("--method", help="How to plan.")]
SolverName = Annotated[
    str | None,
    typer.Option(
        "--solver",
        metavar="NAME",
        help="daqp (default), clarabel, osqp or cvxpy.",
        autocompletion=_known_solvers,
    ),
]
Assignments = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a setting, see `scp-planner settings`; may be given several times.",
        autocompletion=_assigned_settings,
    ),
]
Seed = Annotated[
    int, _seed("Accepted by all commands, 0 or more: planning draws nothing at random, every seed gives the same plan.")
]
SearchSeed = Annotated[int, _seed("Seed of the search of --method monte-carlo, 0 or more; same seed, same trials.")]
NoiseSeed = Annotated[int, _seed("Seed of the noise, 0 or more; same seed, same run.")]
TimeLimit = Annotated[
    float | None, typer.Option("--time-limit", metavar="S", help="Seconds to plan in; default: no limit.")
]
Prove = Annotated[
    float | None,
    typer.Option("--prove", metavar="GAP", help="Relative gap to prove: 0.01 asks whether any trip is 1 % faster."),
]
Samples = Annotated[int, typer.Option("--samples", metavar="N", callback=at_least(2), help="Samples in the plan file.")]
Workers = Annotated[
    int | None,
    typer.Option("--workers", metavar="N", callback=at_least(1), help="Processes; default: one for each core."),
]
Json = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print only errors and the output of --json; no progress bar.")
]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Log the planner's steps to stderr.")]


def load_scenario(source: str, model: str | None = None) -> Scenario:
    """Load a scenario file, a built-in scenario, or a scenario of CommonRoad; all its estimates by one model."""
    given = None if model is None else motion_model(model)
    scenario = _loaded(source)
    if given is None:
        return scenario
    if all(obstacle.motion is not None for obstacle in scenario.obstacles):
        raise bad_option("--model", model, f"{source} has no obstacle whose motion is to be estimated")
    obstacles = [
        obstacle if obstacle.motion is not None else obstacle.model_copy(update={"model": given})
        for obstacle in scenario.obstacles
    ]
    return scenario.model_copy(update={"obstacles": tuple(obstacles)})


def motion_model(source: str) -> Model:
    """Give a motion model: a ready-made one by its name, or one from a file."""
    from scp_planner.scenario import ready_made
    from scp_planner.scenario.models import Model
    from scp_planner.scenario.process_model import ProcessModel

    if source in ready_made.NAMES:
        return Model.named(source)
    if not Path(source).suffix:
        raise bad_option("--model", source, ready_made.unknown(source, "a file or "))
    return Model(process=ProcessModel.load(source))


def _loaded(source: str) -> Scenario:
    if source.startswith(BUILT_IN):
        from scp_planner import builtin

        return builtin.load(source.removeprefix(BUILT_IN))
    if source.lower().endswith(COMMONROAD_SUFFIX):
        if importlib.util.find_spec("commonroad") is None:
            raise bad_option("SCENARIO", source, "needs commonroad-io: pip install 'scp-planner[commonroad]'")
        from scp_planner.formats.commonroad.reading import load_commonroad

        return load_commonroad(source)
    from scp_planner.scenario.models import Scenario

    return Scenario.load(source)


def bad_option(option: str, value: object, message: str) -> typer.BadParameter:
    """Make the error of an option: the value, and what is allowed."""
    return typer.BadParameter(f"{value}: {message}", param_hint=option)


def check_solver(solver: str | None, method: PlanningMethod = PlanningMethod.SCP) -> None:
    """Refuse a solver that is not there, or has nothing to do."""
    from scp_planner.settings.planning import solver_names

    if solver is not None and method is not PlanningMethod.SCP:
        raise bad_option("--solver", solver, f"--method {method} solves no subproblems")
    if solver is not None and solver not in solver_names():
        raise bad_option("--solver", solver, f"must be one of {', '.join(solver_names())}")


def check_number(option: str, value: float | None, least: float) -> None:
    """Refuse a number that is not finite, or too small."""
    if value is not None and not (math.isfinite(value) and value >= least):
        raise bad_option(option, value, f"must be a finite number of at least {least:g}")


def check_time_limit(limit: float | None) -> None:
    """Refuse a limit in which nothing can be done."""
    if limit is not None and not (math.isfinite(limit) and limit > 0):
        raise bad_option("--time-limit", limit, "must be a finite number of seconds greater than 0")


def check_probability(option: str, value: float | None) -> None:
    """Refuse what is no probability, and the two that mean nothing."""
    if value is not None and not 0.0 < value < 1.0:
        raise bad_option(option, value, "must be between 0 and 1")


def check_target(option: str, target: Path | None, source: str | Path = "") -> None:
    """Refuse before planning a file that could not be written after it."""
    if target is None:
        return
    try:
        written = regular_target(target)
    except OSError as error:
        raise bad_option(option, target, str(error.strerror)) from None
    if not written.parent.is_dir():
        raise bad_option(
            option, target, f"the folder {written.parent if target.is_symlink() else target.parent} must exist"
        )
    _check_writable(option, target, written.parent)
    if str(source) and target.exists() and Path(source).exists() and target.samefile(source):
        raise bad_option(option, target, "must not be the scenario file itself")


def check_folder(option: str, target: Path | None, *names: str) -> None:
    """Refuse before planning a folder that could not be written into after it, or files in it that could not be."""
    if target is None:
        return
    if not target.parent.is_dir():
        raise bad_option(option, target, f"the folder {target.parent} must exist")
    if os.path.lexists(target) and not target.is_dir():
        raise bad_option(option, target, "must be a folder")
    _check_writable(option, target, target if target.is_dir() else target.parent)
    for name in names if target.is_dir() else ():
        check_target(option, target / name)


def _check_writable(option: str, target: Path, folder: Path) -> None:
    """Find out whether files can be made in a folder; its permissions alone do not say so."""
    try:
        try_to_write(folder)
    except OSError:
        raise bad_option(option, target, "the folder must be writable") from None


def keyword_settings(assignments: list[str] | None, solver: str | None) -> dict[str, Any]:
    """Read the values of ``--set`` and ``--solver``."""
    from scp_planner.settings.knobs import parse_assignments
    from scp_planner.settings.planning import Settings

    values = parse_assignments(assignments or (), Settings)
    return values if solver is None else {**values, "solver": solver}


MOVING_SUFFIXES = (*FILM_SUFFIXES, *PAGE_SUFFIXES)


PictureView = Annotated[
    View,
    typer.Option(
        "--view",
        help="What the figure of --plot shows: map and profiles; space-time: which part of the way is taken when, and"
        " so why the vehicle waits; or profiles alone.",
    ),
]


def can_plot() -> bool:
    """True if matplotlib is there."""
    return importlib.util.find_spec("matplotlib") is not None


def check_picture(
    option: str,
    target: Path | None,
    source: str = "",
    suffixes: tuple[str, ...] = PICTURE_SUFFIXES,
    view: View = View.MAP,
) -> None:
    """Refuse before planning a picture that could not be drawn after it."""
    if target is None:
        if view is not View.MAP:
            raise bad_option("--view", view, f"needs {option}")
        return
    suffix = target.suffix.lower()
    if suffix not in suffixes:
        raise bad_option(option, target, f"must end in one of {', '.join(suffixes)}")
    if suffix not in PAGE_SUFFIXES and not can_plot():
        raise bad_option(option, target, "needs matplotlib: pip install 'scp-planner[plot]'")
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise bad_option(option, target, "needs ffmpeg, which is not installed; .gif does without")
    if view is not View.MAP and suffix not in FIGURE_SUFFIXES:
        raise bad_option("--view", view, f"is a figure: {option} must end in one of {', '.join(FIGURE_SUFFIXES)}")
    check_target(option, target, source)
