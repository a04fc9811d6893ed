"""Cross among five accelerating craft that a noisy radar sees: observe, replan ten times a second, drive.

Only the simulation knows how the craft really move. The planner begins with what the radar saw before the start, and
its zones shrink while it drives.

    python examples/closed_loop_radar.py [-o closed_loop_radar.png] [--noise 0.1] [--seed 0] [--animate radar.gif]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import scp_planner as sp
from scp_planner.plotting import animate, plot_run

CRAFT = {  # position, velocity and acceleration at t = 0, and radius
    "ferry": ((9.0, -5.5), (0.0, 1.5), (0.0, -0.05), 0.8),
    "skiff": ((14.5, 6.5), (-0.3, -1.2), (0.0, 0.05), 0.5),
    "tug": ((21.0, -1.5), (-1.0, 0.1), (0.05, 0.0), 0.6),
    "yacht": ((5.0, 4.0), (0.4, -1.0), (0.0, 0.1), 0.5),
    "barge": ((17.0, -7.0), (-0.2, 0.9), (0.0, 0.05), 0.7),
}


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("closed_loop_radar.png"), help="figure to write")
    parser.add_argument("--animate", type=Path, help="animation to write, .gif or .mp4")
    parser.add_argument("--noise", type=float, default=0.1, help="standard deviation of a coordinate, m")
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    options = parser.parse_args(argv)

    scenario = sp.Scenario(
        name="radar, closed loop",
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
        confidence=sp.Confidence(probability=0.99, level="joint"),
        obstacles=[
            sp.Obstacle(id=name, shape=sp.Disc(disc=radius), motion=sp.Motion(position=p, velocity=v, acceleration=a))
            for name, (p, v, a, radius) in CRAFT.items()
        ],
    )
    run = sp.simulate(scenario, noise=options.noise, rate=10.0, seed=options.seed)

    end = "arrived" if run.arrived else "did not arrive"
    print(f"{end} after {run.travel_time:.2f} s in {len(run.records)} cycles")
    print(f"  knowing the truth: {sp.plan(scenario).travel_time:.2f} s")
    print(f"  least distance to a true craft: {run.least_clearance:.2f} m")
    print("  " + ", ".join(f"{count} {outcome}" for outcome, count in run.outcomes.items() if count))
    plot_run(run, options.output)
    print(f"wrote {options.output}")
    if options.animate is not None:
        animate(run.recording(), options.animate)
        print(f"wrote {options.animate}")
    return 0 if run.arrived and not run.contact else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(f"{missing}: pip install 'scp-planner[plot]'") from None
