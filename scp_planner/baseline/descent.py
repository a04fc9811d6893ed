"""Descent on the penalised objective with penalty continuation, from one start.

Zambom and Seguin (2021) make planning an unconstrained problem, travel time plus a smooth penalty, and descend. Here
this is done as well as we know how, on the objective of all methods (objective.py), from the starts of all methods:

- Coordinates. The offset's control points are mapped so that the curvature of the arc length becomes the identity;
  those of the acceleration stay within their limits as simple bounds.
- Continuation. The hinge starts wide and is narrowed stage by stage; what stays violated gets dearer.
- Settling. With a hinge of width w the minimiser lies off an active constraint by a small multiple of w, to either
  side. In the last stages each active constraint is moved by just this distance, so that the trip ends on the true one,
  and moved further where the certificate still finds something missing.
- A second attempt. Wide hinges and low prices may lead through an obstacle to where no trip is feasible. Then the
  descent begins again with narrow hinges and high prices.

Three minimisers: L-BFGS-B with the exact gradient, plain gradient descent with a line search, and a Monte Carlo search
that needs no gradient. Nothing is linearised and no subproblem is solved.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.baseline.objective import (
    ACCELERATION,
    BOX,
    CURVATURE,
    GOAL_SPEED,
    LATERAL,
    OBJECTIVE_LIMITS,
    OFFSET,
    OPTIONAL,
    REVERSE,
    SPEED,
    Hinge,
    Margins,
    ObjectiveValue,
    PenalisedObjective,
    SampleTimes,
    Weights,
)
from scp_planner.certificate.check import certify_trip
from scp_planner.certificate.verdict import Certificate
from scp_planner.problem.problem import Problem
from scp_planner.problem.tightening import TIGHTENINGS
from scp_planner.scp.evaluation import Evaluation, evaluate_trip
from scp_planner.scp.record import FEASIBILITY, NEAR
from scp_planner.settings.knobs import word_of
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

logger = logging.getLogger(__name__)

RIGIDITY = 1e-3  # in natural units: keeps the scaling of the offsets regular beside the curvature of the arc length
ESCALATION = 5.0
STUCK = 3.0  # widths of the hinge; what is violated by more gets dearer
HOPELESS = 30.0  # widths of the hinge; violations above this at the last price are not settled
NEAR_WIDTHS = 5.0  # widths of the hinge; below this clearance, but at least NEAR_LEAST, samples are refined
NEAR_LEAST = 0.3  # units of length
ACTIVE = 1e-4  # units of time to one; constraints with a larger multiplier are settled
SETTLED = 1e-4  # units of length or relative; distance to active constraints at which settling ends
TARGET = 1e-5  # units of length or relative; what is left to an active constraint by settling
OUTSIDE = 1e6  # units of time; value of trips that never arrive
CAREFUL = 10.0  # times the first prices, in the second attempt
CAREFUL_WIDTH = 0.05  # units of length; widest hinge of the second attempt
REPAIRABLE = 0.01  # units of length or relative; larger violations are not tightened away
ARMIJO = 1e-4
CERTIFIED_LIMITS = {"lateral_acceleration": LATERAL, "curvature": CURVATURE, "speed": SPEED}


class Variant(StrEnum):
    """How the objective is minimised."""

    LBFGS = "l-bfgs"
    GRADIENT = "gradient-descent"
    MONTE_CARLO = "monte-carlo"


EVALUATIONS = {Variant.LBFGS: 150, Variant.GRADIENT: 400, Variant.MONTE_CARLO: 800}
"""Of the objective in one stage, at most, if the settings do not say."""


class DescentStatus(StrEnum):
    """How a descent ended."""

    CONVERGED = "converged"
    UNSETTLED = "still moving at the last stage"
    INFEASIBLE = "violations stay at the highest price"
    TIME_LIMIT = "time limit"


@dataclass(frozen=True)
class DescentSettings:
    """Settings of penalty descent.

    Attributes
    ----------
    variant : Variant
        Or its word; `SettingsError` if there is none.
    widths : tuple of float
        Of the hinge for zones, units of length of the scene, one a stage.
    limit_width : float
        Width of the hinge for limits, relative, for each unit of the width for zones.
    zone_price, limit_price : float
        First prices, units of time for one of length and for one of excess.
    last_price : float
        Prices grow up to this.
    evaluations : int or None
        Of the objective in one stage, at most; None: as suits the variant.
    settlings : int
        Further stages at the last width, at most.
    memory : int
        Pairs of steps and gradients that L-BFGS keeps.
    tolerance : float
        A stage ends when a step gains less than this fraction of the objective.
    """

    variant: Variant = Variant.LBFGS
    widths: tuple[float, ...] = (0.3, 0.1, 0.03, 0.01, 0.003)
    limit_width: float = 0.3
    zone_price: float = 5.0
    limit_price: float = 20.0
    last_price: float = 1e3
    evaluations: int | None = None
    settlings: int = 8
    memory: int = 25
    tolerance: float = 1e-9

    def __post_init__(self) -> None:
        object.__setattr__(self, "variant", word_of(Variant, self.variant, "variant"))


@dataclass(frozen=True)
class Moment:
    """An iterate of a descent.

    Attributes
    ----------
    evaluations : int
        Of the objective until then.
    seconds : float
        Since the descent began.
    trajectory : Trajectory
    """

    evaluations: int
    seconds: float
    trajectory: Trajectory


@dataclass
class DescentRun:
    """A descent and where it ended.

    Attributes
    ----------
    status : DescentStatus
    evaluation : Evaluation
        The last trip, with the exact hinge.
    evaluations : int
        Of the objective, with gradient or (Monte Carlo) without.
    iterations : int
        Accepted steps of the minimisers.
    moments : list of Moment
        The iterates, if they were asked for.
    """

    status: DescentStatus
    evaluation: Evaluation
    evaluations: int = 0
    iterations: int = 0
    moments: list[Moment] = field(default_factory=list)

    @property
    def trajectory(self) -> Trajectory:
        """The trip it ended with."""
        return self.evaluation.trajectory

    @property
    def feasible(self) -> bool:
        """Whether the trip keeps all sampled constraints."""
        return self.evaluation.worst_violation <= FEASIBILITY

    @property
    def repairable(self) -> bool:
        """Whether settling once more may make a trip of it that the certificate holds for."""
        return self.evaluation.worst_violation <= REPAIRABLE and self.status is not DescentStatus.TIME_LIMIT


class _OutOfTimeError(Exception):
    """The deadline has passed."""


class Descent:
    """Penalty descent on one problem from one start: stages, then settling, then tightening if asked to.

    Parameters
    ----------
    problem : Problem
    start : Trajectory
    settings : DescentSettings
    seed : int
        Of the Monte Carlo search.
    deadline : float
        Value of :func:`time.perf_counter` at which the descent ends.
    keep_moments : bool
        Whether the iterates are kept.
    """

    def __init__(
        self,
        problem: Problem,
        start: Trajectory,
        settings: DescentSettings,
        *,
        seed: int = 0,
        deadline: float = np.inf,
        keep_moments: bool = False,
    ) -> None:
        self.given = problem
        self.start = start
        self.deadline = deadline
        self.keep_moments = keep_moments
        self.random = np.random.default_rng(seed)
        self.began = perf_counter()
        self.path_size = problem.ends.free.stop - problem.ends.free.start
        self.scaling = path_scaling(problem)
        self.base = start.theta[problem.ends.free]
        free = np.full(self.path_size, np.inf)
        self.lower = np.concatenate([-free, problem.lowest_accelerations])
        self.upper = np.concatenate([free, problem.highest_accelerations])
        self._begin(settings)
        self.run_so_far = DescentRun(DescentStatus.UNSETTLED, self._exact())

    def _begin(self, settings: DescentSettings) -> None:
        """Go back to the start."""
        self.problem = self.given
        self.settings = settings
        self.weights = Weights.uniform(self.problem, settings.zone_price, settings.limit_price)
        self.weights.limits[ACCELERATION] = 0.0  # kept as bounds
        self.margins = Margins.none(self.problem)
        self.objective = PenalisedObjective(self.problem, self.weights, Hinge())
        self.y = np.clip(np.concatenate([np.zeros(self.path_size), self.start.beta]), self.lower, self.upper)
        self.best = np.inf

    def run_carefully(self) -> DescentRun:
        """Once more from the start, with narrow hinges and high prices at once: the trip stays in the start's way."""
        settings = self.settings
        self._begin(
            replace(
                settings,
                widths=(CAREFUL_WIDTH, *(width for width in settings.widths if width < CAREFUL_WIDTH)),
                zone_price=CAREFUL * settings.zone_price,
                limit_price=CAREFUL * settings.limit_price,
            )
        )
        return self.run()

    def run(self) -> DescentRun:
        """Go through all stages, and settle."""
        run = self.run_so_far
        try:
            for width in self.settings.widths:
                value = self._stage(width)
                self._raise_prices(width, value)
            self.settle()
        except _OutOfTimeError:
            run.status = DescentStatus.TIME_LIMIT
            run.evaluation = self._exact()
        logger.debug("descent: %s after %d evaluations", run.status.value, run.evaluations)
        return run

    def tighten(self, certificate: Certificate) -> DescentRun | None:
        """Ask for a little more of what the certificate finds missing, and settle again; None if it misses too much."""
        zone_margins, limit_margins = self.margins.zones.copy(), self.margins.limits.copy()
        optional = {limit.name: OPTIONAL + place for place, limit in enumerate(self.problem.optional)}
        places = {**CERTIFIED_LIMITS, **optional}
        for violation in certificate.violations:
            index: Index
            if violation.obstacle is not None:
                index = np.flatnonzero([name == violation.obstacle for name in self.problem.zones.ids])
                if len(index) == 0:
                    return None  # it was taken for too far away to matter
                missing, kind = -violation.value, zone_margins
            elif violation.what == "workspace bounds":
                missing, kind, index = -violation.value, limit_margins, np.array([BOX])
            elif (name := violation.what.partition("[")[0]) in places and violation.allowed > 0.0:
                missing = violation.value / violation.allowed - 1.0
                kind, index = limit_margins, np.array([places[name]])
            else:
                return None
            if missing > REPAIRABLE:
                return None
            kind[index] += 1.5 * missing + SETTLED
        moved = Margins(zone_margins - self.margins.zones, limit_margins - self.margins.limits)
        self.problem = _with_margins(self.problem, moved)
        try:
            self.settle()
        except _OutOfTimeError:
            self.run_so_far.status = DescentStatus.TIME_LIMIT
            self.run_so_far.evaluation = self._exact()
        return self.run_so_far

    def settle(self) -> None:
        """Move the active constraints until the trip ends on the true ones."""
        width, run = self.settings.widths[-1], self.run_so_far
        run.status = DescentStatus.UNSETTLED
        for _ in range(self.settings.settlings):
            value = self._stage(width)
            zones, limits = _signed_excess(self.problem, run.evaluation)
            zone_active = (self.weights.zones * value.zone_use > ACTIVE) | (zones > -TARGET)
            limit_active = (self.weights.limits * value.limit_use > ACTIVE) | (limits > -TARGET)
            off = max(
                np.abs(zones[zone_active] + TARGET).max(initial=0.0),
                np.abs(limits[limit_active] + TARGET).max(initial=0.0),
            )
            if off < SETTLED:
                run.status = DescentStatus.CONVERGED
                break
            if self._raise_prices(width, value):
                continue
            reach = STUCK * width * np.array([1.0, self.settings.limit_width])
            self.margins = Margins(
                self.margins.zones + np.where(zone_active, np.clip(zones + TARGET, -reach[0], reach[0]), 0.0),
                self.margins.limits + np.where(limit_active, np.clip(limits + TARGET, -reach[1], reach[1]), 0.0),
            )
        if run.evaluation.worst_violation > HOPELESS * width:
            run.status = DescentStatus.INFEASIBLE
        self._meet_goal_speed()
        run.evaluation = self._exact()

    def _raise_prices(self, width: float, value: ObjectiveValue) -> bool:
        """Make dearer what is violated by more than the hinge explains; whether anything was."""
        zones, limits = _signed_excess(self.problem, self.run_so_far.evaluation)
        last = self.settings.last_price
        dear_zones = (zones > STUCK * width) & (self.weights.zones < last)
        dear_limits = (limits > STUCK * self.settings.limit_width * width) & (self.weights.limits < last)
        dear_limits[ACCELERATION] = False
        self.weights = Weights(
            np.where(dear_zones, np.minimum(self.weights.zones * ESCALATION, last), self.weights.zones),
            np.where(dear_limits, np.minimum(self.weights.limits * ESCALATION, last), self.weights.limits),
        )
        return bool(dear_zones.any() or dear_limits.any())

    def _stage(self, width: float) -> ObjectiveValue:
        """Minimise with one width of the hinge, from where the last stage ended."""
        near = max(NEAR_LEAST, NEAR_WIDTHS * width)
        self.objective = PenalisedObjective(
            self.problem,
            self.weights,
            Hinge(width, self.settings.limit_width * width),
            SampleTimes.refined(self.problem, self._trajectory(self.y), near),
            self.margins,
        )
        self.best = np.inf
        budget = self.settings.evaluations or EVALUATIONS[self.settings.variant]
        start = self.y
        _MINIMISERS[self.settings.variant](self, start, self.run_so_far.evaluations + budget)
        self.run_so_far.evaluation = self._exact()
        value = self.objective.evaluate(self._omega(self.y), gradient=False)
        logger.debug(
            "stage: width %g, %d evaluations, Q = %.5f s, travel time %.5f s, worst violation %.2e",
            width,
            self.run_so_far.evaluations,
            value.value,
            value.travel_time,
            self.run_so_far.evaluation.worst_violation,
        )
        return value

    def evaluate(self, y: Array, *, gradient: bool = True) -> tuple[float, Array]:
        """Value and gradient in the scaled coordinates; the best y is kept."""
        if perf_counter() > self.deadline:
            raise _OutOfTimeError
        self.run_so_far.evaluations += 1
        found = self.objective.evaluate(self._omega(y), gradient=gradient)
        if not np.isfinite(found.value):
            back = np.zeros_like(y)
            back[self.path_size :] = -OUTSIDE * self.problem.space.tables.final_distance
            return OUTSIDE, back
        if found.value < self.best:
            self.best, self.y = found.value, y.copy()
        slope = found.gradient.copy()
        if gradient:
            slope[: self.path_size] = self.scaling.T @ slope[: self.path_size]
        return found.value, slope

    def note(self, y: Array) -> None:
        """Count an accepted step."""
        run = self.run_so_far
        run.iterations += 1
        if self.keep_moments:
            run.moments.append(Moment(run.evaluations, perf_counter() - self.began, self._trajectory(y)))

    def _omega(self, y: Array) -> Array:
        omega = y.copy()
        omega[: self.path_size] = self.base + self.scaling @ y[: self.path_size]
        return omega

    def _trajectory(self, y: Array) -> Trajectory:
        omega = self._omega(y)
        theta = self.problem.ends.theta.copy()
        theta[self.problem.ends.free] = omega[: self.path_size]
        return Trajectory.of(self.problem.space, theta, omega[self.path_size :])

    def _exact(self) -> Evaluation:
        return evaluate_trip(self.problem, self._trajectory(self.y), NEAR)

    def _meet_goal_speed(self) -> None:
        """Correct the accelerations that are free to be, the least that gives the goal speed to rounding."""
        wanted, space = self.problem.ends.goal_speed, self.problem.space
        if wanted is None:
            return
        y = self.y.copy()
        beta = y[self.path_size :]
        row = space.tables.final_speed
        for _ in range(20):
            trajectory = self._trajectory(y)
            gap = wanted - trajectory.final_speed
            if not np.isfinite(gap) or abs(gap) > REPAIRABLE:
                return
            if abs(gap) < 1e-10:
                break
            room = np.where(gap * row > 0.0, self.upper[self.path_size :] - beta, beta - self.lower[self.path_size :])
            usable = np.where(room > 1e-3, row, 0.0)
            if not usable.any():
                return
            beta += usable * gap / (trajectory.travel_time * float(usable @ usable))
        self.y = np.clip(y, self.lower, self.upper)


