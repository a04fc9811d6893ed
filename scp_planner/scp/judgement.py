from __future__ import annotations

import math

from scp_planner.scp.candidate import Candidate, Watchdog
from scp_planner.scp.record import FEASIBILITY, LoopStatus
from scp_planner.scp.state import LoopState, Progress


def judged(state: LoopState, step: Candidate, rows: int) -> bool:
    """Accept a step, take it on trial, or reject it; then resize the trust region."""
    run = state.run
    run.status = LoopStatus.ITERATION_LIMIT
    accepted = _acceptable(state, step)
    on_trial = state.trial is None and not accepted and _worth_a_trial(state, step)
    run.record.append(step.recorded(state.number, run.penalties, accepted or on_trial, state.trust, rows))
    if on_trial and state.number < state.limits.max_iterations:
        state.trial = Watchdog(run.evaluation, step, state.trust, state.linearised)
        run.evaluation = step.evaluation
        return False
    if accepted:
        run.evaluation = step.evaluation
        state.trial = None
    else:
        step = state.go_back() or step
    ended = _ended(state, step)
    if ended is not None:
        return state.end(ended)
    if state.limits.enough is not None and state.number >= state.limits.enough and _hardly_violated(state):
        return True
    state.trust = state.parameters.resized(state.trust, step.ratio, step.size)
    if state.trust.theta < state.parameters.smallest_trust:
        return state.end(LoopStatus.STALLED)
    return False


def settled(state: LoopState, sooner: float) -> bool:
    """True if the trip keeps all constraints, and the step from it gains next to nothing of the time, s."""
    return state.run.evaluation.worst_violation <= state.parameters.settled and abs(sooner) < state.limits.tolerance


def _acceptable(state: LoopState, step: Candidate) -> bool:
    least = state.parameters.accept
    if state.trial is None:
        return step.actual > 0.0 and step.ratio > least
    gained = state.trial.gained(step.evaluation, state.run.penalties)
    return gained > max(least * state.trial.step.predicted, 0.0)


def _worth_a_trial(state: LoopState, step: Candidate) -> bool:
    return (
        step.predicted > state.limits.tolerance
        and step.actual > -state.parameters.watch_loss
        and step.evaluation.worst_violation < state.parameters.watch
    )


def _hardly_violated(state: LoopState) -> bool:
    return state.run.evaluation.worst_violation <= state.parameters.grave


def _ended(state: LoopState, step: Candidate) -> LoopStatus | None:
    ended, parameters, number = _outcome(state, step), state.parameters, state.number
    violation = state.run.evaluation.worst_violation
    if ended is None and _lingers(state, violation):
        return LoopStatus.INFEASIBLE
    if violation < max(parameters.progress * state.progress.violation, parameters.grave):
        state.progress = Progress(number, violation)
    elif ended is None and number - state.progress.number >= parameters.patience:
        ended = _escalated(state)
        state.progress = Progress(number, violation)
        state.trust = parameters.retry_trust
    if ended is None and number >= state.limits.hopeless_after and violation > parameters.hopeless:
        return LoopStatus.INFEASIBLE
    return ended


def _lingers(state: LoopState, violation: float) -> bool:
    """True if the run has been near to feasibility for long, without getting there or nearer."""
    near = FEASIBILITY < violation < state.parameters.grave
    if not near or violation < state.parameters.progress * state.nearest.violation:
        state.nearest = Progress(state.number, violation)
    return state.number - state.nearest.number >= state.parameters.lingering


def _outcome(state: LoopState, step: Candidate) -> LoopStatus | None:
    current, parameters, cutoff = state.run.evaluation, state.parameters, state.cutoff
    if cutoff.slower(current, step.sooner):
        return LoopStatus.SLOWER
    if cutoff.same_way(current):
        return LoopStatus.SAME_WAY
    if step.evaluation is current and cutoff.on_time(current, step.sooner):
        return LoopStatus.ON_TIME
    tolerance, violation = state.limits.tolerance, current.worst_violation
    feasible = violation <= FEASIBILITY
    if feasible and step.before <= parameters.mended and abs(step.sooner) < tolerance:
        return LoopStatus.CONVERGED
    if step.evaluation is current and violation <= parameters.settled and _last_step(state, step):
        return LoopStatus.CONVERGED
    if step.predicted < tolerance * max(1.0, 10.0 * violation):
        return LoopStatus.CONVERGED if feasible else _escalated(state)
    return None


def _last_step(state: LoopState, step: Candidate) -> bool:
    """True if a step went so little of the way that was open to it, for the constraints, that none is to follow."""
    parameters, tolerance = state.parameters, state.limits.tolerance
    short = step.size < parameters.inside and step.size * state.trust.theta < parameters.short * math.sqrt(tolerance)
    return short and step.sooner < tolerance


def _escalated(state: LoopState) -> LoopStatus | None:
    """Raise the penalties of what stays violated; INFEASIBLE if they are as high as they get."""
    current, parameters, penalties = state.run.evaluation, state.parameters, state.run.penalties
    stuck = current.violations > FEASIBILITY
    if penalties.weights[stuck].max(initial=0.0) >= parameters.last_penalty or not stuck.any():
        return LoopStatus.INFEASIBLE  # without any: a user's own constraints are, whose price stays
    penalties.raise_where(stuck, parameters.escalation)
    return None
