"""Zones of every kind of shape, for tests of what holds for all."""

from __future__ import annotations

from typing import Any

from scenes import observed, scene

import scp_planner as sp
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.threat_zones.batch import ZoneBatch

ELL = [[-1.0, -1.0], [2.0, -1.0], [2.0, 0.0], [0.0, 0.0], [0.0, 2.0], [-1.0, 2.0]]
EGG = {"ellipse": [1.5, 0.4]}


def shaped(
    name: str,
    shape: dict[str, Any],
    position: tuple[float, float],
    velocity: tuple[float, float] = (0.0, 0.0),
    acceleration: tuple[float, float] = (0.0, 0.0),
) -> dict[str, Any]:
    return {
        "id": name,
        "shape": shape,
        "motion": {"position": position, "velocity": velocity, "acceleration": acceleration},
    }


def seen(name: str, shape: dict[str, Any], seed: int, order: int = 2) -> dict[str, Any]:
    return {**observed(name, seed), "shape": shape, "model": {"order": order}}


KINDS = scene(
    shaped("standing", {"rectangle": [3.0, 1.0]}, (4.0, 3.0)),
    shaped("wall", {"rectangle": [5.0, 0.2], "heading": 0.7}, (8.0, -4.0)),
    shaped("car", {"rectangle": [4.0, 1.8]}, (12.0, 4.0), (-1.0, -0.5)),
    shaped("turning", {"rectangle": [4.0, 1.8]}, (6.0, -3.0), (0.8, 0.6), (0.3, -0.4)),
    shaped("egg", EGG, (15.0, 1.0), (0.0, 0.6)),
    shaped("turning egg", EGG, (10.0, 2.0), (-0.4, 0.6), (-0.3, -0.2)),
    shaped("triangle", {"polygon": [[0, 0], [0, 3], [2, 0]]}, (3.0, -5.0), (0.5, 0.2)),
    shaped("ell", {"polygon": ELL}, (16.0, -3.0), (-0.5, 0.2), (0.0, 0.1)),
    seen("seen triangle", {"polygon": [[0, 0], [0, 1], [1, 0]]}, 1),
    seen("seen box", {"rectangle": [2.0, 1.0], "heading": 1.0}, 2),
    seen("seen egg", {**EGG, "heading": -0.3}, 3),
    seen("standing egg", EGG, 4, order=0),
    shaped("disc", {"disc": 0.55}, (8.5, -3.9), (0.23, 0.86), (0.05, 0.1)),
    seen("seen disc", {"disc": 0.4}, 5),
    start={"time": 5.0, "position": [1.0, 2.0]},
    goal={"position": [15.0, 9.0]},
)


def batch_of(scenario: sp.Scenario, inflation: float = 0.3) -> tuple[PlanningFrame, ZoneBatch]:
    frame = PlanningFrame.between(scenario.start.position, scenario.goal.position, scenario.start.time)
    return frame, ZoneBatch.of(sp.zones(scenario), frame, inflation)