def path_scaling(problem: Problem) -> Array:
    """Map from scaled coordinates to free offsets in which the curvature of travel time / arc length is about 1."""
    space, tables = problem.space, problem.space.tables
    step = np.tile(tables.weights, tables.cells) * (space.length / tables.cells)
    slopes = tables.node_slopes[:, problem.ends.free] / space.length
    rows = tables.node_rows[:, problem.ends.free]
    bending = (slopes * step[:, None]).T @ slopes / problem.limits.speed
    matrix = bending + RIGIDITY * (rows * step[:, None]).T @ rows
    return np.linalg.inv(np.linalg.cholesky(matrix)).T


def _signed_excess(problem: Problem, evaluation: Evaluation) -> tuple[Array, Array]:
    """Excesses, with their sign, over zones (L,) m and limits (8,), with the minima between samples refined."""
    trajectory, limits = evaluation.trajectory, problem.limits
    zones = -evaluation.clearance.min(axis=0) if problem.zones.size else np.zeros(0)
    np.maximum.at(zones, evaluation.minima_zone, -evaluation.minima_contacts.distance)
    speeds = trajectory.speed_control_points()[1:] / limits.speed
    found = np.full(len(OBJECTIVE_LIMITS) + len(problem.optional), -np.inf)
    found[OPTIONAL:] = [excess.max(initial=-np.inf) for excess in evaluation.optional]
    found[LATERAL] = evaluation.sites.worst_lateral / limits.lateral_acceleration - 1.0
    found[CURVATURE] = float(np.abs(evaluation.sites.curvature).max()) / limits.curvature - 1.0
    found[SPEED] = float(speeds.max()) - 1.0
    found[BOX] = -float(evaluation.box_gaps.min(initial=np.inf))
    if problem.ends.goal_speed is not None:
        found[GOAL_SPEED] = abs(trajectory.final_speed - problem.ends.goal_speed) - SETTLED
    found[REVERSE] = -float(speeds.min())
    theta, ends, free = trajectory.theta[problem.ends.free], problem.ends, problem.ends.free
    found[OFFSET] = float(np.max(np.maximum(theta - ends.upper[free], ends.lower[free] - theta), initial=-np.inf))
    return zones, found


