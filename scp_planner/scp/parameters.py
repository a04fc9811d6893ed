"""What the loop's steps are steered by. None of it depends on a scene: lengths and times are in the scene's units."""

from __future__ import annotations

from dataclasses import dataclass, field

from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.record import FEASIBILITY


@dataclass(frozen=True)
class LoopParameters:
    """Parameters of the loop.

    Attributes
    ----------
    first_trust : TrustRegion
        Where a run begins with.
    steered : float
        Of that, where the rate of the curvature is limited: it goes by third derivatives of the path, of which large
        steps make so much that they are rejected one after the other.
    largest_trust : TrustRegion
    smallest_trust : float
        Units of length: a run whose steps must be smaller than this has stalled.
    retry_trust : TrustRegion
        Where it goes on with after the penalties were raised.
    shrink_below, grow_above : float
        Ratios of actual to predicted decrease of the merit: below and above these the trust region is resized.
    shrink, grow : float
        Its factors.
    smallest_shrink : float
        Least size of a step, relative to the trust region, that shrinking starts from.
    inside : float
        Relative to the trust region: steps shorter than this are learnt from.
    accept : float
        Least ratio of actual to predicted decrease of an accepted step.
    watch : float
        Largest violation of a trip that is taken on trial.
    watch_loss : float
        Units of time of merit that a trial may cost.
    first_penalty, last_penalty : float
        Units of time to one of length, or to one of relative excess.
    escalation : float
        By which penalties are raised: what stays violated at a moderate price mostly does at any.
    patience : int
        Iterations without coming nearer to feasibility, after which penalties are raised.
    progress : float
        Of the violation: what counts as nearer.
    grave : float
        Violations below this are no reason to lose patience.
    lingering : int
        Iterations within that, not feasible and without coming nearer, after which a run ends: it circles a place that
        is a little too narrow.
    hopeless : float
        Largest violation, after some iterations, of runs that are given up where there are others.
    mended : float
        A step from a larger violation than this may lead to a place from where others lead on.
    short : float
        Of the root of the tolerance, in units of length: what a shorter step is off the minimum by, about its square,
        is of no account.
    settled : float
        Largest violation of a trip that is taken as it is when nothing is left to gain.
    hope : float
        Times the next step's gain that a run may still become faster.
    same_way : float
        Units of length; trips that are never farther apart than this end as one.
    spared : float
        Iterations, in the time of the last one, that are left of the time when a run ends: the next one, which has not
        begun, and what comes after the run.
    shortest_solve : float
        s, that a solver is given at least: some take 0 for no limit.
    last_mend : float
        s, that the trip of a run that is out of time may take to meet the speed of the goal.
    projections : int
        Onto what every step must keep; the length of the path is linearised in each.
    projection_trust : TrustRegion
        Of these: anywhere.
    acceleration_nearness, time_nearness : float
        Prices, in these, of accelerations and of relative steps of the time, squared, against offsets.
    """

    first_trust: TrustRegion = field(default=TrustRegion(theta=1.0, beta=3.0, rho=0.3))
    steered: float = 0.3
    largest_trust: TrustRegion = field(default=TrustRegion(theta=3.0, beta=5.0, rho=0.5))
    smallest_trust: float = 1e-5
    retry_trust: TrustRegion = field(default=TrustRegion(theta=0.3, beta=1.0, rho=0.1))
    shrink_below: float = 0.25
    grow_above: float = 0.7
    shrink: float = 0.3
    grow: float = 1.7
    smallest_shrink: float = 0.1
    inside: float = 0.99
    accept: float = 0.05
    watch: float = 0.5
    watch_loss: float = 1.0
    first_penalty: float = 5.0
    last_penalty: float = 1000.0
    escalation: float = 600.0
    patience: int = 3
    progress: float = 0.8
    grave: float = 5e-3
    lingering: int = 20
    hopeless: float = 0.15
    mended: float = 2e-3
    short: float = 2.3
    settled: float = 0.4 * FEASIBILITY
    hope: float = 4.0
    same_way: float = 0.2
    spared: float = 0.0
    shortest_solve: float = 1e-3
    last_mend: float = 0.01
    projections: int = 3
    projection_trust: TrustRegion = field(default=TrustRegion(theta=1e3, beta=1e2, rho=0.9))
    acceleration_nearness: float = 0.1
    time_nearness: float = 10.0

    def resized(self, trust: TrustRegion, ratio: float, size: float) -> TrustRegion:
        """Return the trust region after a step.

        Parameters
        ----------
        trust : TrustRegion
        ratio : float
            Of actual to predicted decrease.
        size : float
            Of the step's largest component, relative to the trust region.

        Returns
        -------
        TrustRegion
        """
        if ratio < self.shrink_below:
            # From where the step ended, not from a border that it never touched
            return trust.scaled(self.shrink * max(size, self.smallest_shrink))
        if ratio > self.grow_above:
            grown, most = trust.scaled(self.grow), self.largest_trust
            return TrustRegion(min(grown.theta, most.theta), min(grown.beta, most.beta), min(grown.rho, most.rho))
        return trust


LOOP = LoopParameters()
