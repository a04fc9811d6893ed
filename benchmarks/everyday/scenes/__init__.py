"""Everyday scenes, a file each: ``make(seed)`` returns the scene with fresh motions."""

from __future__ import annotations

import pkgutil
from importlib import import_module

from benchmarks.everyday.scene import Scene

NAMES = tuple(sorted(each.name for each in pkgutil.iter_modules(__path__)))


def make(name: str, seed: int) -> Scene:
    """Return a scene by its name."""
    scene: Scene = import_module(f"{__name__}.{name}").make(seed)
    scene.name = name
    return scene
