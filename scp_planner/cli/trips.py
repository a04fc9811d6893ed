"""Commands about one scenario: demo, plan, simulate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scp_planner.batch.jobs import Options, planned
from scp_planner.cli import commonroad, summaries
from scp_planner.cli.application import ExitCode
from scp_planner.cli.groups import PlanOptions, Printing
from scp_planner.cli.options import (
    BUILT_IN,
    MOVING_SUFFIXES,
    Assignments,
    DemoName,
    MotionModel,
    NoiseSeed,
    PictureView,
    ScenarioFile,
    SolverName,
    bad_option,
    can_plot,
    check_folder,
    check_number,
    check_picture,
    check_solver,
    check_target,
    load_scenario,
)
from scp_planner.cli.output import progress_bar, report, start_logging, tell, waiting
from scp_planner.settings.pictures import FIGURE_SUFFIXES, View

if TYPE_CHECKING:
    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario
    from scp_planner.simulation.run import Run

DEMO_SCENARIO = "radar"
DEMO_DATA = ("scenario.yaml", "plan.json", "run.json")
DEMO_PAGES = ("plan.html", "run.html")
DEMO_FIGURES = ("plan.png", "space_time.png", "run.gif")
DEMO_FILES = (*DEMO_DATA, *DEMO_PAGES, *DEMO_FIGURES)


@dataclass(frozen=True)
class PictureOptions:
    plot: Annotated[
        Path | None,
        typer.Option("--plot", help="Draw the plan: .png, .pdf, .svg; .gif, .mp4; .html to look at in a browser."),
    ] = None
    view: PictureView = View.MAP


@dataclass(frozen=True)
class DriveOptions:
    noise: Annotated[
        float | None,
        typer.Option(
            "--noise", metavar="S", help="Standard deviation of observed coordinates, m; default: 1/200 of the trip."
        ),
    ] = None
    rate: Annotated[
        float | None,
        typer.Option(
            "--rate", metavar="HZ", help="Observations and replans per second; default: 70 or so in the fastest trip."
        ),
    ] = None
    motion: MotionModel = None
    seed: NoiseSeed = 0
    solver: SolverName = None
    assignments: Assignments = None

    def check(self) -> None:
        """Refuse a solver that is not there, and numbers that are too small."""
        check_solver(self.solver)
        check_number("--noise", self.noise, 0.0)
        check_number("--rate", self.rate, 1e-9)

    def values(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Settings by ``--set``: of plans, and of the closed loop."""
        from scp_planner.settings.knobs import knobs, parse_assignments
        from scp_planner.settings.online import OnlineSettings
        from scp_planner.settings.planning import Settings

        given = parse_assignments(self.assignments or (), Settings, OnlineSettings)
        if "period" in given:
            raise bad_option("--set", "period", "--rate gives the period")
        planning = {name: value for name, value in given.items() if name in knobs(Settings)}
        return planning, {name: value for name, value in given.items() if name not in planning}


def demo(
    name: DemoName = DEMO_SCENARIO,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write into.")] = Path("demo"),
    *,
    printing: Printing,
) -> None:
    """Plan, drive and draw a built-in scenario.

    Scenario, plan, the run of a closed loop, pictures and pages for a browser are written into a folder.
    """
    start_logging(printing)
    check_folder("--output", output, *DEMO_FILES)
    scenario, quiet = load_scenario(BUILT_IN + name), printing.quiet
    with waiting("planning", quiet):
        made = planned(scenario, Options()).bounded()
    run = _drive(scenario, DriveOptions(noise=0.1, rate=10.0), quiet)
    output.mkdir(exist_ok=True)
    scenario.save(output / "scenario.yaml")
    made.save(output / "plan.json")
    run.save(output / "run.json")
    written = [*DEMO_DATA, *_draw_demo(scenario, made, run, output, quiet)]
    figures = {**summaries.of_plan(scenario, made), **_prefixed("simulated", summaries.of_run(run))}
    report(figures, printing)
    if not quiet:
        tell(f"wrote {', '.join(str(output / file) for file in written)}")
    _finish(BUILT_IN + name, made.certified, str(made.reason))
    _finish_run(BUILT_IN + name, run)


def plan(
    scenario_file: ScenarioFile,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the plan, JSON.")] = None,
    *,
    picture: PictureOptions,
    motion: MotionModel = None,
    planning: PlanOptions,
    bound: Annotated[
        bool,
        typer.Option(
            "--bound/--no-bound", help="Find out what no trip among the obstacles is shorter than, not only without."
        ),
    ] = True,
    solution: commonroad.SolutionOptions,
    printing: Printing,
) -> None:
    """Plan one scenario."""
    start_logging(printing)
    planning.check()
    check_target("--output", output, scenario_file)
    check_picture("--plot", picture.plot, scenario_file, view=picture.view)
    solution.check(scenario_file, planning.method)
    options = planning.options
    with waiting("planning", printing.quiet):
        if solution.file is None:
            scenario = load_scenario(scenario_file, motion)
            made = planned(scenario, options)
        else:
            answer = solution.planned(scenario_file, planning.values, planning.time_limit)
            scenario, made = answer.scenario, answer.plan
            solution.write(made, scenario_file, quiet=printing.quiet)
    if bound:
        with waiting("bounding what another plan could gain", printing.quiet):
            made = made.bounded()
    if output is not None:
        made.save(output, samples=planning.samples)
    if picture.plot is not None:
        made.draw(scenario, picture.plot, picture.view)
    report(summaries.of_plan(scenario, made), printing)
    if made.certified and not printing.quiet:
        _tell_of_discs(scenario)
    _finish(scenario_file, made.certified, f"{made.status}: {made.reason}" if made.reason else str(made.status))


