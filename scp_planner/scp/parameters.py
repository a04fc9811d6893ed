"""Parameters of the loop's steps; lengths and times are in the scene's units."""

from __future__ import annotations

from dataclasses import dataclass, field

from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.record import FEASIBILITY


@dataclass(frozen=True)
class LoopParameters:
    first_trust: TrustRegion = field(default=TrustRegion(theta=1.0, beta=3.0, rho=0.3))
    steered: float = 0.3
    largest_trust: TrustRegion = field(default=TrustRegion(theta=3.0, beta=5.0, rho=0.5))
    smallest_trust: float = 1e-5  # Units of length: a run whose steps must be smaller than this has stalled
    retry_trust: TrustRegion = field(default=TrustRegion(theta=0.3, beta=1.0, rho=0.1))
    shrink_below: float = 0.25  # Ratios of actual to predicted decrease of the merit
    grow_above: float = 0.7  # Ratios of actual to predicted decrease of the merit
    shrink: float = 0.3  # Its factors
    grow: float = 1.7  # Its factors
    smallest_shrink: float = 0.1  # Least size of a step, relative to the trust region, that shrinking starts from
    inside: float = 0.99  # Relative to the trust region: steps shorter than this are learnt from
    accept: float = 0.05  # Least ratio of actual to predicted decrease of an accepted step
    watch: float = 0.5  # Largest violation of a trip that is taken on trial
    watch_loss: float = 1.0  # Units of time of merit that a trial may cost
    first_penalty: float = 5.0  # Units of time to one of length, or to one of relative excess
    last_penalty: float = 1000.0  # Units of time to one of length, or to one of relative excess
    escalation: float = 600.0  # By which penalties are raised
    patience: int = 3  # Iterations without coming nearer to feasibility, after which penalties are raised
    progress: float = 0.8
    grave: float = 5e-3  # Violations below this are no reason to lose patience
    lingering: int = 20  # Iterations within that, not feasible and without coming nearer, after which a run ends
    hopeless: float = 0.15  # Largest violation, after some iterations, of runs that are given up where there are others
    mended: float = 2e-3  # A step from a larger violation than this may lead to a place from where others lead on
    short: float = 2.3
    settled: float = 0.4 * FEASIBILITY
    hope: float = 4.0  # Times the next step's gain that a run may still become faster
    same_way: float = 0.2  # Units of length; trips that are never farther apart than this end as one
    spared: float = 0.0  # Iterations, in the time of the last one, that are left of the time when a run ends
    shortest_solve: float = 1e-3  # s, that a solver is given at least: some take 0 for no limit
    last_mend: float = 0.01  # s, that the trip of a run that is out of time may take to meet the speed of the goal
    projections: int = 3  # Onto what every step must keep; the length of the path is linearised in each
    projection_trust: TrustRegion = field(default=TrustRegion(theta=1e3, beta=1e2, rho=0.9))
    acceleration_nearness: float = 0.1
    time_nearness: float = 10.0

    def resized(self, trust: TrustRegion, ratio: float, size: float) -> TrustRegion:
        """Return the trust region after a step."""
        if ratio < self.shrink_below:
            # From where the step ended, not from a border that it never touched
            return trust.scaled(self.shrink * max(size, self.smallest_shrink))
        if ratio > self.grow_above:
            grown, most = trust.scaled(self.grow), self.largest_trust
            return TrustRegion(min(grown.theta, most.theta), min(grown.beta, most.beta), min(grown.rho, most.rho))
        return trust


LOOP = LoopParameters()