def _with_margins(problem: Problem, more: Margins) -> Problem:
    """The problem with larger zones and lower limits, as the exact checks see it."""
    optional = {limit.name: more.limits[OPTIONAL + place] for place, limit in enumerate(problem.optional)}
    tightened = problem.tightened(more.zones, more.limits[LATERAL], more.limits[CURVATURE], more.limits[BOX], optional)
    return replace(
        tightened, limits=replace(tightened.limits, speed=tightened.limits.speed * (1.0 - more.limits[SPEED]))
    )


def _lbfgs(descent: Descent, start: Array, until: int) -> None:
    from scipy.optimize import minimize

    budget = until - descent.run_so_far.evaluations
    minimize(
        descent.evaluate,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(descent.lower, descent.upper, strict=True)),
        callback=descent.note,
        options={
            "maxcor": descent.settings.memory,
            "maxfun": budget,
            "maxiter": budget,
            "ftol": descent.settings.tolerance,
            "gtol": 1e-5,
        },
    )


def _gradient_descent(descent: Descent, start: Array, until: int) -> None:
    """Steps against the gradient, projected onto the bounds; the step is doubled after success, halved until Armijo."""
    y, length, small = start, 1.0, 0
    value, slope = descent.evaluate(y)
    while descent.run_so_far.evaluations < until and small < 3:
        trial = np.clip(y - length * slope, descent.lower, descent.upper)
        step = trial - y
        if not np.abs(step).max() > 1e-12:
            return
        trial_value, trial_slope = descent.evaluate(trial)
        if trial_value > value + ARMIJO * float(slope @ step):
            length *= 0.5
            continue
        small = small + 1 if value - trial_value < descent.settings.tolerance * abs(value) else 0
        y, value, slope, length = trial, trial_value, trial_slope, 2.0 * length
        descent.note(y)


