"""Parameters of the loop's steps; lengths and times are in the scene's units."""

from __future__ import annotations

from dataclasses import dataclass, field

from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.record import FEASIBILITY


@dataclass(frozen=True)
class LoopParameters:
    first_trust: TrustRegion = field(default=TrustRegion(theta=1.0, beta=3.0, rho=0.3))  # of a run (+4, +1)
    # Of that, where the rate of the curvature is limited: it goes by third derivatives of the path, of which large
    # steps make so much that they are rejected one after the other
    steered: float = 0.3
    largest_trust: TrustRegion = field(default=TrustRegion(theta=3.0, beta=5.0, rho=0.5))
    smallest_trust: float = 1e-5  # units of length: a run whose steps must be smaller than this has stalled
    retry_trust: TrustRegion = field(default=TrustRegion(theta=0.3, beta=1.0, rho=0.1))  # after penalties were raised
    shrink_below: float = 0.25  # ratio of actual to predicted decrease of the merit: the trust region shrinks (+3, 0)
    grow_above: float = 0.7  # the same ratio: it grows (+1, +7)
    shrink: float = 0.3  # factor (-2, +6)
    grow: float = 1.7  # factor (-1, +1)
    smallest_shrink: float = 0.1  # least step, relative to the trust region, that shrinking starts from (+1, +2)
    inside: float = 0.99  # relative to the trust region: steps shorter than this are learnt from (+2, +3)
    accept: float = 0.05  # least ratio of actual to predicted decrease of an accepted step
    watch: float = 0.5  # largest violation of a trip that is taken on trial
    watch_loss: float = 1.0  # units of time of merit that a trial may cost (+3, 0)
    first_penalty: float = 5.0  # units of time to one of length, or to one of relative excess (+9, +3)
    last_penalty: float = 1000.0
    escalation: float = 600.0  # by which penalties are raised: what stays violated at a moderate price mostly does so
    patience: int = 3  # iterations without coming nearer to feasibility, until penalties are raised (-4, +14)
    progress: float = 0.8  # of the violation: what counts as nearer (-1, +37)
    grave: float = 5e-3  # violations below this are no reason to lose patience (0, +2)
    # Iterations within that, not feasible and without coming nearer, after which a run ends: it circles a place that is
    # a little too narrow
    lingering: int = 20
    hopeless: float = 0.15  # largest violation, after some iterations, of runs that are given up where there are others
    mended: float = 2e-3  # a step from a larger violation than this may lead to a place from where others lead on
    # Of the root of the tolerance, in units of length: what a shorter step is off the minimum by, about its square, is
    # of no account
    short: float = 2.3
    settled: float = 0.4 * FEASIBILITY  # largest violation of a trip that is taken if nothing is to gain (+3, -3)
    hope: float = 4.0  # times the next step's gain that a run may still become faster (-1, +2)
    same_way: float = 0.2  # units of length; trips that are never farther apart than this end as one
    # Iterations, in the time of the last one, that are left of the time when a run ends: the next one, which has not
    # begun, and what comes after the run
    spared: float = 0.0
    shortest_solve: float = 1e-3  # s, that a solver is given at least: some take 0 for no limit
    last_mend: float = 0.01  # s, that the trip of a run that is out of time may take to meet the speed of the goal
    projections: int = 3  # onto what every step must keep; the length of the path is linearised in each
    projection_trust: TrustRegion = field(default=TrustRegion(theta=1e3, beta=1e2, rho=0.9))  # of these: anywhere
    acceleration_nearness: float = 0.1  # price in these of accelerations, squared, against offsets
    time_nearness: float = 10.0  # price in these of relative steps of the time, squared, against offsets

    def resized(self, trust: TrustRegion, ratio: float, size: float) -> TrustRegion:
        """Return the trust region after a step, by the ratio of decreases and its size relative to the region."""
        if ratio < self.shrink_below:
            # From where the step ended, not from a border that it never touched
            return trust.scaled(self.shrink * max(size, self.smallest_shrink))
        if ratio > self.grow_above:
            grown, most = trust.scaled(self.grow), self.largest_trust
            return TrustRegion(min(grown.theta, most.theta), min(grown.beta, most.beta), min(grown.rho, most.rho))
        return trust


LOOP = LoopParameters()
