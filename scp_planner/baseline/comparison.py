"""Sequential convex programming beside penalty descent: the same objective, splines, starts and certificate."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import islice
from os import PathLike
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scp_planner.arrays import Array
from scp_planner.baseline.descent import Descent, checked_descent
from scp_planner.baseline.descent_run import DescentSettings, Iterate, Variant
from scp_planner.baseline.methods import Method
from scp_planner.certificate.check import certify_trip
from scp_planner.certificate.verdict import Certificate
from scp_planner.files import text_table, write_rows
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.problem.tightening import TIGHTENINGS, tightened
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.scp.evaluation import evaluate_trip
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.merit import Penalties
from scp_planner.search.starts import starts
from scp_planner.settings.knobs import word_of
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.solvers import solver_named
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

CURVE_PRICE = 50.0  # Of the merit of all methods' convergence curves, units of time for one of length or of excess


@dataclass(frozen=True)
class Curve:
    """Course of a run: the least merit so far, at one price for all methods."""

    evaluations: NDArray[np.int64]  # (n,)
    seconds: Array  # (n,) Since the run began
    merit: Array  # (n,) Travel time + CURVE_PRICE * violations, s


@dataclass(frozen=True)
class Trial:
    """One method from one start."""

    scenario: str
    start: int  # Number of the start, from 0
    method: Method
    status: str
    certified: bool
    travel_time: float  # s
    least_clearance: float  # To the zones, m; certified if the trip is
    worst_violation: float
    iterations: int  # An evaluation is one of a trip and its violations
    evaluations: int  # An evaluation is one of a trip and its violations
    wall_time: float  # s, without the certificate
    violations: str
    curve: Curve


@dataclass(frozen=True)
class Summary:
    """One method over all trials."""

    method: Method
    trials: int
    certified: int
    excess: float  # relative
    excess_worst: float  # The largest
    faster: int
    slower: int
    evaluations: float  # Median
    wall_time: float  # Median and 90 % quantile, s
    wall_time_high: float  # Median and 90 % quantile, s


def compare(
    scenarios: Sequence[Scenario],
    *,
    starts_each: int = 3,
    methods: Sequence[Method | str] = (Method.SCP, Method.LBFGS),
    settings: Settings | None = None,
    seed: int = 0,
    progress: Callable[[Trial], None] | None = None,
) -> list[Trial]:
    """Run all methods from the same starts."""
    chosen = [word_of(Method, method, "methods") for method in methods]
    trials = []
    for scenario in scenarios:
        for trial in _trials(scenario, starts_each, chosen, settings or Settings(), seed):
            trials.append(trial)
            if progress is not None:
                progress(trial)
    return trials


def _trials(
    scenario: Scenario, starts_each: int, methods: Sequence[Method], settings: Settings, seed: int
) -> Iterator[Trial]:
    units = NaturalUnits.of(scenario)
    inside = units.scenario(scenario)
    threat_zones = tuple(ZonesOf(inside))
    problem = replace(build_problem(inside, threat_zones, for_scene(settings, units)), units=units)
    found = islice(starts(problem, settings.searches), starts_each)
    for number, (_, start) in enumerate(found):
        for method in methods:
            task = _Task(problem, threat_zones, number, start, method)
            yield task.improved() if method is Method.SCP else task.descended(seed + number)


class _WatchedLoop(ScpLoop):
    """The loop, with every trip that it steps to written down."""

    iterates: list[Iterate]
    began: float

    def moved(self, trajectory: Trajectory, z: Array) -> Trajectory | None:
        moved = super().moved(trajectory, z)
        self.iterates.append(Iterate(len(self.iterates), perf_counter() - self.began, moved or trajectory))
        return moved


@dataclass(frozen=True)
class _Task:
    """One method from one start."""

    problem: Problem
    threat_zones: tuple[ThreatZone, ...]
    number: int  # Of the start
    start: Trajectory
    method: Method

    def descended(self, seed: int) -> Trial:
        timings: dict[str, float] = {}
        settings = DescentSettings(variant=Variant(self.method))
        descent = Descent(self.problem, self.start, settings, seed=seed, keep_iterates=True)
        checked = checked_descent(self.problem, self.threat_zones, descent, timings)
        run = checked.run
        iterates = [Iterate(0, 0.0, self.start), *descent.run_so_far.iterates]
        spent = {"iterations": run.iterations, "evaluations": run.evaluations, "wall_time": timings["descent"]}
        return self._trial(run.status.value, checked.verdict, run.trajectory, iterates, **spent)

    def improved(self) -> Trial:
        """Run the loop, and repeat it with what its certificate finds missing, as the planner does."""
        settings = self.problem.settings
        iterates, began, checking, iterations = [Iterate(0, 0.0, self.start)], perf_counter(), 0.0, 0
        current, asked = self.start, self.problem
        for _ in range(TIGHTENINGS + 1):
            loop = _WatchedLoop(asked, solver_named(settings.solver), "clarabel")
            loop.iterates, loop.began = iterates, began + checking
            run = loop.run(current, settings.max_iterations)
            iterations += len(run.record)
            clock = perf_counter()
            trip = Trip(self.problem.frame, run.evaluation.trajectory.settled())
            certificate = certify_trip(self.problem.scenario, trip, self.threat_zones)
            checking += perf_counter() - clock
            if certificate.holds or not run.feasible:
                break
            asked, current = tightened(asked, certificate), run.evaluation.trajectory
        wall_time = perf_counter() - began - checking
        spent = {"iterations": iterations, "evaluations": len(iterates), "wall_time": wall_time}
        return self._trial(run.status.value, certificate, run.evaluation.trajectory, iterates, **spent)

    def _trial(
        self, status: str, certificate: Certificate, trajectory: Trajectory, iterates: list[Iterate], **spent: Any
    ) -> Trial:
        units, evaluation = self.problem.units, evaluate_trip(self.problem, trajectory)
        found = certificate.outside(units)
        return Trial(
            self.problem.scenario.name,
            self.number,
            self.method,
            status,
            certificate.holds,
            trajectory.travel_time * units.time,
            found.clearance.minimum,
            evaluation.worst_violation,
            violations="; ".join(str(violation) for violation in found.violations),
            curve=_curve(self.problem, iterates),
            **spent,
        )


def _curve(problem: Problem, iterates: list[Iterate]) -> Curve:
    prices = Penalties.uniform(problem, CURVE_PRICE)
    merits = [evaluate_trip(problem, iterate.trajectory).merit(prices) for iterate in iterates]
    return Curve(
        np.array([iterate.evaluations for iterate in iterates]),
        np.array([iterate.seconds for iterate in iterates]),
        np.minimum.accumulate(np.array(merits)) * problem.units.time,
    )


def best_times(trials: Sequence[Trial]) -> dict[str, float]:
    """Return the least travel time of any certified trial by scenario, s."""
    best: dict[str, float] = {}
    for trial in trials:
        if trial.certified:
            best[trial.scenario] = min(best.get(trial.scenario, np.inf), trial.travel_time)
    return best


def summaries(trials: Sequence[Trial]) -> list[Summary]:
    """Summarise each method over all trials, in the order in which they first appear."""
    best = best_times(trials)
    reference = {(trial.scenario, trial.start): trial for trial in trials if trial.method is Method.SCP}
    return [
        _summary(method, [trial for trial in trials if trial.method is method], best, reference)
        for method in dict.fromkeys(trial.method for trial in trials)
    ]


def _summary(
    method: Method, trials: list[Trial], best: dict[str, float], reference: dict[tuple[str, int], Trial]
) -> Summary:
    excess = [trial.travel_time / best[trial.scenario] - 1.0 for trial in trials if trial.certified]
    outcomes = [
        _outcome(trial, reference[trial.scenario, trial.start])
        for trial in trials
        if (trial.scenario, trial.start) in reference
    ]
    times = [trial.wall_time for trial in trials]
    return Summary(
        method,
        len(trials),
        sum(trial.certified for trial in trials),
        float(np.median(excess)) if excess else np.nan,
        max(excess, default=np.nan),
        sum(outcome < 0 for outcome in outcomes),
        sum(outcome > 0 for outcome in outcomes),
        float(np.median([trial.evaluations for trial in trials])),
        float(np.median(times)),
        float(np.quantile(times, 0.9)),
    )


def _outcome(trial: Trial, other: Trial) -> int:
    """-1 where the trial is better than the other, 1 where it is worse, 0 where neither is clearly."""
    if trial.certified != other.certified:
        return -1 if trial.certified else 1
    if not trial.certified:
        return 0
    ratio = trial.travel_time / other.travel_time - 1.0
    return 0 if abs(ratio) <= 1e-3 else (-1 if ratio < 0.0 else 1)


def summary_table(trials: Sequence[Trial]) -> str:
    """Write the summaries as a table for a terminal, one line a method."""
    heads = ("method", "trials", "certified", "excess", "worst", "faster", "slower", "evaluations", "time", "time 90%")
    rows = [
        (
            summary.method.value,
            str(summary.trials),
            f"{summary.certified} ({summary.certified / summary.trials:.0%})",
            f"{summary.excess:.2%}",
            f"{summary.excess_worst:.2%}",
            str(summary.faster),
            str(summary.slower),
            f"{summary.evaluations:.0f}",
            f"{1e3 * summary.wall_time:.0f} ms",
            f"{1e3 * summary.wall_time_high:.0f} ms",
        )
        for summary in summaries(trials)
    ]
    told = (
        "excess: how much longer certified trips take than the best one of their scenario, median; worst: the largest"
    )
    return f"{text_table([heads, *rows])}\n{told}"


def trial_record(trial: Trial) -> dict[str, str | int | float | bool]:
    """Return a trial as plain values, without its curve."""
    record = asdict(trial)
    del record["curve"]
    return {**record, "method": trial.method.value}


def save_trials(trials: Sequence[Trial], path: str | PathLike[str]) -> None:
    """Write the trials as CSV, one row each, without the curves."""
    write_rows(path, Trial, trials, without=["curve"])
