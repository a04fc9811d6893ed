"""Settings of a descent."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from scp_planner.settings.knobs import word_of


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
