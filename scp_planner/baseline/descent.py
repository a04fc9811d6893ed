"""Descent on the penalised objective from one start, and its certificate: what hardly fails is repeated tighter."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TypeAlias

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.baseline.coordinates import Coordinates
from scp_planner.baseline.descent_run import EVALUATIONS, DescentRun, DescentSettings, DescentStatus, Iterate
from scp_planner.baseline.minimisers import MINIMISERS
from scp_planner.baseline.objective import ObjectiveValue, PenalisedObjective
from scp_planner.baseline.priced import places_of, signed_excess, times_near, uniform, with_margins
from scp_planner.baseline.tolerances import REPAIRABLE, SETTLED_EXCESS, TARGET
from scp_planner.certificate.check import certify_trip
from scp_planner.certificate.verdict import Certificate
from scp_planner.pauses import OutOfTimeError, look_at_the_clock
from scp_planner.planning.checked import CheckedRun
from scp_planner.problem.problem import Problem
from scp_planner.problem.tightening import TIGHTENINGS
from scp_planner.scp.evaluation import Evaluation, evaluate_trip
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class DescentParameters:
    escalation: float = 5.0  # Factor of prices
    stuck: float = 3.0  # Widths of the hinge; what is violated by more gets dearer
    unsettlable: float = 30.0  # Widths of the hinge; violations above this at the last price are not settled
    near_widths: float = 5.0  # Widths of the hinge; below this clearance samples are refined
    near_least: float = 0.3  # Units of length; least clearance below which samples are refined
    active: float = 1e-4  # Units of time to one; constraints with a larger multiplier are settled
    outside: float = 1e6  # Units of time; value of trips that never arrive
    careful: float = 10.0  # Times the first prices, in the second attempt
    careful_width: float = 0.05  # Units of length; widest hinge of the second attempt
    estimate_slack: float = 0.15  # Units of time; how much better than its estimate another start may turn out


DESCENT = DescentParameters()


class Descent:
    """Penalty descent on one problem from one start: stages, then settling, then tightening if asked to."""

    def __init__(
        self,
        problem: Problem,
        start: Trajectory,
        settings: DescentSettings,
        *,
        seed: int = 0,
        deadline: float = np.inf,
        keep_iterates: bool = False,
    ) -> None:
        self.given = problem
        self.deadline = deadline
        self.keep_iterates = keep_iterates
        self.random = np.random.default_rng(seed)
        self.began = perf_counter()
        self.coordinates = Coordinates(problem, start)
        self.lower, self.upper = self.coordinates.lower, self.coordinates.upper
        self._begin(settings)
        self.run_so_far = DescentRun(DescentStatus.UNSETTLED, self._exact())

    def _begin(self, settings: DescentSettings) -> None:
        """Go back to the start."""
        self.problem = self.given
        self.settings = settings
        self.prices = uniform(self.problem, settings.zone_price, settings.limit_price)
        self.prices[places_of(self.problem, "acceleration")] = 0.0  # kept as bounds
        self.margins = np.zeros(len(self.prices))
        self.objective = PenalisedObjective(self.problem, self.prices, np.zeros(len(self.prices)))
        self.y = self.coordinates.origin
        self.best = np.inf

    def run_carefully(self) -> DescentRun:
        """Once more from the start, with narrow hinges and high prices at once: the trip stays in the start's way."""
        settings = self.settings
        self._begin(
            replace(
                settings,
                widths=(DESCENT.careful_width, *(width for width in settings.widths if width < DESCENT.careful_width)),
                zone_price=DESCENT.careful * settings.zone_price,
                limit_price=DESCENT.careful * settings.limit_price,
            )
        )
        return self.run()

    def run(self) -> DescentRun:
        """Go through all stages, and settle."""
        run = self.run_so_far
        try:
            for width in self.settings.widths:
                self._stage(width)
                self._raise_prices(width)
            self.settle()
        except OutOfTimeError:
            run.status = DescentStatus.TIME_LIMIT
            run.evaluation = self._exact()
        logger.debug("descent: %s after %d evaluations", run.status.value, run.evaluations)
        return run

    def tighten(self, certificate: Certificate) -> DescentRun | None:
        """Ask for a little more of what the certificate finds missing, and settle again; None if it misses too much."""
        margins = self.margins.copy()
        for violation in certificate.violations:
            index: Index
            if violation.obstacle is not None:
                index = np.flatnonzero([name == violation.obstacle for name in self.problem.zones.ids])
                missing = -violation.value
            elif violation.what == "workspace bounds":
                index, missing = places_of(self.problem, violation.what), -violation.value
            elif violation.allowed > 0.0:
                index = places_of(self.problem, violation.what.partition("[")[0])
                missing = violation.value / violation.allowed - 1.0
            else:
                return None
            # An obstacle that was taken for too far away to matter has no zone here.
            if len(index) == 0 or missing > REPAIRABLE:
                return None
            margins[index] += 1.5 * missing + SETTLED_EXCESS
        self.problem = with_margins(self.problem, margins - self.margins)
        try:
            self.settle()
        except OutOfTimeError:
            self.run_so_far.status = DescentStatus.TIME_LIMIT
            self.run_so_far.evaluation = self._exact()
        return self.run_so_far

    def settle(self) -> None:
        """Move the active constraints until the trip ends on the true ones."""
        width, run = self.settings.widths[-1], self.run_so_far
        run.status = DescentStatus.UNSETTLED
        for _ in range(self.settings.settlings):
            value = self._stage(width)
            excess = signed_excess(self.problem, run.evaluation)
            active = (self.prices * value.use > DESCENT.active) | (excess > -TARGET)
            if np.abs(excess[active] + TARGET).max(initial=0.0) < SETTLED_EXCESS:
                run.status = DescentStatus.CONVERGED
                break
            if self._raise_prices(width):
                continue
            reach = DESCENT.stuck * self._widths(width)
            self.margins = self.margins + np.where(active, np.clip(excess + TARGET, -reach, reach), 0.0)
        if run.evaluation.worst_violation > DESCENT.unsettlable * width:
            run.status = DescentStatus.INFEASIBLE
        self.y = self.coordinates.with_goal_speed(self.y)
        run.evaluation = self._exact()

    def _raise_prices(self, width: float) -> bool:
        """Make dearer what is violated by more than the hinge explains; whether anything was."""
        excess, last = signed_excess(self.problem, self.run_so_far.evaluation), self.settings.last_price
        dear = (excess > DESCENT.stuck * self._widths(width)) & (self.prices < last)
        self.prices = np.where(dear, np.minimum(self.prices * DESCENT.escalation, last), self.prices)
        return bool(dear.any())

    def _widths(self, width: float) -> Array:
        """Widths of the hinge of all violations, given that of zones."""
        return uniform(self.problem, width, self.settings.limit_width * width)

    def _stage(self, width: float) -> ObjectiveValue:
        """Minimise with one width of the hinge, from where the last stage ended."""
        near = max(DESCENT.near_least, DESCENT.near_widths * width)
        sigma = times_near(self.problem, self.coordinates.trajectory(self.y), near)
        self.objective = PenalisedObjective(self.problem, self.prices, self._widths(width), sigma, self.margins)
        self.best = np.inf
        budget = self.settings.evaluations or EVALUATIONS[self.settings.variant]
        start = self.y
        MINIMISERS[self.settings.variant](self, start, self.run_so_far.evaluations + budget)
        self.run_so_far.evaluation = self._exact()
        value = self.objective.evaluate(self.coordinates.omega(self.y), gradient=False)
        logger.debug(
            "stage: width %g, %d evaluations, Q = %.5f s, travel time %.5f s, worst violation %.2e",
            width,
            self.run_so_far.evaluations,
            value.value,
            value.travel_time,
            self.run_so_far.evaluation.worst_violation,
        )
        return value

    @property
    def evaluations(self) -> int:
        """Number of evaluations of the objective."""
        return self.run_so_far.evaluations

    def evaluate(self, y: Array, *, gradient: bool = True) -> tuple[float, Array]:
        """Value and gradient in the scaled coordinates; the best y is kept."""
        look_at_the_clock(self.deadline)
        self.run_so_far.evaluations += 1
        found = self.objective.evaluate(self.coordinates.omega(y), gradient=gradient)
        if not np.isfinite(found.value):
            back = np.zeros_like(y)
            back[self.coordinates.path_size :] = -DESCENT.outside * self.problem.space.drive.final_distance
            return DESCENT.outside, back
        if found.value < self.best:
            self.best, self.y = found.value, y.copy()
        return found.value, self.coordinates.slope(found.gradient) if gradient else found.gradient

    def note(self, y: Array) -> None:
        """Count an accepted step."""
        run = self.run_so_far
        run.iterations += 1
        if self.keep_iterates:
            run.iterates.append(Iterate(run.evaluations, perf_counter() - self.began, self.coordinates.trajectory(y)))

    def _exact(self) -> Evaluation:
        return evaluate_trip(self.problem, self.coordinates.trajectory(self.y))


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
