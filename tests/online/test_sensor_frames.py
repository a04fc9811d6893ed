"""Tests of observations that are taken in together against the same taken in one by one."""

from __future__ import annotations

import numpy as np
import pytest

import scp_planner as sp
from scp_planner.estimation.error_laws import NormalErrors
from scp_planner.online import sensor_frames
from scp_planner.online.foretold import Foretold, Prediction
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.online.track import Seen
from scp_planner.scenario.models import Model
from scp_planner.scenario.shapes import Disc

NOISE, STEP, COUNT, LAST = 0.1, 0.1, 7, 50


def tracks_of() -> ObstacleTracks:
    """Obstacles of two orders, one of them of a model that is never taken in with others."""
    tracks = ObstacleTracks(sp.Confidence())
    for number in range(COUNT):
        model = Model.named("pedestrian") if number == 3 else Model(order=1 + number % 2)
        tracks.add_unseen(str(number), Disc(disc=0.3), model, 0.0, NOISE**2 * np.eye(2))
    return tracks


def seen_of(rng: np.random.Generator, number: int) -> dict[str, Seen]:
    """One frame: an outlier, one that is missing, one that comes late, one twice, and noise that is given."""
    time = STEP * number
    speeds, turn = np.linspace(0.2, 1.4, COUNT), 1.0 * max(time - 2.0, 0.0) ** 2
    seen = {}
    for k in range(COUNT):
        x, y = np.array([speeds[k] * time + (turn if k == 1 else 0.0), 3.0 * k]) + NOISE * rng.standard_normal(2)
        if k == 2 and number == 23:
            x += 6.0
        if k == 4 and number % 5 == 0:
            continue
        when = time - 1.5 * STEP if k == 5 and number % 7 == 3 else time
        seen[str(k)] = Seen(when, (float(x), float(y)), NOISE**2 * np.eye(2) if k % 3 == 0 else None)
    return seen


def test_a_frame_is_taken_in_as_its_observations_one_by_one() -> None:
    rng = np.random.default_rng(0)
    together, alone = tracks_of(), tracks_of()
    said: list[str | None] = []
    for number in range(LAST + 1):
        seen = seen_of(rng, number)
        if number == 30:
            seen["6"] = Seen(STEP * (number - 1), together.tracks["6"].positions[-1])  # again
        said += (told := sensor_frames.take_in(together, list(seen), list(seen.values())))
        each = [alone.observe(name, one.time, one.position, one.covariance) for name, one in seen.items()]
        assert told == each
        if number % 10 == 0:  # where predictions are from, too
            ours, theirs = together.zones(STEP * number), alone.zones(STEP * number)
            assert [zone.id for zone in ours] == [zone.id for zone in theirs]
    at = STEP * LAST + np.array([0.0, 1.0, 4.0])
    for zone, other in zip(ours, theirs, strict=True):
        assert zone.center(at) == pytest.approx(other.center(at), abs=1e-9)
        assert zone.covariance(at) == pytest.approx(other.covariance(at), rel=1e-9)
    assert together.tracks["1"].alarmed and alone.tracks["1"].alarmed
    assert "it came twice" in said and "it is improbable after what was seen before" in said
    for name, track in together.tracks.items():
        assert track.times == alone.tracks[name].times


def test_what_is_foretold_of_many_is_foretold_of_each() -> None:
    rng = np.random.default_rng(1)
    slots, times = np.array([4, 1, 2]), np.array([2.3, 1.1, 9.0])
    center, positions = rng.normal(size=(3, 3, 2)), rng.normal(size=(3, 2))
    covariance = np.zeros((3, 5, 3))
    covariance[:, 0], covariance[:, 1] = [0.4, 0.1, 0.3], [0.1, 0.0, 0.1]
    covariance[2, 1] = [-1.0, 0.0, -1.0]  # at its time it is none
    noise = np.array([[[0.01, 0.002], [0.002, 0.02]]] * 3)
    foretold = Foretold()
    foretold.grow(5)
    assert np.array_equal(foretold.squares(slots, times, positions, noise), np.zeros(3))
    foretold.put(slots, 1.0, center, covariance)
    found = foretold.squares(slots, times, positions, noise)
    for k in range(3):
        one = Prediction(1.0, center[k], covariance[k], NormalErrors())
        expected = one.square(times[k], (positions[k, 0], positions[k, 1]), noise[k])
        assert found[k] == pytest.approx(0.0 if expected is None else expected, rel=1e-9)
    assert found[2] == 0.0 and found[0] > 0.0