def _monte_carlo(descent: Descent, start: Array, until: int) -> None:
    """Random steps of some coordinates; the step grows after success and shrinks after failure (the 1/5 rule)."""
    y, spread = start, 0.3
    value, _ = descent.evaluate(y, gradient=False)
    while descent.run_so_far.evaluations < until and spread > 1e-7:
        moved = descent.random.random(len(y)) < max(2.0 / len(y), 0.2)
        trial = np.clip(y + spread * moved * descent.random.normal(size=len(y)), descent.lower, descent.upper)
        trial_value, _ = descent.evaluate(trial, gradient=False)
        if trial_value < value:
            y, value, spread = trial, trial_value, spread * 1.5
            descent.note(y)
        else:
            spread *= 1.5**-0.25


_MINIMISERS: dict[Variant, Callable[[Descent, Array, int], None]] = {
    Variant.LBFGS: _lbfgs,
    Variant.GRADIENT: _gradient_descent,
    Variant.MONTE_CARLO: _monte_carlo,
}


@dataclass(frozen=True)
class CheckedDescent:
    """A descent and what its certificate says."""

    run: DescentRun
    certificate: Certificate

    def better_than(self, other: CheckedDescent | None) -> bool:
        """Certified before not certified, then faster; without certificates the lesser violation."""
        if other is None:
            return True
        if self.certificate.holds != other.certificate.holds:
            return self.certificate.holds
        if self.certificate.holds:
            return self.run.trajectory.travel_time < other.run.trajectory.travel_time
        return self.run.evaluation.worst_violation < other.run.evaluation.worst_violation


def checked_descent(
    problem: Problem, threat_zones: tuple[ThreatZone, ...], descent: Descent, timings: dict[str, float] | None = None
) -> CheckedDescent:
    """Descend, and check the result; repeat with tighter margins what hardly fails, and carefully what fails.

    Parameters
    ----------
    problem : Problem
        As the scenario asks for.
    threat_zones : tuple of ThreatZone
        The scenario's zones.
    descent : Descent
        Not yet run.
    timings : dict, optional
        To which wall times are added, s.

    Returns
    -------
    CheckedDescent
    """
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
            checked = CheckedDescent(replace(run), certificate)
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
