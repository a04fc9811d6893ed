"""Failure that explains itself: what stands in the way, when, how much is missing, and what would help."""

from __future__ import annotations

from scp_planner.certificate import Certificate, Violation
from scp_planner.scp import Run, Status

_ENDS = {
    Status.CONVERGED: "the loop converged",
    Status.STALLED: "the trust region became tiny before the loop converged",
    Status.INFEASIBLE: "no step comes nearer to keeping every constraint, at the highest penalties",
    Status.ITERATION_LIMIT: "the limit of iterations was reached",
    Status.TIME_LIMIT: "the time limit was reached",
    Status.SOLVER_FAILED: "the solver failed on the last subproblem",
    Status.SLOWER: "the run was given up as slower than another",
}


def explain(run: Run, certificate: Certificate, tried: int) -> str:
    """Say in one line why there is no certified plan.

    Parameters
    ----------
    run : Run
        The best attempt.
    certificate : Certificate
        What it does not keep.
    tried : int
        Number of ways that were tried.

    Returns
    -------
    str
        The violations with obstacle or limit, value and time; the penalty that is left; the least relaxation that would
        make this attempt acceptable.
    """
    violations = "; ".join(str(violation) for violation in certificate.violations)
    evaluation = run.evaluation
    left = evaluation.merit(run.penalties) - evaluation.trajectory.travel_time
    ways = "1 way round" if tried == 1 else f"{tried} ways round"
    helps = "; ".join(_relaxation(violation) for violation in certificate.violations)
    return (
        f"{violations}. Best of {ways}; {_ENDS[run.status]}; penalty left {left:.3g} s."
        f" It would be acceptable with {helps}"
    )


def _relaxation(violation: Violation) -> str:
    if violation.obstacle is not None:
        return f"{-violation.value:.3g} m less of {violation.obstacle}"
    excess = violation.value - violation.allowed
    if violation.what in ("earliest arrival", "latest arrival"):
        return f"the {violation.what} {abs(excess):.3g} s {'sooner' if excess < 0.0 else 'later'}"
    return f"{abs(excess):.3g} more of {violation.what}"
