"""Turns on the spot, at the start or at the goal."""

from __future__ import annotations

from benchmarks.hostile.features import Rng
from benchmarks.pairs.motion import Turn
from benchmarks.pairs.scene import Scene, lead_in, lead_out


def add(scene: Scene, rng: Rng) -> None:
    scene.vehicle.update(steering="on_the_spot", max_turn_rate=float(rng.uniform(0.5, 2.0)))
    turn = Turn(float(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 2.8)))
    if rng.random() < 0.5:
        lead_in(scene, turn)
    else:
        lead_out(scene, turn)
        scene.heads = True
