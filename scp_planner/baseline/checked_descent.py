"""Descents with their certificates: what hardly fails is repeated with tighter margins, what fails carefully."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import TypeAlias

from scp_planner.baseline.descent import Descent
from scp_planner.baseline.descent_run import DescentRun, DescentStatus
from scp_planner.certificate.check import certify_trip
from scp_planner.planning.attempts import CheckedRun
from scp_planner.problem.problem import Problem
from scp_planner.problem.tightening import TIGHTENINGS
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trip import Trip

CheckedDescent: TypeAlias = CheckedRun[DescentRun]


def checked_descent(
    problem: Problem, threat_zones: tuple[ThreatZone, ...], descent: Descent, timings: dict[str, float] | None = None
) -> CheckedDescent:
    """Descend, and check the result; repeat with tighter margins what hardly fails, and carefully what fails."""
    best: CheckedDescent | None = None
    checking = 0.0
    for attempt in (descent.run, descent.run_carefully):
        run: DescentRun | None = attempt()
        for _ in range(TIGHTENINGS + 1):
            assert run is not None
            clock = perf_counter()
            certificate = certify_trip(problem.scenario, Trip(problem.frame, run.trajectory.settled()), threat_zones)
            checking += perf_counter() - clock
            descent.began += perf_counter() - clock
            checked = CheckedRun(replace(run), certificate)
            best = checked if checked.better_than(best) else best
            if certificate.holds or not run.repairable:
                break
            run = descent.tighten(certificate)
            if run is None:
                break
        if certificate.holds or descent.run_so_far.status is DescentStatus.TIME_LIMIT:
            break
    assert best is not None
    best.run.evaluations = descent.run_so_far.evaluations
    best.run.iterations = descent.run_so_far.iterations
    if timings is not None:
        timings["descent"] = timings.get("descent", 0.0) + perf_counter() - descent.began
        timings["certificate"] = timings.get("certificate", 0.0) + checking
    return best
