"""What a certificate found missing between the samples is asked for a little more of: the exchange method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scp_planner.certificate.verdict import Certificate
from scp_planner.problem.limits.limit import OptionalLimit
from scp_planner.problem.problem import Problem

TIGHTENINGS = 3  # how often a run is repeated with what its certificate found missing
UNDECIDED = 5e-4  # relative, of what was found to be just below its limit, and may be above it beside that
MOST_LESS = 0.5  # of a limit, that is taken off at once: a trip that is so far above it may not tell by how much
AROUND = np.linspace(-0.5, 0.5, 5)  # steps between samples, from where a limit is found to be exceeded
URGENCY = 2.0  # times as much is asked for with each repeat


def tightened(
    problem: Problem, certificate: Certificate, urgency: float = 1.0, travel_time: float | None = None
) -> Problem:
    """Return a problem that asks for somewhat more of all that the certificate of a trip found violated.

    Parameters
    ----------
    problem : Problem
    certificate : Certificate
        Of a trip that keeps all sampled constraints of the problem.
    urgency : float
        How many times as much as usual is asked for: the next trip may be another one, with other peaks.
    travel_time : float, optional
        Of that trip, s: optional limits of a drive are then looked at where it exceeds them as well.

    Returns
    -------
    Problem
    """
    inflation = np.zeros(problem.zones.size)
    missing = {"lateral_acceleration": 0.0, "curvature": 0.0, "speed": 0.0, "workspace bounds": 0.0}
    optional = {limit.name: 0.0 for limit in problem.optional}
    for violation in certificate.violations:
        if violation.obstacle is not None:
            parts = [name == violation.obstacle for name in problem.zones.ids]
            inflation[parts] = urgency * (-1.5 * violation.value + 1e-3)
        elif violation.what == "workspace bounds":
            missing[violation.what] = urgency * (-1.5 * violation.value + 1e-3)
            optional[violation.what] = missing[violation.what]  # of further discs
        elif violation.what in missing and violation.allowed > 0.0:  # not driving backwards
            less = urgency * (1.5 * (violation.value / violation.allowed - 1.0) + 1e-4)
            missing[violation.what] = min(less, MOST_LESS)
        elif (kind := violation.what.partition("[")[0]) in optional:
            # Of limits in relation to them; ranges of the goal by what is missing itself.
            excess = violation.value / violation.allowed - 1.0 if violation.allowed else violation.value
            # What is below its limit could not be decided: no finding says by how much it may be above it.
            more = urgency * (1.5 * (excess if excess > 0.0 else UNDECIDED) + 1e-4)
            optional[kind] = min(more, MOST_LESS) if violation.allowed else more
    asked = problem.tightened(
        inflation, missing["lateral_acceleration"], missing["curvature"], missing["workspace bounds"], optional
    )
    asked = replace(asked, limits=replace(asked.limits, speed=asked.limits.speed * (1.0 - missing["speed"])))
    if travel_time is None:
        return asked
    return replace(
        asked, optional=tuple(_also_there(asked, limit, certificate, travel_time) for limit in asked.optional)
    )


def _also_there(problem: Problem, limit: OptionalLimit, certificate: Certificate, travel_time: float) -> OptionalLimit:
    """A limit, looked at around the times where a trip exceeds it as well: what rises between samples is seen there."""
    begun = problem.scenario.start.time
    times = np.array([one.time - begun for one in certificate.violations if one.what == limit.name])
    if len(times) == 0:
        return limit
    around = times[:, None] / travel_time + AROUND / problem.grid
    return limit.also_at(np.clip(around.ravel(), 0.0, 1.0))
