"""By how much obstacles have changed their velocities of late."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scp_planner.online.unrest import Unrest


def test_changes_are_those_since_any_look_that_is_not_too_long_ago() -> None:
    """Of random courses, against loops over all pairs of looks; the order of obstacles changes."""
    rng = np.random.default_rng(1)
    velocities = {name: rng.normal(size=(12, 2)) for name in "abc"}
    unrest = Unrest(0.35)
    for look in range(12):
        names = tuple(rng.permutation(list("abc")))
        found = unrest.note(0.1 * look, names, np.array([velocities[name][look] for name in names]))
        for name, change in zip(names, found, strict=True):
            course = velocities[name]
            # the first look shows no velocity
            changes = [course[look] - course[before] for before in range(max(look - 3, 1), look)]
            expected = max(changes, key=lambda one: math.hypot(*one), default=np.zeros(2))
            assert change == pytest.approx(expected)


def test_who_has_only_just_come_has_changed_nothing() -> None:
    unrest = Unrest(1.0)
    unrest.note(0.0, ("old",), np.array([[1.0, 0.0]]))
    unrest.note(0.2, ("old", "new"), np.array([[1.0, 0.0], [0.0, 0.0]]))
    assert unrest.note(0.4, ("new", "old"), np.array([[3.0, 0.0], [1.5, 0.0]])) == pytest.approx(
        np.array([[0.0, 0.0], [0.5, 0.0]])
    )
    assert unrest.note(0.6, ("new", "old"), np.array([[3.0, 2.0], [1.5, 0.0]])) == pytest.approx(
        np.array([[0.0, 2.0], [0.5, 0.0]])
    )


def test_one_time_counts_once_and_who_is_gone_comes_anew() -> None:
    unrest = Unrest(1.0)
    assert not len(unrest.note(0.0, (), np.zeros((0, 2))))
    for time in (0.1, 0.2):
        unrest.note(time, ("a",), np.array([[time, 0.0]]))
    assert unrest.note(0.2, ("a",), np.array([[5.0, 0.0]])) == pytest.approx(0.0), "in place of that at 0.2"
    unrest.note(0.3, (), np.zeros((0, 2)))
    unrest.note(0.4, ("a",), np.array([[1.0, 0.0]]))
    assert unrest.note(0.5, ("a",), np.array([[2.0, 0.0]])) == pytest.approx(0.0)
