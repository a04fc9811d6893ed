"""See three craft through a noisy radar, plan round where they may be, and draw where they really went.

Their true motion is known here, but the planner gets only noisy positions. The zones hold all three craft, at all
times of the trip, with the probability that is asked for.

    python examples/noisy_radar.py [-o noisy_radar.png] [--noise 0.08] [--seed 0] [--probability 0.95]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import scp_planner as sp
from scp_planner.plotting import plot_plan

TRUTH = {  # position, velocity and acceleration at t = 0
    "ferry": sp.Motion(position=(9.0, -5.5), velocity=(0.0, 1.5), acceleration=(0.0, -0.05)),
    "skiff": sp.Motion(position=(14.5, 6.5), velocity=(-0.3, -1.2)),
    "tug": sp.Motion(position=(19.0, -1.5), velocity=(-1.0, 0.1), acceleration=(0.05, 0.0)),
}
RADIUS = {"ferry": 0.8, "skiff": 0.5, "tug": 0.6}
SEEN = np.linspace(-3.0, 0.0, 31)  # s: three seconds at 10 Hz


def centre(motion: sp.Motion, t: np.ndarray) -> np.ndarray:
    """Where a craft truly is at times (n,) s, (n, 2) m."""
    t = np.asarray(t)[:, None]
    return np.array(motion.position) + np.array(motion.velocity) * t + 0.5 * np.array(motion.acceleration) * t**2


def observed(name: str, noise: float, rng: np.random.Generator) -> sp.Obstacle:
    """A craft as the planner knows it: what the radar saw of it."""
    positions = centre(TRUTH[name], SEEN) + rng.normal(0.0, noise, (len(SEEN), 2))
    observations = sp.Observations(
        time=SEEN.tolist(), position=positions.tolist(), covariance=[[noise**2, 0.0], [0.0, noise**2]]
    )
    return sp.Obstacle(id=name, shape=sp.Disc(disc=RADIUS[name]), observations=observations)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("noisy_radar.png"), help="figure to write")
    parser.add_argument("--noise", type=float, default=0.05, help="standard deviation of a coordinate, m")
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    parser.add_argument("--probability", type=float, default=0.95, help="that no craft ever leaves its zone")
    options = parser.parse_args(argv)

    rng = np.random.default_rng(options.seed)
    scenario = sp.Scenario(
        name="noisy radar",
        vehicle=sp.Vehicle(
            radius=0.3,
            max_speed=3.0,
            max_acceleration=1.5,
            max_deceleration=2.0,
            max_lateral_acceleration=2.0,
            max_curvature=1.0,
        ),
        start=sp.Start(time=0.0, position=(0.0, 0.0), heading=0.0, speed=1.0),
        goal=sp.Goal(position=(20.0, 0.0)),
        confidence=sp.Confidence(probability=options.probability, level="joint"),
        obstacles=[observed(name, options.noise, rng) for name in TRUTH],
    )
    plan = sp.plan(scenario)

    print(f"{plan.status}: {plan.travel_time:.3f} s")
    times = np.linspace(plan.start_time, plan.arrival_time, 1000)
    for zone in sp.zones(scenario):
        true_centre = centre(TRUTH[zone.id], times)
        # The zone holds the whole disc as long as it holds the centre with the disc's radius to spare.
        spare = -(zone.signed_distance(times, true_centre).max() + RADIUS[zone.id])
        gap = np.linalg.norm(plan.position(times) - true_centre, axis=1).min() - RADIUS[zone.id] - 0.3
        print(f"  {zone.id}: {'stayed in' if spare >= 0 else 'LEFT'} its zone; passed at {gap:.2f} m")
    truth = {name: lambda t, motion=motion: centre(motion, t) for name, motion in TRUTH.items()}
    plot_plan(plan, scenario, options.output, truth=truth)
    print(f"wrote {options.output}")
    return 0 if plan.certified else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(f"{missing}: pip install 'scp-planner[plot]'") from None
