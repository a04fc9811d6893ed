"""Headings at start and goal that a bend leads from and to."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.hostile.features import Rng
from benchmarks.pairs.motion import USED, Drive
from benchmarks.pairs.scene import Scene


def add(scene: Scene, rng: Rng) -> None:
    """Lead into and out of the drives ahead by arcs of up to 1.2 rad."""
    bent = [number for number, piece in enumerate(scene.pieces) if isinstance(piece, Drive) and piece.gear > 0.0]
    for number, side in ((bent[0], "first"), (bent[-1], "last")):
        piece = scene.pieces[number]
        assert isinstance(piece, Drive)
        bend = float(rng.choice([-1.0, 1.0])) * USED * scene.vehicle["max_curvature"]
        arc = (float(rng.uniform(0.3, 1.2)) / abs(bend), bend)
        arcs = (arc, *piece.arcs) if side == "first" else (*piece.arcs, arc)
        scene.pieces[number] = replace(piece, arcs=arcs)
    scene.heads = True
