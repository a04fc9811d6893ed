"""Words of Reeds and Shepp: they lead to their poses, and no other drive is shorter."""

from __future__ import annotations

import numpy as np
import pytest

from scp_planner.arrays import Array
from scp_planner.routes.reeds_shepp import along, words

DRAWN = np.random.default_rng(5)


def shortest(x: Array, y: Array, heading: Array) -> Array:
    lengths = np.abs(words(x, y, heading)[1]).sum(axis=2)
    least: Array = np.nanmin(lengths, axis=1)
    return least


def test_every_word_leads_to_its_pose() -> None:
    x, y, heading = DRAWN.uniform(-4.0, 4.0, 500), DRAWN.uniform(-4.0, 4.0, 500), DRAWN.uniform(-3.2, 3.2, 500)
    turns, lengths = words(x, y, heading)
    there = np.isfinite(lengths.sum(axis=2))
    assert there.any(axis=0).all()
    assert there.any(axis=1).all()
    # Small steps of the differential equations, which share nothing with the closed forms
    for number in range(0, 500, 25):
        for word in np.flatnonzero(there[number]):
            steps = np.repeat(lengths[number, word] / 200.0, 200)
            turned = np.cumsum(np.repeat(turns[word], 200) * steps)
            middle = turned - 0.5 * np.repeat(turns[word], 200) * steps
            end = (steps @ np.cos(middle), steps @ np.sin(middle))
            assert end == pytest.approx((x[number], y[number]), abs=1e-3)
            assert np.cos(turned[-1] - heading[number]) == pytest.approx(1.0, abs=1e-9)


def test_no_other_drive_is_shorter() -> None:
    turns = DRAWN.integers(-1, 2, (20_000, 5)).astype(float)
    lengths = DRAWN.uniform(-2.0, 2.0, (20_000, 5)) * (DRAWN.random((20_000, 5)) < 0.6)
    x, y, heading = along(turns, lengths)[:, -1].T
    assert (shortest(x, y, heading) <= np.abs(lengths).sum(axis=1) + 1e-9).all()


@pytest.mark.parametrize(
    ("pose", "length"),
    [
        ((-3.0, 0.0, 0.0), 3.0),  # straight back
        ((0.0, 2.0, np.pi), np.pi),  # half a turn
        ((0.0, 0.0, np.pi), np.pi),  # round in place: three sixths of a turn
    ],
)
def test_lengths_that_are_known(pose: tuple[float, float, float], length: float) -> None:
    x, y, heading = np.array(pose)[:, None]
    assert shortest(x, y, heading)[0] == pytest.approx(length)
