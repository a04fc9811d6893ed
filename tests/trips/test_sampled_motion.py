"""What is made of samples between them, against the equations that define it and motions with known derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from scp_planner import SampledTrajectory
from scp_planner.trips.sampled_motion import EndVelocity, SampledMotion, velocities

pytestmark = pytest.mark.numerics

Array = np.ndarray


def random_samples(seed: int, count: int = 9) -> SampledTrajectory:
    rng = np.random.default_rng(seed)
    time = 3.0 + np.cumsum(rng.uniform(0.05, 0.8, count))
    position = np.cumsum(rng.normal(0.3, 0.4, (count, 2)), axis=0)
    return SampledTrajectory(time, position, rng.uniform(-3.0, 3.0, count), rng.uniform(0.0, 2.0, count))


@pytest.mark.parametrize("seed", range(5))
def test_the_accelerations_are_those_that_lead_from_one_sample_to_the_next(seed: int) -> None:
    """The two accelerations by solving for velocity and displacement after both halves."""
    samples = random_samples(seed)
    speed, heading = samples.speed, samples.heading
    assert speed is not None and heading is not None
    velocity = speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    motion = SampledMotion.between(samples, velocities(samples))
    for k, step in enumerate(np.diff(samples.time)):
        half = 0.5 * step
        # v1 = v0 + (a1 + a2) half; p1 = p0 + v0 step + a1 (half^2 / 2 + half^2) + a2 half^2 / 2
        system = np.array([[half, half], [1.5 * half**2, 0.5 * half**2]])
        moved = samples.position[k + 1] - samples.position[k] - velocity[k] * step
        wanted = np.linalg.solve(system, np.stack([velocity[k + 1] - velocity[k], moved]))
        np.testing.assert_allclose(motion.acceleration[2 * k : 2 * k + 2], wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_position_and_velocity_are_continuous(seed: int) -> None:
    samples = random_samples(seed)
    motion = SampledMotion.between(samples, velocities(samples))
    every = np.arange(len(motion.begin))
    for at in (motion.position_at, motion.velocity_at):
        np.testing.assert_allclose(at(every[:-1], motion.end[:-1]), at(every[1:], motion.begin[1:]), atol=1e-12)
    np.testing.assert_array_equal(motion.position_at(every[::2], samples.time[:-1]), samples.position[:-1])


def test_a_constant_acceleration_is_met_exactly_even_from_positions_alone() -> None:
    time = np.array([0.0, 0.3, 0.5, 1.1, 1.2])
    acceleration = np.array([0.7, -0.4])
    position = np.array([1.0, 2.0]) + np.outer(time, [1.0, 0.5]) + 0.5 * np.outer(time**2, acceleration)
    samples = SampledTrajectory(time, position)
    found = velocities(samples)
    np.testing.assert_allclose(found, np.array([1.0, 0.5]) + np.outer(time, acceleration), atol=1e-12)
    motion = SampledMotion.between(samples, found)
    np.testing.assert_allclose(motion.acceleration, np.tile(acceleration, (8, 1)), atol=1e-11)


def test_a_constant_jerk_is_missed_by_what_is_said() -> None:
    step, jerk = 0.4, 3.0
    samples = SampledTrajectory(
        [0.0, step], [[0.0, 0.0], [jerk * step**3 / 6.0, 0.0]], [0.0, 0.0], [0.0, jerk * step**2 / 2.0]
    )
    motion = SampledMotion.between(samples, velocities(samples))
    t = np.linspace(0.0, step, 1201)
    piece = (t > 0.5 * step).astype(np.intp)
    position = np.abs(motion.position_at(piece, t)[:, 0] - jerk * t**3 / 6.0).max()
    velocity = np.abs(motion.velocity_at(piece, t)[:, 0] - jerk * t**2 / 2.0).max()
    acceleration = np.abs(motion.acceleration[piece][:, 0] - jerk * t).max()
    assert position == pytest.approx(jerk * step**3 / 324.0, rel=1e-4)
    assert velocity == pytest.approx(jerk * step**2 / 24.0, rel=1e-9)
    assert acceleration == pytest.approx(jerk * step / 3.0, rel=1e-9)
    assert motion.acceleration[:, 0].min() >= 0.0 and motion.acceleration[:, 0].max() <= jerk * step


@pytest.mark.parametrize("share", np.linspace(0.02, 0.98, 13))
def test_a_jump_of_the_acceleration_is_overshot_by_an_eighth_of_it_at_most(share: float) -> None:
    """The acceleration is 0 for a share of the time and 1 for the rest."""
    driven, speed = 0.5 * (1.0 - share) ** 2, 1.0 - share
    samples = SampledTrajectory([0.0, 1.0], [[0.0, 0.0], [1.0 + driven, 0.0]], [0.0, 0.0], [1.0, 1.0 + speed])
    found = SampledMotion.between(samples, velocities(samples)).acceleration[:, 0]
    assert -0.125 - 1e-12 <= found.min() and found.max() <= 1.125 + 1e-12


def test_what_is_missing_comes_from_the_positions() -> None:
    time, position = [0.0, 1.0, 2.0, 4.0], [[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [2.0, 3.0]]
    every = velocities(SampledTrajectory(time, position))
    np.testing.assert_allclose(every[1], [1.0, 0.5])  # the mean of (1, 0) and (1, 1)
    np.testing.assert_allclose(every[2], [2.0 / 3.0, 1.0])  # weighted by the other side's time
    fast = velocities(SampledTrajectory(time, position, speed=[2.0, 2.0, 2.0, 2.0]))
    np.testing.assert_allclose(fast, 2.0 * every / np.hypot(*every.T)[:, None])
    turned = velocities(SampledTrajectory(time, position, heading=[0.0, 0.0, np.pi / 2, np.pi / 2]))
    np.testing.assert_allclose(turned[1:3], [[1.0, 0.0], [0.0, 1.0]], atol=1e-12)


def test_ends_are_as_fast_as_is_known_from_elsewhere() -> None:
    time, position = [0.0, 1.0, 2.0], [[0.0, 0.0], [1.0, 0.0], [2.0, 1.0]]
    first, last = EndVelocity(3.0, np.pi / 2), EndVelocity(0.0, None)
    found = velocities(SampledTrajectory(time, position), first, last)
    np.testing.assert_allclose(found[[0, -1]], [[0.0, 3.0], [0.0, 0.0]], atol=1e-12)
    # What the samples say themselves is left as it is.
    given = velocities(SampledTrajectory(time, position, [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]), first, last)
    np.testing.assert_allclose(given, [[1.0, 0.0]] * 3)


def test_a_vehicle_that_stays_where_it_is_stands() -> None:
    time, position = [0.0, 1.0, 2.0, 3.0, 4.0], [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0]]
    found = velocities(SampledTrajectory(time, position))
    np.testing.assert_array_equal(found[1:4], np.zeros((3, 2)))
    motion = SampledMotion.between(SampledTrajectory(time, position), found)
    assert (motion.velocity_at(np.arange(8), motion.end)[:, 0] >= 0.0).all()
