"""How a descent is made."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from scp_planner.settings.knobs import word_of


class Variant(StrEnum):
    """How the objective is minimised."""

    LBFGS = "l-bfgs"
    GRADIENT = "gradient-descent"
    MONTE_CARLO = "monte-carlo"


EVALUATIONS = {Variant.LBFGS: 150, Variant.GRADIENT: 400, Variant.MONTE_CARLO: 800}
"""Of the objective in one stage, at most, if the settings do not say."""


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
