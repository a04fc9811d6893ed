"""Features of scenes, a file each, and the table of them, in the order in which they are added."""

from __future__ import annotations

from benchmarks.pairs.features import (
    changes,
    constraint,
    deadline,
    grid,
    ground,
    headings,
    jerk,
    obstacles,
    places,
    predictor,
    rectangle,
    reverse,
    spot,
    target,
    tour,
    tracking,
    window,
)
from benchmarks.pairs.scene import Feature

HEADINGS = Feature("heading", ("heading",), headings.add, shapes=True)
REVERSE = Feature("reverse", ("reverse", "backwards", "legs"), reverse.add, shapes=True)
SPOT = Feature("spot", ("max_turn_rate", "on the spot", "steering"), spot.add, shapes=True)
JERK = Feature("jerk", ("jerk",), jerk.add, shapes=True)
RECTANGLE = Feature("rectangle", ("disc", "rectangle"), rectangle.add, shapes=True)
TRACKING = Feature("tracking", ("tracking_error",), tracking.add, shapes=True)
PLACES = Feature("goals", ("goals", "places"), places.add)
WINDOW = Feature("window", ("arrival",), window.add)
TARGET = Feature("target", ("target",), target.add)
MAP = Feature("map", ("map", "ground"), grid.add)
WALLS = Feature("walls", ("walls", "corridor"), ground.add)
CONSTRAINT = Feature("constraint", ("constraint",), constraint.add)
COURSES = Feature("courses", ("course", "obstacle"), obstacles.add_courses)
UNCERTAIN = Feature("uncertain", ("covariance", "estimate", "obstacle"), obstacles.add_uncertain)
PREDICTOR = Feature("predictor", ("predictor",), predictor.add)
DEADLINE = Feature("deadline", ("deadline",), deadline.add)
TOUR = Feature("tour", ("set_goal",), tour.add)
CHANGES = Feature("changes", ("set_goal", "set_limits", "set_walls", "set_ground", "update_map"), changes.add)

OFFLINE = (
    *(HEADINGS, REVERSE, SPOT, JERK, RECTANGLE),
    *(PLACES, WINDOW, TARGET, MAP, WALLS, CONSTRAINT, COURSES, UNCERTAIN),
)
ONLINE = (
    *(REVERSE, SPOT, JERK, RECTANGLE, TRACKING),
    *(PLACES, TARGET, MAP, WALLS, PREDICTOR, DEADLINE, TOUR, CHANGES),
)
EITHER = {feature.name: feature for feature in (*OFFLINE, *ONLINE)}
THREES = {
    False: (("reverse", "goals", "map"), ("reverse", "target", "walls"), ("window", "map", "uncertain")),
    True: (("reverse", "goals", "map"), ("reverse", "target", "walls"), ("map", "predictor", "deadline")),
}
"""Three features that users combine, offline and online (True)."""
