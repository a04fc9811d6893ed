"""From a scenario to a certified plan: starts, runs of the loop, the best that the certificate holds for."""

from __future__ import annotations

import os
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from scp_planner.certificate import Certificate, certify_trip
from scp_planner.plan import Plan, PlanStatus, Trip
from scp_planner.problem import Limits, Problem, build_problem, straight_travel_time
from scp_planner.scenario import Scenario
from scp_planner.scp import Run, ScpLoop
from scp_planner.seeds import WaySearch, _ways
from scp_planner.settings import Settings
from scp_planner.solvers import solver_named
from scp_planner.zones import ThreatZone, zones

Array = NDArray[np.float64]


def plan(
    scenario: Scenario,
    settings: Settings | None = None,
    solver: str | None = None,
    seed: int = 0,
    time_limit: float | None = None,
) -> Plan:
    """Plan the fastest safe trip of a scenario.

    Parameters
    ----------
    scenario : Scenario
    settings : Settings, optional
    solver : str, optional
        Overrides ``settings.solver``.
    seed : int
        Seed of whatever is random; the same input gives the same plan.
    time_limit : float, optional
        Wall time in s after which the best plan so far is returned.

    Returns
    -------
    Plan
        With status ``certified`` only if the continuous-time certificate holds.
    """
    began = perf_counter()
    settings = settings or Settings()
    if solver is not None:
        settings = replace(settings, solver=solver)
    threat_zones = zones(scenario)
    problem = build_problem(scenario, threat_zones, settings)
    loop = ScpLoop(problem, solver_named(settings.solver))
    built = perf_counter()
    best: tuple[Run, Certificate] | None = None
    timings = {"build": built - began, "search": 0.0, "scp": 0.0, "certificate": 0.0}
    iterations, first = 0, 0.0
    clock = perf_counter()
    search = WaySearch(problem)
    for way in _ways(search, 12):
        start = search.start(way)
        timings["search"] += perf_counter() - clock
        if best is not None and best[1].holds:
            if way.travel_time - first > best[0].evaluation.trajectory.travel_time - lowest + 0.05:
                break
        else:
            first = way.travel_time
        clock = perf_counter()
        run = loop.run(start, settings.max_iterations)
        timings["scp"] += perf_counter() - clock
        if best is None: lowest = run.evaluation.trajectory.travel_time
        iterations += len(run.record)
        if os.environ.get("DBG"): print("   ", round(way.travel_time, 3), run.status.name, len(run.record), round(run.evaluation.trajectory.travel_time, 4), run.feasible, way.sides[:5])
        if best is None or _better(run, best[0], best[1]):
            clock = perf_counter()
            certificate = certify_trip(scenario, Trip(problem.frame, run.evaluation.trajectory), threat_zones)
            timings["certificate"] += perf_counter() - clock
            if best is None or certificate.holds or not best[1].holds:
                best = (run, certificate)
        if time_limit is not None and perf_counter() - began > time_limit:
            break
        clock = perf_counter()
    assert best is not None
    run, certificate = best
    status, reason = _verdict(run, certificate)
    return Plan(
        scenario=scenario.name,
        status=status,
        reason=reason,
        trip=Trip(problem.frame, run.evaluation.trajectory),
        method="scp",
        solver=settings.solver,
        iterations=iterations,
        wall_time=perf_counter() - began,
        clearance=certificate.clearance,
        limits=certificate.limits,
        lower_bound=lower_bound(problem),
        timings=timings,
    )


def lower_bound(problem: Problem) -> float:
    """No trip is shorter than a straight one without obstacles, s."""
    scenario = problem.scenario
    time, _ = straight_travel_time(
        float(np.hypot(*np.subtract(scenario.goal.position, scenario.start.position))) - scenario.goal.radius,
        scenario.start.speed,
        Limits.of(scenario),
        scenario.goal.speed,
    )
    return time


def _better(run: Run, best: Run, certificate: Certificate) -> bool:
    if not certificate.holds:
        return run.feasible or run.evaluation.worst_violation < best.evaluation.worst_violation
    return run.feasible and run.evaluation.trajectory.travel_time < best.evaluation.trajectory.travel_time


def _verdict(run: Run, certificate: Certificate) -> tuple[PlanStatus, str | None]:
    if certificate.holds:
        return PlanStatus.CERTIFIED, None
    reason = "; ".join(str(violation) for violation in certificate.violations)
    return (PlanStatus.FEASIBLE if run.feasible else PlanStatus.INFEASIBLE), f"{run.status.value}: {reason}"
