"""What is known of observed obstacles: that late observations are learnt as if in order, at a bounded cost."""

from __future__ import annotations

import numpy as np
import pytest

from scp_planner.estimation.motion_filter import MotionFilter
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.online.track import MOST_LATE, ProcessTrack
from scp_planner.scenario.models import Confidence, Model
from scp_planner.scenario.shapes import Disc
from scp_planner.settings.online import Watch

STEP = 0.1  # s between observations
PROCESS = {
    "process": {"process": {"kind": "random_walk", "diffusion": 0.3}, "velocity_deviation": 1.0, "noise_deviation": 0.1}
}


def observed(count: int) -> tuple[list[float], list[tuple[float, float]]]:
    """Times and places of something that wanders."""
    draw = np.random.default_rng(7)
    places = np.cumsum(np.cumsum(0.02 * draw.normal(size=(count, 2)), axis=0), axis=0)
    return [STEP * k for k in range(count)], [(float(x), float(y)) for x, y in places]


def unseen(model: Model | None = None) -> ObstacleTracks:
    tracks = ObstacleTracks(Confidence(), watch=Watch(gate_probability=0.0))
    tracks.add_unseen("one", Disc(disc=0.5), model or Model(**PROCESS), 0.0, 0.01 * np.eye(2))
    return tracks


def process_of(tracks: ObstacleTracks) -> ProcessTrack:
    estimator = tracks.tracks["one"].estimator
    assert isinstance(estimator, ProcessTrack)
    return estimator


def seen(order: list[int]) -> ObstacleTracks:
    """Take in the observations in some order."""
    times, places = observed(len(order))
    tracks = unseen()
    for k in order:
        assert tracks.observe("one", times[k], places[k]) is None
    return tracks


def assert_same(one: ObstacleTracks, other: ObstacleTracks) -> None:
    a, b = process_of(one).filter, process_of(other).filter
    assert np.array_equal(a.observations, b.observations)
    for part in ("times", "mean", "covariance"):
        assert np.array_equal(getattr(a._state, part), getattr(b._state, part))
    assert np.array_equal(a.log_likelihood, b.log_likelihood)
    assert one.tracks["one"].times == other.tracks["one"].times
    assert one.tracks["one"].positions == other.tracks["one"].positions


@pytest.mark.parametrize("late", [1, 2, 17, MOST_LATE - 1, MOST_LATE])
@pytest.mark.parametrize("count", [MOST_LATE + 1, 3 * MOST_LATE])
def test_a_late_observation_is_learnt_as_if_it_had_come_in_time(late: int, count: int) -> None:
    in_order = list(range(count))
    missed = count - 1 - late
    assert_same(seen([k for k in in_order if k != missed] + [missed]), seen(in_order))


def test_observations_in_any_order_are_learnt_as_if_in_order() -> None:
    count = 2 * MOST_LATE
    shuffled = [k for begin in range(0, count, 8) for k in reversed(range(begin, begin + 8))]
    assert_same(seen(shuffled), seen(list(range(count))))


def test_a_late_observation_costs_no_more_after_a_long_time(monkeypatch: pytest.MonkeyPatch) -> None:
    times, places = observed(1000)
    tracks = unseen()
    updates = 0
    update = MotionFilter.update

    def counted(*arguments: object, **keywords: object) -> object:
        nonlocal updates
        updates += 1
        return update(*arguments, **keywords)  # type: ignore[arg-type]

    monkeypatch.setattr(MotionFilter, "update", counted)
    for k in range(0, 1000, 2):  # two sensors, the second one three looks late
        tracks.observe("one", times[k], places[k])
        if k >= 5:
            before = updates
            tracks.observe("one", times[k - 5], places[k - 5])
            assert updates - before == 4  # itself, and the three that were seen after it
    assert len(process_of(tracks).filters) == MOST_LATE


def test_what_comes_too_late_is_told_and_left_out() -> None:
    times, places = observed(2 * MOST_LATE)
    tracks, other = unseen(), unseen()
    for k in range(1, 2 * MOST_LATE):
        tracks.observe("one", times[k], places[k])
        other.observe("one", times[k], places[k])
    assert "too late" in str(tracks.observe("one", times[0], places[0]))
    assert_same(tracks, other)


def test_polynomial_motions_take_what_comes_very_late() -> None:
    times, places = observed(3 * MOST_LATE)
    tracks = unseen(Model())
    for k in [*range(1, 3 * MOST_LATE), 0]:
        assert tracks.observe("one", times[k], places[k]) is None
    assert tracks.tracks["one"].times == times


def test_the_copy_of_a_filter_goes_on_by_itself() -> None:
    times, places = observed(12)
    first = process_of(seen(list(range(10)))).filter
    before = first._state.covariance.copy()
    other = first.copy()
    other.update(times[10], np.array([places[10]]), 0.01 * np.eye(2))
    assert np.array_equal(first._state.covariance, before) and first.observations[0] == 10
    assert other.observations[0] == 11 and other._state.times[0] == times[10]
