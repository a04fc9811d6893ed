"""Settings of the planner that are measured among people."""

from __future__ import annotations

import scp_planner as sp
from scp_planner.scenario.ready_made import ready_made
from scp_planner.settings.online import OnlineSettings, Safety
from scp_planner.simulation.crowds import WALKER

PROFILES: dict[str, tuple[OnlineSettings | None, sp.Model]] = {
    "default": (OnlineSettings(), sp.Model(process=ready_made("pedestrian"))),
    "crowd": (None, WALKER),
    "straight": (None, sp.Model(order=1)),
    "trip": (OnlineSettings(safety=Safety.TRIP), sp.Model(order=1)),
}
"""Settings, None for those of the episode, and the motion that people are tracked with."""


def profile(name: str) -> tuple[OnlineSettings | None, sp.Model]:
    """Settings, and the motion that people are tracked with."""
    return PROFILES[name]
