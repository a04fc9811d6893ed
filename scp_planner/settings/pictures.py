"""Contents of pictures and their file formats."""

from __future__ import annotations

from enum import StrEnum

FIGURE_SUFFIXES = (".pdf", ".png", ".svg")
FILM_SUFFIXES = (".gif", ".mp4")
PAGE_SUFFIXES = (".html", ".htm")
PICTURE_SUFFIXES = (*FIGURE_SUFFIXES, *FILM_SUFFIXES, *PAGE_SUFFIXES)


class View(StrEnum):
    """Kind of figure.

    ``map``: the map at several times, and profiles. ``space-time``: which part of the way is taken when.
    ``profiles``: speed, accelerations, curvature and clearance against their limits.
    """

    MAP = "map"
    SPACE_TIME = "space-time"
    PROFILES = "profiles"