def simulate(
    scenario_file: ScenarioFile,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the run, JSON.")] = None,
    animation: Annotated[
        Path | None, typer.Option("--animate", help="Animate the run: .gif, .mp4; .html to look at in a browser.")
    ] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="Draw the run: .png, .pdf or .svg.")] = None,
    view: PictureView = View.MAP,
    *,
    drive: DriveOptions,
    printing: Printing,
) -> None:
    """Drive one scenario in a closed loop.

    Observe, refresh zones, replan, drive. Obstacles with a known motion really move like that and are seen with noise;
    of those with observations, the truth is drawn from what the observations leave open.
    """
    start_logging(printing)
    drive.check()
    check_target("--output", output, scenario_file)
    check_picture("--animate", animation, scenario_file, MOVING_SUFFIXES)
    check_picture("--plot", plot, scenario_file, FIGURE_SUFFIXES, view)
    run = _drive(load_scenario(scenario_file, drive.motion), drive, printing.quiet)
    if output is not None:
        run.save(output)
    if animation is not None:
        run.draw(animation)
    if plot is not None:
        run.draw(plot, view)
    report(summaries.of_run(run), printing)
    _finish_run(scenario_file, run)


def _drive(scenario: Scenario, drive: DriveOptions, quiet: bool) -> Run:
    from scp_planner.online.planner import SETTINGS
    from scp_planner.scenario.units import NaturalUnits
    from scp_planner.settings.online import OnlineSettings
    from scp_planner.settings.planning import with_given
    from scp_planner.simulation.loop import DEFAULTS, simulate
    from scp_planner.simulation.setup import Follower

    planning, driving = drive.values()
    units = NaturalUnits.of(scenario)
    online = replace(OnlineSettings(forget_after=DEFAULTS.forget_after * units.time), **driving)
    with progress_bar(None, "s", quiet, bar_format="driving: {n:.1f} s, {elapsed}") as bar:

        def advance(time: float) -> None:
            bar.update(time - bar.n)

        return simulate(
            scenario,
            drive.noise,
            drive.rate,
            drive.seed,
            settings=with_given(SETTINGS, planning, units),
            online=online,
            follower=Follower(online.tracking_error, online.reaction_time),
            solver=drive.solver,
            progress=advance,
        )


def _draw_demo(scenario: Scenario, made: Plan, run: Run, folder: Path, quiet: bool) -> list[str]:
    """Draw all that can be drawn; return the names of the files."""
    made.draw(scenario, folder / "plan.html")
    run.draw(folder / "run.html")
    if not can_plot():
        if not quiet:
            tell("no figures: matplotlib is not installed (pip install 'scp-planner[plot]')")
        return [*DEMO_PAGES]
    made.draw(scenario, folder / "plan.png")
    made.draw(scenario, folder / "space_time.png", "space-time")
    if not quiet:
        tell("drawing the animation ...")
    run.draw(folder / "run.gif")
    return [*DEMO_PAGES, *DEMO_FIGURES]


def _prefixed(prefix: str, summary: dict[str, object]) -> dict[str, object]:
    kept = ("arrived", "contact", "travel_time", "least_clearance", "replans")
    return {f"{prefix}_{key}": summary[key] for key in kept}


def _tell_of_discs(scenario: Scenario) -> None:
    from scp_planner.scenario.shapes import Ellipse, Rectangle
    from scp_planner.scenario.units import NaturalUnits
    from scp_planner.threat_zones.of_scenario import ZonesOf, taken_for_discs

    if not any(isinstance(obstacle.shape, Rectangle | Ellipse) for obstacle in scenario.obstacles):
        return  # zones of a corridor, or of what was observed, take their time
    zones = ZonesOf(NaturalUnits.of(scenario).scenario(scenario)).of_others
    for told in taken_for_discs(scenario.obstacles, zones):
        tell(f"{told}: give shape.heading if you know it")


def _finish(source: str, certified: bool, reason: str) -> None:
    if not certified:
        tell(f"{source}: not certified: {reason}")
        raise typer.Exit(ExitCode.NOT_CERTIFIED)


def _finish_run(source: str, run: Run) -> None:
    faults = [] if run.arrived else [f"did not arrive in {run.travel_time:g} s: {run.records[-1].reason}"]
    if run.contact:
        faults.append(f"touched an obstacle, {-run.least_clearance:.3g} m deep")
    if run.contact_standing:
        tell(f"{source}: an obstacle touched the vehicle while it stood; least clearance is that while it moved")
    if faults:
        tell(f"{source}: {'; '.join(faults)}")
        raise typer.Exit(ExitCode.NOT_CERTIFIED)
