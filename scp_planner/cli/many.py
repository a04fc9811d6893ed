"""Commands about many scenarios: compare."""

from __future__ import annotations

from dataclasses import asdict, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from scp_planner.cli import pictures
from scp_planner.cli.application import ExitCode
from scp_planner.cli.options import (
    Assignments,
    Json,
    Quiet,
    ScenarioFiles,
    Seed,
    Verbose,
    at_least,
    check_target,
    keyword_settings,
    load_scenario,
)
from scp_planner.cli.output import print_json, progress_bar, start_logging, tell


class Compared(StrEnum):
    """What is compared: sequential convex programming, and the variants of penalty descent."""

    SCP = "scp"
    LBFGS = "l-bfgs"
    GRADIENT = "gradient-descent"
    MONTE_CARLO = "monte-carlo"


def compare(
    scenario_files: ScenarioFiles,
    starts: Annotated[
        int, typer.Option("--starts", metavar="N", callback=at_least(1), help="Starts of each scenario, at most.")
    ] = 3,
    methods: Annotated[
        list[Compared] | None,
        typer.Option("--method", help="What to compare; may be given several times; default: scp and l-bfgs."),
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write all trials, CSV.")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="Draw convergence: .png, .pdf or .svg.")] = None,
    assignments: Assignments = None,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Compare SCP with penalty descent.

    Sequential convex programming and the published method run on the same objective from the same starts.
    """
    from scp_planner import comparison
    from scp_planner.settings import Settings

    start_logging(quiet, verbose)
    check_target("--output", output)
    pictures.check_picture("--plot", plot, suffixes=pictures.FIGURE_SUFFIXES)
    settings = replace(Settings(), **keyword_settings(assignments, None))
    scenarios = [load_scenario(file) for file in scenario_files]
    chosen = [comparison.Method(method.value) for method in methods or (Compared.SCP, Compared.LBFGS)]
    with progress_bar(len(scenarios) * starts * len(chosen), "trial", quiet) as bar:

        def advance(_: object) -> None:
            bar.update()

        trials = comparison.compare(
            scenarios,
            starts_each=starts,
            methods=chosen,
            settings=settings,
            seed=seed,
            progress=advance,
        )
    if output is not None:
        comparison.save_trials(trials, output)
    if plot is not None:
        from scp_planner.plotting.studies import plot_comparison

        plot_comparison(trials, plot)
    if as_json:
        records = [comparison.trial_record(trial) for trial in trials]
        print_json({"summary": [asdict(row) for row in comparison.summaries(trials)], "trials": records})
    elif not quiet:
        typer.echo(comparison.summary_table(trials))
    certified = {trial.scenario for trial in trials if trial.certified}
    missing = [scenario.name for scenario in scenarios if scenario.name not in certified]
    if missing:
        tell(f"no certified plan by any method: {', '.join(missing)}")
        raise typer.Exit(ExitCode.NOT_CERTIFIED)
