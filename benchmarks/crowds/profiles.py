"""Settings of the planner that are measured among people."""

from __future__ import annotations

import scp_planner as sp
from scp_planner.settings.online import OnlineSettings, Safety

PROFILES = {
    "default": (OnlineSettings(), sp.Model(order=1)),
    "trip": (OnlineSettings(safety=Safety.TRIP), sp.Model(order=1)),
}


def profile(name: str) -> tuple[OnlineSettings, sp.Model]:
    """Settings, and the motion that people are tracked with."""
    return PROFILES[name]
