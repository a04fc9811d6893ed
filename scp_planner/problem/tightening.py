"""Exchange method: constraints that a certificate found violated between samples are tightened."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scp_planner.certificate.verdict import Certificate, Violation
from scp_planner.constraints.constraint import Constraint
from scp_planner.problem.problem import Problem

TIGHTENINGS = 3  # how often a run is repeated with what its certificate found missing
UNDECIDED = 5e-4  # relative, of what was found to be just below its limit, and may be above it beside that
MOST_LESS = 0.5  # of a limit, that is taken off at once: a trip that is so far above it may not tell by how much
AROUND = np.linspace(-0.5, 0.5, 5)  # steps between samples, from where a limit is found to be exceeded
URGENCY = 2.0  # times as much is asked for with each repeat


def tightened(
    problem: Problem, certificate: Certificate, urgency: float = 1.0, travel_time: float | None = None
) -> Problem:
    """Return a problem that asks for somewhat more of all that the certificate of a trip found violated."""
    inflation, more = np.zeros(problem.zones.size), dict[str, float]()
    for violation in certificate.violations:
        if violation.obstacle is not None:
            parts = [name == violation.obstacle for name in problem.zones.ids]
            inflation[parts] = urgency * (-1.5 * violation.value + 1e-3)
        elif violation.what == "workspace bounds":
            more[violation.what] = urgency * (-1.5 * violation.value + 1e-3)
        else:
            more[violation.what.partition("[")[0]] = _more(violation, urgency)
    asked = problem.tightened(inflation, more)
    if travel_time is None:
        return asked
    also = tuple(_also_there(asked, one, certificate, travel_time) for one in asked.constraints)
    return replace(asked, constraints=also)


def _more(violation: Violation, urgency: float) -> float:
    if violation.what == "speed" and not violation.allowed > 0.0:
        return 0.0  # driving backwards is nothing that a lower limit would mend
    excess = violation.value / violation.allowed - 1.0 if violation.allowed else violation.value
    # What is below its limit could not be decided: no finding says by how much it may be above it.
    more = urgency * (1.5 * (excess if excess > 0.0 else UNDECIDED) + 1e-4)
    return min(more, MOST_LESS) if violation.allowed else more


def _also_there(problem: Problem, limit: Constraint, certificate: Certificate, travel_time: float) -> Constraint:
    """A limit, looked at around the times where a trip exceeds it as well: what rises between samples is seen there."""
    begun = problem.scenario.start.time
    times = np.array([one.time - begun for one in certificate.violations if one.what == limit.name])
    if len(times) == 0:
        return limit
    around = times[:, None] / travel_time + AROUND / problem.grid
    return limit.also_at(np.clip(around.ravel(), 0.0, 1.0))
