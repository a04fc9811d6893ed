"""Settings of the planner that are measured among people."""

from __future__ import annotations

import scp_planner as sp
from scp_planner.scenario.process_model import ProcessModel, RandomWalkVelocity
from scp_planner.settings.online import OnlineSettings, Safety

WALKING = ProcessModel(process=RandomWalkVelocity(diffusion=0.02), velocity_deviation=1.0, noise_deviation=0.02)
"""People change their velocity at every step, and where they are is seen exactly."""

PROFILES = {
    "default": (OnlineSettings(), sp.Model(order=1)),
    "crowd": (OnlineSettings(), sp.Model(order=1, process=WALKING)),
    "trip": (OnlineSettings(safety=Safety.TRIP), sp.Model(order=1)),
}


def profile(name: str) -> tuple[OnlineSettings, sp.Model]:
    """Settings, and the motion that people are tracked with."""
    return PROFILES[name]
