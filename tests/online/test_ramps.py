"""Changes of speed along ramps, against integrals of another kind and a driver who only looks at his speed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scp_planner.online.ramps import Ramps

pytestmark = pytest.mark.numerics

RISE, FALL, JERK = 1.5, 2.0, 4.0
RNG = np.random.default_rng(5)
SPEED, ACCELERATION, WANTED = RNG.uniform((0.0, -FALL, 0.0), (3.0, RISE, 3.0), (12, 3)).T


def one(ramps: Ramps, number: int, count: int = 2001) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, speeds and distances of one change, by sums of small steps."""
    time = np.linspace(0.0, float(ramps.duration[number]), count)
    acceleration = np.interp(time, ramps.knots[number], ramps.acceleration[number])
    step = np.diff(time)
    speed = ramps.start_speed[number] + np.append(0.0, np.cumsum(0.5 * step * (acceleration[1:] + acceleration[:-1])))
    return time, speed, np.append(0.0, np.cumsum(0.5 * step * (speed[1:] + speed[:-1])))


def test_changes_of_speed_end_at_the_speed_that_is_wanted_within_limits() -> None:
    ramps = Ramps.between(SPEED, ACCELERATION, WANTED, RISE, FALL, JERK)
    assert np.array_equal(ramps.acceleration[:, 0], ACCELERATION) and not ramps.acceleration[:, -1].any()
    assert ramps.acceleration.max() <= RISE and ramps.acceleration.min() >= -FALL
    length = np.diff(ramps.knots, axis=1)
    assert length.min() >= 0.0
    assert np.all(np.abs(np.diff(ramps.acceleration, axis=1)) <= JERK * length + 1e-12)
    for number, wanted in enumerate(WANTED):
        time, speed, driven = one(ramps, number)
        assert speed[-1] == pytest.approx(wanted, abs=1e-5)
        assert ramps.way[number] == pytest.approx(driven[-1], abs=1e-5)
        assert ramps.distance(time[None] * np.ones((len(WANTED), 1)))[number] == pytest.approx(driven, abs=1e-5)
        assert ramps.fastest[number] == pytest.approx(speed.max(), abs=1e-5)


def test_on_from_the_end_the_speed_is_kept() -> None:
    ramps = Ramps.between(np.array([1.0]), np.array([0.3]), np.array([2.0]), RISE, FALL, JERK)
    ends = float(ramps.duration[0])
    assert ramps.distance(np.array([[ends + 0.7]]))[0, 0] == pytest.approx(float(ramps.way[0]) + 1.4)


def driver(speed: float, acceleration: float, step: float = 1e-4) -> tuple[float, float]:
    """Time and way of who brakes harder and harder, as hard as he may, until he must let go so as not to go back."""
    time = way = 0.0
    while speed > 0.0:
        must_let_go = acceleration < 0.0 and speed <= acceleration**2 / (2.0 * JERK)
        change = JERK if must_let_go else -JERK
        after = max(acceleration + change * step, -FALL)
        if must_let_go and after > 0.0:
            break
        mean = 0.5 * (acceleration + after)
        way += speed * step + 0.5 * mean * step**2
        speed, acceleration, time = speed + mean * step, after, time + step
    return time, way


@pytest.mark.parametrize(("speed", "acceleration"), [(3.0, 1.5), (0.4, 0.0), (0.05, 0.6), (1.2, -1.9), (0.3, -1.5)])
def test_no_driver_stops_sooner(speed: float, acceleration: float) -> None:
    stop = Ramps.stopping(np.array([speed]), np.array([acceleration]), FALL, JERK)
    time, way = driver(speed, acceleration)
    assert float(stop.duration[0]) == pytest.approx(time, abs=1e-2)
    assert float(stop.way[0]) == pytest.approx(way, abs=1e-4)
    _, speeds, _ = one(stop, 0)
    assert speeds.min() > -1e-6


def test_who_brakes_too_hard_for_his_speed_lets_go_with_more_jerk() -> None:
    """From 0.1 m/s at -2 m/s2 he stands after 0.1 s, if he lets go of the brake with 20 m/s3."""
    stop = Ramps.stopping(np.array([0.1]), np.array([-2.0]), FALL, JERK)
    assert float(stop.duration[0]) == pytest.approx(0.1)
    assert float(stop.way[0]) == pytest.approx(0.1 * 0.1 - 2.0 * 0.1**2 / 2.0 + 20.0 * 0.1**3 / 6.0, abs=1e-12)
    _, speeds, _ = one(stop, 0)
    assert speeds.min() >= -1e-12


def test_a_stop_that_is_begun_again_is_the_same_stop() -> None:
    """The fastest stop from any moment of the fastest stop is what is left of it."""
    whole = Ramps.stopping(np.array([2.5]), np.array([1.0]), FALL, JERK)
    time, speed, driven = one(whole, 0, 20001)
    some = slice(500, 20000, 1500)
    acceleration = np.interp(time[some], whole.knots[0], whole.acceleration[0])
    rest = Ramps.stopping(speed[some], acceleration, FALL, JERK)
    assert rest.duration == pytest.approx(whole.duration - time[some], abs=1e-3)
    assert rest.way == pytest.approx(driven[-1] - driven[some], abs=1e-5)


def test_who_stands_goes_on_standing() -> None:
    stop = Ramps.stopping(np.zeros(2), np.array([0.0, -1e-6]), FALL, JERK)
    assert not stop.duration.any() and not stop.way.any() and not stop.acceleration.any()


def test_ramps_are_chosen_one_by_one() -> None:
    speed, acceleration = np.array([1.0, 1.0]), np.zeros(2)
    slower = Ramps.between(speed, acceleration, np.zeros(2), RISE, FALL, JERK)
    faster = Ramps.between(speed, acceleration, np.full(2, 2.0), RISE, FALL, JERK)
    both = slower.where(np.array([True, False]), faster)
    assert math.isclose(both.way[0], slower.way[0]) and math.isclose(both.way[1], faster.way[1])
