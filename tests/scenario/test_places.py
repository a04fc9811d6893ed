"""Places along lines that cross themselves."""

from __future__ import annotations

import numpy as np
import pytest

from scp_planner.scenario.places import Line, Stretch, followed, limits_at


def test_each_pass_over_a_crossing_keeps_its_own_stations() -> None:
    """A line that goes up, around, and then across itself: a drive along it is on each part in turn."""
    turn = np.linspace(np.pi, -0.5 * np.pi, 40)
    arc = np.stack([20.0 + 20.0 * np.cos(turn), 40.0 + 20.0 * np.sin(turn)], axis=1)
    line = Line(np.concatenate([[[0.0, -40.0], [0.0, 30.0]], arc, [[-40.0, 20.0]]]))
    first_pass = 60.0
    second_pass = line.length - 40.0
    assert line.loop == pytest.approx(second_pass - first_pass, abs=1e-9)
    rng = np.random.default_rng(0)
    stations = np.linspace(0.0, line.length, 700)
    legs = np.hypot(*np.diff(line.points, axis=0).T)
    drive = np.stack([np.interp(stations, np.append(0.0, np.cumsum(legs)), x) for x in line.points.T], axis=1)
    found = line.followed(drive + 0.3 * rng.uniform(-1.0, 1.0, drive.shape))
    assert found is not None
    assert found == pytest.approx(stations, abs=1.2)
    assert Line(line.points[:3]).followed(drive) is None
    slow = (Stretch(line, 0.0, 70.0, 5.0),)
    limits = limits_at(slow, drive, followed(slow, drive))
    assert np.all(np.isinf(limits) == (stations > 70.0 + 1e-6))
    beside = np.array([[0.1, 20.3]])  # of the second pass, if it is asked for by itself: nearer to the first
    assert np.isfinite(limits_at(slow, beside))[0]
    assert np.isinf(limits_at(slow, beside, {line: np.array([second_pass])}))[0]
