"""Commands about many scenarios: batch, compare."""

from __future__ import annotations

import logging
from collections import Counter
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scp_planner.baseline import methods as compared
from scp_planner.cli.application import ExitCode
from scp_planner.cli.groups import PlanOptions, Printing
from scp_planner.cli.options import (
    Assignments,
    ScenarioFiles,
    SearchSeed,
    Workers,
    at_least,
    bad_option,
    check_folder,
    check_picture,
    check_target,
    load_scenario,
)
from scp_planner.cli.output import progress_bar, report, start_logging, tabulate, tell
from scp_planner.settings.pictures import FIGURE_SUFFIXES

if TYPE_CHECKING:
    from scp_planner.batch.executor import Executor
    from scp_planner.batch.jobs import Options
    from scp_planner.batch.runner import BatchResult

MOST_TOLD = 10
"""Scenarios without a certified plan that are named one by one."""


@dataclass(frozen=True)
class CrewOptions:
    workers: Workers = None
    dask: Annotated[
        str | None,
        typer.Option("--dask", metavar="ADDRESS", help="Scheduler of a Dask cluster to work on, tcp://HOST:PORT."),
    ] = None

    def check(self) -> None:
        """Refuse both at once."""
        if self.workers is not None and self.dask is not None:
            raise bad_option("--workers", self.workers, "goes with processes of this machine, not with --dask")

    def executor(self, verbose: bool, stack: ExitStack) -> Executor:
        """Executor of the work; a connection is closed with the stack."""
        if self.dask is None:
            from scp_planner.batch.local import LocalExecutor

            return LocalExecutor(self.workers)
        from scp_planner.batch.dask_cluster import DaskExecutor

        executor = stack.enter_context(closing(DaskExecutor(self.dask)))
        if not verbose:  # That a scheduler is lost is told in one line; how its client sees that fills a screen.
            logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        return executor


@dataclass(frozen=True)
class TableOptions:
    timings: Annotated[
        bool, typer.Option("--timings", help="Add a column of wall times, which differ from run to run.")
    ] = False
    retry: Annotated[
        bool, typer.Option("--retry", help="Do scenarios again whose work came to nothing: status error or lost.")
    ] = False


def batch(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of scenario files (YAML or JSON).")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Table of results, CSV; rows that are there are not done again.")
    ] = Path("results.csv"),
    *,
    crew: CrewOptions,
    pattern: Annotated[
        str | None, typer.Option("--pattern", metavar="GLOB", help="Which files of DIR, such as '**/crossing*.yaml'.")
    ] = None,
    plans: Annotated[Path | None, typer.Option("--plans", help="Folder to write the plans into, JSON.")] = None,
    planning: PlanOptions,
    rows: TableOptions,
    printing: Printing,
) -> None:
    """Plan all scenarios of a folder.

    Each becomes a row of the table, bad ones too. After an interrupt the same command goes on where it was.
    """
    start_logging(printing)
    crew.check()
    planning.check()
    check_target("--output", output)
    check_folder("--plans", plans)
    if not folder.is_dir():
        raise bad_option("DIR", folder, "must be a folder")
    from scp_planner.batch.runner import scenario_files

    options = planning.options
    try:
        files = scenario_files(folder, pattern, [output, *([plans] if plans is not None else [])])
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--pattern") from None
    if not files:
        raise bad_option("DIR", folder, f"holds no scenario files{f' like {pattern}' if pattern else ''}")
    with ExitStack() as stack:
        executor = crew.executor(printing.verbose, stack)
        result = _Work(files, output, options, plans, rows).done(executor, printing.quiet, stack)
    summary = {"scenarios": len(files), **result.counts, "done_before": result.done_before, "results": str(output)}
    report(summary, printing)
    missing = [row for row in result.rows if row["status"] != "certified"]
    for row in missing[:MOST_TOLD]:
        tell(f"{row['file']}: {row['status']}: {row['reason']}")
    if len(missing) > MOST_TOLD:
        tell(f"... and {len(missing) - MOST_TOLD} more, see {output}")
    if missing:
        raise typer.Exit(ExitCode.NOT_CERTIFIED)


@dataclass(frozen=True)
class _Work:
    files: dict[str, Path]
    output: Path
    options: Options
    plans: Path | None
    rows: TableOptions

    def done(self, executor: Executor, quiet: bool, stack: ExitStack) -> BatchResult:
        """Do it, with a progress bar; what interrupts it is told with how far it went."""
        from scp_planner.batch.executor import ExecutorError
        from scp_planner.batch.runner import run_batch

        bar = stack.enter_context(progress_bar(len(self.files), "scenario", quiet))
        counts: Counter[str] = Counter()

        def advance(done: int, status: str) -> None:
            counts[status] += 1
            bar.set_postfix(counts, refresh=False)
            bar.update(done - bar.n)

        try:
            return run_batch(
                self.files,
                self.output,
                executor,
                self.options,
                plans=self.plans,
                timings=self.rows.timings,
                retry=self.rows.retry,
                progress=advance,
            )
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"interrupted: {self._how_far()}") from None
        except ExecutorError as error:
            tell(f"{error}: {self._how_far()}")
            raise typer.Exit(ExitCode.CUT_SHORT) from None

    def _how_far(self) -> str:
        from scp_planner.batch.runner import rows_done

        done = rows_done(self.files, self.output, timings=self.rows.timings)
        return f"{done} of {len(self.files)} rows are in {self.output}; the same command goes on from there"


def compare(
    scenario_files: ScenarioFiles,
    starts: Annotated[
        int, typer.Option("--starts", metavar="N", callback=at_least(1), help="Starts of each scenario, at most.")
    ] = 3,
    methods: Annotated[
        list[compared.Method] | None,
        typer.Option("--method", help="What to compare; may be given several times; default: scp and l-bfgs."),
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write all trials, CSV.")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="Draw convergence: .png, .pdf or .svg.")] = None,
    assignments: Assignments = None,
    seed: SearchSeed = 0,
    *,
    printing: Printing,
) -> None:
    """Compare SCP with penalty descent.

    Sequential convex programming and the published method run on the same objective from the same starts.
    """
    from scp_planner.baseline import comparison
    from scp_planner.settings.planning import Settings

    start_logging(printing)
    check_target("--output", output)
    check_picture("--plot", plot, suffixes=FIGURE_SUFFIXES)
    settings = Settings.from_text(assignments or ())
    scenarios = [load_scenario(file) for file in scenario_files]
    chosen = methods or [compared.Method.SCP, compared.Method.LBFGS]
    with progress_bar(len(scenarios) * starts * len(chosen), "trial", printing.quiet) as bar:

        def advance(_: object) -> None:
            bar.update()

        trials = comparison.compare(
            scenarios, starts_each=starts, methods=chosen, settings=settings, seed=seed, progress=advance
        )
    if output is not None:
        comparison.save_trials(trials, output)
    if plot is not None:
        from scp_planner.studies.figures import plot_comparison

        plot_comparison(trials, plot)
    records = [comparison.trial_record(trial) for trial in trials]
    summary = [asdict(row) for row in comparison.summaries(trials)]
    tabulate({"summary": summary, "trials": records}, comparison.summary_table(trials), printing)
    certified = {trial.scenario for trial in trials if trial.certified}
    missing = [scenario.name for scenario in scenarios if scenario.name not in certified]
    if missing:
        tell(f"no certified plan by any method: {', '.join(missing)}")
        raise typer.Exit(ExitCode.NOT_CERTIFIED)
