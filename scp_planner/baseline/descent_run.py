"""Settings and result of a descent."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from scp_planner.baseline.tolerances import REPAIRABLE
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.record import FEASIBILITY
from scp_planner.settings.knobs import word_of
from scp_planner.trips.trajectory import Trajectory


class Variant(StrEnum):
    LBFGS = "l-bfgs"
    GRADIENT = "gradient-descent"
    MONTE_CARLO = "monte-carlo"


EVALUATIONS = {Variant.LBFGS: 150, Variant.GRADIENT: 400, Variant.MONTE_CARLO: 800}
"""Evaluations of the objective in one stage, at most, if the settings do not say."""


@dataclass(frozen=True)
class DescentSettings:
    """Settings of penalty descent."""

    variant: Variant = Variant.LBFGS  # Or its word; `SettingsError` if there is none
    widths: tuple[float, ...] = (0.3, 0.1, 0.03, 0.01, 0.003)
    limit_width: float = 0.3  # Width of the hinge for limits, relative, for each unit of the width for zones
    zone_price: float = 5.0  # First prices, units of time for one of length and for one of excess
    limit_price: float = 20.0  # First prices, units of time for one of length and for one of excess
    last_price: float = 1e3  # Prices grow up to this
    evaluations: int | None = None
    settlings: int = 8  # Further stages at the last width, at most
    memory: int = 25  # Pairs of steps and gradients that L-BFGS keeps
    tolerance: float = 1e-9  # A stage ends when a step gains less than this fraction of the objective

    def __post_init__(self) -> None:
        object.__setattr__(self, "variant", word_of(Variant, self.variant, "variant"))


class DescentStatus(StrEnum):
    CONVERGED = "converged"
    UNSETTLED = "still moving at the last stage"
    INFEASIBLE = "violations stay at the highest price"
    TIME_LIMIT = "time limit"


@dataclass(frozen=True)
class Iterate:
    """An iterate of a descent."""

    evaluations: int  # of the objective until then
    seconds: float  # since the descent began
    trajectory: Trajectory


@dataclass
class DescentRun:
    """A descent and where it ended."""

    status: DescentStatus
    evaluation: Evaluation  # the last trip, with the exact hinge
    evaluations: int = 0  # of the objective, with gradient or (Monte Carlo) without
    iterations: int = 0  # accepted steps of the minimisers
    iterates: list[Iterate] = field(default_factory=list)  # the iterates, if they were asked for

    @property
    def trajectory(self) -> Trajectory:
        """The trip it ended with."""
        return self.evaluation.trajectory

    @property
    def feasible(self) -> bool:
        """True if the trip keeps all sampled constraints."""
        return self.evaluation.worst_violation <= FEASIBILITY

    @property
    def repairable(self) -> bool:
        """True if settling once more may make a trip of it that the certificate holds for."""
        return self.evaluation.worst_violation <= REPAIRABLE and self.status is not DescentStatus.TIME_LIMIT
